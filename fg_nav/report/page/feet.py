"""The page of a walk with a sensor on each foot: the person's path and both feet's, how far they are apart, and why.

path, distance between the feet, height, sigma, gyroscope bias, heading, errors, remarks, parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePath
from typing import Any

import numpy as np

from fg_nav.arrays import Bools, Floats, interpolate_columns
from fg_nav.feet_result import FeetResult
from fg_nav.report.aligned import AlignedSolution, align_solution
from fg_nav.report.page.content import Cell, Page, Section, Verdict, tabulate_figures
from fg_nav.report.page.course import Frame, describe_alignment, describe_ellipses, describe_frame, draw_feet
from fg_nav.report.page.figures import (
    GRAY,
    MAX_POINTS,
    TEAL,
    VERMILION,
    Chart,
    Panel,
    level,
    line,
    signal,
    stack,
    to_numbers,
    to_seconds,
)
from fg_nav.report.page.series import draw_errors, draw_gyro_bias, draw_headings, draw_height, draw_sigmas
from fg_nav.report.rows import FIGURES, collect_notes
from fg_nav.result import Result
from fg_nav.samples.gaps import find_unrecorded
from fg_nav.text import format_count
from fg_nav.walk import Options

Summary = Mapping[str, Any]


def compose_feet_page(
    result: FeetResult, summary: Summary, configs: Mapping[str, Mapping[str, object]], version: str
) -> Page:
    """Choose what goes onto the page."""
    columns: dict[str, Summary] = {"person": summary} | {side: summary[side] for side in result.feet}
    said = [{"method": name, "notes": one["notes"], "graph": one.get("graph")} for name, one in columns.items()]
    return Page(
        title=" and ".join(_name_recordings(result)),
        about=_describe_recordings(result),
        verdicts=[Verdict(result.method, str(summary["verdict"]), summary["reasons"])],
        highlights=_choose_highlights(summary, result),
        methods=list(columns),
        table=tabulate_figures(list(columns.values())),
        sections=_draw_sections(result),
        remarks=collect_notes(said),
        configs=configs,
        version=version,
        table_title="The person and each foot",
    )


def _name_recordings(result: FeetResult) -> list[str]:
    paths = [foot.walk.recording.provenance.path for foot in result.feet.values()]
    return [
        f"the {side} foot" if path is None else PurePath(path).name
        for side, path in zip(result.feet, paths, strict=True)
    ]


def _describe_recordings(result: FeetResult) -> str:
    words = []
    for side, foot in result.feet.items():
        recording = foot.walk.recording
        words.append(f"{side} foot {recording.duration_s:.1f} s at {1.0 / recording.period_s:.0f} Hz")
    return f"{result.method}; {', '.join(words)}"


def _choose_highlights(summary: Summary, result: FeetResult) -> list[tuple[str, Cell, str]]:
    sigma = result.stances.position_sigma[-1]
    width_sigma = summary["width_sigma_m"]
    apart = "" if width_sigma is None else f"± {width_sigma:.2f} m, {format_count(summary['cells'], 'cell')} of steps"
    aligned = f"aligned: {summary.get('alignment')}"
    shown = [
        ("distance_m", "distance", format_count(summary["strides"], "stride")),
        ("closure_m", "start to end", f"± {float(np.hypot(*sigma[:2])):.2f} m horizontally"),
        ("width_m", "feet apart, across", apart),
        ("rmse_2d_m", "horizontal error, rms", aligned),
        ("end_error_m", "error at the end", aligned),
        ("duration_s", "duration", ""),
    ]
    patterns = {key: pattern for key, _, pattern in FIGURES} | {"duration_s": "{:.1f}", "width_m": "{:.2f}"}
    return [
        (words, Cell(key, f"{patterns[key].format(value)} {key.rsplit('_', 1)[-1]}", value), more)
        for key, words, more in shown
        if (value := summary.get(key)) is not None
    ]


def _draw_sections(result: FeetResult) -> list[Section]:
    person = AlignedSolution(result, result.truth, result.outcome.comparison)
    feet = {side: _align_with_person(result, foot) for side, foot in result.feet.items()}
    frame = _describe_frame(person, result)
    every = {**feet, "person": person}
    return [
        _draw_path(result, person, feet, frame),
        _draw_distance(result),
        Section("height", "Height", [], [draw_height(feet)]),
        Section("sigma", "Uncertainty", [], [draw_sigmas(every, (frame.x, frame.y))]),
        Section("bias", "Gyroscope bias", [], [draw_gyro_bias(feet)]),
        _draw_heading(person),
        _draw_errors(result, person),
    ]


def _draw_path(
    result: FeetResult, person: AlignedSolution, feet: Mapping[str, AlignedSolution], frame: Frame
) -> Section:
    words = [_describe_pairing(result), frame.words, describe_ellipses(person)]
    return Section("path", "Path", words, [draw_feet(person, feet, frame)])


def _describe_pairing(result: FeetResult) -> str:
    """Say which recording is of which foot, and how its clock was set."""
    pairing = result.pairing
    known = {"named": "as it was named", "shown": "as the steps show", "assumed": "which is assumed"}[pairing.sides]
    first = f"The first recording is of the {pairing.order[0]} foot, {known}."
    if pairing.width_m is None:
        return first
    clock = f"{pairing.clock_offset_s:+.3f} s, {'as given' if pairing.clock_given else 'by the signals'}"
    return f"{first} To the stamps of the second one was added {clock}."


def _align_with_person(result: FeetResult, foot: Result) -> AlignedSolution:
    """A foot as it is drawn: aligned as the person is, so that the feet stay where they are to each other."""
    comparison = result.outcome.comparison
    return AlignedSolution(foot, None if comparison is None else foot.walk.truth, comparison)


def _describe_frame(person: AlignedSolution, result: FeetResult) -> Frame:
    """Say where north is: the frame is the left foot's."""
    foot = next(iter(result.feet.values()))
    frame = describe_frame(person, foot.outcome, Options(heading_deg=result.pairing.heading_deg))
    return replace(frame, words=f"{frame.words} The origin is where the {next(iter(result.feet))} foot first stood.")


