"""Dead reckoning by steps alone: each a length along the path, in the direction in which the thigh swings.

    p_k+1 = p_k + l_k d_k,     d_k level and forward: the mean of the thigh's left over a stride, turned to the front

Over a stride the twist of the pelvis goes to and fro, and cancels. Height is not observed, and stays what it was.

Length of a step, in step constants c of the person, by the opening a of the legs and by the time T that it takes:

    length = c (2 sin(a / 2) + r / T) / 2,     or c r / T where no opening is seen

The first is that of two straight legs of length c (Munoz Diaz and Mendiguchia Gonzalez 2014: the step grows with the
opening, whatever the speed, and each person has his own figures). The second is the walk ratio, step length over
cadence, which a person keeps above some 1 m/s and 98 steps/min (Sekiya and Nagasaki 1998; PMC5430280), and which is
about 0.006 m per step/min: 0.0062 here, assumed good to a tenth. Slower steps are longer than that. The errors of both
are independent. c is no leg to be measured: knees bend, the pelvis turns along, heel and toe add to the length, and a
sensor in a pocket moves more than the bone.

Default: c is the leg of an adult, 0.90 m, for a hip is 0.53 of the height over the floor, and the height 1.70 m. Then a
usual step of 0.70 m opens the legs by 46 deg, and takes 0.53 s.

The position's covariance has four parts, l being the lengths, n the left of the directions d, sums over all steps:

======= =============================== ==============================================================================
scale   (s sum l d)(..)^T               the constant of the length, the same always
heading sum_m dv_m (J r_m)(J r_m)^T     v_m the track's variance of heading at step m, never falling, dv_m by how much
                                        it grew, r_m the path from there to here, J a quarter turn: a lost heading
                                        stays lost for the rest of the walk. dv_0 is that of the start and of the
                                        axis, which is not quite across the path
steps   sum l^2 (q^2 d d^T + r^2 n n^T) length and direction of each on its own
slope   (g sum l)^2 on the vertical     stairs and ramps
======= =============================== ==============================================================================
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.pocket.steps import Steps, ThighSwing
from fg_nav.pocket.track import PocketTrack

DEFAULT_CONSTANT_M = 0.90  # Step constant of an adult, m.
WALK_RATIO_S = 0.0062 * 60.0 / DEFAULT_CONSTANT_M  # r: walk ratio 0.0062 m per step/min; the literature has about 0.006

DEFAULT_SIGMA = 0.10
"""Relative, of the default constant: persons and trousers differ by 0.12 in the opening, by 0.10 in the walk ratio."""

CALIBRATED_SIGMA = 0.03  # Relative, of a constant by a known distance: another pace, other trousers, the tape.
STEP_SIGMA = 0.06  # Relative, of each step on its own: steps of one opening differ by so much. Assumed; it averages out
PLAUSIBLE_M = (0.3, 1.5)  # No person's constant is outside.

MOUNTING_SIGMA_DEG = 4.0
"""Axis of the swing against the path, deg: a leg that abducts while it swings turns it by 2 in the simulator, and toes
that point out by some more. Assumed."""

STEP_HEADING_SIGMA_DEG = 4.0  # Direction of each step on its own, deg. Assumed.
SLOPE_SIGMA = 0.03  # Rise over run: floors, streets and ramps. Stairs are ten times that, and not detected. Assumed.


@dataclass(frozen=True)
class StepLength:
    """The length of a step as a function of its opening.

    Attributes
    ----------
    constant_m : c.
    sigma : relative, one standard deviation, of all lengths alike.
    source : of the constant, in words.
    """

    constant_m: float = DEFAULT_CONSTANT_M
    sigma: float = DEFAULT_SIGMA
    source: str = "default"

    def __post_init__(self) -> None:
        low, high = PLAUSIBLE_M
        if not low <= self.constant_m <= high:
            raise EstimationError(
                f"a step constant of {self.constant_m:.3g} m is no person's ({low:g} to {high:g} m): check the known "
                "distance, or give a step constant in between."
            )

    def predict(self, steps: Steps) -> Floats:
        """Lengths (S,) m of steps."""
        return self.constant_m * measure_steps(steps)


def compute_chords(opening: Floats) -> Floats:
    """Lengths (S,) of steps of these openings (S,) rad, in step constants."""
    return np.asarray(2.0 * np.sin(opening / 2.0))


def measure_steps(steps: Steps) -> Floats:
    """Lengths (S,) of steps in step constants, by their openings, where these are known, and their durations."""
    by_cadence = WALK_RATIO_S / np.maximum(steps.took, 1e-3)
    by_opening = compute_chords(steps.opening)
    return np.asarray(0.5 * (np.where(np.isnan(by_opening), by_cadence, by_opening) + by_cadence))


def calibrate_step_length(steps: Steps, known_distance_m: float) -> StepLength:
    """Find the constant of a person who made these steps over a known distance, m, along the path.

    Raises `EstimationError` without a step, with no such distance, or if the constant that comes out is no
    person's.
    """
    if not (np.isfinite(known_distance_m) and known_distance_m > 0):
        raise EstimationError(f"a known distance of {known_distance_m:g} m is none: give the metres walked.")
    if not len(steps):
        raise EstimationError("there is no step to calibrate the step length by: record a walk.")
    constant = float(known_distance_m / measure_steps(steps).sum())
    return StepLength(constant, CALIBRATED_SIGMA, source="known distance")


def use_step_constant(constant_m: float) -> StepLength:
    """Return the length by a constant that was calibrated before; raises `EstimationError` if it is no person's."""
    return StepLength(constant_m, CALIBRATED_SIGMA, source="given")


