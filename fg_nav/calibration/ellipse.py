"""Ma's calibration on the shoe: the ellipse of the levelled field of a standing foot that turns round.

In levelled axes (x forward, y left, z up; `fg_nav.magnetic.footfall_field`), horizontal components only:

    m = o + (1/tau on u, 1 across u) b,    u = (cos eta, sin eta) the long axis,  tau = short axis / long axis
    b = C (m - o),    C = I - (1 - tau) u u^T                                        Ma (9)-(12)

so the corrected field lies on a circle whose radius is the short axis. The offset o holds in the levelled axes: hard
iron as long as the foot stands at the same tilt, plus the vertical field that soft iron and a steady levelling error
rotate into the plane. eta is a direction modulo pi. Center and symmetric matrix are fitted by least squares of
distances, |C (m - o)| = 1, a few wild footfalls left out (`fg_nav.calibration.ellipsoid`); they give offset, eta and
tau with their covariance. The paper's own way, by extremes: `fg_nav.lab.extremes`.

Lack of fit. Iron in the floor differs from place to place, and circles pass the same places again with the same
heading: its effect does not average out. So the variance of a reading is that of its distance from the ellipse, or, if
larger, that of the means of the distances over `SECTORS` of heading:

    s^2 = max(sum r^2 / (F - 5), sum n_j mean_j(r)^2 / (sectors - 5)).

Two sides. An effect of the floor with one or two periods in the round is an ellipse itself and leaves no residual. But
circles to the left stand elsewhere than circles to the right, with another ellipse. `calibrate_on_loop` fits both
apart; half the difference D of their (o_x, o_y, eta, tau) is as uncertain as the ellipse of all, whose covariance P
grows by

    max(1, D^T P^-1 D / 4).

On 36 simulated loops over a smooth floor (seeds below 100) errors are 1.3 of their sigmas with it, and 3.2 without.
Circles that all turn one way do not show the floor: their covariance does not include it, and a note says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.ellipsoid import MIN_UT, compute_distances, fit_robustly, fit_trimmed_quadric
from fg_nav.calibration.magnetometer import (
    LEVEL_FIELD_UT,
    UPPER,
    MagnetometerCalibration,
    check_strength,
    mean_up,
)
from fg_nav.errors import CalibrationError
from fg_nav.magnetic.footfall_field import FootfallField, compute_field_heading, compute_level_R_body
from fg_nav.text import format_count

UNKNOWN_UT = 30.0  # Sigma of hard iron along the vertical, not observable on a floor: the prior of a walk's.
SIDE_FOOTFALLS = 5  # Of the mean turn to the left or to the right.
UPRIGHT_DEG = 2.0  # An x axis so close to vertical has no heading: levelled axes turn about at random.
KNOWN_ETA_RAD = 0.3  # Sigma of a direction that is known: beyond 17 degrees a sigma of an angle has no meaning.
MIN_FOOTFALLS = 10  # Five parameters, and some footfalls to judge them by.
MAX_GAP_RAD = float(np.deg2rad(90.0))  # Between neighboring headings: three quarters of the round hold the ellipse.
MAX_SIGMA = 0.05  # Of the offset over the radius, and of half of tau: an error of 3 deg of heading for both.
LEVELLING_SIGMA_RAD = 0.003  # Steady error of up, per axis (3 mg, a calibrated MEMS part): an error of the hard iron.
SECTORS, MIN_SECTORS = 12, 9  # Of 30 degrees, and how many must hold a footfall for their means to count.

NO_ELLIPSE = "the footfalls lie on no ellipse: walk full circles, right and left, away from iron in the floor."
_SIZES = np.array([0.01, 0.01, 30.0, 30.0, 30.0])  # Scale uT and 1/uT to numbers about 1, as fields on Earth have them


@dataclass(frozen=True)
class Ellipse:
    """The ellipse of the levelled readings, and the circle of the corrected ones.

    Attributes
    ----------
    method : by name.
    offset_uT : o (2,), in levelled axes.
    eta_rad : from x to the long axis, counter-clockwise seen from above, in (-pi/2, pi/2].
    tau : short over long axis.
    radius_uT : short axis, the horizontal strength after the correction.
    covariance : (4, 4) of o_x, o_y, eta, tau; NaN where the method has none. The variance of eta grows without bound
        as tau goes to 1, where there is no long axis; (1 - tau) eta stays known.
    residual_uT : rms distance from the ellipse (with a covariance: that of the readings kept, by degrees of freedom).
    samples : number of readings.
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
        """Return the calibration of the body's readings, for a foot that stands with up at `body_up` (3,).

        h = R^T (o, 0), C = R^T blockdiag(C, 1) R with R = level_R_body. It holds for footfalls at that tilt, not for
        the swing. The vertical is left as it is: hard iron along it has a sigma of `UNKNOWN_UT`, which covers soft iron
        too; its effect of the vertical field over the ground is in o.

        Raises `CalibrationError` if the ellipse has no covariance.
        """
        if not np.isfinite(self.covariance).all():
            raise CalibrationError(f"the ellipse {self.method} has no covariance: use fit_ellipse.")
        R = compute_level_R_body(body_up)
        C = np.eye(3)
        C[:2, :2] = self.correction
        # derivatives (9, 4) of h and C by o, eta, tau
        u, across = R[:2].T @ along(self.eta_rad), R[:2].T @ along(self.eta_rad + np.pi / 2)
        lift = np.zeros((9, 4))
        lift[:3, :2] = R[:2].T
        lift[3:, 2] = -(1.0 - self.tau) * (np.outer(u, across) + np.outer(across, u))[UPPER]
        lift[3:, 3] = np.outer(u, u)[UPPER]
        covariance = lift @ self.covariance @ lift.T
        covariance[:3, :3] += UNKNOWN_UT**2 * np.outer(R[2], R[2])
        return MagnetometerCalibration(
            method=f"ellipse of the standing foot, {self.method}",
            hard_iron_uT=R[:2].T @ self.offset_uT,
            correction=R.T @ C @ R,
            covariance=covariance,
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


def along(angle: float) -> Floats:
    """Unit vector (2,) at an angle, rad."""
    return np.array([np.cos(angle), np.sin(angle)])


def half_turn(angle: float) -> float:
    """Direction modulo pi, in (-pi/2, pi/2]."""
    return float(np.pi / 2 - (np.pi / 2 - angle) % np.pi)


def rise_deg(body_up: Floats) -> float:
    """Elevation of the body's x axis."""
    return float(np.degrees(np.arctan2(body_up[0], np.linalg.norm(body_up[1:]))))


def select_levelled(level_xy: Floats, fewest: int) -> Floats:
    """Readings (F, 2) without NaN rows; `CalibrationError` for too few."""
    readings = level_xy[np.isfinite(level_xy).all(axis=1)]
    if len(readings) < fewest:
        raise CalibrationError(
            f"{format_count(len(readings), 'footfall')} with a field cannot make an ellipse: walk {fewest} in circles."
        )
    return np.asarray(readings)


def fit_ellipse(level_xy: Floats) -> Ellipse:
    """Fit an ellipse to levelled readings by robust least squares of their distances from it.

    `level_xy` (F, 2) uT, levelled axes, one a footfall; NaN rows are left out.

    Raises `CalibrationError` where the headings do not go round, naming the arc that is missing, or the readings leave
    a parameter open.
    """
    ellipse = _fit_round(level_xy)
    _check(ellipse)
    return replace(ellipse, notes=(*ellipse.notes, *_note_on_eta(ellipse)))


def calibrate_on_loop(field: FootfallField) -> tuple[Ellipse, MagnetometerCalibration]:
    """Fit the ellipse of a walk's footfalls, and lift it into the body at their mean tilt.

    The covariance includes the disagreement of circles to the left and to the right, and that of the offset a steady
    error of levelling, which the footfalls do not show.

    Raises `CalibrationError` as `fit_ellipse`, and for an x axis that stands upright.
    """
    body_up = mean_up(field.nav_R_body)
    if abs(rise_deg(body_up)) > 90.0 - UPRIGHT_DEG:
        raise CalibrationError(
            f"the sensor's x axis stands upright at the footfalls, within {UPRIGHT_DEG:g} deg, and has no direction "
            "over the ground: turn the sensor over by hand instead, or name its axes otherwise."
        )
    ellipse = _fit_round(field.level_field[:, :2])
    growth, note = _compare_sides(field, ellipse)
    ellipse = replace(ellipse, covariance=growth * ellipse.covariance)
    _check(ellipse)
    brought_in_uT = LEVELLING_SIGMA_RAD * float(np.nanmedian(field.level_field[:, 2]))
    levelling = np.diag([brought_in_uT**2, brought_in_uT**2, 0.0, 0.0])
    notes = (*ellipse.notes, note, *_note_on_eta(ellipse))
    ellipse = replace(ellipse, covariance=ellipse.covariance + levelling, notes=notes)
    return ellipse, ellipse.in_body(body_up)


def _fit_round(level_xy: Floats) -> Ellipse:
    """Fit levelled readings (F, 2) uT of all headings; raises where an arc is missing, but leaves sigmas unchecked."""
    readings = select_levelled(level_xy, MIN_FOOTFALLS)
    ellipse, kept = fit_likeliest_ellipse(readings)
    # a wide arc without a reading, by the headings that are missing
    heading = np.sort(compute_field_heading(ellipse.correct(readings[kept])))
    gaps = np.diff(heading, append=heading[0] + 2 * np.pi)
    k = int(np.argmax(gaps))
    if gaps[k] > MAX_GAP_RAD:
        first, last = np.degrees([heading[k], heading[k] + gaps[k]]) % 360.0
        raise CalibrationError(
            f"the footfalls do not go round: none has a magnetic heading from {first:.0f} to {last:.0f} deg clockwise "
            f"({np.degrees(gaps[k]):.0f} deg wide, at most {np.degrees(MAX_GAP_RAD):.0f} are allowed); "
            "walk a full circle, better one each way."
        )
    left_out = int((~kept).sum())
    notes = (f"{left_out} of {len(readings)} footfalls left out as outliers",) if left_out else ()
    return replace(ellipse, notes=notes)


def _compare_sides(field: FootfallField, ellipse: Ellipse) -> tuple[float, str]:
    """Covariance inflation factor from the disagreement of left and right circles, 1 without both, and a note."""
    turn = uniform_filter1d(np.gradient(np.unwrap(field.gyro_heading)), SIDE_FOOTFALLS)
    try:
        left, right = (_fit_round(field.level_field[side, :2]) for side in (turn < 0.0, turn > 0.0))
    except CalibrationError:
        return (
            1.0,
            "no full circles both ways: iron in the floor cannot be separated from the shoe's, and is in no sigma",
        )
    apart = (left.numbers - right.numbers) / 2
    apart[2] = half_turn(2 * apart[2]) / 2
    covariance = ellipse.covariance + MIN_UT**2 * np.eye(4)
    growth = max(1.0, float(apart @ np.linalg.solve(covariance, apart)) / 4)
    disagree = f"{np.sqrt(growth):.1f} times what the scatter alone explains"
    return growth, f"sigmas are {disagree}, for circles to the left and to the right disagree by so much"


def _check(ellipse: Ellipse) -> None:
    """Raise `CalibrationError` for a radius no field on Earth has, or sigmas above the limits."""
    check_strength(ellipse.radius_uT, LEVEL_FIELD_UT)
    x, y, _, tau = ellipse.sigma
    offset = max(x, y) / ellipse.radius_uT
    if max(offset, tau / 2) > MAX_SIGMA:
        raise CalibrationError(
            f"the footfalls scatter by {ellipse.residual_uT:.1f} uT about the ellipse and leave its offset open by "
            f"{offset:.2f} of its radius and tau by {tau:.2f} "
            f"(at most {MAX_SIGMA:g} and {2 * MAX_SIGMA:g} are allowed): "
            "walk more circles, away from iron in the floor."
        )


def _note_on_eta(ellipse: Ellipse) -> tuple[str, ...]:
    """Remark on an ellipse that is a circle within its sigma."""
    sigma = ellipse.sigma[2]
    if sigma < KNOWN_ETA_RAD:
        return ()
    return (
        f"tau {ellipse.tau:.3f} is a circle within its sigma of {ellipse.sigma[3]:.3f}: "
        "the direction eta of the long axis is not known, and matters as little",
    )


def fit_likeliest_ellipse(readings: Floats) -> tuple[Ellipse, Bools]:
    """Fit finite readings (F, 2) uT; return the ellipse and flags (F,) of the readings kept as inliers.

    Raises `CalibrationError` where there is no ellipse.
    """
    try:
        center, C = fit_trimmed_quadric(readings)
        fit = fit_robustly(_distances, readings, np.array([*center, C[0, 0], C[0, 1], C[1, 1]]) * _SIZES)
    except CalibrationError:
        raise CalibrationError(NO_ELLIPSE) from None
    # offset and axes from center and symmetric matrix
    x, covariance = fit.parameters / _SIZES, fit.covariance / np.outer(_SIZES, _SIZES)
    (least, most), axes = np.linalg.eigh(np.array([[x[2], x[3]], [x[3], x[4]]]))
    if not least > 0.0:
        raise CalibrationError(NO_ELLIPSE)
    u, w = axes[:, 0], np.array([-axes[1, 0], axes[0, 0]])
    # d eta = (w . dC u) / (least - most), d tau = (u . dC u - tau w . dC w) / most
    between = min(least - most, -1e-9 * most)  # a circle has no long axis: next to no information, not none
    jacobian = np.zeros((4, 5))
    jacobian[:2, :2] = np.eye(2)
    jacobian[2, 2:] = _differentiate_form(w, u) / between
    jacobian[3, 2:] = (_differentiate_form(u, u) - least / most * _differentiate_form(w, w)) / most
    kept = readings[fit.kept]
    ellipse = Ellipse(
        method="fitted",
        offset_uT=x[:2],
        eta_rad=half_turn(float(np.arctan2(u[1], u[0]))),
        tau=float(least / most),
        radius_uT=float(1.0 / most),
        covariance=jacobian @ covariance @ jacobian.T,
        residual_uT=fit.residual_uT,
        samples=len(kept),
    )
    # lack of fit: variance of a reading from the means of the distances over sectors of heading
    heading = compute_field_heading(ellipse.correct(kept))
    sector = np.floor((heading / (2 * np.pi) % 1.0) * SECTORS).astype(np.int64) % SECTORS
    count = np.bincount(sector, minlength=SECTORS)
    total, held = np.bincount(sector, _distances(fit.parameters, kept), minlength=SECTORS), count > 0
    lack = float((total[held] ** 2 / count[held]).sum() / (held.sum() - 5)) if held.sum() >= MIN_SECTORS else 0.0
    worse = max(1.0, lack / max(fit.residual_uT, MIN_UT) ** 2)
    return replace(ellipse, covariance=worse * ellipse.covariance), fit.kept


def _distances(scaled: Floats, readings: Floats) -> Floats:
    """Distances (N,) uT of readings from the ellipse |C (m - o)| = 1."""
    x = scaled / _SIZES
    return compute_distances(x[:2], np.array([[x[2], x[3]], [x[3], x[4]]]), readings)


def _differentiate_form(a: Floats, b: Floats) -> Floats:
    """Derivatives (3,) of a . C b by C_xx, C_xy, C_yy."""
    return np.array([a[0] * b[0], a[0] * b[1] + a[1] * b[0], a[1] * b[1]])
