"""Charts over time, or along the path: of methods, of the field at the footfalls, of samples, graph and returns.

Headings are of the body's x axis, rad clockwise from north. Turns are counted from stance to stance: in a swing the
axis may point anywhere, even up.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection.stance import Stances
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.magnetic.footfall_field import FootfallField
from fg_nav.recording import Recording
from fg_nav.report.charts import (
    ALONG_PATH,
    BAND,
    BLUE,
    CYCLE,
    GRAY,
    GREEN,
    MAX_DOTS,
    METERS,
    OCHRE,
    PURPLE,
    VERMILION,
    AlignedSolution,
    Chart,
    Frame,
    Panel,
    Trace,
    band,
    compose_map,
    dots,
    draw_path,
    fade,
    group_by_verdict,
    has_sure_start,
    level,
    line,
    mark_places,
    signal,
    spread_rows,
    stack,
    to_numbers,
)
from fg_nav.solution import Return, StanceTable
from fg_nav.text import format_count
from fg_nav.truth import TrajectoryTruth

TURNS_UNWRAPPED = 5.0  # A heading that turns more often than this is shown wrapped.
STEEP = float(np.sin(np.deg2rad(60.0)))  # The heading of an axis steeper than this is ill-defined.
EXCERPT_S = 10.0  # Length of the close-up of the stance detection: about ten strides.
HEAVIEST = 0.1  # Marked share of the footfalls, those of most weight.

MAX_RETURNS = 3  # Returns whose field is drawn: the longest ones explain the others.
MAX_DRAWN_M = 120.0  # Of each return, from its begin: waves of some metres are to be visible.
NEVER = 1e-6  # Expected number below which the exact one is meaningless.
COMPONENTS = ("ahead (µT)", "to the left (µT)", "up (µT)")
_FEW = 400  # Most footfalls that are marked on a line.
MAX_SHADED = 2000  # Most stances that are shaded: more are less than a pixel wide, and make a page slow.
MIN_SPAN_UT, MIN_SPAN_DEG = 5.0, 5.0  # Of the axes of strength and inclination: noise is not a disturbance.
COMPASS_AXIS = {"range": [-8, 368], "tickvals": [0, 90, 180, 270, 360]}
SHADE = "rgba(42, 127, 201, 0.16)"  # Background of a stance.
_FROM_ZERO = {"rangemode": "tozero"}

Views = Mapping[str, AlignedSolution]


def _colored(views: Views) -> Iterator[tuple[str, str, AlignedSolution]]:
    for k, (name, view) in enumerate(views.items()):
        yield name, CYCLE[k % len(CYCLE)], view


def _label(name: str, what: str, views: Views) -> str:
    """Name of a line: of several methods the method's alone, by which the legend hides all its traces."""
    return what if len(views) == 1 else name


def _at_stances(t: Floats, value: Floats, color: str, name: str) -> Trace:
    """A line with one point a stance."""
    row = spread_rows(len(t))
    mode = "lines+markers" if len(t) <= _FEW else "lines"
    return line(t[row], value[row], color, name, mode=mode, marker={"size": 3.5})


# --- headings ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Headings:
    """The headings, rad, of a solution of N samples and K stances."""

    at_stances: Floats  # (K,), turns counted
    between: Floats  # (N,), within half a turn of the line through `at_stances`; NaN where the axis is steep
    truth: Floats  # (N,), likewise; NaN where unknown
    error: Floats  # (K,), wrapped, since the first known one where `gauge`; NaN where unknown
    sigma: Floats  # (K,), the estimator's own, without the turn that an alignment removes
    gauge: bool  # whether the heading at the start is sure: given, or zero by definition
    wrapped: bool  # whether it turns too often to be shown with its turns


def trace_headings(view: AlignedSolution) -> Headings:
    """Return the headings of a solution that is aligned with its truth, if there is one."""
    stances, t, nav_R_body = view.solution.stances, view.solution.t, view.solution.nav_R_body
    # heading and steepness of the body's x axis at every sample
    heading, steep = compute_heading(view.align_attitude(nav_R_body)), np.abs(nav_R_body[:, 2, 0]) > STEEP
    at_stances = np.unwrap(compute_heading(view.align_attitude(stances.nav_R_body)))
    middle = np.interp(t, stances.t, at_stances) if len(stances) else heading
    # where the heading at the start is a gauge, claim and error both count from the first stance
    gauge, error = has_sure_start(stances), wrap_angle(at_stances - _read_truth(view, stances.t))
    known = np.flatnonzero(np.isfinite(error))
    if gauge and len(known):
        error = wrap_angle(error - error[known[0]])
    return Headings(
        at_stances,
        np.where(steep, np.nan, middle + wrap_angle(heading - middle)),
        middle + wrap_angle(_read_truth(view, t) - middle),
        error,
        np.sqrt(np.maximum(stances.heading_sigma**2 - view.turn_variance, 0.0)),
        gauge,
        bool(len(stances) and np.ptp(at_stances) > TURNS_UNWRAPPED * 2 * np.pi),
    )


