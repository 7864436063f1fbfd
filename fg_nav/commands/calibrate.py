"""`fg-nav calibrate` and `allan`: errors of a sensor with their effect on its readings, and its noise."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fg_nav.calibration.allan import NoisePart, RecordingNoise, measure_recording_noise
from fg_nav.calibration.inertial import (
    ALONE,
    GyroscopeCalibration,
    average_gyroscopes,
    calibrate_gyroscope,
    read_walk_bias,
)
from fg_nav.calibration.magnetometer import UPPER
from fg_nav.calibration.of_recording import (
    Calibration,
    CalibrationResult,
    check_method,
    is_calibration,
    write_calibration,
)
from fg_nav.calibration.of_recording import calibrate as calibrate_recording
from fg_nav.commands import Answer, Target, find_earth_field, name_walk
from fg_nav.errors import CalibrationError, DetectionError, EstimationError
from fg_nav.io import Reading
from fg_nav.magnetic.axes import MagAxes
from fg_nav.pipeline import navigate
from fg_nav.recording import Recording
from fg_nav.report.files import write_json
from fg_nav.report.folder import ALLAN_FILES, check_file_free, result_file
from fg_nav.report.plots.sensor import AXES, UNITS, plot_allan
from fg_nav.report.plots.style import save
from fg_nav.report.terminal import console, listing, print_place, ruled_table
from fg_nav.text import find_version
from fg_nav.walk import Options


def calibrate(
    files: Sequence[Path],
    out: Path,
    method: str | None,
    strength_uT: float | None,
    place: str | None,
    mag_axes: str | None,
    reading: Reading,
    force: bool,
) -> Answer:
    """Calibrate by a recording, the gyroscope by all of several, and write the calibration into a file."""
    if method is not None:
        check_method(method)
    check_file_free(out, is_calibration, force)
    axes = None if mag_axes is None else MagAxes.parse(mag_axes)
    # The strength of the field as given, or that of a place.
    if strength_uT is not None and place is not None:
        raise CalibrationError("--strength and --place both give the strength of the field: give one of them.")
    if strength_uT is not None and not 5.0 <= strength_uT <= 200.0:
        raise CalibrationError(f"a field of {strength_uT:g} uT is none on Earth (25 to 65): give its strength in uT.")
    earth = find_earth_field(place)
    strength_uT = strength_uT if earth is None else earth.strength_uT
    first, *others = [reading.read(file) for file in files]
    sensor = calibrate_sensor([first, *others]) if others else None
    found = calibrate_recording(first, method, strength_uT, axes, sensor)
    with result_file(out, is_calibration, force) as fresh:
        write_calibration(fresh, found.calibration)
    content = {
        "file": str(out),
        "method": found.choice,
        "mag_axes": None if found.axes is None else str(found.axes),
        "effect": found.effect,
        "remarks": found.remarks,
        "calibration": json.loads(out.read_text(encoding="utf-8")),
    }
    return Answer(content, partial(print_calibration, found, out))


def calibrate_sensor(recordings: Sequence[Recording]) -> GyroscopeCalibration:
    """Return the mean gyroscope bias over recordings of one sensor: walks, each solved on its own, and rests.

    Raises `FgNavError` for a recording that neither walks nor rests.
    """
    found = []
    for recording in recordings:
        try:
            found.append(read_walk_bias(navigate(recording, options=Options(changes=ALONE))))
        except (DetectionError, EstimationError):
            at_rest = calibrate_gyroscope(recording)
            if at_rest is None:
                raise
            found.append(at_rest)
    return average_gyroscopes(found)


def print_calibration(found: CalibrationResult, place: Path) -> None:
    """Print parameters, effect on the readings themselves and notes, where the file is and how to use it."""
    out = console()
    table = ruled_table("parameter", "value", "sigma")
    for row in list_parameters(found.calibration):
        table.add_row(*row)
    out.print(table)
    out.print()
    effect, magnetometer, change = found.effect, found.calibration.magnetometer, "{0:.2f} {2} before, {1:.2f} {2} after"
    rows = [("method", found.choice)]
    if effect is not None:
        words = change.format(effect.strength_before_uT, effect.strength_after_uT, "uT")
        rows.append(("strength of the field, sd", words))
    if effect is not None and np.isfinite(effect.heading_before_deg):
        words = change.format(effect.heading_before_deg, effect.heading_after_deg, "deg")
        rows.append(("compass - gyroscope, circular sd", words))
    rows += [("magnetometer" if i == 0 else "", remark) for i, remark in enumerate(found.remarks)]
    if magnetometer is not None:
        rows.append(("residual", f"{magnetometer.residual_uT:.3g} uT over {magnetometer.samples} readings"))
        rows += [("notes" if i == 0 else "", note) for i, note in enumerate(magnetometer.notes)]
    axes = "" if found.axes is None else f" --mag-axes={found.axes}"
    rows += [("file", str(place)), ("to use it", f"fg-nav run RECORDING --calibration {place}{axes}")]
    out.print(listing(rows), soft_wrap=True)


def list_parameters(found: Calibration) -> Iterator[tuple[str, str, str]]:
    """Yield name with unit, value and sigma of every calibrated parameter."""
    magnetometer, gyroscope, accelerometer = found.magnetometer, found.gyroscope, found.accelerometer
    if magnetometer is not None:
        for name, value, sigma in zip("xyz", magnetometer.hard_iron_uT, magnetometer.sigma[:3], strict=True):
            yield f"hard iron {name} (uT)", f"{value:.2f}", f"{sigma:.2f}"
        for i, j, sigma in zip(*UPPER, magnetometer.sigma[3:], strict=True):
            yield f"correction {'xyz'[i]}{'xyz'[j]}", f"{magnetometer.correction[i, j]:.4f}", f"{sigma:.4f}"
    if gyroscope is not None:
        for name, value, sigma in zip("xyz", np.degrees(gyroscope.bias), np.degrees(gyroscope.sigma), strict=True):
            yield f"gyro bias {name} (deg/s)", f"{value:.3f}", f"{sigma:.3f}"
        yield "of another recording, about it (deg/s)", "0", f"{np.degrees(gyroscope.next_sigma):.3f}"
    if accelerometer is not None and accelerometer.separable:
        yield "acc scale", f"{accelerometer.scale:.4f}", f"{accelerometer.scale_sigma:.4f}"
        for name, value, sigma in zip("xyz", accelerometer.bias, accelerometer.bias_sigma, strict=True):
            yield f"acc bias {name} (m/s^2)", f"{value:.3f}", f"{sigma:.3f}"
    elif accelerometer is not None:
        yield "acc at rest, over gravity", f"{accelerometer.scale:.4f}", "-"


def allan(file: Path, reading: Reading, out: Path | None, force: bool) -> Answer:
    """Measure the noise in a recording of a sensor lying still, and write it into a folder."""
    with Target(out, force, f"{name_walk(file)}-allan", ALLAN_FILES) as target:
        noise = measure_recording_noise(reading.read(file))
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
            sensors[one.sensor][axis] = {
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
