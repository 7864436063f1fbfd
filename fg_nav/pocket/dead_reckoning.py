"""Dead reckoning by steps: each a length along the path, in the direction in which the thigh swings; and GNSS fixes.

    p_k+1 = p_k + l_k d_k,     d_k level and forward: the mean of the thigh's left over a stride, turned to the front

Over a stride the twist of the pelvis goes to and fro, and cancels. Height is not observed, and stays what it was.

Length of a step, in step constants c of the person, by the opening a of the legs and by the time T that it takes:

    length = c (2 sin(a / 2) + r / T) / 2,     or c r / T without an opening

The first is that of two straight legs of length c (Munoz Diaz and Mendiguchia Gonzalez 2014: the step grows with the
opening, whatever the speed, and each person has his own figures). The second is the walk ratio, step length over
cadence, which a person keeps above some 1 m/s and 98 steps/min (Sekiya and Nagasaki 1998; PMC5430280), and which is
about 0.006 m per step/min: 0.0062 here, assumed good to a tenth. Slower steps are longer than that. The errors of both
are independent. c is no leg to be measured: knees bend, the pelvis turns along, heel and toe add to the length, and a
sensor in a pocket moves more than the bone. Default: the leg of an adult of 1.70 m, 0.53 of the height; then a usual
step of 0.70 m opens the legs by 46 deg, and takes 0.53 s.

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

Fixes. A step d_k of the path is turned and scaled by what the walk does not know well of itself, and both change
slowly: trousers, pace, and what the compass misses.

    p_k+1 = p_k + exp(s_k) R(psi_k) d_k (+ its own error)       psi_k+1 = psi_k (+ w)       s_k+1 = s_k (+ v)

psi is clockwise about up. A fix observes p at the node nearest in time, with its accuracy for sigma (`fg_nav.truth`);
each round multiplies the variance of a fix by 1 + (r / (c sigma))^2, which is Cauchy's. An extended Kalman filter
forward and the smoother of Rauch, Tung and Striebel back, about the estimates of the filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.frames import yaw_rotation
from fg_nav.pocket.steps import Steps, ThighSwing
from fg_nav.pocket.track import PocketTrack
from fg_nav.truth import CAUCHY, CORRELATED_S, Fix, Gnss, describe_start, find_turn, select_fixes

DEFAULT_CONSTANT_M = 0.90  # Step constant of an adult, m.
WALK_RATIO_S = 0.0062 * 60.0 / DEFAULT_CONSTANT_M  # r: walk ratio 0.0062 m per step/min; the literature has about 0.006
DEFAULT_SIGMA = 0.10  # Relative, of the default constant: 0.12 in the opening, 0.10 in the walk ratio of persons.
CALIBRATED_SIGMA = 0.03  # Relative, of a constant by a known distance: another pace, other trousers, the tape.
STEP_SIGMA = 0.06  # Relative, of each step on its own: steps of one opening differ by so much. Assumed; it averages out
PLAUSIBLE_M = (0.3, 1.5)  # No person's constant is outside.
MOUNTING_SIGMA_DEG = 4.0  # Axis of the swing against the path, deg: abduction 2 in the simulator, toes more. Assumed.
STEP_HEADING_SIGMA_DEG = 4.0  # Direction of each step on its own, deg. Assumed.
SLOPE_SIGMA = 0.03  # Rise over run: floors, streets and ramps. Stairs are ten times that, and not detected. Assumed.
TURN_WALK_DEG = 2.0  # Of psi, deg/sqrt(s): ten degrees in half a minute, of a sensor that shifts and of iron.
SCALE_WALK = 0.02  # Of s, 1/sqrt(s): a tenth in half a minute, by kerbs, slopes and haste.
UNSEEN_M_S = 0.7  # Walk of the place where no step is seen, m/sqrt(s): who carries the sensor in a hand goes on.
ROUNDS = 8  # Of weights of the fixes.
MAX_GIVEN_SIGMA = np.radians(45.0)  # A heading known worse is first sought in all directions.


@dataclass(frozen=True)
class StepLength:
    """The length of a step as a function of its opening."""

    constant_m: float = DEFAULT_CONSTANT_M  # C.
    sigma: float = DEFAULT_SIGMA  # Relative, one standard deviation, of all lengths alike.
    source: str = "default"  # Of the constant, in words.

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
    """Lengths (S,) in step constants: mean of those by opening and by cadence; cadence alone where opening is NaN."""
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
    """The path of the steps."""

    sample: Ints  # (P,) at the start of the walk, and at both ends of each step.
    position: Floats  # (P, 3) m, relative to the first.
    covariance: Floats  # (P, 3, 3) m^2.
    length: Floats  # (S,) m of each step.
    heading: Floats  # (S,) rad clockwise from north, of each step.


def reckon_path(track: PocketTrack, swing: ThighSwing, steps: Steps, step_length: StepLength) -> SteppedPath:
    """Return the path of the steps and its covariance, with directions and heading sigma from the track."""
    sigma = track.sigma[(steps.start + steps.stop) // 2, 2]
    return add_steps(steps, estimate_directions(track, swing, steps), sigma, step_length)


def add_steps(
    steps: Steps, forward: Floats, heading_sigma: Floats, step_length: StepLength, unseen: Floats | None = None
) -> SteppedPath:
    """Return the dead-reckoned path of steps from the origin, with its covariance (table in the module's docstring).

    Parameters
    ----------
    forward : (S, 2) unit vector east and north of each step.
    heading_sigma : (S,) rad, one standard deviation of the track's heading at each step.
    unseen : (S, 2, 2) m^2, covariance to add at the end of each step, as of gaps and later corrections; None for none.
    """
    length = step_length.predict(steps)
    along, left = length[:, None] * forward, np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    after = np.cumsum(along, axis=0)
    position = np.concatenate([np.zeros((1, 2)), after])
    # scale error common to all steps, and independent errors of length and direction of each
    own = _outer(STEP_SIGMA * along) + _outer(np.radians(STEP_HEADING_SIGMA_DEG) * length[:, None] * left)
    planar = _outer(step_length.sigma * after) + np.cumsum(own, axis=0)
    # heading: sum over m of dv_m (J (p - p_m))(J (p - p_m))^T
    variance = np.maximum.accumulate(heading_sigma**2) + np.radians(MOUNTING_SIGMA_DEG) ** 2
    grown, before = np.diff(variance, prepend=0.0), after - along
    once = np.cumsum(grown[:, None] * before, axis=0)
    twice = np.cumsum(grown[:, None, None] * _outer(before), axis=0)
    mixed = once[:, :, None] * after[:, None, :]
    total = variance[:, None, None] * _outer(after) - mixed - np.swapaxes(mixed, 1, 2) + twice
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    covariance = np.zeros((len(length) + 1, 3, 3))
    covariance[1:, :2, :2] = planar + quarter @ total @ quarter.T
    covariance[1:, 2, 2] = (SLOPE_SIGMA * np.cumsum(length)) ** 2
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
    """Unit vectors (S, 2) east and north: direction of the thigh's swing, averaged over the stride about each step."""
    left = track.nav_R_body[:, :2] @ swing.left
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(left, axis=0)])
    half = (steps.stop - steps.start + 1) // 2
    first, last = np.maximum(steps.start - half, 0), np.minimum(steps.stop + half, len(left))
    return turn_forward(total[last] - total[first])


