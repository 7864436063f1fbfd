"""Ma's ellipse from extremes (Eq. 6-8), as printed and with the quadrant put right. No covariance.

The model is that of `fg_nav.calibration.ellipse_shape`. Single readings decide: a wild one spoils it, and so does an
end of the ellipse that no footfall reached.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.ellipse_fit import footfalls_present
from fg_nav.calibration.ellipse_shape import Ellipse, half_turn


def ellipse_by_extremes(level_xy: Floats) -> Ellipse:
    """Find the ellipse from extremes: Ma Eq. 6-8 with eta = atan2(m_y1, m_x1) modulo pi. No covariance.

    Parameters
    ----------
    level_xy : (F, 2) uT, levelled axes; NaN rows are left out.
    """
    centred, offset = _about_extremes(level_xy)
    x1, y1 = centred[np.argmax(np.linalg.norm(centred, axis=1))]
    return _of_extremes("by extremes", centred, offset, half_turn(float(np.arctan2(y1, x1))))


def ellipse_as_printed(level_xy: Floats) -> Ellipse:
    """Find the ellipse as the paper prints it: Ma Eq. 6-8 with eta = asin(m_y1 / max r), mirrored where m_x1 < 0.

    Parameters
    ----------
    level_xy : (F, 2) uT, levelled axes; NaN rows are left out.
    """
    centred, offset = _about_extremes(level_xy)
    r = np.linalg.norm(centred, axis=1)
    return _of_extremes("as printed", centred, offset, float(np.arcsin(centred[np.argmax(r), 1] / r.max())))


def _about_extremes(level_xy: Floats) -> tuple[Floats, Floats]:
    """Readings about (max + min) / 2 of each axis, and that: Ma Eq. 6."""
    readings = footfalls_present(level_xy, 3)
    offset = (readings.max(axis=0) + readings.min(axis=0)) / 2
    return readings - offset, offset


def _of_extremes(method: str, centred: Floats, offset: Floats, eta: float) -> Ellipse:
    r = np.linalg.norm(centred, axis=1)
    found = Ellipse(
        method, offset, eta, float(r.min() / r.max()), float(r.min()), np.full((4, 4), np.nan), np.nan, len(centred)
    )
    spread = np.linalg.norm(found.corrected(centred + offset), axis=1) - found.radius_uT
    return replace(found, residual_uT=float(np.sqrt((spread**2).mean())))