# the path


@dataclass(frozen=True)
class SteppedPath:
    """The path of the steps.

    Attributes
    ----------
    sample : (P,) at the start of the walk, and at both ends of each step.
    position : (P, 3) m, relative to the first.
    covariance : (P, 3, 3) m^2.
    length : (S,) m of each step.
    heading : (S,) rad clockwise from north, of each step.
    """

    sample: Ints
    position: Floats
    covariance: Floats
    length: Floats
    heading: Floats


def reckon_path(track: PocketTrack, swing: ThighSwing, steps: Steps, step_length: StepLength) -> SteppedPath:
    """Add up the steps of a track."""
    sigma = track.sigma[(steps.start + steps.stop) // 2, 2]
    return add_steps(steps, estimate_directions(track, swing, steps), sigma, step_length)


def add_steps(
    steps: Steps, forward: Floats, heading_sigma: Floats, step_length: StepLength, unseen: Floats | None = None
) -> SteppedPath:
    """Add up steps.

    Parameters
    ----------
    forward : (S, 2) direction of each, of length 1.
    heading_sigma : (S,) rad, of the track at each.
    unseen : (S, 2, 2) m^2, covariance of the place at the end of each by what the sigmas do not show; None for none.
    """
    length = step_length.predict(steps)
    after = np.cumsum(length[:, None] * forward, axis=0)
    position = np.concatenate([np.zeros((1, 2)), after])
    covariance = _propagate_covariance(forward, length, heading_sigma, step_length.sigma)
    if unseen is not None:
        covariance[1:, :2, :2] += unseen
    ends = np.repeat(np.arange(len(steps) + 1), 2)[1:-1]  # before and after each step
    return SteppedPath(
        sample=np.stack([steps.start, steps.stop], axis=1).ravel(),
        position=np.pad(position, ((0, 0), (0, 1)))[ends],
        covariance=covariance[ends],
        length=length,
        heading=np.arctan2(forward[:, 0], forward[:, 1]),
    )


def estimate_directions(track: PocketTrack, swing: ThighSwing, steps: Steps) -> Floats:
    """Directions (S, 2) east and north, of length 1, in which the thigh swings over the stride about each step."""
    left = track.nav_R_body[:, :2] @ swing.left
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(left, axis=0)])
    half = (steps.stop - steps.start + 1) // 2
    first, last = np.maximum(steps.start - half, 0), np.minimum(steps.stop + half, len(left))
    return turn_forward(total[last] - total[first])


def turn_forward(left: Floats) -> Floats:
    """Directions (S, 2) east and north, of length 1, a quarter turn to the right of these (S, 2), of any length."""
    left = left / np.linalg.norm(left, axis=1, keepdims=True)
    return np.stack([left[:, 1], -left[:, 0]], axis=1)


def propagate_corrections(along: Floats, variance: Floats) -> Floats:
    """Covariance (S, 2, 2) of the places after steps `along` (S, 2) m, by what a filter learned of the heading later.

    Where its variance (S,) of the heading falls by dv it was corrected by so much, and the steps before keep the
    direction that they had: sum dv_m (J p_m)(J p_m)^T over the m at which it fell, p_m the path until there.
    """
    fallen = np.maximum(-np.diff(variance, prepend=variance[0]), 0.0)
    before = np.cumsum(along, axis=0) - along
    across = np.stack([-before[:, 1], before[:, 0]], axis=1)
    return np.asarray(np.cumsum(fallen[:, None, None] * _outer(across), axis=0))


def _propagate_covariance(forward: Floats, length: Floats, sigma: Floats, scale_sigma: float) -> Floats:
    """Covariance (S + 1, 3, 3) m^2 before and after each step."""
    along, left = length[:, None] * forward, np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    after = np.cumsum(along, axis=0)
    own = _outer(STEP_SIGMA * along) + _outer(np.radians(STEP_HEADING_SIGMA_DEG) * length[:, None] * left)
    variance = np.maximum.accumulate(sigma**2) + np.radians(MOUNTING_SIGMA_DEG) ** 2
    covariance = np.zeros((len(length) + 1, 3, 3))
    covariance[1:, :2, :2] = (
        _outer(scale_sigma * after) + np.cumsum(own, axis=0) + _propagate_heading(after, along, variance)
    )
    covariance[1:, 2, 2] = (SLOPE_SIGMA * np.cumsum(length)) ** 2
    return covariance


def _propagate_heading(after: Floats, along: Floats, variance: Floats) -> Floats:
    """Covariance (S, 2, 2) by a heading of this variance (S,): sum over m of dv_m (J (p - p_m))(J (p - p_m))^T."""
    grown = np.diff(variance, prepend=0.0)
    before = after - along
    once = np.cumsum(grown[:, None] * before, axis=0)
    twice = np.cumsum(grown[:, None, None] * _outer(before), axis=0)
    mixed = once[:, :, None] * after[:, None, :]
    total = variance[:, None, None] * _outer(after) - mixed - np.swapaxes(mixed, 1, 2) + twice
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    return np.asarray(quarter @ total @ quarter.T)


def _outer(vectors: Floats) -> Floats:
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])
