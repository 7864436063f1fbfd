"""All calibrations that one recording allows, and the file that keeps them.

Magnetometer by one of four methods, gyroscope, accelerometer at rest.

========== ================================= ======================================================================
method     what it needs                     module
========== ================================= ======================================================================
walk       an ordinary walk that turns       `fg_nav.calibration.walk`
levelled   a loop in an undisturbed place    `fg_nav.calibration.ellipse_fit` (Ma 2018, robust)
ellipsoid  the sensor turned over, no walk   `fg_nav.calibration.ellipsoid`
sphere     the same                          `fg_nav.calibration.ellipsoid` (Munoz Diaz 2017)
========== ================================= ======================================================================

If no method is given, `ellipsoid` is taken where up goes round all of the sensor's axes, else `walk`: only the user
knows that a place is undisturbed.

The file keeps what one recording showed of its sensors, for other recordings of the same sensor and shoe. It is JSON,
laid down in `docs/formats.md`. Numbers are written so that they are read back to the last bit; a part that the
recording did not show is null, and so is an infinite sigma. Units are those of the parts' own types.
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
from fg_nav.calibration.at_rest import (
    AccelerometerCalibration,
    GyroscopeCalibration,
    calibrate_accelerometer,
    calibrate_gyroscope,
)
from fg_nav.calibration.ellipse_fit import calibrate_on_loop
from fg_nav.calibration.ellipsoid import fit_ellipsoid, fit_unit_sphere
from fg_nav.calibration.magnetometer import MagnetometerCalibration, circular_sd_deg, correct_field
from fg_nav.calibration.quadric import is_near
from fg_nav.calibration.stride_readings import read_strides
from fg_nav.calibration.walk import calibrate_on_walk
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError, DetectionError, MagneticError, describe_reason
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.axes import MagAxes, align_magnetometer
from fg_nav.recording import Recording
from fg_nav.text import find_version, read_small, to_json

FORMAT = "fg-nav calibration"
VERSION = 2  # Of the file; a reader refuses what is newer.

MAX_HARD_IRON_UT, MAX_GAIN = 10_000.0, 10.0
"""Of a magnetometer: twice the range of those in phones and feet, and a gain that no maker sells."""

MAX_BIAS, MAX_SCALE = 5.0, 1.5
"""Of gyroscope (rad/s) and accelerometer (m/s^2), and of the latter's scale: a third is no error but a unit."""

Part = TypeVar("Part")
AtRest = TypeVar("AtRest", GyroscopeCalibration | None, AccelerometerCalibration | None)


@dataclass(frozen=True)
class Calibration:
    """What a recording showed of its sensors; None for a part that it did not show.

    `recording` is the name of the file it came from, the first one of several.
    """

    recording: str | None = None
    magnetometer: MagnetometerCalibration | None = None
    gyroscope: GyroscopeCalibration | None = None
    accelerometer: AccelerometerCalibration | None = None

    def corrects(self, with_mag: bool) -> tuple[str, ...]:
        """Say what it corrects; `with_mag` where the magnetometer is used."""
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
    """Read a calibration.

    Raises `CalibrationError` if the file cannot be read, is no calibration, is of a newer version, or lacks what it
    should have.
    """
    content = _read_json(path)
    recording = content.get("recording")
    return Calibration(
        recording if isinstance(recording, str) else None,
        _check_magnetometer(path, _read_part(path, content, "magnetometer", MagnetometerCalibration)),
        _check_at_rest(path, "gyroscope", _read_part(path, content, "gyroscope", GyroscopeCalibration)),
        _check_at_rest(path, "accelerometer", _read_part(path, content, "accelerometer", AccelerometerCalibration)),
    )


