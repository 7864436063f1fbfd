"""Fits of quadrics: a magnetometer turned over in one field (ellipsoid), or on a foot that turns round (ellipse).

Quadric through readings (N, n), n = 2 or 3,

    x^T A x + 2 v^T x + d = 0        A (n, n) symmetric

with the monomials x_i x_j (i <= j), 2 x_i, 1 in the columns of a design matrix. About its center h it is

    |C (x - h)| = 1,   h = -A^-1 v,   C = (A / (h^T A h - d))^1/2 symmetric.

Start: least squares under a constraint that cannot end in a hyperboloid (Fang et al. 2011, Ma et al. 2018: CLSEF), in
the plane 4ac - b^2 = 1 (Fitzgibbon), in space 4J - I^2 = 1 with I and J the sum of the eigenvalues of A and that of
their products by pairs (Li and Griffiths 2004), without readings beyond `TRIM_SIGMAS` of the bulk. Then (`fit_quadric`)
the likeliest parameters, the residual being the distance of a reading from the quadric, uT, to first order in white
noise of equal strength on each axis,

    r = (|v| - 1) / |C v / |v||,   v = C (m - h),   covariance = s^2 (J^T J)^-1,   s^2 = sum r^2 / (kept - parameters).

Cauchy's loss finds the bulk of the distances, those beyond `OUTLIER_SIGMAS` of it are left out, and the rest is fitted
plainly, until nothing changes.

Ellipsoid (`fit_ellipsoid`), |C (m - h)| = F with F the strength of the field. Readings alone do not show F: C and F can
be scaled together. With the strength unknown det C = 1, which preserves volumes, and F is estimated; the covariance of
C then has rank 5. With the strength given, F counts as exact.

`fit_unit_sphere` (Munoz Diaz et al. 2017, section 3.2; the paper does not print its algebra): plain least squares about
the readings' mean and in units of their spread,

    a . (squares and products of x) + b . x = 1        N equations, nine numbers.

It minimizes no distance, the squared noise biases it, one wild reading spoils it, and a hyperboloid is refused. Its
covariance is that of the equations as they scatter (White 1980), without that bias.

Ellipse (`calibrate_on_loop`), Ma's calibration on the shoe: the levelled field of a standing foot that turns round. In
levelled axes (x forward, y left, z up; `fg_nav.magnetic.footfall_field`), horizontal components only:

    m = o + (1/tau on u, 1 across u) b,    u = (cos eta, sin eta) the long axis,  tau = short axis / long axis
    b = C (m - o),    C = I - (1 - tau) u u^T                                        Ma (9)-(12)

so the corrected field lies on a circle whose radius is the short axis. The offset o holds in the levelled axes: hard
iron as long as the foot stands at the same tilt, plus the vertical field that soft iron and a steady levelling error
rotate into the plane. eta is a direction modulo pi. The paper's own way, by extremes: `fg_nav.lab.extremes`.

Lack of fit. Iron in the floor differs from place to place, and circles pass the same places again with the same
heading: its effect does not average out. So the variance of a reading is that of its distance from the ellipse, or, if
larger, that of the means of the distances over `SECTORS` of heading:

    s^2 = max(sum r^2 / (F - 5), sum n_j mean_j(r)^2 / (sectors - 5)).

Two sides (docs/field.md). Circles to the left and to the right are fitted apart; half the difference D of their
(o_x, o_y, eta, tau) is as uncertain as the ellipse of all, whose covariance P grows by max(1, D^T P^-1 D / 4). Circles
that all turn one way do not show the floor: a note says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from fg_nav.arrays import Bools, Floats, robust_sigma
from fg_nav.calibration import (
    LEVEL_FIELD_UT,
    UPPER,
    MagnetometerCalibration,
    check_strength,
    matrix_of,
    mean_up,
)
from fg_nav.errors import CalibrationError
from fg_nav.magnetic.footfall_field import FootfallField, compute_field_heading, compute_level_R_body
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
UNKNOWN_UT = 30.0  # Sigma of hard iron along the vertical, not observable on a floor: the prior of a walk's.
SIDE_FOOTFALLS = 5  # Of the mean turn to the left or to the right.
UPRIGHT_DEG = 2.0  # An x axis so close to vertical has no heading: levelled axes turn about at random.
KNOWN_ETA_RAD = 0.3  # Sigma of a direction that is known: beyond 17 degrees a sigma of an angle has no meaning.
MIN_FOOTFALLS = 10  # Five parameters, and some footfalls to judge them by.
MAX_GAP_RAD = float(np.deg2rad(90.0))  # Between neighboring headings: three quarters of the round hold the ellipse.
LEVELLING_SIGMA_RAD = 0.003  # Steady error of up, per axis (3 mg, a calibrated MEMS part): an error of the hard iron.
LEVEL_SIZES = 100.0, 1.0 / 30.0  # Of center (uT) and C (1/uT) over ground: fixed, as a short arc may guess any size.
SECTORS, MIN_SECTORS = 12, 9  # Of 30 degrees, and how many must hold a footfall for their means to count.

NO_ELLIPSOID = "the readings lie on no ellipsoid: turn the sensor in more directions, away from iron that stays behind."
NO_ELLIPSE = "the footfalls lie on no ellipse: walk full circles, right and left, away from iron in the floor."


# --- the sensor turned over ------------------------------------------------------------------------------------------


def fit_ellipsoid(readings: Floats, strength_uT: float | None = None) -> MagnetometerCalibration:
    """Calibrate from readings (N, 3) uT of a sensor turned about in a homogeneous field, of a strength if it is known.

    Raises `CalibrationError` where the directions covered leave a parameter open, naming the weakest direction, or the
    field was not the same throughout, or is none that Earth has.
    """
    present = _select_readings(readings, strength_uT)
    fit = fit_quadric(present)
    if not np.linalg.eigvalsh(fit.C).min() > 0.0:
        raise CalibrationError(NO_ELLIPSOID)
    # C of the given strength, or of det C = 1: dC = dA - A trace(A^-1 dA) / 3, A the fitted matrix
    strength, by_A = strength_uT, np.eye(6)
    if strength is None:
        strength = float(np.linalg.det(fit.C) ** (-1 / 3))
        trace = np.where(UPPER[0] == UPPER[1], 1.0, 2.0) * np.linalg.inv(fit.C)[UPPER]
        by_A -= np.outer(fit.C[UPPER], trace) / 3.0
    to_C = np.eye(9)
    to_C[3:, 3:] = strength * by_A
    found = MagnetometerCalibration(
        method="ellipsoid",
        hard_iron_uT=fit.center,
        correction=strength * fit.C,
        covariance=to_C @ fit.covariance @ to_C.T,
        strength_uT=strength,
        residual_uT=fit.residual_uT,
        samples=int(fit.kept.sum()),
    )
    coverage = _check_fit(found, found.residual_uT, present[fit.kept])
    left_out = len(present) - found.samples
    notes = (coverage, f"{left_out} of {len(present)} readings left out as outliers")
    return replace(found, notes=notes if left_out else notes[:1])


def fit_unit_sphere(readings: Floats, strength_uT: float = 1.0) -> MagnetometerCalibration:
    """Calibrate from readings (N, 3) uT as the paper does; corrected ones have length 1, or that of the field, uT.

    Raises `CalibrationError` where the readings are too few or lie on no ellipsoid, and as `fit_ellipsoid`.
    """
    present = _select_readings(readings, strength_uT)
    x, middle, scale = _scale_readings(present)
    quadratic, rest = _make_design(x)
    columns = np.hstack([quadratic, rest[:, :3]])
    # nine numbers, and their covariance by the scatter of the equations
    solution, _, rank, _ = np.linalg.lstsq(columns, np.ones(len(columns)), rcond=1e-10)
    p = np.asarray(solution, dtype=np.float64)
    if rank < columns.shape[1]:
        raise CalibrationError(NO_ELLIPSOID)
    influence = np.linalg.pinv(columns) * (1.0 - columns @ p)

    def parameters(p: Floats) -> Floats:
        """Center and the upper half of C (9,) of |C (m - h)| = 1."""
        center, C = _find_center(p[:6], np.append(p[6:], -1.0))
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
    apart = compute_distances(h, C / strength_uT, present)
    coverage = _check_fit(found, float(np.sqrt((apart**2).mean())), present)
    return replace(found, notes=(coverage, f"corrected readings have length {strength_uT:g}"))


def _select_readings(readings: Floats, strength_uT: float | None) -> Floats:
    """Readings (N, 3) without NaN rows; refuses too few, a sensor that was not turned, and a strength that is none."""
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
    if strength_uT is not None and not 0.0 < strength_uT < np.inf:
        raise CalibrationError(f"a field of {strength_uT} uT is none: give its strength, or None.")
    return np.asarray(present)


def _check_fit(found: MagnetometerCalibration, residual_uT: float, readings: Floats) -> str:
    """Refuse an ellipsoid with an open parameter, of a size that no field has, or with a large residual, uncorrected.

    Returns the coverage of the sphere by `readings` (N, 3) uT in words.
    """
    share, weakest, weakest_share = measure_coverage(readings - found.hard_iron_uT)
    x, y, z = weakest
    coverage = (
        f"{100 * share:.0f} % of all directions covered, weakest along ({x:+.2f}, {y:+.2f}, {z:+.2f}) of the "
        f"sensor's axes ({100 * weakest_share:.0f} % of an even tumbling)"
    )
    scale = float(np.cbrt(np.linalg.det(found.correction)))
    size_uT = found.strength_uT / scale
    hard_uT, soft = found.sigma[:3].max(), found.sigma[3:].max() / scale
    if max(hard_uT / size_uT, soft) > MAX_SIGMA:
        raise CalibrationError(
            f"the readings leave the hard iron open by {hard_uT:.1f} uT and the soft iron by "
            f"{100 * soft:.0f} % (at most {100 * MAX_SIGMA:g} % of the field are allowed): {coverage}; "
            "turn the sensor so that the field points there too."
        )
    check_strength(size_uT)
    if residual_uT > MAX_RESIDUAL * size_uT:
        raise CalibrationError(
            f"the readings scatter by {residual_uT:.1f} uT about an ellipsoid of {size_uT:.0f} uT, and "
            f"{100 * MAX_RESIDUAL:g} % of it at most are allowed: the field was not the same "
            "everywhere, so turn the sensor in one place away from iron."
        )
    return coverage


def measure_coverage(body_field: Floats) -> tuple[float, Floats, float]:
    """Coverage of the sphere by readings (N, 3) uT less hard iron; soft iron is ignored, for a bad C blows a plane up.

    Returns the share of the patches that hold a reading, the unit axis (3,) along which the readings point least, and
    three times the mean square of their component along it: 1 for an even tumbling, 0 in a plane.
    """
    direction = body_field / np.linalg.norm(body_field, axis=1, keepdims=True)
    k = np.arange(CELLS) + 0.5
    z, angle = 1.0 - 2.0 * k / CELLS, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z**2)
    lattice = np.stack([across * np.cos(angle), across * np.sin(angle), z])
    cell = np.argmax(direction @ lattice, axis=1)
    size, axes = np.linalg.eigh(direction.T @ direction / len(direction))
    return len(np.unique(cell)) / CELLS, axes[:, 0], float(3.0 * size[0])


# --- a loop on the shoe ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ellipse:
    """The ellipse of the levelled readings, and the circle of the corrected ones."""

    method: str  # By name.
    offset_uT: Floats  # o (2,), in levelled axes.
    eta_rad: float  # From x to the long axis, counter-clockwise seen from above, in (-pi/2, pi/2].
    tau: float  # Short over long axis.
    radius_uT: float  # Short axis, the horizontal strength after the correction.
    covariance: Floats  # (4, 4) of o_x, o_y, eta, tau; NaN where the method has none.
    residual_uT: float  # rms distance from the ellipse.
    samples: int  # Number of readings.
    notes: tuple[str, ...] = ()  # Remarks for the user.

    @property
    def sigma(self) -> Floats:
        """(4,) standard deviations of o_x, o_y (uT), eta (rad), tau."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correction(self) -> Floats:
        """C (2, 2)."""
        long_axis = np.array([np.cos(self.eta_rad), np.sin(self.eta_rad)])
        return np.asarray(np.eye(2) - (1.0 - self.tau) * np.outer(long_axis, long_axis))

    def correct(self, level_xy: Floats) -> Floats:
        """Horizontal field (..., 2) uT on the circle, from levelled readings (..., 2) uT."""
        return np.asarray((level_xy - self.offset_uT) @ self.correction)

    def in_body(self, body_up: Floats) -> MagnetometerCalibration:
        """Return the calibration of the body's readings, for a foot that stands with up at `body_up` (3,).

        h = R^T (o, 0), C = R^T blockdiag(C, 1) R with R = level_R_body. The vertical is left as it is: hard iron along
        it has a sigma of `UNKNOWN_UT`, which covers soft iron too.
        """
        R = compute_level_R_body(body_up)
        C = np.eye(3)
        C[:2, :2] = self.correction
        # derivatives (9, 4) of h and C by o, eta, tau
        c, s = np.cos(self.eta_rad), np.sin(self.eta_rad)
        u, across = R[:2].T @ [c, s], R[:2].T @ [-s, c]
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
                f"holds for a foot that stands as in this walk, its x axis {_measure_rise_deg(body_up):.0f} deg above "
                "level, and not on stairs or in the swing",
                "strength and residual are those of the horizontal field; along the vertical iron is not known and the "
                "field is left as it is",
            ),
        )


