"""Pictures of a walk: from above, and over time.

==================== ========================================================
run                  trajectory, heading, gyro_bias, stance_statistic
two feet             trajectory
comparison           trajectories, errors (with a truth), stance_statistic;
                     per method trajectory, heading, gyro_bias
simulation           map: the true path in its field
==================== ========================================================

They are in the truth's frame where there is a truth (the title names the alignment), else in the solution's own. Bands
and ellipses are the estimator's own uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator, NullLocator

from fg_nav.arrays import Floats
from fg_nav.report.drawn import (
    REACH,
    AlignedSolution,
    Headings,
    align_solution,
    break_line,
    choose_excerpt,
    envelope,
    find_ellipses,
    find_extent,
    find_log_limits,
    spread_rows,
    trace_headings,
)
from fg_nav.report.plots import style
from fg_nav.report.plots.style import MAX_POINTS
from fg_nav.stances import Stances
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth

if TYPE_CHECKING:
    from fg_nav.lab.simulation import SimulatedWalk
    from fg_nav.walk import Outcome, Walk

MAX_ELLIPSES = 80
MAX_DOTS = 400  # Stances that are marked one by one.
MAX_PIECES = 20_000  # Of a line in the colours of the field.
WIDEST_SCALE = (2.0, 98.0)  # Percentiles of the strength at the ends of the colours: a magnet would flatten all else.
MAX_STANCES_AS_LINE = 150  # With more stances the line of the statistic would fill the picture.

_PALE: dict[str, Any] = {"alpha": 0.4, "linewidth": 0.7}
_COMPASS_DEG = (5, 10, 15, 30, 45, 90, 180, 360)  # Steps of an axis of angles.


def draw_result(folder: Path, walk: Walk, outcome: Outcome) -> None:
    """Draw one method."""
    view = align_solution(walk, outcome)
    style.save(plot_trajectory(view), folder / "trajectory.png")
    style.save(plot_heading(view), folder / "heading.png")
    style.save(plot_gyro_bias(view), folder / "gyro_bias.png")


def draw_stances(folder: Path, walk: Walk) -> None:
    """Draw the detection that all methods share, where the detector left a statistic."""
    if walk.stances.statistic is not None:
        style.save(plot_stance_statistic(walk.recording.t, walk.stances), folder / "stance_statistic.png")


def draw_comparison(folder: Path, walk: Walk, outcomes: Mapping[str, Outcome]) -> None:
    """Draw the methods over each other, and each into its own folder."""
    views = {name: align_solution(walk, outcome) for name, outcome in outcomes.items()}
    first = next(iter(views.values()))
    with style.styled():
        figure, axes = _new_map(np.vstack([_choose_path(view) for view in views.values()]))
        _draw_truth(axes, first.truth)
        for colour, (name, view) in zip(style.colours(len(views)), views.items(), strict=True):
            _draw_path(axes, view, colour, name)
        draw_ends(axes, first.stance_position())
        style.head(axes, f"Trajectories{first.alignment_words}")
    style.save(figure, folder / "trajectories.png")
    if all(view.comparison is not None for view in views.values()):
        style.save(plot_errors(views), folder / "errors.png")
    for name, outcome in outcomes.items():
        draw_result(folder / name, walk, outcome)


# --- from above ------------------------------------------------------------------------------------------------------


def plot_trajectory(view: AlignedSolution) -> Figure:
    """Draw the walk from above: path, stances with 95 % ellipses, truth."""
    with style.styled():
        figure, axes = _new_map(_choose_path(view))
        _draw_trajectory(axes, view)
    return figure


def plot_trajectory_on_screen(view: AlignedSolution, axes: Axes | None = None) -> Axes:
    """Draw the same into these axes, or into a new figure of pyplot, which windows and notebooks show."""
    from matplotlib import pyplot

    with style.styled():
        path = _choose_path(view)
        if axes is None:
            size = style.WIDTH_IN, _find_height(path)
            axes = pyplot.figure(figsize=size, layout="constrained").subplots()
        _shape_map(axes, path)
        _draw_trajectory(axes, view)
    return axes


def _draw_trajectory(axes: Axes, view: AlignedSolution) -> None:
    """Draw path, stances with 95 % ellipses and truth into a map."""
    stance, found = view.stance_position(), find_ellipses(view, MAX_ELLIPSES)
    _draw_truth(axes, view.truth)
    _draw_path(axes, view, style.BLUE, view.solution.method)
    if found is not None:
        size = 2 * found.zoom * found.semi
        ellipses = EllipseCollection(
            size[:, 1], size[:, 0], np.rad2deg(found.angle), units="xy", offsets=found.centre,
            offset_transform=axes.transData, facecolor=style.BLUE, edgecolor=style.BLUE, alpha=0.16,
            linewidth=0.6, zorder=2,
        )  # fmt: skip
        axes.add_collection(ellipses)
        reach = np.minimum(size[:, 1:] / 2, REACH * find_extent(stance))
        axes.update_datalim(np.vstack([found.centre - reach, found.centre + reach]))
        words = "95 % ellipses" + (f", drawn {found.zoom} times as large" if found.zoom > 1 else "")
        axes.plot([], [], "o", color=style.BLUE, alpha=0.25, markersize=8, label=words)
    if len(stance) <= MAX_DOTS:
        axes.plot(*stance[:, :2].T, ".", color=style.BLUE, markersize=3.2, zorder=4)
    draw_ends(axes, stance)
    style.head(axes, f"Trajectory{view.alignment_words}")


def _new_map(points: Floats) -> tuple[Figure, Axes]:
    """Figure shaped like the points (N, 2) m, with equal scales east and north."""
    figure = style.new_figure(_find_height(points))
    axes = figure.subplots()
    _shape_map(axes, points)
    return figure, axes


def _find_height(points: Floats) -> float:
    """Height in inches of a picture of the points (N, 2) m."""
    width, height = np.ptp(points, axis=0) + 1e-9
    return float(np.clip(style.WIDTH_IN * height / width, 3.5, 8.0)) + 0.7


def _shape_map(axes: Axes, points: Floats) -> None:
    """Give a map of the points (N, 2) m equal scales east and north, and four to ten ticks."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    wanted = max(*np.ptp(points, axis=0).tolist(), 0.1) / 8
    power = 10.0 ** np.floor(np.log10(wanted))
    step_m = float(power * min(s for s in (1, 2, 5, 10) if power * s >= wanted))
    axes.xaxis.set_major_locator(MultipleLocator(step_m))
    axes.yaxis.set_major_locator(MultipleLocator(step_m))
    axes.set(xlabel="east (m)", ylabel="north (m)")


