"""The files of a walk with a sensor on each foot: the person's path, and each foot's.

=========================== ================================================================================
trajectory.tum              of the person, between the feet: t x y z qx qy qz qw, x in the direction of walking
person.csv                  one row a footfall of the left foot, the columns of strides.csv; no gyroscope's bias
trajectory_left/_right.tum  of each foot, as trajectory.tum of a run
strides_left/_right.csv     of each foot, as strides.csv of a run
summary.json                the person's figures of merit, how the feet were put together, each foot's as left, right
config.json                 of each foot, and what was asked for
report.html                 one page of all that
=========================== ================================================================================

Of a foot that is missing there are no files, and its part of the summary is null. Stamps are those of the first
recording's clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fg_nav.feet import SIDES, Side
from fg_nav.feet_result import FeetResult, Pairing
from fg_nav.report import WITH_PAGE, WITH_PICTURES, Plots
from fg_nav.report.aligned import AlignedSolution
from fg_nav.report.files import (
    TRUTH_KEYS,
    Summary,
    describe_end,
    describe_given,
    describe_run,
    summarize,
    write_foot,
    write_json,
    write_person,
)
from fg_nav.result import Result
from fg_nav.text import find_version, to_json

FOOT_KEYS = (
    "distance_m", "distance_sigma_m", "strides", "closure_m", "closure_percent", "end_m", "end_sigma_m", "graph",
    *TRUTH_KEYS, "scale", "verdict", "reasons", "returns", "magnetometer", "magnetometer_delay", "notes",
)  # fmt: skip
"""Of each foot's summary; the rest is the person's too."""


def write_feet(folder: Path, result: FeetResult, plots: Plots = "html") -> Summary:
    """Write what came of both feet into an existing folder, with page and pictures; return the summary."""
    summary = summarize_feet(result)
    configs = {side: describe_run(foot.walk, foot) for side, foot in result.feet.items()}
    write_person(folder, result)
    for side in SIDES:
        if side in result.feet:
            write_foot(folder, side, result.feet[side])
    write_json(folder / "config.json", _describe_request(result) | configs)
    write_json(folder / "summary.json", summary)
    if plots in WITH_PAGE:
        from fg_nav.report.page import write_feet_page

        write_feet_page(folder, result, summary, configs)
    if plots in WITH_PICTURES:
        from fg_nav.report.plots import draw_person

        draw_person(folder, view_person(result))
    return summary


def view_person(result: FeetResult) -> AlignedSolution:
    """Return the person's path as it is drawn: with its truth where it has one."""
    return AlignedSolution(result, result.truth, result.outcome.comparison)


def summarize_feet(result: FeetResult) -> Summary:
    """Figures of merit of the person, how the feet were put together, and those of each foot."""
    metrics, pairing, verdict = result.metrics, result.pairing, result.verdict
    duration_s = float(result.t[-1] - result.t[0])
    figures: Summary = {
        "method": result.method,
        "mount": "feet",
        "duration_s": duration_s,
        "distance_m": metrics.distance_m,
        "strides": metrics.strides_detected,
        "closure_m": metrics.closure_m,
        "closure_percent": metrics.closure_percent,
        "runtime_s": result.runtime_s,
        "realtime_factor": duration_s / result.runtime_s if result.runtime_s > 0 else None,
        **describe_end(result.stances),
        "width_m": pairing.width_m,
        "width_sigma_m": pairing.width_sigma_m,
        "cells": pairing.cells,
        "beyond_reach": pairing.beyond_reach,
        "sides": list(pairing.order),
        "sides_known": pairing.sides,
        "clock_offset_s": pairing.clock_offset_s,
        "clock_drift": pairing.clock_drift,
        "clock_offset_known": _say_how_clocks_are_known(pairing),
    }
    if result.outcome.comparison is not None:
        figures |= {key: getattr(metrics, key) for key in (*TRUTH_KEYS, "scale", "points")}
    figures |= {"verdict": verdict.word, "reasons": list(verdict.reasons)}
    of_feet = {side: _summarize_foot(result.feet.get(side)) for side in SIDES}
    return figures | of_feet | {"magnetometer": _join_magnetometers(of_feet), "notes": [*result.notes, *metrics.notes]}


def _join_magnetometers(of_feet: Mapping[Side, Summary | None]) -> str:
    """Say whether the field had a part: in words of both feet, or of each where they differ."""
    words = {side: str(one["magnetometer"]) for side, one in of_feet.items() if one is not None}
    if len(set(words.values())) == 1:
        return next(iter(words.values()))
    return ", ".join(f"{side} {one}" for side, one in words.items())


def _summarize_foot(foot: Result | None) -> Summary | None:
    if foot is None:
        return None
    whole = summarize(foot.walk, foot.outcome)
    path = foot.walk.recording.provenance.path
    known = {key: whole[key] for key in FOOT_KEYS if key in whole}
    return {"recording": None if path is None else str(path), **known}


def _describe_request(result: FeetResult) -> dict[str, object]:
    """What was asked for of both feet."""
    pairing = result.pairing
    walk = next(iter(result.feet.values())).walk
    return {
        "fg_nav_version": find_version(),
        "method": result.method,
        "mount": "feet",
        "sides": list(pairing.order),
        "sides_known": pairing.sides,
        "clock_offset_s": pairing.clock_offset_s,
        "heading_deg": pairing.heading_deg,
        "parameters": to_json(describe_given(walk, result.method)["parameters"]),
    }


def _say_how_clocks_are_known(pairing: Pairing) -> str | None:
    """Say by what the clocks were set; None where one foot is missing."""
    if pairing.clock_given:
        return "given"
    return "by the signals" if pairing.cells else None