def _read_truth(view: AlignedSolution, t: Floats) -> Floats:
    """Interpolate the true heading (N,) rad at times `t` (N,) s; NaN where unknown."""
    truth = view.truth
    if not isinstance(truth, TrajectoryTruth) or truth.nav_R_body is None:
        return np.full(len(t), np.nan)
    known = np.isfinite(truth.nav_R_body).all(axis=(1, 2))
    if not known.any():
        return np.full(len(t), np.nan)
    heading = np.unwrap(compute_heading(truth.nav_R_body[known]))
    return np.interp(t, truth.t[known], heading, left=np.nan, right=np.nan)


# --- of methods ------------------------------------------------------------------------------------------------------


def draw_height(views: Views) -> Chart:
    """Draw the height of each method with its 95 % band at the footfalls, and that of the truth."""
    traces: list[Trace] = []
    truth = next(iter(views.values())).truth
    if isinstance(truth, TrajectoryTruth):
        row = spread_rows(len(truth.t))
        known = truth.position[row, 2]
        traces.append(line(truth.t[row], known, GRAY, "truth", (3, METERS), width=5, opacity=0.6))
    for name, color, view in _colored(views):
        t, height = view.solution.stances.t, view.stance_position()[:, 2]
        sigma = np.sqrt(view.position_cov()[:, 2, 2])
        traces.append(band(t, height, BAND * sigma, color, _label(name, "95 %", views)))
        dense, pale = view.align_position(view.solution.position)[:, 2], fade(color, 0.55)
        traces.append(signal(view.solution.t, dense, pale, _label(name, "in between", views), width=0.8))
        traces.append(_at_stances(t, height, color, _label(name, "footfalls", views)))
    caption = "In a swing the sensor rises above its footfall; the band is of the footfalls."
    if "pocket" in views:
        caption = "At the strides, with the band that the method claims."
    return stack("height", [Panel("height (m)", traces)], caption)


def draw_sigmas(views: Views, axes: tuple[str, str]) -> Chart:
    """Draw the sigmas of position and heading; of several methods the horizontal one along its largest axis."""
    across, up, heading, alone = [], [], [], len(views) == 1
    for name, color, view in _colored(views):
        cov, t = view.position_cov(), view.solution.stances.t
        if alone:
            sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
            across = [_at_stances(t, sigma[:, k], CYCLE[k], axis) for k, axis in enumerate((*axes, "up"))]
        else:
            known = np.isfinite(cov).all(axis=(1, 2))
            largest = np.full(len(cov), np.nan)
            largest[known] = np.sqrt(np.linalg.eigvalsh(cov[known, :2, :2])[:, -1])
            across.append(_at_stances(t, largest, color, name))
            up.append(_at_stances(t, np.sqrt(cov[:, 2, 2]), color, name))
        sigma_deg = np.rad2deg(view.solution.stances.heading_sigma)
        heading.append(_at_stances(t, sigma_deg, PURPLE if alone else color, "heading" if alone else name))
    position = [Panel("place (m)", across, _FROM_ZERO, share=1.4)]
    if not alone:
        position = [Panel("horizontal (m)", across, _FROM_ZERO), Panel("vertical (m)", up, _FROM_ZERO)]
    panels = [*position, Panel("heading (deg)", heading, _FROM_ZERO)]
    return stack("sigma", panels, "One standard deviation, as the method estimates it.")


def draw_gyro_bias(views: Views) -> Chart:
    """Draw the estimated gyroscope bias by axis, with its 95 % band."""
    panels = []
    for k, axis in enumerate("xyz"):
        traces: list[Trace] = []
        for name, color, view in _colored(views):
            table = view.solution.stances
            bias, sigma = np.rad2deg(table.gyro_bias[:, k]), np.rad2deg(table.gyro_bias_sigma[:, k])
            traces.append(band(table.t, bias, BAND * sigma, color, _label(name, "95 %", views)))
            traces.append(_at_stances(table.t, bias, color, _label(name, "estimate", views)))
        panels.append(Panel(f"{axis} (deg/s)", traces))
    return stack("bias", panels, "Body axes, at the footfalls.")


