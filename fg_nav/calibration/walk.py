"""Hard and soft iron from an ordinary walk: what turns with the foot is the sensor's, what stays is the building's.

The model is in `fg_nav.calibration.walk_model`, the covariance in `fg_nav.calibration.walk_covariance`. The fit is
Gauss-Newton steps with the Student weights and the covariance of d of the last one.

What shows: h along and across the axis about which the foot pitches, forward and up, in each swing; along that axis,
to the side, only between headings. A straight walk does not show it. What S makes of the vertical field is one with h
over the ground where the foot stands; the swings tell the two apart. The size of S is one with the strength of the
field, and keeps its prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats
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
from fg_nav.calibration.stride_readings import PHASES, StrideReadings
from fg_nav.calibration.walk_covariance import Linearization, compute_covariance
from fg_nav.calibration.walk_model import (
    DRIFT_RATE_DEG_S,
    FIELD,
    IRON,
    SOFT_IRON_SIGMA,
    WITHOUT_IRON,
    Walk,
    compute_weights,
    find_whitening,
    learn_spread,
    linearize,
    prior_precision,
    start_unknowns,
    whiten,
)
from fg_nav.errors import CalibrationError, MagneticError
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.magnetic.footfall_field import FootfallField, compute_level_R_body
from fg_nav.text import format_count

SEEN = -2.0 * float(np.log(0.05))
"""Squared sigmas over the ground, the 95 % quantile, below which iron may be none. Soft iron alone does not count: of
what it does to the level field a real floor shows next to nothing."""

FAR_SIGMAS = 6.0  # Soft iron this far from none, by its prior sigma, is no soft iron but another motion.

DRIFT_SIGMAS, LINE_STEP_RAD = 3.0, 0.1
"""How fast a drift is looked for where spreads are compared, and in what steps at the end of the walk."""


MIN_STRIDES = 20  # One stride shows h to 10 uT, twenty to 2 uT.
BLOCKS = 8  # The walk is cut into so many for the trial out of sample: seven eighths show almost what all show.


@dataclass(frozen=True)
class WalkCalibrationParameters:
    """What is asked of the result."""

    largest_sigma_uT: float = 4.0
    """Of h over the ground: 11 deg of heading at 21 uT; a compass that is worse than that is no use."""
    must_gain: bool = True
    """Refuse where the field is none of Earth's, no iron shows, or it explains nothing out of sample; False to study
    walks."""


@dataclass(frozen=True)
class Spread:
    """Circular standard deviation of compass minus inertial heading, deg, about a line in time: the drift."""

    before_deg: float
    after_deg: float


def calibrate_on_walk(
    strides: StrideReadings, parameters: WalkCalibrationParameters = WalkCalibrationParameters()
) -> MagnetometerCalibration:
    """Find the iron from the readings of any walk that turns.

    Raises `CalibrationError` with the reason: too few strides, headings that do not go round, no field that Earth
    has, no iron, iron that no shoe carries, or nothing gained out of sample.
    """
    p = parameters
    walk = Walk.of(strides)
    _check_count(walk)
    fit = fit_iron(walk)
    _check_known(walk, fit, p)
    spread = _spread_blocks(walk, fit)
    if p.must_gain:
        check_strength(float(np.linalg.norm(fit.b[:2])), LEVEL_FIELD_UT)
        _check_seen(walk, fit)
        _check_bending(fit)
        _check_gain(walk, fit)
    return _build_calibration(fit, walk, spread)


def find_iron(strides: StrideReadings) -> MagnetometerCalibration:
    """Find the iron of a walk's own magnetometer, however well the walk shows it: its covariance says how well.

    Raises
    ------
    CalibrationError
        Where there is nothing to fit: too few strides, or none that a shoe's iron explains.
    MagneticError
        Where all that is measured turns with the foot: a magnetometer that is dead.
    """
    walk = Walk.of(strides)
    _check_count(walk)
    fit = fit_iron(walk)
    level_uT = float(np.linalg.norm(fit.b[:2]))
    if level_uT < LEVEL_FIELD_UT[0]:
        raise MagneticError(
            f"the readings of the magnetometer turn with the foot, and {level_uT:.1g} uT of them do not: it measures "
            "no field of the Earth; go on without it (--no-mag)."
        )
    _check_bending(fit)
    return _build_calibration(fit, walk, None)


def find_iron_sigma(calibration: MagnetometerCalibration, field: FootfallField) -> Floats:
    """Sigma (3,) uT, body axes, of what a calibration leaves of h, and of what S makes of the vertical field."""
    up, vertical_uT = mean_up(field.nav_R_body), float(np.nanmean(field.nav_field[:, 2]))
    by_correction = np.eye(len(WITHOUT_IRON))
    by_correction[3:, 3:] = differentiate_inverse(calibration.correction)
    added = np.hstack([np.eye(3), vertical_uT * np.stack([matrix_of(one) @ up for one in np.eye(6)], axis=1)])
    covariance = added @ by_correction @ calibration.covariance @ by_correction.T @ added.T
    return np.asarray(np.sqrt(np.diag(covariance)))


def measure_spread(strides: StrideReadings) -> Spread:
    """Cut the walk into blocks and correct each by a calibration on the others, refused or not."""
    walk = Walk.of(strides)
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
    by_correction = np.eye(len(WITHOUT_IRON))
    by_correction[3:, 3:] = differentiate_inverse(calibration.correction)
    up = mean_up(field.nav_R_body)
    added = level_sum(up, float(np.nanmean(correct_field(field, calibration).nav_field[:, 2])))
    change = np.concatenate([calibration.hard_iron_uT, S[UPPER]]) - WITHOUT_IRON
    by_parameters = added @ by_correction
    return added @ change, by_parameters @ calibration.covariance @ by_parameters.T


def _check_count(walk: Walk) -> None:
    if len(walk) < MIN_STRIDES:
        raise CalibrationError(
            f"{format_count(len(walk), 'stride')} with a field cannot tell the shoe's iron from the building's: "
            f"walk {MIN_STRIDES} strides or more, with turns."
        )


def _check_known(walk: Walk, fit: Fit, p: WalkCalibrationParameters) -> None:
    if fit.level_sigma > p.largest_sigma_uT:
        raise CalibrationError(
            f"after {len(walk)} strides the hard iron would be known to {fit.level_sigma:.1f} uT only, for "
            f"{_describe_headings(walk)}: walk longer and through all headings, such as a round or a figure of eight, "
            "or calibrate on a loop."
        )


def _check_seen(walk: Walk, fit: Fit) -> None:
    if fit.seen < SEEN:
        raise CalibrationError(
            f"no iron shows against the building: over the ground {np.linalg.norm(fit.level_iron):.1f} uT were found, "
            f"and {len(walk)} strides show it to {fit.level_sigma:.1f} uT per axis; go on without a calibration, or "
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


def _check_gain(walk: Walk, fit: Fit) -> None:
    if not _measure_gain(walk, fit) > 0.0:
        raise CalibrationError(
            "the iron found in one part of the walk does not help in the others, whose readings it explains worse than "
            "none; go on without a calibration, or walk longer."
        )


def _measure_gain(walk: Walk, fit: Fit) -> float:
    """By how many squared sigmas the iron found in the other blocks explains a block better than none, all together."""
    last, iron = fit.linearization, np.arange(walk.unknowns) < IRON.stop
    information, pull = last.information, last.pull
    none = WITHOUT_IRON - fit.unknowns[IRON]
    gain = 0.0
    for held in _cut_blocks(walk):
        others, own = information[~held].sum(axis=0) + last.prior, information[held].sum(axis=0)
        slope = pull[held].sum(axis=0)
        found, without = -np.linalg.solve(others, slope), np.zeros(walk.unknowns)
        without[iron] = none
        without[~iron] = np.linalg.solve(
            others[np.ix_(~iron, ~iron)], -slope[~iron] - others[np.ix_(~iron, iron)] @ none
        )
        gain += sum(sign * (step @ own @ step - 2 * slope @ step) for sign, step in ((-1, found), (1, without)))
    return float(gain)


def _cut_blocks(walk: Walk) -> list[Bools]:
    block = np.arange(len(walk)) * BLOCKS // len(walk)
    return [block == k for k in range(BLOCKS)]


def _spread_blocks(walk: Walk, fit: Fit) -> Spread:
    """Spread before, and after a calibration on the other blocks of the walk: one step from that on all of them."""
    last = fit.linearization
    information, pull = last.information, last.pull
    reading = walk.strides.reading[:, 0]
    corrected = np.empty_like(reading)
    for held in _cut_blocks(walk):
        others = information[~held].sum(axis=0) + last.prior
        # At the fit the pull of all strides and of the prior is none: what is left is that of those held back.
        at = fit.unknowns - np.linalg.solve(others, pull[held].sum(axis=0))
        corrected[held] = replace(fit, unknowns=at).correct(reading[held])
    return Spread(*(_find_least_spread(walk, readings) for readings in (reading, corrected)))


def _find_least_spread(walk: Walk, standing: Floats) -> float:
    """Circular sd, deg, of compass minus inertial heading about the line in time that leaves least.

    `standing` (S, 3) uT is the field of each footfall in the body.
    """
    east, north, _ = np.einsum("kij,kj->ik", walk.strides.standing_R, standing)
    difference, t = np.arctan2(north, east), walk.strides.start_s - walk.strides.start_s[0]
    most = DRIFT_SIGMAS * np.radians(DRIFT_RATE_DEG_S)
    rates = np.linspace(-most, most, 2 * max(1, int(np.ceil(most * t[-1] / LINE_STEP_RAD))) + 1)
    return min(circular_sd_deg(difference - rate * t) for rate in rates)


def _describe_headings(walk: Walk) -> str:
    """How far the headings go round, in words."""
    heading = compute_heading(walk.strides.standing_R)
    share = np.mean(np.abs(wrap_angle(heading - np.angle(np.exp(1j * heading).mean()))) < np.pi / 4)
    return f"{100 * share:.0f} % of them head within 45 deg of one direction"


def _build_calibration(fit: Fit, walk: Walk, spread: Spread | None) -> MagnetometerCalibration:
    correction = np.linalg.inv(fit.S)
    correction = (correction + correction.T) / 2
    by_soft = np.eye(len(WITHOUT_IRON))
    by_soft[3:, 3:] = differentiate_inverse(fit.S)
    return MagnetometerCalibration(
        method="walk",
        hard_iron_uT=fit.h,
        correction=correction,
        covariance=by_soft @ fit.covariance @ by_soft.T,
        strength_uT=float(np.linalg.norm(fit.b)),
        residual_uT=float(np.sqrt(np.mean(fit.linearization.residual**2))),
        samples=PHASES * len(walk),
        notes=(
            f"hard iron over the ground, with what soft iron makes of the vertical field, is known to "
            f"{fit.level_sigma:.1f} uT, and the rest of it to {fit.worst_sigma:.1f} uT, from {len(walk)} strides; the "
            "size of the soft iron keeps its wide sigma",
            *_describe_spread(spread),
            "the residual is what the building adds to the field, typically, per axis",
        ),
    )


def _describe_spread(spread: Spread | None) -> tuple[str, ...]:
    if spread is None:
        return ()
    return (
        f"compass minus inertial heading spreads by {spread.after_deg:.1f} deg instead of {spread.before_deg:.1f}, "
        f"each of its {BLOCKS} parts corrected by the others",
    )


START_UT = 10.0  # Of d, before its covariance is learned.

MAX_STEPS, MIN_STEPS, CLOSE_UT = 30, 5, 3e-3
"""Of Gauss-Newton: it takes 6 to 10, steps below this change nothing, and the covariance of d needs five."""


@dataclass(frozen=True)
class Fit:
    """What was found.

    Attributes
    ----------
    unknowns : (U,) in the order of the model.
    up : (3,) mean direction of up in the body.
    linearization : about them.
    covariance : (9, 9) of h and the six of S.
    """

    unknowns: Floats
    up: Floats
    linearization: Linearization
    covariance: Floats

    @property
    def h(self) -> Floats:
        """(3,) uT."""
        return self.unknowns[:3]

    @property
    def S(self) -> Floats:
        """(3, 3)."""
        return matrix_of(self.unknowns[3:9])

    @property
    def b(self) -> Floats:
        """(3,) uT."""
        return np.asarray(self.unknowns[FIELD])

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
        return np.asarray(level_sum(self.up, float(self.b[2])) @ (self.unknowns[IRON] - WITHOUT_IRON))

    @property
    def seen(self) -> float:
        """Squared sigmas by which the sensor differs over the ground from one without iron; chi-square with two."""
        found = self.level_iron
        return float(found @ np.linalg.solve(self.level_covariance, found))

    @property
    def worst_sigma(self) -> float:
        """Of h, in the worst direction, uT."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[2]))

    @property
    def level_sigma(self) -> float:
        """Of the worse direction over the ground, uT."""
        return float(np.sqrt(np.linalg.eigvalsh(self.level_covariance)[1]))