def _read_json(path: Path) -> Mapping[str, Any]:
    content = _parse(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CalibrationError(f"{path.name} is no calibration: give a file that `fg-nav calibrate` wrote.")
    if content.get("version") != VERSION:
        raise CalibrationError(
            f"{path.name} is a calibration of version {content.get('version')}, and version {VERSION} is read here: "
            "calibrate again, or use a newer fg-nav."
        )
    return content


def _parse(path: Path) -> object:
    try:
        return json.loads(read_small(path).decode("utf-8"))
    except FileNotFoundError:
        raise CalibrationError(f"{path} does not exist: check the path of the calibration.") from None
    except IsADirectoryError:
        raise CalibrationError(f"{path} is a directory: give the calibration in it.") from None
    except OSError as error:
        reason = describe_reason(error)
        raise CalibrationError(f"{path} cannot be read ({reason}): give one of `fg-nav calibrate`.") from None
    except (ValueError, RecursionError):
        raise CalibrationError(f"{path.name} is no JSON, or damaged: calibrate again.") from None


def _read_part(path: Path, content: Mapping[str, Any], name: str, kind: type[Part]) -> Part | None:
    part = content.get(name)
    if part is None:
        return None
    try:
        return _restore(kind, part)
    except CalibrationError as error:
        raise CalibrationError(f"{path.name}: {error}") from None
    except ValidationError as error:
        where = "".join(f" at '{key}'" for key in error.errors()[0]["loc"][:1])
        raise CalibrationError(f"{path.name} is damaged in its part '{name}'{where}: calibrate again.") from None
    except (ValueError, OverflowError):
        raise CalibrationError(f"{path.name} is damaged in its part '{name}': calibrate again.") from None


def _check_magnetometer(path: Path, part: MagnetometerCalibration | None) -> MagnetometerCalibration | None:
    """Refuse what no sensor has: a hard iron beyond its range, a gain far from one, a covariance that is none."""
    if part is not None and not (_is_of_a_sensor(part) and _is_covariance(part.covariance)):
        raise CalibrationError(f"{path.name} has values in its part 'magnetometer' that cannot be: calibrate again.")
    return part


def _is_of_a_sensor(part: MagnetometerCalibration) -> bool:
    gain = np.linalg.eigvalsh(part.correction)
    is_near = gain.min() >= 1 / MAX_GAIN and gain.max() <= MAX_GAIN
    return bool(is_near and np.abs(part.hard_iron_uT).max() <= MAX_HARD_IRON_UT)


def _is_covariance(covariance: Floats) -> bool:
    """Whether it is symmetric, and no entry is larger than its variances allow."""
    variance = np.diag(covariance)
    if variance.min() < 0.0 or np.abs(covariance).max() > MAX_HARD_IRON_UT**2:
        return False
    within = np.abs(covariance) <= 1.001 * np.sqrt(np.outer(variance, variance)) + 1e-12
    return bool(within.all() and np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-9))


def _check_at_rest(path: Path, name: str, part: AtRest) -> AtRest:
    """Refuse a bias that is no vector, and a scale that would turn a sensor round."""
    if part is not None:
        scale = part.scale if isinstance(part, AccelerometerCalibration) else 1.0
        sigma = part.next_sigma if isinstance(part, GyroscopeCalibration) else 1.0
        whole = part.bias.shape == (3,) and 0.0 < sigma <= MAX_BIAS
        if not (whole and (np.abs(part.bias) <= MAX_BIAS).all() and 1 / MAX_SCALE <= scale <= MAX_SCALE):
            raise CalibrationError(f"{path.name} has values in its part '{name}' that cannot be: calibrate again.")
    return part


def _restore(kind: type[Part], part: object) -> Part:
    """Build a dataclass of numbers, arrays and texts from what JSON made of it; raises `ValidationError`."""
    types: dict[str, Any] = {name: (_AS_JSON[hint], ...) for name, hint in get_type_hints(kind).items()}
    return kind(**dict(create_model(kind.__name__, **types).model_validate(part)))


_Number: TypeAlias = Annotated[float, Strict(), BeforeValidator(lambda value: np.inf if value is None else value)]
"""Null is an infinite sigma."""

_AS_JSON: Mapping[object, object] = {
    str: Annotated[str, Strict()],
    int: Annotated[int, Strict()],
    bool: Annotated[bool, Strict()],
    float: _Number,
    Floats: Annotated[
        list[_Number] | list[list[_Number]], AfterValidator(lambda rows: np.array(rows, dtype=np.float64))
    ],
    tuple[str, ...]: tuple[Annotated[str, Strict()], ...],
}
"""What each type of a part is in JSON."""


ON_FOOT = ("walk", "levelled")
TUMBLED = ("ellipsoid", "sphere")
METHODS = ON_FOOT + TUMBLED

TUMBLED_BELOW = 0.65
"""Length of the mean direction of up below which a sensor was turned over: 0 for an even tumbling, about 0.5 where
somebody turned it by hand (BROAD); at feet of simulated and real walks 0.75 to 0.94."""


@dataclass(frozen=True)
class Effect:
    """What a calibration does to the readings it was made from, outliers left out.

    Attributes
    ----------
    strength_before_uT, strength_after_uT : standard deviation of |B| over them.
    heading_before_deg, heading_after_deg : circular standard deviation of compass minus gyroscope at the footfalls,
        the gyroscope's drift with it; NaN for a sensor that was turned over.
    """

    strength_before_uT: float
    strength_after_uT: float
    heading_before_deg: float = float("nan")
    heading_after_deg: float = float("nan")


@dataclass(frozen=True)
class CalibrationResult:
    """A calibration, why its method was taken, and what it does to its own readings.

    `effect` is None where the magnetometer is not calibrated; `axes` of it where they were given: the calibration is of
    readings in those of the gyroscope. `remarks` are on its axes and its delay.
    """

    calibration: Calibration
    choice: str
    effect: Effect | None
    axes: MagAxes | None = None
    remarks: tuple[str, ...] = ()


