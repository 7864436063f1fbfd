"""What changes along a walk, over time: height, sigmas, gyroscope bias, heading and its error, position error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.report.aligned import AlignedSolution
from fg_nav.report.decimation import spread_rows
from fg_nav.report.headings import Headings, break_line, trace_headings
from fg_nav.report.page.figures import (
    CYCLE,
    GRAY,
    MAX_POINTS,
    PURPLE,
    Chart,
    Panel,
    Trace,
    band,
    dots,
    fade,
    line,
    signal,
    stack,
    thin,
    to_meters,
    to_numbers,
    to_seconds,
)
from fg_nav.truth import TrajectoryTruth

BAND = 1.96  # Half width of a 95 % band, in standard deviations.
_FEW = 400  # Up to so many footfalls are marked on a line.

Views = Mapping[str, AlignedSolution]


def _colored(views: Views) -> Iterator[tuple[str, str, AlignedSolution]]:
    for k, (name, view) in enumerate(views.items()):
        yield name, CYCLE[k % len(CYCLE)], view


def _label(name: str, what: str, views: Views) -> str:
    """Name of a line: of several methods the method's alone, by which the legend hides all that it drew."""
    return what if len(views) == 1 else name


def _at_stances(t: Floats, value: Floats, color: str, name: str, **more: object) -> Trace:
    """A line with one point a stance."""
    row = thin(t)
    mode = "lines+markers" if len(t) <= _FEW else "lines"
    return line(to_seconds(t[row]), to_numbers(value[row]), color, name, mode=mode, marker={"size": 3.5}, **more)


def draw_height(views: Views) -> Chart:
    """Draw the height of each method with its 95 % band at the footfalls, and that of the truth."""
    traces: list[Trace] = []
    truth = next(iter(views.values())).truth
    if isinstance(truth, TrajectoryTruth):
        row = spread_rows(len(truth.t), MAX_POINTS)
        known = to_meters(truth.position[row, 2])
        traces.append(line(to_seconds(truth.t[row]), known, GRAY, "truth", width=5, opacity=0.6))
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
    """Draw the sigmas of place and heading; of several methods the horizontal one along its largest axis."""
    position = _compare_sigmas(views) if len(views) > 1 else [_split_sigmas(next(iter(views.values())), axes)]
    heading = [
        _at_stances(
            view.solution.stances.t, np.rad2deg(view.solution.stances.heading_sigma),
            PURPLE if len(views) == 1 else color, "heading" if len(views) == 1 else name,
        )
        for name, color, view in _colored(views)
    ]  # fmt: skip
    panels = [*position, Panel("heading (deg)", heading, _FROM_ZERO)]
    return stack("sigma", panels, "One standard deviation, as the method estimates it.")


_FROM_ZERO = {"rangemode": "tozero"}


def _split_sigmas(view: AlignedSolution, axes: tuple[str, str]) -> Panel:
    sigma = np.sqrt(np.diagonal(view.position_cov(), axis1=1, axis2=2))
    names = zip((*axes, "up"), CYCLE, strict=False)
    traces = [_at_stances(view.solution.stances.t, sigma[:, k], color, axis) for k, (axis, color) in enumerate(names)]
    return Panel("place (m)", traces, _FROM_ZERO, share=1.4)


def _compare_sigmas(views: Views) -> list[Panel]:
    across, up = [], []
    for name, color, view in _colored(views):
        cov, t = view.position_cov(), view.solution.stances.t
        known = np.isfinite(cov).all(axis=(1, 2))
        largest = np.full(len(cov), np.nan)
        largest[known] = np.sqrt(np.linalg.eigvalsh(cov[known, :2, :2])[:, -1])
        across.append(_at_stances(t, largest, color, name))
        up.append(_at_stances(t, np.sqrt(cov[:, 2, 2]), color, name))
    return [Panel("horizontal (m)", across, _FROM_ZERO), Panel("vertical (m)", up, _FROM_ZERO)]


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
    panels = [Panel("horizontal (m)", [_draw_error(*one, vertical=False) for one in _colored(views)], _FROM_ZERO, 1.4)]
    if not any(view.comparison is not None and view.comparison.planar for view in views.values()):
        panels.append(Panel("vertical (m)", [_draw_error(*one, vertical=True) for one in _colored(views)]))
    return stack("errors", panels, "Estimate less truth after the alignment.")


def _draw_error(name: str, color: str, view: AlignedSolution, vertical: bool) -> Trace:
    found = view.comparison
    assert found is not None
    error = found.error[:, 2] if vertical else np.linalg.norm(found.error[:, :2], axis=1)
    if found.planar:
        return line(to_seconds(found.t), to_meters(error), color, name, mode="lines+markers", marker={"size": 6})
    return signal(found.t, error, color, name)


def draw_headings(views: Views) -> Chart:
    """Draw the heading of the body's x axis, and below it the claimed band and the error where it is known."""
    traced = {name: trace_headings(view) for name, view in views.items()}
    above: list[Trace] = []
    below: list[Trace] = []
    for name, color, view in _colored(views):
        if not above:
            above += _draw_angle(view.solution.t, traced[name].truth, traced[name], GRAY, "truth", width=5, opacity=0.6)
        above += _draw_heading(view, traced[name], color, name, views)
        below += _draw_heading_error(view, traced[name], color, name, views)
    panels = [Panel("heading (deg)", above, share=1.5), Panel(_error_label(list(traced.values())), below)]
    caption = "Of the sensor's x axis, clockwise from north. The band below is the 95 % that the method claims."
    return stack("heading", panels, caption)


def _error_label(traced: Sequence[Headings]) -> str:
    known = any(np.isfinite(one.error).any() for one in traced)
    gauge = any(one.gauge for one in traced)
    return ("error" if known else "95 %") + (" since start (deg)" if gauge else " (deg)")


def _draw_heading(view: AlignedSolution, found: Headings, color: str, name: str, views: Views) -> list[Trace]:
    alone = len(views) == 1
    t, at = view.solution.t, view.solution.stances.t
    between = (
        _draw_angle(t, found.between, found, fade(color, 0.5), _label(name, "in between", views), width=0.7)
        if alone
        else []
    )
    mode = "lines+markers" if len(at) <= _FEW else "lines"
    more = {"mode": mode, "marker": {"size": 4}}
    return between + _draw_angle(at, found.at_stances, found, color, _label(name, "footfalls", views), **more)


def _draw_angle(t: Floats, angle: Floats, found: Headings, color: str, name: str, **more: object) -> list[Trace]:
    row = thin(t)
    if not np.isfinite(angle[row]).any():
        return []
    t, angle = break_line(t[row], np.rad2deg(angle[row]), found.wrapped)
    return [line(to_seconds(t), to_numbers(angle, 2), color, name, **more)]


def _draw_heading_error(view: AlignedSolution, found: Headings, color: str, name: str, views: Views) -> list[Trace]:
    t = view.solution.stances.t
    claimed = band(t, np.zeros(len(t)), BAND * np.rad2deg(found.sigma), color, _label(name, "95 %", views))
    if not np.isfinite(found.error).any():
        return [claimed]
    row = thin(t)
    error = to_numbers(np.rad2deg(found.error[row]), 3)
    return [claimed, dots(to_seconds(t[row]), error, color, _label(name, "error", views))]
