"""Content of the page: verdict, figures of merit, sections with sentences and charts, remarks and parameters.

========= =============================================================================================================
one foot  path, graph, height, sigma, stances, gyroscope bias, heading (compass against gyroscope), field strength,
          places recognized, errors
two feet  path of the person and of both feet, distance between the feet, height, sigma, gyroscope bias, heading,
          errors
========= =============================================================================================================

Each section is always there, and gives the reason where it has no chart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from fg_nav.arrays import interpolate_columns
from fg_nav.report import FIGURES, Cell, collect_notes, tabulate_figures
from fg_nav.report.charts import (
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
)
from fg_nav.report.course import (
    align_feet,
    align_solution,
    describe_alignment,
    describe_ellipses,
    describe_frame,
    describe_returns,
    draw_course,
    draw_feet,
    draw_returns,
)
from fg_nav.report.series import (
    describe_graph,
    draw_compass,
    draw_errors,
    draw_graph,
    draw_gyro_bias,
    draw_headings,
    draw_height,
    draw_samples,
    draw_sigmas,
    draw_strength,
    group_by_verdict,
)
from fg_nav.samples.gaps import find_unrecorded
from fg_nav.solution import StanceTable
from fg_nav.text import format_count
from fg_nav.walk import Options, Outcome, Walk

if TYPE_CHECKING:
    from fg_nav.feet_result import FeetResult


@dataclass(frozen=True)
class Section:
    """A part of the page: its anchor, title, sentences and charts."""

    name: str
    title: str
    words: Sequence[str] = ()
    charts: Sequence[Chart] = ()


@dataclass(frozen=True)
class Page:
    """Content of the template."""

    title: str
    about: str
    verdicts: Sequence[Mapping[str, object]]  # Summaries, with method, verdict and reasons.
    highlights: Sequence[tuple[str, Cell, str]]
    methods: Sequence[str]
    table: Sequence[tuple[str, Sequence[Cell]]]
    sections: Sequence[Section]
    remarks: Sequence[tuple[str, str]]
    configs: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    table_title: str = "All figures"


def _choose_highlights(
    summary: Mapping[str, Any], table: StanceTable, more: Sequence[tuple[str, str, str]] = (), distance: str = ""
) -> list[tuple[str, Cell, str]]:
    """The few figures that stand out: name, cell, and addition; `more` after the closure."""
    aligned = f"aligned: {summary.get('alignment')}"
    shown = [
        ("distance_m", "distance", distance),
        ("closure_m", "start to end", f"± {float(np.hypot(*table.position_sigma[-1, :2])):.2f} m horizontally"),
        *more,
        ("rmse_2d_m", "horizontal error, rms", aligned),
        ("end_error_m", "error at the end", aligned),
        ("duration_s", "duration", ""),
    ]
    patterns = {key: pattern for key, _, pattern in FIGURES} | {"duration_s": "{:.1f}", "width_m": "{:.2f}"}
    return [
        (words, Cell(key, f"{patterns[key].format(value)} {key.rsplit('_', 1)[-1]}", value), addition)
        for key, words, addition in shown
        if (value := summary.get(key)) is not None
    ]


# --- one foot, one or more methods -----------------------------------------------------------------------------------


def compose_page(
    outcomes: Mapping[str, Outcome],
    summaries: Sequence[Mapping[str, object]],
    configs: Sequence[Mapping[str, object]],
    walk: Walk | None,
) -> Page:
    """Compose the page of one or more methods on one recording, with a summary and a configuration each.

    `walk` is None where the samples were not kept: of a walk in progress with a lag.
    """
    several, methods, path = len(outcomes) > 1, ", ".join(outcomes), configs[0].get("recording")
    title, about = "a walk in progress", methods
    if walk is not None:
        recording = walk.recording
        rate = f"{recording.duration_s:.1f} s at {1.0 / recording.period_s:.0f} Hz"
        title = PurePath(str(path)).name if path else "a walk"
        about = f"{methods}; {recording.provenance.format}, {rate}"
    highlights: list[tuple[str, Cell, str]] = []
    if not several:
        summary: Mapping[str, Any] = summaries[0]
        sigma, strides = summary.get("distance_sigma_m"), format_count(int(summary["strides"]), "stride")
        distance = strides if sigma is None else f"± {sigma:.2f} m, {strides}"
        highlights = _choose_highlights(summary, next(iter(outcomes.values())).solution.stances, distance=distance)
    return Page(
        title=title,
        about=about,
        verdicts=summaries,
        highlights=highlights,
        methods=list(outcomes),
        table=tabulate_figures(summaries),
        sections=_draw_sections(walk, outcomes),
        remarks=collect_notes(summaries),
        configs=dict(zip(outcomes, configs, strict=True)),
        table_title="Methods side by side" if several else "All figures",
    )


def _draw_sections(walk: Walk | None, outcomes: Mapping[str, Outcome]) -> list[Section]:
    views = {name: align_solution(walk, outcome) for name, outcome in outcomes.items()}
    first, outcome = next(iter(views.values())), next(iter(outcomes.values()))
    returns, table = outcome.solution.returns, outcome.solution.stances
    frame = describe_frame(first, outcome, Options() if walk is None else walk.options)
    path = draw_course(views, outcomes, frame)
    graph = describe_graph({name: view.solution for name, view in views.items()})
    with_graph = next((view for view in views.values() if view.solution.graph), first)
    sections = [
        Section("path", "Path", [frame.words, describe_ellipses(first)], [path]),
        Section("graph", "The graph", graph, draw_graph(with_graph, frame)),
        Section("height", "Height", [], [draw_height(views)]),
        Section("sigma", "Uncertainty", [], [draw_sigmas(views, (frame.x, frame.y))]),
        _draw_stances(walk),
        Section("bias", "Gyroscope bias", [], [draw_gyro_bias(views)]),
    ]
    # the field
    missing = "The samples of this walk were not kept, so its field is not shown."
    if walk is not None and walk.recording.mag is None and walk.options.use_magnetometer and not walk.unjudged:
        missing = "The recording has no magnetometer."
    elif walk is not None:
        missing = f"No field is shown: {walk.unjudged.rstrip('.') or 'it was not looked at'}."
    headings, words = [draw_headings(views)], [missing]
    strength = Section("strength", "Field strength along the path", words)
    if walk is not None and walk.field is not None:
        headings.append(draw_compass(walk.field, table))
        turned = np.rad2deg(walk.field.mean_heading_difference)
        words = [f"The compass shows {turned:+.1f}° more than the gyroscope on the mean."]
        clear, disturbed, _ = (int(flag.sum()) for flag, _, _ in group_by_verdict(walk.field, table))
        counts = f"At {clear} of {len(walk.field)} footfalls the field is undisturbed, at {disturbed} disturbed."
        strength = replace(strength, words=[counts], charts=[draw_strength(walk.field, table)])
    sections += [Section("heading", "Heading, and compass against gyroscope", words, headings), strength]
    sections.append(Section("returns", "Places recognized", describe_returns(returns), draw_returns(returns)))
    # errors
    compared = {name: view for name, view in views.items() if view.comparison is not None}
    aligned = [describe_alignment(view) for view in compared.values()]
    if len(compared) > 1:
        aligned = [f"{name}: {words}" for name, words in zip(compared, aligned, strict=True)]
    if not compared:
        had = walk is not None and walk.truth is not None
        aligned = ["The truth could not be compared: see the remarks." if had else "No truth is known of this walk."]
    return [*sections, Section("errors", "Errors", aligned, [draw_errors(compared)] if compared else [])]


def _draw_stances(walk: Walk | None) -> Section:
    title = "Stances"
    if walk is None:
        return Section("stances", title, ["The samples of this walk were not kept, as asked by --lag."])
    found = walk.stances
    if not len(found):
        words = ["No stances are used: a thigh never stands still."] if walk.options.mount == "pocket" else ["None."]
        return Section("stances", title, words, draw_samples(walk.recording, found))
    words = [
        f"{format_count(found.n_footfalls, 'footfall')} in {format_count(len(found), 'stance')} ({found.detector})."
    ]
    return Section("stances", title, words, draw_samples(walk.recording, found))


# --- two feet --------------------------------------------------------------------------------------------------------


def compose_feet_page(
    result: FeetResult, summary: Mapping[str, Any], configs: Mapping[str, Mapping[str, object]]
) -> Page:
    """Compose the page of a walk with a sensor on each foot."""
    columns: dict[str, Mapping[str, Any]] = {"person": summary} | {side: summary[side] for side in result.feet}
    notes = [{"method": name, "notes": one["notes"], "graph": one.get("graph")} for name, one in columns.items()]
    names, about = [], []
    for side, foot in result.feet.items():
        recording = foot.walk.recording
        path = recording.provenance.path
        names.append(f"the {side} foot" if path is None else PurePath(path).name)
        about.append(f"{side} foot {recording.duration_s:.1f} s at {1.0 / recording.period_s:.0f} Hz")
    sigma, width = summary["width_sigma_m"], ""
    if sigma is not None:
        width = f"± {sigma:.2f} m, {format_count(summary['cells'], 'cell')} of steps"
    more, strides = [("width_m", "feet apart, across", width)], format_count(summary["strides"], "stride")
    return Page(
        title=" and ".join(names),
        about=f"{result.method}; {', '.join(about)}",
        verdicts=[summary],
        highlights=_choose_highlights(summary, result.stances, more, strides),
        methods=list(columns),
        table=tabulate_figures(list(columns.values())),
        sections=_draw_feet_sections(result),
        remarks=collect_notes(notes),
        configs=configs,
        table_title="The person and each foot",
    )


def _draw_feet_sections(result: FeetResult) -> list[Section]:
    (person, feet, frame), pairing = align_feet(result), result.pairing
    known = {"named": "as it was named", "shown": "as the steps show", "assumed": "which is assumed"}[pairing.sides]
    origin = f"The first recording is of the {pairing.order[0]} foot, {known}."
    if pairing.width_m is not None:
        clock = f"{pairing.clock_offset_s:+.3f} s, {'as given' if pairing.clock_given else 'by the signals'}"
        origin = f"{origin} To the stamps of the second one was added {clock}."
    path = Section("path", "Path", [origin, frame.words, describe_ellipses(person)], [draw_feet(person, feet, frame)])
    caption = "Of the direction of walking, clockwise from north. The band below is the 95 % that the method claims."
    heading = replace(draw_headings({"person": person}), caption=caption)
    # errors, each path by its own alignment
    views = {side: align_solution(foot.walk, foot.outcome) for side, foot in result.feet.items()} | {"person": person}
    compared = {name: view for name, view in views.items() if view.comparison is not None}
    aligned = [f"{name}: {describe_alignment(view)}" for name, view in compared.items()]
    return [
        path,
        _draw_distance(result),
        Section("height", "Height", [], [draw_height(feet)]),
        Section("sigma", "Uncertainty", [], [draw_sigmas({**feet, "person": person}, (frame.x, frame.y))]),
        Section("bias", "Gyroscope bias", [], [draw_gyro_bias(feet)]),
        Section("heading", "Heading", [], [heading]),
        Section("errors", "Errors", aligned, [draw_errors(compared)])
        if compared
        else Section("errors", "Errors", ["No truth is known of this walk."]),
    ]


def _draw_distance(result: FeetResult) -> Section:
    """Draw the distance of the sensors, and the reach of two standing feet."""
    title = "Distance between the feet"
    left, right = result.left, result.right
    if left is None or right is None:
        return Section("distance", title, ["One foot is missing: see the remarks."])
    if result.width_m is None:
        return Section(
            "distance", title, ["Nothing ties the feet, and each is in a frame of its own: see the remarks."]
        )
    from fg_nav.smoother.feet import REACH_M

    t, pairing = result.t, result.pairing
    both, positions = np.ones(len(t), dtype=np.bool_), []
    for foot in (left, right):
        positions.append(interpolate_columns(t, foot.t, foot.position))
        both &= foot.walk.stances.mask[np.clip(np.searchsorted(foot.t, t), 0, len(foot.t) - 1)]
    apart = np.linalg.norm(positions[0] - positions[1], axis=1)
    apart[find_unrecorded(t, left.t) | find_unrecorded(t, right.t)] = np.nan
    words = [
        f"{format_count(pairing.cells, 'cell')} of steps tie the feet, {pairing.width_m:.2f} ± "
        f"{pairing.width_sigma_m:.2f} m apart across the way. "
        f"{format_count(pairing.beyond_reach, 'pair')} of footfalls had to be held within reach."
    ]
    row = np.arange(0, len(t), max(1, len(t) // MAX_POINTS))
    traces = [
        signal(t, apart, GRAY, "between the sensors", width=0.8),
        line(t[row], np.where(both, apart, np.nan)[row], TEAL, "while both stand", (3, 3), width=2.5),
        level(t, REACH_M, VERMILION, "reach of two standing feet"),
    ]
    caption = "In a swing the feet may be further apart than they ever stand."
    return Section("distance", title, words, [stack("distance", [Panel("distance (m)", traces)], caption)])
