"""What goes onto the page: the verdict, figures of merit, and sections with sentences and charts, in this order.

path, graph, height, sigma, stances, gyroscope bias, heading (compass against gyroscope), field strength, places
recognized, errors, remarks, parameters. Each section is always there, and says why where it has no chart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePath

import numpy as np

from fg_nav.report.aligned import AlignedSolution
from fg_nav.report.page.compass import draw_compass, draw_strength, judge
from fg_nav.report.page.course import Frame, describe_alignment, describe_ellipses, describe_frame, draw_course
from fg_nav.report.page.figures import Chart
from fg_nav.report.page.graph import describe_graph, draw_graph
from fg_nav.report.page.returns import describe_returns, draw_returns
from fg_nav.report.page.samples import draw_samples
from fg_nav.report.page.series import draw_errors, draw_gyro_bias, draw_headings, draw_height, draw_sigmas
from fg_nav.report.rows import FIGURES, collect_notes
from fg_nav.system.spilled import drop_pages
from fg_nav.text import format_count
from fg_nav.walk import Options, Outcome, Walk


@dataclass(frozen=True)
class Findings:
    """What a page is made of.

    Attributes
    ----------
    outcomes : by method.
    summaries, configs : of each method, as they are written to files.
    walk : None where the samples were not kept: of a walk in progress with a lag.
    """

    outcomes: Mapping[str, Outcome]
    summaries: Sequence[Mapping[str, object]]
    configs: Sequence[Mapping[str, object]]
    walk: Walk | None


@dataclass(frozen=True)
class Section:
    """A part of the page: its anchor, title, sentences and charts."""

    name: str
    title: str
    words: Sequence[str] = ()
    charts: Sequence[Chart] = ()


@dataclass(frozen=True)
class Verdict:
    """The verdict on one method: word and reasons."""

    method: str
    word: str
    reasons: Sequence[str]


@dataclass(frozen=True)
class Cell:
    """A figure of merit as it is shown, with its key and its value in the summary."""

    key: str
    text: str
    value: object


@dataclass(frozen=True)
class Page:
    """All that the template puts into words."""

    title: str
    about: str
    verdicts: Sequence[Verdict]
    highlights: Sequence[tuple[str, Cell, str]]
    methods: Sequence[str]
    table: Sequence[tuple[str, Sequence[Cell]]]
    sections: Sequence[Section]
    remarks: Sequence[tuple[str, str]]
    configs: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    version: str = ""
    table_title: str = "All figures"

    @property
    def charts(self) -> list[Chart]:
        """All charts, in their order."""
        return [chart for section in self.sections for chart in section.charts]


def compose_page(found: Findings, version: str) -> Page:
    """Choose what goes onto the page."""
    configs = dict(zip(found.outcomes, found.configs, strict=True))
    return Page(
        title=_name_recording(found),
        about=_describe_recording(found),
        verdicts=_collect_verdicts(found.summaries),
        highlights=_choose_highlights(found) if len(found.outcomes) == 1 else [],
        methods=list(found.outcomes),
        table=tabulate_figures(found.summaries),
        sections=_draw_sections(found),
        remarks=collect_notes(found.summaries),
        configs=configs,
        version=version,
        table_title="Methods side by side" if len(found.outcomes) > 1 else "All figures",
    )


def _name_recording(found: Findings) -> str:
    path = found.configs[0].get("recording") if found.walk is not None else None
    return PurePath(str(path)).name if path else "a walk in progress" if found.walk is None else "a walk"


def _describe_recording(found: Findings) -> str:
    methods = ", ".join(found.outcomes)
    if found.walk is None:
        return methods
    recording = found.walk.recording
    rate = f"{recording.duration_s:.1f} s at {1.0 / recording.period_s:.0f} Hz"
    return f"{methods}; {recording.provenance.format}, {rate}"


def _collect_verdicts(summaries: Sequence[Mapping[str, object]]) -> list[Verdict]:
    found = []
    for one in summaries:
        reasons = one["reasons"]
        assert isinstance(reasons, list)
        found.append(Verdict(str(one["method"]), str(one["verdict"]), reasons))
    return found


def tabulate_figures(summaries: Sequence[Mapping[str, object]]) -> list[tuple[str, list[Cell]]]:
    """Rows of figures that at least one of the methods has, or of other columns."""
    rows = []
    for key, words, pattern in FIGURES:
        values = [summary.get(key) for summary in summaries]
        if any(value is not None for value in values):
            cells = [Cell(key, "-" if value is None else pattern.format(value), value) for value in values]
            rows.append((words, cells))
    return rows


def _choose_highlights(found: Findings) -> list[tuple[str, Cell, str]]:
    """The few figures that stand out: what, its cell, and what goes with it."""
    summary = found.summaries[0]
    table = next(iter(found.outcomes.values())).solution.stances
    sigma = summary.get("distance_sigma_m")
    strides = format_count(int(str(summary["strides"])), "stride")
    shown = [("distance_m", "distance", strides if sigma is None else f"± {sigma:.2f} m, {strides}")]
    end = f"± {float(np.hypot(*table.position_sigma[-1, :2])):.2f} m horizontally"
    shown.append(("closure_m", "start to end", end))
    alignment = summary.get("alignment")
    shown += [
        ("rmse_2d_m", "horizontal error, rms", f"aligned: {alignment}"),
        ("end_error_m", "error at the end", f"aligned: {alignment}"),
        ("duration_s", "duration", ""),
    ]
    patterns = {key: pattern for key, _, pattern in FIGURES} | {"duration_s": "{:.1f}"}
    return [
        (words, Cell(key, f"{patterns[key].format(value)} {key.rsplit('_', 1)[-1]}", value), more)
        for key, words, more in shown
        if (value := summary.get(key)) is not None
    ]


def _draw_sections(found: Findings) -> list[Section]:
    walk, outcomes = found.walk, found.outcomes
    views = {name: _align(found, outcome) for name, outcome in outcomes.items()}
    name, outcome = next(iter(outcomes.items()))
    returns = outcome.solution.returns
    frame = describe_frame(views[name], outcome, Options() if walk is None else walk.options)
    return [
        _draw_path(views, outcomes, frame),
        _draw_graph(views, frame),
        Section("height", "Height", [], [draw_height(views)]),
        Section("sigma", "Uncertainty", [], [draw_sigmas(views, (frame.x, frame.y))]),
        _draw_stances(walk),
        Section("bias", "Gyroscope bias", [], [draw_gyro_bias(views)]),
        _draw_heading(walk, views, outcome),
        _draw_strength(walk, outcome),
        Section("returns", "Places recognized", describe_returns(returns), draw_returns(returns)),
        _draw_errors(walk, views),
    ]


def _align(found: Findings, outcome: Outcome) -> AlignedSolution:
    usable = outcome.comparison is not None and found.walk is not None
    truth = found.walk.truth if usable and found.walk is not None else None
    return AlignedSolution(outcome.solution, truth, outcome.comparison)


def _draw_path(views: Mapping[str, AlignedSolution], outcomes: Mapping[str, Outcome], frame: Frame) -> Section:
    first = next(iter(views.values()))
    words = [frame.words, describe_ellipses(first)]
    return Section("path", "Path", words, [draw_course(views, outcomes, frame)])


def _draw_graph(views: Mapping[str, AlignedSolution], frame: Frame) -> Section:
    words = describe_graph({name: view.solution for name, view in views.items()})
    drawn = next((view for view in views.values() if view.solution.graph), next(iter(views.values())))
    return Section("graph", "The graph", words, draw_graph(drawn, frame))


def _draw_stances(walk: Walk | None) -> Section:
    title = "Stances"
    if walk is None:
        return Section("stances", title, ["The samples of this walk were not kept, as asked by --lag."])
    if not len(walk.stances):
        words = ["No stances are used: a thigh never stands still."] if walk.options.mount == "pocket" else ["None."]
        return Section("stances", title, words, draw_samples(walk.recording, walk.stances))
    found = walk.stances
    words = [
        f"{format_count(found.n_footfalls, 'footfall')} in {format_count(len(found), 'stance')} ({found.detector})."
    ]
    charts = draw_samples(walk.recording, found)
    drop_pages()
    return Section("stances", title, words, charts)


def _draw_heading(walk: Walk | None, views: Mapping[str, AlignedSolution], outcome: Outcome) -> Section:
    charts, words = [draw_headings(views)], [_why_no_field(walk)]
    if walk is not None and walk.field is not None:
        charts.append(draw_compass(walk.field, outcome.solution.stances))
        turned = np.rad2deg(walk.field.mean_heading_difference)
        words = [f"The compass shows {turned:+.1f}° more than the gyroscope on the mean."]
    return Section("heading", "Heading, and compass against gyroscope", words, charts)


def _draw_strength(walk: Walk | None, outcome: Outcome) -> Section:
    title = "Field strength along the path"
    if walk is None or walk.field is None:
        return Section("strength", title, [_why_no_field(walk)])
    table = outcome.solution.stances
    clear, disturbed, _ = (int(flag.sum()) for flag, _, _ in judge(walk.field, table))
    words = f"At {clear} of {len(walk.field)} footfalls the field is undisturbed, at {disturbed} disturbed."
    return Section("strength", title, [words], [draw_strength(walk.field, table)])


def _why_no_field(walk: Walk | None) -> str:
    if walk is None:
        return "The samples of this walk were not kept, so its field is not shown."
    if walk.recording.mag is None and walk.options.use_magnetometer and not walk.unjudged:
        return "The recording has no magnetometer."
    return f"No field is shown: {walk.unjudged.rstrip('.') or 'it was not looked at'}."


def _draw_errors(walk: Walk | None, views: Mapping[str, AlignedSolution]) -> Section:
    compared = {name: view for name, view in views.items() if view.comparison is not None}
    if not compared:
        had = walk is not None and walk.truth is not None
        words = "The truth could not be compared: see the remarks." if had else "No truth is known of this walk."
        return Section("errors", "Errors", [words])
    aligned = [describe_alignment(view) for view in compared.values()]
    if len(compared) > 1:
        aligned = [f"{name}: {words}" for name, words in zip(compared, aligned, strict=True)]
    return Section("errors", "Errors", aligned, [draw_errors(compared)])
