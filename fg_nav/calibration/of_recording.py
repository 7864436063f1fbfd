"""All calibrations that one recording allows, and their file.

Magnetometer by one of four methods (docs/magnetic.md), gyroscope, accelerometer at rest.

The file is JSON (`docs/formats.md`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar, get_type_hints

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Strict, ValidationError, create_model

from fg_nav.arrays import Floats
from fg_nav.calibration import MagnetometerCalibration, circular_sd_deg, correct_field
from fg_nav.calibration.ellipsoid import calibrate_on_loop, fit_ellipsoid, fit_unit_sphere, is_near
from fg_nav.calibration.inertial import (
    AccelerometerCalibration,
    GyroscopeCalibration,
    calibrate_accelerometer,
    calibrate_gyroscope,
)
from fg_nav.calibration.walk import calibrate_on_walk
from fg_nav.calibration.walk_model import read_strides
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError, DetectionError, MagneticError, describe_reason
from fg_nav.magnetic import average_footfall_field
from fg_nav.magnetic.axes import MagAxes, align_magnetometer
from fg_nav.recording import Recording
from fg_nav.text import find_version, read_small, to_json

FORMAT = "fg-nav calibration"
VERSION = 2  # Of the file; a reader refuses what is newer.
MAX_HARD_IRON_UT, MAX_GAIN = 10_000.0, 10.0  # Of a magnetometer: twice the range of phones', and a gain of no part.
MAX_BIAS, MAX_SCALE = 5.0, 1.5  # Of gyroscope (rad/s), accelerometer (m/s^2) and its scale: a third would be a unit.

Part = TypeVar("Part")


@dataclass(frozen=True)
class Calibration:
    """Calibrations of a recording's sensors; None for a part that it did not show.

    `recording` is the name of the file it came from, the first one of several.
    """

    recording: str | None = None
    magnetometer: MagnetometerCalibration | None = None
    gyroscope: GyroscopeCalibration | None = None
    accelerometer: AccelerometerCalibration | None = None

    def corrects(self, with_mag: bool) -> tuple[str, ...]:
        """Names of the sensors that it corrects; `with_mag` where the magnetometer is used."""
        words = []
        if self.magnetometer is not None and with_mag:
            words.append(f"magnetometer ({self.magnetometer.method})")
        if self.accelerometer is not None and self.accelerometer.separable:
            words.append("accelerometer")
        return tuple(words)


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a calibration; an older file is replaced."""
    content = {"format": FORMAT, "version": VERSION, "made_by": f"fg-nav {find_version()}", **to_json(calibration)}
    path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def is_calibration(path: Path) -> bool:
    """Whether a file was written here, even if it is damaged since."""
    with path.open("rb") as file:
        return FORMAT.encode() in file.read(100)


def read_calibration(path: Path) -> Calibration:
    """Read a calibration; raises `CalibrationError` if the file is none, of a newer version, or damaged."""
    try:
        content = json.loads(read_small(path).decode("utf-8"))
    except FileNotFoundError:
        raise CalibrationError(f"{path} does not exist: check the path of the calibration.") from None
    except IsADirectoryError:
        raise CalibrationError(f"{path} is a directory: give the calibration in it.") from None
    except OSError as error:
        reason = describe_reason(error)
        raise CalibrationError(f"{path} cannot be read ({reason}): give one of `fg-nav calibrate`.") from None
    except (ValueError, RecursionError):
        raise CalibrationError(f"{path.name} is no JSON, or damaged: calibrate again.") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CalibrationError(f"{path.name} is no calibration: give a file that `fg-nav calibrate` wrote.")
    if content.get("version") != VERSION:
        raise CalibrationError(
            f"{path.name} is a calibration of version {content.get('version')}, and version {VERSION} is read here: "
            "calibrate again, or use a newer fg-nav."
        )
    recording = content.get("recording")
    return Calibration(
        recording if isinstance(recording, str) else None,
        _read_part(path, content, "magnetometer", MagnetometerCalibration),
        _read_part(path, content, "gyroscope", GyroscopeCalibration),
        _read_part(path, content, "accelerometer", AccelerometerCalibration),
    )