def calibrate(
    recording: Recording,
    method: str | None = None,
    strength_uT: float | None = None,
    axes: MagAxes | None = None,
    sensor: GyroscopeCalibration | None = None,
) -> CalibrationResult:
    """Calibrate what can be calibrated from a recording.

    Without a magnetometer, or where the sensor lies still, gyroscope and accelerometer alone, unless more was asked
    for; else raises `CalibrationError` without a magnetometer or with wrong axes that were not given, for a method that
    is none, a strength that the method cannot use, or where the recording does not show the magnetometer's errors;
    raises `DetectionError` and `MagneticError` for a method on foot, where there are no footfalls or none with a field.

    Parameters
    ----------
    recording : with a magnetometer.
    method : one of `METHODS`; None to choose by the recording.
    strength_uT : of the field at the place, for a sensor that was turned over; None if it is not known.
    axes : of the magnetometer in those of the gyroscope; None for the same.
    sensor : gyroscope by several recordings of the sensor, this the first of them; None to take it from this one. The
        magnetometer may then be one that does not show its errors.
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
    try:
        return detect_stances(recording).n_footfalls > 1
    except DetectionError:
        return False


def _calibrate_magnetometer(
    recording: Recording, others: Calibration, method: str | None, strength_uT: float | None, axes: MagAxes | None
) -> CalibrationResult:
    """Add the magnetometer to the other sensors' calibration."""
    name, choice = _choose_method(recording, method)
    if strength_uT is not None and name in ON_FOOT:
        raise CalibrationError(
            f"the method '{name}' has no use for the strength of the field: leave it out, or take "
            f"{' or '.join(TUMBLED)}."
        )
    recording = recording if axes is None else axes.apply_to(recording)
    aligned = align_magnetometer(recording, axes is not None)
    if aligned.recording.mag is None:
        raise CalibrationError(f"{aligned.notes[0]}.")
    # strengths need no stamps: of a sensor that was turned over the readings stay as they are
    recording, remarks = (aligned.recording, aligned.notes) if name in ON_FOOT else (recording, ())
    magnetometer, effect = (
        _calibrate_on_foot(recording, name) if name in ON_FOOT else _calibrate_tumbled(recording, name, strength_uT)
    )
    return CalibrationResult(replace(others, magnetometer=magnetometer), choice, effect, axes, remarks)


def check_method(method: str) -> None:
    """Raise `CalibrationError` if there is no such method."""
    if method not in METHODS:
        raise CalibrationError(f"there is no method '{method}' of calibration: choose one of {', '.join(METHODS)}.")


def _choose_method(recording: Recording, method: str | None) -> tuple[str, str]:
    """Name of the method, and why."""
    if recording.mag is None:
        raise CalibrationError("the recording has no magnetometer to calibrate: record it with one, or lying still.")
    if method is not None:
        check_method(method)
        return method, f"{method}, as given"
    length = mean_direction_of_up(recording)
    if length < TUMBLED_BELOW:
        return "ellipsoid", "ellipsoid, for the sensor was turned over in all directions"
    return "walk", "walk, for the sensor stayed upright"


def mean_direction_of_up(recording: Recording) -> float:
    """Length of the mean of the specific force's directions in the body: 1 if it is always the same axis that is up."""
    size = np.linalg.norm(recording.acc, axis=1)
    felt = size > 0.0
    return float(np.linalg.norm((recording.acc[felt] / size[felt, None]).mean(axis=0)))


def _calibrate_on_foot(recording: Recording, name: str) -> tuple[MagnetometerCalibration, Effect]:
    stances = detect_stances(recording)
    field = average_footfall_field(recording, stances)
    found = calibrate_on_walk(read_strides(recording, stances)) if name == "walk" else calibrate_on_loop(field)[1]
    after = correct_field(field, found)
    return found, Effect(_scatter(field.strength), _scatter(after.strength), _spread(field), _spread(after))


def _calibrate_tumbled(
    recording: Recording, name: str, strength_uT: float | None
) -> tuple[MagnetometerCalibration, Effect]:
    assert recording.mag is not None
    find = fit_ellipsoid if name == "ellipsoid" else _fit_sphere
    found = find(recording.mag, strength_uT)
    readings = recording.mag[np.isfinite(recording.mag).all(axis=1)]
    before, after = (np.linalg.norm(mag, axis=1) for mag in (readings, found.correct(readings)))
    kept = is_near(after - found.strength_uT)
    return found, Effect(_scatter(before[kept]), _scatter(after[kept]))


def _fit_sphere(readings: Floats, strength_uT: float | None) -> MagnetometerCalibration:
    """To the unit sphere, and from it to the strength; if that is not known det C = 1, as for the ellipsoid."""
    if strength_uT is None:
        strength_uT = float(np.linalg.det(fit_unit_sphere(readings).correction) ** (-1 / 3))
    return fit_unit_sphere(readings, strength_uT)


def _scatter(values: Floats) -> float:
    return float(np.nanstd(values))


def _spread(field: FootfallField) -> float:
    difference = field.heading_difference
    return circular_sd_deg(difference[np.isfinite(difference)])
