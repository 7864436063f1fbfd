"""`fg-nav detect`: what each detector makes of the field along a walk, at its footfalls or at every sample."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from fg_nav.commands.shared import (
    Answer,
    Target,
    choose_options,
    choose_reading,
    name_walk,
    run_methods,
)
from fg_nav.earth import Place, compute_field
from fg_nav.errors import MagneticError
from fg_nav.lab.drawing import draw_survey, plot_samples
from fg_nav.lab.field_survey import (
    SAMPLEWISE,
    SETTINGS,
    FieldSurvey,
    SampleSurvey,
    judge_samples,
    parse_detectors,
    require_field,
    survey_field,
)
from fg_nav.lab.verbs import DetectRequest
from fg_nav.lab.verbs.allan import print_place
from fg_nav.magnetic.detectors import find_detector
from fg_nav.pipeline import prepare_walk
from fg_nav.report.files import collect_remarks, describe_recording, write_json
from fg_nav.report.plots.style import save
from fg_nav.report.terminal import console, listing, ruled_table
from fg_nav.walk import Walk, correct_walk, read_walk

PATH_METHOD = "iez"  # Draws the path on which the field is looked at: quick, and good enough for a map.
MAX_SWING_S = 10.0  # Between two stances; where none is found for longer, that foot does not walk.

DETECT_FILES = frozenset({"field.png", "field_map.png", "field.csv", "detect.json"})
FOOTFALL_COLUMNS = (
    "index", "time_s", "strength_uT", "inclination_deg", "compass_heading_deg", "gyro_heading_deg", "difference_deg",
)  # fmt: skip


def detect(request: DetectRequest) -> Answer:
    """Judge the field by the detectors of a list with commas, and write what they find into a folder."""
    names, file = parse_detectors(request.gate), request.recording
    options, reading = choose_options(request), choose_reading(request)
    if names == [SAMPLEWISE] and (request.place is not None or request.truth is not None):
        raise MagneticError(f"{SAMPLEWISE} alone draws no map and no headings: leave --place and --truth out.")
    with Target(request.out, request.force, f"{name_walk(file)}-detect", DETECT_FILES) as target:
        if names == [SAMPLEWISE]:
            walk = correct_walk(read_walk(file, options, reading))
            if walk.recording.mag is None and walk.magnetometer is not None and walk.magnetometer.notes:
                raise MagneticError(f"{walk.magnetometer.notes[0]}.")
            samples = judge_samples(walk.recording)
            content = describe_samples(walk, samples)
            with target.open() as folder:
                save(plot_samples(samples), folder / "field.png")
                write_json(folder / "detect.json", content)
            show = partial(print_samples, walk, samples, target.place)
        else:
            earth = None if request.place is None else compute_field(Place.parse(request.place))
            walk = prepare_walk(read_walk(file, options, reading))
            field = require_field(walk)
            outcome = run_methods(walk, [PATH_METHOD])[PATH_METHOD]
            survey = survey_field(walk.recording, field, names, outcome.solution, earth)
            with target.open() as folder:
                write_survey(folder, walk, survey)
                draw_survey(folder, walk, survey, outcome)
            content, show = describe_survey(walk, survey), partial(print_survey, walk, survey, target.place)
    return Answer({"folder": str(target.place), **content}, show)


def write_survey(folder: Path, walk: Walk, survey: FieldSurvey) -> None:
    """Write both files into an existing folder."""
    frame = tabulate_footfalls(survey)
    frame["time_s"] = frame["time_s"].map("{:.9f}".format)  # nine digits would blur the stamps of a clock
    frame.to_csv(folder / "field.csv", index=False, float_format="%.9g")
    write_json(folder / "detect.json", describe_survey(walk, survey))


def tabulate_footfalls(survey: FieldSurvey) -> pd.DataFrame:
    """Return a table, one row a footfall; headings in [0, 360) deg clockwise from north, differences in [-180, 180)."""
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


def describe_survey(walk: Walk, survey: FieldSurvey) -> dict[str, object]:
    """Return for JSON all that reproduces the survey, and the coverage of each detector."""
    field = survey.field
    strength, inclination = field.strength, np.degrees(field.inclination)
    detectors = {}
    for one in survey.coverage:
        counts = {"judged": one.judged, "quasi_static": one.accepted, "share": one.share}
        runs = {name: getattr(one, name) for name in ("longest_run", "change_deg", "change_all_deg")}
        parameters = SETTINGS if one.detector == SAMPLEWISE else find_detector(one.detector)
        threshold = survey.verdicts[one.detector].threshold
        detectors[one.detector] = {"threshold": threshold, **counts, **runs, "parameters": parameters}
    return {
        **describe_recording(walk),
        "notes": collect_survey_notes(walk),
        "path_method": survey.solution.method,
        "earth": survey.earth,
        "footfalls": len(field),
        "footfalls_with_field": int(np.isfinite(strength).sum()),
        "strength_median_uT": float(np.median(strength[np.isfinite(strength)])),
        "inclination_median_deg": float(np.median(inclination[np.isfinite(inclination)])),
        "drawn_in_colour": survey.chosen,
        "detectors": detectors,
    }


def print_survey(walk: Walk, survey: FieldSurvey, place: Path) -> None:
    """Print the coverage of each detector and how to read it, the notes, and where the files are."""
    out = console()
    heads = ("detector", "judged", "quasi-static", "of all", "longest run", "change, passing", "change, all")
    table = ruled_table(*heads)
    for one in survey.coverage:
        counts = (str(one.judged), str(one.accepted), f"{100 * one.share:.1f} %", str(one.longest_run))
        changes = (one.change_deg, one.change_all_deg)
        table.add_row(one.detector, *counts, *(f"{deg:.1f} deg" if np.isfinite(deg) else "-" for deg in changes))
    out.print(table)
    out.print(
        "change: of compass minus gyroscope from one footfall to the next, median; where both footfalls pass, and of "
        "all. The gyroscope keeps to a tenth of a degree meanwhile: the rest is the field's.",
        soft_wrap=True,
    )
    print_place(collect_survey_notes(walk), place)


def collect_survey_notes(walk: Walk) -> list[str]:
    """Return remarks on the walk, and caveats on the shares of accepted footfalls."""
    notes, calibration = collect_remarks(walk), walk.calibration
    if calibration is None or calibration.magnetometer is None:
        notes.append(
            "no calibration: iron that the walk itself did not show turns with the foot, and counts as disturbance"
        )
    # The longest swing.
    t, stances = walk.recording.t, walk.stances
    swing_s = t[stances.start[1:]] - t[stances.stop[:-1] - 1]
    k = int(np.argmax(swing_s)) if len(swing_s) else 0
    if len(swing_s) and swing_s[k] >= MAX_SWING_S:
        notes.append(
            f"no footfall for {swing_s[k]:.0f} s from {t[stances.stop[k] - 1]:.0f} s on: the shares are of the rest; a "
            f"sensor in a pocket never stands, look at its samples with --gate {SAMPLEWISE}"
        )
    return notes


def describe_samples(walk: Walk, survey: SampleSurvey) -> dict[str, object]:
    """Return for JSON all that reproduces the survey of the samples, and its result."""
    found = {
        "judged": int(survey.judged.sum()),
        "quasi_static": int(survey.quasi_static.sum()),
        "share": survey.share,
        "longest_s": survey.longest_s,
        "parameters": SETTINGS,
    }
    return {**describe_recording(walk), "notes": collect_remarks(walk), "sample_detectors": {SAMPLEWISE: found}}


def print_samples(walk: Walk, survey: SampleSurvey, place: Path) -> None:
    """Print what passes, the notes, and where the files are."""
    rows = [
        ("detector", f"{SAMPLEWISE}, sample by sample"),
        ("judged", f"{int(survey.judged.sum())} of {len(survey.t)} samples"),
        ("quasi-static", f"{100 * survey.share:.1f} % of them"),
        ("longest stretch", f"{survey.longest_s:.1f} s"),
    ]
    console().print(listing(rows))
    print_place(collect_remarks(walk), place)
