"""From nodes and strides to the problem that is solved, and from its solution back to the recording's rate.

Initial values are dead reckoning, stopped at every node: the velocity is set to zero, the position gives back what the
linear growth of the velocity error added, and while the foot stands the tilt is nudged towards gravity. Over a hole in
the samples the position stays, and the attitude is turned and levelled as in `strides`.

The dense path. Between two nodes of the solution the samples are integrated from the first one with its bias. What is
left at the second, a rotation d_R, a velocity d_v and a position d_p, is given back smoothly over the interval of
length T, with s in [0, 1]:

    R(s) Exp(a d_R),  a = 3 s^2 - 2 s^3;      p(s) + a d_p + b T d_v,  b = s^3 - s^2;      v(s) its derivative.

Before the first node and after the last, and on both sides of a hole, the samples are integrated, backward and forward.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeVar

import gtsam
import numpy as np
from gtsam.symbol_shorthand import A, B, M, P, S, V, X

from fg_nav.arrays import Bools, Brief, Floats, Ints
from fg_nav.detection import Rest
from fg_nav.detection.rest import RollingLever
from fg_nav.detection.stance import Stances
from fg_nav.factors.magnetic_field import FieldPrior
from fg_nav.factors.residual import LETTER_SHIFT, Keys, ResidualBlock, read_variables
from fg_nav.factors.walk_constraints import UnseenWalk
from fg_nav.factors.zero_velocity import ZeroRate
from fg_nav.frames import yaw_rotation
from fg_nav.mechanisation import (
    TILT_TIME_S,
    NavState,
    nudge_tilt,
    rotate_in_body,
    rotation_vector,
    strapdown,
    write_state,
)
from fg_nav.recording import Recording
from fg_nav.samples.gaps import MAX_HELD_S
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import (
    CONVERGENCE,
    BlockGroup,
    GtsamFactors,
    LinearizableBlock,
    Solved,
    WalkSystem,
    find_minimum,
    list_biases,
    list_in_time,
    list_poses,
    split_tied,
)
from fg_nav.smoother.strides import (
    INERTIAL_KEYS,
    Nodes,
    add_start,
    add_stride,
    find_unseen_walks,
    join_velocities,
    measure_velocities,
    place_nodes,
    preintegrate,
    strides_of,
)
from fg_nav.system.compiled import njit

GAUGE_SIGMA = 1e-4  # Position (m) and heading (rad) at the start are known by definition.
LEVELLINGS = 3  # Of an attitude behind a hole, each of which takes a tilt of 45 deg to one of 10.
UNKNOWN_HEADING_DEG = 60.0  # Sigma of a heading that is not given, about the direction of the walk's mean field.
KINDS = ("imu", "zero_velocity", "magnetic_heading", "differential_field", "field_potential", "gated_out")
"""As in `summary.json`; `gated_out` are the footfalls with a field whose compass a hard gate left out."""

POSITION_FIX, KNOWN_PLACE, OWN, BAROMETER = "position_fix", "known_place", "own", "barometer"
FURTHER_KINDS = ("same_place", "direction", BAROMETER, POSITION_FIX, KNOWN_PLACE, OWN)  # Where there are any.

KIND_OF_KEYS = {
    "xvxvb": "imu",
    "xvs": "zero_velocity",
    "xm": "magnetic_heading",
    "xmm": "field_potential",
    "b": "differential_field",
    "xp": BAROMETER,
}
"""By the letters of the variables that a factor joins. No other factor joins the same, but priors a bias."""

NAME_OF_KEYS = {"b": ZeroRate.name, "xx": UnseenWalk.name, "m": FieldPrior.name}
"""Likewise, of factors in Python that are in no block of their kind."""

K = TypeVar("K", bound=LinearizableBlock)


@dataclass(frozen=True)
class Known:
    """What is known of sensor, mounting and walk before the graph is built, and the same in words."""

    gyro_bias: Floats  # (3,) rad/s to start from.
    gyro_bias_mean: Floats  # (3,) rad/s, of its prior.
    gyro_bias_sigma: float
    rests: tuple[Rest, ...]
    lever: RollingLever
    peak_height: float = 1.0  # Of clipped peaks of the rate above the range, over what their flanks show.
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class StartPrior:
    """The gauge: position and attitude at the first node."""

    nav_R_body: Floats  # (3, 3).
    heading_sigma: float  # rad.
    place_sigma: float | tuple[float, ...] = GAUGE_SIGMA  # m, also of each axis.
    place: Sequence[float] | Floats = (0.0, 0.0, 0.0)  # m, of the second of two feet where it is about to begin.

    def factor(self, p: SmootherParameters) -> gtsam.PriorFactorPose3:
        """Return it as a prior on the first pose, with the tilt of levelling."""
        pose = gtsam.Pose3(gtsam.Rot3(self.nav_R_body), np.asarray(self.place, dtype=float))
        tilt = np.radians(p.tilt_sigma_deg)
        nav_rotation = np.diag([tilt, tilt, self.heading_sigma]) ** 2
        covariance, R = np.zeros((6, 6)), self.nav_R_body
        covariance[:3, :3] = R.T @ nav_rotation @ R
        covariance[3:, 3:] = R.T @ np.diag(np.square(np.broadcast_to(self.place_sigma, 3))) @ R
        return gtsam.PriorFactorPose3(X(0), pose, gtsam.noiseModel.Gaussian.Covariance(covariance))


@dataclass(frozen=True)
class WalkProblem(Brief):
    """A walk as a graph, before it is solved."""

    recording: Recording
    nodes: Nodes
    known: Known
    parameters: SmootherParameters  # With swing noise and bias walk that were chosen.
    heading_known: bool  # Whether the heading at the start was given, or fixes show it.
    start: StartPrior
    graph: gtsam.NonlinearFactorGraph  # Inertial factors, and those on biases and settling.
    velocities: ResidualBlock  # Of the stances.
    values: gtsam.Values  # Of all variables, to start from.
    blocks: tuple[LinearizableBlock, ...] = ()  # Of all that joins the first solution, linearized beside the graph.
    floor: Ints | None = None  # (F,) of each footfall, -1 on none; None where they were not searched.
    tied: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # Footfalls (n,) at recognized places.

    @property
    def system(self) -> WalkSystem:
        """Return all factors as the system that is minimized."""
        start = GtsamFactors(self.start.factor(self.parameters))
        return WalkSystem(self.graph, (self.velocities, start, *self.blocks))

    def find(self, kind: type[K]) -> K | None:
        """Return the block of a class, None without one."""
        return next((block for block in self.blocks if isinstance(block, kind)), None)

    def get(self, kind: type[K]) -> K:
        """Return the block of a class, which the walk has."""
        return next(block for block in self.blocks if isinstance(block, kind))

    def join(self, block: LinearizableBlock) -> WalkProblem:
        """Return it with another block."""
        return replace(self, blocks=(*self.blocks, block))

    def without(self, kind: type[LinearizableBlock]) -> WalkProblem:
        """Return it without the block of a class."""
        return replace(self, blocks=tuple(block for block in self.blocks if not isinstance(block, kind)))

    def with_note(self, note: str) -> WalkProblem:
        """Return it with another note."""
        return replace(self, known=replace(self.known, notes=(*self.known.notes, note)))

    @property
    def time_order(self) -> Keys:
        """Keys of all variables, node by node (`solver.list_in_time`)."""
        has, directions = self.values.exists, 0
        while has(A(directions)):
            directions += 1
        return list_in_time(self.nodes, has(M(0)), self.floor, directions, has(P(0)))

    def factors(self) -> gtsam.NonlinearFactorGraph:
        """Return all of it as factors of gtsam, one by one."""
        graph = gtsam.NonlinearFactorGraph(self.graph)
        for block in self.system.blocks:
            for factor in block.factors():
                graph.push_back(factor)
        return graph

    def name_factors(self) -> Iterator[tuple[str, str]]:
        """Yield the kind, "" of what is not counted, and the name of each of the `factors`, in their order."""
        blocks: list[LinearizableBlock] = [GtsamFactors(*map(self.graph.at, range(self.graph.size())))]
        blocks += self.system.blocks
        while blocks:
            block = blocks.pop(0)
            if isinstance(block, BlockGroup):
                blocks = [*block.blocks, *blocks]
                continue
            kind, named = next(iter(block.counts), ""), block.residuals.name if isinstance(block, ResidualBlock) else ""
            for one in block.factors():
                ours = NAME_OF_KEYS.get(join_letters(one.keys())) if isinstance(one, gtsam.CustomFactor) else None
                name = named or (ours if ours and not kind else type(one).__name__)
                yield kind or ("imu" if one.size() == INERTIAL_KEYS else ""), name


def solve(problem: WalkProblem, convergence: float = CONVERGENCE, with_stacks: bool = False) -> Solved:
    """Minimize the error of a walk, to this difference of promised and true error per variable.

    `with_stacks` keeps the linear factors, as large as the triangle.
    """
    found = find_minimum(problem.system, problem.values, order_variables(problem), convergence)
    return found if with_stacks else replace(found, stacks=())


def order_variables(problem: WalkProblem) -> Keys:
    """Return the keys of all variables in elimination order, chosen for small fronts."""
    keys = problem.time_order
    if not len(problem.tied):
        return keys
    # In the order of time every front between two footfalls at one place would carry the later one. So tied footfalls,
    # with all that joins their past to their future, are last, the newest first: what is between is a chain by itself.
    # Floors and the direction of a building, which join many, end the order.
    is_last, is_common = split_tied(keys, problem.nodes, problem.tied)
    return np.concatenate([keys[~is_last & ~is_common], keys[is_last][::-1], keys[is_common]])


def build_problem(
    recording: Recording,
    stances: Stances,
    nav_R_body: Floats,
    known: Known,
    p: SmootherParameters,
    heading_known: bool = True,
    progress: Callable[[float], None] | None = None,
) -> WalkProblem:
    """Build nodes, inertial and stance factors and initial values; `nav_R_body` (3, 3) is the attitude at the start."""
    nodes = place_nodes(recording, stances, p)
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), known.gyro_bias)
    measurements = preintegrate(recording, nodes.sample, bias, p, progress)
    velocities = measure_velocities(recording, stances, nodes, known.gyro_bias, known.lever.lever, p)
    graph = gtsam.NonlinearFactorGraph()
    add_start(graph, known.gyro_bias_mean, known.gyro_bias_sigma, p)
    for stride in strides_of(recording, nodes, measurements, velocities, known.rests):
        add_stride(graph, stride, p)
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
    recording: Recording, stances: Stances, nodes: Nodes, nav_R_body: Floats, gyro_bias: Floats, gravity: float
) -> gtsam.Values:
    """Return initial values by dead reckoning, velocity zeroed at each node; `nav_R_body` (3, 3) at the first."""
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
    """Return position (M, 3) m and attitude (M, 3, 3) at the nodes: strapdown from rest to rest, levelled in stance."""
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


def count_factors(problem: WalkProblem) -> Counter[str]:
    """Count the factors of a walk by kind."""
    counts = Counter(dict.fromkeys(KINDS, 0))
    counts["imu"] = sum(problem.graph.at(i).size() == INERTIAL_KEYS for i in range(problem.graph.size()))
    for block in (problem.velocities, *problem.blocks):
        counts.update(block.counts)
    return Counter({kind: counts[kind] for kind in (*KINDS, *FURTHER_KINDS) if kind in counts})


def join_letters(keys: Sequence[int]) -> str:
    """Return the letters of variables."""
    return "".join(chr(key >> LETTER_SHIFT) for key in keys)


def count_graph(graph: gtsam.NonlinearFactorGraph) -> Counter[str]:
    """Count the factors of gtsam by kind: as `count_factors` does those of the motion and of the field."""
    counts = Counter[str]()
    for factor in map(graph.at, range(graph.size())):
        keys = factor.keys()
        letters = join_letters(keys)
        is_prior = letters == "b" and not isinstance(factor, gtsam.LinearContainerFactor)
        if letters in KIND_OF_KEYS and not is_prior:
            counts[KIND_OF_KEYS[letters]] += 1
    return counts


class Trajectory(NamedTuple):
    """Position (N, 3) m, velocity (N, 3) m/s and attitude (N, 3, 3) at every sample."""

    position: Floats
    velocity: Floats
    nav_R_body: Floats


def trajectory_of(recording: Recording, nodes: Nodes, values: gtsam.Values, gravity: float) -> Trajectory:
    """Return the trajectory of a solved walk at the recording's rate."""
    poses = list_poses(range(len(nodes)), values)
    bias = list_biases(nodes, values)[nodes.bias[nodes.footfall]]
    return dense_trajectory(
        recording,
        nodes.sample,
        poses[:, :3, 3].copy(),
        read_variables(values, [V(j) for j in range(len(nodes))], 3),
        poses[:, :3, :3].copy(),
        np.ascontiguousarray(bias[:, 3:]),
        np.ascontiguousarray(bias[:, :3]),
        gravity,
    )


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
    """Return the trajectory at every sample, strapdown between the states (M, ...) at nodes `sample` (M,).

    Position in m, velocity in m/s, gyro bias in rad/s, accelerometer bias in m/s^2.
    """
    samples = _HeldSamples(recording.periods_s, *recording.integrable)
    nodes, n = NavState(position, velocity, nav_R_body, gyro_bias, acc_bias), len(recording)
    path = Trajectory(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3)))
    _fill(samples, sample, nodes, gravity, path)
    return path


