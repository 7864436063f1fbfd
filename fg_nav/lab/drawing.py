"""Map of a simulated walk: its true path in the colours of the field, and its landmarks."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from fg_nav.lab.simulation import SimulatedWalk
from fg_nav.report.charts import spread_rows
from fg_nav.report.course import draw_ends
from fg_nav.report.plots import style
from fg_nav.truth import TrajectoryTruth

MAX_PIECES = 20_000  # Of a line in the colours of the field.
WIDEST_SCALE = (2.0, 98.0)  # Percentiles of the strength at the ends of the colours: a magnet would flatten all else.


def plot_simulated_walk(walk: SimulatedWalk) -> Figure:
    """Draw the true path, the field on it, and the landmarks."""
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    path = truth.position[spread_rows(len(truth.position), MAX_PIECES)]
    strength = np.linalg.norm(walk.field.at(path + walk.origin), axis=1)
    low, high = path[:, :2].min(axis=0), path[:, :2].max(axis=0)
    margin = 0.06 * max(*(high - low).tolist(), 0.5)
    with style.styled():
        figure = style.new_figure(style.find_map_height(*(high - low + 2 * margin)))
        axes = figure.subplots()
        # path in the colours of the field
        weakest, strongest = np.percentile(strength, WIDEST_SCALE)
        pieces = np.stack([path[:-1, :2], path[1:, :2]], axis=1)
        lines = LineCollection(
            list(pieces), array=(strength[1:] + strength[:-1]) / 2, cmap="viridis", linewidth=1.6,
            capstyle="round", clim=(weakest - 0.5, strongest + 0.5), zorder=3,
        )  # fmt: skip
        axes.add_collection(lines)
        figure.colorbar(lines, ax=axes, label="field at the sensor (uT)", shrink=0.75, pad=0.02)
        # landmarks, start and end
        places = {mark.landmark: mark.position for mark in walk.landmarks}
        if places:
            east, north, _ = np.array(list(places.values())).T
            mark: dict[str, Any] = {"color": style.INK, "markerfacecolor": "white", "markersize": 5}
            axes.plot(east, north, "D", **mark, zorder=5, label="landmark")
        style.draw_traces(axes, draw_ends(path), lowest=6)
        axes.set(xlabel="east (m)", ylabel="north (m)")
        style.shape_map(axes, *np.stack([low - margin, high + margin], axis=1))
        style.head(axes, f"{walk.scenario.name}, seed {walk.seed}: {walk.scenario.field} field")
    return figure
