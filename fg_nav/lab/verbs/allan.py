"""`fg-nav lab allan`: the noise of a sensor that lies still (docs/simulation.md)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fg_nav.commands.shared import Answer, Target, choose_reading, name_walk
from fg_nav.lab.allan import NoisePart, RecordingNoise, measure_recording_noise
from fg_nav.lab.drawing import AXES, UNITS, plot_allan
from fg_nav.lab.verbs import AllanRequest
from fg_nav.report.files import write_json
from fg_nav.report.plots.style import save
from fg_nav.report.terminal import console, ruled_table
from fg_nav.text import find_version

ALLAN_FILES = frozenset({"allan.json", "allan.png"})


def allan(request: AllanRequest) -> Answer:
    """Measure the noise in a recording of a sensor lying still, and write it into a folder."""
    file = request.recording
    with Target(request.out, request.force, f"{name_walk(file)}-allan", ALLAN_FILES) as target:
        noise = measure_recording_noise(choose_reading(request).read(file))
        described = describe_noise(noise, file)
        with target.open() as folder:
            save(plot_allan(noise), folder / "allan.png")
            write_json(folder / "allan.json", described)
    return Answer({"folder": str(target.place), **described}, partial(print_allan, noise, target.place))


def describe_noise(noise: RecordingNoise, source: Path) -> dict[str, Any]:
    """Return the Allan result for JSON: N per sqrt(Hz) and K per sqrt(s), B plain; in rad/s, m/s^2, uT."""
    sensors: dict[str, dict[str, Any]] = {}
    for one in noise.sensors:
        sensors[one.sensor] = {"rate_hz": one.rate_hz}
        for axis, curve, fit in zip(AXES, one.curves, one.fits, strict=True):
            parts = {"N": fit.white, "B": fit.flicker, "K": fit.walk}
            figures = {name: getattr(fit, name) for name in ("lowest", "lowest_tau_s", "fitted_from_s", "misfit")}
            measured = {"tau_s": curve.tau_s, "deviation": curve.deviation, "low": fit.low, "high": fit.high}
            sensors[one.sensor][axis] = parts | figures | measured
    known = {"version": find_version(), "recording": str(source)}
    return {**known, "start_s": noise.start_s, "seconds": noise.seconds, "sensors": sensors}


def print_allan(noise: RecordingNoise, place: Path) -> None:
    """Print N, B, K and the lowest point per sensor and axis, and where the files are."""
    out = console()
    out.print(f"at rest for {noise.seconds:.0f} s from {noise.start_s:.1f} s on", soft_wrap=True)
    for one in noise.sensors:
        unit = UNITS[one.sensor]
        heads = (f"N ({unit.white})", f"B ({unit.level})", f"K ({unit.walk})", f"lowest ({unit.level})")
        shown = ruled_table(f"{unit.title}, {one.rate_hz:.0f} Hz", *heads, "at (s)", "fit from (s)")
        for axis, fit in zip(AXES, one.fits, strict=True):
            parts = ((fit.white, unit.per_white), (fit.flicker, unit.per_level), (fit.walk, unit.per_walk))
            lowest = (f"{fit.lowest * unit.per_level:.3g}", f"{fit.lowest_tau_s:.3g}", f"{fit.fitted_from_s:.2g}")
            shown.add_row(axis, *(format_part(*part) for part in parts), *lowest)
        out.print(shown)
    out.print(
        "N white noise (sheets with one-sided densities print 1.41 N), B flicker (the curve's floor is 0.66 B), K "
        "random walk. '< x': not seen in this record, and with 95 % not above x.",
        soft_wrap=True,
    )
    print_place([], place)


def format_part(part: NoisePart, factor: float) -> str:
    """Value and sigma, both to the sigma's second digit but not finer than four digits of the value."""
    if not part.seen:
        return f"< {part.limit * factor:.2g}"
    value, sigma = part.value * factor, part.sigma * factor
    places = max(0, int(np.ceil(1 - np.log10(max(sigma, 1e-4 * value, 1e-12)))))
    return f"{value:.{places}f} ± {sigma:.{places}f}"


def print_place(notes: Sequence[str], place: Path) -> None:
    """Print the notes, and the places of files and pictures."""
    out = console()
    for note in notes:
        out.print(f"note: {note}", soft_wrap=True)
    out.print(f"files: {place}", soft_wrap=True)
    pictures = sorted(path.name for path in place.glob("*.png"))
    if pictures:
        out.print(f"pictures: {', '.join(pictures)}", soft_wrap=True)