def half_turn(angle: float) -> float:
    """Direction modulo pi, in (-pi/2, pi/2]."""
    return float(np.pi / 2 - (np.pi / 2 - angle) % np.pi)


def _measure_rise_deg(body_up: Floats) -> float:
    """Elevation of the body's x axis."""
    return float(np.degrees(np.arctan2(body_up[0], np.linalg.norm(body_up[1:]))))


def calibrate_on_loop(field: FootfallField) -> tuple[Ellipse, MagnetometerCalibration]:
    """Fit the ellipse of a walk's footfalls, and lift it into the body at their mean tilt.

    Raises `CalibrationError` as `fit_ellipse`, for an x axis that stands upright, for a radius no field on Earth has,
    and where the readings leave a parameter open.
    """
    body_up = mean_up(field.nav_R_body)
    if abs(_measure_rise_deg(body_up)) > 90.0 - UPRIGHT_DEG:
        raise CalibrationError(
            f"the sensor's x axis stands upright at the footfalls, within {UPRIGHT_DEG:g} deg, and has no direction "
            "over the ground: turn the sensor over by hand instead, or name its axes otherwise."
        )
    ellipse = fit_ellipse(field.level_field[:, :2])
    growth, note = _compare_sides(field, ellipse)
    ellipse = replace(ellipse, covariance=growth * ellipse.covariance, notes=(*ellipse.notes, note))
    # Plausible, and known well enough.
    check_strength(ellipse.radius_uT, LEVEL_FIELD_UT)
    x, y, eta, tau = ellipse.sigma
    offset = max(x, y) / ellipse.radius_uT
    if max(offset, tau / 2) > MAX_SIGMA:
        raise CalibrationError(
            f"the footfalls scatter by {ellipse.residual_uT:.1f} uT about the ellipse and leave its offset open by "
            f"{offset:.2f} of its radius and tau by {tau:.2f} (at most {MAX_SIGMA:g} and {2 * MAX_SIGMA:g} are "
            "allowed): walk more circles, away from iron in the floor."
        )
    if not eta < KNOWN_ETA_RAD:
        note = (
            f"tau {ellipse.tau:.3f} is a circle within its sigma of {tau:.3f}: "
            "the direction eta of the long axis is not known, and matters as little"
        )
        ellipse = replace(ellipse, notes=(*ellipse.notes, note))
    brought_in_uT = LEVELLING_SIGMA_RAD * float(np.nanmedian(field.level_field[:, 2]))
    levelling = np.diag([brought_in_uT**2, brought_in_uT**2, 0.0, 0.0])
    ellipse = replace(ellipse, covariance=ellipse.covariance + levelling)
    return ellipse, ellipse.in_body(body_up)


