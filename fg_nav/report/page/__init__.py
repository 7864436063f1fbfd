"""`report.html`: one self-contained page of a result (docs/files.md).

It has the verdict, the path, the figures of merit, sections with sentences, charts and tables, remarks and parameters.
A section with neither chart nor table is left out.

plotly.js (its basic bundle, MIT licence, in `LICENSE-plotly.txt`) stands in the page; it is packed in the package, and
the figures are plain dictionaries, so no other package is needed. A policy in the page forbids every request, and all
texts are escaped, so neither a recording nor its name can inject code.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fg_nav.arrays import interpolate_columns
from fg_nav.evaluation.comparison import Comparison
from fg_nav.report import REPORT
from fg_nav.report.charts import (
    GRAY,
    MAX_POINTS,
    TEAL,
    VERMILION,
    AlignedSolution,
    Chart,
    Panel,
    align_feet,
    align_paths,
    align_solution,
    describe_ellipses,
    draw_course,
    level,
    line,
    render_plotly,
    signal,
    stack,
)
from fg_nav.report.series import (
    MAX_RETURNS,
    describe_return,
    draw_compass,
    draw_errors,
    draw_graph,
    draw_gyro_bias,
    draw_headings,
    draw_height,
    draw_returns,
    draw_samples,
    draw_sigmas,
    draw_strength,
    group_field,
)
from fg_nav.report.terminal import Cell, collect_notes, format_sigma, group_notes, is_loop, tabulate_figures
from fg_nav.samples.gaps import find_unrecorded
from fg_nav.solution import Solution
from fg_nav.text import find_version, format_count, format_digits, to_json
from fg_nav.walk import Outcome, Walk

if TYPE_CHECKING:
    from fg_nav.both_feet import FeetResult

PLOTLY = "plotly-basic-4.1.1.min.js"
_HERE = Path(__file__).parent

_KINDS = {"imu": "inertial", "direction": "direction of the building", "own": "your own"}  # Others as they are named.


GAIT = (
    ("length_m", "stride length (m)", "{:.2f}", 1.0),
    ("duration_s", "stride duration (s)", "{:.2f}", 1.0),
    ("speed_m_s", "speed (m/s)", "{:.2f}", 1.0),
    ("cadence_steps_min", "cadence (steps/min)", "{:.1f}", 1.0),
    ("stance_share", "stance (%)", "{:.1f}", 100.0),
    ("clearance_m", "sensor clearance (cm)", "{:.1f}", 100.0),
    ("turning_deg", "turn (° clockwise)", "{:z.1f}", 1.0),
    ("step_length_m", "step length (m)", "{:.2f}", 1.0),
    ("step_width_m", "step width (m)", "{:.2f}", 1.0),
    ("step_time_s", "step time (s)", "{:.2f}", 1.0),
)
"""Gait parameters in their order: key, words, format, and factor of the unit."""


@dataclass(frozen=True)
class Section:
    """A part of the page: its anchor, title, sentences, table and charts."""

    name: str
    title: str
    words: Sequence[str] = ()
    charts: Sequence[Chart] = ()
    table: Sequence[Sequence[str]] = ()  # Its head first.


@dataclass(frozen=True)
class Page:
    """Content of the template."""

    title: str
    about: str
    verdicts: Sequence[Mapping[str, object]]  # Summaries, with method, verdict and reasons.
    highlights: Sequence[tuple[str, Cell, str]]
    columns: Sequence[str]  # Of the table: methods, or the person and each foot.
    table: Sequence[tuple[str, Sequence[Cell]]]
    table_title: str
    sections: Sequence[Section]
    remarks: Mapping[str, Sequence[tuple[str, str]]]  # By title, each with its method.
    configs: Mapping[str, Mapping[str, object]]


def write_page(folder: Path, page: Page) -> None:
    """Write the page of a result into its folder."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(_HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["json"] = lambda value: json.dumps(to_json(value), indent=1, ensure_ascii=False)
    content = {chart.name: render_plotly(chart) for section in page.sections for chart in section.charts}
    charts = json.dumps(content, separators=(",", ":"), allow_nan=False, ensure_ascii=False)
    # no character may end an element of the page
    charts = charts.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    text = environment.get_template("report.html.j2").render(
        page=page,
        version=find_version(),
        charts=Markup(charts),
        plotly=Markup(gzip.decompress((_HERE / f"{PLOTLY}.gz").read_bytes()).decode("utf-8")),
        licence=(_HERE / "LICENSE-plotly.txt").read_text(encoding="utf-8"),
        script=Markup((_HERE / "report.js").read_text(encoding="utf-8")),
    )
    (folder / REPORT).write_text(text, encoding="utf-8")


