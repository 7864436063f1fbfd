"""What changes along a walk, over time: position error, heading, gyroscope bias, and the stance statistic."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator, NullLocator

from fg_nav.arrays import Floats
from fg_nav.report.aligned import AlignedSolution
from fg_nav.report.decimation import envelope, spread_rows
from fg_nav.report.excerpt import choose_excerpt, find_log_limits
from fg_nav.report.headings import Headings, break_line, trace_headings
from fg_nav.report.plots import style
from fg_nav.report.plots.style import MAX_POINTS
from fg_nav.stances import Stances

_PALE: dict[str, Any] = {"alpha": 0.4, "linewidth": 0.7}

_COMPASS_DEG = (5, 10, 15, 30, 45, 90, 180, 360)  # Steps of an axis of angles.

_MAX_DOTS = 400


def plot_errors(views: Mapping[str, AlignedSolution]) -> Figure:
    """Draw the horizontal error of several methods over time. Every view must have a comparison."""
    with style.styled():
        figure = style.new_figure(3.4)
        axes = figure.subplots()
        for colour, (name, view) in zip(style.colours(len(views)), views.items(), strict=True):
            _draw_error(axes, view, colour, name)
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.01)
        axes.set(xlabel="time (s)", ylabel="horizontal error (m)")
        style.head(axes, f"Position error{next(iter(views.values())).alignment_words}")
    return figure


def plot_heading(view: AlignedSolution) -> Figure:
    """Draw the heading of the body's x axis; below it the claimed 95 % band, and the error if known."""
    headings = trace_headings(view)
    with style.styled():
        figure = style.new_figure(5.0)
        whole, close = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
        _draw_headings(whole, view, headings)
        whole.set_ylabel("heading (deg,\nclockwise from north)")
        whole.margins(x=0.01)
        style.head(whole, f"Heading{view.alignment_words}")
        _draw_heading_error(close, view.solution.stances.t, headings)
        close.set_xlabel("time (s)")
    return figure


def plot_gyro_bias(view: AlignedSolution) -> Figure:
    """Draw the estimated gyroscope bias per axis, with one and two sigma bands."""
    stances = view.solution.stances
    bias, sigma = np.rad2deg(stances.gyro_bias), np.rad2deg(stances.gyro_bias_sigma)
    with style.styled():
        figure = style.new_figure(5.2)
        panels = figure.subplots(3, 1, sharex=True, sharey=True)
        for i, (axes, name) in enumerate(zip(panels, "xyz", strict=True)):
            for width, alpha in ((2, 0.14), (1, 0.22)):
                band = (bias[:, i] - width * sigma[:, i], bias[:, i] + width * sigma[:, i])
                axes.fill_between(stances.t, *band, color=style.CYCLE[i], alpha=alpha, linewidth=0)
            axes.axhline(0.0, color=style.SOFT_INK, linewidth=0.6)
            axes.plot(stances.t, bias[:, i], color=style.CYCLE[i])
            axes.set_ylabel(f"{name} (deg/s)")
            axes.margins(x=0.01)
        style.head(panels[0], "Gyroscope bias, body axes, with 1 and 2 sigma")
        panels[-1].set_xlabel("time (s)")
    return figure


def _draw_error(axes: Axes, view: AlignedSolution, colour: str, name: str) -> None:
    if view.comparison is None:
        raise ValueError(f"'{name}' was not compared with a truth: it has no error to draw")
    error = np.linalg.norm(view.comparison.error[:, :2], axis=1)
    rms = f"{name}, rms {np.sqrt(np.mean(error**2)):.3f} m"
    if view.comparison.planar:
        axes.plot(view.comparison.t, error, "o-", color=colour, markersize=3.5, linewidth=0.9, label=rms)
    else:
        axes.plot(*envelope(view.comparison.t, error), color=colour, linewidth=0.9, label=rms)


def _draw_headings(axes: Axes, view: AlignedSolution, headings: Headings) -> None:
    stances, t, wrapped = view.solution.stances, view.solution.t, headings.wrapped
    dots = {"marker": ".", "markersize": 4.5} if len(stances) <= _MAX_DOTS else {}
    line = {"color": style.BLUE, "linewidth": 1.1, "label": f"{view.solution.method}, at the stances"}
    _draw_angle(axes, t, headings.truth, wrapped, {**style.TRUTH_LINE, "label": "truth"})
    _draw_angle(axes, t, headings.between, wrapped, {**line, **_PALE, "label": "in between"})
    _draw_angle(axes, stances.t, headings.at_stances, wrapped, {**line, **dots})
    span_deg = float(np.ptp(axes.get_ylim()))
    axes.yaxis.set_major_locator(MultipleLocator(next((s for s in _COMPASS_DEG if span_deg / s <= 9), 360)))