def _compare_sides(field: FootfallField, ellipse: Ellipse) -> tuple[float, str]:
    """Covariance inflation factor from the disagreement of left and right circles, 1 without both, and a note."""
    turn = uniform_filter1d(np.gradient(np.unwrap(field.gyro_heading)), SIDE_FOOTFALLS)
    try:
        sides = [fit_ellipse(field.level_field[side, :2]) for side in (turn < 0.0, turn > 0.0)]
    except CalibrationError:
        note = "no full circles both ways: iron in the floor cannot be separated from the shoe's, and is in no sigma"
        return 1.0, note
    left, right = (np.array([*one.offset_uT, one.eta_rad, one.tau]) for one in sides)
    apart = (left - right) / 2
    apart[2] = half_turn(2 * apart[2]) / 2
    covariance = ellipse.covariance + MIN_UT**2 * np.eye(4)
    growth = max(1.0, float(apart @ np.linalg.solve(covariance, apart)) / 4)
    disagree = f"{np.sqrt(growth):.1f} times what the scatter alone explains"
    return growth, f"sigmas are {disagree}, for circles to the left and to the right disagree by so much"


def select_levelled(level_xy: Floats, fewest: int) -> Floats:
    """Readings (F, 2) without NaN rows; `CalibrationError` for too few."""
    readings = level_xy[np.isfinite(level_xy).all(axis=1)]
    if len(readings) < fewest:
        raise CalibrationError(
            f"{format_count(len(readings), 'footfall')} with a field cannot make an ellipse: walk {fewest} in circles."
        )
    return np.asarray(readings)


