"""The walk from above: one method with its 95 % ellipses, several methods, or a simulated walk in its field.

Pictures are in the truth's frame where there is a truth (the title says how the solution was aligned with it), else in
the solution's own. Bands and ellipses are the estimator's own uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator

from fg_nav.arrays import Floats
from fg_nav.report.aligned import AlignedSolution
from fg_nav.report.decimation import spread_rows
from fg_nav.report.ellipses import REACH, find_ellipses, find_extent
from fg_nav.report.plots import style
from fg_nav.report.plots.style import MAX_POINTS
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth

if TYPE_CHECKING:
    from fg_nav.lab.simulation import SimulatedWalk


MAX_ELLIPSES = 80
MAX_DOTS = 400  # More stances than this are not marked one by one.

MAX_PIECES = 20_000
WIDEST_SCALE = (2.0, 98.0)
"""Percentiles of the strength that the colours span: a magnet would leave all else one colour."""


def plot_trajectory(view: AlignedSolution) -> Figure:
    """Draw the walk from above: path, stances with 95 % ellipses, truth."""
    with style.styled():
        figure, axes = _map([view])
        draw_trajectory(axes, view)
    return figure


def plot_trajectory_on_screen(view: AlignedSolution, axes: Axes | None = None) -> Axes:
    """Draw the same into these axes, or into a new figure of pyplot, which windows and notebooks show."""
    from matplotlib import pyplot

    with style.styled():
        if axes is None:
            size = style.WIDTH_IN, _map_height(_path(view))
            axes = pyplot.figure(figsize=size, layout="constrained").subplots()
        _shape_map(axes, _path(view))
        _name_axes(axes, view.truth)
        draw_trajectory(axes, view)
    return axes


def draw_trajectory(axes: Axes, view: AlignedSolution) -> None:
    """Draw path, stances with 95 % ellipses and truth into a map."""
    stance = view.stance_position()
    _draw_truth(axes, view.truth)
    _draw_path(axes, view, style.BLUE, view.solution.method)
    _draw_ellipses(axes, view)
    if len(stance) <= MAX_DOTS:
        axes.plot(*stance[:, :2].T, ".", color=style.BLUE, markersize=3.2, zorder=4)
    draw_ends(axes, stance)
    style.head(axes, f"Trajectory{view.alignment_words}")


def plot_trajectories(views: Mapping[str, AlignedSolution]) -> Figure:
    """Lay the walks of several methods over each other, and over the truth."""
    first = next(iter(views.values()))
    with style.styled():
        figure, axes = _map(list(views.values()))
        _draw_truth(axes, first.truth)
        for colour, (name, view) in zip(style.colours(len(views)), views.items(), strict=True):
            _draw_path(axes, view, colour, name)
        draw_ends(axes, first.stance_position())
        style.head(axes, f"Trajectories{first.alignment_words}")
    return figure


def _map(views: list[AlignedSolution]) -> tuple[Figure, Axes]:
    """Map for the walks of all views."""
    figure, axes = new_map(np.vstack([_path(view) for view in views]))
    _name_axes(axes, views[0].truth)
    return figure, axes


def _name_axes(axes: Axes, truth: Truth | None) -> None:
    if isinstance(truth, FootprintTruth):  # of unknown azimuth
        axes.set(xlabel="x (m)", ylabel="y (m)")


def new_map(points: Floats) -> tuple[Figure, Axes]:
    """Figure shaped like the points (N, 2) m, with equal scales east and north."""
    figure = style.new_figure(_map_height(points))
    axes = figure.subplots()
    _shape_map(axes, points)
    return figure, axes


def _map_height(points: Floats) -> float:
    """Height in inches of a picture of the points (N, 2) m."""
    width, height = np.ptp(points, axis=0) + 1e-9
    return float(np.clip(style.WIDTH_IN * height / width, 3.5, 8.0)) + 0.7


def _shape_map(axes: Axes, points: Floats) -> None:
    """Give a map of the points (N, 2) m equal scales east and north."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    step_m = _tick_step(max(*np.ptp(points, axis=0).tolist(), 0.1))
    axes.xaxis.set_major_locator(MultipleLocator(step_m))
    axes.yaxis.set_major_locator(MultipleLocator(step_m))
    axes.set(xlabel="east (m)", ylabel="north (m)")