def fit_iron(walk: Walk) -> Fit:
    """Find the iron from none on, with its covariance."""
    at, spread = start_unknowns(walk), START_UT**2 * np.stack([np.eye(PHASES)] * 3)
    prior, rest = prior_precision(walk), np.zeros(walk.unknowns)
    rest[IRON] = WITHOUT_IRON
    for step in range(MAX_STEPS):
        residual, jacobian = linearize(walk, at)
        whitening = find_whitening(spread)
        weight = compute_weights(whiten(whitening, residual))
        last = Linearization(residual, jacobian, weight, whitening, prior)
        normal = last.information.sum(axis=0) + prior
        change = np.linalg.solve(normal, last.pull.sum(axis=0) - prior @ (at - rest))
        if step >= MIN_STEPS and np.abs(change[:3]).max() < CLOSE_UT:
            break
        at = at + change
        spread = learn_spread(walk, residual - jacobian @ change, weight)
    covariance = compute_covariance(walk, last)[IRON, IRON]
    return Fit(at, mean_up(walk.strides.standing_R), last, covariance)


def level_sum(up: Floats, vertical_uT: float) -> Floats:
    """(2, 9): what h and the six of S add up to over the ground, in levelled axes, where up is up in the body."""
    by_soft = np.stack([matrix_of(one) @ up for one in np.eye(6)], axis=1)
    return np.asarray(compute_level_R_body(up)[:2] @ np.hstack([np.eye(3), vertical_uT * by_soft]))
