"""Figures 4, 5, 7, 8, 9, 10, 11, 13 and 14 of Munoz Diaz et al. (2017), in the paper's layout, of our runs.

Axes of the sensor are blue, red and green as there; thin lines are one sigma to either side, dashes what is true.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.arrays import Floats
from fg_nav.lab import palette
from fg_nav.lab.reproduce.munoz_diaz2017.runs import Run
from fg_nav.lab.reproduce.munoz_diaz2017.walks import AllanPair, Setting
from fg_nav.lab.simulation.fields import Cylinders
from fg_nav.report.plots import style

COLOURS = (palette.BLUE, "#CC3311", palette.GREEN)
NAMES = ("x", "y", "z")
BOTH, ALONE = "#CC33AA", palette.GREEN
"""Trajectories by both updates and by gravity only, as in Figure 14."""
BLOCK_M = (40.0, 11.0)  # Half the length and half the width of what Figure 4 shows.


FIGURES: Mapping[str, str] = MappingProxyType(
    {
        "figure-08": "biases by gravity only",
        "figure-09": "biases by gravity and the field at three places",
        "figure-10": "field and biases past cars and lamps",
        "figure-11": "yaw error in four fields",
        "figure-13": "biases of the second walk",
        "figure-14": "way of the second walk by both updates and by gravity only",
    }
)
"""Of each estimator, and what they show."""

_SITES = {"north-pole": "(a) North Pole", "equator": "(b) Equator", "munich": "(c) Munich"}
_STATES = {
    "MTw, gravity": "(a) gravity only",
    "MTw, raw": "(b) uncalibrated magnetometer",
    "MTw, calibrated": "(c) calibrated magnetometer",
}


def draw_all(
    folder: Path, estimator: str, seed: int, settings: Mapping[str, Setting], runs: Mapping[str, Run | None]
) -> list[str]:
    """Draw one estimator's runs, by case, and return the names of the files; a case that ended early is left blank."""
    with style.styled():
        drawn = (
            _biases(settings, runs, {"gravity": "Gravity only"}),
            _biases(settings, runs, _SITES),
            _perturbed(settings, runs),
            _yaws(runs),
            _biases(settings, runs, _STATES),
            _trajectories(settings["MTw, gravity"], runs),
        )
        names = [file_of(figure, seed, estimator) for figure in FIGURES]
        for name, figure in zip(names, drawn, strict=True):
            style.save(figure, folder / name)
    return names


def file_of(figure: str, seed: int, estimator: str = "") -> str:
    """Name of a picture's file."""
    return "-".join(word for word in (figure, estimator, str(seed)) if word) + ".png"


def draw_walk(folder: Path, seed: int, setting: Setting, pair: AllanPair) -> list[str]:
    """Draw what no estimator has a hand in, Figures 4, 5 and 7, and return the names of the files."""
    with style.styled():
        names = [file_of(figure, seed) for figure in ("figure-04", "figure-05", "figure-07")]
        for name, figure in zip(names, (_template(setting), _allan(pair), _streets(setting)), strict=True):
            style.save(figure, folder / name)
    return names


def _template(setting: Setting) -> Figure:
    """A block of the street, from above."""
    figure = style.new_figure(3.2)
    axes = figure.subplots()
    axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal")
    if setting.street is not None:
        east, north, field = _bent(setting.street, 0.25)
        shown = axes.pcolormesh(east, north, np.linalg.norm(field, axis=-1), cmap="viridis")
        figure.colorbar(shown, ax=axes, label="field (uT)", shrink=0.8)
        few = (slice(None, None, 12),) * 2
        axes.quiver(east[few], north[few], field[few][..., 0], field[few][..., 1], color="white", width=0.002)
    style.head(axes, "Figure 4: the field past lamps and a car")
    return figure


def _bent(street: Cylinders, step_m: float) -> tuple[Floats, Floats, Floats]:
    """Places east and north (A, B) m of one block about its car, and the field (A, B, 3) uT there; NaN inside iron."""
    middle = street.axis[np.flatnonzero((street.radius > 1.0) & (street.axis[:, 0] > 0.0))[0]]
    wide, deep = BLOCK_M
    east, north = np.meshgrid(
        np.arange(-wide, wide, step_m) + middle[0], np.arange(-deep, deep, step_m) + middle[1], indexing="ij"
    )
    at = np.stack([east.ravel(), north.ravel(), np.zeros(east.size)], axis=1)
    outside = (np.linalg.norm(at[:, None, :2] - street.axis, axis=2) > street.radius).all(axis=1)
    field = np.full(at.shape, np.nan)
    field[outside] = street.at(at[outside])
    return east, north, field.reshape(*east.shape, 3)


def _allan(pair: AllanPair) -> Figure:
    figure = style.new_figure(3.6, 6.0)
    axes = figure.subplots()
    for curves, line, name in ((pair.fog, "-", "FOG"), (pair.mems, "--", "MTw")):
        for curve, colour, axis in zip(curves, COLOURS, NAMES, strict=True):
            axes.loglog(curve.tau_s, curve.deviation, line, color=colour, label=f"{name} {axis}")
    axes.set(xlabel="averaging time (s)", ylabel="Allan deviation (deg/s)")
    style.head(axes, "Figure 5: gyroscopes at rest", 6)
    return figure


