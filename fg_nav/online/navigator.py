"""A walk in progress: samples in blocks of any size, one estimate for each footfall.

    samples -> intake -> buffer -> causal stances -> footfall -> online smoother -> estimate

The smoother uses the samples up to one behind the footfall, so that nothing depends on how the samples came in blocks.
At the end the present estimates of all footfalls are the result, with a path through the nodes of the graph: strapdown
between two nodes, bent to meet the second. With a lag samples are discarded, and the path is known at footfalls only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.detection.causal import CausalStances, Footfall, join_footfalls
from fg_nav.detection.rest import freeze_ends
from fg_nav.detection.stance import Stances
from fg_nav.errors import EstimationError
from fg_nav.magnetic.axes import AlignedMagnetometer, align_magnetometer
from fg_nav.online.buffer import OnlineOptions, SampleBuffer, as_recording
from fg_nav.online.estimates import Revision, StanceEstimate, StrapdownPath, select_rows
from fg_nav.online.resolve import Solver, SolverProcess, WalkSolver, measure_online_field
from fg_nav.online.smoother import OnlineSmoother
from fg_nav.recording import MIN_SAMPLES, Recording
from fg_nav.samples.intake import Intake
from fg_nav.samples.readings import COLUMNS
from fg_nav.smoother import smooth
from fg_nav.smoother.building import mark_returns
from fg_nav.smoother.graph import Trajectory, dense_trajectory
from fg_nav.smoother.solver import UNSOLVED
from fg_nav.solution import Return, Solution, StanceTable

if TYPE_CHECKING:
    from fg_nav.online.pocket import PocketNavigator
    from fg_nav.online.record import GivenLines

METHOD = "online"
ESTIMATORS = "its lines are of iSAM2 on the newest footfalls, its files of the last solution of the whole walk"
SAME_S = 1e-6  # Stamps of a line and of its footfall differ by the digits of a line.
MAX_FREE_S = 3.0  # A stride and the wait for its footfall; a free strapdown is metres off by then.
NO_ROWS = np.empty((0, COLUMNS))


class SampleIntake(ABC):
    """Navigates by samples in blocks of any size.

    `intake` judges them; `lost` is what was lost on the way, as its follower counted.
    """

    def __init__(self, remark: Callable[[str], None]) -> None:
        self.buffer, self.intake = SampleBuffer(), Intake(remark)
        self.lost: Mapping[str, int] = {}
        self.has_ended, self._busy_s = False, 0.0

    def push(
        self, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None, pressure: Floats | None = None
    ) -> list[StanceEstimate | Revision]:
        """Add samples and return the estimates that they complete, and what they take back, in order.

        t, acc, gyr, mag, pressure are (n,) s, (n, 3) m/s^2, (n, 3) rad/s, (n, 3) uT and (n,) Pa, n >= 0; what cannot
        be used is left out (`fg_nav.samples.intake`). Raises `RecordingError` where the first seconds show that a unit
        is wrong, `EstimationError` after the end, and in a pocket where there is no up to begin with.
        """
        if self.has_ended:
            raise EstimationError("this walk has ended: begin a new one for more samples.")
        began = perf_counter()
        field = np.full((len(t), 3), np.nan) if mag is None else mag
        air = np.full(len(t), np.nan) if pressure is None else pressure
        rows = self.intake.push(np.column_stack([t, acc, gyr, field, air]))
        self._busy_s += perf_counter() - began
        return self.add_rows(rows)

    def add_rows(self, rows: Floats) -> list[StanceEstimate | Revision]:
        """Add rows (n, 12) that passed the checks, here or as a recording; return estimates as `push` does."""
        began = perf_counter()
        found = self._add_rows(rows)
        self._busy_s += perf_counter() - began
        return found

    @abstractmethod
    def resume(self, given: GivenLines) -> None:
        """Go on with a walk that gave these lines: `push` takes its samples again, and returns what was not given."""

    @abstractmethod
    def end_replay(self) -> list[StanceEstimate | Revision]:
        """Return what a resumed walk takes back of its lines, with its past, once its samples are there again."""

    @abstractmethod
    def _add_rows(self, rows: Floats) -> list[StanceEstimate | Revision]:
        """Put rows into the buffer, and estimate by them."""

    def _cut_until(self, stop: int, use_mag: bool = True) -> Recording:
        """Cut out the samples before `stop`, with the magnetometer if there is one; `RecordingError` if too few."""
        rows = self.buffer.between(0, stop)
        return as_recording(rows, use_mag and bool(np.isfinite(rows[:, 7:10]).all(axis=1).any()))


class OnlineNavigator(SampleIntake):
    """Navigates while samples come in."""

    def __init__(
        self,
        options: OnlineOptions = OnlineOptions(),
        remark: Callable[[str], None] = lambda words: None,
        background: bool = False,
        solver: Callable[[SampleBuffer], Solver] | None = None,
    ) -> None:
        """Begin a walk; `remark` is given, in a sentence, what is odd about the samples, once for each kind of oddity.

        With `background` the walk is solved again in another process, so that no footfall waits for that. `solver`
        makes the solver of the whole walk, of its samples; None for the walk of one foot.
        """
        super().__init__(remark)
        self.options, self._stances = options, CausalStances()
        if solver is not None:
            self._solver = solver(self.buffer)
        else:
            process = SolverProcess({None: options}) if background else None
            self._solver = Solver(WalkSolver(options, self.buffer), process, remark)
        self.smoother = OnlineSmoother(options, self.buffer, solver=self._solver)
        self._remark, self._waits, self._warned, self._handed = remark, False, False, 0
        self._given: GivenLines | None = None  # While a walk that was resumed comes again,
        self._open: deque[StanceEstimate] = deque()  # those of its lines whose footfalls are still to come.

    @property
    def footfalls(self) -> list[Footfall]:
        """Those of the walk so far, in the order of `smoothed`."""
        return [one.footfall for one in self.smoother.footfalls]

    @property
    def reported_continues(self) -> Sequence[bool]:
        """Which lines are further pieces of a standing."""
        return self.smoother.reported_continues

    def close(self) -> list[StanceEstimate | Revision]:
        """End the walk and return the estimates of the footfalls that were still open, and what its end takes back."""
        return [] if self.has_ended else [*self.begin_end(), *self.smoother.take_end()]

    def begin_end(self) -> list[StanceEstimate | Revision]:
        """End the walk, return the estimates of the footfalls that were still open, and begin its last solution."""
        self.has_ended = True
        found = self._add_rows(self.intake.push(NO_ROWS, at_end=True))
        if self.buffer.stop >= MIN_SAMPLES:
            # A stance of the very last sample alone is none.
            found += self._estimates(f for f in self._stances.finish() if f.start[0] + 1 < self.buffer.stop)
        self.smoother.begin_end()
        return found

    def finish(self) -> Solution:
        """End the walk and return its solution; raises `RecordingError`, `DetectionError` where there was no walk."""
        began = perf_counter()
        self.close()
        stances = join_footfalls(self.footfalls, self.buffer.stop)
        (table, nodes), window = self.smoother.solution(), self.smoother.window
        assert window is not None
        p, is_new = window.initial.parameters, np.array([not footfall.continues for footfall in self.footfalls], bool)
        table = mark_returns(select_rows(table, is_new), self.returns)
        if self.options.lag_s is None:
            recording = self.recording().raise_peaks(self.smoother.walk.sensor.peak_height)
            path, t = dense_trajectory(recording, *nodes, p.gravity), recording.t
            ends = freeze_ends(t, stances, path.position, path.velocity)
        else:
            recording = None
            path, t = Trajectory(table.position, np.zeros_like(table.position), table.nav_R_body), table.t
            ends = (f"the past was corrected for {self.options.lag_s:g} s, and is known at footfalls only",)
        return Solution(
            METHOD,
            t,
            *path,
            stances=table,
            runtime_s=self._busy_s + perf_counter() - began,
            parameters=asdict(p),
            notes=(*window.initial.notes, ESTIMATORS, *ends, *self.intake.notes),
            graph=dict(window.initial.counts),
            moment=select_rows(self.causal(), ~np.array(self.reported_continues, dtype=np.bool_)),
            recording=recording,
            returns=self.returns,
        )

    def polish(self, progress: Callable[[float], None] | None = None, stances: Stances | None = None) -> Solution:
        """End the walk and solve it as a whole in batch; without its field where that fails.

        `stances` are of `recording()`, where they are known. Raises `RecordingError`, `DetectionError`,
        `EstimationError` where there was no walk, with a lag, or where it has no solution.
        """
        self.close()
        recording, options, why = self.recording(), self.options, ""
        aligned = AlignedMagnetometer(recording)
        if options.use_field:
            aligned = align_magnetometer(recording, options.axes_given)
        found_stances = detect_stances(aligned.recording) if stances is None else stances
        measured = measure_online_field(aligned.recording, found_stances, options)
        notes = (*aligned.notes, *measured.notes) if stances is None else ()
        given = measured.recording, found_stances, options.parameters, options.heading_rad, progress
        fixes = tuple(fix for fix in options.fixes if fix.time_s <= recording.t[-1])
        for field in (None,) if measured.field is None else (measured.field, None):
            try:
                found = smooth(*given, field, fixes)
            except UNSOLVED as error:
                why = why or str(error).strip().partition("\n")[0]
                continue
            left_out = (f"the field was left out: {why}",) if why else ()
            return replace(found, notes=(*notes, *found.notes, *left_out))
        raise EstimationError(f"the walk has no batch solution: {why}")

    def recording(self) -> Recording:
        """Return all samples; raises `EstimationError` with a lag, and `RecordingError` if there are too few."""
        if self.options.lag_s is not None:
            raise EstimationError("with a lag the samples of a walk are not kept: leave the lag out.")
        return self._cut_until(self.buffer.stop)

    def pose(self) -> StrapdownPath | None:
        """Return the pose at the last sample, as a path of one row; None before the first footfall.

        Strapdown from the last footfall on. Its error is not bounded: after `MAX_FREE_S` the position is held.
        """
        if not self.smoother.n_reported:
            return None
        longest = self.buffer.stamp(self._handed - 1) + MAX_FREE_S
        until = self.buffer.find_since(longest, self.buffer.stop)
        last = StrapdownPath(*(part[-1:] for part in self.smoother.propagate(until)))
        if until == self.buffer.stop:
            return last
        return last._replace(t=np.array([self.buffer.newest_s]), velocity=np.zeros((1, 3)))

    @property
    def stands(self) -> bool:
        """Whether the foot stands at the last samples, as far as is known."""
        return self._stances.stands

    @property
    def floor(self) -> int | None:
        """Number of the floor of the newest footfall, 0 where the walk began; None where it is not known."""
        latest = self.smoother.latest
        return None if latest is None else latest.floor

    @property
    def returns(self) -> tuple[Return, ...]:
        """Stretches at which the walk was before, as they were recognized when it was last solved as a whole."""
        initial = self.smoother.initial
        return () if initial is None else initial.returns

    def resume(self, given: GivenLines) -> None:
        """See `SampleIntake`."""
        self._given, self._open = given, deque(given.estimates)
        self.smoother.solver.start()

    def end_replay(self) -> list[StanceEstimate | Revision]:
        """See `SampleIntake`."""
        self._pass_given(np.inf)
        return self._solve_given()

    def causal(self) -> StanceTable:
        """Return one row an estimate, as it was reported."""
        return self.smoother.causal()

    def smoothed(self) -> StanceTable:
        """Return one row an estimate, as it is now."""
        return self.smoother.smoothed()

    def push(
        self, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None, pressure: Floats | None = None
    ) -> list[StanceEstimate | Revision]:
        """See `SampleIntake`."""
        with self._solver.pace:
            self.smoother.prepare()
            return super().push(t, acc, gyr, mag, pressure)

    def _add_rows(self, rows: Floats) -> list[StanceEstimate | Revision]:
        self.buffer.append(rows)
        return self._estimates(self._stances.search(rows[:, 0], rows[:, 1:4], rows[:, 4:7]))

    def _estimates(self, footfalls: Iterable[Footfall]) -> list[StanceEstimate | Revision]:
        """Return the estimates of footfalls; a walk begins at the first of them that it can begin at."""
        found: list[StanceEstimate | Revision] = []
        for footfall in footfalls:
            try:
                found += self._add(footfall)
            except EstimationError as error:
                if self.smoother.n_reported:
                    raise
                if not self._waits:
                    self._remark(f"the walk does not begin yet: {error}")
                self._waits = True
                self.smoother = OnlineSmoother(self.options, self.buffer, solver=self._solver)
        return found

    def _add(self, footfall: Footfall) -> list[StanceEstimate | Revision]:
        """Add a footfall, and the samples up to one behind it, to the smoother; return its estimate and revisions."""
        until = min(max(int(footfall.stop[-1]) + 1, MIN_SAMPLES), self.buffer.stop)
        # One that ends with the last of these samples is cut one before it.
        stop = np.minimum(footfall.stop, until - 1)
        inside = footfall.start < stop
        footfall = replace(
            footfall,
            start=footfall.start[inside],
            stop=stop[inside],
            threshold=footfall.threshold[inside],
            stillest=min(footfall.stillest, until - 2),
        )
        self._handed, found = until, list[StanceEstimate | Revision]()
        if self._given is not None:
            # Of a resumed walk: one whose line was given, or the first behind these.
            t = self.buffer.stamp(footfall.stillest)
            self._pass_given(t - SAME_S)
            if self._open:
                self._pass_given(t + SAME_S, footfall, until)
                return [] if self._open else self._solve_given()
            found = self._solve_given()
        footfall = replace(footfall, continues=footfall.continues and self.smoother.n_reported > 0)
        found += self.smoother.add_footfall(footfall, until, self._stances.seen)
        if self.smoother.wrong_axes is not None and not self._warned:
            self._remark(self.smoother.wrong_axes.warning)
            self._warned = True
        return found

    def _pass_given(self, t: float, footfall: Footfall | None = None, until: int = 0) -> None:
        """Pass the given lines up to a stamp, s, on to the smoother: with their footfall, or as those of none."""
        while self._given is not None and self._open and self._open[0].t < t:
            line = self._open.popleft()
            continues = self._given.continues[line.number]
            is_gone = footfall is None or line.number in self._given.retracted
            self.smoother.add_given(line, continues, None if is_gone else footfall, until)

    def _solve_given(self) -> list[StanceEstimate | Revision]:
        """Solve the walk whose lines were given; return its past, and which of them have no footfall."""
        given, self._given = self._given, None
        return [self.smoother.solve_given(given)] if given is not None and given.estimates else []


def finish_walk(
    navigator: OnlineNavigator | PocketNavigator,
    polish: bool,
    progress: Callable[[float], None] | None = None,
    stances: Stances | None = None,
) -> Solution:
    """End a walk; with `polish` its batch solution stands next to it, as `polished`, or a note why there is none."""
    found = navigator.finish()
    if not polish:
        return found
    try:
        return replace(found, polished=navigator.polish(progress, stances))
    except EstimationError as error:
        return replace(found, notes=(*found.notes, str(error)))
