"""The path from above: methods, truth, ellipses, footfalls with all that is known of them, and the disturbed field."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.frames import compute_heading
from fg_nav.magnetic.quasi_static import DISTURBED, QUASI_STATIC
from fg_nav.report.aligned import AlignedSolution, has_sure_start
from fg_nav.report.decimation import spread_rows
from fg_nav.report.ellipses import REACH, Ellipses, find_ellipses, find_extent
from fg_nav.report.page.figures import (
    BLUE,
    CYCLE,
    GRAY,
    GREEN,
    MAX_DOTS,
    MAX_POINTS,
    VERMILION,
    Chart,
    Trace,
    axis,
    dots,
    fade,
    line,
    to_meters,
)
from fg_nav.report.page.returns import mark_map
from fg_nav.samples.gaps import find_holes
from fg_nav.solution import StanceTable
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth
from fg_nav.walk import Options, Outcome

MAX_ELLIPSES = 250
MAX_WITH_ELLIPSES = 2  # Methods whose ellipses lie over one another and can still be told apart.
_OUTLINE = 25  # Corners of an ellipse.
_MIN_POINTS = 4  # Of a stride, for a line to be drawn by samples; with fewer it is drawn through the footfalls.
LATER = "legendonly"  # Of what is not drawn before the reader asks for it in the legend.

_HOVER = (
    "footfall %{customdata[0]}, t %{customdata[1]:.2f} s<br>"
    "{x} %{x:.2f} ± %{customdata[2]:.3f} m<br>{y} %{y:.2f} ± %{customdata[3]:.3f} m<br>"
    "up %{customdata[4]:.2f} ± %{customdata[5]:.3f} m<br>heading %{customdata[6]:.1f} ± %{customdata[7]:.1f}°<br>"
    "field %{customdata[8]}<extra>{name}</extra>"
)


@dataclass(frozen=True)
class Frame:
    """Where the axes of a picture point: their names, the letters at the north arrow, and a sentence."""

    x: str
    y: str
    north: str
    words: str


def describe_frame(view: AlignedSolution, outcome: Outcome, options: Options) -> Frame:
    """Say in which frame a solution is drawn, and what its ellipses are relative to."""
    if isinstance(view.truth, FootprintTruth):
        return Frame("x", "y", "y", "The axes are those of the survey; its azimuth is not known.")
    if view.truth is not None:
        return Frame("east", "north", "N", "North is that of the truth.")
    if options.heading_deg is not None:
        given = f"North follows from the heading at the start, given as {options.heading_deg:g}°."
        return Frame("east", "north", "N", given)
    if outcome.field_used:
        return Frame("east", "north", "N mag", "North is magnetic, by the compass along the walk.")
    words = "North is not known: the arrow shows where the sensor's x axis pointed at the start."
    return Frame("x", "y", "start", words)


def describe_ellipses(view: AlignedSolution) -> str:
    """Say what the ellipses hold, and what they are relative to."""
    table = view.solution.stances
    own = "Ellipses hold 95 % by the method's own covariance, relative to the first footfall"
    if view.is_turned:
        return (
            f"{own} and to a path that is turned onto the truth: the uncertainty of north is not in them. Laid on "
            "the truth as a whole, the path may lie closer to it than they are large, and apart from it at the start."
        )
    if has_sure_start(table):
        return f"{own} and to the heading there, which counts as known."
    return f"{own}; the uncertainty of north is in them."


def describe_alignment(view: AlignedSolution) -> str:
    """Say how a path was laid on its truth, in figures."""
    if view.comparison is None:
        return ""
    found = view.comparison.alignment
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
    return f"The path was {words}{turned}. {len(view.comparison.t)} points are compared."


def draw_course(views: Mapping[str, AlignedSolution], outcomes: Mapping[str, Outcome], frame: Frame) -> Chart:
    """Draw the paths of one or more methods."""
    first, alone = next(iter(views.values())), len(views) == 1
    data = _draw_truth(first.truth) + (mark_map(first) if alone else [])
    for k, (name, view) in enumerate(views.items()):
        data += _draw_method(view, outcomes[name], name, CYCLE[k % len(CYCLE)], frame, alone)
        data += _draw_ellipses(find_ellipses(view, MAX_ELLIPSES), CYCLE[k % len(CYCLE)], k, len(views))
    data += _draw_ends(first.stance_position())
    return compose_map(data, list(views.values()), frame)


_HOW_TO = "Drag to zoom, double-click for all of it; a touch on the legend hides and shows."


def compose_map(
    data: list[Trace], views: Sequence[AlignedSolution], frame: Frame, name: str = "path", caption: str = _HOW_TO
) -> Chart:
    """Put what is drawn onto axes that show all of these paths."""
    ranges, shape = _frame_map(views)
    layout: dict[str, Any] = {
        "xaxis": axis(f"{frame.x} (m)", range=ranges[0], constrain="range"),
        "yaxis": axis(f"{frame.y} (m)", range=ranges[1], scaleanchor="x", scaleratio=1),
        "hovermode": "closest",
    }
    height = f"clamp(22rem, calc({shape:.3f} * min(100vw, 73rem) + 5rem), 44rem)"
    return Chart(name, data, layout, caption, height, scaled=True, north=frame.north)


def draw_feet(person: AlignedSolution, feet: Mapping[str, AlignedSolution], frame: Frame) -> Chart:
    """Draw the paths of both feet, and between them that of the person with its ellipses."""
    data = _draw_truth(person.truth)
    for color, (side, view) in zip(CYCLE, feet.items(), strict=False):
        name = f"{side} foot"
        data.append(_path(_choose_path(view), fade(color, 0.7), name, width=1, hoverinfo="skip", legendgroup=name))
        data += _draw_footfalls(view, name, color, frame, alone=False)
    data.append(_path(_choose_path(person), GREEN, "person", width=1.4, hoverinfo="skip"))
    data += _draw_ellipses(find_ellipses(person, MAX_ELLIPSES), GREEN, 0, 1) + _draw_ends(person.stance_position())
    return compose_map(data, [person, *feet.values()], frame)


def _draw_truth(truth: Truth | None) -> list[Trace]:
    if isinstance(truth, TrajectoryTruth):
        path = truth.position[spread_rows(len(truth.position), MAX_POINTS)]
        return [_path(path, GRAY, "truth", width=5, opacity=0.6, hoverinfo="skip")]
    if truth is not None:
        hover = "surveyed footprint of stride %{customdata}<extra></extra>"
        kind: dict[str, Any] = {
            "style": {"symbol": "square-open", "line": {"width": 2}},
            "size": 9,
            "hovertemplate": hover,
        }
        mark = dots(*_axes(truth.xy), GRAY, "surveyed footprints", customdata=truth.stride.tolist(), **kind)
        return [mark]
    return []


def _draw_method(
    view: AlignedSolution, outcome: Outcome, name: str, color: str, frame: Frame, alone: bool
) -> list[Trace]:
    solution = outcome.solution
    data = [_path(_choose_path(view), color, name, width=1.5, hoverinfo="skip", legendgroup=name)]
    if outcome.polished is not None:
        batch = AlignedSolution(outcome.polished.solution, view.truth, view.comparison)
        data.append(_path(_choose_path(batch), GREEN, f"{name}, batch afterwards", width=1.2, hoverinfo="skip"))
    if solution.moment is not None:
        at_moment = view.align_position(solution.moment.position)[spread_rows(len(solution.moment), MAX_POINTS)]
        words_then = f"{name}, as known at the moment"
        data.append(_path(at_moment, color, words_then, style={"dash": "dot"}, hoverinfo="skip", visible=LATER))
    return data + _draw_footfalls(view, name, color, frame, alone)


def _choose_path(view: AlignedSolution) -> Floats:
    """Points (M, 2) m: samples evenly spread, or the footfalls where there are too many of them; NaN in a hole."""
    solution, stances = view.solution, view.solution.stances
    t, dense = solution.t, solution.position
    if len(stances) * _MIN_POINTS > MAX_POINTS:
        t, dense = stances.t, stances.position
    row = spread_rows(len(dense), MAX_POINTS)
    behind = np.searchsorted(t[row], solution.t[find_holes(solution.t) + 1])
    return np.insert(view.align_position(dense[row])[:, :2], behind, np.nan, axis=0)


def draw_path(view: AlignedSolution, color: str, name: str) -> Trace:
    """Draw the path of a solution alone."""
    return _path(_choose_path(view), color, name, width=1.5, hoverinfo="skip")


def _path(xy: Floats, color: str, name: str, **more: Any) -> Trace:
    return line(*_axes(xy), color, name, **more)


def _axes(xy: Floats) -> tuple[list[float | None], list[float | None]]:
    return to_meters(xy[:, 0]), to_meters(xy[:, 1])


def _draw_ellipses(found: Ellipses | None, color: str, k: int, n_methods: int) -> list[Trace]:
    """The ellipses of method `k` as large as they are; of one alone, where that is small, on demand enlarged.

    One entry of the legend is for the ellipses of all methods; of many methods they are drawn on demand.
    """
    if found is None:
        return []
    shown: dict[str, Any] = {} if n_methods <= MAX_WITH_ELLIPSES else {"visible": LATER}
    drawn = [(1, "95 % ellipses", {"showlegend": k == 0} | shown)]
    if found.zoom > 1 and n_methods == 1:
        drawn.append((found.zoom, f"ellipses {found.zoom} times as large", {"visible": LATER}))
    traces = []
    for factor, words, more in drawn:
        outline = found.outline(_OUTLINE, factor)
        broken = np.concatenate([outline, np.full((len(outline), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        fill = {"fill": "toself", "fillcolor": fade(color, 0.18), "hoverinfo": "skip"}
        traces.append(_path(broken, color, words, width=0.6, legendgroup=words, **fill, **more))
    return traces


def _draw_footfalls(view: AlignedSolution, name: str, color: str, frame: Frame, alone: bool) -> list[Trace]:
    """Footfalls that answer the pointer; of one method alone colored by the verdict on the field."""
    table = view.solution.stances
    row = spread_rows(len(table), MAX_DOTS)
    verdict = np.array(table.field, dtype=object)[row]
    groups: list[tuple[Bools, str, str]] = [(np.ones(len(row), dtype=bool), color, name)]
    entry: dict[str, Any] = {} if alone else {"legendgroup": name, "showlegend": False}
    if alone:
        clear, disturbed = verdict == QUASI_STATIC, verdict == DISTURBED
        what = "strides" if name == "pocket" else "footfalls"
        groups = [
            (~clear & ~disturbed, BLUE, what),
            (clear, GREEN, f"{what}, field undisturbed"),
            (disturbed, VERMILION, f"{what}, field disturbed"),
        ]
    position, about = view.stance_position()[row], _describe_footfalls(view, table)
    hover = _HOVER.replace("{x}", frame.x).replace("{y}", frame.y).replace("{name}", "" if alone else name)
    return [
        dots(
            *_axes(position[use]), mark, label, size=5 if len(row) < 500 else 4, hovertemplate=hover,
            customdata=[about[k] for k in row[use]], **entry,
        )
        for use, mark, label in groups
        if use.any()
    ]  # fmt: skip


def _describe_footfalls(view: AlignedSolution, table: StanceTable) -> Sequence[list[object]]:
    """What the pointer shows of each footfall, in the order of `_HOVER`."""
    sigma = np.sqrt(np.diagonal(view.position_cov(), axis1=1, axis2=2))
    heading_deg = np.rad2deg(compute_heading(view.align_attitude(table.nav_R_body))) % 360.0
    columns = [
        table.t, sigma[:, 0], sigma[:, 1], view.stance_position()[:, 2], sigma[:, 2], heading_deg,
        np.rad2deg(table.heading_sigma),
    ]  # fmt: skip
    figures = [to_meters(column) for column in columns]
    said = zip(table.field, table.field_reason, strict=True)
    field = [f"{word}: {reason}" if reason else word for word, reason in said]
    return [[k, *values] for k, values in enumerate(zip(*figures, field, strict=True))]


def _draw_ends(stance: Floats) -> list[Trace]:
    """Mark where the walk begins and ends."""
    apart = bool(np.linalg.norm(stance[-1, :2] - stance[0, :2]) > 0.05 * find_extent(stance))
    ends = stance[[0, -1], :2] if apart else stance[:1, :2]
    mark = {"symbol": ["circle-open", "square-open"][: len(ends)], "line": {"width": 2}}
    words = ["start", "end"] if apart else ["start, end"]
    places = ["top right", "bottom right"][: len(ends)]  # two close to one another are legible
    more: dict[str, Any] = {"mode": "markers+text", "text": words, "textposition": places, "hoverinfo": "skip"}
    return [dots(*_axes(ends), GRAY, "start and end", size=10, style=mark, showlegend=False, **more)]


def _frame_map(views: Sequence[AlignedSolution]) -> tuple[list[list[float]], float]:
    """Ranges of both axes that show all paths, and the height of the map over its width."""
    points = [_choose_path(view) for view in views]
    truth = views[0].truth
    if truth is not None:
        points.append(truth.position[:, :2] if isinstance(truth, TrajectoryTruth) else truth.xy)
    found = find_ellipses(views[0], MAX_ELLIPSES)
    if found is not None:
        reach = np.minimum(found.semi[:, 1:], REACH * find_extent(views[0].stance_position()))
        points += [found.centre - reach, found.centre + reach]
    every = np.vstack(points)
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    margin = 0.06 * float(max(np.max(high - low), 0.5))
    low, high = low - margin, high + margin
    ranges = [[round(float(low[k]), 2), round(float(high[k]), 2)] for k in (0, 1)]
    return ranges, float((high[1] - low[1]) / (high[0] - low[0]))