def compose_page(
    outcomes: Mapping[str, Outcome],
    summaries: Sequence[Mapping[str, Any]],
    configs: Mapping[str, Mapping[str, object]],
    walks: Mapping[str, Walk],
    both: FeetResult | None = None,
) -> Page:
    """Compose the page of one or more methods on one recording, or of both feet.

    `outcomes` and `configs` are by method, or by foot; so are `walks`, which are empty where the samples were not kept:
    of a walk in progress with a lag. The `summaries` are one of each method, or that of both feet.
    """
    columns = {str(one["method"]): one for one in summaries}
    method = ", ".join(columns)
    if both is not None:
        columns = {"person": summaries[0], **{side: summaries[0][side] for side in outcomes}}
    # recordings, by name and length
    names, about = dict[str, None](), dict[str, None]()
    for name, walk in walks.items():
        recording, path = walk.recording, walk.recording.provenance.path
        nameless = "a walk" if both is None else f"the {name} foot"
        named = path is not None and (path.name if path.stem != "recording" else f"{path.parent.name}/{path.name}")
        names[named or nameless] = None
        of_what = f"{recording.provenance.format}," if both is None else f"{name} foot"
        about[f"{of_what} {recording.duration_s:.1f} s at {1.0 / recording.period_s:.0f} Hz"] = None
    several = len(summaries) > 1
    return Page(
        title=" and ".join(names) or "a walk in progress",
        about=f"{method}; {', '.join(about)}" if about else method,
        verdicts=summaries,
        highlights=[] if several else _choose_highlights(summaries[0]),
        columns=list(columns),
        table=tabulate_figures(list(columns.values())),
        table_title="The person and each foot" if both else "Methods side by side" if several else "All figures",
        sections=[
            one
            for one in _draw_sections(outcomes, walks, both, _describe_gait(summaries, both))
            if one.charts or one.table
        ],
        remarks=group_notes(collect_notes([{**one, "method": name} for name, one in columns.items()])),
        configs=configs,
    )


def _choose_highlights(summary: Mapping[str, Any]) -> list[tuple[str, Cell, str]]:
    """The few figures that stand out: name, cell, and addition."""
    aligned, strides = f"aligned: {summary.get('alignment')}", format_count(int(summary["strides"]), "stride")
    sigma, width_sigma = summary.get("distance_sigma_m"), summary.get("width_sigma_m")
    end_sigma_m = hypot(*(np.nan if one is None else one for one in summary["end_sigma_m"][:2]))
    cells = "" if width_sigma is None else f"± {width_sigma:.2f} m, {format_count(summary['cells'], 'cell')} of steps"
    shown = [
        ("distance_m", "distance", strides if sigma is None else f"± {format_sigma(sigma)} m, {strides}"),
        ("closure_m", "start to end", f"± {format_sigma(end_sigma_m)} m horizontally"),
        ("width_m", "feet apart, across", cells),
        ("rmse_2d_m", "horizontal error, rms", aligned),
        ("end_error_m", "error at the end", aligned),
    ]
    return [
        (words, Cell(key, f"{format_digits(value, decimals=2 + (key != 'width_m'))} m", value), addition)
        for key, words, addition in shown
        if (value := summary.get(key)) is not None and (key != "closure_m" or is_loop([summary]))
    ]


