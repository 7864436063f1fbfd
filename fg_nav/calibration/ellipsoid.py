"""The sensor turned about in one field of one strength F: its readings lie on an ellipsoid. Fits of quadrics.

    |C (m - h)| = F,    C symmetric (3, 3), h hard iron, m the readings with white noise of equal strength on each axis

`fit_ellipsoid`. Start: least squares constrained to an ellipsoid (Fang et al. 2011 and Ma et al. 2018: CLSEF). Then the
likeliest parameters, a few wild readings left out: the residual is the distance of the reading from the ellipsoid, uT,
to first order in the noise,

    r = (|v| - F) / |C v / |v||,    v = C (m - h).

Readings alone do not show F: C and F can be scaled together. With the strength unknown det C = 1, which preserves
volumes, and F is estimated; the covariance of C then has rank 5. With the strength given, F counts as exact.

`fit_unit_sphere` (Munoz Diaz et al. 2017, section 3.2; the paper does not print its algebra): plain least squares about
the readings' mean and in units of their spread,

    a . (squares and products of x) + b . x = 1        N equations, nine numbers.

The corrected readings have length 1, as in the paper, or the strength of the field at the place, if given. It minimizes
no distance, the squared noise biases it, one wild reading spoils it, and a hyperboloid is refused. Its covariance is
that of the equations as they scatter (White 1980), without that bias.

Quadric through readings (N, n), n = 2 or 3,

    x^T A x + 2 v^T x + d = 0        A (n, n) symmetric

with the monomials x_i x_j (i <= j), 2 x_i, 1 in the columns of a design matrix. About its center h it is

    |C (x - h)| = 1,   h = -A^-1 v,   C = (A / (h^T A h - d))^1/2 symmetric.

Least squares under a constraint cannot end in a hyperboloid: in the plane 4ac - b^2 = 1 (Fitzgibbon), in space
4J - I^2 = 1 with I and J the sum of the eigenvalues of A and that of their products by pairs (Li and Griffiths 2004).
The latter holds of all ellipsoids whose short axis is more than half the long one.

`fit_robustly` fits distances, uT: Cauchy's loss finds the bulk of them, residuals beyond `OUTLIER_SIGMAS` of it are
left out, and the rest is fitted plainly, until nothing changes:

    covariance = s^2 (J^T J)^-1,   s^2 = sum r^2 / (kept - parameters).

Coverage: the sphere of directions is cut into `CELLS` patches of equal size about the points of a Fibonacci lattice; a
patch is covered if a reading points into it. More important is the weakest direction, along which the mean square of
the unit vectors is least: 1/3 when all directions are covered alike and 0 when the readings lie in a plane.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from scipy.optimize import least_squares

from fg_nav.arrays import MAD_TO_SIGMA, Bools, Floats
from fg_nav.calibration.magnetometer import UPPER, MagnetometerCalibration, check_strength, matrix_of
from fg_nav.errors import CalibrationError
from fg_nav.text import format_count

TRIMS, TRIM_SIGMAS = 20, 2.5  # Rounds of leaving out, and how far: tight, for at first wild readings attract the fit.
MIN_UT = 1e-6  # Of distances: below this they are rounding.
OUTLIER_SIGMAS = 4.0  # One in 16000 normal residuals lies farther out: s is too small by 0.05 %.
ROUNDS = 5  # Of leaving out and fitting again; two or three are enough.
CHANGE_PERCENT, MIN_CHANGE_UT = 90.0, 2.0  # A tenth of the readings of a turned sensor are so far from their median.
MIN_READINGS = 20  # Nine parameters, and some readings to judge them by.
MAX_SIGMA = 0.05  # Of h over the size, and of C of determinant 1: 3 deg of heading in a level field, 7 deg at Munich.
MAX_RESIDUAL = 0.05  # Over the size: 2.4 uT on Earth, several times the noise of any chip; more, and the field varies.
CELLS = 100  # Patches about 20 degrees wide: a hand that tumbles a box leaves no finer holes.

NO_ELLIPSOID = "the readings lie on no ellipsoid: turn the sensor in more directions, away from iron that stays behind."
Residuals: TypeAlias = Callable[[Floats, Floats], Floats]  # Of parameters (P,) and readings (K, D): (K,) uT.


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
    # parameters of similar sizes
    size = float(np.mean(np.diag(unit_C)))
    sizes = np.concatenate([np.full(3, 0.1 / size), np.full(6, size)])

    def distances(scaled: Floats, chosen: Floats) -> Floats:
        x = scaled * sizes
        return compute_distances(x[:3], matrix_of(x[3:]), chosen)

    fit = fit_robustly(distances, present, np.concatenate([h, unit_C[UPPER]]) / sizes)
    x, covariance = fit.parameters * sizes, fit.covariance * np.outer(sizes, sizes)
    unit_C = matrix_of(x[3:])
    if not np.linalg.eigvalsh(unit_C).min() > 0.0:
        raise CalibrationError(NO_ELLIPSOID)
    # C of the given strength, or of det C = 1: dC = dA - A trace(A^-1 dA) / 3, A the fitted matrix
    strength, by_A = strength_uT, np.eye(6)
    if strength is None:
        strength = float(np.linalg.det(unit_C) ** (-1 / 3))
        trace = np.where(UPPER[0] == UPPER[1], 1.0, 2.0) * np.linalg.inv(unit_C)[UPPER]
        by_A -= np.outer(unit_C[UPPER], trace) / 3.0
    to_C = np.eye(9)
    to_C[3:, 3:] = strength * by_A
    found = MagnetometerCalibration(
        method="ellipsoid",
        hard_iron_uT=x[:3],
        correction=strength * unit_C,
        covariance=to_C @ covariance @ to_C.T,
        strength_uT=strength,
        residual_uT=fit.residual_uT,
        samples=int(fit.kept.sum()),
    )
    coverage = measure_coverage(present[fit.kept] - found.hard_iron_uT)  # not corrected: a bad C would blow a plane up
    check_fit(found, found.residual_uT, coverage)
    left_out = len(present) - found.samples
    notes = (coverage.words, f"{left_out} of {len(present)} readings left out as outliers")
    return replace(found, notes=notes if left_out else notes[:1])


def fit_unit_sphere(readings: Floats, strength_uT: float = 1.0) -> MagnetometerCalibration:
    """Calibrate from readings of a sensor turned about in a homogeneous field.

    Parameters
    ----------
    readings : (N, 3) uT in the body frame; NaN rows are left out.
    strength_uT : of the corrected readings: 1 as in the paper, or that of the field, for uT.

    Raises `CalibrationError` where the readings are too few or lie on no ellipsoid, and as `fit_ellipsoid`.
    """
    check_given(strength_uT)
    present = select_readings(readings)
    x, middle, scale = scale_readings(present)
    quadratic, rest = design(x)
    columns = np.hstack([quadratic, rest[:, :3]])
    # nine numbers, and their covariance by the scatter of the equations
    solution, _, rank, _ = np.linalg.lstsq(columns, np.ones(len(columns)), rcond=1e-10)
    p = np.asarray(solution, dtype=np.float64)
    if rank < columns.shape[1]:
        raise CalibrationError(NO_ELLIPSOID)
    influence = np.linalg.pinv(columns) * (1.0 - columns @ p)

    def parameters(p: Floats) -> Floats:
        """Center and the upper half of C (9,) of |C (m - h)| = 1."""
        center, C = find_center(p[:6], np.append(p[6:], -1.0))
        return np.concatenate([middle + scale * center, (C / scale)[UPPER]])

    # h and C, and their derivatives by central differences
    to_strength = np.repeat([1.0, strength_uT], [3, 6])
    slopes = [(parameters(p + step) - parameters(p - step)) / 2e-6 for step in 1e-6 * np.eye(9)]
    J = to_strength[:, None] * np.stack(slopes, axis=1)
    found_p = to_strength * parameters(p)
    h, C = found_p[:3], matrix_of(found_p[3:])
    error = np.linalg.norm((present - h) @ C, axis=1) - strength_uT
    found = MagnetometerCalibration(
        method="unit sphere",
        hard_iron_uT=h,
        correction=C,
        covariance=J @ (influence @ influence.T) @ J.T,
        strength_uT=strength_uT,
        residual_uT=float(np.sqrt((error**2).mean())),
        samples=len(present),
    )
    coverage = measure_coverage(present - found.hard_iron_uT)
    apart = compute_distances(found.hard_iron_uT, found.correction / found.strength_uT, present)
    check_fit(found, float(np.sqrt((apart**2).mean())), coverage)
    return replace(found, notes=(coverage.words, f"corrected readings have length {strength_uT:g}"))


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


def check_fit(found: MagnetometerCalibration, residual_uT: float, coverage: Coverage) -> None:
    """Refuse an ellipsoid with an open parameter, of a size that no field has, or that the readings do not lie on.

    Parameters
    ----------
    found : the ellipsoid; with a given strength, C has a scale, which is removed.
    residual_uT : of the readings, not corrected.

    Raises `CalibrationError` in this order, with the reason.
    """
    scale = float(np.cbrt(np.linalg.det(found.correction)))
    size_uT = found.strength_uT / scale
    hard_uT, soft = found.sigma[:3].max(), found.sigma[3:].max() / scale
    if max(hard_uT / size_uT, soft) > MAX_SIGMA:
        raise CalibrationError(
            f"the readings leave the hard iron open by {hard_uT:.1f} uT and the soft iron by "
            f"{100 * soft:.0f} % (at most {100 * MAX_SIGMA:g} % of the field are allowed): {coverage.words}; "
            "turn the sensor so that the field points there too."
        )
    check_strength(size_uT)
    if residual_uT > MAX_RESIDUAL * size_uT:
        raise CalibrationError(
            f"the readings scatter by {residual_uT:.1f} uT about an ellipsoid of {size_uT:.0f} uT, and "
            f"{100 * MAX_RESIDUAL:g} % of it at most are allowed: the field was not the same "
            "everywhere, so turn the sensor in one place away from iron."
        )


@dataclass(frozen=True)
class Coverage:
    """Directions covered by the readings.

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
        """Part of a sentence."""
        x, y, z = self.weakest
        return (
            f"{100 * self.share:.0f} % of all directions covered, weakest along ({x:+.2f}, {y:+.2f}, {z:+.2f}) of the "
            f"sensor's axes ({100 * self.weakest_share:.0f} % of an even tumbling)"
        )


