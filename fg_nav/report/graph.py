"""The graph of a solution: factors by kind, weight of each footfall's compass, gyro bias, iSAM2 against the batch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.magnetic.quasi_static import DISTURBED, QUASI_STATIC
from fg_nav.report.charts import (
    BAND,
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
from fg_nav.report.course import AlignedSolution, Frame, compose_map, draw_path
from fg_nav.report.series import measure_travelled
from fg_nav.solution import Solution, StanceTable
from fg_nav.text import format_count

HEAVIEST = 0.1  # Marked share of the footfalls, those of most weight.

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
    """Numbers of factors by kind, a sentence a method."""
    words = []
    for name, one in solutions.items():
        if one.graph:
            counts = {kind: count for kind, count in one.graph.items() if kind in _KINDS}
            kinds = ", ".join(f"{_KINDS[kind]} {count}" for kind, count in counts.items())
            left_out = one.graph.get("gated_out", 0)
            gated = f" The gate left out the compass of {format_count(left_out, 'footfall')}." if left_out else ""
            words.append(f"Factors of {name} by kind: {kinds}; {sum(counts.values())} in all.{gated}")
    return words or [f"No graph: {', '.join(solutions)} has none, or does not tell its factors."]


def draw_graph(view: AlignedSolution, frame: Frame) -> list[Chart]:
    """Draw the graph of one solution, as far as it is known."""
    solution, table = view.solution, view.solution.stances
    charts = []
    if table.compass_weight is not None and bool((table.compass_weight > 0.0).any()):
        charts += [_draw_weights(table, table.compass_weight), _draw_heaviest(view, frame, table.compass_weight)]
    if solution.graph:
        charts.append(_draw_bias(table))
    if solution.moment is not None:
        batch = solution.stances if solution.polished is None else solution.polished.stances
        charts.append(_draw_moment(solution.moment, batch))
    return charts


def _draw_weights(table: StanceTable, weight: Floats) -> Chart:
    """Statistic, weight of the compass and sigma of the differential field along the path."""
    travelled = measure_travelled(table.t, table)
    panels, statistic = [], table.field_statistic
    if statistic is not None and np.isfinite(statistic).any():
        words = np.array(table.field, dtype=object)
        groups = [(words == QUASI_STATIC, GREEN, "passed"), (words == DISTURBED, VERMILION, "disturbed")]
        traces = [
            dots(*_thinned(travelled[use], statistic[use]), color, f"statistic, {word}")
            for use, color, word in groups
            if use.any()
        ]
        limit = level(travelled, 1.0, GRAY, "threshold")
        panels.append(Panel("statistic / threshold", [*traces, limit], {"type": "log", "exponentformat": "power"}))
    weights = dots(*_thinned(travelled, weight), BLUE, "compass weight")
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


def _thinned(x: Floats, y: Floats) -> tuple[list[float | None], list[float | None]]:
    row = thin(x, MAX_DOTS)
    return to_meters(x[row]), to_numbers(y[row])


def _draw_heaviest(view: AlignedSolution, frame: Frame, weight: Floats) -> Chart:
    """Mark on the map the footfalls of most weight, by compass and by differential field."""
    table, place = view.solution.stances, view.stance_position()
    quiet = np.zeros(len(table)) if table.field_statistic is None else -np.nan_to_num(table.field_statistic)
    found: list[tuple[Ints, str, str, float, str]] = [
        (_find_most(weight, quiet), GREEN, "compass weighs most", 7.0, "circle"),
    ]
    if table.differential_sigma is not None:
        information = np.nan_to_num(table.differential_sigma**-2.0)
        found.append((_find_most(information, quiet), PURPLE, "differential field weighs most", 11.0, "circle-open"))
    data = [draw_path(view, fade(BLUE, 0.5), "path", width=1.5)]
    for row, color, words, size, symbol in found:
        mark = {"style": {"symbol": symbol, "line": {"width": 1.5}}, "size": size}
        hover = f"footfall %{{customdata}}, {words}<extra></extra>"
        x, y = (to_meters(place[row, axis]) for axis in (0, 1))
        data.append(dots(x, y, color, words, customdata=row.tolist(), hovertemplate=hover, **mark))
    caption = f"The tenth of the footfalls that weighs most, of {format_count(len(table), 'footfall')}."
    return compose_map(data, [view], frame, "heaviest", caption)


def _find_most(weight: Floats, then: Floats) -> Ints:
    """Rows of the largest positive weights, in their order; of equal ones those with the largest `then`."""
    count = min(max(round(HEAVIEST * len(weight)), 1), MAX_DOTS)
    heaviest = np.lexsort((-then, -weight))[:count]
    return np.sort(heaviest[weight[heaviest] > 0.0])


def _draw_bias(table: StanceTable) -> Chart:
    """Gyro bias about up, by which the heading drifts, with its 95 % band."""
    up = table.nav_R_body[:, 2]
    bias = np.rad2deg((table.gyro_bias * up).sum(axis=1))
    sigma = np.rad2deg(np.sqrt(((table.gyro_bias_sigma * up) ** 2).sum(axis=1)))
    row = thin(table.t)
    estimate = line(to_seconds(table.t[row]), to_numbers(bias[row]), BLUE, "estimate", mode="lines+markers")
    traces = [band(table.t, bias, BAND * sigma, BLUE, "95 %"), estimate | {"marker": {"size": 3.5}}]
    caption = "Gyroscope bias about up, which turns the heading; its band without correlations of the axes."
    return stack("bias-up", [Panel("bias about up (deg/s)", traces)], caption)


def _draw_moment(moment: StanceTable, batch: StanceTable) -> Chart:
    """Estimate of iSAM2 at the moment of each footfall less that of the batch."""
    nearest = np.clip(np.searchsorted(batch.t, moment.t - 1e-6), 0, len(batch) - 1)
    moved = moment.position - batch.position[nearest]
    turned = wrap_angle(compute_heading(moment.nav_R_body) - compute_heading(batch.nav_R_body[nearest]))
    sigma_m = np.sqrt(np.trace(moment.position_cov[:, :2, :2], axis1=1, axis2=2))
    row, words = thin(moment.t), "95 % at the moment"

    def difference(value: Floats) -> Trace:
        return line(to_seconds(moment.t[row]), to_numbers(value[row]), BLUE, "moment less batch")

    limit = line(to_seconds(moment.t[row]), to_numbers(BAND * sigma_m[row]), OCHRE, words)
    claimed = band(moment.t, np.zeros(len(moment)), BAND * np.rad2deg(moment.heading_sigma), OCHRE, words)
    apart = [limit, difference(np.linalg.norm(moved[:, :2], axis=1))]
    heading = [claimed, difference(np.rad2deg(turned))]
    panels = [Panel("horizontal (m)", apart, {"rangemode": "tozero"}), Panel("heading (deg)", heading)]
    caption = "Estimate of iSAM2 at the moment of each footfall, less that of the batch afterwards."
    return stack("moment", panels, caption)