def turn_forward(left: Floats) -> Floats:
    """Unit vectors (S, 2) east and north, 90 deg to the right of the vectors `left` (S, 2)."""
    left = left / np.linalg.norm(left, axis=1, keepdims=True)
    return np.stack([left[:, 1], -left[:, 0]], axis=1)


def propagate_corrections(along: Floats, variance: Floats) -> Floats:
    """Covariance (S, 2, 2) m^2 of positions after steps `along` (S, 2) m, by heading corrections that came too late.

    A fall dv in heading `variance` (S,) rad^2 is the variance of a correction, and steps before it keep their old
    direction: sum dv_m (J p_m)(J p_m)^T over the m at which it fell, p_m the path until there.
    """
    fallen = np.maximum(-np.diff(variance, prepend=variance[0]), 0.0)
    before = np.cumsum(along, axis=0) - along
    across = np.stack([-before[:, 1], before[:, 0]], axis=1)
    return np.asarray(np.cumsum(fallen[:, None, None] * _outer(across), axis=0))


def _outer(vectors: Floats) -> Floats:
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])


# fixes


@dataclass(frozen=True)
class FusedPath:
    """Path of steps and fixes."""

    t: Floats  # (S + 1,) s, the first step's begin and the end of each.
    position: Floats  # (S + 1, 2) m east and north, in the frame of the fixes.
    turn: Floats  # (S + 1,) psi, rad clockwise.
    log_scale: Floats  # (S + 1,) s.
    covariance: Floats  # (S + 1, 4, 4) of position, psi and s.
    weights: Floats  # (K,) of the fixes, 1 for one without a residual.