def _draw_sections(
    outcomes: Mapping[str, Outcome], walks: Mapping[str, Walk], both: FeetResult | None, gait: Sequence[Section]
) -> list[Section]:
    """Draw the sections, each with its sentences; of two feet without graph, stances, field and returns."""
    walk = next(iter(walks.values()), None)
    paths = align_paths(outcomes, walk) if both is None else align_feet(both)
    views, frame, first = paths.views, paths.frame, paths.first
    words = [frame.words, describe_ellipses(first)]
    if both is not None:
        words = [_describe_origin(both), *words]
    people = {} if paths.person is None else {"person": paths.person}
    course = draw_course(paths)
    path = Section("path", "Path", charts=[replace(course, caption=" ".join([*words, course.caption]))])
    height = Section("height", "Height", [], [draw_height(views)])
    sigma = Section("sigma", "Uncertainty", [], [draw_sigmas({**views, **people}, (frame.x, frame.y))])
    bias = Section("bias", "Gyroscope bias", [], [draw_gyro_bias(views)])
    # errors, each path by its own alignment
    aligned = {name: align_solution(walks.get(name), outcome) for name, outcome in outcomes.items()} | people
    compared = {name: view for name, view in aligned.items() if view.comparison is not None}
    words = [describe_alignment(view.comparison) for view in compared.values() if view.comparison is not None]
    if len(compared) > 1:
        words = [f"{name}: {one}" for name, one in zip(compared, words, strict=True)]
    errors = Section("errors", "Errors", words, [draw_errors(compared)] if compared else [])
    if both is not None:
        heading = Section("heading", "Heading", [], [draw_headings(people)])
        return [path, *gait, _draw_distance(both), height, sigma, bias, heading, errors]
    # the graph
    words = describe_graph({name: view.solution for name, view in views.items()})
    with_graph = next((view for view in views.values() if view.solution.graph), first)
    graph = Section("graph", "The graph", words, draw_graph(with_graph, frame))
    # stances
    words, charts = list[str](), list[Chart]()
    if walk is not None:
        found, charts = walk.stances, draw_samples(walk.recording, walk.stances)
        footfalls = format_count(found.n_footfalls, "footfall")
        words = [f"{footfalls} in {format_count(len(found), 'stance')} ({found.detector})."]
        if not len(found):
            pocket = walk.options.mount == "pocket"
            words = ["No stances are used: a thigh never stands still." if pocket else "None."]
    stances = Section("stances", "Stances", words, charts)
    # places recognized, the longest first
    recognized = sorted(first.solution.returns, key=lambda one: -one.length_m)
    words = [describe_return(one) for one in recognized[:MAX_RETURNS]]
    if more := len(recognized) - len(words):
        words.append(f"{format_count(more, 'more return')} of {recognized[MAX_RETURNS].length_m:.0f} m or less.")
    returns = Section("returns", "Places recognized", words, draw_returns(recognized[:MAX_RETURNS]))
    return [path, *gait, graph, height, sigma, stances, bias, *_draw_field(views, walk), returns, errors]


def _describe_gait(summaries: Sequence[Mapping[str, Any]], both: FeetResult | None) -> list[Section]:
    """Tabulate the means of the gait parameters of each method, or of each foot; nothing of a few strides."""
    known = {str(one["method"]): one.get("gait", {}) for one in summaries} if both is None else summaries[0]["gait"]
    means = {name: of for name, of in known.items() if "mean" in of}
    if not means:
        return []
    table = [["mean ± sd", *means], ["strides", *(str(of["strides"]) for of in means.values())]]
    for key, words, pattern, times in GAIT:
        if any(key in of["mean"] for of in means.values()):
            both_of = ((of["mean"].get(key, np.nan), of["sd"].get(key, np.nan)) for of in means.values())
            table.append(
                [words, *("\u00a0±\u00a0".join(pattern.format(times * one) for one in pair) for pair in both_of)]
            )
    said = ["Over strides with one before and one after, without turns; each stride is in gait.csv."]
    if asymmetry := known.get("asymmetry_percent"):
        names = {key: words.partition(" (")[0] for key, words, _, _ in GAIT}
        parts = (f"{names[key]} {value:+.1f} %" for key, value in asymmetry.items())
        said.append(f"Asymmetry, right less left over the mean of both: {', '.join(parts)}.")
    return [Section("gait", "Gait", said, table=table)]


