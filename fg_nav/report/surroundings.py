"""A simulated walk from above, coloured by the strength of the field where the sensor was."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from fg_nav.arrays import Floats
from fg_nav.lab.simulation import SimulatedWalk
from fg_nav.recording import TrajectoryTruth
from fg_nav.report import style
from fg_nav.report.maps import draw_ends, new_map
from fg_nav.report.thinning import spread_rows

MAX_PIECES = 20_000
WIDEST_SCALE = (2.0, 98.0)
"""Percentiles of the strength that the colours span: a magnet would leave all else one colour."""


def plot_surroundings(walk: SimulatedWalk) -> Figure:
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
