"""Simulated walks to smooth, and their graphs as dense matrices."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.detection import RestParameters, detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab.simulation.person import Person
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.graph import Trajectory, WalkProblem, trajectory_of
from fg_nav.smoother.parameters import WalkParameters
from fg_nav.smoother.solver import dimension_of
from fg_nav.solution import Solution
from tests.simulated import IDEAL, QUIET, corridor

DEFAULT = SmootherParameters()

FREE = replace(DEFAULT, walk=WalkParameters(floors=False))
"""Without level floors: the height by the foot alone, as online."""


NO_REST = RestParameters(shortest_s=math.inf, shortest_at_end_s=math.inf)
NOT_RESTED = replace(DEFAULT, rest=NO_REST, gyro_bias_sigma_deg_s=0.3)
"""Without a rest the gyro bias is what the walk shows of it."""


def replace_field(p: SmootherParameters = DEFAULT, **changes: object) -> SmootherParameters:
    return replace(p, magnetic=replace(p.magnetic, **changes))


def ordering_of(keys: Iterable[int]) -> gtsam.Ordering:
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(int(key))
    return ordering


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
    walk = demo(seed, rate_hz)
    return smooth(walk.recording, walk.stances, p)


def dense_root(problem: WalkProblem, values: gtsam.Values) -> tuple[Floats, Floats, Floats]:
    """Jacobian A and right-hand side b of a whole graph, and the inverse root of A^T A, by dense linear algebra."""
    A, b = problem.factors().linearize(values).jacobian(ordering_of(problem.time_order))
    # Columns of one size, as poses, velocities and biases are of many.
    size = np.linalg.norm(A, axis=0)
    return A, b, np.linalg.inv(np.linalg.qr(A / size, mode="r")) / size[:, None]


def find_columns(problem: WalkProblem) -> dict[int, slice]:
    ends = np.cumsum([0, *map(dimension_of, problem.time_order.tolist())]).tolist()
    return {key: slice(*of) for key, of in zip(problem.time_order.tolist(), pairwise(ends), strict=True)}


def dense_log_evidence(problem: WalkProblem, values: gtsam.Values) -> float:
    """Of a graph linearized at values: E + 1/2 log|A^T A| without the logarithms of its sigmas."""
    A, b, inverse_root = dense_root(problem, values)
    explained = b @ (A @ (inverse_root @ (inverse_root.T @ (A.T @ b))))
    return float(0.5 * (b @ b - explained) - np.linalg.slogdet(inverse_root)[1])


@cache
def noise_free(person: Person = QUIET, rate_hz: float = 200.0) -> Walk:
    """The same walk as a perfect sensor has it."""
    return _detected(corridor(person, sensor=IDEAL, rate_hz=rate_hz).recording)


def _detected(recording: Recording) -> Walk:
    recording = replace(recording, mag=None)
    return Walk(recording, detect_stances(recording))


def in_field(
    field: Floats | Callable[[Floats], Floats], seed: int = 0, bias_deg_s: float = 0.0, iron: Floats = np.zeros(3)
) -> Recording:
    """The demonstration with a perfect magnetometer in a field of place, and a gyroscope that drifts about up."""
    recording, truth = demo(seed).recording, demo(seed).recording.truth
    there = field(truth.position) if callable(field) else np.broadcast_to(field, truth.position.shape)
    mag = np.einsum("nji,nj->ni", truth.nav_R_body, there) + iron
    return replace(recording, mag=mag, gyr=recording.gyr + np.radians(bias_deg_s) * truth.nav_R_body[:, 2])


def heading_error_deg(found: Solution, seed: int = 0) -> Floats:
    """Error (F,) at the footfalls of the demonstration."""
    true = demo(seed).recording.truth.nav_R_body[found.stances.sample]
    return np.degrees(wrap_angle(compute_heading(found.stances.nav_R_body) - compute_heading(true)))


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


def degrees_between(R: Floats, Q: Floats) -> Floats:
    return np.degrees(Rotation.from_matrix(np.swapaxes(R, 1, 2) @ Q).magnitude())


def track_of(problem: WalkProblem, values: gtsam.Values | None = None) -> Trajectory:
    at = problem.values if values is None else values
    return trajectory_of(problem.recording, problem.nodes, at, problem.parameters.gravity)