def fit_ellipse(level_xy: Floats) -> Ellipse:
    """Fit an ellipse to levelled readings (F, 2) uT, one a footfall; NaN rows are left out.

    Raises `CalibrationError` where there is no ellipse, or the headings do not go round, naming the arc that is
    missing.
    """
    readings = select_levelled(level_xy, MIN_FOOTFALLS)
    try:
        fit = fit_quadric(readings, LEVEL_SIZES)
    except CalibrationError:
        raise CalibrationError(NO_ELLIPSE) from None
    # offset and axes from center and symmetric matrix
    (least, most), axes = np.linalg.eigh(fit.C)
    if not least > 0.0:
        raise CalibrationError(NO_ELLIPSE)
    u, w = axes[:, 0], np.array([-axes[1, 0], axes[0, 0]])
    # d eta = (w . dC u) / (least - most), d tau = (u . dC u - tau w . dC w) / most
    between = min(least - most, -1e-9 * most)  # a circle has no long axis: next to no information, not none
    jacobian = np.zeros((4, 5))
    jacobian[:2, :2] = np.eye(2)
    for k, dC in enumerate(map(matrix_of, np.eye(3)), 2):
        jacobian[2, k] = w @ dC @ u / between
        jacobian[3, k] = (u @ dC @ u - least / most * (w @ dC @ w)) / most
    kept = readings[fit.kept]
    left_out = len(readings) - len(kept)
    ellipse = Ellipse(
        method="fitted",
        offset_uT=fit.center,
        eta_rad=half_turn(float(np.arctan2(u[1], u[0]))),
        tau=float(least / most),
        radius_uT=float(1.0 / most),
        covariance=jacobian @ fit.covariance @ jacobian.T,
        residual_uT=fit.residual_uT,
        samples=len(kept),
        notes=(f"{left_out} of {len(readings)} footfalls left out as outliers",) if left_out else (),
    )
    # a wide arc without a reading, by the headings that are missing
    heading = compute_field_heading(ellipse.correct(kept))
    around = np.sort(heading)
    gaps = np.diff(around, append=around[0] + 2 * np.pi)
    k = int(np.argmax(gaps))
    if gaps[k] > MAX_GAP_RAD:
        first, last = np.degrees([around[k], around[k] + gaps[k]]) % 360.0
        raise CalibrationError(
            f"the footfalls do not go round: none has a magnetic heading from {first:.0f} to {last:.0f} deg clockwise "
            f"({np.degrees(gaps[k]):.0f} deg wide, at most {np.degrees(MAX_GAP_RAD):.0f} are allowed); "
            "walk a full circle, better one each way."
        )
    # lack of fit: variance of a reading from the means of the distances over sectors of heading
    sector = np.floor((heading / (2 * np.pi) % 1.0) * SECTORS).astype(np.int64) % SECTORS
    count = np.bincount(sector, minlength=SECTORS)
    total, held = np.bincount(sector, compute_distances(fit.center, fit.C, kept), minlength=SECTORS), count > 0
    lack = float((total[held] ** 2 / count[held]).sum() / (held.sum() - 5)) if held.sum() >= MIN_SECTORS else 0.0
    worse = max(1.0, lack / max(fit.residual_uT, MIN_UT) ** 2)
    return replace(ellipse, covariance=worse * ellipse.covariance)


