"""The likeliest ellipse through levelled readings, a few wild ones left out, with its covariance.

Least squares of distances. Centre and symmetric matrix are what is fitted, |C (m - o)| = 1; they give offset, eta and
tau.

Iron in the floor is another at every place, and circles pass the same places again with the same heading: what it does
to the readings is no noise that averages out. So the variance of a reading is that of its distance from the ellipse,
or, if larger, that which the means of the distances over `SECTORS` of heading show (lack of fit):

    s^2 = max(sum r^2 / (F - 5), sum n_j mean_j(r)^2 / (sectors - 5)).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.ellipse_shape import Ellipse, half_turn
from fg_nav.calibration.quadric import LEAST_UT, distance, trimmed_quadric
from fg_nav.calibration.robust import Fit, robust_fit
from fg_nav.errors import CalibrationError
from fg_nav.magnetic.compass import heading_of_field
from fg_nav.wording import counted

SECTORS, FEWEST_SECTORS = 12, 9
"""Of 30 degrees, and how many must hold a footfall for their means to say something."""

NO_ELLIPSE = "the footfalls lie on no ellipse: walk full circles, right and left, away from iron in the floor."

_SIZES = np.array([0.01, 0.01, 30.0, 30.0, 30.0])
"""Brings uT and 1/uT to numbers about 1, as fields on Earth have them."""


def likeliest_ellipse(readings: Floats) -> tuple[Ellipse, Bools]:
    """Fit readings (F, 2) uT, all finite; returns the ellipse and which of them were kept (F,).

    Raises
    ------
    CalibrationError
        Where there is no ellipse.
    """
    fit = _fit(readings)
    kept = readings[fit.kept]
    ellipse = _from_fit(fit.parameters, fit.covariance, fit.residual_uT, len(kept))
    lack = _lack_of_fit(_distance(fit.parameters, kept), heading_of_field(ellipse.corrected(kept)))
    worse = max(1.0, lack / max(fit.residual_uT, LEAST_UT) ** 2)
    return replace(ellipse, covariance=worse * ellipse.covariance), fit.kept


def _fit(readings: Floats) -> Fit:
    """Centre and matrix of the ellipse, scaled; a refusal is in words for somebody who walks."""
    try:
        centre, C = trimmed_quadric(readings)
        return robust_fit(_distance, readings, np.array([*centre, C[0, 0], C[0, 1], C[1, 1]]) * _SIZES)
    except CalibrationError:
        raise CalibrationError(NO_ELLIPSE) from None


def _distance(scaled: Floats, readings: Floats) -> Floats:
    """Distances (N,) uT of readings from the ellipse |C (m - o)| = 1."""
    x = scaled / _SIZES
    return distance(x[:2], np.array([[x[2], x[3]], [x[3], x[4]]]), readings)


def _from_fit(scaled: Floats, scaled_covariance: Floats, residual: float, samples: int) -> Ellipse:
    """Offset, axes and their covariance from the centre and the symmetric matrix that were fitted."""
    x, covariance = scaled / _SIZES, scaled_covariance / np.outer(_SIZES, _SIZES)
    (least, most), axes = np.linalg.eigh(np.array([[x[2], x[3]], [x[3], x[4]]]))
    if not least > 0.0:
        raise CalibrationError(NO_ELLIPSE)
    u = axes[:, 0]
    jacobian = np.zeros((4, 5))
    jacobian[:2, :2], jacobian[2:, 2:] = np.eye(2), _shape_by_matrix(u, least, most)
    return Ellipse(
        method="fitted",
        offset_uT=x[:2],
        eta_rad=half_turn(float(np.arctan2(u[1], u[0]))),
        tau=float(least / most),
        radius_uT=float(1.0 / most),
        covariance=jacobian @ covariance @ jacobian.T,
        residual_uT=residual,
        samples=samples,
    )


def _shape_by_matrix(u: Floats, least: float, most: float) -> Floats:
    """Derivatives (2, 3) of eta and tau by C_xx, C_xy, C_yy, C having the eigenvalue `least` along u, `most` across.

    With w = u turned left: d eta = (w . dC u) / (least - most), d tau = (u . dC u - tau w . dC w) / most.
    """
    w = np.array([-u[1], u[0]])
    between = min(least - most, -1e-9 * most)  # a circle's long axis has no direction: next to no knowledge, not none
    return np.stack([_by_entries(w, u) / between, (_by_entries(u, u) - least / most * _by_entries(w, w)) / most])


def _by_entries(a: Floats, b: Floats) -> Floats:
    """Derivatives (3,) of a . C b by C_xx, C_xy, C_yy."""
    return np.array([a[0] * b[0], a[0] * b[1] + a[1] * b[0], a[1] * b[1]])


def _lack_of_fit(residual: Floats, heading: Floats) -> float:
    """Variance (uT^2) of a reading, from the means of the residuals (F,) over sectors of heading (F,)."""
    sector = np.floor((heading / (2 * np.pi) % 1.0) * SECTORS).astype(np.int64) % SECTORS
    count = np.bincount(sector, minlength=SECTORS)
    total = np.bincount(sector, residual, minlength=SECTORS)
    held = count > 0
    if held.sum() < FEWEST_SECTORS:
        return 0.0
    return float((total[held] ** 2 / count[held]).sum() / (held.sum() - 5))


def footfalls_present(level_xy: Floats, fewest: int) -> Floats:
    """Readings (F, 2) without NaN rows; `CalibrationError` for too few."""
    readings = level_xy[np.isfinite(level_xy).all(axis=1)]
    if len(readings) < fewest:
        raise CalibrationError(
            f"{counted(len(readings), 'footfall')} with a field cannot make an ellipse: walk {fewest} in circles."
        )
    return np.asarray(readings)
