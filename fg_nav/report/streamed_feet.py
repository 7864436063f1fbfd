"""The files of a walk of two feet that was followed as it was walked.

=========================== ================================================================================
trajectory.tum              of the person, between the feet; of the foot that is left where they were not tied
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

import numpy as np

from fg_nav.arrays import interpolate_columns
from fg_nav.feet.person import FeetSolution
from fg_nav.feet.sides import SIDES, Side
from fg_nav.io import write_tum
from fg_nav.report.files import Summary, summarize, write_json, write_strides
from fg_nav.solution import Solution
from fg_nav.walk import Outcome, Walk


def write_streamed_feet(
    folder: Path, feet: Mapping[Side, Solution], both: FeetSolution | None, summary: Summary
) -> None:
    """Write what came of both feet into an existing folder."""
    if both is None:
        one = next(iter(feet.values()))
        write_tum(folder / "trajectory.tum", one.t, one.position, one.nav_R_body)
    else:
        write_tum(folder / "trajectory.tum", both.person.t, both.person.position, both.person.nav_R_person)
    for side, foot in feet.items():
        write_tum(folder / f"trajectory_{side}.tum", foot.t, foot.position, foot.nav_R_body)
        write_strides(folder / f"strides_{side}.csv", foot.stances)
        if foot.moment is not None:
            write_strides(folder / f"online_{side}.csv", foot.moment)
    write_json(folder / "summary.json", summary)


def summarize_streamed_feet(
    feet: Mapping[Side, tuple[Walk, Outcome]], both: FeetSolution | None, lost: Mapping[Side, str]
) -> Summary:
    """Figures of merit of the person, how the feet were put together, and those of each foot, or why it is lost."""
    known = {side: summarize(*one) for side, one in feet.items()}
    of_feet: Summary = {side: {"lost": lost[side]} if side in lost else known[side] for side in SIDES}
    walk, outcome = next(iter(feet.values()))
    figures: Summary = {"method": outcome.solution.method, "mount": "feet", "duration_s": walk.recording.duration_s}
    if both is None:
        alone = summarize(walk, outcome)
        figures |= {key: alone[key] for key in ("distance_m", "strides", "closure_m", "end_m", "end_sigma_m")}
        return figures | {"tied": False} | of_feet
    person, table = both.person.position, outcome.solution.stances
    at_steps = interpolate_columns(table.t, both.person.t, person)
    figures["distance_m"] = float(np.linalg.norm(np.diff(at_steps[:, :2], axis=0), axis=1).sum())
    figures["strides"] = len(table) - 1
    figures["closure_m"] = float(np.linalg.norm(person[-1, :2] - person[0, :2]))
    figures |= describe_person_end(both) | {"tied": True, "width_m": both.width_m}
    figures |= {"width_sigma_m": both.width_sigma_m, "cells": both.cells, "beyond_reach": both.beyond_reach}
    return figures | of_feet


def describe_person_end(both: FeetSolution) -> dict[str, object]:
    """Place of the person at the end from that at the start, and its sigmas: x, y, z m."""
    person = both.person
    sigma = np.sqrt(np.diagonal(person.pose_cov[-1])[:3])
    return {"end_m": (person.position[-1] - person.position[0]).tolist(), "end_sigma_m": sigma.tolist()}
