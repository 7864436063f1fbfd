"""`fg-nav calibrate`: errors of a sensor, with their effect on its readings."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from fg_nav.calibration import UPPER
from fg_nav.calibration.inertial import (
    ALONE,
    average_gyroscopes,
    calibrate_gyroscope,
    read_walk_bias,
)
from fg_nav.calibration.of_recording import (
    Calibration,
    CalibrationResult,
    check_method,
    is_calibration,
    write_calibration,
)
from fg_nav.calibration.of_recording import calibrate as calibrate_recording
from fg_nav.commands.requests import CalibrateRequest
from fg_nav.commands.shared import Answer, choose_reading
from fg_nav.earth import Place, compute_field
from fg_nav.errors import CalibrationError, DetectionError, EstimationError
from fg_nav.magnetic.axes import MagAxes
from fg_nav.pipeline import navigate
from fg_nav.report.folder import check_file_free, result_file
from fg_nav.report.terminal import console, listing, ruled_table
from fg_nav.walk import Options


def calibrate(request: CalibrateRequest) -> Answer:
    """Calibrate by a recording, the gyroscope by all of several, and write the calibration into a file."""
    out, strength_uT, reading = request.out, request.strength, choose_reading(request)
    if request.method is not None:
        check_method(request.method)
    check_file_free(out, is_calibration, request.force)
    axes = None if request.mag_axes is None else MagAxes.parse(request.mag_axes)
    # The strength of the field as given, or that of a place.
    if strength_uT is not None and request.place is not None:
        raise CalibrationError("--strength and --place both give the strength of the field: give one of them.")
    if strength_uT is not None and not 5.0 <= strength_uT <= 200.0:
        raise CalibrationError(f"a field of {strength_uT:g} uT is none on Earth (25 to 65): give its strength in uT.")
    if request.place is not None:
        strength_uT = compute_field(Place.parse(request.place)).strength_uT
    first, *others = [reading.read(file) for file in request.recordings]
    # The mean bias of the gyroscope over several recordings: walks, each solved on its own, and rests.
    biases = []
    for recording in (first, *others) if others else ():
        try:
            biases.append(read_walk_bias(navigate(recording, options=Options(changes=ALONE))))
        except (DetectionError, EstimationError):
            at_rest = calibrate_gyroscope(recording)
            if at_rest is None:
                raise
            biases.append(at_rest)
    sensor = average_gyroscopes(biases) if biases else None
    found = calibrate_recording(first, request.method, strength_uT, axes, sensor)
    with result_file(out, is_calibration, request.force) as fresh:
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
    use = f"fg-nav run RECORDING --calibration {place}{axes}"
    is_harmful = effect is not None and effect.is_harmful
    if is_harmful:
        words = (
            "corrected by it, this recording's readings scatter more than raw: leave it, and calibrate by a walked loop"
        )
        rows.insert(0, ("caution", words))
    rows += [("file", str(place)), *([] if is_harmful else [("to use it", use)])]
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
