"""From the samples between two nodes to one measurement: of the inertial sensor, or of a person who was not seen.

Preintegration is Galilean, each sample held over its own period, with the noise of a moving foot as the mean over an
interval (`docs/models.md`); samples of extra sigma (`find_extra_sigmas`) have it at their own time. A gap is
integrated in steps of the sample period: within a step, what turns does not yet move.

Compounding, for speed. A block of samples turns the body by R and moves it by v (m/s) and p (m) in T seconds, exactly
(`mechanisation`, without gravity). The two samples that stand for it hold one rate w for all of T, and a specific force
each for half of it:

    theta = w h,    h = T / 2,    Exp(2 theta) = R,
    v = h Gamma_1 (f_1 + g),      p = h^2 ((Gamma_1 + Gamma_2) f_1 + Gamma_2 g),      g = Exp(theta) f_2,

and as all functions of [theta] commute, with s = Gamma_1^-1 v / h,

    f_1 = Gamma_1^-1 (p / h^2 - Gamma_2 s),    f_2 = Exp(theta)^T (s - f_1).

So R, v and p between two nodes are those of the samples, coning and sculling with them. How they change with the bias
and the covariance of their noise are those of the two: they differ by the square of what turns in a block, which ends
before it has turned by `MAX_TURN_RAD` or lasts `MAX_S`, by which the sigmas of a walk are right to 1 %, and its end
moves by 1 % of its sigma at most.

Unseen walks. In a gap of more than `MAX_HELD_S` nothing shows how the foot moved, and the inertial measurement of the
interval, before the gap and behind it, is given up. Between the nodes on either side, of a time T apart, the foot has
walked and turned (`factors.walk_constraints`) by

    0 +- WALKING_M_S d(T)      over ground on each axis
    0 +- CLIMBING_M_S d(T)     up
    turn +- min(TURNING_RAD sqrt(T), UNKNOWN_RAD),

    d(T)^2 = 2 tau (T - tau (1 - exp(-T / tau))),     tau = `STRAIGHT_S`,

the displacement of a velocity that is forgotten with the time tau (Fuerth 1920): T at first, sqrt(2 tau T) in the end.
The turn is that of the magnetic field between the stances on either side, as far as it is better than nothing: with f
the turn that makes the field there point as it did before, known to `FIELD_SIGMA_RAD` indoors,

    turn = f s^2 / (s^2 + FIELD_SIGMA_RAD^2),     s the sigma of the turn;     0 without a field.

The sigma stays that of a person: the compass of the footfalls begins there, and has a second zero half a turn away.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import gtsam
import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.factors.residual import one_of
from fg_nav.factors.rotation import turn_about_up
from fg_nav.factors.walk_constraints import UnseenWalk
from fg_nav.frames import UNKNOWN_RAD, level_attitude, yaw_rotation
from fg_nav.mechanisation import NavState, rotation_series, rotation_vector, strapdown
from fg_nav.recording import Recording, find_extra_sigmas
from fg_nav.samples.gaps import cross_holes, find_holes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.system.compiled import njit

POSITION_DENSITY = 1e-3  # White error of velocity, m/s/sqrt(Hz): rounding; keeps short intervals well conditioned.
MAX_TURN_RAD = 0.3  # Of the body in a block of samples, along its way.
MAX_S = 0.12  # Of a block.
SHORTEST = 3  # Samples in a block: fewer stand for themselves.
WALKING_M_S = 1.0  # On each axis over ground: 1.4 m/s on both together, as people walk.
CLIMBING_M_S = 0.35  # Stairs are climbed at 0.3 to 0.5 m/s, and most ways are level.
STRAIGHT_S = 120.0  # People go on in one direction, up to a street: after an hour they are within 1.3 km, one sigma.
TURNING_RAD = 0.5  # In a second; a random walk: a right angle each ten seconds, as indoors.
FIELD_SIGMA_RAD = 0.8  # Of the field's turn from one footfall to another, in a building.
TILT_SIGMA_RAD = 0.3  # Of a foot in two stances: slopes, stairs, and the phase of its roll.
REACH_S = 0.1  # On either side of a node, over which gravity and field are averaged.

Measurement: TypeAlias = gtsam.PreintegratedImuMeasurementsG | UnseenWalk
"""From one node to the next: of the inertial sensor, or where its samples are missing what a person does."""


def preintegrate(
    recording: Recording,
    sample: Ints,
    bias: gtsam.imuBias.ConstantBias,
    p: SmootherParameters,
    progress: Callable[[float], None] | None = None,
) -> Iterator[Measurement]:
    """Yield the preintegrated measurement, or `UnseenWalk` over a gap, between nodes at `sample` (M,), at `bias`."""
    # Squared noise densities of the intervals, extra sigmas of single samples, and the intervals that have such.
    (force, rate), h = recording.integrable, np.diff(recording.t)
    off_gravity, turning = _mean_squares(recording.t, recording.acc, recording.gyr, sample, p.gravity)
    acc_noise = p.acc_density**2 + p.acc_relative_density**2 * off_gravity
    gyr_noise = np.radians(p.gyr_density_deg_s) ** 2 + p.gyr_relative_density**2 * turning
    acc_extra, gyr_extra = find_extra_sigmas(recording, p.saturated_share)
    is_uncertain = np.diff(np.append(0, np.cumsum(acc_extra.any(axis=1) | gyr_extra.any(axis=1)))[sample]) > 0
    # Walks that were not seen, and the samples compounded.
    unseen, vector = find_unseen_walks(recording, sample, p.magnetic.compass), bias.vector()
    few = compound_samples(force, rate, h, sample, vector[:3], vector[3:])
    held, begins = few.h.tolist(), few.first.tolist()
    params = gtsam.PreintegrationParams.MakeSharedU(p.gravity)
    params.setIntegrationCovariance(np.eye(3) * POSITION_DENSITY**2)
    for k, part in enumerate(pairwise(begins)):
        if progress is not None and k % 64 == 0:
            progress(k / len(sample))
        if unseen.unseen[k]:
            yield one_of(unseen.walk, k)
            continue
        of_acc, of_gyr = acc_noise[k] * np.eye(3), gyr_noise[k] * np.eye(3)
        params.setAccelerometerCovariance(of_acc)
        params.setGyroscopeCovariance(of_gyr)
        measurement = gtsam.PreintegratedImuMeasurementsG(params, bias)
        if is_uncertain[k]:
            # The samples one by one, each with its variance and the noise of the interval.
            for i in range(sample[k], sample[k + 1]):
                duration = float(h[i])
                params.setAccelerometerCovariance(of_acc + np.diag(acc_extra[i] ** 2 * duration))
                params.setGyroscopeCovariance(of_gyr + np.diag(gyr_extra[i] ** 2 * duration))
                steps = max(1, round(duration / recording.period_s))
                for _ in range(steps):
                    measurement.integrateMeasurement(force[i], rate[i], duration / steps)
        else:
            rows = slice(*part)
            for one in zip(few.force[rows], few.rate[rows], held[rows], strict=True):
                measurement.integrateMeasurement(*one)
        yield measurement


@njit(cache=True)
def _mean_squares(t: Floats, acc: Floats, gyr: Floats, sample: Ints, gravity: float) -> tuple[Floats, Floats]:
    """Return mean squares (M-1,) of |f| - g (m/s^2) and |w| (rad/s) between nodes: noise grows with them."""
    off_gravity, rate = np.zeros(len(sample) - 1), np.zeros(len(sample) - 1)
    for k in range(len(sample) - 1):
        for i in range(sample[k], sample[k + 1]):
            h = t[i + 1] - t[i]
            force = np.sqrt(acc[i, 0] ** 2 + acc[i, 1] ** 2 + acc[i, 2] ** 2)
            off_gravity[k] += (force - gravity) ** 2 * h
            rate[k] += (gyr[i, 0] ** 2 + gyr[i, 1] ** 2 + gyr[i, 2] ** 2) * h
        duration = t[sample[k + 1]] - t[sample[k]]
        off_gravity[k] /= duration
        rate[k] /= duration
    return off_gravity, rate


class Compound(NamedTuple):
    """Samples that stand for those between nodes: `force` (K, 3) m/s^2 and `rate` (K, 3) rad/s, held for `h` (K,) s.

    Those from node k to the next are `first[k]` to `first[k + 1]`, (M,).
    """

    force: Floats
    rate: Floats
    h: Floats
    first: Ints


@njit(cache=True)
def compound_samples(
    force: Floats, rate: Floats, h: Floats, sample: Ints, acc_bias: Floats, gyro_bias: Floats
) -> Compound:
    """Replace each short block of samples (N, 3), held `h` (N,) s, by two with the same integrals, at these biases."""
    most = sample[-1] - sample[0]
    out = Compound(np.empty((most, 3)), np.empty((most, 3)), np.empty(most), np.zeros(len(sample), np.int64))
    state = NavState(np.empty(3), np.empty(3), np.empty((3, 3)), gyro_bias, acc_bias)
    turn, work, count = np.empty((3, 3)), np.empty((3, 3)), 0
    for k in range(len(sample) - 1):
        i = sample[k]
        while i < sample[k + 1]:
            stop = _end_block(rate, h, i, sample[k + 1], gyro_bias)
            if stop - i < SHORTEST:
                write_sample(out, count, force[i], rate[i], h[i])
                i, count = i + 1, count + 1
            else:
                _halve(out, count, force, rate, h, i, stop, state, turn, work)
                i, count = stop, count + 2
        out.first[k + 1] = count
    return Compound(out.force[:count].copy(), out.rate[:count].copy(), out.h[:count].copy(), out.first)


@njit(cache=True)
def write_sample(out: Compound, row: int, force: Floats, rate: Floats, h: float) -> None:
    """Write one sample."""
    out.h[row] = h
    for axis in range(3):
        out.force[row, axis], out.rate[row, axis] = force[axis], rate[axis]


@njit(cache=True)
def _end_block(rate: Floats, h: Floats, first: int, last: int, gyro_bias: Floats) -> int:
    """Return the end (exclusive) of the block from `first`: limited by turn, duration and `last`."""
    turned, elapsed, i = 0.0, 0.0, first
    while i < last:
        square = 0.0
        for axis in range(3):
            square += (rate[i, axis] - gyro_bias[axis]) ** 2
        turned += np.sqrt(square) * h[i]
        elapsed += h[i]
        # Tolerance of a quarter of a sample: rounded stamps must not move the end of a block.
        if i > first and (turned > MAX_TURN_RAD or elapsed > MAX_S + 0.25 * h[i]):
            break
        i += 1
    return i


@njit(cache=True)
def _halve(
    out: Compound,
    row: int,
    force: Floats,
    rate: Floats,
    h: Floats,
    first: int,
    stop: int,
    state: NavState,
    turn: Floats,
    work: Floats,
) -> None:
    """Write two samples that reproduce the block's attitude, velocity and position to `out`, from row `row`."""
    T, acc_bias, gyro_bias = 0.0, state.acc_bias, state.gyro_bias
    for k in range(3):
        state.position[k], state.velocity[k] = 0.0, 0.0
        for axis in range(3):
            state.nav_R_body[k, axis] = 1.0 if k == axis else 0.0
    for i in range(first, stop):
        strapdown(state, force[i], rate[i], h[i], 0.0, turn, work[0])
        T += h[i]
    half, theta = 0.5 * T, rotation_vector(state.nav_R_body)
    x = 0.0
    for axis in range(3):
        theta[axis] *= 0.5
        x += theta[axis] ** 2
    a, b, c = rotation_series(x)
    to_mean = (1.0 - (1.0 - b * x) / (2.0 * a)) / x if x > 1e-12 else 1.0 / 12.0
    total, one, other = work[0], work[1], work[2]
    _apply(theta, 1.0, -0.5, to_mean, state.velocity, total)
    _apply(theta, 0.5, b, c, total, other)
    for axis in range(3):
        other[axis] = (state.position[axis] / half - other[axis]) / half
    _apply(theta, 1.0, -0.5, to_mean, other, one)
    for axis in range(3):
        other[axis] = total[axis] / half - one[axis]
    _apply(theta, 1.0, b * x - 1.0, a, other, total)
    for axis in range(3):
        one[axis] += acc_bias[axis]
        total[axis] += acc_bias[axis]
        theta[axis] = theta[axis] / half + gyro_bias[axis]
    write_sample(out, row, one, theta, half)
    write_sample(out, row + 1, total, theta, half)


