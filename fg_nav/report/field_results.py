"""The files of a look at the field, and the table that is printed.

==================== =======================================================================================
field.csv            one row a footfall: `FOOTFALL_COLUMNS`, then statistic and verdict of each detector
detect.json          what was looked at, the coverage and the parameters of each detector
==================== =======================================================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from rich.table import Table

from fg_nav.arrays import Floats
from fg_nav.magnetic import FieldVerdicts
from fg_nav.magnetic.disturbance import SETTINGS
from fg_nav.magnetic.quasi_static import find_detector
from fg_nav.report.field_survey import SAMPLEWISE, Coverage, FieldSurvey
from fg_nav.report.results import recording_facts, remarks, write_json
from fg_nav.report.terminal import console, print_place, ruled_table

if TYPE_CHECKING:
    from fg_nav.session import Session

FOOTFALL_COLUMNS = (
    "index", "time_s", "strength_uT", "inclination_deg", "compass_heading_deg", "gyro_heading_deg", "difference_deg",
)  # fmt: skip


def write_survey(folder: Path, session: Session, survey: FieldSurvey) -> None:
    """Write both files into an existing folder."""
    frame = footfall_frame(survey)
    frame["time_s"] = frame["time_s"].map("{:.9f}".format)  # nine digits would blur the stamps of a clock
    frame.to_csv(folder / "field.csv", index=False, float_format="%.9g")
    write_json(folder / "detect.json", facts(session, survey))


def footfall_frame(survey: FieldSurvey) -> pd.DataFrame:
    """Table of the footfalls; headings in [0, 360) deg clockwise from north, differences in [-180, 180)."""
    field = survey.field
    columns = [
        np.arange(len(field)), field.t, field.strength, np.degrees(field.inclination),
        np.degrees(survey.compass_heading) % 360.0, np.degrees(field.gyro_heading) % 360.0,
        np.degrees(survey.difference),
    ]  # fmt: skip
    table: dict[str, object] = dict(zip(FOOTFALL_COLUMNS, columns, strict=True))
    for name, verdicts in survey.verdicts.items():
        table |= {f"{name}_statistic": verdicts.statistic, f"{name}_verdict": verdicts.words}
    return pd.DataFrame(table)


def facts(session: Session, survey: FieldSurvey) -> dict[str, object]:
    """Everything needed to do it again, and the coverage."""
    field = survey.field
    return {
        **recording_facts(session),
        "notes": survey_notes(session),
        "path_method": survey.solution.method,
        "earth": survey.earth,
        "footfalls": len(field),
        "footfalls_with_field": int(np.isfinite(field.strength).sum()),
        "strength_median_uT": _median(field.strength),
        "inclination_median_deg": _median(np.degrees(field.inclination)),
        "drawn_in_colour": survey.chosen,
        "detectors": {one.detector: _of_detector(one, survey.verdicts[one.detector]) for one in survey.coverage},
    }


def _of_detector(found: Coverage, verdicts: FieldVerdicts) -> dict[str, object]:
    return {
        "threshold": verdicts.threshold,
        "judged": found.judged,
        "quasi_static": found.accepted,
        "share": found.share,
        "longest_run": found.longest_run,
        "change_deg": found.change_deg,
        "change_all_deg": found.change_all_deg,
        "parameters": SETTINGS if found.detector == SAMPLEWISE else find_detector(found.detector),
    }


def _median(values: Floats) -> float:
    return float(np.median(values[np.isfinite(values)]))


def print_survey(session: Session, survey: FieldSurvey, place: Path) -> None:
    """Print the coverage of each detector and how to read it, the notes, and where the files are."""
    out = console()
    out.print(coverage_table(survey.coverage))
    out.print(READING, soft_wrap=True)
    print_place(survey_notes(session), place)


READING = (
    "change: of compass minus gyroscope from one footfall to the next, median; where both footfalls pass, and of all. "
    "The gyroscope keeps to a tenth of a degree meanwhile: the rest is the field's."
)


LONGEST_SWING_S = 10.0
"""Between two stances; where none is found for longer nobody walks on that foot."""


def survey_notes(session: Session) -> list[str]:
    """Remarks on the session, and what else the shares have to be read with."""
    notes = remarks(session)
    calibration = session.calibration
    if calibration is None or calibration.magnetometer is None:
        notes.append("no calibration: what magnetometer and shoe add turns with the foot, and counts as disturbance")
    return notes + _footless(session)


def _footless(session: Session) -> list[str]:
    t, stances = session.recording.t, session.stances
    swing_s = t[stances.start[1:]] - t[stances.stop[:-1] - 1]
    k = int(np.argmax(swing_s)) if len(swing_s) else 0
    if not len(swing_s) or swing_s[k] < LONGEST_SWING_S:
        return []
    return [
        f"no footfall for {swing_s[k]:.0f} s from {t[stances.stop[k] - 1]:.0f} s on: the shares are of the rest; a "
        f"sensor in a pocket never stands, look at its samples with --detector {SAMPLEWISE}"
    ]


def coverage_table(found: Sequence[Coverage]) -> Table:
    """One row a detector."""
    table = ruled_table(
        "detector", "judged", "quasi-static", "of all", "longest run", "change, passing", "change, all"
    )  # fmt: skip
    for one in found:
        counts = (str(one.judged), str(one.accepted), f"{100 * one.share:.1f} %", str(one.longest_run))
        table.add_row(one.detector, *counts, _degrees(one.change_deg), _degrees(one.change_all_deg))
    return table


def _degrees(value: float) -> str:
    return f"{value:.1f} deg" if np.isfinite(value) else "-"
