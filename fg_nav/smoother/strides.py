"""From samples to strides, and from strides to factors: a walk is its strides, added one after the other.

Variables: pose X and velocity V at each node, nodes in stances only (`place_nodes`), which ties the still middle to the
rolling ends; for the footfalls of ten seconds one bias B and one excess S, m, of the settling of the sole, which
nothing inertial shows. A stride is a footfall and the swing that led to it. It adds

* inertial factors from the last node of the footfall before, through all nodes of this one; where samples are missing
  for too long, in place of one what a person can have done;
* at each node the velocity of the stance (`factors.zero_velocity`);
* where a new bias begins, random-walk factors of B and S from those before;
* for each rest in the footfall, what it shows of the gyro bias.

The first footfall has in place of the swing priors on bias and settling, and the gauge (`graph.StartPrior`).
Preintegration is Galilean, with the noise of a moving foot as the mean over an interval (`docs/models.md`).

Compounding, for speed. A block of samples turns the body by R and moves it by v (m/s) and p (m) in T seconds, exactly
(`mechanisation`, without gravity). The two samples that stand for it hold one rate w for all of T, and a specific force
each for half of it:

    theta = w h,    h = T / 2,    Exp(2 theta) = R,
    v = h Gamma_1 (f_1 + g),      p = h^2 ((Gamma_1 + Gamma_2) f_1 + Gamma_2 g),      g = Exp(theta) f_2,

and as all functions of [theta] commute, with s = Gamma_1^-1 v / h,

    f_1 = Gamma_1^-1 (p / h^2 - Gamma_2 s),    f_2 = Exp(theta)^T (s - f_1).

So R, v and p between two nodes are those of the samples. Their bias Jacobian and noise are those of the two, which
differ by the square of what turns in a block: sigmas by 1 %, with blocks of `MAX_TURN_RAD` and `MAX_S` at most.

Unseen walks. In a gap T of more than `MAX_HELD_S` nothing shows how the foot moved. Between the nodes on either side it
has walked and turned (`factors.walk_constraints`) by

    0 +- WALKING_M_S d(T)      over ground on each axis
    0 +- CLIMBING_M_S d(T)     up
    turn +- min(TURNING_RAD sqrt(T), UNKNOWN_RAD),

    d(T)^2 = 2 tau (T - tau (1 - exp(-T / tau))),     tau = `STRAIGHT_S`,

the displacement of a velocity that is forgotten with the time tau (Fuerth 1920). With f the turn that makes the field
there point as it did before, turn = f s^2 / (s^2 + FIELD_SIGMA_RAD^2), s the sigma of the turn; 0 without a field.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, S, V, X

from fg_nav.arrays import Bools, Brief, Floats, Ints
from fg_nav.detection import Rest
from fg_nav.detection.stance import Stances
from fg_nav.factors.residual import ResidualBlock, factor_of, one_of
from fg_nav.factors.rotation import turn_about_up
from fg_nav.factors.walk_constraints import UnseenWalk
from fg_nav.factors.zero_velocity import StanceVelocity, zero_rate_factor
from fg_nav.frames import UNKNOWN_RAD, level_attitude, yaw_rotation
from fg_nav.mechanisation import NavState, rotation_series, rotation_vector, strapdown
from fg_nav.recording import Recording, find_extra_sigmas
from fg_nav.samples.gaps import cross_holes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.system.compiled import njit, unliteral

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
LONG_STANCE_S = 0.5  # Beyond this length of a stance, nodes stand `REST_SPACING_S` apart.
REST_SPACING_S = 0.5
BIAS_SPACING_S = 10.0  # Footfalls within this time share one bias: its random walk in between is 0.002 deg/s.
STANDS_S = 1.5  # No walk has stances so long: the foot stands, and its sole has settled.
INERTIAL_KEYS = 5  # Pose, velocity, pose, velocity, bias: the variables of an inertial factor; none other joins as many
VELOCITY_SIGMA = 0.004  # Velocity of a foot that stands and does not turn, m/s (Peruzzi et al. 2011: below 0.011).
SETTLING_WALK_M = 2e-5  # Random walk of the excess S, m/sqrt(s): 1 mm in an hour; a sole gets warm, a lace loose.
SETTLING_TIME_S = 0.3  # Shortest time in which a sole settles.
ACC_BIAS_SIGMA = 0.02  # Accelerometer bias, m/s^2 (2 mg).
ACC_BIAS_WALK = 1e-4  # Random walk of the accelerometer bias, m/s^2/sqrt(s).
MIN_WALK_DEG_S = 1e-7  # Of the gyro bias, deg/s/sqrt(s), where none is assumed; without any there is no factor.
UNREST_REACH_S = 0.01  # On either side of a node, over which rate and force are averaged; not beyond the stance.


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
    """Samples that stand for those between nodes."""

    force: Floats  # (K, 3) m/s^2.
    rate: Floats  # (K, 3) rad/s.
    h: Floats  # (K,) s, for which each is held.
    first: Ints  # (M,) of those from each node to the next.


@njit(cache=True)
def compound_samples(
    force: Floats, rate: Floats, h: Floats, sample: Ints, acc_bias: Floats, gyro_bias: Floats
) -> Compound:
    """Replace each short block of samples (N, 3), held `h` (N,) s, by two with the same integrals, at these biases."""
    most = sample[-1] - sample[0]
    out = Compound(np.empty((most, 3)), np.empty((most, 3)), np.empty(most), np.zeros(len(sample), np.int64))
    state = NavState(np.empty(3), np.empty(3), np.empty((3, 3)), gyro_bias, acc_bias)
    turn, work, count = np.empty((3, 3)), np.empty((3, 3)), unliteral(0)
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
    """Of the intervals between M nodes."""

    unseen: Bools  # (M-1,) whether samples are missing.
    body_up: Floats  # (M-1, 3) specific force at the end of each that is unseen, m/s^2.
    walk: UnseenWalk  # What a person does in each; of those that are seen, nothing of meaning.


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
    """Mean specific force (3,) about a node, and the attitude (3, 3) in which it is up and the field north, or NaN."""
    t = recording.t
    about = slice(*np.searchsorted(t, [t[node] - REACH_S, t[node] + REACH_S]))  # it is shorter than any hole
    force = recording.acc[about].mean(axis=0)
    if recording.mag is None or not (seen := np.isfinite(recording.mag[about, 0])).any():
        return force, np.full((3, 3), np.nan)
    level_R_body = level_attitude(force)
    east, north, _ = level_R_body @ recording.mag[about][seen].mean(axis=0)
    return force, yaw_rotation(float(np.arctan2(east, north))) @ level_R_body


@dataclass(frozen=True)
class Nodes(Brief):
    """Nodes of a walk, in order of time."""

    sample: Ints  # (M,) index into the recording, ascending.
    interval: Ints  # (M,) stance interval it stands in.
    footfall: Ints  # (M,) footfall it belongs to.
    first: Ints  # (F+1,) first node of each footfall, and M.
    result: Ints  # (F,) node of each footfall at its stillest sample.
    bias: Ints  # (F,) bias variable of each footfall, from 0, never falling.

    def __len__(self) -> int:
        return len(self.sample)


def place_nodes(recording: Recording, stances: Stances, p: SmootherParameters) -> Nodes:
    """Return the nodes of all stances: both ends, evenly between, the nearest on each stillest sample."""
    stillest = stances.stillest(recording.gyr)
    at = stillest[stances.footfall]
    sample, count = _list_nodes(recording.t, stances.start, stances.stop, at, p.node_spacing_s, p.shortest_interval_s)
    interval = np.repeat(np.arange(len(stances)), count)
    footfall = stances.footfall[interval]
    first = np.searchsorted(footfall, np.arange(stances.n_footfalls + 1))
    # A new bias variable after each spacing.
    t = recording.t[stillest]
    spacing = np.floor((t - t[0]) / BIAS_SPACING_S).astype(np.int64)
    bias = np.cumsum(np.diff(spacing, prepend=spacing[0]) > 0)
    return Nodes(sample, interval, footfall, first, np.searchsorted(sample, stillest), bias)


@njit(cache=True)
def _list_nodes(
    t: Floats, start: Ints, stop: Ints, stillest: Ints, spacing: float, shortest: float
) -> tuple[Ints, Ints]:
    """Return node samples (M,) and their count (S,) in each stance interval; `spacing` and `shortest` in s."""
    most = 0
    for k in range(len(start)):
        most += _count_pieces(t[stop[k] - 1] - t[start[k]], spacing, shortest) + 1
    out, count, filled = np.empty(most, np.int64), np.zeros(len(start), np.int64), 0
    for k in range(len(start)):
        pieces = _count_pieces(t[stop[k] - 1] - t[start[k]], spacing, shortest)
        nodes = out[filled : filled + pieces + 1]
        # Evenly spaced, the one nearest to the stillest sample moved onto it.
        inside = start[k] <= stillest[k] < stop[k]
        if pieces == 0:
            nodes[0] = stillest[k] if inside else (start[k] + stop[k]) // 2
        else:
            step, nearest = (stop[k] - 1 - start[k]) / pieces, 0
            for n in range(pieces):
                nodes[n] = int(np.rint(n * step + start[k]))
            nodes[pieces] = stop[k] - 1
            for n in range(pieces + 1):
                if abs(nodes[n] - stillest[k]) < abs(nodes[nearest] - stillest[k]):
                    nearest = n
            if inside:
                nodes[nearest] = stillest[k]
        # Drop nodes that follow another within `shortest`, but never the stillest.
        kept = 1
        for n in range(1, len(nodes)):
            if t[nodes[n]] - t[nodes[kept - 1]] >= shortest:
                nodes[kept] = nodes[n]
                kept += 1
            elif nodes[n] == stillest[k]:
                nodes[kept - 1] = nodes[n]
        count[k] = kept
        filled += count[k]
    return out[:filled].copy(), count


@njit(cache=True)
def _count_pieces(duration: float, spacing: float, shortest: float) -> int:
    """Return the number of node spacings in a stance of `duration` s; zero for a single node."""
    if duration < 2 * shortest:
        return 0
    dense = min(duration, LONG_STANCE_S)
    return int(np.ceil(dense / spacing) + np.ceil((duration - dense) / REST_SPACING_S))


@dataclass(frozen=True)
class Stride:
    """What a footfall and the swing before it measured, at the nodes `first <= j < last`."""

    first: int
    last: int
    bias: int
    bias_before: int
    bias_age_s: float
    measurements: list[Measurement]  # From each node's predecessor to it; none before the very first.
    velocities: StanceVelocity  # Of all nodes that were measured together,
    own: slice  # and which of them are its own.
    rests: list[Rest]

    @property
    def velocity(self) -> StanceVelocity:
        """At each of its nodes."""
        return one_of(self.velocities, self.own)


def measure_velocities(
    recording: Recording, stances: Stances, nodes: Nodes, gyro_bias: Floats, lever: Floats, p: SmootherParameters
) -> StanceVelocity:
    """Return expected velocity and sigma at each node: w x lever and settling; `gyro_bias` (3,) rad/s is off w."""
    # Rate and specific force about the nodes.
    reach = max(1, round(UNREST_REACH_S / recording.period_s))
    rate = _about_nodes(recording.gyr, stances, nodes, reach) - gyro_bias
    off_gravity = np.linalg.norm(recording.acc, axis=1, keepdims=True) - p.gravity
    off_gravity = np.sqrt(_about_nodes(off_gravity**2, stances, nodes, reach)[:, 0])
    # The sole settles once in a footfall, though the stance may be in pieces. Who stands has settled: a long stance, or
    # one that begins where the one before ended, settles no more.
    t, first = recording.t, np.searchsorted(stances.footfall, np.arange(stances.n_footfalls))
    last = np.append(first[1:], len(stances)) - 1
    duration = t[stances.stop[last] - 1] - t[stances.start[first]]
    continues = np.append(False, stances.start[first[1:]] == stances.stop[last[:-1]])
    of_footfall = np.where(continues | (duration > STANDS_S), 0.0, 1.0 / np.maximum(duration, SETTLING_TIME_S))
    sinks_per_m = of_footfall[nodes.footfall]
    settling = np.zeros((len(rate), 3))
    settling[:, 2] = -(p.settling_m * sinks_per_m)
    # Sigma of a still foot, of a rolling one, and of the settling.
    still = VELOCITY_SIGMA**2 + (p.unsteady_s * off_gravity) ** 2
    rolling = p.roll_sigma_m**2 * (rate**2).sum(axis=1)
    sigma = np.repeat(np.sqrt(still + rolling)[:, None], 3, axis=1)
    sigma[:, 2] = np.hypot(sigma[:, 2], p.settling_sigma_m * sinks_per_m)
    return StanceVelocity(np.cross(rate, lever), settling, sigma, sinks_per_m)


def strides_of(
    recording: Recording,
    nodes: Nodes,
    measurements: Iterator[Measurement],
    velocities: StanceVelocity,
    rests: tuple[Rest, ...],
) -> Iterator[Stride]:
    """Yield the strides of a walk in order; `measurements` one an interval, `velocities` (M,) of all nodes."""
    t = recording.t[nodes.sample[nodes.result]]
    begun = t[np.flatnonzero(np.diff(nodes.bias, prepend=-1))]
    # The footfall in which, or next to which, each rest lies.
    middles = [(rest.start + rest.stop) // 2 for rest in rests]
    nearest = np.clip(np.searchsorted(nodes.sample, middles), 0, len(nodes) - 1)
    rests_of: dict[int, list[Rest]] = {}
    for rest, footfall in zip(rests, nodes.footfall[nearest], strict=True):
        rests_of.setdefault(int(footfall), []).append(rest)
    for k, (first, last) in enumerate(zip(nodes.first[:-1], nodes.first[1:], strict=True)):
        yield Stride(
            first=first,
            last=last,
            bias=nodes.bias[k],
            bias_before=nodes.bias[max(k - 1, 0)],
            bias_age_s=t[k] - begun[nodes.bias[max(k - 1, 0)]],
            measurements=[next(measurements) for _ in range(max(first, 1), last)],
            velocities=velocities,
            own=slice(first, last),
            rests=rests_of.get(k, []),
        )


def add_stride(graph: gtsam.NonlinearFactorGraph, stride: Stride, p: SmootherParameters) -> None:
    """Add the factors of a stride but those of its velocities, which a batch linearizes jointly (`join_velocities`)."""
    _add_inertial(graph, stride)
    _add_sensor(graph, stride, p)


def join_velocities(velocities: StanceVelocity, nodes: Nodes) -> ResidualBlock:
    """Return the stance velocities of all nodes of a walk as one block, with their keys."""
    bias = nodes.bias[nodes.footfall].tolist()
    return ResidualBlock(velocities, [(X(j), V(j), S(k)) for j, k in enumerate(bias)], kind="zero_velocity")


def stride_graph(stride: Stride, p: SmootherParameters) -> gtsam.NonlinearFactorGraph:
    """Return all factors of a stride, one by one."""
    graph = gtsam.NonlinearFactorGraph()
    _add_inertial(graph, stride)
    keys = [(X(j), V(j), S(stride.bias)) for j in range(stride.first, stride.last)]
    for factor in ResidualBlock(stride.velocity, keys).factors():
        graph.push_back(factor)
    _add_sensor(graph, stride, p)
    return graph


def _add_inertial(graph: gtsam.NonlinearFactorGraph, stride: Stride) -> None:
    for j, measurement in enumerate(stride.measurements, start=max(stride.first, 1)):
        if isinstance(measurement, UnseenWalk):
            graph.push_back(factor_of(measurement, [X(j - 1), X(j)]))
            continue
        bias = B(stride.bias_before if j == stride.first else stride.bias)
        graph.push_back(gtsam.GalileanImuFactor(X(j - 1), V(j - 1), X(j), V(j), bias, measurement))


def _add_sensor(graph: gtsam.NonlinearFactorGraph, stride: Stride, p: SmootherParameters) -> None:
    """Add the random walk of bias and settling where a new one begins, and the rests."""
    if stride.bias != stride.bias_before:
        walk = np.repeat([ACC_BIAS_WALK, np.radians(max(p.gyro_bias_walk_deg_s, MIN_WALK_DEG_S))], 3)
        noise = gtsam.noiseModel.Diagonal.Sigmas(walk * np.sqrt(stride.bias_age_s))
        no_change = gtsam.imuBias.ConstantBias()
        graph.push_back(gtsam.BetweenFactorConstantBias(B(stride.bias_before), B(stride.bias), no_change, noise))
        change = gtsam.noiseModel.Isotropic.Sigma(1, SETTLING_WALK_M * np.sqrt(stride.bias_age_s))
        graph.push_back(gtsam.BetweenFactorVector(S(stride.bias_before), S(stride.bias), np.zeros(1), change))
    for rest in stride.rests:
        graph.push_back(zero_rate_factor(B(stride.bias), rest.rate, rest.covariance))


def add_start(
    graph: gtsam.NonlinearFactorGraph, gyro_bias_mean: Floats, gyro_bias_sigma: float, p: SmootherParameters
) -> None:
    """Add the priors on the bias and on the excess of the settling."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([ACC_BIAS_SIGMA, gyro_bias_sigma], 3))
    graph.addPriorConstantBias(B(0), gtsam.imuBias.ConstantBias(np.zeros(3), gyro_bias_mean), noise)
    excess = gtsam.noiseModel.Isotropic.Sigma(1, p.settling_sigma_m)
    graph.push_back(gtsam.PriorFactorVector(S(0), np.zeros(1), excess))


def _about_nodes(samples: Floats, stances: Stances, nodes: Nodes, reach: int) -> Floats:
    """Return the mean (M, d) of samples (N, d) within `reach` samples of each node, inside its stance."""
    first = np.maximum(nodes.sample - reach, stances.start[nodes.interval])
    last = np.minimum(nodes.sample + reach + 1, stances.stop[nodes.interval])
    total = np.concatenate([np.zeros((1, samples.shape[1])), np.cumsum(samples, axis=0)])
    return np.asarray((total[last] - total[first]) / (last - first)[:, None])
