"""Hard and soft iron from an ordinary walk: what turns with the foot is the sensor's, what stays is the building's.

The model is in `fg_nav.calibration.walk_model`. The fit is Gauss-Newton steps with the Student weights of the last one;
the scale of d is found on the way.

What a level floor cannot show: h along the vertical is one with b, and what S makes of the vertical field is one with
h over the ground. Both keep their priors, and the covariance says so; the heading of a foot that stands flat needs
neither. The swings, whose pitch goes round by 80 deg, show the vertical part: on 8 simulated demos to 5 uT, but they
would claim 3, for their samples feel one field after another along the path, and over the ground h is no better for
them. They are not used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from fg_nav.arrays import Floats
from fg_nav.calibration.magnetometer import (
    LEVEL_FIELD_UT,
    UPPER,
    MagnetometerCalibration,
    check_strength,
    circular_sd_deg,
    correct_field,
    differentiate_inverse,
    matrix_of,
    mean_up,
)
from fg_nav.calibration.walk_model import (
    DRIFT_RATE_DEG_S,
    FEWEST_FOOTFALLS,
    IRON,
    SOFT_IRON_SIGMA,
    WITHOUT_IRON,
    Walk,
    compute_covariance,
    compute_jacobian,
    compute_residual,
    compute_weights,
    prior_precision,
)
from fg_nav.errors import CalibrationError
from fg_nav.frames import wrap_angle
from fg_nav.magnetic.footfall_field import FootfallField, compute_level_R_body
from fg_nav.text import format_count

SEEN = float(chi2.ppf(0.95, 2))
"""Squared sigmas over the ground below which iron that is found may be none. Soft iron alone does not count: of what it
does to the level field a real floor shows next to nothing."""

FAR_SIGMAS = 6.0
"""Soft iron this far from none, by its prior sigma, is no soft iron but another motion."""

DRIFT_SIGMAS, LINE_STEP_RAD = 3.0, 0.1
"""How fast a drift is looked for where spreads are compared, and in what steps at the end of the walk."""


BLOCKS = 8
"""The walk is cut into so many for the trial out of sample: seven eighths show almost what all show."""


@dataclass(frozen=True)
class WalkCalibrationParameters:
    """What is asked of the result."""

    largest_sigma_uT: float = 4.0
    """Of h over the ground: 11 deg of heading at 21 uT; a compass that is worse than that is no use."""
    must_gain: bool = True
    """Refuse where the field is none of Earth's, no iron shows, or the spread out of sample is not less than before;
    False to study walks."""


@dataclass(frozen=True)
class Spread:
    """Circular standard deviation of compass minus inertial heading, deg, about a line in time: the drift."""

    before_deg: float
    after_deg: float


def calibrate_on_walk(
    field: FootfallField, parameters: WalkCalibrationParameters = WalkCalibrationParameters()
) -> MagnetometerCalibration:
    """Find the iron from the field at the footfalls of any walk that turns.

    `field` is that of the walk, not calibrated; footfalls without a field are left out.

    Raises `CalibrationError` with the reason: too few footfalls, headings that do not go round, no field that Earth
    has, no iron, iron that no shoe carries, or nothing gained out of sample.
    """
    p = parameters
    walk = Walk.of(field)
    _check_count(walk)
    fit = fit_iron(walk)
    _check_known(walk, fit, p)
    spread = _spread_blocks(walk, fit)
    if p.must_gain:
        check_strength(float(np.linalg.norm(fit.b[:2])), LEVEL_FIELD_UT)
        _check_seen(walk, fit)
        _check_bending(fit)
        _check_gain(spread)
    return _build_calibration(fit, walk, spread)


def measure_spread(field: FootfallField) -> Spread:
    """Cut the walk into blocks and correct each by a calibration on the others, refused or not."""
    walk = Walk.of(field)
    return _spread_blocks(walk, fit_iron(walk))


def find_level_iron(calibration: MagnetometerCalibration, field: FootfallField) -> tuple[Floats, Floats]:
    """What the iron adds to the level field of a foot that stands flat: h, and what S makes of the vertical field.

    Parameters
    ----------
    calibration : any, with a covariance.
    field : of a walk, not calibrated: it says which way up is and how strong the vertical field is.

    Returns
    -------
    (2,) uT in levelled axes, forward and left, and its covariance (2, 2) uT^2. A heading errs by up to its length over
    the level strength, once to either side in a turn.
    """
    S = np.linalg.inv(calibration.correction)
    by_correction = np.eye(IRON)
    by_correction[3:, 3:] = differentiate_inverse(calibration.correction)
    up = mean_up(field.nav_R_body)
    added = level_sum(up, float(np.nanmean(correct_field(field, calibration).nav_field[:, 2])))
    change = np.concatenate([calibration.hard_iron_uT, S[UPPER]]) - WITHOUT_IRON
    by_parameters = added @ by_correction
    return added @ change, by_parameters @ calibration.covariance @ by_parameters.T


def _check_count(walk: Walk) -> None:
    if len(walk) < FEWEST_FOOTFALLS:
        raise CalibrationError(
            f"{format_count(len(walk), 'footfall')} with a field cannot tell the shoe's iron from the building's: "
            f"walk {FEWEST_FOOTFALLS} strides or more, with turns."
        )


def _check_known(walk: Walk, fit: Fit, p: WalkCalibrationParameters) -> None:
    if fit.level_sigma > p.largest_sigma_uT:
        raise CalibrationError(
            f"after {len(walk)} footfalls the hard iron would be known to {fit.level_sigma:.1f} uT only, for "
            f"{_describe_headings(walk)}: walk longer and through all headings, such as a round or a figure of eight, "
            "or calibrate on a loop."
        )


def _check_seen(walk: Walk, fit: Fit) -> None:
    if fit.seen < SEEN:
        raise CalibrationError(
            f"no iron shows against the building: over the ground {np.linalg.norm(fit.level_iron):.1f} uT were found, "
            f"and {len(walk)} footfalls show it to {fit.level_sigma:.1f} uT per axis; go on without a calibration, or "
            "walk longer."
        )


def _check_bending(fit: Fit) -> None:
    """Refuse soft iron far from the prior of shoes: the model does not hold."""
    bending = np.linalg.eigvalsh(fit.S)
    if np.abs(bending - 1.0).max() > FAR_SIGMAS * SOFT_IRON_SIGMA:
        raise CalibrationError(
            f"the iron found would make the field {bending.min():.2g} to {bending.max():.2g} times as strong, as no "
            "shoe does: is the sensor on a walking foot?"
        )


def _check_gain(spread: Spread) -> None:
    if not spread.after_deg < spread.before_deg:
        raise CalibrationError(
            "the iron found in one part of the walk does not help in the others: compass minus inertial heading would "
            f"spread by {spread.after_deg:.1f} deg instead of {spread.before_deg:.1f}; go on without a calibration, "
            "or walk longer."
        )


def _spread_blocks(walk: Walk, fit: Fit) -> Spread:
    """Spread before, and after a calibration on the other blocks of the walk."""
    block = np.arange(len(walk)) * BLOCKS // len(walk)
    corrected = np.empty_like(walk.reading)
    for held in (block == k for k in range(BLOCKS)):
        others = find_from(walk.part(~held), fit.unknowns, fit.sigma_d)
        corrected[held] = others.correct(walk.reading[held])
    after = replace(walk.field, body_field=corrected)
    return Spread(*(_least_spread(field) for field in (walk.field, after)))


def _least_spread(field: FootfallField) -> float:
    """Circular sd, deg, of compass minus inertial heading about the line in time that leaves least."""
    t = field.t - field.t[0]
    most = DRIFT_SIGMAS * np.radians(DRIFT_RATE_DEG_S)
    rates = np.linspace(-most, most, 2 * max(1, int(np.ceil(most * t[-1] / LINE_STEP_RAD))) + 1)
    return min(circular_sd_deg(field.heading_difference - rate * t) for rate in rates)


def _describe_headings(walk: Walk) -> str:
    """How far the headings go round, in words."""
    heading = walk.field.gyro_heading
    share = np.mean(np.abs(wrap_angle(heading - np.angle(np.exp(1j * heading).mean()))) < np.pi / 4)
    return f"{100 * share:.0f} % of them head within 45 deg of one direction"


def _build_calibration(fit: Fit, walk: Walk, spread: Spread) -> MagnetometerCalibration:
    correction = np.linalg.inv(fit.S)
    correction = (correction + correction.T) / 2
    by_soft = np.eye(IRON)
    by_soft[3:, 3:] = differentiate_inverse(fit.S)
    return MagnetometerCalibration(
        method="walk",
        hard_iron_uT=fit.h,
        correction=correction,
        covariance=by_soft @ fit.covariance @ by_soft.T,
        strength_uT=float(np.linalg.norm(fit.b)),
        residual_uT=float(np.sqrt(np.mean(fit.sigma_d**2))),
        samples=len(walk),
        notes=(
            f"hard iron over the ground, with what soft iron makes of the vertical field, is known to "
            f"{fit.level_sigma:.1f} uT from {len(walk)} footfalls; what a walk on the level does not show keeps its "
            "wide sigma",
            f"compass minus inertial heading spreads by {spread.after_deg:.1f} deg instead of {spread.before_deg:.1f}, "
            f"each of its {BLOCKS} parts corrected by the others",
            "the residual is what the building adds to the field, typically, per axis",
        ),
    )


MOST_STEPS, CLOSE_UT = 30, 3e-3
"""Of Gauss-Newton: it takes 5 to 15, and steps below this change nothing."""


@dataclass(frozen=True)
class Fit:
    """What was found.

    Attributes
    ----------
    unknowns : (P,) in the order of the Jacobian.
    sigma_d : (3,) uT, scale of d in nav.
    up : (3,) mean direction of up in the body.
    covariance : (9, 9) of h and the six of S; NaN where it was not asked for.
    """

    unknowns: Floats
    sigma_d: Floats
    up: Floats
    covariance: Floats

    @property
    def h(self) -> Floats:
        """(3,) uT."""
        return self.unknowns[:3]

    @property
    def S(self) -> Floats:
        """(3, 3)."""
        return matrix_of(self.unknowns[3:IRON])

    @property
    def b(self) -> Floats:
        """(3,) uT."""
        return self.unknowns[IRON:12]

    def correct(self, reading: Floats) -> Floats:
        """Field (N, 3) uT."""
        return np.asarray(np.linalg.solve(self.S, (reading - self.h).T).T)

    @property
    def level_covariance(self) -> Floats:
        """Of h over the ground with what S makes of the vertical field, (2, 2) uT^2."""
        level = level_sum(self.up, float(self.b[2]))
        return np.asarray(level @ self.covariance @ level.T)

    @property
    def level_iron(self) -> Floats:
        """What h and S add over the ground, (2,) uT."""
        return np.asarray(level_sum(self.up, float(self.b[2])) @ (self.unknowns[:IRON] - WITHOUT_IRON))

    @property
    def seen(self) -> float:
        """Squared sigmas by which the sensor differs over the ground from one without iron; chi-square with two."""
        found = self.level_iron
        return float(found @ np.linalg.solve(self.level_covariance, found))

    @property
    def level_sigma(self) -> float:
        """Of the worse direction over the ground, uT."""
        return float(np.sqrt(np.linalg.eigvalsh(self.level_covariance)[1]))


def fit_iron(walk: Walk) -> Fit:
    """Find the iron from none on, with its covariance."""
    start = np.concatenate([WITHOUT_IRON, _mean_field(walk), np.zeros(walk.knots.shape[1])])
    found = find_from(walk, start, np.full(3, 10.0))
    return replace(found, covariance=compute_covariance(walk, found.unknowns, found.sigma_d)[:IRON, :IRON])


def find_from(walk: Walk, at: Floats, sigma_d: Floats) -> Fit:
    """Find the iron from any unknowns (P,) and scale of d (3,) on, without covariance."""
    prior, rest = prior_precision(walk), np.zeros(len(at))
    rest[:IRON] = WITHOUT_IRON
    for _ in range(MOST_STEPS):
        residual = compute_residual(walk, at)
        weight = compute_weights(residual, sigma_d)
        sigma_d = np.sqrt(_estimate_scales(residual, weight))
        scaled = compute_jacobian(walk, at) / sigma_d[:, None]
        normal = np.einsum("n,nij,nik->jk", weight, scaled, scaled) + prior
        right = np.einsum("n,nij,ni->j", weight, scaled, residual / sigma_d) - prior @ (at - rest)
        step = np.linalg.solve(normal, right)
        at = at + step
        if np.abs(step[:3]).max() < CLOSE_UT:
            break
    return Fit(at, sigma_d, mean_up(walk.nav_R_body), np.full((IRON, IRON), np.nan))


def _mean_field(walk: Walk) -> Floats:
    return np.asarray(np.einsum("nij,nj->ni", walk.nav_R_body, walk.reading).mean(axis=0))


def level_sum(up: Floats, vertical_uT: float) -> Floats:
    """(2, 9): what h and the six of S add up to over the ground, in levelled axes, where up is up in the body."""
    by_soft = np.stack([matrix_of(one) @ up for one in np.eye(6)], axis=1)
    return np.asarray(compute_level_R_body(up)[:2] @ np.hstack([np.eye(3), vertical_uT * by_soft]))


def _estimate_scales(residual: Floats, weight: Floats) -> Floats:
    """Squared scale (3,) of d: one over the ground, one upright."""
    square = (weight[:, None] * residual**2).mean(axis=0) + 1e-6
    level = square[:2].mean()
    return np.array([level, level, square[2]])
