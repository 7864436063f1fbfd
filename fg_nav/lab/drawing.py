"""Pictures of the laboratory.

A simulated walk from above: its true path in the colours of the field, and its landmarks. The noise of a sensor: Allan
deviations in the units of data sheets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab import palette
from fg_nav.lab.allan import FLOOR, AllanCurve, NoiseFit, RecordingNoise
from fg_nav.lab.simulation import SimulatedWalk
from fg_nav.report.charts import draw_ends, spread_rows
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


# --- noise -----------------------------------------------------------------------------------------------------------

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class SheetUnit:
    """What data sheets write for a sensor: words of its unit, SI units (or uT) in it, and for B and K the same."""

    title: str
    white: str
    per_white: float
    level: str
    per_level: float
    walk: str
    per_walk: float


_DEG, _PER_SQRT_HOUR = float(np.rad2deg(1.0)), 60.0
_MICRO_G = 1e6 / GRAVITY_M_S2

UNITS = {
    "gyr": SheetUnit(
        "gyroscope", "deg/s/√Hz", _DEG, "deg/h", 3600 * _DEG, "deg/h/√h", 3600 * _DEG * _PER_SQRT_HOUR
    ),
    "acc": SheetUnit("accelerometer", "µg/√Hz", _MICRO_G, "µg", _MICRO_G, "µg/√h", _MICRO_G * _PER_SQRT_HOUR),
    "mag": SheetUnit("magnetometer", "nT/√Hz", 1e3, "nT", 1e3, "nT/√h", 1e3 * _PER_SQRT_HOUR),
}  # fmt: skip


def plot_allan(noise: RecordingNoise) -> Figure:
    """Draw every axis: measured deviation with its band, fit, and the parts that were seen."""
    rows = len(noise.sensors)
    with style.styled():
        figure = style.new_figure(0.7 + 2.5 * rows)
        grid = figure.subplots(rows, 3, sharex=True, sharey="row", squeeze=False)
        for row, one in zip(grid, noise.sensors, strict=True):
            for axes, name, curve, fit in zip(row, AXES, one.curves, one.fits, strict=True):
                _draw(axes, curve, fit, UNITS[one.sensor].per_level)
                axes.set_title(f"{UNITS[one.sensor].title} {name}")
            # range of the measured deviations and their bands; the parts of the fit may leave it
            bounds = np.concatenate([bound for fit in one.fits for bound in (fit.low, fit.high)])
            seen = UNITS[one.sensor].per_level * bounds[bounds > 0.0]
            limits = (float(seen.min()) / 1.5, 1.5 * float(seen.max())) if len(seen) else (0.1, 1.0)
            row[0].set_ylim(*limits)
            row[0].set_ylabel(f"Allan deviation ({UNITS[one.sensor].level})")
        for axes in grid[-1]:
            axes.set_xlabel("averaging time (s)")
        handles = {
            label: handle for axes in grid.flat for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        figure.legend(handles.values(), handles.keys(), loc="outside upper left", ncols=6, handlelength=1.8)
    return figure


def _draw(axes: Axes, curve: AllanCurve, fit: NoiseFit, factor: float) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    if not curve.deviation.any():
        axes.text(0.5, 0.5, "constant", transform=axes.transAxes, ha="center", color=style.SOFT_INK)
        return
    tau = np.geomspace(fit.fitted_from_s, curve.tau_s[-1], 200)
    axes.fill_between(
        curve.tau_s, factor * fit.low, factor * fit.high, color=palette.SKY, alpha=0.35, linewidth=0, label="68 %"
    )
    axes.plot(curve.tau_s, factor * curve.deviation, ".", color=palette.BLUE, markersize=4, label="measured", zorder=4)
    axes.plot(tau, factor * fit.deviation_at(tau), color=style.INK, linewidth=1.0, label="fit")
    axes.margins(x=0.02)
    slopes = (
        ("N white noise", fit.white, fit.white.value / np.sqrt(tau), palette.VERMILION),
        ("B flicker", fit.flicker, np.full(len(tau), FLOOR * fit.flicker.value), palette.GREEN),
        ("K random walk", fit.walk, fit.walk.value * np.sqrt(tau / 3), palette.PURPLE),
    )
    for name, part, line, colour in slopes:
        if part.seen:
            axes.plot(tau, factor * line, "--", color=colour, linewidth=1.1, label=name, zorder=1)