def _draw_truth(axes: Axes, truth: Truth | None) -> None:
    if isinstance(truth, TrajectoryTruth):
        path = truth.position[spread_rows(len(truth.position), MAX_POINTS)]
        axes.plot(path[:, 0], path[:, 1], **style.TRUTH_LINE, label="truth", zorder=1)
    elif isinstance(truth, FootprintTruth):
        mark: dict[str, Any] = {"color": style.TRUTH, "markersize": 5, "markerfacecolor": "none"}
        axes.plot(*truth.xy.T, "s", **mark, label="surveyed footprints")
        axes.set(xlabel="x (m)", ylabel="y (m)")  # of unknown azimuth


def _draw_path(axes: Axes, view: AlignedSolution, colour: str, label: str) -> None:
    path = _choose_path(view)
    laps = np.linalg.norm(np.diff(path, axis=0), axis=1).sum() / max(float(np.max(np.ptp(path, axis=0))), 0.1)
    width = float(np.clip(1.1 * np.sqrt(20.0 / max(laps, 1.0)), 0.35, 1.1))  # thin where lines lie close
    axes.plot(path[:, 0], path[:, 1], color=colour, linewidth=width, label=label, zorder=3)


def _choose_path(view: AlignedSolution) -> Floats:
    """Points (M, 2) m of the walk, enough for a line."""
    return view.align_position(view.solution.position[spread_rows(len(view.solution.position), MAX_POINTS)])[:, :2]