@dataclass(frozen=True)
class QuadricFit:
    """The quadric |C (m - h)| = 1. Its P parameters are the center and the upper half of C, row by row."""

    center: Floats  # (n,).
    C: Floats  # (n, n).
    covariance: Floats  # (P, P) of both.
    residual_uT: float  # s.
    kept: Bools  # (N,) flags of inliers.


def fit_quadric(readings: Floats, sizes: tuple[float, float] | None = None) -> QuadricFit:
    """Fit readings (N, n) uT by robust least squares of their distances, then by plain least squares on the inliers.

    `sizes` of center (uT) and C (1/uT), by which the parameters are scaled; None for those of the first guess.

    Raises `CalibrationError` if the readings do not determine the parameters.
    """
    # a first guess that a few outliers do not spoil: the fit judges them anew
    n, kept = readings.shape[1], np.ones(len(readings), dtype=np.bool_)
    for _ in range(TRIMS):
        h, C = fit_constrained_quadric(readings[kept])
        far = compute_distances(h, C, readings)
        before, kept = kept, np.abs(far) <= TRIM_SIGMAS * robust_sigma(far) + MIN_UT
        if (kept == before).all():
            break
    upper, size = C[np.triu_indices(n)], float(np.mean(np.diag(C)))
    scale = np.repeat(sizes or (0.1 / size, size), [n, len(upper)])

    def distances(scaled: Floats, chosen: Floats) -> Floats:
        return compute_distances(scaled[:n] * scale[:n], matrix_of(scaled[n:] * scale[n:]), chosen)

    x = _solve(distances, readings, np.concatenate([h, upper]) / scale, "cauchy")
    kept = is_near(distances(x, readings))
    for _ in range(ROUNDS):
        x = _solve(distances, readings[kept], x, "linear")
        before, kept = kept, is_near(distances(x, readings))
        if (kept == before).all():
            break
    # covariance by the Jacobian, central differences (N, P)
    inliers = readings[kept]
    if len(inliers) <= len(x):
        raise CalibrationError(f"{len(inliers)} readings do not determine {len(x)} parameters: record more.")
    steps = np.diag(1e-5 * np.maximum(np.abs(x), 0.1))
    columns = [(distances(x + step, inliers) - distances(x - step, inliers)) / (2 * step.sum()) for step in steps]
    variance = float((distances(x, inliers) ** 2).sum()) / (len(inliers) - len(x))
    _, singular, right = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    if singular[-1] < 1e-10 * singular[0]:
        raise CalibrationError("the readings leave a parameter open: turn the sensor in more directions.")
    covariance = variance * (right.T / singular**2) @ right * np.outer(scale, scale)
    return QuadricFit(x[:n] * scale[:n], matrix_of(x[n:] * scale[n:]), covariance, float(np.sqrt(variance)), kept)