def _draw_angle(axes: Axes, t: Floats, angle: Floats, wrapped: bool, kind: dict[str, Any]) -> None:
    row = spread_rows(len(t), MAX_POINTS)
    if np.isfinite(angle[row]).any():
        axes.plot(*break_line(t[row], np.rad2deg(angle[row]), wrapped), **kind)


def _draw_heading_error(axes: Axes, t: Floats, headings: Headings) -> None:
    half_deg = 1.96 * np.rad2deg(headings.sigma)
    band: dict[str, Any] = {"color": style.BLUE, "alpha": 0.2, "linewidth": 0, "label": "95 % claimed"}
    axes.fill_between(t, -half_deg, half_deg, **band)
    axes.axhline(0.0, color=style.SOFT_INK, linewidth=0.6)
    known = bool(np.isfinite(headings.error).any())
    if known:
        line: dict[str, Any] = {"color": style.BLUE, "markersize": 3, "linewidth": 0.8, "label": "error"}
        axes.plot(t, np.rad2deg(headings.error), ".-", **line)
    axes.set_ylim(*np.clip(axes.get_ylim(), -180.0, 180.0))
    axes.set_ylabel("since the start (deg)" if headings.gauge else "heading (deg)")
    style.head(axes, "Uncertainty and error at the stances" if known else "Uncertainty at the stances")


MAX_STANCES_AS_LINE = 150  # With more stances than this the line of the statistic would fill the picture.


def plot_stance_statistic(t: Floats, stances: Stances) -> Figure:
    """Draw the detector's statistic over its threshold: the whole walk above, ten seconds of it below.

    `t` (N,) s. The stances must have a statistic.
    """
    if stances.statistic is None:
        raise ValueError("these stances have no statistic to draw")
    excerpt = choose_excerpt(t, stances)
    with style.styled():
        figure = style.new_figure(5.0)
        whole, close = figure.subplots(2, 1, sharey=True)
        _draw_overview(whole, t, stances, stances.statistic)
        whole.axvspan(t[excerpt.start], t[excerpt.stop - 1], color=style.ORANGE, alpha=0.3, linewidth=0)
        middle = (t[excerpt.start] + t[excerpt.stop - 1]) / 2
        pointer = {"transform": whole.get_xaxis_transform(), "clip_on": False}
        whole.plot(middle, 1.0, "v", color=style.ORANGE, markersize=7, **pointer)
        style.head(whole, f"Stance detection ({stances.detector}): {stances.n_footfalls} footfalls")
        whole.set_ylim(*find_log_limits(stances.statistic))
        _shade_stances(close, t, stances, excerpt)
        _draw_statistic(close, t[excerpt], stances.statistic[excerpt], linewidth=1.0)
        close.set_xlim(t[excerpt.start], t[excerpt.stop - 1])
        close.set_xlabel("time (s)")
        style.head(close, "Close-up of the marked stretch")
    return figure


def _shade_stances(axes: Axes, t: Floats, stances: Stances, part: slice) -> None:
    label = "stance"
    for start, stop in zip(stances.start, stances.stop, strict=True):
        if stop > part.start and start < part.stop:
            axes.axvspan(t[start], t[stop - 1], color=style.SHADE, linewidth=0, label=label)
            label = "_another"


def _draw_overview(axes: Axes, t: Floats, stances: Stances, statistic: Floats) -> None:
    """Draw the whole statistic; of a long walk, whose line is a block, a dot for each stance and swing."""
    if len(stances) <= MAX_STANCES_AS_LINE:
        _draw_statistic(axes, *envelope(t, statistic), linewidth=0.5)
        return
    ends = np.stack([stances.start, stances.stop], axis=1).ravel()[:-1]  # stance, swing, stance, ...
    low, high = np.fmin.reduceat(statistic, ends)[0::2], np.fmax.reduceat(statistic, ends)[1::2]
    axes.plot(t[ends[1::2]], high, ".", color=style.SKY, markersize=2.5, label="largest of each swing")
    axes.plot(t[ends[0::2]], low, ".", color=style.BLUE, markersize=2.5, label="smallest of each stance")
    _draw_statistic(axes, t[:0], statistic[:0], linewidth=0.5)


def _draw_statistic(axes: Axes, t: Floats, statistic: Floats, linewidth: float) -> None:
    axes.plot(t, statistic, color=style.BLUE, linewidth=linewidth)
    axes.axhline(1.0, color=style.VERMILION, linewidth=1.1, label="threshold")
    axes.set_yscale("log")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.margins(x=0.01)
    axes.set_ylabel("statistic / threshold")