def draw_ends(axes: Axes, stance: Floats) -> None:
    """Mark where a walk (N, 3) begins and ends."""
    apart = np.linalg.norm(stance[-1, :2] - stance[0, :2]) > 0.05 * np.max(np.ptp(stance[:, :2], axis=0))
    marks: list[tuple[str, Floats, dict[str, Any]]] = [("start" if apart else "start, end", stance[0], {"marker": "o"})]
    if apart:
        marks.append(("end", stance[-1], {"marker": "s"}))
    for words, point, kind in marks:
        axes.plot(*point[:2], **kind, color=style.INK, markersize=6, markerfacecolor="white", zorder=6)
        halo = [withStroke(linewidth=2.5, foreground="white")]
        text: dict[str, Any] = {"color": style.INK, "fontsize": 8.5, "zorder": 6, "path_effects": halo}
        axes.annotate(words, (point[0], point[1]), (7, 5), textcoords="offset points", **text)


def plot_simulated_walk(walk: SimulatedWalk) -> Figure:
    """Draw the true path, the field on it, and the landmarks."""
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    path = truth.position[spread_rows(len(truth.position), MAX_PIECES)]
    strength = np.linalg.norm(walk.field.at(path + walk.origin), axis=1)
    with style.styled():
        figure, axes = _new_map(path[:, :2])
        low, high = np.percentile(strength, WIDEST_SCALE)
        pieces = np.stack([path[:-1, :2], path[1:, :2]], axis=1)
        lines = LineCollection(
            list(pieces), array=(strength[1:] + strength[:-1]) / 2, cmap="viridis", linewidth=1.6,
            capstyle="round", clim=(low - 0.5, high + 0.5), zorder=3,
        )  # fmt: skip
        axes.add_collection(lines)
        axes.update_datalim(path[:, :2])
        axes.autoscale_view()
        figure.colorbar(lines, ax=axes, label="field at the sensor (uT)", shrink=0.75, pad=0.02)
        places = {mark.landmark: mark.position for mark in walk.landmarks}
        if places:
            east, north, _ = np.array(list(places.values())).T
            mark: dict[str, Any] = {"color": style.INK, "markerfacecolor": "white", "markersize": 5}
            axes.plot(east, north, "D", **mark, zorder=5, label="landmark")
        draw_ends(axes, path)
        style.head(axes, f"{walk.scenario.name}, seed {walk.seed}: {walk.scenario.field} field")
    return figure


# --- over time -------------------------------------------------------------------------------------------------------


def plot_errors(views: Mapping[str, AlignedSolution]) -> Figure:
    """Draw the horizontal error of several methods over time. Every view must have a comparison."""
    with style.styled():
        figure = style.new_figure(3.4)
        axes = figure.subplots()
        for colour, (name, view) in zip(style.colours(len(views)), views.items(), strict=True):
            found = view.comparison
            if found is None:
                raise ValueError(f"'{name}' was not compared with a truth: it has no error to draw")
            error = np.linalg.norm(found.error[:, :2], axis=1)
            rms = f"{name}, rms {np.sqrt(np.mean(error**2)):.3f} m"
            if found.planar:
                axes.plot(found.t, error, "o-", color=colour, markersize=3.5, linewidth=0.9, label=rms)
            else:
                axes.plot(*envelope(found.t, error), color=colour, linewidth=0.9, label=rms)
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.01)
        axes.set(xlabel="time (s)", ylabel="horizontal error (m)")
        style.head(axes, f"Position error{next(iter(views.values())).alignment_words}")
    return figure


