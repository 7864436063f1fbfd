"""The online smoother: footfalls in, the estimate of each out, and revisions of the past.

    footfall         -> the newest window of the walk, in iSAM2 (`window`): where the foot is now
    by the schedule  -> the walk so far is solved again in the background (`resolve`), its footfalls reviewed
    anchor state     -> takes effect at a footfall that was fixed beforehand: a new window begins there, and the past is
                        revised (`estimates.Revision`)

Where the newest window ends, and when the walk is solved again (table in docs/online.md), is fixed by the count of
footfalls alone, so the same calls give the same answers to the bit. A solution is waited for where it is solved in this
process, or the walk spends less than half of its time waiting for samples: those of a recording. Where they come as
they are walked it takes effect once it is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fg_nav.detection.causal import Footfall, Seen
from fg_nav.errors import EstimationError
from fg_nav.frames import UNKNOWN_RAD
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online.buffer import OnlineOptions, PartialWalk, ReportedFootfall, SampleBuffer
from fg_nav.online.estimates import (
    EstimateRow,
    Past,
    PathNodes,
    Revision,
    StanceEstimate,
    StrapdownPath,
    build_table,
    compare_pasts,
)
from fg_nav.online.field import extend_with_north
from fg_nav.online.resolve import CONTEXT_S, Solver, Task, WalkSolver, solve_from_start
from fg_nav.online.window import AnchorState, Window
from fg_nav.smoother.solver import UNSOLVED
from fg_nav.solution import StanceTable

if TYPE_CHECKING:
    from fg_nav.online.record import GivenLines

AT_ONCE = (1, 2, 3, 4, 6, 8, 10)  # Footfalls at which all is solved at once: a tenth of a second.
WHOLE_UNTIL, WHOLE_WITH_LAG = 2000, 512  # The last footfall at which all is solved; with a lag, samples go then.
WINDOW = 256  # Footfalls that are solved again behind it.
NEWEST = 20  # Footfalls that are checked for one in doubt: those of the last 20 s, in which stances are searched.
DOUBT_DELAY = 3  # Footfalls until a solution for one in doubt takes effect.
FAST = 2.0  # Seconds walked in one second of waiting for samples: then they are of a recording, and nobody watches.
MAX_LATE = 6  # Footfalls that are added when a late solution takes effect: each takes 10 ms.


def is_windowed(n: int, has_lag: bool) -> bool:
    """Whether a walk of n footfalls is not solved as a whole any more."""
    return n > (WHOLE_WITH_LAG if has_lag else WHOLE_UNTIL)


def choose_next(n: int, has_lag: bool) -> int:
    """Return the footfall behind n, after the first ones, at which the walk is solved next."""
    return n + (WINDOW // 8 if is_windowed(n, has_lag) else max(8, n // 12))


def choose_delay(n: int, has_lag: bool) -> int:
    """Return how many footfalls behind n a solution of n takes effect: it takes n / 250 s, a footfall one second."""
    return 2 + (WINDOW if is_windowed(n, has_lag) else n) // 200


@dataclass(frozen=True)
class Pending:
    """A solution in progress: the line before which it takes effect, or later, and the number of its footfalls."""

    due_at: int
    footfalls: int


class OnlineSmoother:
    """A walk in progress, by the samples of a buffer that the caller fills; solved here without a `solver`."""

    def __init__(self, options: OnlineOptions, buffer: SampleBuffer, solver: Solver | None = None) -> None:
        self._options, self._buffer, self._has_lag = options, buffer, options.lag_s is not None
        self.walk = PartialWalk(buffer, options)
        self.solver = Solver(WalkSolver(options, buffer)) if solver is None else solver
        self.pending: Pending | None = None  # None between two solutions.
        self._clock: tuple[float, float] | None = None  # time idle and stamp, s, when the pending one was begun
        self.window: Window | None = None
        self._past = Past()
        self.reported: list[EstimateRow] = []  # all lines, as they were given out
        self.reported_continues: list[bool] = []
        self.footfalls: list[ReportedFootfall] = []  # as reviewed by now: those that `smoothed` has rows of
        self.anchors: list[AnchorState] = []  # at which a window may begin, the newest that of `window`
        self._next = AT_ONCE[-1]  # number of lines at which the next solution is begun
        self._doubted: set[int] = set()  # stillest samples of footfalls that were in doubt
        self._has_mag = False

    def add_footfall(self, footfall: Footfall, until: int, seen: Seen | None = None) -> list[StanceEstimate | Revision]:
        """Add a complete footfall; return the revision before it, if there is one, and its estimate.

        Samples of the buffer before `until` are used, to the end of the footfall or more; a footfall that is none of
        the stances `seen` by now is in doubt. Raises `EstimationError` with samples or footfalls out of order or not
        finite, or if the first footfall has no up.
        """
        # A solution that is due takes effect before the footfall that comes behind it.
        is_due = self.pending is not None and self.pending.due_at <= self.n_reported
        revised = self._apply_solution() if is_due and (self._waits() or self.solver.is_ready()) else []
        reported = ReportedFootfall(footfall, self.n_reported, until)
        self.walk.add(reported)
        self.footfalls.append(reported)
        # The first footfalls are solved as a whole at once; later ones extend the newest window.
        if self.window is None:
            self.solver.start()
        if self.n_reported + 1 in AT_ONCE or self.window is None:
            revised += self._solve_at_once()
        else:
            self.window.add_newest()
        assert self.window is not None
        estimate = replace(self.window.latest, number=self.n_reported)
        # North by field or fixes, not given: its error turns the walk as a whole; no factor has it, it is added here.
        if self._options.use_field and not self._has_mag:
            begins = int(self.footfalls[-1].footfall.start[0])
            self._has_mag = bool(np.isfinite(self._buffer.between(begins, self.walk.stop)[:, 7]).any())
        shown_by_field = self._has_mag and self.wrong_axes is None
        if (shown_by_field or self._options.fixes) and not self.window.initial.heading_known:
            field = self.window.field
            sigma = UNKNOWN_RAD if field is None else field.north_sigma
            estimate = replace(estimate, pose_cov=extend_with_north(estimate.pose_cov, estimate.position, sigma))
        self.reported.append(estimate.as_row())
        self.reported_continues.append(footfall.continues)
        # The newest footfall that hindsight detects as no stance any more, unless it was in doubt before.
        doubtful = None
        if seen is not None:
            for k in range(len(self.footfalls) - 2, max(len(self.footfalls) - NEWEST, 0), -1):
                one = self.footfalls[k].footfall
                if one.stillest not in self._doubted and seen.lacks(int(one.start[0]), int(one.stop[-1])):
                    doubtful = k
                    break
        # The next solution is begun, or requested where it is due.
        self._schedule_solution(doubtful)
        return [*revised, estimate]

    def add_given(self, line: StanceEstimate, continues: bool, footfall: Footfall | None, until: int) -> None:
        """Add a line that was given before the walk was interrupted; its footfall is None where it was none.

        Samples of the buffer before `until` are used with it; `solve_given` follows the last one.
        """
        if footfall is not None:
            reported = ReportedFootfall(replace(footfall, continues=continues), self.n_reported, until)
            self.walk.add(reported)
            self.footfalls.append(reported)
        self.reported.append(line.as_row(None if footfall is None else footfall.stillest))
        self.reported_continues.append(continues)

    def solve_given(self, lines: GivenLines) -> Revision:
        """Solve the walk of the lines that were given; return its past, and which of them have no footfall.

        Where it has no solution, the longest beginning that has one is solved, and the rest added to it. Raises
        `EstimationError` where there is none.
        """
        given, sensor, first = tuple(self.footfalls), self.walk.sensor, self._buffer.first
        rows = [lines.estimates[one.line].turn(lines.turns[one.line]).as_row(one.footfall.stillest) for one in given]
        self._past = Past(0, tuple(rows))
        solver = WalkSolver(self._options, self._buffer)
        nothing = Revision(float(self.reported[-1].numbers[1]), 0.0, (), np.empty((0, 4)))
        stop, revision = len(given), None if given else nothing
        while stop and revision is None:
            anchor = solver.run(Task(None, given[:stop], sensor, first))
            if anchor is not None:
                with suppress(*UNSOLVED):
                    revision = self._begin_window(anchor, given[stop:])
            stop //= 2
        if revision is None:
            raise EstimationError("the walk so far has no solution: begin a new one.")
        self._next = max(AT_ONCE[-1], choose_next(len(given), self._has_lag))
        kept = {one.line for one in given}
        gone = [k for k in range(self.n_reported) if k not in kept and k not in lines.retracted]
        lost = [(k, float(self.reported[k].numbers[1])) for k in gone]
        return replace(revision, retracted=tuple(sorted((*lost, *revision.retracted))))

    def begin_end(self) -> None:
        """End the walk, and begin to solve it once more, as far as its samples are there."""
        self.solver.close()
        if self.window is not None:
            start = self.anchors[0] if is_windowed(self.n_reported, self._has_lag) else None
            self._begin_solution(start, 0, has_ended=True)

    def take_end(self) -> list[StanceEstimate | Revision]:
        """Apply the last solution; return the revision, if any."""
        return [] if self.window is None else self._apply_solution()

    def prepare(self) -> None:
        """Wait for a solution that is due, where it is waited for: now, and not when a footfall is complete."""
        if self.pending is not None and self._clock is None and self._buffer.stop:
            self._clock = self.solver.pace.idle_s, self._buffer.newest_s
        if self.pending is not None and self.pending.due_at <= self.n_reported and self._waits():
            self.solver.take()

    @property
    def n_reported(self) -> int:
        """Number of footfalls that were added."""
        return len(self.reported)

    @property
    def latest(self) -> StanceEstimate | None:
        """Estimate of the newest footfall; None before the first."""
        return None if self.window is None else replace(self.window.latest, number=self.n_reported - 1)

    @property
    def initial(self) -> AnchorState | None:
        """Anchor state of the newest window; None before the first footfall."""
        return None if self.window is None else self.window.initial

    @property
    def wrong_axes(self) -> MagAxes | None:
        """Axes of the magnetometer where they are not the gyroscope's."""
        found = self.walk.sensor.magnetometer
        return None if found is None else found.wrong_axes

    @property
    def rows(self) -> tuple[EstimateRow, ...]:
        """All footfalls as they were reported last, in hindsight up to the newest solution."""
        return self._past.rows if self.window is None else (*self._past.rows, *self.window.reported)

    def causal(self) -> StanceTable:
        """Return one row a line: what `add_footfall` returned at the time."""
        return build_table(self.reported)

    def smoothed(self) -> StanceTable:
        """Return one row a footfall: the present estimates."""
        return self.solution()[0]

    def solution(self) -> tuple[StanceTable, PathNodes]:
        """Return the present estimates: one row a footfall, and the nodes of the path."""
        past = self._past if self.window is None else self._past.join(self.window.solve())
        return build_table(past.rows), past.nodes

    def propagate(self, until: int) -> StrapdownPath:
        """Propagate the pose from the last footfall to before `until`; raises `EstimationError` before the first."""
        if self.window is None:
            raise EstimationError("there is no footfall yet to carry a pose on from: add one first.")
        return self.window.propagate(until)

    def resolve_soon(self, footfall: int) -> None:
        """Begin the next solution at this footfall at the latest."""
        self._next = min(self._next, footfall)

    def _waits(self) -> bool:
        """Return whether the walk waits for a solution that is due."""
        if self.solver.is_here or self._clock is None:
            return True
        idle_s, stamp = self._clock
        return self._buffer.newest_s - stamp > FAST * (self.solver.pace.idle_s - idle_s)

    def _solve_at_once(self) -> list[StanceEstimate | Revision]:
        """Solve the whole walk and return the revision; where that fails extend the newest window and return none."""
        known = self.walk.sensor
        try:
            return [self._begin_window(solve_from_start(self.walk, self._options))]
        except UNSOLVED as error:
            self.walk.sensor = known  # the newest window goes on as it began
            if self.window is None:
                raise EstimationError(
                    f"the walk has no beginning at footfall {self.n_reported}: leave out the samples before it."
                ) from error
            self.window.add_newest()
            return []

    def _apply_solution(self) -> list[StanceEstimate | Revision]:
        """Apply the solution that is due, return the revision; none if it failed or is late: the window goes on."""
        assert self.pending is not None
        anchor, late = self.solver.take(), self.n_reported - self.pending.due_at
        if anchor is not None and late > MAX_LATE:
            # Too many footfalls have come since: they are added in the background as well.
            self.solver.request(self.footfalls[-late:])
            self.pending = replace(self.pending, due_at=self.n_reported)
            return []
        self.pending = None
        try:
            return [] if anchor is None else [self._begin_window(anchor, self.footfalls[len(self.footfalls) - late :])]
        except UNSOLVED:
            return []

    def _begin_window(self, anchor: AnchorState, since: Sequence[ReportedFootfall] = ()) -> Revision:
        """Begin a window at an anchor state, with the footfalls since, and adopt its past; return the revision."""
        first, before, old = anchor.first, self.footfalls[anchor.first :], self.rows
        known, self.walk.sensor = self.walk.sensor, anchor.sensor
        self.walk.replace_footfalls(first, anchor.footfalls)
        try:
            window = Window(anchor.without_past(), self.walk)
            window.extend(since)
        except UNSOLVED:
            self.walk.sensor = known
            self.walk.replace_footfalls(first, before)
            raise
        self.window = window
        self.footfalls[first:] = [*anchor.footfalls, *since]
        self._past = self._past.join(anchor.past)
        earlier = [] if first == 0 else self.anchors
        self.anchors = window_anchors(earlier, anchor, self.footfalls, self._options.lag_s, WINDOW)
        # Lines whose footfalls are none any more are retracted.
        kept = {one.line for one in self.footfalls[first:]}
        lost = [one.line for one in before if one.line >= 0 and one.line not in kept]
        return compare_pasts(old[first:], self.rows, first, [(k, float(self.reported[k].numbers[1])) for k in lost])

    def _schedule_solution(self, doubtful: int | None) -> None:
        """Begin the next solution, soon for footfall `doubtful` (None without), or request the one that is due."""
        n, pending = self.n_reported, self.pending
        if pending is not None:
            if n == pending.due_at:
                self.solver.request(self.footfalls[pending.footfalls :])
            return
        if n < AT_ONCE[-1] or (doubtful is None and n < self._next):
            return
        start, delay = self.anchors[0] if is_windowed(n, self._has_lag) else None, choose_delay(n, self._has_lag)
        if start is not None and self._has_lag:
            # What lies before the first anchor state is needed no more.
            self.walk.discard(start.stance.number, self._find_needed(start))
        if doubtful is None:
            self._next = choose_next(n, self._has_lag)
        else:
            # One that is in doubt is checked from the last anchor state before it, which is quick.
            self._doubted.add(self.footfalls[doubtful].footfall.stillest)
            before = [one for one in self.anchors if one.stance.number < doubtful]
            start, delay = (before[-1], DOUBT_DELAY) if before else (start, delay)
        self._begin_solution(start, delay)

    def _begin_solution(self, start: AnchorState | None, delay: int, has_ended: bool = False) -> None:
        """Begin a solution from an anchor state, or of the whole walk, which is due so many lines later."""
        footfalls = self.footfalls[0 if start is None else start.stance.number :]
        self.solver.begin(Task(start, tuple(footfalls), self.walk.sensor, self._find_needed(start), has_ended))
        self.pending, self._clock = Pending(self.n_reported + delay, len(self.footfalls)), None

    def _find_needed(self, start: AnchorState | None) -> int:
        """Return the number of the first sample that a solution from `start`, and later solutions, need."""
        if start is None or not is_windowed(self.n_reported, self._has_lag):
            return self._buffer.first
        # Later ones may begin at the oldest anchor.
        oldest = self.footfalls[self.anchors[0].stance.number].footfall
        return self._buffer.find_since(self._buffer.stamp(int(oldest.start[0])) - CONTEXT_S, self.walk.stop)


def window_anchors(
    earlier: Sequence[AnchorState],
    newest: AnchorState,
    footfalls: Sequence[ReportedFootfall],
    lag_s: float | None,
    window: int,
) -> list[AnchorState]:
    """Return the anchor states to keep: from the last that is a window of footfalls, or a lag, back, up to `newest`.

    Those behind a footfall that was retracted or inserted are invalid, and left out.
    """
    valid = []
    for one in earlier:
        at = footfalls[one.stance.number : one.stance.number + 1]
        if at and at[0].footfall.stillest == one.stance.sample:
            valid.append(one)
    anchors, stance = [*valid, newest.without_past()], newest.stance
    if lag_s is None:
        enough = sum(stance.number - one.stance.number >= window for one in anchors)
    else:
        enough = sum(stance.t - one.stance.t >= lag_s for one in anchors)
    return anchors[max(enough - 1, 0) :]
