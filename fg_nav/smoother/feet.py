"""Two feet of one person, smoothed as one walk.

    each foot     as a walk of its own (`batch`)                         -> its factors, with their noise and verdicts
    alignment     both paths turned and moved to each other              -> values to start from
    ties          steps that are beside each other                       (`feet_factors`)
    solution      of all factors of both feet
    reach         where standing feet are too far apart: added, and solved again
    shared        errors that each foot's steps share (`shared_errors`), in the triangle of both
    paths         of each foot by its share of the triangle (`batch`), and of the person by both (`feet.person`)

Each foot alone finds what only it can: rests, lever, noise, biases, what its field is worth. The graph of both has all
these factors and the ties; the left foot's start is the gauge, and the right one's is free.

The variables of the right foot have keys of their own (`feet_factors.RIGHT`), given to the linear factors only. The
footfalls that are tied are eliminated last, the newest of them first: what lies between is a chain of each foot alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Complexes, Floats
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import LETTER_SHIFT, Keys, Stack
from fg_nav.feet.person import FeetSolution, PersonPath, trace_person
from fg_nav.feet.steps import MIN_TURNS, average_cells, measure_turns
from fg_nav.samples.gaps import list_unrecorded
from fg_nav.smoother.batch import WalkInput, compile_smoother, fit_walk, prepare_solution
from fg_nav.smoother.feet_factors import (
    RIGHT,
    WIDTH,
    WIDTH_M,
    FeetValues,
    FootfallTies,
    ReachFactors,
    find_beyond_reach,
    list_footfalls,
    list_pose_keys,
    mark_right,
    tie_feet,
)
from fg_nav.smoother.gauss_newton import Minimum, find_minimum
from fg_nav.smoother.graph import StartPrior, WalkProblem, turn_walk
from fg_nav.smoother.sensitivity import FootfallCovariance
from fg_nav.smoother.solver import (
    Solved,
    WalkSystem,
    list_attitudes,
    list_poses,
    list_table_keys,
    pose_in_nav,
    split_tied,
)
from fg_nav.smoother.square_root import SquareRoot
from fg_nav.solution import Solution

FREE_PLACE_M, FREE_HEADING_DEG = 2.0, 60.0  # Sigmas of the right foot's start about its path beside the left.
SMOOTH_S = 10.0  # Before and after, over which turns of the right foot's path against the left one's are averaged.
AROUND_HOLE = 10  # Strides on either side of a hole in a recording, by which the path behind it is turned.
FEET_CONVERGENCE = 5e-6  # Per variable: what both feet show weakly, the heading of all, to a part of its sigma.
REACH_ROUNDS = 2  # Of adding reach.
MIN_CELLS = 2  # Of steps that tie two feet: fewer do not show how they lie.


@dataclass(frozen=True)
class FeetSystem:
    """The factors of both feet, and those between."""

    right: WalkSystem
    left: WalkSystem
    ties: FootfallTies
    reach: ReachFactors

    def stack(self, values: FeetValues) -> list[Stack]:
        """Linearize all of them."""
        of_right = (Stack(mark_right(one.keys), one.rows) for one in self.right.stack(values.right))
        return [*of_right, *self.left.stack(values.left), *self.ties.stack(values), *self.reach.stack(values)]

    def error(self, values: FeetValues) -> float:
        """Half the sum of squares of all residuals over their sigmas."""
        of_feet = self.right.error(values.right) + self.left.error(values.left)
        return of_feet + self.ties.error(values) + self.reach.error(values)

    def excess(self, values: FeetValues) -> float:
        """By how much the error is more than that of the linearized factors."""
        return self.right.excess(values.right) + self.left.excess(values.left)

    def move(self, values: FeetValues, step: Mapping[int, Floats]) -> FeetValues:
        """Retract each variable."""
        right, left, width = int(RIGHT), dict[int, Floats](), int(WIDTH)
        of_right = {key - right: x for key, x in step.items() if key & right}
        left = {key: x for key, x in step.items() if not key & right and key != width}
        return FeetValues(
            self.right.move(values.right, of_right),
            self.left.move(values.left, left),
            values.width + float(step[width][0]),
        )


@dataclass(frozen=True)
class FeetProblem:
    """Both feet before they are solved."""

    right: WalkProblem
    left: WalkProblem
    values: FeetValues
    ties: FootfallTies
    reach: ReachFactors

    @property
    def system(self) -> FeetSystem:
        """What is minimized."""
        right, left = (WalkSystem(one.graph, one.blocks) for one in (self.right, self.left))
        return FeetSystem(right, left, self.ties, self.reach)


@dataclass(frozen=True)
class SolvedFeet:
    """Both feet as they were solved, each with the triangle of both."""

    problem: FeetProblem
    minimum: Minimum[FeetValues]

    @property
    def right(self) -> Solved:
        """The right foot."""
        return self._foot("right", int(RIGHT))

    @property
    def left(self) -> Solved:
        """The left foot."""
        return self._foot("left", 0)

    def _foot(self, name: str, shift: int) -> Solved:
        m = self.minimum
        values, at = getattr(m.values, name), getattr(m.linearized_at, name)
        return Solved(values, m.root.shift_keys(shift), m.steps, at, m.error, m.volume)


def solve_feet(right: WalkProblem, left: WalkProblem) -> SolvedFeet:
    """Solve two feet, whose values are near the minima of each alone, as one walk."""
    # Both paths beside each other.
    right, values = align_feet(right, left)
    problem = FeetProblem(right, left, values, tie_feet(right, left, values), ReachFactors())
    # All factors of both, from a start that may be turned far from where the fields of both have it.
    solved = _solve(problem)
    for _ in range(REACH_ROUNDS):
        reach = find_beyond_reach(right, left, solved.minimum.values, solved.problem.reach)
        if len(reach) == len(solved.problem.reach):
            break
        # Where the ties and the reach of some feet contradict each other there is no minimum: the ties hold.
        try:
            solved = _solve(replace(problem, values=solved.minimum.values, reach=reach))
        except EstimationError:
            break
    return solved


def _solve(problem: FeetProblem) -> SolvedFeet:
    return SolvedFeet(problem, find_minimum(problem.system, problem.values, order_variables(problem), FEET_CONVERGENCE))


def align_feet(right: WalkProblem, left: WalkProblem) -> tuple[WalkProblem, FeetValues]:
    """Turn both paths into each other, half way each, move the right one beside the left, and free its start.

    The left one's heading at the start is the gauge.
    """
    of_right, of_left = gtsam.Values(right.values), gtsam.Values(left.values)
    _turn_behind_holes(FeetValues(of_right, of_left, WIDTH_M), right, left)
    turns = measure_turns(list_footfalls(right, of_right), list_footfalls(left, of_left))
    at_right, at_left = (_smooth_turn(*turns, one.recording.t[one.nodes.sample]) for one in (right, left))
    turn_walk(of_left, left.nodes, 0.5 * (at_left - at_left[0]))
    turn_walk(of_right, right.nodes, -0.5 * (at_right + at_left[0]))
    # The right path beside the left one, in the mean of all cells. Its factors hold no place: the start moves,
    # and all nodes with it.
    cells, poses = (
        average_cells(list_footfalls(right, of_right), list_footfalls(left, of_left)),
        list_poses(range(len(right.nodes)), of_right),
    )
    if len(cells):
        beside = cells.left - cells.right
        beside[:, :2] -= WIDTH_M * cells.left_normal
        poses[:, :3, 3] += np.mean(beside, axis=0)
    for j, pose in enumerate(poses):
        of_right.update(X(j), gtsam.Pose3(pose))
    start = of_right.atPose3(X(0))
    prior = StartPrior(start.rotation().matrix(), np.radians(FREE_HEADING_DEG), FREE_PLACE_M, start.translation())
    return replace(right, start=prior, values=of_right), FeetValues(of_right, of_left, WIDTH_M)


def _turn_behind_holes(values: FeetValues, right: WalkProblem, left: WalkProblem) -> None:
    """Turn each foot's path behind a hole in its recording as the other foot's goes on, in place."""
    holes = [
        (*span, of, problem, sign)
        for of, problem, sign in ((values.right, right, -1.0), (values.left, left, 1.0))
        for span in list_unrecorded(problem.recording.t)[1:-1]
    ]
    for begin, end, of, problem, sign in sorted(holes, key=lambda hole: hole[0]):
        t, turn = measure_turns(list_footfalls(right, values.right), list_footfalls(left, values.left))
        before, after = turn[t <= begin][-AROUND_HOLE:], turn[t >= end][:AROUND_HOLE]
        if min(np.abs(before).sum(), np.abs(after).sum()) >= MIN_TURNS:
            jump = float(np.angle(after.mean() / before.mean()))
            behind = problem.recording.t[problem.nodes.sample] >= end
            turn_walk(of, problem.nodes, sign * jump * behind)


def _smooth_turn(at: Floats, turn: Complexes, t: Floats) -> Floats:
    """Turn (M,) rad at times t (M,), a mean of the turns (S,), weighted exp(i turn), at times (S,) around."""
    if not len(at):
        return np.zeros(len(t))
    middle = np.arange(t[0], t[-1] + SMOOTH_S, 0.5 * SMOOTH_S)
    near = np.searchsorted(at, [middle - SMOOTH_S, middle + SMOOTH_S])
    total = np.concatenate([[0.0], np.cumsum(turn)])
    mean = total[near[1]] - total[near[0]]
    seen = near[1] > near[0]
    return np.asarray(np.interp(t, middle[seen], np.unwrap(np.angle(mean[seen]))))


def order_variables(problem: FeetProblem) -> Keys:
    """Keys of all variables in the order in which they are eliminated.

    First the chain of each foot alone, then the tied footfalls, the newest of them first, and what many join.
    """
    chains, tied, common, moments = [], [], [], []
    for one, ties, reach, mark in (
        (problem.right, problem.ties.right, problem.reach.right, RIGHT),
        (problem.left, problem.ties.left, problem.reach.left, np.uint64(0)),
    ):
        nodes, keys = one.nodes, one.time_order
        by_places = np.zeros(0, np.int64) if one.places is None else one.places.footfalls
        footfalls = np.unique(np.concatenate([ties, np.searchsorted(nodes.result, reach), by_places]))
        is_tied, is_common = split_tied(keys, nodes, footfalls)
        # A variable follows the last node that uses it.
        is_pose = keys >> np.uint64(LETTER_SHIFT) == ord("x")
        node = np.maximum.accumulate(np.where(is_pose, (keys & np.uint64(0xFFFFFFFF)).astype(np.int64), -1))
        chains.append(keys[~is_tied & ~is_common] + mark)
        tied.append(keys[is_tied] + mark)
        common.append(keys[is_common] + mark)
        moments.append(one.recording.t[nodes.sample[node]][is_tied])
    newest_first = np.argsort(np.concatenate(moments), kind="stable")[::-1]
    return np.concatenate([*chains, np.concatenate(tied)[newest_first], *common, [WIDTH]])


def smooth_feet(right: WalkInput, left: WalkInput, progress: Callable[[float], None] | None = None) -> FeetSolution:
    """Smooth the walk of two feet, whose recordings are on one clock.

    The frame is that of the left foot: its start is the origin, and its heading there the given one.

    Raises
    ------
    EstimationError
        As `smooth` of each foot, and where no steps show how the feet lie to each other.
    """
    compile_smoother()
    began, fitted = perf_counter(), []
    # Each foot alone; where the left one looks for places the right one does not, as both are at the same ones.
    for number, foot in enumerate((right, left)):
        p = foot.parameters
        if number == 0 and left.field is not None:
            p = replace(p, walk=replace(p.walk, places=False))
        # Each takes 45 % of the time.
        report = None if progress is None else lambda done, of=number: progress(0.45 * (of + done))
        fitted.append(fit_walk(replace(foot, parameters=p, progress=report)))
    # Both in one graph.
    solved = solve_feet(*(replace(one.walk.problem, values=one.walk.solved.values) for one in fitted))
    ties = solved.problem.ties
    if ties.cells < MIN_CELLS:
        raise EstimationError(
            "the two feet hardly take steps in turn: are they of one person at one time, and their clocks aligned? "
            "Run each of them by itself, or give --clock-offset."
        )
    fitted = [
        fitted[0].take_solution(solved.problem.right, solved.right),
        fitted[1].take_solution(solved.problem.left, solved.left),
    ]
    # The sigmas of both feet and of the person, and the dense paths.
    shared = np.hstack([one.shared_sqrt_covariance() for one in fitted])
    joints = [FootfallCovariance.of(one.walk.solved, one.walk.problem.nodes, shared) for one in fitted]
    covariances, apart_cov = _take_covariances(solved, shared)
    finishes = [
        prepare_solution(one.walk, joint, of_table, foot.stances, began)
        for one, joint, of_table, foot in zip(fitted, joints, covariances, (right, left), strict=True)
    ]
    of_right, of_left = (finish() for finish in finishes)
    solution = FeetSolution(
        of_right,
        of_left,
        trace_person(of_right, of_left, _list_tie_times(solved), apart_cov),
        solved.minimum.values.width,
        measure_width_sigma(solved.minimum.root),
        ties.cells,
        len(solved.problem.reach),
    )
    if progress is not None:
        progress(1.0)
    return solution


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
