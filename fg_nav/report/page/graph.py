"""The graph of a solution: factors by kind, weight of each footfall's compass, gyro bias, iSAM2 against the batch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.magnetic.quasi_static import DISTURBED, QUASI_STATIC
from fg_nav.report.aligned import AlignedSolution
from fg_nav.report.page.compass import measure_travelled
from fg_nav.report.page.course import Frame, compose_map, draw_path
from fg_nav.report.page.figures import (
    BLUE,
    GRAY,
    GREEN,
    MAX_DOTS,
    OCHRE,
    PURPLE,
    VERMILION,
    Chart,
    Panel,
    Trace,
    band,
    dots,
    fade,
    level,
    line,
    stack,
    thin,
    to_meters,
    to_numbers,
    to_seconds,
)
from fg_nav.report.page.series import BAND
from fg_nav.solution import Solution, StanceTable
from fg_nav.text import format_count

HEAVIEST = 0.1  # Share of the footfalls that are marked as those that weigh most.

_KINDS = {
    "imu": "inertial",
    "zero_velocity": "zero velocity",
    "magnetic_heading": "magnetic heading",
    "differential_field": "differential field",
    "field_potential": "field potential",
    "same_place": "same place",
    "known_place": "known place",
    "direction": "direction of the building",
    "position_fix": "position fix",
    "own": "your own",
}


def describe_graph(solutions: Mapping[str, Solution]) -> list[str]:
    """Say how many factors of each kind each method has."""
    words = [_describe_counts(name, one.graph) for name, one in solutions.items() if one.graph]
    if not words:
        return [f"No graph: {', '.join(solutions)} has none, or does not tell its factors."]
    return words


def _describe_counts(name: str, graph: Mapping[str, int]) -> str:
    kinds = [f"{_KINDS[kind]} {count}" for kind, count in graph.items() if kind in _KINDS]
    total = sum(count for kind, count in graph.items() if kind in _KINDS)
    left_out = graph.get("gated_out", 0)
    gated = f" The gate left out the compass of {format_count(left_out, 'footfall')}." if left_out else ""
    return f"Factors of {name} by kind: {', '.join(kinds)}; {total} in all.{gated}"


def draw_graph(view: AlignedSolution, frame: Frame) -> list[Chart]:
    """Draw what is known of the graph of one solution."""
    table = view.solution.stances
    charts = []
    if has_weights(table):
        charts += [_draw_weights(table), _draw_heaviest(view, frame)]
    if view.solution.graph:
        charts.append(_draw_bias(table))
    if view.solution.moment is not None:
        charts.append(_draw_moment(view.solution.moment, _find_batch(view.solution)))
    return charts


def has_weights(table: StanceTable) -> bool:
    """Whether the compass of a footfall weighs."""
    return table.compass_weight is not None and bool((table.compass_weight > 0.0).any())


def _draw_weights(table: StanceTable) -> Chart:
    """Statistic, weight of the compass and sigma of the differential field along the path."""
    travelled = measure_travelled(table.t, table)
    panels = []
    if table.field_statistic is not None and np.isfinite(table.field_statistic).any():
        panels.append(_draw_statistic(table, table.field_statistic, travelled))
    assert table.compass_weight is not None
    weights = dots(*_thinned(travelled, table.compass_weight), BLUE, "compass weight")
    panels.append(Panel("compass weight", [weights], {"range": [-0.05, 1.05]}))
    if table.differential_sigma is not None and np.isfinite(table.differential_sigma).any():
        sigma = np.rad2deg(table.differential_sigma)
        trace = line(*_thinned(travelled, sigma), PURPLE, "sigma by differential field")
        panels.append(Panel("bias about up (deg/s)", [trace], {"rangemode": "tozero"}))
    caption = (
        "Above, the detector's statistic over its threshold. The weight is the information of the footfall's compass "
        "over that at the walk's own spread of the field. Below, the sigma of the gyroscope's bias by the differential "
        "field alone."
    )
    return stack("weights", panels, caption, "length of the path (m)")


def _draw_statistic(table: StanceTable, statistic: Floats, travelled: Floats) -> Panel:
    words = np.array(table.field, dtype=object)
    groups = [(words == QUASI_STATIC, GREEN, "passed"), (words == DISTURBED, VERMILION, "disturbed")]
    traces = [
        dots(*_thinned(travelled[use], statistic[use]), color, f"statistic, {word}")
        for use, color, word in groups
        if use.any()
    ]
    limit = level(travelled, 1.0, GRAY, "threshold")
    return Panel("statistic / threshold", [*traces, limit], {"type": "log", "exponentformat": "power"})


def _thinned(x: Floats, y: Floats) -> tuple[list[float | None], list[float | None]]:
    row = thin(x, MAX_DOTS)
    return to_meters(x[row]), to_numbers(y[row])


def _draw_heaviest(view: AlignedSolution, frame: Frame) -> Chart:
    """Mark on the map the footfalls whose compass, and whose differential field, weigh most."""
    table, place = view.solution.stances, view.stance_position()
    assert table.compass_weight is not None
    quiet = np.zeros(len(table)) if table.field_statistic is None else -np.nan_to_num(table.field_statistic)
    found: list[tuple[Ints, str, str, float, str]] = [
        (_find_most(table.compass_weight, quiet), GREEN, "compass weighs most", 7.0, "circle"),
    ]
    if table.differential_sigma is not None:
        information = np.nan_to_num(table.differential_sigma**-2.0)
        found.append((_find_most(information, quiet), PURPLE, "differential field weighs most", 11.0, "circle-open"))
    data = [draw_path(view, fade(BLUE, 0.5), "path")]
    for row, color, words, size, symbol in found:
        mark = {"style": {"symbol": symbol, "line": {"width": 1.5}}, "size": size}
        hover = f"footfall %{{customdata}}, {words}<extra></extra>"
        x, y = (to_meters(place[row, axis]) for axis in (0, 1))
        data.append(dots(x, y, color, words, customdata=row.tolist(), hovertemplate=hover, **mark))
    caption = f"The tenth of the footfalls that weighs most, of {format_count(len(table), 'footfall')}."
    return compose_map(data, [view], frame, "heaviest", caption)


def _find_most(weight: Floats, then: Floats) -> Ints:
    """Rows of the heaviest that weigh at all, in their order; of equal ones those with the largest `then`."""
    count = min(max(round(HEAVIEST * len(weight)), 1), MAX_DOTS)
    heaviest = np.lexsort((-then, -weight))[:count]
    return np.sort(heaviest[weight[heaviest] > 0.0])


def _draw_bias(table: StanceTable) -> Chart:
    """Gyro bias about up, by which the heading drifts, with its 95 % band and what the differential field shows."""
    up = table.nav_R_body[:, 2]
    bias = np.rad2deg((table.gyro_bias * up).sum(axis=1))
    sigma = np.rad2deg(np.sqrt(((table.gyro_bias_sigma * up) ** 2).sum(axis=1)))
    row = thin(table.t)
    estimate = line(to_seconds(table.t[row]), to_numbers(bias[row]), BLUE, "estimate", mode="lines+markers")
    traces = [band(table.t, bias, BAND * sigma, BLUE, "95 %"), estimate | {"marker": {"size": 3.5}}]
    caption = "Gyroscope bias about up, which turns the heading; its band without correlations of the axes."
    return stack("bias-up", [Panel("bias about up (deg/s)", traces)], caption)


def _find_batch(solution: Solution) -> StanceTable:
    """Table of the batch solution next to an online one; of its own graph at the end where there is none."""
    return solution.stances if solution.polished is None else solution.polished.stances


def _draw_moment(moment: StanceTable, batch: StanceTable) -> Chart:
    """Estimate of iSAM2 at the moment of each footfall less that of the batch."""
    nearest = np.clip(np.searchsorted(batch.t, moment.t - 1e-6), 0, len(batch) - 1)
    moved = moment.position - batch.position[nearest]
    turned = wrap_angle(compute_heading(moment.nav_R_body) - compute_heading(batch.nav_R_body[nearest]))
    sigma_m = np.sqrt(np.trace(moment.position_cov[:, :2, :2], axis1=1, axis2=2))
    none = np.zeros(len(moment))
    apart = _draw_difference(moment.t, np.linalg.norm(moved[:, :2], axis=1), sigma_m)
    heading = _draw_difference(moment.t, np.rad2deg(turned), np.rad2deg(moment.heading_sigma), none)
    panels = [Panel("horizontal (m)", apart, {"rangemode": "tozero"}), Panel("heading (deg)", heading)]
    return stack(
        "moment", panels, "Estimate of iSAM2 at the moment of each footfall, less that of the batch afterwards."
    )


def _draw_difference(t: Floats, value: Floats, sigma: Floats, about: Floats | None = None) -> list[Trace]:
    row = thin(t)
    trace = line(to_seconds(t[row]), to_numbers(value[row]), BLUE, "moment less batch")
    if about is not None:
        return [band(t, about, BAND * sigma, OCHRE, "95 % at the moment"), trace]
    limit = line(to_seconds(t[row]), to_numbers(BAND * sigma[row]), OCHRE, "95 % at the moment")
    return [limit, trace]