def fuse_fixes(t: Floats, steps: Floats, fixes: Sequence[Fix], heading_sigma: float, scale_sigma: float) -> FusedPath:
    """Estimate path, heading offset psi and log scale s from steps and position fixes (EKF and RTS smoother).

    Parameters
    ----------
    t : (S + 1,) s, begin of the first step and end of each.
    steps : (S, 2) m, dead-reckoned displacement east and north of each.
    fixes : at least `fg_nav.truth.MIN_FIXES` within the walk; heights are not used.
    heading_sigma, scale_sigma : prior sigmas of psi, rad, and of s, at the start.

    Raises `EstimationError` with fewer fixes.
    """
    # nearest node of each fix; its variance includes the walk between node and fix
    seen = select_fixes(fixes, float(t[0]) - CORRELATED_S, float(t[-1]) + CORRELATED_S)
    node = np.abs(seen.time[:, None] - t).argmin(axis=1)
    place, variance = seen.place, seen.sigma**2 + (UNSEEN_M_S * (seen.time - t[node])) ** 2
    # an unknown heading needs an initial guess, or the filter linearizes too far off
    walked, turn = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), 0.0
    if heading_sigma > MAX_GIVEN_SIGMA:
        turn, heading_sigma = -find_turn(walked[node], seen)[0], float(MAX_GIVEN_SIGMA)
    best = int(np.argmin(variance))
    start = place[best] - walked[node[best]] @ yaw_rotation(-turn)[:2, :2].T
    prior = np.array([*start, turn, 0.0])
    spread = np.diag([1e4, 1e4, heading_sigma**2, scale_sigma**2])
    # rounds of weights
    scale = np.ones(len(node))
    for _ in range(ROUNDS):
        x, P = _smooth(t, steps, node, place, variance * scale, prior, spread)
        off = ((place - x[node, :2]) ** 2).sum(axis=1) / variance
        scale = 1.0 + off / CAUCHY**2
    return FusedPath(t, x[:, :2], x[:, 2], x[:, 3], P, 1.0 / scale)


