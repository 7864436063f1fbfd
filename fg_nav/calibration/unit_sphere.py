"""Munoz Diaz's calibration: turn, shift and scale the ellipsoid of the readings to the unit sphere.

Munoz Diaz et al. 2017, section 3.2: plain algebraic least squares, which the paper does not print. Here, about the
readings' mean and in units of their spread,

    a . (squares and products of x) + b . x = 1        N equations, nine numbers

whose ellipsoid is |C (m - h)| = 1 (`fg_nav.calibration.quadric`). The axes of the ellipsoid are the rotation, 1 over
their lengths the scales; turned back afterwards the three are the symmetric C. The corrected readings have length 1,
not uT, as in the paper; the strength of the field at the place, if given, brings them to uT.

Simple, and less good than `fitted_ellipsoid`: it minimises no distance, the squared noise shifts it, one wild reading
spoils it, and nothing keeps it from a hyperboloid, which is refused. So is all that `fitted_ellipsoid` refuses:
directions not covered, a scatter that no sensor has, a field that Earth has not. The covariance is that of the
equations as they scatter (White 1980); it does not know of that shift.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.coverage import coverage_of
from fg_nav.calibration.ellipsoid import EllipsoidParameters, check_fit, check_given, readings_present
from fg_nav.calibration.magnetometer import UPPER, MagnetometerCalibration, matrix_of
from fg_nav.calibration.quadric import NO_ELLIPSOID, about_centre, design, distance, scaled, unscaled
from fg_nav.errors import CalibrationError


def unit_sphere(
    readings: Floats, strength_uT: float = 1.0, parameters: EllipsoidParameters = EllipsoidParameters()
) -> MagnetometerCalibration:
    """Calibrate from readings of a sensor turned about in a homogeneous field.

    Parameters
    ----------
    readings : (N, 3) uT in the body frame; NaN rows are left out.
    strength_uT : that the corrected readings shall have: 1 as the paper has it, or that of the field, for uT.
    parameters : when to refuse.

    Raises
    ------
    CalibrationError
        Where the readings are too few or lie on no ellipsoid, and as `fitted_ellipsoid`.
    """
    check_given(strength_uT)
    present = readings_present(readings, parameters.fewest)
    x, middle, scale = scaled(present)
    p, covariance = _plain_least_squares(_columns(x))
    to_strength = np.repeat([1.0, strength_uT], [3, 6])
    J = to_strength[:, None] * np.stack([_slope(p, k, middle, scale) for k in range(9)], axis=1)
    parts = to_strength * _parameters(p, middle, scale)
    found = _calibration(parts, J @ covariance @ J.T, strength_uT, present)
    coverage = coverage_of(present - found.hard_iron_uT)
    check_fit(found, float(np.sqrt((_distances(found, present) ** 2).mean())), coverage, parameters)
    return replace(found, notes=(coverage.words, f"corrected readings have length {strength_uT:g}"))


def _calibration(parts: Floats, covariance: Floats, strength_uT: float, readings: Floats) -> MagnetometerCalibration:
    """From h and the six of C, (9,) and (9, 9); without notes."""
    h, C = parts[:3], matrix_of(parts[3:])
    error = np.linalg.norm((readings - h) @ C, axis=1) - strength_uT
    return MagnetometerCalibration(
        method="unit sphere",
        hard_iron_uT=h,
        correction=C,
        covariance=covariance,
        strength_uT=strength_uT,
        residual_uT=float(np.sqrt((error**2).mean())),
        samples=len(readings),
    )


def _distances(found: MagnetometerCalibration, readings: Floats) -> Floats:
    """Of readings (N, 3) uT from the ellipsoid."""
    return distance(found.hard_iron_uT, found.correction / found.strength_uT, readings)


def _columns(x: Floats) -> Floats:
    quadratic, rest = design(x)
    return np.hstack([quadratic, rest[:, :3]])


def _plain_least_squares(columns: Floats) -> tuple[Floats, Floats]:
    """Nine numbers, and their covariance by the scatter of the equations."""
    p, _, rank, _ = np.linalg.lstsq(columns, np.ones(len(columns)), rcond=1e-10)
    if rank < columns.shape[1]:
        raise CalibrationError(NO_ELLIPSOID)
    influence = np.linalg.pinv(columns) * (1.0 - columns @ p)
    return np.asarray(p), np.asarray(influence @ influence.T)


def _parameters(p: Floats, middle: Floats, scale: float) -> Floats:
    """Centre and the upper half of C (9,) of |C (m - h)| = 1."""
    h, C = unscaled(*about_centre(p[:6], np.append(p[6:], -1.0)), middle, scale)
    return np.concatenate([h, C[UPPER]])


def _slope(p: Floats, k: int, middle: Floats, scale: float) -> Floats:
    """Derivatives (9,) of h and C by the k-th of the nine numbers: central differences."""
    step = np.zeros(9)
    step[k] = 1e-6
    return (_parameters(p + step, middle, scale) - _parameters(p - step, middle, scale)) / 2e-6
