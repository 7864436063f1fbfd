"""Errors of a recording's own sensor and mounting.

All at once and their file (`of_recording`); the magnetometer turned over and on a loop (`ellipsoid`), on a walk
(`walk`, with `walk_model`); gyroscope and accelerometer (`inertial`). It imports no estimator.

Iron of a magnetometer, which every method finds and whose correction is the same:

    reading = S B + h   (S soft iron, h hard iron; `fg_nav.lab.simulation.sensors.magnetometer`)
    B = C (reading - h),   C = S^-1

Readings alone determine the length of B and not its direction: C is known up to a rotation, and the symmetric one
represents all of them. Its parameters, in the order of the covariance, are

    h_x h_y h_z   C_xx C_xy C_xz C_yy C_yz C_zz.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import CalibrationError
from fg_nav.magnetic.footfall_field import FootfallField
from fg_nav.recording import Recording

UPPER = np.triu_indices(3)  # Of the six numbers of a symmetric matrix, row by row.

# Possible strengths of a field, whole and horizontal: Earth's has 22 to 67, below 3 horizontally only near its poles.
FIELD_UT, LEVEL_FIELD_UT = (5.0, 500.0), (3.0, 500.0)


def matrix_of(upper: Floats) -> Floats:
    """Symmetric matrix (2, 2) or (3, 3) from the three or six numbers of its upper half."""
    n = 2 if len(upper) == 3 else 3
    matrix = np.zeros((n, n))
    matrix[np.triu_indices(n)] = upper
    return matrix + np.triu(matrix, 1).T


def differentiate_inverse(matrix: Floats) -> Floats:
    """Derivatives (9, 9) of h and the inverse of a symmetric matrix (3, 3) by h and its six numbers: -M^-1 dM M^-1."""
    derivatives, inverse = np.eye(9), np.linalg.inv(matrix)
    derivatives[3:, 3:] = np.stack([-(inverse @ matrix_of(one) @ inverse)[UPPER] for one in np.eye(6)], axis=1)
    return derivatives


def check_strength(found_uT: float, allowed_uT: tuple[float, float] = FIELD_UT) -> None:
    """Refuse a field that Earth has nowhere: a dead magnetometer, one that was not turned, or another unit.

    Raises `CalibrationError` if the strength is not within those allowed.
    """
    low, high = allowed_uT
    if not low <= found_uT <= high:
        level = " over the ground" if allowed_uT == LEVEL_FIELD_UT else ""
        raise CalibrationError(
            f"the field found is {found_uT:.2g} uT strong{level}, and Earth and buildings make {low:g} to "
            f"{high:g} uT: does the magnetometer work, was it turned, and are its readings in uT?"
        )


@dataclass(frozen=True)
class MagnetometerCalibration:
    """A calibration and its covariance."""

    method: str  # By name.
    hard_iron_uT: Floats  # h (3,), in the body frame.
    correction: Floats  # C (3, 3), symmetric.
    covariance: Floats  # (9, 9) of the parameters in the order above, uT and 1; zero where a method sets one.
    strength_uT: float  # Of the field of the corrected readings.
    residual_uT: float  # rms of |B| - strength, or of another residual of the method, named in its notes.
    samples: int  # Number of readings.
    notes: tuple[str, ...] = ()  # Remarks for the user, the coverage verdict first.

    def __post_init__(self) -> None:
        for name, shape in (("hard_iron_uT", (3,)), ("correction", (3, 3)), ("covariance", (9, 9))):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise CalibrationError(f"{name} of a magnetometer calibration must be {shape} finite numbers.")
            object.__setattr__(self, name, value)
        if not np.allclose(self.correction, self.correction.T, rtol=0.0, atol=1e-9):
            raise CalibrationError("the correction of a magnetometer calibration must be symmetric.")
        if np.linalg.eigvalsh(self.correction).min() <= 0.0:
            raise CalibrationError("the correction of a magnetometer calibration turns a field round: it cannot be.")

    @property
    def parameters(self) -> Floats:
        """(9,) in the order of the covariance."""
        return np.concatenate([self.hard_iron_uT, self.correction[UPPER]])

    @property
    def sigma(self) -> Floats:
        """(9,) standard deviations of the parameters."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def correct(self, reading: Floats) -> Floats:
        """Field (..., 3) uT in the body frame, from readings (..., 3) uT; NaN rows stay."""
        return np.asarray((reading - self.hard_iron_uT) @ self.correction)

    def apply_to(self, recording: Recording) -> Recording:
        """Return the recording with its magnetometer corrected; raises `CalibrationError` if it has none."""
        if recording.mag is None:
            raise CalibrationError("the recording has no magnetometer that a calibration could correct.")
        return replace(recording, mag=self.correct(recording.mag))


def correct_field(field: FootfallField, calibration: MagnetometerCalibration) -> FootfallField:
    """Return the field at the footfalls with a corrected mean; scatter and slope stay."""
    return replace(field, body_field=calibration.correct(field.body_field))


def circular_sd_deg(angle: Floats) -> float:
    """Circular standard deviation, deg, of angles (N,) rad; NaN ones are left out."""
    resultant = min(float(np.abs(np.nanmean(np.exp(1j * angle)))), 1.0)
    return float(np.degrees(np.sqrt(-2 * np.log(max(resultant, 1e-12)))))


def mean_up(nav_R_body: Floats) -> Floats:
    """Mean direction (3,) of up in the body, of attitudes (F, 3, 3)."""
    up = nav_R_body[:, 2].sum(axis=0)
    return np.asarray(up / np.linalg.norm(up))
