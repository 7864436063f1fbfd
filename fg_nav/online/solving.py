"""The walk so far is solved again while it goes on: what is asked, and what comes of it.

    Task                  -> footfalls in hindsight (`review`) -> solution of all of them (`resolve`), or of those since
                             an earlier handover (`stretch`)
    footfalls meanwhile   -> added to it
    hand_over             -> Handover at the newest of these

`WalkSolver` does it in this process, when the handover is due; `beside` in another, meanwhile. Both answer the same,
to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from fg_nav.detection.stance import StanceParameters
from fg_nav.online.buffer import PartialWalk, ReportedFootfall, SampleBuffer, SensorState, as_recording
from fg_nav.online.handover import Handover
from fg_nav.online.options import OnlineOptions
from fg_nav.online.resolve import solve_from_start
from fg_nav.online.review import review_footfalls
from fg_nav.online.stretch import Stretch
from fg_nav.smoother.solver import UNSOLVED

CONTEXT_S = 20.0
"""Before a handover, in which the stances behind it are detected, and levels at which sensors clip are seen."""


@dataclass(frozen=True)
class Task:
    """A walk to be solved.

    Attributes
    ----------
    start : handover to begin at, without its past; None for the start of the walk.
    footfalls : from that of the handover on.
    sensor : what the walk shows of it so far.
    has_ended : whether nothing follows.
    """

    start: Handover | None
    footfalls: tuple[ReportedFootfall, ...]
    sensor: SensorState
    has_ended: bool = False


class Solver(Protocol):
    """Solves a walk again while it goes on; `is_here` where it does so in this process."""

    is_here: bool

    def follow(self, until: int) -> None:
        """Take note of the samples of the walk before this one."""

    def discard(self, before: int) -> None:
        """Discard samples that no task needs any more."""

    def begin(self, task: Task) -> None:
        """Begin with a task, all samples of whose footfalls are there."""

    def ask(self, footfalls: Sequence[ReportedFootfall]) -> None:
        """Ask for the handover at the last of these footfalls, which came since the task, or since it was asked for."""

    def is_ready(self) -> bool:
        """Whether it is there."""

    def wait(self) -> None:
        """Wait until it is there."""

    def take(self) -> Handover | None:
        """Return it, as soon as it is there; None where the walk has no solution."""

    def close(self) -> Solver:
        """Give up what it holds; return who solves in this process from then on."""


class WalkSolver:
    """Solves in this process, when a handover is waited for."""

    is_here = True

    def __init__(self, options: OnlineOptions, stance: StanceParameters, buffer: SampleBuffer) -> None:
        self._options, self._stance, self._buffer = options, stance, buffer
        self._task: Task | None = None
        self._asked: list[Sequence[ReportedFootfall]] = []
        self._solved: tuple[Handover, PartialWalk] | None = None
        self._is_done = False

    def follow(self, until: int) -> None:
        """Nothing: the buffer is its owner's."""

    def discard(self, before: int) -> None:
        """Nothing: the buffer is its owner's."""

    def begin(self, task: Task) -> None:
        """See `Solver`."""
        self._task, self._asked, self._solved, self._is_done = task, [], None, False

    def ask(self, footfalls: Sequence[ReportedFootfall]) -> None:
        """See `Solver`."""
        self._asked.append(footfalls)
        self._is_done = False

    def is_ready(self) -> bool:
        """See `Solver`."""
        return self._is_done

    def wait(self) -> None:
        """See `Solver`."""
        if self._is_done:
            return
        assert self._task is not None
        try:
            solved, walk = self.solve(self._task) if self._solved is None else self._solved
            for footfalls in self._asked:
                solved = self.go_on(solved, walk, footfalls)
            self._solved = solved, walk
        except UNSOLVED:
            self._solved = None
        self._asked, self._is_done = [], True

    def take(self) -> Handover | None:
        """See `Solver`."""
        self.wait()
        return None if self._solved is None else self._solved[0]

    def close(self) -> Solver:
        """Nothing to give up."""
        return self

    def solve(self, task: Task) -> tuple[Handover, PartialWalk]:
        """Solve a task; return the walk too."""
        options, start = self._options, task.start
        if start is None:
            walk = self._collect_walk(task)
            return self._solve_whole(walk, task.has_ended), walk
        footfalls = self._review(task)
        begun = footfalls[:1]
        walk = PartialWalk(self._buffer, options.use_field, options.axes_given, start.place.number, begun, start.sensor)
        stretch = Stretch(replace(start, footfalls=begun, first=start.place.number), walk)
        for footfall in footfalls[1:]:
            walk.add(footfall)
            stretch.add_newest()
        return stretch.hand_over(), walk

    def go_on(self, solved: Handover, walk: PartialWalk, footfalls: Sequence[ReportedFootfall]) -> Handover:
        """Return the handover at the last of the footfalls that came since."""
        if not footfalls:
            return solved
        stretch = Stretch(solved, walk)
        for footfall in footfalls:
            walk.add(footfall)
            stretch.add_newest()
        return stretch.hand_over()

    def _collect_walk(self, task: Task) -> PartialWalk:
        """Collect the walk of a task that begins at its start."""
        walk = PartialWalk(self._buffer, self._options.use_field, self._options.axes_given, sensor=task.sensor)
        for footfall in self._review(task):
            walk.add(footfall)
        return walk

    def _solve_whole(self, walk: PartialWalk, has_ended: bool) -> Handover:
        """Solve all of a walk."""
        return solve_from_start(walk, self._options, has_ended)

    def _review(self, task: Task) -> tuple[ReportedFootfall, ...]:
        """See the footfalls of a task in hindsight, but the one that it begins with."""
        begins, until = 0, task.footfalls[-1].until
        if task.start is not None:
            stamp = self._buffer.stamp(int(task.footfalls[0].footfall.start[0]))
            begins = self._buffer.find_since(stamp - CONTEXT_S, until)
        rows = self._buffer.between(begins, until)
        recording = as_recording(rows, with_mag=False)
        if task.start is None:
            return tuple(review_footfalls(recording, begins, task.footfalls, self._stance))
        first, *later = task.footfalls
        seen = review_footfalls(recording, begins, later, self._stance)
        ends = int(first.footfall.stop[-1])
        return (first, *(one for one in seen if one.footfall.start[0] >= ends))