def _solve(
    residuals: Callable[[Floats, Floats], Floats], readings: Floats, start: Floats, loss: Literal["linear", "cauchy"]
) -> Floats:
    """Least-squares parameters (P,) with this loss, its scale the robust spread of the residuals (K,) at `start`."""
    if len(readings) <= len(start):
        raise CalibrationError(f"{len(readings)} readings do not determine {len(start)} parameters: record more.")
    first = residuals(start, readings)
    if not np.isfinite(first).all():
        raise CalibrationError("the readings lie on no ellipse or ellipsoid: is this a magnetometer, turned about?")
    scale = max(robust_sigma(first), MIN_UT)
    return np.asarray(least_squares(residuals, start, loss=loss, f_scale=scale, max_nfev=100, args=(readings,)).x)


def is_near(residual: Floats) -> Bools:
    """Flags (N,) of the residuals that are no outliers of their bulk."""
    return np.asarray(np.abs(residual) <= OUTLIER_SIGMAS * max(robust_sigma(residual), MIN_UT))


def compute_distances(h: Floats, C: Floats, readings: Floats) -> Floats:
    """Distances (N,) of readings (N, n) from the ellipsoid |C (m - h)| = 1, to first order; outside positive."""
    v = (readings - h) @ C
    length = np.linalg.norm(v, axis=1)
    return np.asarray((length - 1.0) * length / np.linalg.norm(v @ C, axis=1))


def fit_constrained_quadric(readings: Floats) -> tuple[Floats, Floats]:
    """Center (n,) and symmetric C (n, n) of the ellipse or ellipsoid through readings (N, n).

    Raises `CalibrationError` where the readings do not determine one, as on a plane or along too short an arc.
    """
    x, middle, scale = _scale_readings(readings)
    quadratic, rest = _make_design(x)
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
    center, C = _find_center(best, elimination @ best)
    return middle + scale * center, C / scale


def _scale_readings(readings: Floats) -> tuple[Floats, Floats, float]:
    """Readings about their mean in units of their spread: monomials of one size."""
    middle = readings.mean(axis=0)
    scale = float(np.sqrt(((readings - middle) ** 2).sum(axis=1).mean()))
    if not scale > 0.0:
        raise CalibrationError(NO_ELLIPSOID)
    return (readings - middle) / scale, middle, scale


def _make_design(x: Floats) -> tuple[Floats, Floats]:
    """Columns x_i^2, then x_i x_j twice (i < j); and 2 x_i, 1."""
    i, j = np.triu_indices(x.shape[1], k=1)
    return np.hstack([x**2, 2 * x[:, i] * x[:, j]]), np.hstack([2 * x, np.ones((len(x), 1))])


def _find_center(quadratic: Floats, rest: Floats) -> tuple[Floats, Floats]:
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
