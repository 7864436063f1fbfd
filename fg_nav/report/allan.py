"""The noise of a sensor at rest: a table in the units of data sheets, a picture, and all of it as JSON.

=============== ==========================================================================================
allan.json      per sensor and axis N, B, K with sigma and limit, the lowest point, and the curve; SI units and uT
allan.png       deviation over averaging time, one panel an axis, with band, fit and its three parts
=============== ==========================================================================================
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.calibration.allan import FLOOR, AllanCurve, NoiseFit, NoisePart
from fg_nav.calibration.at_rest import RecordingNoise, SensorNoise
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.report import style
from fg_nav.report.results import write_json
from fg_nav.report.terminal import console, print_place, ruled_table
from fg_nav.version import version

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


def write_allan(folder: Path, noise: RecordingNoise, source: Path) -> None:
    """Write `allan.json` and `allan.png` into an existing folder."""
    style.save(plot_allan(noise), folder / "allan.png")
    write_json(folder / "allan.json", allan_content(noise, source))


def allan_content(noise: RecordingNoise, source: Path) -> dict[str, Any]:
    """Everything for JSON: rad/s, m/s^2 and uT, with sqrt(Hz) or sqrt(s) under N and K."""
    return {
        "version": version(),
        "recording": str(source),
        "start_s": noise.start_s,
        "seconds": noise.seconds,
        "sensors": {one.sensor: _sensor_content(one) for one in noise.sensors},
    }


def _sensor_content(one: SensorNoise) -> dict[str, Any]:
    axes = zip(AXES, one.curves, one.fits, strict=True)
    return {"rate_hz": one.rate_hz} | {name: _axis_content(curve, fit) for name, curve, fit in axes}


def _axis_content(curve: AllanCurve, fit: NoiseFit) -> dict[str, Any]:
    return {
        "N": fit.white,
        "B": fit.flicker,
        "K": fit.walk,
        "lowest": fit.lowest,
        "lowest_tau_s": fit.lowest_tau_s,
        "fitted_from_s": fit.fitted_from_s,
        "misfit": fit.misfit,
        "tau_s": curve.tau_s,
        "deviation": curve.deviation,
        "low": fit.low,
        "high": fit.high,
    }


def print_allan(noise: RecordingNoise, place: Path) -> None:
    """Print N, B, K and the lowest point per sensor and axis, and where the files are."""
    out = console()
    out.print(f"at rest for {noise.seconds:.0f} s from {noise.start_s:.1f} s on", soft_wrap=True)
    for one in noise.sensors:
        unit = UNITS[one.sensor]
        heads = (
            f"N ({unit.white})",
            f"B ({unit.level})",
            f"K ({unit.walk})",
            f"lowest ({unit.level})",
            "at (s)",
            "fit from (s)",
        )
        shown = ruled_table(f"{unit.title}, {one.rate_hz:.0f} Hz", *heads)
        for axis, fit in zip(AXES, one.fits, strict=True):
            shown.add_row(axis, *_words(fit, unit))
        out.print(shown)
    out.print(_READING, soft_wrap=True)
    print_place([], place)


_READING = (
    "N white noise (sheets with one-sided densities print 1.41 N), B flicker (the curve's floor is 0.66 B), K random "
    "walk. '< x': not seen in this record, and with 95 % not above x."
)


def _words(fit: NoiseFit, unit: SheetUnit) -> Iterator[str]:
    yield _part_words(fit.white, unit.per_white)
    yield _part_words(fit.flicker, unit.per_level)
    yield _part_words(fit.walk, unit.per_walk)
    yield f"{fit.lowest * unit.per_level:.3g}"
    yield f"{fit.lowest_tau_s:.3g}"
    yield f"{fit.fitted_from_s:.2g}"


def _part_words(part: NoisePart, factor: float) -> str:
    """Value and sigma, both to the sigma's second digit but not finer than four digits of the value."""
    if not part.seen:
        return f"< {part.limit * factor:.2g}"
    value, sigma = part.value * factor, part.sigma * factor
    places = max(0, int(np.ceil(1 - np.log10(max(sigma, 1e-4 * value, 1e-12)))))
    return f"{value:.{places}f} ± {sigma:.{places}f}"


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
            row[0].set_ylim(*_limits(one, UNITS[one.sensor].per_level))
            row[0].set_ylabel(f"Allan deviation ({UNITS[one.sensor].level})")
        for axes in grid[-1]:
            axes.set_xlabel("averaging time (s)")
        handles = {
            label: handle for axes in grid.flat for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        figure.legend(handles.values(), handles.keys(), loc="outside upper left", ncols=6, handlelength=1.8)
    return figure


def _limits(one: SensorNoise, factor: float) -> tuple[float, float]:
    """Range of the measured deviations and their bands; the parts of the fit may leave it."""
    all_bounds = np.concatenate([bound for fit in one.fits for bound in (fit.low, fit.high)])
    seen = factor * all_bounds[all_bounds > 0.0]
    return (float(seen.min()) / 1.5, 1.5 * float(seen.max())) if len(seen) else (0.1, 1.0)


def _draw(axes: Axes, curve: AllanCurve, fit: NoiseFit, factor: float) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    if not curve.deviation.any():
        axes.text(0.5, 0.5, "constant", transform=axes.transAxes, ha="center", color=style.SOFT_INK)
        return
    tau = np.geomspace(fit.fitted_from_s, curve.tau_s[-1], 200)
    axes.fill_between(
        curve.tau_s, factor * fit.low, factor * fit.high, color=style.SKY, alpha=0.35, linewidth=0, label="68 %"
    )
    axes.plot(curve.tau_s, factor * curve.deviation, ".", color=style.BLUE, markersize=4, label="measured", zorder=4)
    axes.plot(tau, factor * fit.deviation_at(tau), color=style.INK, linewidth=1.0, label="fit")
    axes.margins(x=0.02)
    slopes = (
        ("N white noise", fit.white, fit.white.value / np.sqrt(tau), style.VERMILION),
        ("B flicker", fit.flicker, np.full(len(tau), FLOOR * fit.flicker.value), style.GREEN),
        ("K random walk", fit.walk, fit.walk.value * np.sqrt(tau / 3), style.PURPLE),
    )
    for name, part, line, colour in slopes:
        if part.seen:
            axes.plot(tau, factor * line, "--", color=colour, linewidth=1.1, label=name, zorder=1)
