"""When a walk in progress is solved again, and when that solution takes effect.

A walk is solved again by the count of its footfalls alone (table in docs/online.md). One of n footfalls takes some
n / 250 s, a footfall one second: the solution takes effect two footfalls later, and one more for each 200 of the walk.
It is waited for where it is solved in this process, or samples come faster than they were walked. Where they come as
they are walked it takes effect once it is there; before which line is recorded, and a resumed walk follows the record.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fg_nav.online.anchor import AnchorState, Past
from fg_nav.online.background import Solver
from fg_nav.online.buffer import ReportedFootfall, SampleBuffer
from fg_nav.online.estimates import EstimateRow
from fg_nav.online.solving import Task

AT_ONCE = (1, 2, 3, 4, 6, 8, 10)  # Footfalls at which all is solved at once: a tenth of a second.
WHOLE_UNTIL, WHOLE_WITH_LAG = 2000, 512  # The last footfall at which all is solved; with a lag, samples go then.
WINDOW = 256  # Footfalls that are solved again behind it.
NEWEST = 20  # Footfalls that are checked for one in doubt: those of the last 20 s, in which stances are searched.
DOUBT_DELAY = 3  # Footfalls until a solution for one in doubt takes effect.
FAST = 2.0  # Times as fast as it was walked: then the samples are of a recording, and nobody watches.


def is_windowed(n: int, has_lag: bool) -> bool:
    """Whether a walk of n footfalls is not solved as a whole any more."""
    return n > (WHOLE_WITH_LAG if has_lag else WHOLE_UNTIL)


def choose_next(n: int, has_lag: bool) -> int:
    """Return the footfall behind n, after the first ones, at which the walk is solved next."""
    return n + (WINDOW // 8 if is_windowed(n, has_lag) else max(8, n // 12))


def choose_delay(n: int, has_lag: bool) -> int:
    """Return how many footfalls behind n a solution of n footfalls takes effect."""
    return 2 + (WINDOW if is_windowed(n, has_lag) else n) // 200


@dataclass(frozen=True)
class Pending:
    """A solution in progress."""

    asked: tuple[int, ...]  # Lines before which it is requested, each time with the footfalls up to there.
    footfalls: int  # Number of footfalls of the task.
    task: Task

    @property
    def due_at(self) -> int:
        """The last of these lines: it takes effect there, or later."""
        return self.asked[-1]


@dataclass(frozen=True)
class SmootherState:
    """All that a smoother needs to resume, besides the samples; immutable."""

    told: tuple[EstimateRow, ...]
    reported_continues: tuple[bool, ...]
    footfalls: tuple[ReportedFootfall, ...]
    past: Past
    starts: tuple[AnchorState, ...]  # The newest window begins at the newest of them.
    pending: Pending | None
    next: int
    doubted: tuple[int, ...]
    has_mag: bool
    discarded: int  # Number of footfalls without samples.


class ResolveSchedule:
    """The pending solution, and when those before took effect."""

    def __init__(self, solver: Solver, buffer: SampleBuffer) -> None:
        self.solver, self._buffer = solver, buffer
        self.pending: Pending | None = None  # None between two.
        self.taken: list[int] = []  # Lines before which one took effect, or was requested again, in the newest window.
        self.races = 0  # Number of decisions that depended on solver timing.
        self._clock: tuple[float, float] | None = None  # time.monotonic() and stamp, s, when the solution was begun
        self.recorded: frozenset[int] = frozenset()  # Of a resumed walk, lines before which solutions took effect,
        self.recorded_until = 0  # of those before this one.

    def begin(self, task: Task, due_at: int, n_footfalls: int) -> None:
        """Begin a task on the first footfalls, whose solution is due before line `due_at`."""
        self.solver.begin(task)
        self.pending, self._clock = Pending((due_at,), n_footfalls, task), None

    def request(self, footfalls: Sequence[ReportedFootfall], line: int) -> None:
        """Request the anchor state at the last of `footfalls`, those since the task or last request, before a line."""
        assert self.pending is not None
        self.solver.request(footfalls)
        if line != self.pending.due_at:
            self.pending = replace(self.pending, asked=(*self.pending.asked, line))

    def resume(self, pending: Pending, footfalls: Sequence[ReportedFootfall], line: int) -> None:
        """Restart the `pending` solution of a resumed walk, which has these footfalls before line `line`."""
        self.solver.begin(pending.task)
        self.pending, begins = pending, pending.footfalls
        for due_at in pending.asked:
            if due_at <= line:
                stop = len(footfalls) - line + due_at
                self.solver.request(footfalls[begins:stop])
                begins = stop

    def prepare(self, line: int) -> None:
        """Wait for a solution that is due, where it is waited for: now, and not when a footfall is complete."""
        if self.pending is not None and self._clock is None and self._buffer.stop:
            self._clock = time.monotonic(), self._buffer.stamp(self._buffer.stop - 1)
        if self._is_due(line) and self._waits():
            self.solver.wait()

    def is_taken(self, line: int) -> bool:
        """Decide whether a solution takes effect before a line."""
        if not self._is_due(line):
            return False
        if line < self.recorded_until:
            return line in self.recorded
        if self._waits():
            return True
        self.races += 1
        return self.solver.is_ready()

    def _is_due(self, line: int) -> bool:
        return self.pending is not None and self.pending.due_at <= line

    def _waits(self) -> bool:
        """Whether the walk waits for a solution that is due."""
        if self.solver.is_here or self._clock is None:
            return True
        began, stamp = self._clock
        return self._buffer.stamp(self._buffer.stop - 1) - stamp > FAST * (time.monotonic() - began)
