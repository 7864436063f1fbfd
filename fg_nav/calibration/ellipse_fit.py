"""Ma's calibration on the shoe: the levelled field of the standing foot, turned round, lies on an ellipse.

The ellipse and its symbols are in `fg_nav.calibration.ellipse`. Center and symmetric matrix are fitted by least squares
of distances, |C (m - o)| = 1, a few wild footfalls left out; they give offset, eta and tau with their covariance.

Lack of fit. Iron in the floor is another at every place, and circles pass the same places again with the same heading:
what it does to the readings does not average out. So the variance of a reading is that of its distance from the
ellipse, or, if larger, that which the means of the distances over `SECTORS` of heading show:

    s^2 = max(sum r^2 / (F - 5), sum n_j mean_j(r)^2 / (sectors - 5)).

Two sides. What the floor does with one or two periods in the round is an ellipse itself: no residual shows it. But
circles to the left stand elsewhere than circles to the right, and theirs is another ellipse. `calibrate_on_loop` fits
both apart; half the difference D of their (o_x, o_y, eta, tau) is as uncertain as the ellipse of all, whose covariance
P grows by

    max(1, D^T P^-1 D / 4).

On 36 simulated loops over a smooth floor (seeds below 100) errors are 1.3 of their sigmas with it, and 3.2 without.
Circles that all turn one way do not show the floor: their covariance does not include it, and a note says so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.ellipse import Ellipse, half_turn, rise_deg, select_levelled
from fg_nav.calibration.magnetometer import LEVEL_FIELD_UT, MagnetometerCalibration, check_strength, mean_up
from fg_nav.calibration.quadric import MIN_UT, Fit, distance, fit_robustly, fit_trimmed_quadric
from fg_nav.errors import CalibrationError
from fg_nav.magnetic.footfall_field import FootfallField, compute_field_heading

SIDE_FOOTFALLS = 5  # Turning is to the left or to the right in the mean over so many.

UPRIGHT_DEG = 2.0
"""An x axis so close to vertical has no heading that a foot could repeat: levelled axes turn about at random."""


KNOWN_ETA_RAD = 0.3
"""A direction with more sigma than this is no direction: 17 degrees, and beyond it sigma is no more than a word."""


MIN_FOOTFALLS = 10  # Five numbers want a few more footfalls to be judged by.

MAX_GAP_RAD = float(np.deg2rad(90.0))
"""Between neighboring directions about the center. Ma turns by 15 to 35 deg from step to step; with a quarter of the
round missing the two ends of it still hold the ellipse."""

MAX_SIGMA = 0.05  # Of the offset over the radius, and of half of tau: an error of 3 deg of heading for both.

LEVELLING_SIGMA_RAD = 0.003
"""Steady error of up, per axis: an accelerometer that is wrong by 3 mg, as a calibrated MEMS part is. What vertical
field it brings into the plane looks like an offset, and belongs to it as long as the same levelling is used; for the
hard iron it is an error."""


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

    The covariance has in it by how much circles to the left and to the right disagree, and that of the offset a steady
    error of levelling, which the footfalls do not show.

    Raises `CalibrationError` as `fit_ellipse`, and for an x axis that stands upright.
    """
    body_up = mean_up(field.nav_R_body)
    _check_x_axis(body_up)
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
    """Fit; refuse only where there is no ellipse or the headings do not go round."""
    readings = select_levelled(level_xy, MIN_FOOTFALLS)
    ellipse, kept = fit_likeliest_ellipse(readings)
    _check_round(ellipse.correct(readings[kept]))
    left_out = int((~kept).sum())
    notes = (f"{left_out} of {len(readings)} footfalls left out as outliers",) if left_out else ()
    return replace(ellipse, notes=notes)


def _compare_sides(field: FootfallField, ellipse: Ellipse) -> tuple[float, str]:
    """Factor on the covariance by which circles to the left and to the right disagree, and a note on them."""
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


def _check_round(corrected: Floats) -> None:
    """Refuse where no reading points over a wide arc, and name it by the headings that the foot did not have."""
    heading = np.sort(compute_field_heading(corrected))
    gaps = np.diff(heading, append=heading[0] + 2 * np.pi)
    k = int(np.argmax(gaps))
    if gaps[k] > MAX_GAP_RAD:
        first, last = np.degrees([heading[k], heading[k] + gaps[k]]) % 360.0
        raise CalibrationError(
            f"the footfalls do not go round: none has a magnetic heading from {first:.0f} to {last:.0f} deg clockwise "
            f"({np.degrees(gaps[k]):.0f} deg wide, at most {np.degrees(MAX_GAP_RAD):.0f} are allowed); "
            "walk a full circle, better one each way."
        )


