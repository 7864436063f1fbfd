"""Hard and soft iron from an ordinary walk: what turns with the foot is the sensor's, what stays is the building's.

The model, its fit and the covariance are in `fg_nav.calibration.walk_model`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration import (
    LEVEL_FIELD_UT,
    MagnetometerCalibration,
    check_strength,
    circular_sd_deg,
    differentiate_inverse,
    matrix_of,
    mean_up,
)
from fg_nav.calibration.walk_model import (
    BLOCKS,
    DRIFT_RATE_DEG_S,
    IRON,
    PHASES,
    SOFT_IRON_SIGMA,
    WITHOUT_IRON,
    IronFit,
    StrideModel,
    StrideReadings,
    fit_iron,
    list_blocks,
    read_strides,
    sum_iron,
)
from fg_nav.detection.stance import Stances
from fg_nav.errors import CalibrationError, MagneticError
from fg_nav.frames import average_angles, compute_heading, wrap_angle
from fg_nav.magnetic.footfall_field import FootfallField, average_footfall_field
from fg_nav.recording import Recording
from fg_nav.text import format_count

MIN_SIGNIFICANCE = -2.0 * float(np.log(0.05))  # Of horizontal iron, the 95 % quantile; soft iron alone hardly shows.
FAR_SIGMAS = 6.0  # Soft iron this far from none, by its prior sigma, is another motion.
DRIFT_SIGMAS, LINE_STEP_RAD = 3.0, 0.1  # Range of drift rates where spreads are compared; step at the end of the walk.
MIN_STRIDES = 20  # One stride determines h to 10 uT, twenty to 2 uT.


@dataclass(frozen=True)
class WalkCalibrationParameters:
    """Requirements on the result."""

    largest_sigma_uT: float = 4.0  # Of horizontal h: 11 deg of heading at 21 uT; a worse compass is no use.
    must_gain: bool = True  # Refuse a field none of Earth's, no iron, or no gain out of sample; False to study walks.


class Spread(NamedTuple):
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
    walk = StrideModel.of(strides)
    fit = _fit_counted(walk)
    if fit.level_sigma > parameters.largest_sigma_uT:
        heading = compute_heading(walk.strides.standing_R)
        share = np.mean(np.abs(wrap_angle(heading - average_angles(heading))) < np.pi / 4)
        raise CalibrationError(
            f"after {len(walk)} strides the hard iron would be known to {fit.level_sigma:.1f} uT only, for "
            f"{100 * share:.0f} % of them head within 45 deg of one direction: walk longer and through all headings, "
            "such as a round or a figure of eight, or calibrate on a loop."
        )
    spread = measure_spread(walk, fit)
    if parameters.must_gain:
        check_strength(float(np.linalg.norm(fit.b[:2])), LEVEL_FIELD_UT)
        if fit.level_iron @ np.linalg.solve(fit.level_covariance, fit.level_iron) < MIN_SIGNIFICANCE:
            raise CalibrationError(
                f"no iron shows against the building: over the ground {np.linalg.norm(fit.level_iron):.1f} uT were "
                f"found, and {len(walk)} strides show it to {fit.level_sigma:.1f} uT per axis; go on without a "
                "calibration, or walk longer."
            )
        _check_bending(fit)
        if not _measure_gain(walk, fit) > 0.0:
            raise CalibrationError(
                "the iron found in one part of the walk does not help in the others, whose readings it explains worse "
                "than none; go on without a calibration, or walk longer."
            )
    return _build_calibration(fit, walk, spread)


def find_iron(strides: StrideReadings) -> MagnetometerCalibration:
    """Find the iron of a walk's own magnetometer, whatever its covariance.

    Raises `CalibrationError` for too few strides, or a fit that no shoe's iron explains; `MagneticError` where the
    whole reading turns with the foot: a dead magnetometer.
    """
    walk = StrideModel.of(strides)
    fit = _fit_counted(walk)
    level_uT = float(np.linalg.norm(fit.b[:2]))
    if level_uT < LEVEL_FIELD_UT[0]:
        raise MagneticError(
            f"the readings of the magnetometer turn with the foot, and {level_uT:.1g} uT of them do not: it measures "
            "no field of the Earth; go on without it (--no-mag)."
        )
    _check_bending(fit)
    return _build_calibration(fit, walk, None)


def find_iron_sigma(calibration: MagnetometerCalibration, field: FootfallField) -> Floats:
    """Sigma (3,) uT, body axes, of the iron left by a calibration: h, and S times the vertical field."""
    up, vertical_uT = mean_up(field.nav_R_body), float(np.nanmean(field.nav_field[:, 2]))
    left = sum_iron(up, vertical_uT) @ differentiate_inverse(calibration.correction)
    return np.asarray(np.sqrt(np.diag(left @ calibration.covariance @ left.T)))


def _fit_counted(walk: StrideModel) -> IronFit:
    """Fit, and refuse a walk with too few strides."""
    if len(walk) < MIN_STRIDES:
        raise CalibrationError(
            f"{format_count(len(walk), 'stride')} with a field cannot tell the shoe's iron from the building's: "
            f"walk {MIN_STRIDES} strides or more, with turns."
        )
    return fit_iron(walk)


def _check_bending(fit: IronFit) -> None:
    """Refuse soft iron far from the prior of shoes: the model does not hold."""
    bending = np.linalg.eigvalsh(fit.S)
    if np.abs(bending - 1.0).max() > FAR_SIGMAS * SOFT_IRON_SIGMA:
        raise CalibrationError(
            f"the iron found would make the field {bending.min():.2g} to {bending.max():.2g} times as strong, as no "
            "shoe does: is the sensor on a walking foot?"
        )


def _measure_gain(walk: StrideModel, fit: IronFit) -> float:
    """Cross-validated gain: chi squared of each block without iron less that with the other blocks' iron, summed."""
    last, iron = fit.linearization, np.arange(walk.unknowns) < IRON.stop
    none = WITHOUT_IRON - fit.unknowns[IRON]
    gain = 0.0
    for own, slope in zip(last.information, last.score, strict=True):
        others = last.information.sum(axis=0) - own + fit.prior
        found, without = -np.linalg.solve(others, slope), np.zeros(walk.unknowns)
        without[iron] = none
        without[~iron] = np.linalg.solve(
            others[np.ix_(~iron, ~iron)], -slope[~iron] - others[np.ix_(~iron, iron)] @ none
        )
        gain += sum(sign * (step @ own @ step - 2 * slope @ step) for sign, step in ((-1, found), (1, without)))
    return float(gain)


