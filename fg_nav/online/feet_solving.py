"""The walks of both feet of a person in progress, solved again as one.

    each foot     its walk so far alone                       (`resolve.solve_alone`)
    both          in one graph                                (`smoother.feet.solve_feet`)
    AnchorState   of each foot, by the triangle of both; its newest strides go on from there alone

Both begin within a step of each other, and are joined when the first of them is due, so that both go on from one
solution, each by its own marginal of it: nothing is counted twice. A foot that has no newer task is in it as it was
solved last. Steps that tie fewer cells than `MIN_CELLS` do not show how the feet lie: then each is as it is alone,
the right one in a frame of its own.

The frame of both is the left foot's. Where its heading was given, or it has no magnetometer, the right foot's is set by
the directions of the steps, once, and its walk solved again with it: else its field and the steps would ask for two.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from fg_nav.detection.stance import StanceParameters
from fg_nav.errors import EstimationError
from fg_nav.feet import SIDES, Side
from fg_nav.feet.steps import MIN_TURNS, measure_turns
from fg_nav.frames import compute_heading
from fg_nav.online.anchor import AnchorState, TiedAnchorState, marginalize_root
from fg_nav.online.buffer import PartialWalk, SampleBuffer
from fg_nav.online.field import OnlineField
from fg_nav.online.options import OnlineOptions
from fg_nav.online.resolve import WalkSolution, build_anchor, marginalize_at, solve_alone
from fg_nav.online.solving import Task, WalkSolver
from fg_nav.online.strides import list_variables
from fg_nav.smoother.feet import SolvedFeet, list_footfalls, solve_feet
from fg_nav.smoother.solver import UNSOLVED, list_attitudes

MIN_CELLS = 6  # That tie two feet in progress: the first ones are small, and each foot alone turns by its own drift.


class WalksAlone:
    """The walk of each foot alone as it was solved last, and both in one graph."""

    def __init__(self) -> None:
        self.solvers: dict[Side, FootSolver] = {}
        self.alone: dict[Side, WalkSolution] = {}
        self.both: SolvedFeet | None = None  # As they were solved last; None before.
        self.count = 0  # Number of such solutions.
        self._is_turned = False
        self.is_parted = False  # Whether their clocks are not one any more: each foot is left alone.
        self._joined: Sequence[WalkSolution] = ()

    def find_heading(self, right: WalkSolution, options: OnlineOptions) -> float | None:
        """Return the heading, rad, with which the right foot's walk is to be solved again; None to leave it."""
        left = self.alone.get("left")
        if self._is_turned or self.is_parted or left is None:
            return None
        # Only where the left foot's heading is one that the right foot's field does not show.
        if options.heading_rad is None and left.problem.recording.mag is not None:
            return None
        turn = measure_turns(*(list_footfalls(one.problem, one.solved.values) for one in (right, left)))[1]
        if np.abs(turn).sum() < MIN_TURNS:
            return None
        self._is_turned = True
        start = compute_heading(list_attitudes([0], right.solved.values)[0])
        return float(start + np.angle(np.sum(turn)))

    def join(self) -> SolvedFeet | None:
        """Solve both in one graph; None where they do not show how they lie. Raises `UNSOLVED`."""
        if self.is_parted or len(self.alone) < len(SIDES):
            return None
        pair = self.alone["right"], self.alone["left"]
        if not self._is_turned and pair[0].field is not None and pair[1].field is None:
            return None  # the one shows north, the other does not yet
        if not self._joined or any(one is not other for one, other in zip(pair, self._joined, strict=True)):
            self.both = solve_feet(*(replace(one.problem, values=one.solved.values) for one in pair))
            self._joined, self.count = pair, self.count + 1
        assert self.both is not None
        return self.both if self.both.problem.ties.cells >= MIN_CELLS else None


class FootSolver(WalkSolver):
    """Solves the walk of one foot with that of the other, in this process.

    Parameters
    ----------
    side : which foot it is.
    walks : of both; shared with the other foot's solver.
    """

    def __init__(
        self, side: Side, walks: WalksAlone, options: OnlineOptions, stance: StanceParameters, buffer: SampleBuffer
    ) -> None:
        super().__init__(options, stance, buffer)
        self._side, self._walks = side, walks
        self._walk: PartialWalk | None = None
        self._is_prepared = False
        walks.solvers[side] = self

    def begin(self, task: Task) -> None:
        """As of `WalkSolver`."""
        super().begin(task)
        self._walk, self._is_prepared = None, False

    def prepare(self) -> None:
        """Solve the walk of its task alone, unless that is done, so that the other foot can be joined to it."""
        if self._is_prepared or self._task is None or self._task.start is not None:
            return
        self._is_prepared = True
        with suppress(*UNSOLVED):
            walk, has_ended = super()._collect_walk(self._task), self._task.has_ended
            found = solve_alone(walk, self._options, has_ended)
            # The steps give the right foot its heading, once.
            heading = self._walks.find_heading(found, self._options) if self._side == "right" else None
            if heading is not None:
                self._options = replace(self._options, heading_rad=heading)
                found = solve_alone(walk, self._options, has_ended)
            self._walks.alone[self._side] = found
            self._walk = walk

    def _collect_walk(self, task: Task) -> PartialWalk:
        for solver in self._walks.solvers.values():
            solver.prepare()
        if self._walk is None:
            raise EstimationError(f"the walk of the {self._side} foot has no solution.")
        return self._walk

    def _solve_whole(self, walk: PartialWalk, has_ended: bool) -> AnchorState:
        alone, both = self._walks.alone[self._side], self._walks.join()
        if both is None:
            return build_anchor(walk, self._options, alone, marginalize_at(alone, alone.stances[-1]))
        # The walk of this foot as it is in the graph of both.
        problem, solved = getattr(both.problem, self._side), getattr(both, self._side)
        found = replace(alone, problem=problem, solved=solved)
        if alone.solved_field is not None and problem.field is not None:
            own, field = alone.solved_field
            own = replace(own, problem=problem, solved=solved, states=problem.field.states(solved.values))
            found = replace(found, field=OnlineField(own, field), solved_field=(own, field))
        prior = marginalize_root(solved.root, solved.values, list_variables(found.stances[-1], solved.values))
        return TiedAnchorState(**vars(build_anchor(walk, self._options, found, prior)), number=self._walks.count)