def _biases(settings: Mapping[str, Setting], runs: Mapping[str, Run | None], titles: Mapping[str, str]) -> Figure:
    figure = style.new_figure(3.0, 4.2 * len(titles) if len(titles) > 1 else 6.0)
    for axes, (case, title) in zip(np.atleast_1d(figure.subplots(1, len(titles))), titles.items(), strict=True):
        _draw_bias(axes, settings[case], runs[case], title)
    return figure


def _draw_bias(axes: Axes, setting: Setting, run: Run | None, title: str) -> None:
    axes.set(xlabel="time (min)", ylabel="bias (deg/s)")
    if run is not None:
        for axis, colour in enumerate(COLOURS):
            value, sigma = run.bias[:, axis], run.sigma[:, axis]
            axes.plot(run.minute, value, color=colour, label=NAMES[axis])
            for side in (-1, 1):
                axes.plot(run.minute, value + side * sigma, color=colour, linewidth=0.4)
            axes.plot(run.minute, setting.bias[:, axis], "--", color=colour, linewidth=0.7)
        # what is drawn is what the estimates do; their uncertainty may be cut off
        low, high = np.percentile(np.concatenate([run.bias, setting.bias]), [0.0, 100.0])
        axes.set_ylim(low - 0.05, high + 0.05)
    style.head(axes, title, 3)


def _perturbed(settings: Mapping[str, Setting], runs: Mapping[str, Run | None]) -> Figure:
    """Panel (b) only of who has such a run: the graph has no way without its own weighing of the field."""
    figure = style.new_figure(3.0, 12.6 if "cars" in runs else 8.4)
    panels = figure.subplots(1, 3 if "cars" in runs else 2)
    run = runs["cars, detector"]
    if run is not None and run.strength is not None:
        panels[0].plot(run.minute, run.strength, color=palette.BLUE, linewidth=0.7, label="strength")
        if "cars" in runs:
            used = np.where(run.used, run.strength, np.nan)
            panels[0].plot(run.minute, used, color=COLOURS[1], linewidth=1.0, label="update active")
    for minute in settings["cars"].passed_min:
        panels[0].axvline(minute, color=style.SOFT_INK, linewidth=0.5, linestyle=":")
    panels[0].set(xlabel="time (min)", ylabel="field (uT)")
    style.head(panels[0], "(a) field measured", 2)
    if "cars" in runs:
        _draw_bias(panels[1], settings["cars"], runs["cars"], "(b) update always")
    _draw_bias(panels[-1], settings["cars"], run, f"(c) disturbances {'left out' if 'cars' in runs else 'weighed'}")
    return figure


def _yaws(runs: Mapping[str, Run | None]) -> Figure:
    figure = style.new_figure(5.0)
    titles = {
        "gravity": "(a) gravity only",
        "munich": "(b) Munich, both updates",
        "equator": "(c) Equator, both updates",
        "cars, detector": "(d) perturbed, both updates",
    }
    for axes, (case, title) in zip(figure.subplots(2, 2).ravel(), titles.items(), strict=True):
        run = runs[case]
        if run is not None:
            axes.plot(run.minute, run.yaw_error, color=palette.BLUE)
        axes.set(xlabel="time (min)", ylabel="yaw error (deg)")
        style.head(axes, title)
    return figure


def _trajectories(setting: Setting, runs: Mapping[str, Run | None]) -> Figure:
    figure = style.new_figure(4.0)
    for axes, legs, title in zip(figure.subplots(1, 2), (2, None), ("(a) first round trip", "(b) all"), strict=True):
        part = slice(None) if legs is None else setting.legs < legs
        axes.plot(*setting.path[part].T, color=palette.ORANGE, linewidth=3, label="true")
        for case, colour, name in (("MTw, calibrated", BOTH, "both updates"), ("MTw, gravity", ALONE, "gravity only")):
            run = runs[case]
            if run is not None:
                axes.plot(*run.path[part].T, color=colour, label=name)
        axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal")
        axes.set_adjustable("datalim")
        style.head(axes, title, 2)
    return figure


def _streets(setting: Setting) -> Figure:
    figure = style.new_figure(2.2)
    axes = figure.subplots()
    axes.plot(*setting.path.T, color=COLOURS[1], linewidth=0.8, label="walk")
    if setting.street is not None:
        east, north = setting.street.axis.T
        car = setting.street.radius > 1.0
        axes.plot(east[car], north[car], "o", color=palette.BLUE, label="cars")
        axes.plot(east[~car], north[~car], ".", color=palette.GREEN, label="lamps")
    axes.set(xlabel="east (m)", ylabel="north (m)", xlim=(-20, 520))
    style.head(axes, "Figure 7b: the walk and what stands beside it", 3)
    return figure
