"""A walk in progress: samples in blocks of any size, one estimate for each footfall.

    samples -> judge -> buffer -> causal stances -> footfall -> online smoother -> estimate

The smoother uses the samples up to one behind the footfall, so that nothing depends on how the samples came in blocks.
An estimate is that of the moment when the footfall was complete, and is reported once; `smoothed` returns the present
estimates of all of them. At the end these are the result, with a path through the nodes of the graph. Where it is asked
for, the whole walk is solved once more as well: stances and field are detected in all samples, as for a recording, and
the batch smoother solves it (`polish`).

With a lag the samples are discarded once no stride needs them, and the path is known at footfalls only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.detection import detect_stances
from fg_nav.detection.causal import CausalParameters, CausalStances, Footfall, join_footfalls
from fg_nav.errors import EstimationError
from fg_nav.magnetic.axes import AlignedMagnetometer, align_magnetometer
from fg_nav.online.beside import WorkerSolver
from fg_nav.online.buffer import SampleBuffer
from fg_nav.online.estimates import StanceEstimate, Track, select_rows
from fg_nav.online.intake import SampleIntake
from fg_nav.online.judge import SampleFilter
from fg_nav.online.options import OnlineOptions
from fg_nav.online.path import build_path
from fg_nav.online.resolve import measure_walk_field
from fg_nav.online.revision import Revision
from fg_nav.online.smoother import OnlineSmoother
from fg_nav.online.smoother_state import SmootherState
from fg_nav.online.solving import Solver
from fg_nav.recording import MIN_SAMPLES, Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.dense_path import Trajectory
from fg_nav.smoother.places import mark_returns
from fg_nav.smoother.solver import UNSOLVED
from fg_nav.solution import Return, Solution, StanceTable
from fg_nav.stances import Stances

if TYPE_CHECKING:
    from fg_nav.online.pocket import PocketNavigator

METHOD = "online"

SolverMaker: TypeAlias = Callable[[SampleBuffer], Solver]

MAX_FREE_S = 3.0  # A stride and the wait for its footfall; a free strapdown is metres off by then.


@dataclass(frozen=True)
class NavigatorState:
    """All that a navigator needs to go on behind the sample before `stop`; what is in it does not change any more.

    `handed` samples were given to the smoother; `waits` and `warned` say what was remarked.
    """

    stop: int
    smoother: SmootherState
    stances: CausalStances
    handed: int
    waits: bool
    warned: bool
    has_ended: bool
    busy_s: float


class OnlineNavigator(SampleIntake):
    """Navigates while samples come in.

    Attributes
    ----------
    options : of the smoother.
    detection : how footfalls are found.
    """

    def __init__(
        self,
        options: OnlineOptions = OnlineOptions(),
        remark: Callable[[str], None] = lambda words: None,
        detection: CausalParameters = CausalParameters(),
        judge: SampleFilter | None = None,
        beside: bool = False,
        solver: SolverMaker | None = None,
    ) -> None:
        """Begin a walk.

        Parameters
        ----------
        options, detection : of the smoother; how footfalls are found.
        remark : given, in a sentence, what is odd about the samples; once for each kind of oddity.
        judge : of the samples, where a walk is resumed.
        beside : whether it is solved again in another process, so that no footfall waits for that.
        solver : makes what solves it again, of its samples; None for the walk of one foot.
        """
        super().__init__(remark, judge)
        self.options = options
        self.detection = detection
        self._stances = CausalStances(detection)
        self._solver: Solver | None = None if solver is None else solver(self.buffer)
        if beside and solver is None:
            self._solver = WorkerSolver(options, detection.stance, self.buffer, remark)
        self._smoother = self._begin_smoother()
        self._remark, self._waits, self._warned = remark, False, False
        self._handed = 0

    @property
    def footfalls(self) -> list[Footfall]:
        """Those of the walk so far, in the order of `smoothed`."""
        return [one.footfall for one in self._smoother.footfalls]

    @property
    def reported_continues(self) -> Sequence[bool]:
        """Which lines are further pieces of a standing."""
        return self._smoother.reported_continues

    def close(self) -> list[StanceEstimate | Revision]:
        """End the walk and return the estimates of the footfalls that were still open, and what its end takes back."""
        return [] if self._closed else [*self.begin_end(), *self.take_end()]

    def begin_end(self) -> list[StanceEstimate | Revision]:
        """End the walk, return the estimates of the footfalls that were still open, and begin its last solution."""
        self._closed = True
        found = self._add_rows(self._admit_rest())
        if self.buffer.stop >= MIN_SAMPLES:
            # A stance of the very last sample alone is none.
            found += self._estimates(f for f in self._stances.finish() if f.start[0] + 1 < self.buffer.stop)
        self._smoother.begin_end()
        return found

    def take_end(self) -> list[StanceEstimate | Revision]:
        """Take the last solution over; what it takes back."""
        return self._smoother.take_end()

    def finish(self) -> Solution:
        """End the walk and return its estimates as they are then, with their path.

        Raises
        ------
        RecordingError, DetectionError
            Where there was no walk.
        """
        began = perf_counter()
        self.close()
        stances, (table, nodes) = self.stances(), self._smoother.solution()
        p, table = self._smoother.parameters, select_rows(table, self._is_new())
        table = mark_returns(table, self.returns)
        if self.options.lag_s is None:
            recording = self.recording().raise_peaks(self._smoother.peak_height)
            path, ends = build_path(recording, nodes, stances, p.gravity)
            t = recording.t
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
            notes=(*self._smoother.notes, *ends, *self.notes),
            graph=self._smoother.counts,
            moment=select_rows(self.causal(), ~np.array(self.reported_continues, dtype=np.bool_)),
            recording=recording,
            returns=self.returns,
        )

    def polish(
        self,
        progress: Callable[[float], None] | None = None,
        stances: Stances | None = None,
    ) -> Solution:
        """End the walk and solve it as a whole in batch; without its field where that fails.

        Parameters
        ----------
        progress
            Given from time to time the fraction that is done.
        stances
            Of `recording()`, where they are known.

        Raises
        ------
        RecordingError, DetectionError, EstimationError
            Where there was no walk, with a lag, or where it has no solution.
        """
        self.close()
        aligned, options = self._align(self.recording()), self.options
        known, recording = stances is not None, aligned.recording
        stances = detect_stances(recording, self.detection.stance) if stances is None else stances
        seen = measure_walk_field(recording, stances, options)
        notes = () if known else (*aligned.notes, *seen.notes)
        fixes = tuple(fix for fix in options.fixes if fix.time_s <= recording.t[-1])
        why = ""
        for used in (None,) if seen.field is None else (seen.field, None):
            try:
                found = smooth(seen.recording, stances, options.parameters, options.heading_rad, progress, used, fixes)
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
        return self._cut_all()

    def _align(self, recording: Recording) -> AlignedMagnetometer:
        if not self.options.use_field:
            return AlignedMagnetometer(recording)
        return align_magnetometer(recording, self.options.axes_given)

    def stances(self) -> Stances:
        """Return the stances so far; raises `DetectionError` if there is none."""
        return join_footfalls(self.footfalls, self.buffer.stop)

    def pose(self) -> Track | None:
        """Return the pose at the last sample, as a path of one row; None before the first footfall.

        Strapdown from the last footfall on. Its error is not bounded: after `MAX_FREE_S` the position is held.
        """
        if not self._smoother.n_reported:
            return None
        last_stamp = self.buffer.stamp(self.buffer.stop - 1)
        longest = self.buffer.stamp(self._handed - 1) + MAX_FREE_S
        until = self.buffer.find_since(longest, self.buffer.stop)
        track = self._smoother.propagate(until)
        last = Track(*(part[-1:] for part in track))
        if until == self.buffer.stop:
            return last
        return last._replace(t=np.array([last_stamp]), velocity=np.zeros((1, 3)))

    @property
    def stands(self) -> bool:
        """Whether the foot stands at the last samples, as far as is seen."""
        return self._stances.stands

    @property
    def floor(self) -> int | None:
        """Number of the floor of the newest footfall, 0 where the walk began; None where it is not known."""
        latest = self._smoother.latest
        return None if latest is None else latest.floor

    @property
    def smoother(self) -> OnlineSmoother:
        """What the footfalls are given to."""
        return self._smoother

    @property
    def returns(self) -> tuple[Return, ...]:
        """Stretches at which the walk was before, as they were recognized when it was last solved as a whole."""
        return self._smoother.returns

    @property
    def anchor_sample(self) -> int:
        """Which solution of the walk so far it goes on from: the sample of its last footfall; -1 before the first."""
        return self._smoother.anchor_sample

    @property
    def n_reported(self) -> int:
        """Number of lines so far."""
        return self._smoother.n_reported

    def state(self) -> NavigatorState:
        """Return what `resume` needs, of a walk that has begun: a copy of some ten seconds, and of nothing longer."""
        words = self._waits, self._warned, self._closed
        stances = self._stances.copy()
        return NavigatorState(self.buffer.stop, self._smoother.state(), stances, self._handed, *words, self._busy_s)

    @property
    def races(self) -> int:
        """How often what was told hung on how fast this machine is."""
        return self._smoother.takeover.races

    @property
    def takeovers(self) -> tuple[int, ...]:
        """Lines before which a solution made beside was taken over, since the walk goes on from the newest of them."""
        return tuple(self._smoother.takeover.taken)

    def resume(self, state: NavigatorState, takeovers: Sequence[int] = (), n_reported: int = 0) -> None:
        """Go on where another navigator was, whose samples are in the buffer, as far as they were not discarded.

        It had reported `n_reported` lines, and had taken over solutions before the lines `takeovers` since; the
        same happens here when the samples behind the state are added again.
        """
        self._smoother.takeover.note(takeovers, n_reported)
        self._smoother.resume(state.smoother)
        self._stances, self._handed, self._busy_s = state.stances.copy(), state.handed, state.busy_s
        self._waits, self._warned, self._closed = state.waits, state.warned, state.has_ended
        if self._closed and self._solver is not None:
            self._solver.close()

    def causal(self) -> StanceTable:
        """Return one row an estimate, as it was reported."""
        return self._smoother.causal()

    def smoothed(self) -> StanceTable:
        """Return one row an estimate, as it is now."""
        return self._smoother.smoothed()

    def _prepare(self) -> None:
        self._smoother.prepare()

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
                if self._smoother.n_reported:
                    raise
                if not self._waits:
                    self._remark(f"the walk does not begin yet: {error}")
                self._waits = True
                self._smoother = self._begin_smoother()
        return found

    def _begin_smoother(self) -> OnlineSmoother:
        return OnlineSmoother(self.options, self.buffer, self.detection.stance, self._solver)

    def _add(self, footfall: Footfall) -> list[StanceEstimate | Revision]:
        """Give a footfall and the samples up to the one behind it to the smoother."""
        footfall = replace(footfall, continues=footfall.continues and self._smoother.n_reported > 0)
        until = min(max(int(footfall.stop[-1]) + 1, MIN_SAMPLES), self.buffer.stop)
        found = self._smoother.add_footfall(_end_before(footfall, until), until, self._stances.seen)
        self._handed = until
        if self._smoother.wrong_axes is not None and not self._warned:
            self._remark(self._smoother.wrong_axes.warning)
            self._warned = True
        return found

    def _is_new(self) -> Bools:
        """(K,) True for the first piece of each footfall."""
        return np.array([not footfall.continues for footfall in self.footfalls], dtype=bool)


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


def _end_before(footfall: Footfall, until: int) -> Footfall:
    """Cut a footfall that ends with the last of `until` samples one before it."""
    stop = np.minimum(footfall.stop, until - 1)
    inside = footfall.start < stop
    return replace(
        footfall,
        start=footfall.start[inside],
        stop=stop[inside],
        threshold=footfall.threshold[inside],
        stillest=min(footfall.stillest, until - 2),
    )