def draw_errors(views: Views) -> Chart:
    """Draw the errors of methods that were compared with a truth: horizontal, and vertical where that is known."""
    across, up, planar = [], [], False
    for name, color, view in _colored(views):
        found = view.comparison
        assert found is not None
        horizontal, planar = np.linalg.norm(found.error[:, :2], axis=1), planar or found.planar
        if found.planar:
            mark = {"mode": "lines+markers", "marker": {"size": 6}}
            across.append(line(found.t, horizontal, color, name, (3, METERS), **mark))
        else:
            across.append(signal(found.t, horizontal, color, name))
            up.append(signal(found.t, found.error[:, 2], color, name))
    panels = [Panel("horizontal (m)", across, _FROM_ZERO, 1.4)]
    if not planar:
        panels.append(Panel("vertical (m)", up))
    return stack("errors", panels, "Estimate less truth after the alignment.")


def draw_headings(views: Views) -> Chart:
    """Draw the heading of the body's x axis, and below it the claimed band and the error where it is known."""
    above: list[Trace] = []
    below: list[Trace] = []
    traced = {name: trace_headings(view) for name, view in views.items()}
    for name, color, view in _colored(views):
        # above: the truth once, the samples of a single method, and the footfalls
        found, t, at = traced[name], view.solution.t, view.solution.stances.t
        mark: dict[str, Any] = {"mode": "lines+markers" if len(at) <= _FEW else "lines", "marker": {"size": 4}}
        lines: list[tuple[Floats, Floats, str, str, dict[str, Any]]] = []
        if not above:
            lines.append((t, found.truth, GRAY, "truth", {"width": 5, "opacity": 0.6}))
        if len(views) == 1:
            lines.append((t, found.between, fade(color, 0.5), "in between", {"width": 0.7}))
        lines.append((at, found.at_stances, color, _label(name, "footfalls", views), mark))
        for times, angle, shade, label, more in lines:
            row = spread_rows(len(times))
            if np.isfinite(angle[row]).any():
                x, y = times[row], np.rad2deg(angle[row])
                if found.wrapped:  # to [0, 360), with NaN where the line jumps
                    y = y % 360.0
                    jump = np.flatnonzero(np.abs(np.diff(y)) > 180.0) + 1
                    x, y = np.insert(x, jump, x[jump]), np.insert(y, jump, np.nan)
                above.append(line(x, y, shade, label, (3, 2), **more))
        # below: the claimed band, and the error where it is known
        half = BAND * np.rad2deg(found.sigma)
        below.append(band(at, np.zeros(len(at)), half, color, _label(name, "95 %", views)))
        if np.isfinite(found.error).any():
            row = spread_rows(len(at))
            below.append(dots(at[row], np.rad2deg(found.error[row]), color, _label(name, "error", views), (3, 3)))
    known = any(np.isfinite(one.error).any() for one in traced.values())
    gauge = any(one.gauge for one in traced.values())
    label = ("error" if known else "95 %") + (" since start (deg)" if gauge else " (deg)")
    what = "direction of walking" if "person" in views else "sensor's x axis"
    caption = f"Of the {what}, clockwise from north. The band below is the 95 % that the method claims."
    return stack("heading", [Panel("heading (deg)", above, share=1.5), Panel(label, below)], caption)


# --- of the field at the footfalls -----------------------------------------------------------------------------------


def group_field(field: FootfallField, table: StanceTable) -> list[tuple[Bools, str, str]]:
    """Group the footfalls (F,) of a field by the verdict in the table of a solution, as `group_by_verdict`."""
    nearest = np.clip(np.searchsorted(table.t, field.t - 1e-6), 0, max(len(table) - 1, 0))
    words = np.array(table.field, dtype=object)[nearest] if len(table) else np.full(len(field), "", dtype=object)
    return group_by_verdict(words)


def _group_drawn(field: FootfallField, table: StanceTable) -> list[tuple[Bools, str, str]]:
    """Groups of the drawn footfalls, without empty ones."""
    drawn = np.zeros(len(field), dtype=bool)
    drawn[spread_rows(len(field.t), MAX_DOTS)] = True
    groups = group_field(field, table)
    return [(flag & drawn, color, word) for flag, color, word in groups if (flag & drawn).any()]