def measure_spread(walk: StrideModel, fit: IronFit) -> Spread:
    """Compass spread, deg, before and after cross-validation: each block corrected by one Newton step without it."""
    last = fit.linearization
    reading = walk.strides.reading[:, 0]
    corrected = np.empty_like(reading)
    for held, own, slope in zip(list_blocks(len(walk)), last.information, last.score, strict=True):
        others = last.information.sum(axis=0) - own + fit.prior
        # at the solution all scores and the prior sum to zero: leaving a block out leaves minus its score
        at = fit.unknowns - np.linalg.solve(others, slope)
        corrected[held] = np.linalg.solve(matrix_of(at[3:9]), (reading[held] - at[:3]).T).T
    # compass minus inertial heading about the line in time with the least circular sd
    t = walk.strides.start_s - walk.strides.start_s[0]
    most = DRIFT_SIGMAS * np.radians(DRIFT_RATE_DEG_S)
    rates = np.linspace(-most, most, 2 * max(1, int(np.ceil(most * t[-1] / LINE_STEP_RAD))) + 1)
    least_deg = []
    for standing in (reading, corrected):
        east, north, _ = np.einsum("kij,kj->ik", walk.strides.standing_R, standing)
        difference = np.arctan2(north, east)
        least_deg.append(min(circular_sd_deg(difference - rate * t) for rate in rates))
    return Spread(*least_deg)


def _build_calibration(fit: IronFit, walk: StrideModel, spread: Spread | None) -> MagnetometerCalibration:
    """Return the calibration: C and its covariance from S, and remarks, on `spread` too unless None."""
    spreads = []
    if spread is not None:
        spreads.append(
            f"compass minus inertial heading spreads by {spread.after_deg:.1f} deg instead of {spread.before_deg:.1f}, "
            f"each of its {BLOCKS} parts corrected by the others"
        )
    worst_uT = float(np.sqrt(np.linalg.eigvalsh(fit.covariance[:3, :3])[2]))
    correction = np.linalg.inv(fit.S)
    correction = (correction + correction.T) / 2
    by_soft = differentiate_inverse(fit.S)
    return MagnetometerCalibration(
        method="walk",
        hard_iron_uT=fit.unknowns[:3],
        correction=correction,
        covariance=by_soft @ fit.covariance @ by_soft.T,
        strength_uT=float(np.linalg.norm(fit.b)),
        residual_uT=float(np.sqrt(np.mean(fit.linearization.residual**2))),
        samples=PHASES * len(walk),
        notes=(
            f"hard iron over the ground, with what soft iron makes of the vertical field, is known to "
            f"{fit.level_sigma:.1f} uT, and the rest of it to {worst_uT:.1f} uT, from {len(walk)} strides; the "
            "size of the soft iron keeps its wide sigma",
            *spreads,
            "the residual is what the building adds to the field, typically, per axis",
        ),
    )


@dataclass(frozen=True)
class MeasuredField:
    """The field of a walk at its footfalls."""

    recording: Recording  # With the magnetometer corrected.
    field: FootfallField | None = None  # None where it is not used, or not measured.
    unseen: str = ""  # Why it was not measured, though it was to be used.
    iron: MagnetometerCalibration | None = None  # By the walk itself; None where it shows none, or one was given.
    notes: tuple[str, ...] = ()  # How the magnetometer was corrected.


def measure_walk_field(
    recording: Recording,
    stances: Stances,
    heading: float | None,
    given: MagnetometerCalibration | None,
    standings: Stances | None = None,
) -> MeasuredField:
    """Return the field at the footfalls, the magnetometer corrected by the walk itself where no calibration is given.

    `standings` are the stances by which the iron is found, None for the same.
    """
    iron, notes = None, tuple[str, ...]()
    try:
        if given is None:
            # The iron that the walk shows, if it does.
            try:
                iron = find_iron(read_strides(recording, stances if standings is None else standings))
            except CalibrationError as error:
                notes = (f"iron of the magnetometer unknown: {error}",)
            else:
                h, sigma = (", ".join(f"{x:.1f}" for x in v[:3]) for v in (iron.hard_iron_uT, iron.sigma))
                notes = (f"magnetometer corrected by the walk itself: hard iron {h} uT, each known to {sigma}",)
                recording = iron.apply_to(recording)
        # The field over each footfall, with the sigma of the iron that is left.
        field, used = average_footfall_field(recording, stances, heading or 0.0), iron if given is None else given
        if used is not None:
            field = replace(field, iron_sigma_uT=np.tile(find_iron_sigma(used, field), (len(field), 1)))
        return MeasuredField(recording, field, iron=iron, notes=notes)
    except MagneticError as error:
        return MeasuredField(recording, unseen=str(error), iron=iron, notes=notes)