def _smooth(
    t: Floats, steps: Floats, node: Ints, place: Floats, variance: Floats, prior: Floats, spread: Floats
) -> tuple[Floats, Floats]:
    """Smoothed states (S + 1, 4): east and north in m, psi in rad, s; and their covariances (S + 1, 4, 4)."""
    n = len(t)
    x, P, F = np.empty((n, 4)), np.empty((n, 4, 4)), np.tile(np.eye(4), (n - 1, 1, 1))
    ahead_x, ahead_P = np.empty((n, 4)), np.empty((n, 4, 4))
    h, length = np.diff(t), np.linalg.norm(steps, axis=1)
    unseen = UNSEEN_M_S**2 * np.maximum(h - 1.5 * float(np.median(h)), 0.0)
    first = np.searchsorted(node, np.arange(n + 1))
    ahead_x[0], ahead_P[0] = prior, spread
    for k in range(n):
        # fixes at the node: those at one are one, with their mean
        x[k], P[k] = ahead_x[k], ahead_P[k]
        here = slice(first[k], first[k + 1])
        if first[k] < first[k + 1]:
            information = 1.0 / variance[here]
            mean, R = information @ place[here] / information.sum(), 1.0 / information.sum()
            gain = P[k][:, :2] @ np.linalg.inv(P[k][:2, :2] + R * np.eye(2))
            x[k] = x[k] + gain @ (mean - x[k, :2])
            P[k] = P[k] - gain @ P[k][:2]
        # the step
        if k < n - 1:
            move = np.exp(x[k, 3]) * (yaw_rotation(-x[k, 2])[:2, :2] @ steps[k])
            across = np.array([move[1], -move[0]])
            F[k][:2, 2], F[k][:2, 3] = across, move
            Q = np.diag([unseen[k], unseen[k], np.radians(TURN_WALK_DEG) ** 2 * h[k], SCALE_WALK**2 * h[k]])
            if length[k] > 0:
                Q[:2, :2] += STEP_SIGMA**2 * np.outer(move, move)
                Q[:2, :2] += np.radians(STEP_HEADING_SIGMA_DEG) ** 2 * np.outer(across, across)
            ahead_x[k + 1] = x[k] + np.array([*move, 0.0, 0.0])
            ahead_P[k + 1] = F[k] @ P[k] @ F[k].T + Q
    for k in range(n - 2, -1, -1):
        gain = P[k] @ F[k].T @ np.linalg.inv(ahead_P[k + 1])
        x[k] = x[k] + gain @ (x[k + 1] - ahead_x[k + 1])
        P[k] = P[k] + gain @ (P[k + 1] - ahead_P[k + 1]) @ gain.T
    return x, P


def lay_on_fixes(
    track: PocketTrack, path: SteppedPath, gnss: Gnss, heading_sigma: float | None, step_length: StepLength
) -> tuple[PocketTrack, SteppedPath, StepLength, dict[str, float]]:
    """Fuse a dead-reckoned path with fixes; `heading_sigma` rad of the start heading, None if unknown.

    Returns track and path turned to true north, with the path's start for origin, the estimated step length, and the
    start's geodetic coordinates. Errors as of `fuse_fixes`.
    """
    t = track.t[np.append(path.sample[:1], path.sample[1::2])]
    steps = path.position[1::2, :2] - path.position[::2, :2]
    sigma = np.pi if heading_sigma is None else float(np.hypot(heading_sigma, np.radians(MOUNTING_SIGMA_DEG)))
    fused = fuse_fixes(t, steps, gnss.fixes, sigma, step_length.sigma)
    # the path: a step begins where the one before ended
    length, at = path.length * np.exp(fused.log_scale[:-1]), np.repeat(np.arange(len(t)), 2)[1:-1]
    position, covariance = np.zeros((len(at), 3)), path.covariance.copy()
    position[:, :2], covariance[:, :2, :2] = (fused.position - fused.position[0])[at], fused.covariance[at, :2, :2]
    laid = replace(
        path, position=position, covariance=covariance, length=length, heading=path.heading + fused.turn[:-1]
    )
    # the track, turned as the path
    turned = track.sigma.copy()
    turned[:, 2] = np.interp(track.t, t, np.sqrt(fused.covariance[:, 2, 2]))
    turn = np.interp(track.t, t, fused.turn)
    track = track._replace(nav_R_body=yaw_rotation(-turn) @ track.nav_R_body, sigma=turned)
    # the step constant
    constant = step_length.constant_m * float(length.sum() / path.length.sum())
    found = StepLength(constant, float(np.sqrt(np.mean(fused.covariance[:, 3, 3]))), "GNSS")
    sigma_m = float(np.sqrt(np.trace(fused.covariance[0, :2, :2]) / 2))
    return track, laid, found, describe_start(gnss, fused.position[0], sigma_m, fused.weights > 0.5)