class _HeldSamples(NamedTuple):
    """Time `h` (N,) s for which each is held, specific force `acc` and rate `gyr` (N, 3)."""

    h: Floats
    acc: Floats
    gyr: Floats


@njit(cache=True)
def _fill(samples: _HeldSamples, sample: Ints, nodes: NavState, gravity: float, path: Trajectory) -> None:
    """Write `path` from each node to the next; `nodes` are the solved states (M, ...)."""
    p, v, R = path
    h, position, velocity, nav_R_body = samples.h, nodes.position, nodes.velocity, nodes.nav_R_body
    m = len(sample)
    for j in range(m):
        if j == 0:
            write_state(position[j], velocity[j], nav_R_body[j], p, v, R, sample[j])
            _integrate(samples, sample[j], j, nodes.gyro_bias[j], nodes.acc_bias[j], gravity, path)  # to the very first
        end = sample[j + 1] if j + 1 < m else len(h) - 1
        before = _find_hole(h, sample[j], end) if j + 1 < m else end
        write_state(position[j], velocity[j], nav_R_body[j], p, v, R, sample[j])
        _integrate(samples, sample[j], before, nodes.gyro_bias[j], nodes.acc_bias[j], gravity, path)
        if before < end:
            behind = _find_hole(h, end - 1, sample[j] - 1) + 1
            write_state(position[j + 1], velocity[j + 1], nav_R_body[j + 1], p, v, R, end)
            _integrate(samples, end, behind, nodes.gyro_bias[j], nodes.acc_bias[j], gravity, path)
            _join(h, before, behind, path)
        elif j + 1 < m:
            _meet(h, sample[j], end, position[j + 1], velocity[j + 1], nav_R_body[j + 1], path)
            write_state(position[j + 1], velocity[j + 1], nav_R_body[j + 1], p, v, R, end)


