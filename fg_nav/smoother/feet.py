"""Two feet of one person in one graph.

    each foot     as a walk of its own                                   -> its factors, with their noise and verdicts
    alignment     both paths turned and moved to each other              -> values to start from
    ties          steps that are beside each other                       (`feet_factors`)
    solution      of all factors of both feet
    reach         where standing feet are too far apart: asked for, and solved again

Each foot alone finds what only it can: rests, lever, noise, biases, what its field is worth. The graph of both has all
these factors and the ties; the left foot's start is the gauge, and the right one's is free.

The variables of the right foot have keys of their own (`feet_factors.RIGHT`), given to the linear factors only. The
footfalls that are tied are eliminated last, the newest of them first: what lies between is a chain of each foot alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Complexes, Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import LETTER_SHIFT, Keys, Stack
from fg_nav.feet.steps import MIN_TURNS, Cells, average_cells, measure_turns
from fg_nav.samples.gaps import list_unrecorded
from fg_nav.smoother.feet_factors import (
    RIGHT,
    WIDTH,
    WIDTH_M,
    FeetValues,
    FootfallTies,
    ReachFactors,
    find_beyond_reach,
    list_footfalls,
    mark_right,
    tie_feet,
)
from fg_nav.smoother.gauss_newton import Minimum, find_minimum
from fg_nav.smoother.graph import StartPrior, WalkProblem, turn_walk
from fg_nav.smoother.place_factors import split_tied
from fg_nav.smoother.solver import Solved, WalkSystem, list_in_time, list_poses

FREE_PLACE_M, FREE_HEADING_DEG = 2.0, 60.0
"""Sigmas of the right foot's start about where its path lies beside the left one's."""

SMOOTH_S = 10.0  # Before and after, over which turns of the right foot's path against the left one's are averaged.
AROUND_HOLE = 10  # Strides on either side of a hole in a recording, by which the path behind it is turned.

FEET_CONVERGENCE = 5e-6
"""Difference of promised and true error per variable, of which there are some ten thousand: two feet start from where
they were alone, and what they show weakly, as the heading of all of the walk, is to be found to a part of its sigma."""

REACH_ROUNDS = 2  # In which reach is asked for.


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
    problem = FeetProblem(right, left, values, tie_feet(right, left, values), ReachFactors.of_nothing())
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
    shift = _measure_shift(average_cells(list_footfalls(right, of_right), list_footfalls(left, of_left)))
    # Its factors do not say where it is: what is moved is the start, and all nodes with it.
    _shift_walk(of_right, len(right.nodes), shift)
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
    asked = np.arange(t[0], t[-1] + SMOOTH_S, 0.5 * SMOOTH_S)
    near = np.searchsorted(at, [asked - SMOOTH_S, asked + SMOOTH_S])
    total = np.concatenate([[0.0], np.cumsum(turn)])
    mean = total[near[1]] - total[near[0]]
    seen = near[1] > near[0]
    return np.asarray(np.interp(t, asked[seen], np.unwrap(np.angle(mean[seen]))))


def _measure_shift(cells: Cells) -> Floats:
    """From the right foot to beside the left one (3,) m, in the mean of all cells."""
    if not len(cells):
        return np.zeros(3)
    beside = cells.left - cells.right
    beside[:, :2] -= WIDTH_M * cells.left_normal
    return np.asarray(np.mean(beside, axis=0))


def _shift_walk(values: gtsam.Values, nodes: int, shift: Floats) -> None:
    poses = list_poses(range(nodes), values)
    poses[:, :3, 3] += shift
    for j, pose in enumerate(poses):
        values.update(X(j), gtsam.Pose3(pose))


def order_variables(problem: FeetProblem) -> Keys:
    """Keys of all variables in the order in which they are eliminated."""
    chains, tied, common, moments = [], [], [], []
    for one, ties, reach, mark in (
        (problem.right, problem.ties.right, problem.reach.right, RIGHT),
        (problem.left, problem.ties.left, problem.reach.left, np.uint64(0)),
    ):
        keys, last, joined, t = _split_foot(one, ties, reach)
        chains.append(keys + mark)
        tied.append(last + mark)
        common.append(joined + mark)
        moments.append(t)
    newest_first = np.argsort(np.concatenate(moments), kind="stable")[::-1]
    return np.concatenate([*chains, np.concatenate(tied)[newest_first], *common, [WIDTH]])


def _split_foot(problem: WalkProblem, ties: Ints, reach: Ints) -> tuple[Keys, Keys, Keys, Floats]:
    """Keys of the chain of a foot, those of tied footfalls, what many join, and the moments of the tied ones."""
    nodes = problem.nodes
    by_places = np.zeros(0, np.int64) if problem.places is None else problem.places.footfalls
    tied = np.unique(np.concatenate([ties, np.searchsorted(nodes.result, reach), by_places]))
    with_field, with_air = problem.field is not None, problem.barometer is not None
    keys = list_in_time(nodes, with_field, problem.floor, problem.alphas, with_air)
    is_tied, is_common = split_tied(keys, nodes, tied)
    # A variable follows the last node that uses it.
    is_pose = keys >> np.uint64(LETTER_SHIFT) == ord("x")
    node = np.maximum.accumulate(np.where(is_pose, (keys & np.uint64(0xFFFFFFFF)).astype(np.int64), -1))
    moment = problem.recording.t[nodes.sample[node]]
    return keys[~is_tied & ~is_common], keys[is_tied], keys[is_common], moment[is_tied]