def measure_coverage(body_field: Floats) -> Coverage:
    """Coverage of the sphere by readings (N, 3) uT less hard iron, and its weakest direction; soft iron is ignored."""
    direction = body_field / np.linalg.norm(body_field, axis=1, keepdims=True)
    k = np.arange(CELLS) + 0.5
    z, angle = 1.0 - 2.0 * k / CELLS, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z**2)
    lattice = np.stack([across * np.cos(angle), across * np.sin(angle), z])
    cell = np.argmax(direction @ lattice, axis=1)
    size, axes = np.linalg.eigh(direction.T @ direction / len(direction))
    return Coverage(len(np.unique(cell)) / CELLS, axes[:, 0], float(3.0 * size[0]))


def fit_constrained_quadric(readings: Floats) -> tuple[Floats, Floats]:
    """Center (n,) and symmetric C (n, n) of the ellipse or ellipsoid through readings (N, n).

    Raises `CalibrationError` where the readings do not determine one, as on a plane or along too short an arc.
    """
    x, middle, scale = scale_readings(readings)
    quadratic, rest = design(x)
    # K of the constraint a^T K a = 1 on the quadratic coefficients a
    n = readings.shape[1]
    K = -4.0 * np.eye(n * (n + 1) // 2)
    K[:n, :n] = 2.0 * (1 - np.eye(n)) - (n == 3)
    scatter, mixed, low = quadratic.T @ quadratic, quadratic.T @ rest, rest.T @ rest
    try:
        elimination = -np.linalg.solve(low, mixed.T)
        values, vectors = np.linalg.eig(np.linalg.solve(K, scatter + mixed @ elimination))
    except np.linalg.LinAlgError as error:
        raise CalibrationError(NO_ELLIPSOID) from error
    vectors = np.real(vectors)
    allowed = np.einsum("ik,ij,jk->k", vectors, K, vectors) > 0.0
    if not allowed.any():
        raise CalibrationError(NO_ELLIPSOID)
    best = vectors[:, np.argmin(np.where(allowed, np.abs(values), np.inf))]
    center, C = find_center(best, elimination @ best)
    return middle + scale * center, C / scale


def fit_trimmed_quadric(readings: Floats) -> tuple[Floats, Floats]:
    """Center (n,) and C (n, n) as by `fit_constrained_quadric`, without readings beyond `TRIM_SIGMAS` of the bulk.

    An initial guess robust to a few outliers; the fit judges them anew.
    """
    kept = np.ones(len(readings), dtype=np.bool_)
    for _ in range(TRIMS):
        h, C = fit_constrained_quadric(readings[kept])
        far = np.abs(compute_distances(h, C, readings))
        before, kept = kept, far <= TRIM_SIGMAS * MAD_TO_SIGMA * np.median(far) + MIN_UT
        if (kept == before).all():
            break
    return h, C


def compute_distances(h: Floats, C: Floats, readings: Floats) -> Floats:
    """Distances (N,) of readings (N, n) from the ellipsoid |C (m - h)| = 1, to first order; outside positive."""
    v = (readings - h) @ C
    length = np.linalg.norm(v, axis=1)
    return np.asarray((length - 1.0) * length / np.linalg.norm(v @ C, axis=1))


def scale_readings(readings: Floats) -> tuple[Floats, Floats, float]:
    """Readings about their mean in units of their spread: monomials of one size."""
    middle = readings.mean(axis=0)
    scale = float(np.sqrt(((readings - middle) ** 2).sum(axis=1).mean()))
    if not scale > 0.0:
        raise CalibrationError(NO_ELLIPSOID)
    return (readings - middle) / scale, middle, scale


def design(x: Floats) -> tuple[Floats, Floats]:
    """Columns x_i^2, then x_i x_j twice (i < j); and 2 x_i, 1."""
    i, j = np.triu_indices(x.shape[1], k=1)
    return np.hstack([x**2, 2 * x[:, i] * x[:, j]]), np.hstack([2 * x, np.ones((len(x), 1))])


def find_center(quadratic: Floats, rest: Floats) -> tuple[Floats, Floats]:
    """Center (n,) and C (n, n) by coefficients of a quadric, second-order and `rest`; raises if it is no ellipsoid."""
    n = len(rest) - 1
    i, j = np.triu_indices(n, k=1)
    A = np.diag(quadratic[:n])
    A[i, j] = A[j, i] = quadratic[n:]
    try:
        center = -np.linalg.solve(A, rest[:-1])
    except np.linalg.LinAlgError as error:
        raise CalibrationError(NO_ELLIPSOID) from error
    size, axes = np.linalg.eigh(A / (center @ A @ center - rest[-1]))
    if not size.min() > 0.0:
        raise CalibrationError(NO_ELLIPSOID)
    return np.asarray(center), np.asarray((axes * np.sqrt(size)) @ axes.T)


@dataclass(frozen=True)
class Fit:
    """Parameters (P,), their covariance (P, P), s in uT, and flags (N,) of the readings that were kept."""

    parameters: Floats
    covariance: Floats
    residual_uT: float
    kept: Bools


def fit_robustly(residuals: Residuals, readings: Floats, start: Floats) -> Fit:
    """Fit parameters to readings by robust least squares, then by plain least squares on the inliers.

    Parameters
    ----------
    residuals : of parameters (P,) and readings (K, D), returns (K,) uT.
    readings : (N, D) uT.
    start : (P,), near the answer (`fit_trimmed_quadric`), of similar sizes.

    Raises `CalibrationError` if the readings do not determine the parameters.
    """
    x = _solve(residuals, readings, start, "cauchy")
    kept = is_near(residuals(x, readings))
    for _ in range(ROUNDS):
        x = _solve(residuals, readings[kept], x, "linear")
        before, kept = kept, is_near(residuals(x, readings))
        if (kept == before).all():
            break
    # covariance by the Jacobian, central differences (N, P)
    inliers = readings[kept]
    if len(inliers) <= len(x):
        raise CalibrationError(f"{len(inliers)} readings do not determine {len(x)} parameters: record more.")
    steps = np.diag(1e-5 * np.maximum(np.abs(x), 0.1))
    columns = [(residuals(x + step, inliers) - residuals(x - step, inliers)) / (2 * step.sum()) for step in steps]
    variance = float((residuals(x, inliers) ** 2).sum()) / (len(inliers) - len(x))
    _, size, right = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    if size[-1] < 1e-10 * size[0]:
        raise CalibrationError("the readings leave a parameter open: turn the sensor in more directions.")
    return Fit(x, variance * (right.T / size**2) @ right, float(np.sqrt(variance)), kept)


def _solve(residuals: Residuals, readings: Floats, start: Floats, loss: Literal["linear", "cauchy"]) -> Floats:
    """Least-squares parameters (P,) with this loss, its scale the robust spread of the residuals at `start`."""
    if len(readings) <= len(start):
        raise CalibrationError(f"{len(readings)} readings do not determine {len(start)} parameters: record more.")
    first = residuals(start, readings)
    if not np.isfinite(first).all():
        raise CalibrationError("the readings lie on no ellipse or ellipsoid: is this a magnetometer, turned about?")
    scale = _robust_sigma(first)
    return np.asarray(least_squares(residuals, start, loss=loss, f_scale=scale, max_nfev=100, args=(readings,)).x)


def _robust_sigma(residual: Floats) -> float:
    """Standard deviation of residuals (N,) by their median."""
    return max(float(MAD_TO_SIGMA * np.median(np.abs(residual))), MIN_UT)


def is_near(residual: Floats) -> Bools:
    """Flags (N,) of the residuals that are no outliers of their bulk."""
    return np.asarray(np.abs(residual) <= OUTLIER_SIGMAS * _robust_sigma(residual))
