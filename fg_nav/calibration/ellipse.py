"""Ma's calibration on the shoe: the levelled field of the standing foot, turned round, lies on an ellipse.

In levelled axes (x forward, y left, z up; `fg_nav.magnetic.compass`), horizontal components only:

    m = o + (1/tau on u, 1 across u) b,    u = (cos eta, sin eta) the long axis,  tau = short axis / long axis
    b = C (m - o),    C = I - (1 - tau) u u^T                                        Ma et al. 2018, Eq. 9-12

so the corrected field lies on a circle whose radius is the short axis. The offset o holds in the levelled axes: it is
hard iron as long as the foot stands at the same tilt, plus what vertical field the soft iron and a steady error of
levelling turn into the plane. eta is a direction without an arrow, modulo pi.

`fitted_ellipse` is the default: least squares in which a few wild footfalls do not matter, with a covariance. The
paper finds the same numbers from extremes (Eq. 6-8): `ellipse_as_printed`, and `ellipse_by_extremes` with the quadrant
put right: asin in Eq. 8 mirrors the long axis whenever the farthest reading has x < 0.

Iron in the floor is another at every place, and circles pass the same places again with the same heading: what it does
to the readings is no noise that averages out. So the variance of a reading is that of its distance from the ellipse,
or, if larger, that which the means of the distances over `SECTORS` of heading show (lack of fit):

    s^2 = max(sum r^2 / (F - 5), sum n_j mean_j(r)^2 / (sectors - 5)).

What the floor does with one or two periods in the round is an ellipse itself: no residual can tell it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.magnetometer import UPPER, MagnetometerCalibration
from fg_nav.calibration.quadric import LEAST_UT, NO_ELLIPSOID, distance, trimmed_quadric
from fg_nav.calibration.robust import robust_fit
from fg_nav.errors import CalibrationError
from fg_nav.magnetic.compass import heading_of_field, level_R_body
from fg_nav.magnetic.footfall_field import FootfallField

SECTORS, FEWEST_SECTORS = 12, 9
"""Of 30 degrees, and how many must hold a footfall for their means to say something."""

KNOWN_ETA_RAD = 0.3
"""A direction with more sigma than this is no direction: 17 degrees, and beyond it sigma is no more than a word."""


@dataclass(frozen=True)
class EllipseParameters:
    """When to refuse.

    Attributes
    ----------
    fewest : footfalls; five numbers want a few more to be judged by.
    largest_gap_rad : between neighbouring directions about the centre. Ma turns by 15 to 35 deg from step to step;
        with a quarter of the round missing the two ends of it still hold the ellipse.
    largest_sigma : of the offset over the radius, and of tau: 0.05 is an error of 3 deg of heading.
    levelling_sigma_rad : steady error of up, per axis: an accelerometer that is wrong by 3 mg, as a calibrated MEMS
        part is. What vertical field it brings into the plane looks like an offset, and belongs to it as long as the
        same levelling is used; for the hard iron it is an error.
    """

    fewest: int = 10
    largest_gap_rad: float = np.deg2rad(90.0)
    largest_sigma: float = 0.05
    levelling_sigma_rad: float = 0.003


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
    def sigma(self) -> Floats:
        """(4,) standard deviations of o_x, o_y (uT), eta (rad), tau."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correction(self) -> Floats:
        """C (2, 2)."""
        long_axis = _along(self.eta_rad)
        return np.asarray(np.eye(2) - (1.0 - self.tau) * np.outer(long_axis, long_axis))

    def corrected(self, level_xy: Floats) -> Floats:
        """Horizontal field (..., 2) uT on the circle, from levelled readings (..., 2) uT."""
        return np.asarray((level_xy - self.offset_uT) @ self.correction)

    def in_body(self, body_up: Floats) -> MagnetometerCalibration:
        """The same as a calibration of the body's readings, for a foot that stands with up at `body_up` (3,).

        h = R^T (o, 0), C = R^T blockdiag(C, 1) R with R = level_R_body. It holds for footfalls at that tilt, not for
        the swing. The vertical is left as it is.

        Raises
        ------
        CalibrationError
            If the ellipse has no covariance.
        """
        if not np.isfinite(self.covariance).all():
            raise CalibrationError(f"the ellipse {self.method} has no covariance: use fitted_ellipse.")
        R = level_R_body(body_up)
        C = np.eye(3)
        C[:2, :2] = self.correction
        lift = self._lift(R)
        return MagnetometerCalibration(
            method=f"ellipse of the standing foot, {self.method}",
            hard_iron_uT=R[:2].T @ self.offset_uT,
            correction=R.T @ C @ R,
            covariance=lift @ self.covariance @ lift.T,
            strength_uT=self.radius_uT,
            residual_uT=self.residual_uT,
            samples=self.samples,
            notes=(
                *self.notes,
                f"holds for a foot that stands as in this walk, its x axis {_rise_deg(body_up):.0f} deg above level, "
                "and not on stairs or in the swing",
                "strength and residual are those of the horizontal field; the vertical is left as it is",
            ),
        )

    def _lift(self, R: Floats) -> Floats:
        """Derivatives (9, 4) of h and C in the body by o, eta, tau."""
        u, across = R[:2].T @ _along(self.eta_rad), R[:2].T @ _along(self.eta_rad + np.pi / 2)
        by_eta = -(1.0 - self.tau) * (np.outer(u, across) + np.outer(across, u))
        lift = np.zeros((9, 4))
        lift[:3, :2] = R[:2].T
        lift[3:, 2], lift[3:, 3] = by_eta[UPPER], np.outer(u, u)[UPPER]
        return lift


