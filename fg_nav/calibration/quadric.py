"""The ellipse or ellipsoid through readings: by linear algebra, a start, and by robust least squares.

    x^T A x + 2 v^T x + d = 0        A (n, n) symmetric, n = 2 or 3

with the monomials x_i x_j (i <= j), 2 x_i, 1 in the columns of a design matrix. About its center h it is

    |C (x - h)| = 1,   h = -A^-1 v,   C = (A / (h^T A h - d))^1/2 symmetric.

Least squares under a constraint cannot end in a hyperboloid: in the plane 4ac - b^2 = 1 (Fitzgibbon), in space
4J - I^2 = 1 with I and J the sum of the eigenvalues of A and that of their products by pairs (Li and Griffiths 2004;
Fang et al. 2011 calibrate with it). The latter holds of all ellipsoids whose short axis is more than half the long one.

`fit_robustly` then fits the distances, uT: Cauchy's loss finds the bulk of them, what lies beyond `OUTLIER_SIGMAS`
of it is left out, and the rest is fitted plainly, until nothing changes:

    covariance = s^2 (J^T J)^-1,   s^2 = sum r^2 / (kept - parameters).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import least_squares

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import CalibrationError

TRIMS, TRIM_SIGMAS = 20, 2.5
"""Rounds, and what they leave: tight, for at first the wild readings pull the ellipsoid towards themselves."""

MAD_TO_SD = 1.4826  # Standard deviation of a normal variable over its median absolute deviation.
MIN_UT = 1e-6  # Of distances: below this they are rounding.

NO_ELLIPSOID = "the readings lie on no ellipsoid: turn the sensor in more directions, away from iron that stays behind."


def fit_constrained_quadric(readings: Floats) -> tuple[Floats, Floats]:
    """Center (n,) and symmetric C (n, n) of the ellipse or ellipsoid through readings (N, n).

    Raises `CalibrationError` where the readings do not determine one, as on a plane or along too short an arc.
    """
    x, middle, scale = scale_readings(readings)
    n = readings.shape[1]
    quadratic, rest = design(x)
    scatter, mixed, low = quadratic.T @ quadratic, quadratic.T @ rest, rest.T @ rest
    try:
        elimination = -np.linalg.solve(low, mixed.T)
        values, vectors = np.linalg.eig(np.linalg.solve(_constraint(n), scatter + mixed @ elimination))
    except np.linalg.LinAlgError as error:
        raise CalibrationError(NO_ELLIPSOID) from error
    vectors = np.real(vectors)
    allowed = np.einsum("ik,ij,jk->k", vectors, _constraint(n), vectors) > 0.0
    if not allowed.any():
        raise CalibrationError(NO_ELLIPSOID)
    best = vectors[:, np.argmin(np.where(allowed, np.abs(values), np.inf))]
    return unscale(*find_center(best, elimination @ best), middle, scale)


def fit_trimmed_quadric(readings: Floats) -> tuple[Floats, Floats]:
    """Center (n,) and C (n, n) as `fit_constrained_quadric` has them, of readings whose farthest are left out by steps.

    Far is what lies more than `TRIM_SIGMAS` from the ellipsoid, as the bulk of the distances scatters. This is a start
    that a few wild readings do not spoil; a fit decides on them again.
    """
    kept = np.ones(len(readings), dtype=np.bool_)
    for _ in range(TRIMS):
        h, C = fit_constrained_quadric(readings[kept])
        far = np.abs(distance(h, C, readings))
        before, kept = kept, far <= TRIM_SIGMAS * MAD_TO_SD * np.median(far) + MIN_UT
        if (kept == before).all():
            break
    return h, C


def distance(h: Floats, C: Floats, readings: Floats) -> Floats:
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


def unscale(center: Floats, C: Floats, middle: Floats, scale: float) -> tuple[Floats, Floats]:
    """Center and C of the readings from those of the scaled ones."""
    return middle + scale * center, C / scale


def design(x: Floats) -> tuple[Floats, Floats]:
    """Columns x_i^2, then x_i x_j twice (i < j); and 2 x_i, 1."""
    i, j = np.triu_indices(x.shape[1], k=1)
    return np.hstack([x**2, 2 * x[:, i] * x[:, j]]), np.hstack([2 * x, np.ones((len(x), 1))])


def _constraint(n: int) -> Floats:
    """K of the constraint a^T K a = 1 on the quadratic coefficients a, in the order of `design`."""
    pairs = n * (n - 1) // 2
    K = np.zeros((n + pairs, n + pairs))
    K[:n, :n] = 2.0 * (1 - np.eye(n)) - (n == 3)
    K[n:, n:] = -4.0 * np.eye(pairs)
    return K


def find_center(quadratic: Floats, rest: Floats) -> tuple[Floats, Floats]:
    """Center and C from the coefficients of the two halves of `design`; `CalibrationError` where there is none."""
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


OUTLIER_SIGMAS = 4.0
"""Of normal residuals one in 16000 lies farther out, so leaving those out makes s too small by 0.05 %."""

ROUNDS = 5  # Of leaving out and fitting again; two or three are enough.


@dataclass(frozen=True)
class Fit:
    """Parameters (P,), their covariance (P, P), s in uT, and which readings (N,) were kept."""

    parameters: Floats
    covariance: Floats
    residual_uT: float
    kept: Bools


def fit_robustly(residuals: Callable[[Floats, Floats], Floats], readings: Floats, start: Floats) -> Fit:
    """Fit parameters to readings.

    Parameters
    ----------
    residuals : of parameters (P,) and readings (K, D), returns (K,) uT.
    readings : (N, D) uT.
    start : (P,), near the answer (`fg_nav.calibration.quadric.fit_trimmed_quadric`), of sizes that are much alike.

    Raises `CalibrationError` if the readings do not determine the parameters.
    """
    x = _solved(residuals, readings, start, "cauchy")
    kept = is_near(residuals(x, readings))
    for _ in range(ROUNDS):
        x = _solved(residuals, readings[kept], x, "linear")
        before, kept = kept, is_near(residuals(x, readings))
        if (kept == before).all():
            break
    return _with_covariance(residuals, readings, x, kept)


def _solved(
    residuals: Callable[[Floats, Floats], Floats], readings: Floats, start: Floats, loss: Literal["linear", "cauchy"]
) -> Floats:
    if len(readings) <= len(start):
        raise CalibrationError(f"{len(readings)} readings do not determine {len(start)} parameters: record more.")
    first = residuals(start, readings)
    if not np.isfinite(first).all():
        raise CalibrationError("the readings lie on no ellipse or ellipsoid: is this a magnetometer, turned about?")

    def at(x: Floats) -> Floats:
        return residuals(x, readings)

    found = least_squares(at, start, loss=loss, f_scale=_scale(first), max_nfev=100)
    return np.asarray(found.x)


def _scale(residual: Floats) -> float:
    return max(float(MAD_TO_SD * np.median(np.abs(residual))), MIN_UT)


def is_near(residual: Floats) -> Bools:
    """Tell which residuals (N,) are no outliers, as the bulk of them scatters."""
    return np.asarray(np.abs(residual) <= OUTLIER_SIGMAS * _scale(residual))


def _with_covariance(residuals: Callable[[Floats, Floats], Floats], readings: Floats, x: Floats, kept: Bools) -> Fit:
    inliers = readings[kept]
    if len(inliers) <= len(x):
        raise CalibrationError(f"{len(inliers)} readings do not determine {len(x)} parameters: record more.")
    J = _jacobian(residuals, inliers, x)
    variance = float((residuals(x, inliers) ** 2).sum()) / (len(inliers) - len(x))
    _, size, right = np.linalg.svd(J, full_matrices=False)
    if size[-1] < 1e-10 * size[0]:
        raise CalibrationError("the readings leave a parameter open: turn the sensor in more directions.")
    return Fit(x, variance * (right.T / size**2) @ right, float(np.sqrt(variance)), kept)


def _jacobian(residuals: Callable[[Floats, Floats], Floats], readings: Floats, x: Floats) -> Floats:
    """Central differences (N, P)."""
    columns = []
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = 1e-5 * max(abs(x[k]), 0.1)
        columns.append((residuals(x + step, readings) - residuals(x - step, readings)) / (2 * step[k]))
    return np.stack(columns, axis=1)
