"""The ellipse on which the levelled field of a standing foot lies as it turns round, and what takes it to a circle.

In levelled axes (x forward, y left, z up; `fg_nav.magnetic.footfall_field`), horizontal components only:

    m = o + (1/tau on u, 1 across u) b,    u = (cos eta, sin eta) the long axis,  tau = short axis / long axis
    b = C (m - o),    C = I - (1 - tau) u u^T                                        Ma (9)-(12)

so the corrected field lies on a circle whose radius is the short axis. The offset o holds in the levelled axes: it is
hard iron as long as the foot stands at the same tilt, plus what vertical field the soft iron and a steady error of
levelling turn into the plane. eta is a direction without an arrow, modulo pi.

`find_ellipse_by_extremes` and `find_ellipse_as_printed` find it as the paper does, Ma (6)-(8), without a covariance:
single readings decide, so a wild one spoils it, and so does an end of the ellipse that no footfall reached. The least
squares fit is in `fg_nav.calibration.ellipse_fit`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.magnetometer import UPPER, MagnetometerCalibration
from fg_nav.errors import CalibrationError
from fg_nav.magnetic.footfall_field import compute_level_R_body
from fg_nav.text import format_count

UNKNOWN_UT = 30.0
"""Sigma of hard iron along the vertical, of which circles on a floor say nothing: the prior of
`fg_nav.calibration.walk`."""


@dataclass(frozen=True)
class Ellipse:
    """The ellipse of the levelled readings, and the circle it is brought to.

    Attributes
    ----------
    method : how it was found.
    offset_uT : o (2,), in levelled axes.
    eta_rad : from x to the long axis, counter-clockwise seen from above, in (-pi/2, pi/2].
    tau : short over long axis.
    radius_uT : short axis, the horizontal strength after the correction.
    covariance : (4, 4) of o_x, o_y, eta, tau; NaN where the method has none. The variance of eta grows without bound
        as tau goes to 1, where there is no long axis; (1 - tau) eta stays known.
    residual_uT : rms distance from the ellipse (with a covariance: that of the readings kept, by degrees of freedom).
    samples : readings that it rests on.
    notes : remarks for the user.
    """

    method: str
    offset_uT: Floats
    eta_rad: float
    tau: float
    radius_uT: float
    covariance: Floats
    residual_uT: float
    samples: int
    notes: tuple[str, ...] = ()

    @property
    def numbers(self) -> Floats:
        """(4,) o_x, o_y (uT), eta (rad), tau."""
        return np.array([*self.offset_uT, self.eta_rad, self.tau])

    @property
    def sigma(self) -> Floats:
        """(4,) standard deviations of o_x, o_y (uT), eta (rad), tau."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correction(self) -> Floats:
        """C (2, 2)."""
        long_axis = along(self.eta_rad)
        return np.asarray(np.eye(2) - (1.0 - self.tau) * np.outer(long_axis, long_axis))

    def correct(self, level_xy: Floats) -> Floats:
        """Horizontal field (..., 2) uT on the circle, from levelled readings (..., 2) uT."""
        return np.asarray((level_xy - self.offset_uT) @ self.correction)

    def in_body(self, body_up: Floats) -> MagnetometerCalibration:
        """The same as a calibration of the body's readings, for a foot that stands with up at `body_up` (3,).

        h = R^T (o, 0), C = R^T blockdiag(C, 1) R with R = level_R_body. It holds for footfalls at that tilt, not for
        the swing. The vertical is left as it is: hard iron along it has a sigma of `UNKNOWN_UT`, which stands for soft
        iron too; what that makes of the vertical field over the ground is in o.

        Raises `CalibrationError` if the ellipse has no covariance.
        """
        if not np.isfinite(self.covariance).all():
            raise CalibrationError(f"the ellipse {self.method} has no covariance: use fit_ellipse.")
        R = compute_level_R_body(body_up)
        C = np.eye(3)
        C[:2, :2] = self.correction
        lift = self._lift(R)
        return MagnetometerCalibration(
            method=f"ellipse of the standing foot, {self.method}",
            hard_iron_uT=R[:2].T @ self.offset_uT,
            correction=R.T @ C @ R,
            covariance=lift @ self.covariance @ lift.T + _build_unknown_covariance(R[2]),
            strength_uT=self.radius_uT,
            residual_uT=self.residual_uT,
            samples=self.samples,
            notes=(
                *self.notes,
                f"holds for a foot that stands as in this walk, its x axis {rise_deg(body_up):.0f} deg above level, "
                "and not on stairs or in the swing",
                "strength and residual are those of the horizontal field; along the vertical iron is not known and the "
                "field is left as it is",
            ),
        )

    def _lift(self, R: Floats) -> Floats:
        """Derivatives (9, 4) of h and C in the body by o, eta, tau."""
        u, across = R[:2].T @ along(self.eta_rad), R[:2].T @ along(self.eta_rad + np.pi / 2)
        by_eta = -(1.0 - self.tau) * (np.outer(u, across) + np.outer(across, u))
        lift = np.zeros((9, 4))
        lift[:3, :2] = R[:2].T
        lift[3:, 2], lift[3:, 3] = by_eta[UPPER], np.outer(u, u)[UPPER]
        return lift


def along(angle: float) -> Floats:
    """Unit vector (2,)."""
    return np.array([np.cos(angle), np.sin(angle)])


def half_turn(angle: float) -> float:
    """Direction without an arrow, in (-pi/2, pi/2]."""
    return float(np.pi / 2 - (np.pi / 2 - angle) % np.pi)


def _build_unknown_covariance(up: Floats) -> Floats:
    """Covariance (9, 9) of a hard iron along `up` (3,) in the body of which nothing is known."""
    unknown = np.zeros((9, 9))
    unknown[:3, :3] = UNKNOWN_UT**2 * np.outer(up, up)
    return unknown


def rise_deg(body_up: Floats) -> float:
    """How far the body's x axis points above level."""
    return float(np.degrees(np.arctan2(body_up[0], np.linalg.norm(body_up[1:]))))


def select_levelled(level_xy: Floats, fewest: int) -> Floats:
    """Readings (F, 2) without NaN rows; `CalibrationError` for too few."""
    readings = level_xy[np.isfinite(level_xy).all(axis=1)]
    if len(readings) < fewest:
        raise CalibrationError(
            f"{format_count(len(readings), 'footfall')} with a field cannot make an ellipse: walk {fewest} in circles."
        )
    return np.asarray(readings)


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
    r = np.linalg.norm(centered, axis=1)
    found = Ellipse(
        method, offset, eta, float(r.min() / r.max()), float(r.min()), np.full((4, 4), np.nan), np.nan, len(centered)
    )
    spread = np.linalg.norm(found.correct(centered + offset), axis=1) - found.radius_uT
    return replace(found, residual_uT=float(np.sqrt((spread**2).mean())))
