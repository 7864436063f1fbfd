"""From samples to strides, and from strides to factors: a walk is its strides, added one after the other.

Variables: pose X and velocity V at each node, and nodes stand in stances only: one at each end and more between, so
that the inertial measurements tie the still middle to the rolling ends, the nearest moved onto the footfall's stillest
sample, where results are given. For the footfalls of ten seconds one bias B and one excess S of the settling of the
sole. A stride is a footfall and the swing that led to it. It adds

* inertial factors from the last node of the footfall before, through all nodes of this one; where samples are missing
  for too long, in place of one what a person can have done (`preintegration`);
* at each node the velocity of the stance (`factors.zero_velocity`), V = R (w x l) + settling - S / (duration of the
  stance) up, with a sigma that grows with how fast the foot turns and how far its specific force is from gravity there;
* where a new bias begins, random-walk factors of B and S from those before;
* for each rest in the footfall, what it shows of the gyro bias.

The sole of one walk settles in all its stances alike, by more or by less than expected, and nothing inertial shows it.
So S is a variable, m: known to its prior, and estimated where floors or fixes show the height (`docs/models.md`).

The first footfall has in place of the swing a prior on the bias, and the gauge: position and heading by definition,
tilt from gravity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, S, V, X

from fg_nav.arrays import Floats, Ints
from fg_nav.detection import Rest
from fg_nav.detection.stance import Stances
from fg_nav.factors.residual import ResidualBlock, factor_of, one_of
from fg_nav.factors.walk_constraints import UnseenWalk
from fg_nav.factors.zero_velocity import StanceVelocity, zero_rate_factor
from fg_nav.recording import Recording
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.preintegration import Measurement
from fg_nav.system.compiled import njit

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


@dataclass(frozen=True)
class Nodes:
    """Nodes of a walk, in order of time.

    ========= ==== ===========================================================
    sample    (M,) index into the recording, ascending
    interval  (M,) stance interval it stands in
    footfall  (M,) footfall it belongs to
    first     (F+1,) first node of each footfall, and M
    result    (F,) node of each footfall at its stillest sample
    bias      (F,) bias variable of each footfall, from 0, never falling
    ========= ==== ===========================================================
    """

    sample: Ints
    interval: Ints
    footfall: Ints
    first: Ints
    result: Ints
    bias: Ints

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
    """What a footfall and the swing before it measured.

    Nodes `first <= j < last`, bias `bias` and before the footfall `bias_before`, begun `bias_age_s` ago;
    `measurements` from each node's predecessor to it (none before the very first); `velocities` of all nodes that were
    measured together, of which its own are the rows `own`.
    """

    first: int
    last: int
    bias: int
    bias_before: int
    bias_age_s: float
    measurements: list[Measurement]
    velocities: StanceVelocity
    own: slice
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
