"""The sensor turned about in one field of one strength F: its readings lie on an ellipsoid.

    |C (m - h)| = F,    C symmetric (3, 3), h hard iron, m the readings with white noise of equal strength on each axis

`fit_ellipsoid`. Start: least squares constrained to an ellipsoid (`fg_nav.calibration.quadric`, as Fang et al. 2011
and Ma et al. 2018 use it: CLSEF). Then the likeliest parameters, a few wild readings left out: the residual is the
distance of the reading from the ellipsoid, uT, to first order in the noise,

    r = (|v| - F) / |C v / |v||,    v = C (m - h).

Readings alone do not show F: C and F can be scaled together. With the strength unknown det C = 1, which leaves volumes
as they are, and F is estimated; the covariance of C then has rank 5. With the strength given, F counts as exact.

`fit_unit_sphere` (Munoz Diaz et al. 2017, section 3.2; the paper does not print its algebra): plain least squares about
the readings' mean and in units of their spread,

    a . (squares and products of x) + b . x = 1        N equations, nine numbers.

The corrected readings have length 1, as in the paper, or the strength of the field at the place, if given. It minimizes
no distance, the squared noise shifts it, one wild reading spoils it, and a hyperboloid is refused. Its covariance is
that of the equations as they scatter (White 1980), without that shift.

Coverage: the sphere of directions is cut into `CELLS` patches of equal size about the points of a Fibonacci lattice; a
patch is covered if a reading points into it. What matters more is the weakest direction, along which the mean square of
the unit vectors is least: 1/3 when all directions are seen alike and 0 when the readings lie in a plane.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.magnetometer import UPPER, MagnetometerCalibration, check_strength, matrix_of
from fg_nav.calibration.quadric import (
    NO_ELLIPSOID,
    Fit,
    design,
    distance,
    find_center,
    fit_robustly,
    fit_trimmed_quadric,
    scale_readings,
    unscale,
)
from fg_nav.errors import CalibrationError
from fg_nav.text import format_count

CHANGE_PERCENT, MIN_CHANGE_UT = 90.0, 2.0
"""Readings of a sensor that was turned change by more than this from their median, a tenth of them at least. Noise
changes by less: there is an ellipsoid through it, and the fit takes long to find it."""


MIN_READINGS = 20  # Nine numbers want a few more readings to be judged by.

MAX_SIGMA = 0.05
"""Of the hard iron over the size of the ellipsoid, and of any element of C of determinant 1: 0.05 of the field is an
error of heading of 3 deg where it lies level, and 7 deg at Munich."""

MAX_RESIDUAL = 0.05
"""Of the readings over the size of the ellipsoid: 2.4 uT on Earth, several times the noise of any chip. More is a field
that changes from place to place, which sigma does not include."""


def fit_ellipsoid(readings: Floats, strength_uT: float | None = None) -> MagnetometerCalibration:
    """Calibrate from readings of a sensor turned about in a homogeneous field.

    Parameters
    ----------
    readings : (N, 3) uT in the body frame; NaN rows are left out.
    strength_uT : of the field; None if it is not known: then det C = 1 and the strength is estimated.

    Raises `CalibrationError` where the directions covered leave a parameter open, naming the weakest direction, or the
    field was not the same throughout, or is none that Earth has.
    """
    present = select_readings(readings)
    if strength_uT is not None:
        check_given(strength_uT)
    h, unit_C = fit_trimmed_quadric(present)
    size = float(np.mean(np.diag(unit_C)))
    sizes = np.concatenate([np.full(3, 0.1 / size), np.full(6, size)])
    fit = fit_robustly(_distances(sizes), present, np.concatenate([h, unit_C[UPPER]]) / sizes)
    found = _build_calibration(fit, sizes, strength_uT)
    coverage = measure_coverage(present[fit.kept] - found.hard_iron_uT)  # not corrected: a bad C would blow a plane up
    check_fit(found, found.residual_uT, coverage)
    return _add_notes(found, coverage, len(present))


def upper_triangular(correction: Floats) -> Floats:
    """Turn a correction C (3, 3) into the upper triangular one with the same strengths: K_c of Ma 2018, Table 1.

    K^T K = C^T C, with positive diagonal. The corrected field is turned by what C and K differ in.
    """
    return np.asarray(np.linalg.cholesky(correction.T @ correction).T)


def symmetric(matrix: Floats) -> Floats:
    """Symmetric correction C (3, 3) with the same strengths as any matrix (3, 3): C^2 = M^T M, polar decomposition."""
    _, size, right = np.linalg.svd(matrix)
    return np.asarray((right.T * size) @ right)


def select_readings(readings: Floats) -> Floats:
    """Readings (N, 3) without NaN rows; `CalibrationError` for too few, or of a sensor that was not turned."""
    present = readings[np.isfinite(readings).all(axis=1)]
    if len(present) < MIN_READINGS:
        raise CalibrationError(
            f"{format_count(len(present), 'whole reading')} of the field cannot make an ellipsoid: record "
            f"{MIN_READINGS} or more, of all three axes."
        )
    change = np.percentile(np.linalg.norm(present - np.median(present, axis=0), axis=1), CHANGE_PERCENT)
    if change < MIN_CHANGE_UT:
        raise CalibrationError(
            f"nine in ten readings lie within {change:.2g} uT of their median and make no ellipsoid: "
            "does the magnetometer work, was it turned, and are its readings in uT?"
        )
    return np.asarray(present)


def check_given(strength_uT: float) -> None:
    """Raise `CalibrationError` for a strength that no field has."""
    if not 0.0 < strength_uT < np.inf:
        raise CalibrationError(f"a field of {strength_uT} uT is none: give its strength, or None.")


def _distances(sizes: Floats) -> Callable[[Floats, Floats], Floats]:
    """Distances by parameters that are brought to sizes much alike."""

    def distances(scaled: Floats, readings: Floats) -> Floats:
        x = scaled * sizes
        return distance(x[:3], matrix_of(x[3:]), readings)

    return distances


def _build_calibration(fit: Fit, sizes: Floats, strength_uT: float | None) -> MagnetometerCalibration:
    x, covariance = fit.parameters * sizes, fit.covariance * np.outer(sizes, sizes)
    unit_C = matrix_of(x[3:])
    if not np.linalg.eigvalsh(unit_C).min() > 0.0:
        raise CalibrationError(NO_ELLIPSOID)
    strength = float(np.linalg.det(unit_C) ** (-1 / 3)) if strength_uT is None else strength_uT
    to_C = np.eye(9)
    to_C[3:, 3:] = strength * (np.eye(6) if strength_uT is not None else _remove_scale(unit_C))
    return MagnetometerCalibration(
        method="ellipsoid",
        hard_iron_uT=x[:3],
        correction=strength * unit_C,
        covariance=to_C @ covariance @ to_C.T,
        strength_uT=strength,
        residual_uT=fit.residual_uT,
        samples=int(fit.kept.sum()),
    )


def _remove_scale(unit_C: Floats) -> Floats:
    """Derivatives (6, 6) of C by the matrix A that was fitted, over det C^(1/3): dC = dA - A trace(A^-1 dA) / 3."""
    inverse = np.linalg.inv(unit_C)
    trace = np.where(UPPER[0] == UPPER[1], 1.0, 2.0) * inverse[UPPER]
    return np.asarray(np.eye(6) - np.outer(unit_C[UPPER], trace) / 3.0)


def check_fit(found: MagnetometerCalibration, residual_uT: float, coverage: Coverage) -> None:
    """Refuse an ellipsoid with an open parameter, of a size that no field has, or that the readings do not lie on.

    Parameters
    ----------
    found : the ellipsoid; with a strength that was given, C has a scale, which is taken out.
    residual_uT : of the readings as they were, not corrected.

    Raises `CalibrationError` in this order, with the reason.
    """
    scale = float(np.cbrt(np.linalg.det(found.correction)))
    size_uT = found.strength_uT / scale
    _check_sigma(found.sigma[:3].max(), size_uT, found.sigma[3:].max() / scale, coverage)
    check_strength(size_uT)
    if residual_uT > MAX_RESIDUAL * size_uT:
        raise CalibrationError(
            f"the readings scatter by {residual_uT:.1f} uT about an ellipsoid of {size_uT:.0f} uT, and "
            f"{100 * MAX_RESIDUAL:g} % of it at most are allowed: the field was not the same "
            "everywhere, so turn the sensor in one place away from iron."
        )


def _check_sigma(hard_uT: float, size_uT: float, soft: float, coverage: Coverage) -> None:
    if max(hard_uT / size_uT, soft) > MAX_SIGMA:
        raise CalibrationError(
            f"the readings leave the hard iron open by {hard_uT:.1f} uT and the soft iron by "
            f"{100 * soft:.0f} % (at most {100 * MAX_SIGMA:g} % of the field are allowed): {coverage.words}; "
            "turn the sensor so that the field points there too."
        )


def _add_notes(found: MagnetometerCalibration, coverage: Coverage, readings: int) -> MagnetometerCalibration:
    left_out = readings - found.samples
    notes = (coverage.words, f"{left_out} of {readings} readings left out as outliers")
    return replace(found, notes=notes if left_out else notes[:1])


def fit_unit_sphere(readings: Floats, strength_uT: float = 1.0) -> MagnetometerCalibration:
    """Calibrate from readings of a sensor turned about in a homogeneous field.

    Parameters
    ----------
    readings : (N, 3) uT in the body frame; NaN rows are left out.
    strength_uT : that the corrected readings shall have: 1 as the paper has it, or that of the field, for uT.

    Raises `CalibrationError` where the readings are too few or lie on no ellipsoid, and as `fit_ellipsoid`.
    """
    check_given(strength_uT)
    present = select_readings(readings)
    x, middle, scale = scale_readings(present)
    p, covariance = _plain_least_squares(_columns(x))
    to_strength = np.repeat([1.0, strength_uT], [3, 6])
    J = to_strength[:, None] * np.stack([_slope(p, k, middle, scale) for k in range(9)], axis=1)
    parts = to_strength * _parameters(p, middle, scale)
    found = _build_sphere_calibration(parts, J @ covariance @ J.T, strength_uT, present)
    coverage = measure_coverage(present - found.hard_iron_uT)
    check_fit(found, float(np.sqrt((_measure_distances(found, present) ** 2).mean())), coverage)
    return replace(found, notes=(coverage.words, f"corrected readings have length {strength_uT:g}"))


def _build_sphere_calibration(
    parts: Floats, covariance: Floats, strength_uT: float, readings: Floats
) -> MagnetometerCalibration:
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


def _measure_distances(found: MagnetometerCalibration, readings: Floats) -> Floats:
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
    """Center and the upper half of C (9,) of |C (m - h)| = 1."""
    h, C = unscale(*find_center(p[:6], np.append(p[6:], -1.0)), middle, scale)
    return np.concatenate([h, C[UPPER]])


def _slope(p: Floats, k: int, middle: Floats, scale: float) -> Floats:
    """Derivatives (9,) of h and C by the k-th of the nine numbers: central differences."""
    step = np.zeros(9)
    step[k] = 1e-6
    return (_parameters(p + step, middle, scale) - _parameters(p - step, middle, scale)) / 2e-6


CELLS = 100  # Patches of 413 square degrees, about 20 degrees wide: a hand that tumbles a box leaves no finer holes.


@dataclass(frozen=True)
class Coverage:
    """Directions that were covered.

    Attributes
    ----------
    share : of the sphere's patches that hold a reading.
    weakest : (3,) unit axis along which the readings point least.
    weakest_share : three times the mean square of their component along it: 1 for an even tumbling, 0 in a plane.
    """

    share: float
    weakest: Floats
    weakest_share: float

    @property
    def words(self) -> str:
        """The verdict in a sentence's part."""
        x, y, z = self.weakest
        return (
            f"{100 * self.share:.0f} % of all directions covered, weakest along ({x:+.2f}, {y:+.2f}, {z:+.2f}) of the "
            f"sensor's axes ({100 * self.weakest_share:.0f} % of an even tumbling)"
        )


def measure_coverage(body_field: Floats) -> Coverage:
    """Coverage by readings (N, 3) less hard iron: soft iron is mild enough to be left in."""
    direction = body_field / np.linalg.norm(body_field, axis=1, keepdims=True)
    cell = np.argmax(direction @ _lattice().T, axis=1)
    size, axes = np.linalg.eigh(direction.T @ direction / len(direction))
    return Coverage(len(np.unique(cell)) / CELLS, axes[:, 0], float(3.0 * size[0]))


def _lattice() -> Floats:
    """Points (CELLS, 3) evenly over the unit sphere."""
    k = np.arange(CELLS) + 0.5
    z, angle = 1.0 - 2.0 * k / CELLS, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)