def draw_compass(field: FootfallField, table: StanceTable) -> Chart:
    """Draw both headings, that of the gyroscope turned to lie on the compass, and their difference."""
    row = spread_rows(len(field.t), MAX_DOTS)
    turned = np.rad2deg(field.gyro_heading + field.mean_heading_difference)[row] % 360.0
    compass = np.rad2deg(field.magnetic_heading)[row] % 360.0
    above = [
        dots(field.t[row], turned, OCHRE, "gyroscope, turned onto the compass", (3, 2), size=5),
        dots(field.t[row], compass, BLUE, "compass", (3, 2), size=4),
    ]
    apart = np.rad2deg(wrap_angle(field.heading_difference - field.mean_heading_difference))
    below = [
        dots(field.t[use], apart[use], color, f"difference, field {word}", (3, 2), size=5)
        for use, color, word in _group_drawn(field, table)
    ]
    panels = [Panel("heading (deg)", above, COMPASS_AXIS, share=1.4), Panel("difference (deg)", below, share=1.2)]
    return stack("compass", panels, "At the footfalls, clockwise from magnetic north. Below, compass less gyroscope.")


def draw_strength(field: FootfallField, table: StanceTable) -> Chart:
    """Draw strength and inclination over the length of the path."""
    travelled = measure_travelled(field.t, table)
    panels = []
    for label, value, min_span in (
        ("strength (µT)", field.strength, MIN_SPAN_UT),
        ("inclination (deg)", np.rad2deg(field.inclination), MIN_SPAN_DEG),
    ):
        hover, traces = "%{y:.2f} at %{x:.1f} m, t %{customdata:.1f} s<extra></extra>", []
        for use, color, word in _group_drawn(field, table):
            more = {"hovertemplate": hover, "customdata": to_numbers(field.t[use], 3)}
            traces.append(dots(travelled[use], value[use], color, word, ALONG_PATH, size=5, **more))
        panels.append(Panel(label, traces, {"range": find_range(value, min_span)}))
    return stack("strength", panels, "At the footfalls, along the path.", "length of the path (m)")