def fitted_ellipse(level_xy: Floats, parameters: EllipseParameters = EllipseParameters()) -> Ellipse:
    """Fit an ellipse to levelled readings by robust least squares of their distances from it.

    Parameters
    ----------
    level_xy : (F, 2) uT, levelled axes, one a footfall; NaN rows are left out.
    parameters : when to refuse.

    Raises
    ------
    CalibrationError
        Where the headings do not go round, telling which arc is missing, or the readings leave a parameter open.
    """
    readings = _present(level_xy, parameters.fewest)
    centre, C = trimmed_quadric(readings)
    fit = robust_fit(_distance, readings, np.array([*centre, C[0, 0], C[0, 1], C[1, 1]]) * _SIZES)
    kept = readings[fit.kept]
    ellipse = _from_fit(fit.parameters, fit.covariance, fit.residual_uT, len(kept))
    lack = _lack_of_fit(_distance(fit.parameters, kept), heading_of_field(ellipse.corrected(kept)))
    worse = max(1.0, lack / max(fit.residual_uT, LEAST_UT) ** 2)
    ellipse = replace(ellipse, covariance=worse * ellipse.covariance)
    _check_round(ellipse.corrected(kept), parameters.largest_gap_rad)
    _check_sigma(ellipse, parameters.largest_sigma)
    left_out = len(readings) - ellipse.samples
    notes = (f"{left_out} of {len(readings)} footfalls left out as outliers",) if left_out else ()
    return replace(ellipse, notes=(*notes, *_note_on_eta(ellipse)))


def ellipse_of_walk(
    field: FootfallField, parameters: EllipseParameters = EllipseParameters()
) -> tuple[Ellipse, MagnetometerCalibration]:
    """Fit the ellipse of a walk's footfalls, and lift it into the body at their mean tilt.

    The covariance of the offset has that of a steady error of levelling in it, which the footfalls do not show.

    Raises
    ------
    CalibrationError
        As `fitted_ellipse`.
    """
    ellipse = fitted_ellipse(field.level_field[:, :2], parameters)
    brought_in_uT = parameters.levelling_sigma_rad * float(np.nanmedian(field.level_field[:, 2]))
    levelling = np.diag([brought_in_uT**2, brought_in_uT**2, 0.0, 0.0])
    ellipse = replace(ellipse, covariance=ellipse.covariance + levelling)
    return ellipse, ellipse.in_body(mean_up(field))


def mean_up(field: FootfallField) -> Floats:
    """Mean direction (3,) of up in the body at the footfalls."""
    total = field.nav_R_body[:, 2].sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))


def ellipse_by_extremes(level_xy: Floats) -> Ellipse:
    """Find the ellipse from extremes: Ma Eq. 6-8 with eta = atan2(m_y1, m_x1) modulo pi. No covariance.

    Parameters
    ----------
    level_xy : (F, 2) uT, levelled axes; NaN rows are left out.
    """
    centred, offset = _about_extremes(level_xy)
    x1, y1 = centred[np.argmax(np.linalg.norm(centred, axis=1))]
    return _of_extremes("by extremes", centred, offset, _half_turn(float(np.arctan2(y1, x1))))


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
    readings = _present(level_xy, 3)
    offset = (readings.max(axis=0) + readings.min(axis=0)) / 2
    return readings - offset, offset