def _draw_field(views: Mapping[str, AlignedSolution], walk: Walk | None) -> list[Section]:
    """Draw heading and field of a single foot, or of the methods' one recording; of several methods the first one's."""
    words, headings, counts, strengths = list[str](), [draw_headings(views)], list[str](), list[Chart]()
    if walk is not None and walk.field is not None:
        table, field = next(iter(views.values())).solution.stances, walk.field
        headings.append(draw_compass(field, table))
        turned = np.rad2deg(field.mean_heading_difference)
        words = [f"The compass shows {turned:+.1f}° more than the gyroscope on average."]
        clear, disturbed, _ = (int(flag.sum()) for flag, _, _ in group_field(field, table))
        counts = [f"At {clear} of {len(field)} footfalls the field is undisturbed, at {disturbed} disturbed."]
        strengths = [draw_strength(field, table)]
    return [
        Section("heading", "Heading", words, headings),
        Section("strength", "Field strength", counts, strengths),
    ]


def describe_alignment(comparison: Comparison) -> str:
    """Alignment of a path with its truth, in words and figures."""
    found = comparison.alignment
    if found.mode == "none":
        return "The path was not aligned with the truth."
    words = {
        "yaw": "turned about up and shifted as fits all compared points best",
        "se3": "rotated about any axis and shifted as fits all compared points best",
        "origin": "shifted so that the first compared points coincide",
    }[found.mode]
    turn_deg = -np.rad2deg(np.arctan2(found.truth_R_nav[1, 0], found.truth_R_nav[0, 0]))
    side = "clockwise" if turn_deg > 0 else "counterclockwise"
    turned = "" if found.mode == "origin" else f", by {abs(turn_deg):.2f}° {side}"
    return f"The path was {words}{turned}. {len(comparison.t)} points are compared."


def describe_graph(solutions: Mapping[str, Solution]) -> list[str]:
    """Numbers of factors by kind, a sentence a method."""
    words = []
    for name, one in solutions.items():
        if one.graph:
            counts = {kind: count for kind, count in one.graph.items() if kind != "gated_out"}
            kinds = ", ".join(f"{_KINDS.get(kind, kind.replace('_', ' '))} {count}" for kind, count in counts.items())
            left_out = one.graph.get("gated_out", 0)
            gated = f" The gate left out the compass of {format_count(left_out, 'footfall')}." if left_out else ""
            words.append(f"Factors of {name} by kind: {kinds}; {sum(counts.values())} in all.{gated}")
    return words


def _describe_origin(both: FeetResult) -> str:
    """Which recording is of which foot, and how their clocks were aligned, in words."""
    pairing = both.pairing
    known = {"named": "as it was named", "shown": "as the steps show", "assumed": "which is assumed"}[pairing.sides]
    words = f"The first recording is of the {pairing.order[0]} foot, {known}."
    if pairing.width_m is None or abs(pairing.clock_offset_s) < 5e-4:
        return words
    clock = f"{pairing.clock_offset_s:+.3f} s, {'as given' if pairing.clock_given else 'by the signals'}"
    return f"{words} To the stamps of the second one was added {clock}."


def _draw_distance(result: FeetResult) -> Section:
    """Draw the distance of the sensors, and the reach of two standing feet."""
    title = "Distance between the feet"
    left, right = result.left, result.right
    if left is None or right is None or result.width_m is None:
        return Section("distance", title)
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
