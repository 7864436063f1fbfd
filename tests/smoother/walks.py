"""Walks to smooth, simulated and real, and their graphs before they are solved."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from fg_nav.arrays import Floats, Ints
from fg_nav.detection import detect_stances, find_rests
from fg_nav.detection.rest import estimate_lever
from fg_nav.detection.stance import Stances
from fg_nav.factors import guarded_factor
from fg_nav.factors.residual import Keys, ResidualBlock, one_of
from fg_nav.factors.zero_velocity import StanceVelocity
from fg_nav.frames import level_attitude
from fg_nav.io import read
from fg_nav.lab.pyshoe import read_pyshoe_labels
from fg_nav.lab.simulation.person import Person
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.graph import GAUGE_SIGMA, StartPrior, Trajectory, WalkProblem, initial_values, trajectory_of
from fg_nav.smoother.parameters import WalkParameters
from fg_nav.smoother.solver import CONVERGENCE, MAX_STEPS, Solved, WalkSystem, find_minimum, list_in_time
from fg_nav.smoother.strides import (
    Nodes,
    Stride,
    add_start,
    add_stride,
    join_velocities,
    measure_velocities,
    place_nodes,
    preintegrate,
    strides_of,
)
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth
from tests.real_data import DATA
from tests.simulated import IDEAL, QUIET, corridor

DEFAULT = SmootherParameters()

FREE = replace(DEFAULT, walk=WalkParameters(floors=False))
"""Without level floors: the height by the foot alone, as online."""


def time_order(
    nodes: Nodes, with_field: bool = False, floor: Ints | None = None, directions: int = 0, with_air: bool = False
) -> gtsam.Ordering:
    """Order in which the variables are eliminated, as `list_in_time`, for gtsam."""
    ordering = gtsam.Ordering()
    for key in list_in_time(nodes, with_field, floor, directions, with_air).tolist():
        ordering.push_back(key)
    return ordering


def list_keys(ordering: gtsam.Ordering) -> Keys:
    """List the keys of an ordering."""
    return np.array([ordering.at(i) for i in range(ordering.size())], dtype=np.uint64)


@dataclass(frozen=True)
class Walk:
    recording: Recording
    stances: Stances


@cache
def demo(seed: int = 0, rate_hz: float = 200.0) -> Walk:
    """A minute round a corridor: biased, noisy samples of a foot with a soft sole."""
    return _detected(corridor(seed=seed, rate_hz=rate_hz).recording)


@cache
def smoothed(seed: int = 0, p: SmootherParameters = DEFAULT, rate_hz: float = 200.0) -> Solution:
    """The demonstration, smoothed by its strides alone."""
    walk = demo(seed, rate_hz)
    return smooth(walk.recording, walk.stances, p)


def truth_of(recording: Recording) -> TrajectoryTruth:
    """The truth of a recording, which has attitudes."""
    assert isinstance(recording.truth, TrajectoryTruth)
    assert recording.truth.nav_R_body is not None
    return recording.truth


def values_moved(values: gtsam.Values, size: float, seed: int = 0) -> gtsam.Values:
    """Values with every variable a random step away."""
    rng, step = np.random.default_rng(seed), gtsam.VectorValues()
    for key, width in values.dims().items():
        step.insert(key, size * rng.standard_normal(width))
    return values.retract(step)


def dense_root(system: WalkProblem, values: gtsam.Values, ordering: gtsam.Ordering) -> tuple[Floats, Floats, Floats]:
    """Jacobian A and right-hand side b of a whole graph, and the inverse root of A^T A, by dense linear algebra."""
    A, b = system.factors().linearize(values).jacobian(ordering)
    # Columns of one size, as poses, velocities and biases are of many.
    size = np.linalg.norm(A, axis=0)
    return A, b, np.linalg.inv(np.linalg.qr(A / size, mode="r")) / size[:, None]


def dense_log_evidence(system: WalkProblem, values: gtsam.Values) -> float:
    """Of a graph linearized at values: E + 1/2 log|A^T A| without the logarithms of its sigmas."""
    A, b, inverse_root = dense_root(system, values, time_order(system.nodes))
    explained = b @ (A @ (inverse_root @ (inverse_root.T @ (A.T @ b))))
    return float(0.5 * (b @ b - explained) - np.linalg.slogdet(inverse_root)[1])


@cache
def noise_free(person: Person = QUIET, seed: int = 0, rate_hz: float = 200.0) -> Walk:
    """The same walk as a perfect sensor has it."""
    return _detected(corridor(person, sensor=IDEAL, seed=seed, rate_hz=rate_hz).recording)


@cache
def vicon(trial: str) -> Walk:
    """A trial with motion capture; the stances are the authors' labels."""
    path = DATA / "vicon" / f"{trial}.mat"
    return Walk(read(path), Stances.from_mask(read_pyshoe_labels(path)))


@cache
def gdin(number: int) -> Walk:
    """An indoor walk with surveyed footprints."""
    folder = "own" if number > 29 else "own_obsolete"
    return _detected(read(DATA / "gdin" / folder / f"SensorConnectData_{number}.csv"))


@cache
def openshoe(number: int) -> Walk:
    """A loop of 78 m that ends where it began."""
    return _detected(read(DATA / "openshoe" / f"data_inert{number}.txt"))


def _detected(recording: Recording) -> Walk:
    recording = replace(recording, mag=None)
    return Walk(recording, detect_stances(recording))