def _read_part(path: Path, content: Mapping[str, Any], name: str, kind: type[Part]) -> Part | None:
    """Restore a dataclass of numbers, arrays and texts from JSON; None where the part is null."""
    part = content.get(name)
    if part is None:
        return None
    types: dict[str, Any] = {field: (_AS_JSON[hint], ...) for field, hint in get_type_hints(kind).items()}
    try:
        found = kind(**dict(create_model(kind.__name__, **types).model_validate(part)))
    except CalibrationError as error:
        raise CalibrationError(f"{path.name}: {error}") from None
    except ValidationError as error:
        where = "".join(f" at '{key}'" for key in error.errors()[0]["loc"][:1])
        raise CalibrationError(f"{path.name} is damaged in its part '{name}'{where}: calibrate again.") from None
    except (ValueError, OverflowError):
        raise CalibrationError(f"{path.name} is damaged in its part '{name}': calibrate again.") from None
    if not _is_possible(found):
        raise CalibrationError(f"{path.name} has values in its part '{name}' that cannot be: calibrate again.")
    return found


def _is_possible(part: object) -> bool:
    """Whether the values are within the limits of sensors, and a covariance has valid correlations."""
    if isinstance(part, MagnetometerCalibration):
        gain, covariance = np.linalg.eigvalsh(part.correction), part.covariance
        if gain.min() < 1 / MAX_GAIN or gain.max() > MAX_GAIN or np.abs(part.hard_iron_uT).max() > MAX_HARD_IRON_UT:
            return False
        variance = np.diag(covariance)
        if variance.min() < 0.0 or np.abs(covariance).max() > MAX_HARD_IRON_UT**2:
            return False
        within = np.abs(covariance) <= 1.001 * np.sqrt(np.outer(variance, variance)) + 1e-12
        return bool(within.all() and np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-9))
    assert isinstance(part, GyroscopeCalibration | AccelerometerCalibration)
    if part.bias.shape != (3,) or not (np.abs(part.bias) <= MAX_BIAS).all():
        return False
    if isinstance(part, GyroscopeCalibration):
        return 0.0 < part.next_sigma <= MAX_BIAS
    return 1 / MAX_SCALE <= part.scale <= MAX_SCALE


# null is an infinite sigma
_Number: TypeAlias = Annotated[float, Strict(), BeforeValidator(lambda value: np.inf if value is None else value)]

_AS_JSON: Mapping[object, object] = {
    str: Annotated[str, Strict()],
    int: Annotated[int, Strict()],
    bool: Annotated[bool, Strict()],
    float: _Number,
    Floats: Annotated[
        list[_Number] | list[list[_Number]], AfterValidator(lambda rows: np.array(rows, dtype=np.float64))
    ],
    tuple[str, ...]: tuple[Annotated[str, Strict()], ...],
}  # JSON type of each type of a part.


ON_FOOT = ("walk", "levelled")
TUMBLED = ("ellipsoid", "sphere")
METHODS = ON_FOOT + TUMBLED

TUMBLED_BELOW = 0.65  # Mean direction of up of a sensor turned over: 0 evenly, 0.5 by hand (BROAD), feet 0.75 to 0.94.


@dataclass(frozen=True)
class Effect:
    """Effect of a calibration on its own readings, outliers left out."""

    strength_before_uT: float  # Standard deviation of |B|.
    strength_after_uT: float
    heading_before_deg: float = float("nan")  # Circular sd of compass minus gyroscope, drift included, at footfalls.
    heading_after_deg: float = float("nan")

    @property
    def is_harmful(self) -> bool:
        """Whether strength and heading together, as far as known, scatter more after than before."""
        before = self.strength_before_uT, self.heading_before_deg
        after = self.strength_after_uT, self.heading_after_deg
        return bool(np.nanprod(np.divide(after, before)) > 1.0)


@dataclass(frozen=True)
class CalibrationResult:
    """A calibration, the reason of its method, and its effect on its own readings."""

    calibration: Calibration
    choice: str
    effect: Effect | None  # None where the magnetometer is not calibrated.
    axes: MagAxes | None = None  # Of the magnetometer, where given: what is calibrated is in those of the gyroscope.
    remarks: tuple[str, ...] = ()  # On its axes and its delay.


