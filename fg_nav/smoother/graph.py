"""From nodes and strides to the problem that is solved, and from its solution back to the recording's rate.

The problem is factors, initial values, and the prior on the start.

`problem.walk_problem` calls `build_problem` for a whole walk, the evidence of the swing noise for pieces of it.

The initial values are dead reckoning, stopped at every node: strapdown from node to node; at a node the velocity is set
to zero, the position gives back what the linear growth of the velocity error added, and while the foot stands the tilt
is nudged towards gravity. Good to some degrees and per cents, which Gauss-Newton needs no better. Over a hole in the
samples the position stays, and the attitude is turned and levelled as `unseen` says.

Back to the recording's rate (`trajectory_of`) it goes by `dense_path`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, S, V, X

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import Rest
from fg_nav.detection.rolling_lever import RollingLever
from fg_nav.factors.residual import Keys, ResidualBlock, read_variables
from fg_nav.frames import yaw_rotation
from fg_nav.mechanisation import TILT_TIME_S, NavState, nudge_tilt, strapdown
from fg_nav.recording import Recording
from fg_nav.smoother.dense_path import fill_path
from fg_nav.smoother.differential_factors import DifferentialFactors
from fg_nav.smoother.direction_factors import DirectionFactors
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.gauss_newton import CONVERGENCE
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.place_factors import PlaceFactors, postpone
from fg_nav.smoother.preintegration import preintegrate
from fg_nav.smoother.solver import GtsamFactors, LinearizableBlock, Solved, list_in_time, list_poses, minimize
from fg_nav.smoother.strides import (
    Nodes,
    add_start,
    add_stride,
    join_velocities,
    measure_velocities,
    place_nodes,
    strides_of,
)
from fg_nav.smoother.unseen import find_unseen_walks
from fg_nav.stances import Stances
from fg_nav.system.compiled import njit
from fg_nav.system.spilled import drop_pages

if TYPE_CHECKING:
    from fg_nav.smoother.barometer import BarometerFactors

GAUGE_SIGMA = 1e-4  # Position (m) and heading (rad) at the start are known by definition.
LEVELLINGS = 3  # Of an attitude behind a hole, each of which takes a tilt of 45 deg to one of 10.

UNKNOWN_HEADING_DEG = 60.0
"""Sigma of the heading at the start about what the walk's mean field says, where it is not given."""


@dataclass(frozen=True)
class Known:
    """What is known of sensor, mounting and walk before the graph is built.

    Gyro bias (3,) rad/s to start from, mean (3,) and sigma of its prior, rests, lever, how high clipped peaks of the
    rate are above the range, in what their flanks say; and the same in words.
    """

    gyro_bias: Floats
    gyro_bias_mean: Floats
    gyro_bias_sigma: float
    rests: tuple[Rest, ...]
    lever: RollingLever
    peak_height: float = 1.0
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class StartPrior:
    """The gauge: position zero at the first node, this attitude (3, 3); sigmas of its heading, rad, and place, m.

    Of the second of two feet `place` (3,) m is where it is about to begin.
    """

    nav_R_body: Floats
    heading_sigma: float
    place_sigma: float = GAUGE_SIGMA
    place: Sequence[float] | Floats = (0.0, 0.0, 0.0)

    def factor(self, p: SmootherParameters) -> gtsam.PriorFactorPose3:
        """Return it as a prior on the first pose, with the tilt of levelling."""
        pose = gtsam.Pose3(gtsam.Rot3(self.nav_R_body), np.asarray(self.place, dtype=float))
        tilt = np.radians(p.tilt_sigma_deg)
        nav_rotation = np.diag([tilt, tilt, self.heading_sigma]) ** 2
        covariance = np.eye(6) * self.place_sigma**2
        covariance[:3, :3] = self.nav_R_body.T @ nav_rotation @ self.nav_R_body
        return gtsam.PriorFactorPose3(X(0), pose, gtsam.noiseModel.Gaussian.Covariance(covariance))