def part(walk: Walk, footfalls: int) -> Walk:
    """The beginning of a walk, up to the middle of the swing after these footfalls."""
    s = walk.stances
    last = int(np.flatnonzero(s.footfall < footfalls)[-1])
    stop = int(s.stop[last] + s.start[last + 1]) // 2
    few = slice(0, last + 1)
    statistic = None if s.statistic is None else s.statistic[:stop]
    stances = replace(
        s, start=s.start[few], stop=s.stop[few], footfall=s.footfall[few], n_samples=stop, statistic=statistic
    )
    return Walk(walk.recording.slice(0, stop), stances)


@dataclass(frozen=True)
class Problem:
    """A walk's graph, the velocities of its stances, and where its solution starts."""

    nodes: Nodes
    strides: list[Stride]
    graph: gtsam.NonlinearFactorGraph
    velocities: ResidualBlock
    initial: gtsam.Values
    ordering: gtsam.Ordering


def problem(walk: Walk, p: SmootherParameters = DEFAULT) -> Problem:
    """Build the graph of a walk from the smoother's own parts, in its own order."""
    recording, stances = walk.recording, walk.stances
    rests = find_rests(recording, p.rest)
    bias = np.mean([rest.rate for rest in rests], axis=0) if rests else np.zeros(3)
    lever = estimate_lever(recording, stances).lever if p.known_lever is None else np.array(p.known_lever)
    nodes = place_nodes(recording, stances, p)
    start = level_attitude(recording.acc[stances.start[0] : stances.stop[0]].mean(axis=0))
    measurements = preintegrate(recording, nodes.sample, gtsam.imuBias.ConstantBias(np.zeros(3), bias), p)
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(StartPrior(start, GAUGE_SIGMA).factor(p))
    add_start(graph, np.radians(p.gyro_bias_deg_s), np.radians(p.gyro_bias_sigma_deg_s), p)
    velocities = measure_velocities(recording, stances, nodes, bias, lever, p)
    strides = list(strides_of(recording, nodes, measurements, velocities, rests))
    for stride in strides:
        add_stride(graph, stride, p)
    initial = initial_values(recording, stances, nodes, start, bias, p.gravity)
    return Problem(nodes, strides, graph, join_velocities(velocities, nodes), initial, time_order(nodes))


def rolling_stance_factor(keys: Sequence[int], one: StanceVelocity) -> gtsam.CustomFactor:
    """The velocity of a stance in navigation axes, as it is written in the books: e = V - R u - settling + s S up."""

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
        R = values.atPose3(keys[0]).rotation().matrix()
        sinks = np.array([[0.0], [0.0], [float(one.sinks_per_m)]])
        e = values.atVector(keys[1]) - R @ one.body_velocity - one.settling + sinks @ values.atVector(keys[2])
        by_turn = R @ np.stack([np.cross(one.body_velocity, axis) for axis in np.eye(3)], axis=-1)
        return e, [np.hstack([by_turn, np.zeros((3, 3))]), np.eye(3), sinks] if with_jacobians else []

    noise = gtsam.noiseModel.Diagonal.Sigmas(one.sigma)
    return guarded_factor("rolling stance", list(keys), [6, 3, 1], noise, residual)


def with_exact_factors(walk: Walk) -> Problem:
    """The graph of the same strides, the velocities of their stances in navigation axes."""
    one = problem(walk)
    velocities = one.velocities.residuals
    assert isinstance(velocities, StanceVelocity)
    for k, keys in enumerate(one.velocities.keys):
        one.graph.push_back(rolling_stance_factor(keys, one_of(velocities, k)))
    return replace(one, velocities=ResidualBlock(velocities, []))


def minimum(one: Problem, convergence: float = CONVERGENCE) -> Solved:
    """Solve a problem as the smoother does."""
    system = WalkSystem(one.graph, [one.velocities])
    return find_minimum(system, one.initial, list_keys(one.ordering), convergence, MAX_STEPS)


def node_arrays(nodes: Nodes, values: gtsam.Values) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Position, velocity (M, 3), attitude (M, 3, 3), gyro and accelerometer bias (M, 3) at the nodes."""
    poses = [values.atPose3(X(j)) for j in range(len(nodes))]
    bias = np.array([values.atConstantBias(B(int(k))).vector() for k in nodes.bias[nodes.footfall]])
    return (
        np.array([pose.translation() for pose in poses]),
        np.array([values.atVector(V(j)) for j in range(len(nodes))]),
        np.array([pose.rotation().matrix() for pose in poses]),
        np.ascontiguousarray(bias[:, 3:]),
        np.ascontiguousarray(bias[:, :3]),
    )


def degrees_between(R: Floats, Q: Floats) -> Floats:
    """Angles (M,) between attitudes (M, 3, 3)."""
    turn = np.einsum("nji,njk->nik", R, Q)
    axis = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1)
    return np.degrees(np.arctan2(np.linalg.norm(axis, axis=1) / 2, (np.trace(turn, axis1=1, axis2=2) - 1) / 2))


def track_of(problem: WalkProblem, values: gtsam.Values | None = None) -> Trajectory:
    """Trajectory of a walk at these values, or at those of the problem."""
    at = problem.values if values is None else values
    return trajectory_of(problem.recording, problem.nodes, at, problem.parameters.gravity)