@njit(cache=True)
def _apply(theta: Floats, by_itself: float, by_one: float, by_two: float, v: Floats, out: Floats) -> None:
    """Write (by_itself I + by_one [theta] + by_two [theta]^2) v: in numbers, which are compiled sooner than arrays."""
    x, y, z = theta[0], theta[1], theta[2]
    c0, c1, c2 = y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]
    out[0] = by_itself * v[0] + by_one * c0 + by_two * (y * c2 - z * c1)
    out[1] = by_itself * v[1] + by_one * c1 + by_two * (z * c0 - x * c2)
    out[2] = by_itself * v[2] + by_one * c2 + by_two * (x * c1 - y * c0)


class UnseenWalks(NamedTuple):
    """Of the intervals between M nodes.

    ============ ======== =====================================================================
    unseen       (M-1,)   whether samples are missing
    body_up      (M-1, 3) specific force at the end of each that is unseen, m/s^2
    walk                  what a person does in each; of those that are seen, nothing of meaning
    ============ ======== =====================================================================
    """

    unseen: Bools
    body_up: Floats
    walk: UnseenWalk


def find_unseen_walks(recording: Recording, sample: Ints, with_compass: bool = True) -> UnseenWalks:
    """Return the intervals between nodes at `sample` (M,) with gaps, and the expected move and turn over each."""
    unseen = cross_holes(recording.t, sample)
    elapsed = np.diff(recording.t[sample])
    move = walk_for(elapsed)[:, None] * np.array([WALKING_M_S, WALKING_M_S, CLIMBING_M_S])
    turn, sigma = np.zeros(len(elapsed)), np.minimum(TURNING_RAD * np.sqrt(elapsed), UNKNOWN_RAD)
    body_up = np.zeros((len(elapsed), 3))
    for k in np.flatnonzero(unseen):
        (_, before), (body_up[k], behind) = (_average_about(recording, int(i)) for i in sample[k : k + 2])
        share, of_field = sigma[k] ** 2 / (sigma[k] ** 2 + FIELD_SIGMA_RAD**2), float(turn_about_up(behind @ before.T))
        turn[k] = share * of_field if with_compass and np.isfinite(of_field) else 0.0
    return UnseenWalks(unseen, body_up, UnseenWalk(move, turn, sigma, np.full(len(elapsed), TILT_SIGMA_RAD)))