@dataclass(frozen=True)
class WalkProblem:
    """A walk as a graph, before it is solved.

    Attributes
    ----------
    recording, nodes, known, parameters : of the walk; with swing noise and bias walk that were chosen.
    heading_known : whether the heading at the start was given, or fixes show it.
    start : prior on the first pose.
    graph : inertial factors, and those on biases and settling.
    velocities : of the stances.
    constraints : factors of fixes and floors, and the caller's own.
    floor : (F,) floor of each footfall, -1 on none; None where they were not looked for.
    field : factors of the magnetic field, where it is used.
    differential : those of the differential field on the gyro bias, where the magnetometer is used.
    places : of footfalls at places that were recognized, where there are any.
    directions : of courses along the directions of a building, where they are used.
    barometer : factors of the air pressure, where it is used.
    values : of all variables, to start from.
    """

    recording: Recording
    nodes: Nodes
    known: Known
    parameters: SmootherParameters
    heading_known: bool
    start: StartPrior
    graph: gtsam.NonlinearFactorGraph
    velocities: ResidualBlock
    values: gtsam.Values
    constraints: tuple[LinearizableBlock, ...] = ()
    floor: Ints | None = None
    field: FieldFactors | None = None
    differential: DifferentialFactors | None = None
    places: PlaceFactors | None = None
    directions: DirectionFactors | None = None
    barometer: BarometerFactors | None = None

    @property
    def blocks(self) -> tuple[LinearizableBlock, ...]:
        """What is linearized next to the graph."""
        magnetic = (block for block in (self.field, self.differential, self.places) if block is not None)
        of_building = () if self.directions is None else self.directions.blocks
        air = () if self.barometer is None else self.barometer.blocks
        start = GtsamFactors(self.start.factor(self.parameters))
        return (self.velocities, start, *magnetic, *of_building, *air, *self.constraints)

    @property
    def alphas(self) -> int:
        """How many directions of a building are variables."""
        return 0 if self.directions is None else self.directions.pieces

    def factors(self) -> gtsam.NonlinearFactorGraph:
        """Return all of it as factors of gtsam, one by one."""
        graph = gtsam.NonlinearFactorGraph(self.graph)
        for block in self.blocks:
            for factor in block.factors():
                graph.push_back(factor)
        return graph


def solve(problem: WalkProblem, convergence: float = CONVERGENCE) -> Solved:
    """Minimize the error of a walk, to this difference of promised and true error per variable."""
    return solve_and_keep(problem, convergence).forget_stacks()


def solve_and_keep(problem: WalkProblem, convergence: float) -> Solved:
    """Minimize as `solve` does, and keep the factors of the last linearization, which are larger than all else."""
    return minimize(problem.graph, problem.blocks, problem.values, order_variables(problem), convergence)


def order_variables(problem: WalkProblem) -> Keys:
    """Keys of all variables in the order in which they are eliminated."""
    with_field, with_air = problem.field is not None, problem.barometer is not None
    keys = list_in_time(problem.nodes, with_field, problem.floor, problem.alphas, with_air)
    return keys if problem.places is None else postpone(keys, problem.nodes, problem.places.footfalls)


def build_problem(
    recording: Recording,
    stances: Stances,
    nav_R_body: Floats,
    known: Known,
    p: SmootherParameters,
    heading_known: bool = True,
    progress: Callable[[float], None] | None = None,
) -> WalkProblem:
    """Turn a walk that starts in this attitude (3, 3) into nodes, factors and initial values."""
    nodes = place_nodes(recording, stances, p)
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), known.gyro_bias)
    measurements = preintegrate(recording, nodes.sample, bias, p, progress)
    velocities = measure_velocities(recording, stances, nodes, known.gyro_bias, known.lever.lever, p)
    graph = gtsam.NonlinearFactorGraph()
    add_start(graph, known.gyro_bias_mean, known.gyro_bias_sigma, p)
    for stride in strides_of(recording, nodes, measurements, velocities, known.rests):
        add_stride(graph, stride, p)
    drop_pages()
    return WalkProblem(
        recording,
        nodes,
        known,
        p,
        heading_known,
        StartPrior(nav_R_body, GAUGE_SIGMA),
        graph,
        join_velocities(velocities, nodes),
        initial_values(recording, stances, nodes, nav_R_body, known.gyro_bias, p.gravity),
    )


def initial_values(
    recording: Recording,
    stances: Stances,
    nodes: Nodes,
    nav_R_body: Floats,
    gyro_bias: Floats,
    gravity: float,
) -> gtsam.Values:
    """Values of all variables; `nav_R_body` (3, 3) is the attitude at the first node."""
    unseen = find_unseen_walks(recording, nodes.sample)
    position, attitude = _stop_and_go(
        unseen.unseen,
        unseen.walk.turn,
        unseen.body_up,
        recording.t,
        *recording.integrable,
        stances.mask,
        nodes.sample,
        nav_R_body,
        gyro_bias,
        gravity,
    )
    values, pose = gtsam.Values(), np.tile(np.eye(4), (len(nodes), 1, 1))
    pose[:, :3, :3], pose[:, :3, 3], rest = attitude, position, np.zeros(3)
    for j, one in enumerate(pose):
        values.insert(X(j), gtsam.Pose3(one))
        values.insert(V(j), rest)
    bias = gtsam.imuBias.ConstantBias(rest, gyro_bias)
    for k in range(nodes.bias[-1] + 1):
        values.insert(B(k), bias)
        values.insert(S(k), np.zeros(1))
    return values