def calibrate(
    recording: Recording,
    method: str | None = None,
    strength_uT: float | None = None,
    axes: MagAxes | None = None,
    sensor: GyroscopeCalibration | None = None,
) -> CalibrationResult:
    """Calibrate the sensors of a recording.

    Without a magnetometer, or where the sensor lies still, gyroscope and accelerometer alone, unless more was asked
    for; else raises `CalibrationError`, or `DetectionError` and `MagneticError` for a method on foot.

    Parameters
    ----------
    method : one of `METHODS`; None for `ellipsoid` where up goes round all of the sensor's axes, else `walk`.
    strength_uT : of the field at the place, for a sensor that was turned over; None if it is not known.
    axes : of the magnetometer in those of the gyroscope; None for the same.
    sensor : gyroscope by several recordings, this the first of them: the magnetometer need not be calibrated then.
    """
    gyroscope = calibrate_gyroscope(recording) if sensor is None else sensor
    path = recording.provenance.path
    found = Calibration(None if path is None else path.name, None, gyroscope, calibrate_accelerometer(recording))
    try:
        return _calibrate_magnetometer(recording, found, method, strength_uT, axes)
    except (CalibrationError, DetectionError, MagneticError) as error:
        is_asked_for = (method, strength_uT, axes) != (None, None, None)
        if gyroscope is None or is_asked_for or (sensor is None and recording.mag is not None and _walks(recording)):
            raise
        reason = "there is none" if recording.mag is None else error
        return CalibrationResult(found, f"without the magnetometer: {reason}", None)


def _walks(recording: Recording) -> bool:
    """Whether it has footfalls."""
    try:
        return detect_stances(recording).n_footfalls > 1
    except DetectionError:
        return False


def _calibrate_magnetometer(
    recording: Recording, others: Calibration, method: str | None, strength_uT: float | None, axes: MagAxes | None
) -> CalibrationResult:
    """Return the calibration `others` with the magnetometer added, the method, why, and its effect."""
    if recording.mag is None:
        raise CalibrationError("the recording has no magnetometer to calibrate: record it with one, or lying still.")
    # the method as given, or by the mean direction of the specific force in the body
    if method is not None:
        check_method(method)
        name, choice = method, f"{method}, as given"
    else:
        size = np.linalg.norm(recording.acc, axis=1)
        felt = size > 0.0
        if float(np.linalg.norm((recording.acc[felt] / size[felt, None]).mean(axis=0))) < TUMBLED_BELOW:
            name, choice = "ellipsoid", "ellipsoid, for the sensor was turned over in all directions"
        else:
            name, choice = "walk", "walk, for the sensor stayed upright"
    if strength_uT is not None and name in ON_FOOT:
        raise CalibrationError(
            f"the method '{name}' has no use for the strength of the field: leave it out, or take "
            f"{' or '.join(TUMBLED)}."
        )
    recording = recording if axes is None else axes.apply_to(recording)
    aligned = align_magnetometer(recording, axes is not None)
    if aligned.recording.mag is None:
        raise CalibrationError(f"{aligned.notes[0]}.")
    if name in ON_FOOT:
        stances = detect_stances(aligned.recording)
        field = average_footfall_field(aligned.recording, stances)
        if name == "walk":
            found = calibrate_on_walk(read_strides(aligned.recording, stances))
        else:
            found = calibrate_on_loop(field)[1]
        fields = (field, correct_field(field, found))
        spread = [float(np.nanstd(one.strength)) for one in fields]
        effect = Effect(*spread, *(circular_sd_deg(one.heading_difference) for one in fields))
        return CalibrationResult(replace(others, magnetometer=found), choice, effect, axes, aligned.notes)
    # strengths need no stamps: readings of a sensor that was turned over stay as they are
    assert recording.mag is not None
    if name == "ellipsoid":
        found = fit_ellipsoid(recording.mag, strength_uT)
    else:
        if strength_uT is None:  # det C = 1, as for the ellipsoid
            strength_uT = float(np.linalg.det(fit_unit_sphere(recording.mag).correction) ** (-1 / 3))
        found = fit_unit_sphere(recording.mag, strength_uT)
    readings = recording.mag[np.isfinite(recording.mag).all(axis=1)]
    before, after = (np.linalg.norm(mag, axis=1) for mag in (readings, found.correct(readings)))
    kept = is_near(after - found.strength_uT)
    effect = Effect(float(np.nanstd(before[kept])), float(np.nanstd(after[kept])))
    return CalibrationResult(replace(others, magnetometer=found), choice, effect, axes)


def check_method(method: str) -> None:
    """Raise `CalibrationError` if there is no such method."""
    if method not in METHODS:
        raise CalibrationError(f"there is no method '{method}' of calibration: choose one of {', '.join(METHODS)}.")
