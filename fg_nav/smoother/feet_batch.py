"""Two whole recordings of the feet of one person, smoothed as one walk.

each foot  solved alone, with all that it shows of sensor and field          (`fitting`)
feet       both in one graph, tied by their steps                            (`feet`)
shared     what each foot's steps share, gyroscope's scale and moving foot, in the triangle of both
solution   of each foot by its share of the triangle (`batch.Draft`), and of the person by both (`feet.person`)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from dataclasses import field as declare
from functools import partial
from time import perf_counter

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import Keys
from fg_nav.feet.person import FeetSolution, PersonPath, trace_person
from fg_nav.magnetic import FootfallField
from fg_nav.recording import Recording
from fg_nav.smoother.batch import Draft, check_field, compile_smoother
from fg_nav.smoother.combinations import FootfallCovariance
from fg_nav.smoother.feet import SolvedFeet, solve_feet
from fg_nav.smoother.feet_factors import WIDTH, FootfallTies, list_pose_keys, mark_right
from fg_nav.smoother.fitting import FittedWalk, fit_walk
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import list_attitudes, list_table_keys, pose_in_nav
from fg_nav.smoother.square_root import SquareRoot
from fg_nav.solution import Solution
from fg_nav.stances import Stances

MIN_CELLS = 2  # Of steps that tie two feet: fewer do not show how they lie.


@dataclass(frozen=True)
class Foot:
    """What one foot's sensor recorded.

    `heading` of its body's x axis at the first stance, rad clockwise from north, None where it is not known; `field` at
    its footfalls, None to do without; `parameters` with the bias of its sensor.
    """

    recording: Recording
    stances: Stances
    heading: float | None = 0.0
    field: FootfallField | None = None
    parameters: SmootherParameters = declare(default_factory=SmootherParameters)


def smooth_feet(right: Foot, left: Foot, progress: Callable[[float], None] | None = None) -> FeetSolution:
    """Smooth the walk of two feet, whose recordings are on one clock.

    The frame is that of the left foot: its start is the origin, and its heading there the given one.

    Raises
    ------
    EstimationError
        As `smooth` of each foot, and where no steps show how the feet lie to each other.
    """
    compile_smoother()
    began, fitted = perf_counter(), []
    # Each foot alone, with all that it shows.
    for number, foot in enumerate((right, left)):
        check_field(foot.recording, foot.stances, foot.field)
        told = partial(_tell, progress, number)
        given = _look_for_places_once(foot.parameters, number == 0 and left.field is not None)
        fitted.append(fit_walk(foot.recording, foot.stances, given, foot.heading, told, foot.field))
    # Both in one graph.
    solved = solve_feet(*(replace(one.walk.problem, values=one.walk.solved.values) for one in fitted))
    _refuse_without_steps(solved)
    of_right = fitted[0].take_solution(solved.problem.right, solved.right)
    of_left = fitted[1].take_solution(solved.problem.left, solved.left)
    solution = _finish(solved, (of_right, right), (of_left, left), began)
    if progress is not None:
        progress(1.0)
    return solution


def _look_for_places_once(parameters: SmootherParameters, does_the_other: bool) -> SmootherParameters:
    """Return the parameters without places where the other foot looks for them: both are at the same ones."""
    return replace(parameters, walk=replace(parameters.walk, places=False)) if does_the_other else parameters


def _tell(progress: Callable[[float], None] | None, number: int, done: float) -> None:
    if progress is not None:
        progress(0.45 * (number + done))


def _refuse_without_steps(solved: SolvedFeet) -> None:
    if solved.problem.ties.cells < MIN_CELLS:
        raise EstimationError(
            "the two feet hardly take steps in turn: are they of one person at one time, and their clocks aligned? "
            "Run each of them by itself, or give --clock-offset."
        )


def _finish(
    solved: SolvedFeet, right: tuple[FittedWalk, Foot], left: tuple[FittedWalk, Foot], began: float
) -> FeetSolution:
    """Take the sigmas of both feet and of the person, and the dense paths."""
    shared = np.hstack([one.shared_sqrt_covariance() for one, _ in (right, left)])
    walks = [one.walk for one, _ in (right, left)]
    joints = [FootfallCovariance.of(walk.solved, walk.problem.nodes, shared) for walk in walks]
    covariances, apart_cov = _take_covariances(solved, shared)
    drafts = [
        Draft.of(walk, joint, of_table, foot.stances, began)
        for walk, joint, of_table, (_, foot) in zip(walks, joints, covariances, (right, left), strict=True)
    ]
    of_right, of_left = (draft.finish() for draft in drafts)
    ties, reach = solved.problem.ties, solved.problem.reach
    return FeetSolution(
        of_right,
        of_left,
        trace_person(of_right, of_left, _list_tie_times(solved), apart_cov),
        solved.minimum.values.width,
        measure_width_sigma(solved.minimum.root),
        ties.cells,
        len(reach),
    )


def trace_solved_person(solved: SolvedFeet, right: Solution, left: Solution) -> PersonPath:
    """Trace the person between two feet that were solved together."""
    ties, root = solved.problem.ties, solved.minimum.root
    joint = root.joint_covariances(_list_tied_keys(ties))
    return trace_person(right, left, _list_tie_times(solved), _subtract_left(solved, joint))


def _list_tie_times(solved: SolvedFeet) -> Floats:
    one = solved.problem.left
    return np.asarray(one.recording.t[one.nodes.sample[solved.problem.ties.left_node]])


def _list_tied_keys(ties: FootfallTies) -> Keys:
    """Keys (C, 2) of the right and of the left pose of each tie."""
    return np.stack([mark_right(list_pose_keys(ties.right_node)), list_pose_keys(ties.left_node)], axis=1)


def _take_covariances(solved: SolvedFeet, shared: Floats) -> tuple[tuple[Floats, Floats], Floats]:
    """Covariances (K, 6, 6) of the tables of the right and of the left foot, and (C, 4, 4) of what they differ by.

    `shared` (N, n) has by how much both are moved by numbers of unit covariance that the triangle does not hold. One
    pass along it finds all: of a pose that is tied, and eliminated before the other one, the joint covariance with
    that, of all else that with itself.
    """
    root, ties = solved.minimum.root, solved.problem.ties
    right, left = (list_table_keys(one.nodes) for one in (solved.problem.right, solved.problem.left))
    keys = np.concatenate([mark_right(np.array(right, dtype=np.uint64)), np.array(left, dtype=np.uint64)])
    number = np.stack([ties.right, len(right) + ties.left], axis=1)
    column = root.find_columns(keys[:, None])[:, 0]
    first = column[number].argmin(axis=1)
    pick = np.arange(len(ties))
    pairs = np.stack([keys, keys], axis=1)
    pairs[number[pick, first], 1] = keys[number[pick, 1 - first]]
    moved = shared[root.find_columns(pairs)]
    joint = root.joint_covariances(pairs) + moved @ np.swapaxes(moved, 1, 2)
    of_ties = joint[number[pick, first]]
    turned = np.roll(of_ties, 6, axis=(1, 2))
    in_order = np.where((first == 0)[:, None, None], of_ties, turned)
    own = joint[:, :6, :6]
    return (own[: len(right)], own[len(right) :]), _subtract_left(solved, in_order)


def _subtract_left(solved: SolvedFeet, joint: Floats) -> Floats:
    """Covariance (C, 4, 4) of the right foot's errors less the left one's, from that (C, 12, 12) of both poses."""
    ties = solved.problem.ties
    of_right, of_left = (
        pose_in_nav(list_attitudes(node, one.values))
        for node, one in ((ties.right_node, solved.right), (ties.left_node, solved.left))
    )
    nav_T_both = np.concatenate([of_right, -of_left], axis=2)
    return np.asarray(nav_T_both @ joint @ np.swapaxes(nav_T_both, 1, 2))


def measure_width_sigma(root: SquareRoot) -> float:
    """Sigma of the width, m, by one column of the covariance.

    What all strides share, as a foot that moves in stance, moves both feet alike: without it errors are 0.2 to 0.3
    sigmas on simulated walks.
    """
    column = np.zeros((root.total, 1))
    (at,) = root.find_columns([[int(WIDTH)]])[0]
    column[at] = 1.0
    return float(np.sqrt(root.back_substitute(root.forward_substitute(column))[at, 0]))