def _draw_distance(result: FeetResult) -> Section:
    """Draw how far the sensors are apart, and the reach of two standing feet."""
    title = "Distance between the feet"
    left, right = result.left, result.right
    if left is None or right is None:
        return Section("distance", title, ["One foot is missing: see the remarks."])
    if result.width_m is None:
        return Section(
            "distance", title, ["Nothing ties the feet, and each is in a frame of its own: see the remarks."]
        )
    from fg_nav.smoother.feet_factors import REACH_M

    t = result.t
    apart = np.linalg.norm(
        interpolate_columns(t, left.t, left.position) - interpolate_columns(t, right.t, right.position), axis=1
    )
    # Where one foot was not recorded there is no distance.
    apart[find_unrecorded(t, left.t) | find_unrecorded(t, right.t)] = np.nan
    both = _stands_at(t, left.t, left.walk.stances.mask) & _stands_at(t, right.t, right.walk.stances.mask)
    pairing = result.pairing
    words = [
        f"{format_count(pairing.cells, 'cell')} of steps tie the feet, {pairing.width_m:.2f} ± "
        f"{pairing.width_sigma_m:.2f} m apart across the way. "
        f"{format_count(pairing.beyond_reach, 'pair')} of footfalls had to be held within reach."
    ]
    row = np.arange(0, len(t), max(1, len(t) // MAX_POINTS))
    standing = to_numbers(np.where(both, apart, np.nan)[row], 3)
    traces = [
        signal(t, apart, GRAY, "between the sensors", width=0.8),
        line(to_seconds(t[row]), standing, TEAL, "while both stand", width=2.5),
        level(t, REACH_M, VERMILION, "reach of two standing feet"),
    ]
    caption = "In a swing the feet may be further apart than they ever stand."
    return Section("distance", title, words, [stack("distance", [Panel("distance (m)", traces)], caption)])


def _stands_at(asked: Floats, t: Floats, mask: Bools) -> Bools:
    return np.asarray(mask[np.clip(np.searchsorted(t, asked), 0, len(t) - 1)])


def _draw_heading(person: AlignedSolution) -> Section:
    chart: Chart = draw_headings({"person": person})
    caption = "Of the direction of walking, clockwise from north. The band below is the 95 % that the method claims."
    return Section("heading", "Heading", [], [replace(chart, caption=caption)])


def _draw_errors(result: FeetResult, person: AlignedSolution) -> Section:
    views = {side: align_solution(foot.walk, foot.outcome) for side, foot in result.feet.items()}
    views["person"] = person
    compared = {name: view for name, view in views.items() if view.comparison is not None}
    if not compared:
        return Section("errors", "Errors", ["No truth is known of this walk."])
    words = [f"{name}: {describe_alignment(view)}" for name, view in compared.items()]
    return Section("errors", "Errors", words, [draw_errors(compared)])
