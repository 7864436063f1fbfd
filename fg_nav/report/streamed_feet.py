"""The files of a walk of two feet that was followed as it was walked.

=========================== ================================================================================
trajectory.tum, person.csv  of the person, between the feet; of the foot that is left where they were not tied
trajectory_left/_right.tum  of each foot, as trajectory.tum of a stream
strides_left/_right.csv     of each foot, as strides.csv of a stream
online_left/_right.csv      of each foot, its estimates of the moment, as online.csv of a stream
summary.json                figures of the person, width and ties, and each foot's as left and right
=========================== ================================================================================

Of a foot that has no walk there are no files, and its part of the summary says why as `lost`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fg_nav.evaluation.metrics import evaluate
from fg_nav.feet import SIDES, Side
from fg_nav.feet.person import FeetSolution
from fg_nav.feet_result import solve_person
from fg_nav.report.files import Summary, describe_end, summarize, write_foot, write_json, write_person, write_strides
from fg_nav.solution import Solution
from fg_nav.walk import Outcome, Walk


def write_streamed_feet(
    folder: Path, feet: Mapping[Side, Solution], both: FeetSolution | None, summary: Summary
) -> None:
    """Write what came of both feet into an existing folder."""
    write_person(folder, _take_person(feet, both))
    for side, foot in feet.items():
        write_foot(folder, side, foot)
        if foot.moment is not None:
            write_strides(folder / f"online_{side}.csv", foot.moment)
    write_json(folder / "summary.json", summary)


def summarize_streamed_feet(
    feet: Mapping[Side, tuple[Walk, Outcome]], both: FeetSolution | None, lost: Mapping[Side, str]
) -> Summary:
    """Figures of merit of the person, how the feet were put together, and those of each foot, or why it is lost."""
    known = {side: summarize(*one) for side, one in feet.items()}
    of_feet: Summary = {side: {"lost": lost[side]} if side in lost else known[side] for side in SIDES}
    person = _take_person({side: outcome.solution for side, (_, outcome) in feet.items()}, both)
    metrics = evaluate(person)
    figures: Summary = {
        "method": person.method,
        "mount": "feet",
        "duration_s": float(person.t[-1] - person.t[0]),
        "distance_m": metrics.distance_m,
        "strides": metrics.strides_detected,
        "closure_m": metrics.closure_m,
        **describe_end(person.stances),
        "tied": both is not None,
    }
    if both is not None:
        figures |= {"width_m": both.width_m, "width_sigma_m": both.width_sigma_m}
        figures |= {"cells": both.cells, "beyond_reach": both.beyond_reach}
    return figures | of_feet


def _take_person(feet: Mapping[Side, Solution], both: FeetSolution | None) -> Solution:
    """Return the path of the person: between the feet, or that of the first one where they were not tied."""
    first = next(iter(feet.values()))
    return first if both is None else solve_person(both.person, first, first.runtime_s)
