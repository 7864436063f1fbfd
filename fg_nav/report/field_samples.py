"""The sample-wise detector over a whole recording, for a sensor that never stands: in a pocket or in a hand.

================ ==================================================================================
field.png        strength and the detector's statistic over time, and a lane of its verdicts
detect.json      what was looked at, share of the samples that pass, longest stretch, parameters
================ ==================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.arrays import Floats
from fg_nav.magnetic.disturbance import SETTINGS, WINDOW_S, Disturbance, judge_samples
from fg_nav.recording import Recording
from fg_nav.report import style
from fg_nav.report.field import LEAST_SPAN_UT, span_at_least
from fg_nav.report.field_survey import SAMPLEWISE
from fg_nav.report.lanes import draw_lanes
from fg_nav.report.results import recording_facts, remarks, write_json
from fg_nav.report.terminal import console, listing, print_place
from fg_nav.report.thinning import envelope
from fg_nav.stances import runs

if TYPE_CHECKING:
    from fg_nav.session import Session


@dataclass(frozen=True)
class SampleSurvey:
    """The field at every sample, and what the detector makes of it.

    Attributes
    ----------
    t : (N,) s.
    strength : (N,) uT; NaN where it was not measured.
    verdicts : of N samples.
    """

    t: Floats
    strength: Floats
    verdicts: Disturbance

    @property
    def share(self) -> float:
        """Samples that pass, of those that were judged."""
        judged = int(self.verdicts.judged.sum())
        return float(self.verdicts.quasi_static.sum()) / judged if judged else 0.0

    @property
    def longest_s(self) -> float:
        """Time of the longest stretch that passes."""
        first, after = runs(self.verdicts.quasi_static)
        return float(np.max(self.t[after - 1] - self.t[first], initial=0.0))


def sampled(recording: Recording) -> SampleSurvey:
    """Judge every sample; raises `MagneticError` without a field, or with too few samples of it."""
    verdicts = judge_samples(recording)
    assert recording.mag is not None  # or it would have been refused
    return SampleSurvey(recording.t, np.linalg.norm(recording.mag, axis=1), verdicts)


def write_samples(folder: Path, session: Session, survey: SampleSurvey) -> None:
    """Write both files into an existing folder."""
    style.save(plot_samples(survey), folder / "field.png")
    write_json(folder / "detect.json", sample_facts(session, survey))


def sample_facts(session: Session, survey: SampleSurvey) -> dict[str, object]:
    """Everything needed to do it again, and what came out."""
    found = {
        "judged": int(survey.verdicts.judged.sum()),
        "quasi_static": int(survey.verdicts.quasi_static.sum()),
        "share": survey.share,
        "longest_s": survey.longest_s,
        "parameters": SETTINGS,
    }
    return {**recording_facts(session), "notes": remarks(session), "sample_detectors": {SAMPLEWISE: found}}


def print_samples(session: Session, survey: SampleSurvey, place: Path) -> None:
    """Print what passes, the notes, and where the files are."""
    rows = [
        ("detector", f"{SAMPLEWISE}, sample by sample"),
        ("judged", f"{int(survey.verdicts.judged.sum())} of {len(survey.t)} samples"),
        ("quasi-static", f"{100 * survey.share:.1f} % of them"),
        ("longest stretch", f"{survey.longest_s:.1f} s"),
    ]
    console().print(listing(rows))
    print_place(remarks(session), place)


def plot_samples(survey: SampleSurvey) -> Figure:
    """Draw strength, statistic and verdicts over time."""
    with style.styled():
        figure = style.new_figure(4.8)
        strength, statistic, lane = figure.subplots(3, 1, sharex=True, height_ratios=[6, 6, 1])
        strength.plot(*envelope(survey.t, survey.strength), color=style.BLUE, linewidth=0.8)
        span_at_least(strength, LEAST_SPAN_UT)
        strength.set_ylabel("strength (uT)")
        style.head(strength, "Strength of the field at every sample")
        _draw_statistic(statistic, survey)
        words = f"Verdicts, and the share of all samples that pass; longest stretch {survey.longest_s:.0f} s"
        draw_lanes(lane, survey.t, {SAMPLEWISE: survey.verdicts}, words)
        lane.set_xlim(survey.t[0], survey.t[-1])
        lane.set_xlabel("time (s)")
    return figure


def _draw_statistic(axes: Axes, survey: SampleSurvey) -> None:
    axes.plot(*envelope(survey.t, survey.verdicts.statistic), color=style.BLUE, linewidth=0.8)
    axes.axhline(1.0, color=style.VERMILION, linewidth=1.1, label="threshold: below it the field passes")
    axes.set_yscale("log")
    axes.set_ylabel("statistic / threshold")
    style.head(axes, f"Scatter of the strength over the {WINDOW_S:g} s before")
