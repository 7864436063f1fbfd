"""When a solution that is made beside a walk is taken over: before the line for which it was asked, or later.

it is waited for   where it is made in this process, or samples come faster than they were walked, as from a file:
                   the same samples give the same answers, however fast the machine is
it is not          where they come as they are walked: if it is late the walk goes on without it. Before which line
                   it is taken over hangs on the machine then, and is noted; a walk that is resumed does as noted
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from fg_nav.online.buffer import ReportedFootfall, SampleBuffer
from fg_nav.online.handover import Handover
from fg_nav.online.smoother_state import Pending
from fg_nav.online.solving import Solver, Task

FAST = 2.0  # Times as fast as it was walked: then the samples are of a recording, and nobody watches.


class Takeover:
    """The solution that is being made, and when the ones before were taken over.

    Attributes
    ----------
    solver : makes it.
    pending : what is being solved; None between two solutions.
    taken : numbers of the lines before which one was taken over, or asked for again, since the newest stretch began.
    races : how often it hung on the machine whether one was taken over before a line.
    """

    def __init__(self, solver: Solver, buffer: SampleBuffer) -> None:
        self.solver, self._buffer = solver, buffer
        self.pending: Pending | None = None
        self.taken: list[int] = []
        self.races = 0
        self._clock: tuple[float, float] | None = None
        self._noted: frozenset[int] = frozenset()
        self._noted_until = 0

    def begin(self, task: Task, due_at: int, n_footfalls: int) -> None:
        """Begin with a task on the first footfalls, whose solution is due before line `due_at`."""
        self.solver.begin(task)
        self.pending, self._clock = Pending((due_at,), n_footfalls, task), None

    def ask(self, footfalls: Sequence[ReportedFootfall], line: int) -> None:
        """Ask for the solution at the last of the footfalls that came since, before a line."""
        assert self.pending is not None
        self.solver.ask(footfalls)
        self.pending = self.pending.ask_at(line)

    def resume(self, pending: Pending, footfalls: Sequence[ReportedFootfall], line: int) -> None:
        """Begin again with what was being solved before a line of a walk with these footfalls."""
        self.solver.begin(pending.task)
        self.pending, begins = pending, pending.footfalls
        for due_at in pending.asked:
            if due_at <= line:
                stop = len(footfalls) - line + due_at
                self.solver.ask(footfalls[begins:stop])
                begins = stop

    def note(self, taken: Sequence[int], until: int) -> None:
        """Take note of the lines before which solutions were taken over, of all before line `until`."""
        self._noted, self._noted_until = frozenset(taken), until

    def start_clock(self) -> None:
        """Begin to compare how fast samples come with how fast they were walked, where that has not begun."""
        if self.pending is not None and self._clock is None and self._buffer.stop:
            self._clock = time.monotonic(), self._last_stamp()

    def prepare(self, line: int) -> None:
        """Wait for a solution that is due, where it is waited for: now, and not when a footfall is complete."""
        if self.is_due(line) and self._waits():
            self.solver.wait()

    def is_due(self, line: int) -> bool:
        """Whether a solution was asked for before a line."""
        return self.pending is not None and self.pending.due_at <= line

    def is_taken(self, line: int) -> bool:
        """Decide whether a solution is taken over before a line."""
        if not self.is_due(line):
            return False
        if line < self._noted_until:
            return line in self._noted
        if self._waits():
            return True
        self.races += 1
        return self.solver.is_ready()

    def take(self, line: int) -> Handover | None:
        """Return the solution, before a line; None where the walk has none."""
        self.taken.append(line)
        return self.solver.take()

    def _waits(self) -> bool:
        if self.solver.is_here or self._clock is None:
            return True
        began, stamp = self._clock
        return self._last_stamp() - stamp > FAST * (time.monotonic() - began)

    def _last_stamp(self) -> float:
        return self._buffer.stamp(self._buffer.stop - 1)
