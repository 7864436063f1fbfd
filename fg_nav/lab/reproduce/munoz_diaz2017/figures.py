"""Figures 5, 8 to 11, 13 and 14 of Munoz Diaz et al. (2017), in the paper's layout, of our runs.

Axes of the sensor are blue, red and green as there; thin lines are one sigma to either side, dashes what is true.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.lab import palette
from fg_nav.lab.reproduce.drawing import Pictures
from fg_nav.lab.reproduce.munoz_diaz2017.runs import Run, Seed
from fg_nav.lab.reproduce.munoz_diaz2017.walks import FILTER, ONLINE, Setting
from fg_nav.lab.reproduce.results import Picture
from fg_nav.report.plots import style

COLOURS = (palette.BLUE, "#CC3311", palette.GREEN)
NAMES = ("x", "y", "z")
BOTH, ALONE = "#CC33AA", palette.GREEN
"""Trajectories by both updates and by gravity only, as in Figure 14."""
SITES = {"north-pole": "(a) North Pole", "equator": "(b) Equator", "munich": "(c) Munich"}
STATES = {
    "MTw, gravity": "(a) gravity only",
    "MTw, raw": "(b) uncalibrated magnetometer",
    "MTw, calibrated": "(c) calibrated magnetometer",
}
DRAWN = {FILTER: "filter", ONLINE: "online graph"}  # Estimators whose runs are drawn.

Runs = Mapping[str, Run | None]  # Of one estimator, by case; one that ended early is left blank.


def draw_all(pictures: Pictures, seed: Seed) -> dict[str, list[Picture]]:
    """Draw the figures of each experiment, of each estimator that is drawn."""
    draw: dict[str, tuple[int, str, Callable[[Runs], Figure]]] = {
        "D-E1": (8, "biases by gravity only", lambda runs: _biases(seed, runs, {"gravity": "Gravity only"})),
        "D-E2": (9, "biases by gravity and the field at three places", lambda runs: _biases(seed, runs, SITES)),
        "D-E3": (10, "field and biases past cars and lamps", lambda runs: _perturbed(seed, runs)),
        "D-E4": (11, "yaw error in four fields", _yaws),
        "D-E5": (13, "biases of the second walk", lambda runs: _biases(seed, runs, STATES)),
        "D-E6": (14, "the way of the second walk", lambda runs: _trajectories(seed.settings["MTw, gravity"], runs)),
    }
    with style.styled():
        what = "Allan deviations of the gyroscopes"
        found = {"D-E0": [pictures.keep(_allan(seed), 5, what, "the fibre-optic one and the MTw's")]}
        for experiment, (number, what, make) in draw.items():
            for name, words in DRAWN.items():
                runs = {case: by[name] for case, by in seed.runs.items() if name in by}
                kept = pictures.keep(make(runs), number, what, f"as the {words} has it", name)
                found.setdefault(experiment, []).append(kept)
    return found


def _allan(seed: Seed) -> Figure:
    figure = style.new_figure(3.6, 6.0)
    axes = figure.subplots()
    for sensor, line, name in (("fog", "-", "FOG"), ("mems", "--", "MTw")):
        for deviation, colour, axis in zip(seed.own[f"allan/{sensor}"], COLOURS, NAMES, strict=True):
            axes.loglog(seed.own["allan/tau_s"], deviation, line, color=colour, label=f"{name} {axis}")
    axes.set(xlabel="averaging time (s)", ylabel="Allan deviation (deg/s)")
    style.head(axes, "Figure 5: gyroscopes at rest", 6)
    return figure


def _biases(seed: Seed, runs: Runs, titles: Mapping[str, str]) -> Figure:
    figure = style.new_figure(3.0, 4.2 * len(titles) if len(titles) > 1 else 6.0)
    for axes, (case, title) in zip(np.atleast_1d(figure.subplots(1, len(titles))), titles.items(), strict=True):
        _draw_bias(axes, seed.settings[case], runs[case], title)
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


def _perturbed(seed: Seed, runs: Runs) -> Figure:
    """Panel (b) only of who has such a run: the graph has no way without its own weighing of the field."""
    figure = style.new_figure(3.0, 12.6 if "cars" in runs else 8.4)
    panels = figure.subplots(1, 3 if "cars" in runs else 2)
    run = runs["cars, detector"]
    if run is not None and run.strength is not None:
        panels[0].plot(run.minute, run.strength, color=palette.BLUE, linewidth=0.7, label="strength")
        if "cars" in runs:
            used = np.where(run.used, run.strength, np.nan)
            panels[0].plot(run.minute, used, color=COLOURS[1], linewidth=1.0, label="update active")
    for minute in seed.settings["cars"].passed_min:
        panels[0].axvline(minute, color=style.SOFT_INK, linewidth=0.5, linestyle=":")
    panels[0].set(xlabel="time (min)", ylabel="field (uT)")
    style.head(panels[0], "(a) field measured", 2)
    if "cars" in runs:
        _draw_bias(panels[1], seed.settings["cars"], runs["cars"], "(b) update always")
    _draw_bias(
        panels[-1], seed.settings["cars"], run, f"(c) disturbances {'left out' if 'cars' in runs else 'weighed'}"
    )
    return figure


def _yaws(runs: Runs) -> Figure:
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


def _trajectories(setting: Setting, runs: Runs) -> Figure:
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