def plot_heading(view: AlignedSolution) -> Figure:
    """Draw the heading of the body's x axis; below it the claimed 95 % band, and the error if known."""
    stances, headings = view.solution.stances, trace_headings(view)
    with style.styled():
        figure = style.new_figure(5.0)
        whole, close = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
        dots = {"marker": ".", "markersize": 4.5} if len(stances) <= MAX_DOTS else {}
        line = {"color": style.BLUE, "linewidth": 1.1, "label": f"{view.solution.method}, at the stances"}
        for t, angle, kind in (
            (view.solution.t, headings.truth, {**style.TRUTH_LINE, "label": "truth"}),
            (view.solution.t, headings.between, {**line, **_PALE, "label": "in between"}),
            (stances.t, headings.at_stances, {**line, **dots}),
        ):
            row = spread_rows(len(t), MAX_POINTS)
            if np.isfinite(angle[row]).any():
                whole.plot(*break_line(t[row], np.rad2deg(angle[row]), headings.wrapped), **kind)
        span_deg = float(np.ptp(whole.get_ylim()))
        whole.yaxis.set_major_locator(MultipleLocator(next((s for s in _COMPASS_DEG if span_deg / s <= 9), 360)))
        whole.set_ylabel("heading (deg,\nclockwise from north)")
        whole.margins(x=0.01)
        style.head(whole, f"Heading{view.alignment_words}")
        _draw_heading_error(close, stances.t, headings)
        close.set_xlabel("time (s)")
    return figure


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


def plot_stance_statistic(t: Floats, stances: Stances) -> Figure:
    """Draw the detector's statistic over its threshold: the whole walk above, ten seconds of it below.

    `t` (N,) s. The stances must have a statistic.
    """
    statistic = stances.statistic
    if statistic is None:
        raise ValueError("these stances have no statistic to draw")
    excerpt = choose_excerpt(t, stances)
    with style.styled():
        figure = style.new_figure(5.0)
        whole, close = figure.subplots(2, 1, sharey=True)
        # of a long walk, whose line is a block, a dot for each stance and swing
        if len(stances) <= MAX_STANCES_AS_LINE:
            _draw_statistic(whole, *envelope(t, statistic), linewidth=0.5)
        else:
            ends = np.stack([stances.start, stances.stop], axis=1).ravel()[:-1]  # stance, swing, stance, ...
            low, high = np.fmin.reduceat(statistic, ends)[0::2], np.fmax.reduceat(statistic, ends)[1::2]
            whole.plot(t[ends[1::2]], high, ".", color=style.SKY, markersize=2.5, label="largest of each swing")
            whole.plot(t[ends[0::2]], low, ".", color=style.BLUE, markersize=2.5, label="smallest of each stance")
            _draw_statistic(whole, t[:0], statistic[:0], linewidth=0.5)
        whole.axvspan(t[excerpt.start], t[excerpt.stop - 1], color=style.ORANGE, alpha=0.3, linewidth=0)
        middle = (t[excerpt.start] + t[excerpt.stop - 1]) / 2
        pointer = {"transform": whole.get_xaxis_transform(), "clip_on": False}
        whole.plot(middle, 1.0, "v", color=style.ORANGE, markersize=7, **pointer)
        style.head(whole, f"Stance detection ({stances.detector}): {stances.n_footfalls} footfalls")
        whole.set_ylim(*find_log_limits(statistic))
        # the close-up
        label = "stance"
        for start, stop in zip(stances.start, stances.stop, strict=True):
            if stop > excerpt.start and start < excerpt.stop:
                close.axvspan(t[start], t[stop - 1], color=style.SHADE, linewidth=0, label=label)
                label = "_another"
        _draw_statistic(close, t[excerpt], statistic[excerpt], linewidth=1.0)
        close.set_xlim(t[excerpt.start], t[excerpt.stop - 1])
        close.set_xlabel("time (s)")
        style.head(close, "Close-up of the marked stretch")
    return figure


def _draw_statistic(axes: Axes, t: Floats, statistic: Floats, linewidth: float) -> None:
    axes.plot(t, statistic, color=style.BLUE, linewidth=linewidth)
    axes.axhline(1.0, color=style.VERMILION, linewidth=1.1, label="threshold")
    axes.set_yscale("log")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.margins(x=0.01)
    axes.set_ylabel("statistic / threshold")