def _tick_step(extent_m: float) -> float:
    """Round distance of which four to ten fit into the extent."""
    wanted = extent_m / 8
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * min(s for s in (1, 2, 5, 10) if power * s >= wanted))


def _draw_truth(axes: Axes, truth: Truth | None) -> None:
    if isinstance(truth, TrajectoryTruth):
        path = truth.position[spread_rows(len(truth.position), MAX_POINTS)]
        axes.plot(path[:, 0], path[:, 1], **style.TRUTH_LINE, label="truth", zorder=1)
    elif truth is not None:
        axes.plot(
            *truth.xy.T,
            "s",
            color=style.TRUTH,
            markersize=5,
            markerfacecolor="none",
            label="surveyed footprints",
        )


def _draw_path(axes: Axes, view: AlignedSolution, colour: str, label: str) -> None:
    path = _path(view)
    laps = np.linalg.norm(np.diff(path, axis=0), axis=1).sum() / max(float(np.max(np.ptp(path, axis=0))), 0.1)
    width = float(np.clip(1.1 * np.sqrt(20.0 / max(laps, 1.0)), 0.35, 1.1))  # thin where lines lie close
    axes.plot(path[:, 0], path[:, 1], color=colour, linewidth=width, label=label, zorder=3)


def _path(view: AlignedSolution) -> Floats:
    """Points (M, 2) m of the walk, as many as a line needs."""
    return view.align_position(view.solution.position[spread_rows(len(view.solution.position), MAX_POINTS)])[:, :2]


def _draw_ellipses(axes: Axes, view: AlignedSolution) -> None:
    found = find_ellipses(view, MAX_ELLIPSES)
    if found is None:
        return
    size = 2 * found.zoom * found.semi
    ellipses = EllipseCollection(
        size[:, 1], size[:, 0], np.rad2deg(found.angle), units="xy", offsets=found.centre,
        offset_transform=axes.transData, facecolor=style.BLUE, edgecolor=style.BLUE, alpha=0.16,
        linewidth=0.6, zorder=2,
    )  # fmt: skip
    axes.add_collection(ellipses)
    reach = np.minimum(size[:, 1:] / 2, REACH * find_extent(view.stance_position()))
    axes.update_datalim(np.vstack([found.centre - reach, found.centre + reach]))
    words = "95 % ellipses" + (f", drawn {found.zoom} times as large" if found.zoom > 1 else "")
    axes.plot([], [], "o", color=style.BLUE, alpha=0.25, markersize=8, label=words)


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
        figure, axes = new_map(path[:, :2])
        low, high = np.percentile(strength, WIDEST_SCALE)
        lines = LineCollection(
            list(_pieces(path[:, :2])), array=(strength[1:] + strength[:-1]) / 2, cmap="viridis", linewidth=1.6,
            capstyle="round", clim=(low - 0.5, high + 0.5), zorder=3,
        )  # fmt: skip
        axes.add_collection(lines)
        axes.update_datalim(path[:, :2])
        axes.autoscale_view()
        figure.colorbar(lines, ax=axes, label="field at the sensor (uT)", shrink=0.75, pad=0.02)
        places = {mark.landmark: mark.position for mark in walk.landmarks}
        if places:
            east, north, _ = np.array(list(places.values())).T
            axes.plot(
                east, north, "D", color=style.INK, markerfacecolor="white", markersize=5, zorder=5, label="landmark"
            )
        draw_ends(axes, path)
        style.head(axes, f"{walk.scenario.name}, seed {walk.seed}: {walk.scenario.field} field")
    return figure


def _pieces(xy: Floats) -> Floats:
    """Segments (M - 1, 2, 2) of a line (M, 2)."""
    return np.stack([xy[:-1], xy[1:]], axis=1)