@njit(cache=True)
def _find_hole(h: Floats, first: int, last: int) -> int:
    """Return the first sample from `first` towards `last` that is held over a gap; `last` if there is none."""
    i, way = first, 1 if last > first else -1
    while i != last and h[i] <= MAX_HELD_S:
        i += way
    return i


@njit(cache=True)
def _join(h: Floats, before: int, behind: int, path: Trajectory) -> None:
    """Write `path` between samples `before` and `behind` of a gap: a straight line, attitude held from `before`."""
    p, v, R = path
    duration, elapsed = 0.0, 0.0
    for i in range(before, behind):
        duration += h[i]
    for i in range(before + 1, behind):
        elapsed += h[i - 1]
        write_state(p[before], v[before], R[before], p, v, R, i)
        for k in range(3):
            move = p[behind, k] - p[before, k]
            p[i, k] += move * (elapsed / duration)
            v[i, k] = move / duration


@njit(cache=True)
def _integrate(
    samples: _HeldSamples, first: int, last: int, gyro_bias: Floats, acc_bias: Floats, gravity: float, path: Trajectory
) -> None:
    """Write `path` by strapdown from its state at sample `first` to `last` inclusive, forward or backward."""
    p, v, R = path
    turn, push = np.empty((3, 3)), np.empty(3)
    state = NavState(p[first].copy(), v[first].copy(), R[first].copy(), gyro_bias, acc_bias)
    way = 1 if last > first else -1
    for i in range(first, last, way):
        held = min(i, i + way)  # a sample holds from its stamp to the next
        strapdown(state, samples.acc[held], samples.gyr[held], way * samples.h[held], gravity, turn, push)
        write_state(state.position, state.velocity, state.nav_R_body, p, v, R, i + way)


@njit(cache=True)
def _meet(
    h: Floats, first: int, last: int, position: Floats, velocity: Floats, nav_R_body: Floats, path: Trajectory
) -> None:
    """Spread the mismatch at sample `last` over `path` since `first`, so that it ends in the solved state."""
    p, v, R = path
    duration, elapsed = 0.0, 0.0
    for i in range(first, last):
        duration += h[i]
    left = np.zeros((3, 3))  # R_last^T nav_R_body
    for row in range(3):
        for column in range(3):
            for k in range(3):
                left[row, column] += R[last, k, row] * nav_R_body[k, column]
    d_R = rotation_vector(left)
    for i in range(first + 1, last):
        elapsed += h[i - 1]
        s = elapsed / duration
        a, b = s * s * (3 - 2 * s), s * s * (s - 1)
        da, db = 6 * s * (1 - s) / duration, s * (3 * s - 2)
        for k in range(3):
            d_p, d_v = position[k] - p[last, k], velocity[k] - v[last, k]
            p[i, k] += a * d_p + b * duration * d_v
            v[i, k] += da * d_p + db * d_v
        rotate_in_body(R[i], a * d_R[0], a * d_R[1], a * d_R[2])
