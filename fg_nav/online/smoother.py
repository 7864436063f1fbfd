"""The online smoother: footfalls in, the estimate of each out, and what is taken back of the past.

    footfall        -> the newest stretch of the walk (`stretch`), in iSAM2: where the foot is now
    now and then    -> the walk so far is solved again beside it (`solving`), footfalls seen in hindsight
    solution        -> handed over at a footfall that was fixed beforehand: a new stretch begins there, the past is
                       revised (`revision`)

The newest stretch is short, so that a footfall costs the same however long the walk; all of the past is in its anchor.
Where it ends is fixed by the count of footfalls alone. So the same calls give the same answers to the bit, and how long
a solution takes makes no difference, unless it takes longer than the footfalls until then. Then a walk whose samples
come as they are walked goes on without it, and takes it over when it is there (`takeover`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fg_nav.arrays import Bools
from fg_nav.detection.causal import Footfall, Seen
from fg_nav.detection.stance import StanceParameters
from fg_nav.errors import EstimationError
from fg_nav.frames import UNKNOWN_RAD
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online.buffer import PartialWalk, ReportedFootfall, SampleBuffer
from fg_nav.online.estimates import EstimateRow, StanceEstimate, Track, build_table
from fg_nav.online.handover import Handover, Past, PathNodes, list_untold, window_anchors
from fg_nav.online.north import extend_with_north
from fg_nav.online.options import OnlineOptions
from fg_nav.online.resolve import solve_from_start
from fg_nav.online.revision import Revision, compare_pasts
from fg_nav.online.schedule import AT_ONCE, DOUBT_DELAY, NEWEST, WINDOW, choose_delay, choose_next, is_windowed
from fg_nav.online.smoother_state import SmootherState
from fg_nav.online.solving import CONTEXT_S, Solver, Task, WalkSolver
from fg_nav.online.stretch import Stretch
from fg_nav.online.takeover import Takeover
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import UNSOLVED
from fg_nav.solution import Return, StanceTable

MAX_LATE = 6  # Footfalls since a solution was due that are added when it is taken over: each takes 10 ms.


class OnlineSmoother:
    """A walk in progress. The same calls give the same answers to the bit, those since a `state` of it too.

    Parameters
    ----------
    options : chosen by the user.
    buffer : of the samples, filled by whoever adds footfalls; with a lag its beginning is discarded here.
    stance, solver : how footfalls are found; solves the walk again beside it, None to do so in between.
    """

    def __init__(
        self,
        options: OnlineOptions,
        buffer: SampleBuffer,
        stance: StanceParameters = StanceParameters(),
        solver: Solver | None = None,
    ) -> None:
        self._options, self._buffer = options, buffer
        self._walk = PartialWalk(buffer, options.use_field, options.axes_given)
        self._takeover = Takeover(WalkSolver(options, stance, buffer) if solver is None else solver, buffer)
        self._stretch: Stretch | None = None
        self._past = Past()
        self._told: list[EstimateRow] = []
        self._told_continues: list[bool] = []
        self._footfalls: list[ReportedFootfall] = []
        self._starts: list[Handover] = []
        self._next = AT_ONCE[-1]
        self._doubted: set[int] = set()
        self._has_mag = False

    def add_footfall(self, footfall: Footfall, until: int, seen: Seen | None = None) -> list[StanceEstimate | Revision]:
        """Add a complete footfall; what is taken back before it, and its estimate.

        Parameters
        ----------
        footfall
            After the one before it.
        until
            Samples of the buffer before this one are used; they reach to the end of the footfall or beyond. Rests are
            found in them.
        seen
            Stances as they are seen by now: a footfall that is none of them is in doubt.

        Raises
        ------
        EstimationError
            With samples or footfalls out of order or not finite, or if the first footfall has no up. Valid input
            never raises, however the person moved.
        """
        # A solution that is due is taken over before the footfall that comes behind it.
        revised = self._take_over() if self._takeover.is_taken(self.n_reported) else []
        told = ReportedFootfall(footfall, self.n_reported, until)
        self._walk.add(told)
        self._footfalls.append(told)
        # The first footfalls are solved as a whole at once; later ones extend the newest stretch.
        if self.n_reported + 1 in AT_ONCE or self._stretch is None:
            revised += self._solve_at_once()
        else:
            self._stretch.add_newest()
        assert self._stretch is not None
        estimate = self._count_north(replace(self._stretch.latest, number=self.n_reported))
        self._told.append(estimate.as_row())
        self._told_continues.append(footfall.continues)
        # The next solution is begun, or asked for where it is due.
        self._schedule(None if seen is None else self._find_doubtful(seen))
        return [*revised, estimate]

    def prepare(self) -> None:
        """Get ready for samples that just came: wait for a solution that is due, where the walk waits for one."""
        self._takeover.start_clock()
        self._takeover.prepare(self.n_reported)

    def begin_end(self) -> None:
        """End the walk, and begin to solve it once more, as far as its samples are there."""
        self._takeover.solver = self._takeover.solver.close()
        if self._stretch is not None:
            self._begin(replace(self._build_task(self._window_start), has_ended=True), delay=0)

    def take_end(self) -> list[StanceEstimate | Revision]:
        """Take that solution over; what this takes back."""
        return [] if self._stretch is None else self._take_over()

    @property
    def n_reported(self) -> int:
        """Number of footfalls that were added."""
        return len(self._told)

    @property
    def latest(self) -> StanceEstimate | None:
        """Of the newest footfall; None before the first."""
        return None if self._stretch is None else replace(self._stretch.latest, number=self.n_reported - 1)

    @property
    def parameters(self) -> SmootherParameters:
        """Those in effect: with the swing noise that was chosen."""
        return self._options.parameters if self._stretch is None else self._stretch.begun.parameters

    @property
    def peak_height(self) -> float:
        """How high clipped peaks of the rate are above the range, in what their flanks say."""
        return self._walk.sensor.peak_height

    @property
    def counts(self) -> dict[str, int]:
        """Factors that were added since the walk began, by kind."""
        return {} if self._stretch is None else self._stretch.counts

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user."""
        return () if self._stretch is None else self._stretch.begun.notes

    @property
    def returns(self) -> tuple[Return, ...]:
        """Stretches at which the walk was before, as the last solution of the whole recognized them."""
        return () if self._stretch is None else self._stretch.begun.returns

    @property
    def wrong_axes(self) -> MagAxes | None:
        """Axes of the magnetometer where they are not the gyroscope's."""
        found = self._walk.sensor.magnetometer
        return None if found is None else found.wrong_axes

    @property
    def footfalls(self) -> list[ReportedFootfall]:
        """Footfalls of the walk as they are taken now, those that `smoothed` has rows of."""
        return self._footfalls

    def causal(self) -> StanceTable:
        """Return one row a line: what `add_footfall` returned at the time."""
        return build_table(self._told)

    @property
    def reported_continues(self) -> Sequence[bool]:
        """Which lines are further pieces of a standing."""
        return self._told_continues

    def smoothed(self) -> StanceTable:
        """Return one row a footfall: the present estimates."""
        return self.solution()[0]

    def solution(self) -> tuple[StanceTable, PathNodes]:
        """Return the present estimates: one row a footfall, and the nodes of the path."""
        past = self._past if self._stretch is None else self._past.join(self._stretch.solve())
        return build_table(past.rows), past.nodes

    def propagate(self, until: int, stands: Bools | None = None) -> Track:
        """Propagate the pose from the last footfall to the sample before `until`; see `Stretch.propagate`.

        Raises
        ------
        EstimationError
            Before the first footfall.
        """
        if self._stretch is None:
            raise EstimationError("there is no footfall yet to carry a pose on from: add one first.")
        return self._stretch.propagate(until, stands)

    @property
    def begun(self) -> Handover | None:
        """What the newest stretch began with; None before the first footfall."""
        return None if self._stretch is None else self._stretch.begun

    @property
    def rows(self) -> tuple[EstimateRow, ...]:
        """All footfalls as they were reported last, in hindsight up to the newest solution."""
        return () if self._stretch is None else (*self._past.rows, *self._stretch.reported)

    @property
    def newest(self) -> EstimateRow | None:
        """The newest line; None before the first."""
        return self._told[-1] if self._told else None

    def resolve_soon(self, footfall: int) -> None:
        """Begin the next solution at this footfall at the latest."""
        self._next = min(self._next, footfall)

    @property
    def anchor_sample(self) -> int:
        """Sample of the footfall with which the newest stretch began; -1 before the first."""
        return self._starts[-1].place.sample if self._starts else -1

    @property
    def takeover(self) -> Takeover:
        """When solutions that were made beside were taken over."""
        return self._takeover

    def state(self) -> SmootherState:
        """Return what `resume` needs, of a walk that has begun: at no cost but that of the lists."""
        return SmootherState(
            told=tuple(self._told),
            reported_continues=tuple(self._told_continues),
            footfalls=tuple(self._footfalls),
            past=self._past,
            starts=tuple(self._starts),
            pending=self._takeover.pending,
            next=self._next,
            doubted=tuple(self._doubted),
            has_mag=self._has_mag,
            discarded=self._walk.discarded,
        )

    def resume(self, state: SmootherState) -> None:
        """Go on where another smoother was, whose samples are in the buffer, as far as they were not discarded."""
        self._told, self._told_continues = list(state.told), list(state.reported_continues)
        self._footfalls, self._past, self._starts = list(state.footfalls), state.past, list(state.starts)
        self._next, self._has_mag = state.next, state.has_mag
        self._doubted = set(state.doubted)
        # The newest stretch is made again of the strides since it began.
        begun = self._starts[-1]
        options, behind = self._options, begun.place.number + 1
        known = self._footfalls[state.discarded : behind]
        self._walk = PartialWalk(
            self._buffer, options.use_field, options.axes_given, state.discarded, known, begun.sensor
        )
        self._stretch = Stretch(begun, self._walk)
        for footfall in self._footfalls[behind:]:
            self._walk.add(footfall)
            self._stretch.add_newest()
        # What was being solved is begun again, on the samples that it and what comes need.
        pending, n, solver = state.pending, self.n_reported, self._takeover.solver
        is_whole = not is_windowed(n + 1, options.lag_s is not None) or (pending and pending.task.start is None)
        solver.discard(self._buffer.first if is_whole else self._find_window())
        solver.follow(self._walk.stop)
        if pending is not None:
            self._takeover.resume(pending, self._footfalls, n)

    def _count_north(self, estimate: StanceEstimate) -> StanceEstimate:
        """Count in what is not known of a north that the field alone shows, or has yet to show."""
        assert self._stretch is not None
        field, begins = self._stretch.field, int(self._footfalls[-1].footfall.start[0])
        if self._options.use_field and not self._has_mag:
            self._has_mag = bool(np.isfinite(self._buffer.between(begins, self._walk.stop)[:, 7]).any())
        shown_by_field = self._has_mag and self.wrong_axes is None
        if self._stretch.begun.heading_known or not (shown_by_field or self._options.fixes):
            return estimate
        sigma = UNKNOWN_RAD if field is None else field.north_sigma
        return replace(estimate, pose_cov=extend_with_north(estimate.pose_cov, estimate.position, sigma))

    def _solve_at_once(self) -> list[StanceEstimate | Revision]:
        """Solve all of the walk; extend the newest stretch where that has no solution."""
        known = self._walk.sensor
        try:
            return [self._take(solve_from_start(self._walk, self._options))]
        except UNSOLVED as error:
            self._walk.sensor = known  # the newest stretch goes on as it began
            if self._stretch is None:
                raise EstimationError(
                    f"the walk has no beginning at footfall {self.n_reported}: leave out the samples before it."
                ) from error
            self._stretch.add_newest()
            return []

    def _take_over(self) -> list[StanceEstimate | Revision]:
        """Take over what was solved beside, unless there is no solution: then the newest stretch goes on."""
        takeover, n = self._takeover, self.n_reported
        assert takeover.pending is not None
        handover, late = takeover.take(n), n - takeover.pending.due_at
        if handover is not None and late > MAX_LATE:
            # Too many footfalls have come since: they are added beside as well.
            takeover.ask(self._footfalls[-late:], n)
            return []
        takeover.pending = None
        try:
            return [] if handover is None else [self._take(handover, self._footfalls[len(self._footfalls) - late :])]
        except UNSOLVED:
            return []

    def _take(self, handover: Handover, since: Sequence[ReportedFootfall] = ()) -> Revision:
        """Begin a new stretch at a handover, with the footfalls since, and take over its past; what this changes."""
        before, first = self._footfalls[handover.first :], handover.first
        old = self.rows
        known, self._walk.sensor = self._walk.sensor, handover.sensor
        self._walk.replace_footfalls(first, handover.footfalls)
        try:
            stretch = Stretch(handover.forget_past(), self._walk)
            for footfall in since:
                self._walk.add(footfall)
                stretch.add_newest()
        except UNSOLVED:
            self._walk.sensor = known
            self._walk.replace_footfalls(first, before)
            raise
        self._stretch = stretch
        self._footfalls[first:] = [*handover.footfalls, *since]
        self._past = self._past.join(handover.past)
        earlier = [] if handover.first == 0 else self._starts
        self._starts = window_anchors(earlier, handover, self._footfalls, self._options.lag_s, WINDOW)
        self._takeover.taken.clear()
        rows = self.rows
        untold = [one.told for one in list_untold(before, self._footfalls[first:])]
        return compare_pasts(old[first:], rows, first, [(told, float(self._told[told].numbers[1])) for told in untold])

    def _find_doubtful(self, seen: Seen) -> int | None:
        """Return the newest footfall that is no stance any more, and was not in doubt before."""
        for k in range(len(self._footfalls) - 2, max(len(self._footfalls) - NEWEST, 0), -1):
            one = self._footfalls[k]
            start, stop = int(one.footfall.start[0]), int(one.footfall.stop[-1])
            if one.footfall.stillest not in self._doubted and seen.lacks(start, stop):
                return k
        return None

    @property
    def _window_start(self) -> Handover | None:
        return self._starts[0] if is_windowed(self.n_reported, self._options.lag_s is not None) else None

    def _schedule(self, doubtful: int | None) -> None:
        """Begin the next solution, or ask for the one that is due behind the newest footfall."""
        n, has_lag, pending = self.n_reported, self._options.lag_s is not None, self._takeover.pending
        self._takeover.solver.follow(self._walk.stop)
        if pending is not None:
            if n == pending.due_at:
                self._takeover.ask(self._footfalls[pending.footfalls :], n)
            return
        if n < AT_ONCE[-1] or (doubtful is None and n < self._next):
            return
        start, delay = self._window_start, choose_delay(n, has_lag)
        if start is not None:
            self._discard()
        if doubtful is None:
            self._next = choose_next(n, has_lag)
        else:
            # One that is in doubt is looked at from the last handover before it, which takes no long.
            self._doubted.add(self._footfalls[doubtful].footfall.stillest)
            before = [one for one in self._starts if one.place.number < doubtful]
            start, delay = (before[-1], DOUBT_DELAY) if before else (start, delay)
        self._begin(self._build_task(start), delay)

    def _begin(self, task: Task, delay: int) -> None:
        """Begin with a task, whose solution is due so many lines later."""
        self._takeover.begin(task, self.n_reported + delay, len(self._footfalls))

    def _build_task(self, start: Handover | None) -> Task:
        footfalls = self._footfalls[0 if start is None else start.place.number :]
        return Task(start, tuple(footfalls), self._walk.sensor)

    def _discard(self) -> None:
        """Discard what lies before the first handover that a window may begin at, samples with a lag alone."""
        since = self._find_window()
        self._takeover.solver.discard(since)
        if self._options.lag_s is not None:
            self._walk.discard(self._starts[0].place.number, since)

    def _find_window(self) -> int:
        """First sample that is needed to begin at the first handover that a window may begin at."""
        begins = self._footfalls[self._starts[0].place.number].footfall.start[0]
        return self._buffer.find_since(self._buffer.stamp(int(begins)) - CONTEXT_S, self._walk.stop)