def _of_extremes(method: str, centred: Floats, offset: Floats, eta: float) -> Ellipse:
    r = np.linalg.norm(centred, axis=1)
    found = Ellipse(
        method, offset, eta, float(r.min() / r.max()), float(r.min()), np.full((4, 4), np.nan), np.nan, len(centred)
    )
    spread = np.linalg.norm(found.corrected(centred + offset), axis=1) - found.radius_uT
    return replace(found, residual_uT=float(np.sqrt((spread**2).mean())))


_SIZES = np.array([0.01, 0.01, 30.0, 30.0, 30.0])
"""Brings uT and 1/uT to numbers about 1, as fields on Earth have them."""


def _distance(scaled: Floats, readings: Floats) -> Floats:
    """Distances (N,) uT of readings from the ellipse |C (m - o)| = 1."""
    x = scaled / _SIZES
    return distance(x[:2], np.array([[x[2], x[3]], [x[3], x[4]]]), readings)


def _from_fit(scaled: Floats, scaled_covariance: Floats, residual: float, samples: int) -> Ellipse:
    """Offset, axes and their covariance from the centre and the symmetric matrix that were fitted."""
    x, covariance = scaled / _SIZES, scaled_covariance / np.outer(_SIZES, _SIZES)
    (least, most), axes = np.linalg.eigh(np.array([[x[2], x[3]], [x[3], x[4]]]))
    if not least > 0.0:
        raise CalibrationError(NO_ELLIPSOID)
    u = axes[:, 0]
    jacobian = np.zeros((4, 5))
    jacobian[:2, :2], jacobian[2:, 2:] = np.eye(2), _shape_by_matrix(u, least, most)
    return Ellipse(
        method="fitted",
        offset_uT=x[:2],
        eta_rad=_half_turn(float(np.arctan2(u[1], u[0]))),
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


def _check_round(corrected: Floats, largest_gap: float) -> None:
    """Refuse where no reading points over a wide arc, and name it by the headings that the foot did not have."""
    heading = np.sort(heading_of_field(corrected))
    gaps = np.diff(heading, append=heading[0] + 2 * np.pi)
    k = int(np.argmax(gaps))
    if gaps[k] > largest_gap:
        first, last = np.degrees([heading[k], heading[k] + gaps[k]]) % 360.0
        raise CalibrationError(
            f"the footfalls do not go round: none has a magnetic heading from {first:.0f} to {last:.0f} deg clockwise "
            f"({np.degrees(gaps[k]):.0f} deg wide, at most {np.degrees(largest_gap):.0f} are allowed); "
            "walk a full circle, better one each way."
        )


def _check_sigma(ellipse: Ellipse, largest: float) -> None:
    x, y, _, tau = ellipse.sigma
    offset = max(x, y) / ellipse.radius_uT
    if max(offset, tau) > largest:
        raise CalibrationError(
            f"the footfalls scatter by {ellipse.residual_uT:.1f} uT about the ellipse, which leaves its offset open by "
            f"{offset:.2f} of its radius and tau by {tau:.2f} (at most {largest} of either): walk more circles, "
            "away from iron in the floor."
        )


def _note_on_eta(ellipse: Ellipse) -> tuple[str, ...]:
    sigma = ellipse.sigma[2]
    if sigma < KNOWN_ETA_RAD:
        return ()
    return (
        f"tau {ellipse.tau:.3f} is a circle within its sigma of {ellipse.sigma[3]:.3f}: "
        "the direction eta of the long axis is not known, and matters as little",
    )


def _present(level_xy: Floats, fewest: int) -> Floats:
    readings = level_xy[np.isfinite(level_xy).all(axis=1)]
    if len(readings) < fewest:
        raise CalibrationError(f"{len(readings)} footfalls with a field are no ellipse: walk {fewest} or more.")
    return np.asarray(readings)


def _along(angle: float) -> Floats:
    return np.array([np.cos(angle), np.sin(angle)])


def _half_turn(angle: float) -> float:
    """Direction without an arrow, in (-pi/2, pi/2]."""
    return float(np.pi / 2 - (np.pi / 2 - angle) % np.pi)


def _rise_deg(body_up: Floats) -> float:
    return float(np.degrees(np.arcsin(body_up[0] / np.linalg.norm(body_up))))
