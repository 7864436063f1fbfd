"""The ellipse of the levelled field by extremes, Ma (6)-(8): as the paper has it, without a covariance.

Single readings decide, so a wild one spoils it, and so does an end of the ellipse that no footfall reached. The least
squares fit and the symbols: `fg_nav.calibration.ellipsoid`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.ellipsoid import Ellipse, half_turn, select_levelled


def find_ellipse_by_extremes(level_xy: Floats) -> Ellipse:
    """Find the ellipse from extremes: Ma (6)-(8) with eta = atan2(m_y1, m_x1) modulo pi. No covariance.

    `level_xy` (F, 2) uT, levelled axes; NaN rows are left out.
    """
    centered, offset = _center_between_extremes(level_xy)
    x1, y1 = centered[np.argmax(np.linalg.norm(centered, axis=1))]
    return _build_ellipse("by extremes", centered, offset, half_turn(float(np.arctan2(y1, x1))))


def find_ellipse_as_printed(level_xy: Floats) -> Ellipse:
    """Find the ellipse as the paper prints it: Ma (6)-(8) with eta = asin(m_y1 / max r), mirrored where m_x1 < 0.

    `level_xy` (F, 2) uT, levelled axes; NaN rows are left out.
    """
    centered, offset = _center_between_extremes(level_xy)
    r = np.linalg.norm(centered, axis=1)
    return _build_ellipse("as printed", centered, offset, float(np.arcsin(centered[np.argmax(r), 1] / r.max())))


def _center_between_extremes(level_xy: Floats) -> tuple[Floats, Floats]:
    """Readings about (max + min) / 2 of each axis, and that: Ma (6)."""
    readings = select_levelled(level_xy, 3)
    offset = (readings.max(axis=0) + readings.min(axis=0)) / 2
    return readings - offset, offset


def _build_ellipse(method: str, centered: Floats, offset: Floats, eta: float) -> Ellipse:
    """Axes by the least and the greatest distance, Ma (7)."""
    r = np.linalg.norm(centered, axis=1)
    found = Ellipse(
        method, offset, eta, float(r.min() / r.max()), float(r.min()), np.full((4, 4), np.nan), np.nan, len(centered)
    )
    spread = np.linalg.norm(found.correct(centered + offset), axis=1) - found.radius_uT
    return replace(found, residual_uT=float(np.sqrt((spread**2).mean())))


def upper_triangular(correction: Floats) -> Floats:
    """Turn a correction C (3, 3) into the upper triangular one with the same strengths: K_c of Ma 2018, Table 1.

    K^T K = C^T C, with positive diagonal. The corrected field is turned by what C and K differ in.
    """
    return np.asarray(np.linalg.cholesky(correction.T @ correction).T)
