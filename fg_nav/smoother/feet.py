"""Two feet of one person, smoothed as one walk (`docs/two_feet.md`).

    each foot     as a walk of its own (`batch`)                         -> its factors, with their noise and verdicts
    alignment     both paths turned and moved to each other              -> values to start from
    ties          steps that are beside each other                       (`factors.same_place`)
    solution      of all factors of both feet
    reach         where standing feet are too far apart: added, and solved again
    shared        errors that each foot's steps share (`sensitivity`), in the triangle of both
    paths         of each foot by its share of the triangle (`batch`), and of the person by both (`feet.person`)

The left foot's start is the gauge, and the right one's is free; its variables have keys of their own (`RIGHT`), in the
linear factors only. Where for long there is no cell of steps, pairs of footfalls have ties of zero weight, which keep
both feet's joint covariance for the sigmas of the person. The footfalls that are tied are eliminated last, the newest
of them first: what lies between is a chain of each foot alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Bools, Complexes, Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import LETTER_SHIFT, Keys, Stack, one_of
from fg_nav.factors.same_place import BesideEachOther, WithinReach, weigh_place
from fg_nav.feet.person import FeetSolution, trace_person
from fg_nav.feet.steps import MAX_S, MIN_TURNS, Footfalls, average_cells, measure_turns
from fg_nav.samples.gaps import find_holes, list_unrecorded
from fg_nav.smoother.batch import WalkInput, compile_smoother, fit_walk, list_table_keys, to_solution
from fg_nav.smoother.building import find_footfalls
from fg_nav.smoother.graph import StartPrior, WalkProblem, turn_walk
from fg_nav.smoother.sensitivity import FootfallCovariance
from fg_nav.smoother.solver import (
    Minimum,
    Solved,
    WalkSystem,
    find_minimum,
    list_attitudes,
    list_poses,
    pose_in_nav,
    split_tied,
)
from fg_nav.smoother.square_root import SquareRoot
from fg_nav.solution import Solution

ALONG_SIGMA_M, ACROSS_SIGMA_M, UP_SIGMA_M = 0.08, 0.05, 0.04  # Of a cell of a short walk; laps 0.03, 0.02, 0.005.
STEPS_HALF = 2.0  # Steps of a cell in whose mean they differ as much as what a person does alike from step to step.
WIDTH_M, WIDTH_SIGMA_M = 0.15, 0.1  # Between the sensors: people walk 0.05 to 0.2 m wide, with sensors outside.
STAND_SIGMA_M, STAND_UP_SIGMA_M = 0.25, 0.15  # Between the feet of a person who stands still.
STAND_SHARE = 0.5  # Of the usual time of a stride: who walks has both feet on the ground for a tenth to a fourth of it.
SAME_STAND_M = 0.1  # Between stands of feet that have not moved since.
MAX_GROWN_SIGMA = 2.0  # Of a stand: nobody who walks has both feet on the ground for half of a stride's time.
NEAR_FOOTFALLS = 4  # Of the one foot, that are compared with one of the other.
REACH_M, REACH_SIGMA_M = 1.2, 0.1  # Between two standing feet: what a tall person lunges, and soft edges.
FLIGHT_M_S, MAX_FLIGHT_S = 3.0, 0.3  # Where neither is seen to stand the person moves on, for no longer.
WATCHED_S = 15.0  # From the nearest cell, beyond which pairs are tied by nothing: cells of long walks are 20 s apart.
RIGHT = np.uint64(1 << 40)  # Added to the keys of the right foot's variables in the graph of both.
WIDTH = np.uint64(ord("w") << LETTER_SHIFT)  # Key of the width.
FREE_PLACE_M, FREE_HEADING_DEG = 2.0, 60.0  # Sigmas of the right foot's start about its path beside the left.
SMOOTH_S = 10.0  # Before and after, over which turns of the right foot's path against the left one's are averaged.
AROUND_HOLE = 10  # Strides on either side of a hole in a recording, by which the path behind it is turned.
FEET_CONVERGENCE = 5e-6  # Per variable: what both feet show weakly, the heading of all, to a part of its sigma.
REACH_ROUNDS = 2  # Of adding reach.
MIN_CELLS = 2  # Of steps that tie two feet: fewer do not show how they lie.


@dataclass(frozen=True)
class FeetValues:
    """Values of all variables of both feet, and of the width, m."""

    right: gtsam.Values
    left: gtsam.Values
    width: float


@dataclass(frozen=True)
class NodePairs:
    """Residuals (P, r) of pairs of nodes `right` and `left` (P,), one of each foot; of ties with the width besides."""

    right: Ints
    left: Ints
    residuals: BesideEachOther | WithinReach

    def __len__(self) -> int:
        return len(self.right)

    def take(self, those: Bools) -> NodePairs:
        """Return some of them."""
        return NodePairs(self.right[those], self.left[those], one_of(self.residuals, those))

    def evaluate(self, values: FeetValues, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
        """Return residuals (P, r) and Jacobians."""
        variables = [list_poses(self.right, values.right), list_poses(self.left, values.left)]
        if isinstance(self.residuals, BesideEachOther):
            variables.append(np.full((len(self), 1), values.width))
        return self.residuals.evaluate(variables, with_jacobians)

    def stack(self, values: FeetValues) -> list[Stack]:
        """Return them linearized at these values."""
        if not len(self):
            return []
        keys, (e, H) = _pair_keys(self.right, self.left), self.evaluate(values, True)
        if isinstance(self.residuals, BesideEachOther):
            keys = np.column_stack([keys, np.full(len(self), WIDTH)])
        return [Stack(keys, np.concatenate([*H, -e[..., None]], axis=2))]

    def error(self, values: FeetValues) -> float:
        """Half the sum of squares of the residuals over their sigmas."""
        return 0.5 * float((self.evaluate(values, False)[0] ** 2).sum()) if len(self) else 0.0


@dataclass(frozen=True)
class FootfallTies:
    """C pairs of footfalls, tied at their nodes."""

    right: Ints  # (C,).
    left: Ints  # (C,).
    pairs: NodePairs
    cells: int  # The first of them, which stand for cells of steps; the others are tied by nothing.

    def __len__(self) -> int:
        return len(self.right)


def _pair_keys(right: Ints, left: Ints) -> Keys:
    """Keys (n, 2) of poses of the right foot at nodes `right` (n,), and of the left one at nodes `left` (n,)."""
    keys = np.array([[X(int(j)), X(int(k))] for j, k in zip(right, left, strict=True)], dtype=np.uint64)
    return keys.reshape(-1, 2) + np.array([RIGHT, 0], dtype=np.uint64)


def list_footfalls(problem: WalkProblem, values: gtsam.Values) -> Footfalls:
    """List the footfalls of a foot, in the middle of their standing."""
    nodes, t = problem.nodes, problem.recording.t[problem.nodes.sample]
    middle = 0.5 * (t[nodes.first[:-1]] + t[nodes.first[1:] - 1])
    holes = problem.recording.t[find_holes(problem.recording.t)]
    return Footfalls(middle, list_poses(nodes.result, values)[:, :3, 3].copy(), holes)


def tie_feet(right: WalkProblem, left: WalkProblem, values: FeetValues) -> FootfallTies:
    """Return the ties of mean right and left places: a cell of steps each, and standings with both feet."""
    feet = list_footfalls(right, values.right), list_footfalls(left, values.left)
    cells = average_cells(*feet)
    *stands, stand_sigma = _find_stands(right, left, feet)
    # Each footfall has one tie at most: joint covariances are found by their first variable.
    free = [np.setdiff1d(np.arange(len(foot)), taken) for foot, taken in zip(feet, stands, strict=True)]
    count = np.arange(len(cells))
    nearest = [
        np.maximum.accumulate(find_footfalls(cells.t, foot.t[one]) - count) + count
        for foot, one in zip(feet, free, strict=True)
    ]
    cells = cells.take((nearest[0] < len(free[0])) & (nearest[1] < len(free[1])))
    by_tie = [
        np.concatenate([one[near[: len(cells)]], taken]) for one, near, taken in zip(free, nearest, stands, strict=True)
    ]
    # Pairs that are watched, every `WATCHED_S` where no tie is within as much: their covariance is reported.
    cell_t = np.concatenate([[-np.inf], np.sort(feet[1].t[by_tie[1]]), [np.inf]])
    moment = np.arange(max(foot.t[0] for foot in feet), min(foot.t[-1] for foot in feet), WATCHED_S)
    after = np.searchsorted(cell_t, moment)
    lonely = moment[np.minimum(moment - cell_t[after - 1], cell_t[after] - moment) > WATCHED_S]
    pairs = np.stack([find_footfalls(lonely, foot.t) for foot in feet], axis=1)
    is_new = [~np.isin(pairs[:, k], by_tie[k]) & (np.diff(pairs[:, k], prepend=-1) > 0) for k in range(2)]
    apart_s = np.abs(feet[0].t[pairs[:, 0]] - feet[1].t[pairs[:, 1]])
    watched = pairs[is_new[0] & is_new[1] & (apart_s < MAX_S)].T
    of_right, of_left = (np.concatenate(each) for each in zip(by_tie, watched, strict=True))
    node = right.nodes.result[of_right], left.nodes.result[of_left]
    poses = list_poses(node[0], values.right), list_poses(node[1], values.left)
    in_body = [
        np.einsum("kji,kj->ki", pose[: len(cells), :3, :3], place - pose[: len(cells), :3, 3])
        for pose, place in zip(poses, (cells.right, cells.left), strict=True)
    ]
    normal = np.pad(cells.left_normal, ((0, 0), (0, 1)))
    heading = np.arctan2(-normal[:, 0], normal[:, 1])
    # Sigma of a cell's mean by how many steps it averages.
    times = np.sqrt(1.0 / cells.grown + STEPS_HALF / cells.steps)
    along, across, up = np.array([ALONG_SIGMA_M, ACROSS_SIGMA_M, UP_SIGMA_M])[:, None] * times
    weight = weigh_place(heading, along, across, up)
    in_left = np.einsum("kji,kj->ki", poses[1][: len(cells), :3, :3], normal)
    # In a standing the sensors themselves are close, in an unknown direction: an isotropic sigma.
    in_body = [np.concatenate([one, np.zeros((len(stand_sigma), 3))]) for one in in_body]
    near = np.array([STAND_SIGMA_M, STAND_SIGMA_M, STAND_UP_SIGMA_M])
    weight = np.concatenate([weight, np.eye(3) / (near * stand_sigma[:, None])[:, None]])
    # Watched pairs, only there for their covariance, have zero weight.
    rows = [
        np.concatenate([one, np.zeros((len(of_right) - len(one), *one.shape[1:]))])
        for one in (*in_body, in_left, weight)
    ]
    return FootfallTies(of_right, of_left, NodePairs(*node, BesideEachOther(*rows)), len(cells))


def _find_stands(right: WalkProblem, left: WalkProblem, feet: tuple[Footfalls, Footfalls]) -> tuple[Ints, Ints, Floats]:
    """Return right and left footfalls (P,) of standings with both feet, and the factors (P,) on their sigmas."""
    spans = [_list_spans(one) for one in (right, left)]
    usual = np.median(np.concatenate([np.diff(foot.t) for foot in feet])) if min(map(len, feet)) > 1 else np.inf
    first = np.searchsorted(spans[1][1], spans[0][0])
    pairs, placed = list[tuple[int, int, float]](), list[Floats]()
    for i, j in enumerate(first):
        # The left footfall with the longest common stance; the shorter that is, the larger the sigma.
        begin, end = (one[j : j + NEAR_FOOTFALLS] for one in spans[1])
        shared = np.minimum(spans[0][1][i], end) - np.maximum(spans[0][0][i], begin)
        if not len(shared) or shared.max() <= 0.0:
            continue
        k = int(j + shared.argmax())
        grown = 1.0 + (STAND_SHARE * usual / shared.max()) ** 4
        place = np.concatenate([feet[0].position[i], feet[1].position[k]])
        is_same = bool(placed) and float(np.abs(place - placed[-1]).max()) < SAME_STAND_M
        if grown < MAX_GROWN_SIGMA and not is_same and not (pairs and pairs[-1][1] == k):
            pairs.append((i, k, grown))
            placed.append(place)
    of_right, of_left, grown_by = (np.array(column) for column in zip(*pairs, strict=True)) if pairs else ([], [], [])
    return np.asarray(of_right, np.int64), np.asarray(of_left, np.int64), np.asarray(grown_by, np.float64)


def pair_standing_feet(right: WalkProblem, left: WalkProblem) -> NodePairs:
    """Return the pairs of footfalls between which both feet were in the air for a moment, or for none: within reach."""
    (begin, end), (begin_left, end_left) = (_list_spans(problem) for problem in (right, left))
    first = np.searchsorted(end_left, begin - MAX_FLIGHT_S)
    count = np.maximum(np.searchsorted(begin_left, end + MAX_FLIGHT_S) - first, 0)
    at = np.repeat(np.arange(len(count)), count)
    at_left = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)
    flight = np.maximum(begin[at] - end_left[at_left], begin_left[at_left] - end[at])
    reach = REACH_M + FLIGHT_M_S * np.maximum(flight, 0.0)
    within = WithinReach(reach, np.full(len(reach), REACH_SIGMA_M))
    return NodePairs(right.nodes.result[at], left.nodes.result[at_left], within)


def _list_spans(problem: WalkProblem) -> tuple[Floats, Floats]:
    """Begin and end (F,) of each footfall, s."""
    nodes, t = problem.nodes, problem.recording.t[problem.nodes.sample]
    return t[nodes.first[:-1]], t[nodes.first[1:] - 1]


@dataclass(frozen=True)
class FeetSystem:
    """The factors of both feet, those between, and the prior of the width."""

    right: WalkSystem
    left: WalkSystem
    between: tuple[NodePairs, NodePairs]

    def stack(self, values: FeetValues) -> list[Stack]:
        """Linearize all of them."""
        of_right = (Stack(one.keys + RIGHT, one.rows) for one in self.right.stack(values.right))
        prior = Stack(np.array([[WIDTH]]), np.array([[[1.0, WIDTH_M - values.width]]]) / WIDTH_SIGMA_M)
        pairs = (stack for one in self.between for stack in one.stack(values))
        return [*of_right, *self.left.stack(values.left), prior, *pairs]

    def error(self, values: FeetValues) -> float:
        """Half the sum of squares of all residuals over their sigmas."""
        of_feet = self.right.error(values.right) + self.left.error(values.left)
        of_width = 0.5 * ((values.width - WIDTH_M) / WIDTH_SIGMA_M) ** 2
        return of_feet + of_width + sum(one.error(values) for one in self.between)

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
    reach: NodePairs

    @property
    def system(self) -> FeetSystem:
        """What is minimized."""
        return FeetSystem(self.right.system, self.left.system, (self.ties.pairs, self.reach))


@dataclass(frozen=True)
class SolvedFeet:
    """Both feet as they were solved, each with the triangle of both."""

    problem: FeetProblem
    minimum: Minimum[FeetValues]

    @property
    def right(self) -> Solved:
        """The right foot."""
        m = self.minimum
        at_right = m.root.shift_keys(int(RIGHT))
        return Minimum(m.values.right, at_right, m.steps, m.linearized_at.right, m.error)

    @property
    def left(self) -> Solved:
        """The left foot."""
        m = self.minimum
        return Minimum(m.values.left, m.root, m.steps, m.linearized_at.left, m.error)


def solve_feet(right: WalkProblem, left: WalkProblem) -> SolvedFeet:
    """Solve two feet, whose values are near the minima of each alone, as one walk."""
    # Both paths beside each other.
    right, values = align_feet(right, left)
    standing = pair_standing_feet(right, left)
    beyond = np.zeros(len(standing), dtype=np.bool_)
    problem = FeetProblem(right, left, values, tie_feet(right, left, values), standing.take(beyond))
    # All factors of both, from a start that may be turned far from where the fields of both have it.
    solved = _solve(problem)
    for _ in range(REACH_ROUNDS):
        known, apart = beyond, standing.evaluate(solved.minimum.values, False)[0][:, 0]
        beyond = known | (apart > 0.0)
        if beyond.sum() == known.sum():
            break
        # Where the ties and the reach of some feet contradict each other there is no minimum: the ties hold.
        try:
            solved = _solve(replace(problem, values=solved.minimum.values, reach=standing.take(beyond)))
        except EstimationError:
            break
    return solved


def _solve(problem: FeetProblem) -> SolvedFeet:
    return SolvedFeet(problem, find_minimum(problem.system, problem.values, order_variables(problem), FEET_CONVERGENCE))


def align_feet(right: WalkProblem, left: WalkProblem) -> tuple[WalkProblem, FeetValues]:
    """Turn both paths into each other, half way each, move the right one beside the left, and free its start."""
    of_right, of_left = gtsam.Values(right.values), gtsam.Values(left.values)
    # Behind a hole in its recording each path is turned as the other foot's goes on.
    holes = [
        (*span, of, problem, sign)
        for of, problem, sign in ((of_right, right, -1.0), (of_left, left, 1.0))
        for span in list_unrecorded(problem.recording.t)[1:-1]
    ]
    for begin, end, of, problem, sign in sorted(holes, key=lambda hole: hole[0]):
        t, turn = measure_turns(list_footfalls(right, of_right), list_footfalls(left, of_left))
        before, after = turn[t <= begin][-AROUND_HOLE:], turn[t >= end][:AROUND_HOLE]
        if min(np.abs(before).sum(), np.abs(after).sum()) >= MIN_TURNS:
            jump = float(np.angle(after.mean() / before.mean()))
            turn_walk(of, problem.nodes, sign * jump * (problem.recording.t[problem.nodes.sample] >= end))
    # The turn of one path against the other, half of it taken from each.
    turns = measure_turns(list_footfalls(right, of_right), list_footfalls(left, of_left))
    at_right, at_left = (_smooth_turn(*turns, one.recording.t[one.nodes.sample]) for one in (right, left))
    turn_walk(of_left, left.nodes, 0.5 * (at_left - at_left[0]))
    turn_walk(of_right, right.nodes, -0.5 * (at_right + at_left[0]))
    # The right path beside the left one, in the mean of all cells. Its factors hold no place: the start moves,
    # and all nodes with it.
    cells = average_cells(list_footfalls(right, of_right), list_footfalls(left, of_left))
    poses = list_poses(range(len(right.nodes)), of_right)
    if len(cells):
        beside = cells.left - cells.right
        beside[:, :2] -= WIDTH_M * cells.left_normal
        poses[:, :3, 3] += np.mean(beside, axis=0)
    for j, pose in enumerate(poses):
        of_right.update(X(j), gtsam.Pose3(pose))
    start = of_right.atPose3(X(0))
    prior = StartPrior(start.rotation().matrix(), np.radians(FREE_HEADING_DEG), FREE_PLACE_M, start.translation())
    return replace(right, start=prior, values=of_right), FeetValues(of_right, of_left, WIDTH_M)


def _smooth_turn(at: Floats, turn: Complexes, t: Floats) -> Floats:
    """Return the smoothed turn (M,) rad at times t (M,) s: moving mean of phasors `turn` (S,), weight exp(i angle)."""
    if not len(at):
        return np.zeros(len(t))
    middle = np.arange(t[0], t[-1] + SMOOTH_S, 0.5 * SMOOTH_S)
    near = np.searchsorted(at, [middle - SMOOTH_S, middle + SMOOTH_S])
    total = np.concatenate([[0.0], np.cumsum(turn)])
    mean = total[near[1]] - total[near[0]]
    seen = near[1] > near[0]
    return np.asarray(np.interp(t, middle[seen], np.unwrap(np.angle(mean[seen]))))


def order_variables(problem: FeetProblem) -> Keys:
    """Order the keys for small fronts: each foot's chain, then tied footfalls, newest first, and what many join."""
    chains, tied, common, moments = [], [], [], []
    for one, ties, reach, mark in (
        (problem.right, problem.ties.right, problem.reach.right, RIGHT),
        (problem.left, problem.ties.left, problem.reach.left, np.uint64(0)),
    ):
        nodes, keys = one.nodes, one.time_order
        footfalls = np.unique(np.concatenate([ties, np.searchsorted(nodes.result, reach), one.tied]))
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
    """Smooth the walk of two feet, whose recordings are on one clock, in the frame of the left one.

    Raises `EstimationError` as `smooth` of each foot, and where no steps show how the feet lie to each other.
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
    solved = solve_feet(*(replace(one.problem, values=one.solved.values) for one in fitted))
    ties = solved.problem.ties
    if ties.cells < MIN_CELLS:
        raise EstimationError(
            "the two feet hardly take steps in turn: are they of one person at one time, and their clocks aligned? "
            "Run each of them by itself, or give --clock-offset."
        )
    of_each = ((solved.problem.right, solved.right), (solved.problem.left, solved.left))
    fitted = [one.take_solution(*of) for one, of in zip(fitted, of_each, strict=True)]
    # The sigmas of both feet and of the person, and the dense paths.
    shared = np.hstack([one.shared_sqrt_covariance() for one in fitted])
    joints = [FootfallCovariance.of(one.solved, one.problem.nodes, shared) for one in fitted]
    covariances, apart_cov = _take_covariances(solved, shared)
    of_right, of_left = (
        to_solution(one, joint, of_table, foot.stances, began)
        for one, joint, of_table, foot in zip(fitted, joints, covariances, (right, left), strict=True)
    )
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


def trace_solved_person(solved: SolvedFeet, right: Solution, left: Solution) -> Solution:
    """Trace the person between two feet that were solved together."""
    ties, root = solved.problem.ties, solved.minimum.root
    joint = root.joint_covariances(_pair_keys(ties.pairs.right, ties.pairs.left))
    return trace_person(right, left, _list_tie_times(solved), _subtract_left(solved, joint))


def _list_tie_times(solved: SolvedFeet) -> Floats:
    one = solved.problem.left
    return np.asarray(one.recording.t[one.nodes.sample[solved.problem.ties.pairs.left]])


def _take_covariances(solved: SolvedFeet, shared: Floats) -> tuple[tuple[Floats, Floats], Floats]:
    """Return table covariances (K, 6, 6) of right and left, and (C, 4, 4) of right less left pose (4) at ties."""
    # One pass along the triangle finds all: of a tied pose that is eliminated before the other one the joint covariance
    # of both, of all else its own.
    root, ties = solved.minimum.root, solved.problem.ties
    right, left = (list_table_keys(one.nodes) for one in (solved.problem.right, solved.problem.left))
    keys = np.concatenate([np.array(right, dtype=np.uint64) + RIGHT, np.array(left, dtype=np.uint64)])
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
    """Return the covariance (C, 4, 4) of right less left errors, from the joint one (C, 12, 12) of both poses."""
    ties = solved.problem.ties.pairs
    of_right, of_left = (
        pose_in_nav(list_attitudes(node, one.values))
        for node, one in ((ties.right, solved.right), (ties.left, solved.left))
    )
    nav_T_both = np.concatenate([of_right, -of_left], axis=2)
    return np.asarray(nav_T_both @ joint @ np.swapaxes(nav_T_both, 1, 2))


def measure_width_sigma(root: SquareRoot) -> float:
    """Sigma of the width, m, by one column of the covariance; what all strides share moves both feet alike."""
    column = np.zeros((root.total, 1))
    (at,) = root.find_columns([[int(WIDTH)]])[0]
    column[at] = 1.0
    return float(np.sqrt(root.back_substitute(root.forward_substitute(column))[at, 0]))