def _check(ellipse: Ellipse) -> None:
    """Refuse a radius that no field has, and numbers that are not known well enough."""
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
    sigma = ellipse.sigma[2]
    if sigma < KNOWN_ETA_RAD:
        return ()
    return (
        f"tau {ellipse.tau:.3f} is a circle within its sigma of {ellipse.sigma[3]:.3f}: "
        "the direction eta of the long axis is not known, and matters as little",
    )


def _check_x_axis(body_up: Floats) -> None:
    if abs(rise_deg(body_up)) > 90.0 - UPRIGHT_DEG:
        raise CalibrationError(
            f"the sensor's x axis stands upright at the footfalls, within {UPRIGHT_DEG:g} deg, and has no direction "
            "over the ground: turn the sensor over by hand instead, or name its axes otherwise."
        )


SECTORS, MIN_SECTORS = 12, 9  # Of 30 degrees, and how many must hold a footfall for their means to say something.

NO_ELLIPSE = "the footfalls lie on no ellipse: walk full circles, right and left, away from iron in the floor."

_SIZES = np.array([0.01, 0.01, 30.0, 30.0, 30.0])  # Brings uT and 1/uT to numbers about 1, as fields on Earth have them


def fit_likeliest_ellipse(readings: Floats) -> tuple[Ellipse, Bools]:
    """Fit readings (F, 2) uT, all finite; returns the ellipse and which of them were kept (F,).

    Raises `CalibrationError` where there is no ellipse.
    """
    fit = _fit(readings)
    kept = readings[fit.kept]
    ellipse = _build_ellipse(fit.parameters, fit.covariance, fit.residual_uT, len(kept))
    lack = _measure_lack_of_fit(_distance(fit.parameters, kept), compute_field_heading(ellipse.correct(kept)))
    worse = max(1.0, lack / max(fit.residual_uT, MIN_UT) ** 2)
    return replace(ellipse, covariance=worse * ellipse.covariance), fit.kept


def _fit(readings: Floats) -> Fit:
    """Center and matrix of the ellipse, scaled; a refusal addresses the walker."""
    try:
        center, C = fit_trimmed_quadric(readings)
        return fit_robustly(_distance, readings, np.array([*center, C[0, 0], C[0, 1], C[1, 1]]) * _SIZES)
    except CalibrationError:
        raise CalibrationError(NO_ELLIPSE) from None


def _distance(scaled: Floats, readings: Floats) -> Floats:
    """Distances (N,) uT of readings from the ellipse |C (m - o)| = 1."""
    x = scaled / _SIZES
    return distance(x[:2], np.array([[x[2], x[3]], [x[3], x[4]]]), readings)


def _build_ellipse(scaled: Floats, scaled_covariance: Floats, residual: float, samples: int) -> Ellipse:
    """Offset, axes and their covariance from the center and the symmetric matrix that were fitted."""
    x, covariance = scaled / _SIZES, scaled_covariance / np.outer(_SIZES, _SIZES)
    (least, most), axes = np.linalg.eigh(np.array([[x[2], x[3]], [x[3], x[4]]]))
    if not least > 0.0:
        raise CalibrationError(NO_ELLIPSE)
    u = axes[:, 0]
    jacobian = np.zeros((4, 5))
    jacobian[:2, :2], jacobian[2:, 2:] = np.eye(2), _differentiate_shape(u, least, most)
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


def _differentiate_shape(u: Floats, least: float, most: float) -> Floats:
    """Derivatives (2, 3) of eta and tau by C_xx, C_xy, C_yy, C having the eigenvalue `least` along u, `most` across.

    With w = u turned left: d eta = (w . dC u) / (least - most), d tau = (u . dC u - tau w . dC w) / most.
    """
    w = np.array([-u[1], u[0]])
    between = min(least - most, -1e-9 * most)  # a circle's long axis has no direction: next to no knowledge, not none
    return np.stack(
        [
            _differentiate_form(w, u) / between,
            (_differentiate_form(u, u) - least / most * _differentiate_form(w, w)) / most,
        ]
    )


def _differentiate_form(a: Floats, b: Floats) -> Floats:
    """Derivatives (3,) of a . C b by C_xx, C_xy, C_yy."""
    return np.array([a[0] * b[0], a[0] * b[1] + a[1] * b[0], a[1] * b[1]])


def _measure_lack_of_fit(residual: Floats, heading: Floats) -> float:
    """Variance (uT^2) of a reading, from the means of the residuals (F,) over sectors of heading (F,)."""
    sector = np.floor((heading / (2 * np.pi) % 1.0) * SECTORS).astype(np.int64) % SECTORS
    count = np.bincount(sector, minlength=SECTORS)
    total = np.bincount(sector, residual, minlength=SECTORS)
    held = count > 0
    if held.sum() < MIN_SECTORS:
        return 0.0
    return float((total[held] ** 2 / count[held]).sum() / (held.sum() - 5))