def turn_walk(values: gtsam.Values, nodes: Nodes, angle: float | Floats) -> None:
    """Turn poses and velocities of a walk about up by an angle, (M,) rad of each node, counter-clockwise, in place.

    The way from the origin to the first node is turned as that node, and each move as the node that it leads to.
    """
    number, turn = range(len(nodes)), yaw_rotation(np.broadcast_to(angle, len(nodes)))
    pose, velocity = list_poses(number, values), read_variables(values, [V(j) for j in number], 3)
    moves = np.diff(pose[:, :3, 3], axis=0, prepend=np.zeros((1, 3)))
    turned, velocity = np.tile(np.eye(4), (len(nodes), 1, 1)), (turn @ velocity[..., None])[..., 0]
    turned[:, :3, :3] = turn @ pose[:, :3, :3]
    turned[:, :3, 3] = np.cumsum((turn @ moves[..., None])[..., 0], axis=0)
    for j in number:
        values.update(X(j), gtsam.Pose3(turned[j]))
        values.update(V(j), velocity[j])


@njit(cache=True)
def _stop_and_go(
    unseen: Bools,
    turned: Floats,
    body_up: Floats,
    t: Floats,
    acc: Floats,
    gyr: Floats,
    stands: Bools,
    sample: Ints,
    nav_R_body: Floats,
    gyro_bias: Floats,
    gravity: float,
) -> tuple[Floats, Floats]:
    """Position (M, 3) and attitude (M, 3, 3) at the nodes."""
    position, attitude = np.zeros((len(sample), 3)), np.empty((len(sample), 3, 3))
    velocity, acc_bias, turn, push = np.zeros(3), np.zeros(3), np.empty((3, 3)), np.empty(3)
    for row in range(3):
        for axis in range(3):
            attitude[0, row, axis] = nav_R_body[row, axis]
    for j in range(1, len(sample)):
        p, R = position[j], attitude[j]
        for row in range(3):
            p[row] = position[j - 1, row]
            for axis in range(3):
                R[row, axis] = attitude[j - 1, row, axis]
        if unseen[j - 1]:
            c, s = np.cos(turned[j - 1]), np.sin(turned[j - 1])
            for axis in range(3):
                R[0, axis], R[1, axis] = c * R[0, axis] - s * R[1, axis], s * R[0, axis] + c * R[1, axis]
            for _ in range(LEVELLINGS):
                nudge_tilt(R, body_up[j - 1], 1.0)
            continue
        state = NavState(p, velocity, R, gyro_bias, acc_bias)
        for i in range(sample[j - 1], sample[j]):
            h = t[i + 1] - t[i]
            strapdown(state, acc[i], gyr[i], h, gravity, turn, push)
            if stands[i]:
                nudge_tilt(R, acc[i], min(h / TILT_TIME_S, 1.0))
        half = 0.5 * (t[sample[j]] - t[sample[j - 1]])
        for row in range(3):
            p[row] -= velocity[row] * half
            velocity[row] = 0.0
    return position, attitude


class Trajectory(NamedTuple):
    """Position (N, 3) m, velocity (N, 3) m/s and attitude (N, 3, 3) at every sample."""

    position: Floats
    velocity: Floats
    nav_R_body: Floats


def trajectory_of(recording: Recording, nodes: Nodes, values: gtsam.Values, gravity: float) -> Trajectory:
    """Return the trajectory of a solved walk at the recording's rate."""
    return prepare_trajectory(recording, nodes, values, gravity)()


def prepare_trajectory(
    recording: Recording, nodes: Nodes, values: gtsam.Values, gravity: float
) -> Callable[[], Trajectory]:
    """Return what makes the trajectory, of arrays alone, so that the graph can be let go of before."""
    poses = list_poses(range(len(nodes)), values)
    bias = biases_of(nodes, values)[nodes.bias[nodes.footfall]]
    return partial(
        dense_trajectory,
        recording,
        nodes.sample,
        poses[:, :3, 3].copy(),
        read_variables(values, [V(j) for j in range(len(nodes))], 3),
        poses[:, :3, :3].copy(),
        np.ascontiguousarray(bias[:, 3:]),
        np.ascontiguousarray(bias[:, :3]),
        gravity,
    )


def biases_of(nodes: Nodes, values: gtsam.Values) -> Floats:
    """Return the bias variables (K, 6) of a walk: accelerometer m/s^2, gyroscope rad/s."""
    return np.array([values.atConstantBias(B(k)).vector() for k in range(int(nodes.bias[-1]) + 1)])


def dense_trajectory(
    recording: Recording,
    sample: Ints,
    position: Floats,
    velocity: Floats,
    nav_R_body: Floats,
    gyro_bias: Floats,
    acc_bias: Floats,
    gravity: float,
) -> Trajectory:
    """Return the trajectory at every sample, from states at nodes `sample` (M,)."""
    h = np.append(np.diff(recording.t), recording.period_s)
    acc, gyr = recording.integrable
    return Trajectory(*fill_path(h, acc, gyr, sample, position, velocity, nav_R_body, gyro_bias, acc_bias, gravity))
