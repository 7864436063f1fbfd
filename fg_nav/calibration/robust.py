"""Least squares that a few per cent of wild readings do not spoil, with the covariance of what they find.

The residuals are those of a curve or surface that every reading should lie on, in uT. Cauchy's loss, which forgets
what is far, finds the bulk of them; what lies beyond `OUTLIER_SIGMAS` of it is left out, and the rest is fitted
plainly, until nothing changes:

    covariance = s^2 (J^T J)^-1,   s^2 = sum r^2 / (kept - parameters).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import least_squares

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.quadric import LEAST_UT, MAD_TO_SD
from fg_nav.errors import CalibrationError

OUTLIER_SIGMAS = 4.0
"""Of normal residuals one in 16000 lies farther out, so leaving those out makes s too small by 0.05 %."""

ROUNDS = 5
"""Of leaving out and fitting again; two or three are enough."""


@dataclass(frozen=True)
class Fit:
    """Parameters (P,), their covariance (P, P), s in uT, and which readings (N,) were kept."""

    parameters: Floats
    covariance: Floats
    residual_uT: float
    kept: Bools


def robust_fit(residuals: Callable[[Floats, Floats], Floats], readings: Floats, start: Floats) -> Fit:
    """Fit parameters to readings.

    Parameters
    ----------
    residuals : of parameters (P,) and readings (K, D), returns (K,) uT.
    readings : (N, D) uT.
    start : (P,), near the answer (`fg_nav.calibration.quadric.trimmed_quadric`), of sizes that are much alike.

    Raises
    ------
    CalibrationError
        If the readings do not determine the parameters.
    """
    x = _solved(residuals, readings, start, "cauchy")
    kept = near(residuals(x, readings))
    for _ in range(ROUNDS):
        x = _solved(residuals, readings[kept], x, "linear")
        before, kept = kept, near(residuals(x, readings))
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
    return max(float(MAD_TO_SD * np.median(np.abs(residual))), LEAST_UT)


def near(residual: Floats) -> Bools:
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
