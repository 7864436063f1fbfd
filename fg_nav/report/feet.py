"""The files of a walk with a sensor on each foot, at the end of a recording or of a stream: the person's, each foot's.

=========================== ================================================================================
trajectory.tum              of the person, between the feet: t x y z qx qy qz qw, x in the direction of walking
person.csv                  one row a footfall of the left foot, the columns of strides.csv; no gyroscope bias
trajectory_left/_right.tum  of each foot, as trajectory.tum of a run
strides_left/_right.csv     of each foot, as strides.csv of a run
online_left/_right.csv      of each foot of a stream, as online.csv of a stream
summary.json                the person's figures of merit, the coupling of the feet, each foot's as left, right
config.json                 of each foot, and of the request; not of a stream
report.html                 one page of all that; not of a stream
=========================== ================================================================================

A missing foot has no files; its part of the summary is null, or its reason as `lost` in a stream. There the person is
the left foot while the feet are not tied. Stamps are those of the first recording's clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fg_nav.evaluation.metrics import evaluate
from fg_nav.feet import SIDES, Side
from fg_nav.feet.person import FeetSolution
from fg_nav.feet_result import FeetResult, make_person_solution
from fg_nav.io import write_tum
from fg_nav.report import WITH_PAGE, WITH_PICTURES, Plots
from fg_nav.report.files import (
    TRUTH_KEYS,
    Summary,
    describe_end,
    describe_given,
    describe_path,
    describe_run,
    summarize,
    write_json,
    write_strides,
)
from fg_nav.solution import Solution
from fg_nav.text import find_version, to_json
from fg_nav.walk import Outcome, Walk

FOOT_KEYS = (
    "distance_m", "distance_sigma_m", "strides", "closure_m", "closure_percent", "end_m", "end_sigma_m", "graph",
    *TRUTH_KEYS, "scale", "verdict", "reasons", "returns", "magnetometer", "magnetometer_delay", "notes",
)  # fmt: skip
"""Of each foot's summary; the other keys are the same as the person's."""


def write_feet(folder: Path, result: FeetResult, plots: Plots = "html") -> Summary:
    """Write the result of both feet into an existing folder, with page and pictures; return the summary."""
    summary, pairing = _summarize_feet(result), result.pairing
    configs = {side: describe_run(foot.walk, foot) for side, foot in result.feet.items()}
    first = next(iter(result.feet.values())).walk
    request: dict[str, object] = {
        "fg_nav_version": find_version(),
        "method": result.method,
        "mount": "feet",
        "sides": list(pairing.order),
        "sides_known": pairing.sides,
        "clock_offset_s": pairing.clock_offset_s,
        "heading_deg": pairing.heading_deg,
        "parameters": to_json(describe_given(first, result.method)["parameters"]),
    }
    _write_paths(folder, result, {side: result.feet[side] for side in SIDES if side in result.feet})
    write_json(folder / "config.json", request | configs)
    write_json(folder / "summary.json", summary)
    if plots in WITH_PAGE:
        from fg_nav.report.page import write_page
        from fg_nav.report.page.content import compose_feet_page

        write_page(folder, compose_feet_page(result, summary, configs))
    if plots in WITH_PICTURES:
        from fg_nav.report.plots.walk import draw_both_feet

        draw_both_feet(folder / "trajectory.png", result)
    return summary


def _write_paths(folder: Path, person: Solution, feet: Mapping[Side, Solution]) -> None:
    """Write path and footfalls of the person and of each foot."""
    write_tum(folder / "trajectory.tum", person.t, person.position, person.nav_R_body)
    write_strides(folder / "person.csv", person.stances)
    for side, foot in feet.items():
        write_tum(folder / f"trajectory_{side}.tum", foot.t, foot.position, foot.nav_R_body)
        write_strides(folder / f"strides_{side}.csv", foot.stances)


def _summarize_feet(result: FeetResult) -> Summary:
    """Figures of merit of the person, the coupling of the feet, and the figures of each foot."""
    metrics, pairing, verdict = result.metrics, result.pairing, result.verdict
    duration_s = float(result.t[-1] - result.t[0])
    clock = "given" if pairing.clock_given else "by the signals" if pairing.cells else None
    figures: Summary = {
        "method": result.method,
        "mount": "feet",
        "duration_s": duration_s,
        **describe_path(metrics, result.runtime_s),
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
        "clock_offset_known": clock,
    }
    if result.outcome.comparison is not None:
        figures |= {key: getattr(metrics, key) for key in (*TRUTH_KEYS, "scale", "points")}
    figures |= {"verdict": verdict.word, "reasons": list(verdict.reasons)}

    of_feet: dict[str, Summary] = {}
    for side, foot in result.feet.items():
        whole, path = summarize(foot.walk, foot.outcome), foot.walk.recording.provenance.path
        known = {key: whole[key] for key in FOOT_KEYS if key in whole}
        of_feet[side] = {"recording": None if path is None else str(path), **known}
    figures |= {side: of_feet.get(side) for side in SIDES}

    # the field in words of both feet, or of each where they differ
    words = {side: str(of_feet[side]["magnetometer"]) for side in SIDES if side in of_feet}
    same = len(set(words.values())) == 1
    figures["magnetometer"] = (
        next(iter(words.values())) if same else ", ".join(f"{side} {one}" for side, one in words.items())
    )
    return figures | {"notes": [*result.notes, *metrics.notes]}


def write_streamed_feet(
    folder: Path, feet: Mapping[Side, Solution], both: FeetSolution | None, summary: Summary
) -> None:
    """Write the result of a stream of both feet into an existing folder."""
    _write_paths(folder, _take_person(feet, both), feet)
    for side, foot in feet.items():
        if foot.moment is not None:
            write_strides(folder / f"online_{side}.csv", foot.moment)
    write_json(folder / "summary.json", summary)


def summarize_streamed_feet(
    feet: Mapping[Side, tuple[Walk, Outcome]], both: FeetSolution | None, lost: Mapping[Side, str]
) -> Summary:
    """Figures of merit of the person, the coupling of the feet, and those of each foot, or the reason of its loss."""
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
    return first if both is None else make_person_solution(both.person, first, first.runtime_s)