def walk_for(elapsed_s: Floats) -> Floats:
    """Displacement d (...) of a person, rms, over these times (...) and over the speed: s."""
    forgotten = -STRAIGHT_S * np.expm1(-elapsed_s / STRAIGHT_S)
    return np.asarray(np.sqrt(2.0 * STRAIGHT_S * (elapsed_s - forgotten)))


def _average_about(recording: Recording, node: int) -> tuple[Floats, Floats]:
    """Mean specific force (3,) about a node, up to the next hole, and the attitude (3, 3) by it and the field there.

    In that attitude the force points up and the field north; NaN without a field.
    """
    t = recording.t
    first, stop = np.searchsorted(t, [t[node] - REACH_S, t[node] + REACH_S])
    holes = find_holes(t[first:stop]) + first
    about = slice(max([first, *(holes[holes < node] + 1)]), min([stop, *(holes[holes >= node] + 1)]))
    force = recording.acc[about].mean(axis=0)
    if recording.mag is None or not (seen := np.isfinite(recording.mag[about, 0])).any():
        return force, np.full((3, 3), np.nan)
    level_R_body = level_attitude(force)
    east, north, _ = level_R_body @ recording.mag[about][seen].mean(axis=0)
    return force, yaw_rotation(float(np.arctan2(east, north))) @ level_R_body