def find_range(value: Floats, min_span: float) -> list[float]:
    """Range of an axis: all values with a margin, and at least the span."""
    known = value[np.isfinite(value)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    half = max(1.1 * (high - low), min_span) / 2
    return [(low + high) / 2 - half, (low + high) / 2 + half]


def measure_travelled(t: Floats, table: StanceTable) -> Floats:
    """Length of the path (F,) m at times `t` (F,) s, by the moves from stance to stance."""
    moves = np.linalg.norm(np.diff(table.position, axis=0), axis=1)
    return np.asarray(np.interp(t, table.t, np.concatenate([[0.0], np.cumsum(moves)])))


# --- of samples and stances ------------------------------------------------------------------------------------------


def find_log_limits(statistic: Floats) -> tuple[float, float]:
    """Range of a logarithmic axis that shows the statistic and its threshold, 1."""
    positive = statistic[np.isfinite(statistic) & (statistic > 0)]
    if not len(positive):
        return 0.1, 10.0
    low, high = np.percentile(positive, [0.5, 100.0])
    return min(float(low) / 2, 0.5), max(float(high) * 2, 2.0)


def draw_samples(recording: Recording, stances: Stances) -> list[Chart]:
    """Draw the whole walk, and the close-up in which single samples show."""
    # close-up around the middle stance, where the walk is in full swing
    t, few = recording.t, len(stances) <= MAX_SHADED
    centre = t[stances.start[len(stances) // 2]] if len(stances) else t[len(t) // 2]
    begin = min(max(centre - EXCERPT_S / 2, t[0]), max(t[-1] - EXCERPT_S, t[0]))
    part = slice(int(np.searchsorted(t, begin)), int(np.searchsorted(t, begin + EXCERPT_S, side="right")))
    words = "The whole walk."
    if len(stances):
        words = "Shaded where the foot was taken to stand" + ("." if few else ", in the close-up only.")
    close = f"Close-up of {t[part.start]:.1f} to {t[part.stop - 1]:.1f} s, every sample."
    return [
        _draw_samples("stances", recording, stances, slice(0, len(recording)), few, words),
        _draw_samples("close-up", recording, stances, part, True, close),
    ]


def _draw_samples(name: str, recording: Recording, stances: Stances, part: slice, shaded: bool, caption: str) -> Chart:
    t = recording.t[part]
    panels = [
        Panel("|acc| (m/s²)", [signal(t, np.linalg.norm(recording.acc[part], axis=1), BLUE, "|acc|", width=1)]),
        Panel("|gyr| (rad/s)", [signal(t, np.linalg.norm(recording.gyr[part], axis=1), PURPLE, "|gyr|", width=1)]),
    ]
    if stances.statistic is not None:
        low, high = find_log_limits(stances.statistic)
        with np.errstate(divide="ignore", invalid="ignore"):
            value = np.where(stances.statistic[part] > 0, stances.statistic[part], np.nan)
        traces = [signal(t, value, GREEN, "statistic", width=1), level(t, 1.0, VERMILION, "threshold")]
        limits = [float(np.log10(low)), float(np.log10(high))]
        axis = {"type": "log", "range": limits, "exponentformat": "power"}
        panels.append(Panel("statistic / threshold", traces, axis))
    if shaded and len(stances):
        panels = [_shade(panel, recording.t, stances, part) for panel in panels]
    return stack(name, panels, caption)


def _shade(panel: Panel, t: Floats, stances: Stances, part: slice) -> Panel:
    """Fix the range of a panel to its signals, and draw a box over all of it for each stance."""
    axis: dict[str, Any] = dict(panel.axis)
    if "range" in axis:
        low, high = (10.0**end for end in axis["range"])
    else:
        values = [value for trace in panel.traces for value in trace["y"] if value is not None]
        low, high = 0.0, 1.05 * max(values, default=1.0)
        axis = {"range": [low, high]}
    use = (stances.stop > part.start) & (stances.start < part.stop)
    start, stop = t[stances.start[use]], t[stances.stop[use] - 1]
    x = np.stack([start, start, stop, stop, start, np.full(len(start), np.nan)], axis=1).ravel()
    y: list[float | None] = [low, high, high, low, low, None] * len(start)
    more: dict[str, Any] = {"fill": "toself", "fillcolor": SHADE, "hoverinfo": "skip"}
    boxes = line(x, x, SHADE, "stance", width=0, **more) | {"y": y}
    return Panel(panel.label, [boxes, *panel.traces], axis, panel.share)


def draw_graph(view: AlignedSolution, frame: Frame) -> list[Chart]:
    """Draw the graph of one solution, as far as it is known."""
    solution, table = view.solution, view.solution.stances
    charts = []
    if table.compass_weight is not None and bool((table.compass_weight > 0.0).any()):
        charts += [_draw_weights(table, table.compass_weight), _draw_heaviest(view, frame, table.compass_weight)]
    if solution.graph:
        # bias about up, by which the heading drifts
        up = table.nav_R_body[:, 2]
        bias = np.rad2deg((table.gyro_bias * up).sum(axis=1))
        sigma = np.rad2deg(np.sqrt(((table.gyro_bias_sigma * up) ** 2).sum(axis=1)))
        estimate = _at_stances(table.t, bias, BLUE, "estimate") | {"mode": "lines+markers"}
        traces = [band(table.t, bias, BAND * sigma, BLUE, "95 %"), estimate]
        caption = "Gyroscope bias about up, which turns the heading; its band without correlations of the axes."
        charts.append(stack("bias-up", [Panel("bias about up (deg/s)", traces)], caption))
    if solution.moment is not None:
        batch = solution.stances if solution.polished is None else solution.polished.stances
        charts.append(_draw_moment(solution.moment, batch))
    return charts


def _draw_weights(table: StanceTable, weight: Floats) -> Chart:
    """Statistic, weight of the compass and sigma of the differential field along the path."""
    travelled = measure_travelled(table.t, table)
    panels, statistic = [], table.field_statistic
    if statistic is not None and np.isfinite(statistic).any():
        passed, disturbed, _ = group_by_verdict(np.array(table.field, dtype=object))
        traces = [
            _along_path(dots, travelled[use], statistic[use], color, f"statistic, {word}")
            for (use, color, _), word in ((passed, "passed"), (disturbed, "disturbed"))
            if use.any()
        ]
        limit = level(travelled, 1.0, GRAY, "threshold")
        panels.append(Panel("statistic / threshold", [*traces, limit], {"type": "log", "exponentformat": "power"}))
    weights = _along_path(dots, travelled, weight, BLUE, "compass weight")
    panels.append(Panel("compass weight", [weights], {"range": [-0.05, 1.05]}))
    if table.differential_sigma is not None and np.isfinite(table.differential_sigma).any():
        sigma = np.rad2deg(table.differential_sigma)
        trace = _along_path(line, travelled, sigma, PURPLE, "sigma by differential field")
        panels.append(Panel("bias about up (deg/s)", [trace], _FROM_ZERO))
    caption = (
        "Above, the detector's statistic over its threshold. The weight is the information of the footfall's compass "
        "over that at the walk's own spread of the field. Below, the sigma of the gyroscope's bias by the differential "
        "field alone."
    )
    return stack("weights", panels, caption, "length of the path (m)")


def _along_path(draw: Callable[..., Trace], travelled: Floats, value: Floats, color: str, name: str) -> Trace:
    row = spread_rows(len(travelled), MAX_DOTS)
    return draw(travelled[row], value[row], color, name, ALONG_PATH)


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
        mark: dict[str, Any] = {"style": {"symbol": symbol, "line": {"width": 1.5}}, "size": size}
        hover = f"footfall %{{customdata}}, {words}<extra></extra>"
        data.append(mark_places(place[row], color, words, customdata=row.tolist(), hovertemplate=hover, **mark))
    caption = f"The tenth of the footfalls that weighs most, of {format_count(len(table), 'footfall')}."
    return compose_map(data, [view], frame, "heaviest", caption)


def _find_most(weight: Floats, then: Floats) -> Ints:
    """Rows of the largest positive weights, in their order; of equal ones those with the largest `then`."""
    count = min(max(round(HEAVIEST * len(weight)), 1), MAX_DOTS)
    heaviest = np.lexsort((-then, -weight))[:count]
    return np.sort(heaviest[weight[heaviest] > 0.0])


def _draw_moment(moment: StanceTable, batch: StanceTable) -> Chart:
    """Estimate of iSAM2 at the moment of each footfall less that of the batch."""
    nearest = np.clip(np.searchsorted(batch.t, moment.t - 1e-6), 0, len(batch) - 1)
    moved = moment.position - batch.position[nearest]
    turned = wrap_angle(compute_heading(moment.nav_R_body) - compute_heading(batch.nav_R_body[nearest]))
    sigma_m = np.sqrt(np.trace(moment.position_cov[:, :2, :2], axis1=1, axis2=2))
    row, words = spread_rows(len(moment.t)), "95 % at the moment"

    def difference(value: Floats) -> Trace:
        return line(moment.t[row], value[row], BLUE, "moment less batch")

    limit = line(moment.t[row], BAND * sigma_m[row], OCHRE, words)
    claimed = band(moment.t, np.zeros(len(moment)), BAND * np.rad2deg(moment.heading_sigma), OCHRE, words)
    apart = [limit, difference(np.linalg.norm(moved[:, :2], axis=1))]
    heading = [claimed, difference(np.rad2deg(turned))]
    panels = [Panel("horizontal (m)", apart, _FROM_ZERO), Panel("heading (deg)", heading)]
    caption = "Estimate of iSAM2 at the moment of each footfall, less that of the batch afterwards."
    return stack("moment", panels, caption)


def describe_return(one: Return) -> str:
    """A return in words: when, where, and by how much it is more likely than chance."""
    way = "in the opposite direction" if one.opposite else "in the same direction"
    chance = f"{one.expected_false:.1g}" if one.expected_false > NEVER else f"fewer than {NEVER:g}"
    return (
        f"{one.length_m:.0f} m from {one.t[0]:.0f} to {one.t[-1]:.0f} s are those of {one.earlier_t.min():.0f} to "
        f"{one.earlier_t.max():.0f} s, walked {way}: by {one.score:.0f} nats, where chance makes {chance} such "
        "recognitions in the walk."
    )


def draw_returns(returns: Sequence[Return]) -> list[Chart]:
    """Draw the field of both passes of each return along the path, as the later one was walked."""
    charts = []
    for k, one in enumerate(returns, start=1):
        walked = np.linspace(0.0, one.length_m, len(one.t))
        row = np.flatnonzero(walked <= MAX_DRAWN_M)
        passes = (("then", GRAY, one.earlier_field_uT), ("now", PURPLE, one.field_uT))
        panels = []
        for k_axis, label in enumerate(COMPONENTS):
            lines = [line(walked[row], field[row, k_axis], color, word, ALONG_PATH) for word, color, field in passes]
            panels.append(Panel(label, lines))
        caption, label = describe_return(one), "length of the path since the return began (m)"
        charts.append(stack(f"return-{k}", panels, caption, label))
    return charts
