"""`fg-nav allan`: the noise of a sensor at rest as a table in the units of data sheets, a picture, and JSON.

=============== ==========================================================================================
allan.json      per sensor and axis N, B, K with sigma and limit, the lowest point, and the curve; SI units and uT
allan.png       deviation over averaging time, one panel an axis, with band, fit and its three parts
=============== ==========================================================================================
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fg_nav.calibration.allan import (
    AllanCurve,
    NoiseFit,
    NoisePart,
    RecordingNoise,
    SensorNoise,
    measure_recording_noise,
)
from fg_nav.commands import Answer, Target, name_walk
from fg_nav.io import Reading
from fg_nav.report.files import write_json
from fg_nav.report.folder import ALLAN_FILES
from fg_nav.report.plots.allan import AXES, UNITS, SheetUnit, plot_allan
from fg_nav.report.plots.style import save
from fg_nav.report.terminal import console, print_place, ruled_table
from fg_nav.text import find_version


def allan(file: Path, reading: Reading, out: Path | None, force: bool) -> Answer:
    """Measure the noise in a recording of a sensor lying still, and write it into a folder."""
    with Target(out, force, f"{name_walk(file)}-allan", ALLAN_FILES) as target:
        noise = measure_recording_noise(reading.read(file))
        with target.open() as folder:
            write_allan(folder, noise, file)
    content = {"folder": str(target.place), **describe_noise(noise, file)}
    return Answer(content, partial(print_allan, noise, target.place))


def write_allan(folder: Path, noise: RecordingNoise, source: Path) -> None:
    """Write `allan.json` and `allan.png` into an existing folder."""
    save(plot_allan(noise), folder / "allan.png")
    write_json(folder / "allan.json", describe_noise(noise, source))


def describe_noise(noise: RecordingNoise, source: Path) -> dict[str, Any]:
    """Everything for JSON: rad/s, m/s^2 and uT, with sqrt(Hz) or sqrt(s) under N and K."""
    return {
        "version": find_version(),
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
