"""Figures 5, 7, 8, 9, 10, 11, 13 and 14 of Munoz Diaz et al. (2017), in the paper's layout, of our runs.

Axes of the sensor are blue, red and green as there; thin lines are one sigma to either side, dashes what is true.
Drawn by `reproduce_munoz_diaz2017.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.calibration.allan import AllanCurve
from fg_nav.report import style
from fg_nav.simulation.fields import Cylinders

COLOURS = (style.BLUE, "#CC3311", style.GREEN)
NAMES = ("x", "y", "z")
BOTH, ALONE = "#CC33AA", style.GREEN
"""Trajectories by both updates and by gravity only, as in Figure 14."""


@dataclass(frozen=True)
class Run:
    """What an estimator made of a walk, once a second (M rows).

    Attributes
    ----------
    minute : (M,) min.
    bias, sigma : (M, 3) deg/s.
    yaw_error : (M,) deg, unwrapped, zero at the start.
    strength : (M,) uT as measured; None without a magnetometer.
    used : (M,) whether the differential field update was used.
    path : (K, 2) m, places after each stride by dead reckoning.
    """

    minute: Floats
    bias: Floats
    sigma: Floats
    yaw_error: Floats
    strength: Floats | None
    used: Bools
    path: Floats


@dataclass(frozen=True)
class Setting:
    """What is true of a walk.

    Attributes
    ----------
    starts, ends : (K,) s, of the strides that go somewhere.
    legs : (K,) which time along the street each belongs to, from 0 on.
    length_m : of all of them together.
    path : (K, 2) m, where the foot came down after each, from where it stood first.
    passed_min : when one passes the cars and lamps that stand close, min.
    bias : (M, 3) deg/s, true, as the rows of `Run`.
    street : cars and lamps; None where there are none.
    """

    starts: Floats
    ends: Floats
    legs: Ints
    length_m: float
    path: Floats
    passed_min: Floats
    bias: Floats
    street: Cylinders | None = None


@dataclass(frozen=True)
class AllanPair:
    """Allan deviations of the fibre-optic and of the MEMS gyroscopes, deg/s, an axis each."""

    fog: Sequence[AllanCurve]
    mems: Sequence[AllanCurve]


def draw_all(folder: Path, estimator: str, settings: Mapping[str, Setting], runs: Mapping[str, Run | None]) -> None:
    """Draw what there is of one estimator's runs, by case; a case that ended early is left blank."""
    with style.styled():
        drawn = {
            "figure-07": _streets(settings["cars"]),
            "figure-08": _biases(settings, runs, {"gravity": "Gravity only"}),
            "figure-09": _biases(
                settings, runs, {"north-pole": "(a) North Pole", "equator": "(b) Equator", "munich": "(c) Munich"}
            ),
            "figure-10": _perturbed(settings, runs),
            "figure-11": _yaws(runs),
            "figure-13": _biases(
                settings,
                runs,
                {
                    "MTw, gravity": "(a) gravity only",
                    "MTw, raw": "(b) uncalibrated magnetometer",
                    "MTw, calibrated": "(c) calibrated magnetometer",
                },
            ),
            "figure-14": _trajectories(settings["MTw, gravity"], runs),
        }
        for name, figure in drawn.items():
            style.save(figure, folder / f"{estimator.replace(' ', '-')}-{name}.png")


def draw_allan(folder: Path, pair: AllanPair) -> None:
    """Figure 5."""
    with style.styled():
        figure = style.new_figure(3.6, 6.0)
        axes = figure.subplots()
        for curves, line, name in ((pair.fog, "-", "FOG"), (pair.mems, "--", "MTw")):
            for curve, colour, axis in zip(curves, COLOURS, NAMES, strict=True):
                axes.loglog(curve.tau_s, curve.deviation, line, color=colour, label=f"{name} {axis}")
        axes.set(xlabel="averaging time (s)", ylabel="Allan deviation (deg/s)")
        style.head(axes, "Figure 5: gyroscopes at rest", 6)
        style.save(figure, folder / "figure-05.png")


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
        # what is drawn is what the estimates do; their doubt may be cut off
        low, high = np.percentile(np.concatenate([run.bias, setting.bias]), [0.0, 100.0])
        axes.set_ylim(low - 0.05, high + 0.05)
    style.head(axes, title, 3)


def _perturbed(settings: Mapping[str, Setting], runs: Mapping[str, Run | None]) -> Figure:
    figure = style.new_figure(3.0, 12.6)
    strength, always, gated = figure.subplots(1, 3)
    run = runs["cars, detector"]
    if run is not None and run.strength is not None:
        strength.plot(run.minute, run.strength, color=style.BLUE, linewidth=0.7, label="strength")
        used = np.where(run.used, run.strength, np.nan)
        strength.plot(run.minute, used, color=COLOURS[1], linewidth=1.0, label="update active")
    for minute in settings["cars"].passed_min:
        strength.axvline(minute, color=style.SOFT_INK, linewidth=0.5, linestyle=":")
    strength.set(xlabel="time (min)", ylabel="field (uT)")
    style.head(strength, "(a) field measured", 2)
    _draw_bias(always, settings["cars"], runs["cars"], "(b) update always")
    _draw_bias(gated, settings["cars"], run, "(c) update by the detector")
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
            axes.plot(run.minute, run.yaw_error, color=style.BLUE)
        axes.set(xlabel="time (min)", ylabel="yaw error (deg)")
        style.head(axes, title)
    return figure


def _trajectories(setting: Setting, runs: Mapping[str, Run | None]) -> Figure:
    figure = style.new_figure(4.0)
    for axes, legs, title in zip(figure.subplots(1, 2), (2, None), ("(a) first round trip", "(b) all"), strict=True):
        part = slice(None) if legs is None else setting.legs < legs
        axes.plot(*setting.path[part].T, color=style.ORANGE, linewidth=3, label="true")
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
        axes.plot(east[car], north[car], "o", color=style.BLUE, label="cars")
        axes.plot(east[~car], north[~car], ".", color=style.GREEN, label="lamps")
    axes.set(xlabel="east (m)", ylabel="north (m)", xlim=(-20, 520))
    style.head(axes, "Figure 7b: the walk and what stands beside it", 3)
    return figure
