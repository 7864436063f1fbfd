"""The walk so far solved again while it goes on, by the functions of the batch.

    Task                  -> footfalls reviewed -> solution of the whole walk, or of the strides since an earlier anchor
                             state (`window`)
    footfalls meanwhile   -> added to it
                          -> AnchorState at the newest of these

`WalkSolver` does so in this process, when the anchor state is needed, or in that of `background`, meanwhile: the same,
to the bit.

Review: online, a footfall is reported before it is known how the walk goes on. Stances are detected again in all
samples so far, as in a recording. A footfall without a sample in any of those stances was none and is taken out; a
stance without a sample in any footfall was missed and is put in. What ends less than `OPEN_S` before the last sample
stays.

The whole walk: lever, swing noise, the bias to linearize at, its random walk, the height of clipped peaks, delay and
iron of the magnetometer and the roughness of the field are estimated on it, level floors are recognized, and stances
that contradict it get a larger sigma. Of the position fixes those are used whose time has come
(`smoother.constraints`): where they show the heading better than it is known, the walk is turned to them.

Two feet: each walk alone, then both in one graph (`smoother.feet.solve_feet`), and the anchor state of each foot by the
triangle of both; its newest strides go on from there alone. Both begin within a step of each other, and are joined when
the first of them is due, so that both go on from one solution, each by its own marginal of it: nothing is counted
twice. A foot that has no newer task is in it as it was solved last. Steps that tie fewer cells than `MIN_CELLS` do not
show how the feet lie: then each is as it is alone, the right one in a frame of its own. The frame of both is the left
foot's. Where its heading was given, or it has no magnetometer, the right foot's is set by the directions of the steps,
once, and its walk solved again with it: else its field and the steps would ask for two.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools
from fg_nav.calibration.magnetometer import MagnetometerCalibration
from fg_nav.calibration.walk import MeasuredField, measure_walk_field
from fg_nav.detection import detect_stances
from fg_nav.detection.causal import Footfall
from fg_nav.detection.stance import StanceParameters, Stances
from fg_nav.errors import DetectionError, EstimationError
from fg_nav.feet import SIDES, Side
from fg_nav.feet.steps import MIN_TURNS, measure_turns
from fg_nav.frames import compute_heading
from fg_nav.magnetic import FootfallField
from fg_nav.online.anchor import (
    AnchorState,
    MarginalPrior,
    Past,
    PathNodes,
    TiedAnchorState,
    marginalize,
    marginalize_root,
    track_floors,
)
from fg_nav.online.buffer import (
    OnlineOptions,
    PartialWalk,
    ReportedFootfall,
    SampleBuffer,
    SensorState,
    as_recording,
)
from fg_nav.online.estimates import list_estimates
from fg_nav.online.field import BiasLedger, CompassVerdict, OnlineField
from fg_nav.online.strides import RestLedger, StanceNodes, list_stances, list_variables, result_keys
from fg_nav.online.window import Window
from fg_nav.recording import Recording
from fg_nav.smoother.batch import InProgress, WalkInput, fit_walk
from fg_nav.smoother.differential import DifferentialFactors
from fg_nav.smoother.feet import SolvedFeet, list_footfalls, solve_feet
from fg_nav.smoother.field import FieldSolution, FieldVerdict
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.graph import WalkProblem, count_factors, order_variables
from fg_nav.smoother.heights import BarometerFactors
from fg_nav.smoother.solver import UNSOLVED, Solved, list_attitudes, list_positions
from fg_nav.solution import Return

CONTEXT_S = 20.0  # Before an anchor state: to detect the stances behind it, and levels at which sensors clip.
OPEN_S = 1.5  # A swing and the beginning of the stance after it: by then a footfall has been seen from both sides.
UNREPORTED = -1  # Number of the line of a footfall that had none.
MIN_CELLS = 6  # That tie two feet in progress: the first ones are small, and each foot alone turns by its own drift.


@dataclass(frozen=True)
class Task:
    """Input of a re-solve."""

    start: AnchorState | None  # Where to begin, without its past; None for the start of the walk.
    footfalls: tuple[ReportedFootfall, ...]  # From that of the anchor state on.
    sensor: SensorState
    since: int  # First sample that it, or one after it, needs.
    has_ended: bool = False  # Whether nothing follows.


class Pace:
    """How long a walk, or that of two feet, waited for samples so far: the time between two blocks of them."""

    def __init__(self) -> None:
        self.idle_s, self._left = 0.0, time.monotonic()

    def __enter__(self) -> None:
        self.idle_s += time.monotonic() - self._left

    def __exit__(self, *_: object) -> None:
        self._left = time.monotonic()


class WalkSolver:
    """Solves a walk again while it goes on: in this process, when an anchor state is taken."""

    is_here = True  # Whether it solves in this process.

    def __init__(self, options: OnlineOptions, stance: StanceParameters, buffer: SampleBuffer) -> None:
        self._options, self._stance, self.buffer, self.pace = options, stance, buffer, Pace()
        self._task: Task | None = None
        self._open: list[Task | Sequence[ReportedFootfall]] = []  # Requested, and not done yet.
        self._solved: tuple[AnchorState, PartialWalk] | None = None

    def start(self) -> None:
        """Get ready for tasks to come."""

    def begin(self, task: Task) -> None:
        """Begin a task, all samples of whose footfalls are there."""
        self._task, self._open = task, [task]

    def request(self, footfalls: Sequence[ReportedFootfall]) -> None:
        """Request the anchor state at the last of these footfalls, which came since the task, or the last request."""
        self._open.append(footfalls)

    def is_ready(self) -> bool:
        """Return whether the requested anchor state is there."""
        return not self._open

    def prepare(self) -> None:
        """Solve the task itself, before an anchor state is requested."""
        self.take()

    def take(self) -> AnchorState | None:
        """Return the requested anchor state; None where the walk has no solution."""
        try:
            while self._open:
                work = self._open.pop(0)
                if isinstance(work, Task):
                    self._solved = None
                    self._solved = self._solve(work)
                elif work and self._solved is not None:
                    anchor, walk = self._solved
                    window = Window(anchor, walk)
                    window.extend(work)
                    self._solved = window.to_anchor(), walk
        except UNSOLVED:
            self._solved = None
        return None if self._solved is None else self._solved[0]

    def close(self) -> WalkSolver:
        """Release what it holds; return the solver in this process, for what follows."""
        return self

    def _solve(self, task: Task) -> tuple[AnchorState, PartialWalk]:
        """Solve a task; return the anchor state at its last footfall, and the walk."""
        start = task.start
        if start is None:
            return self._solve_whole(task)
        first, *later = self._review(task)
        number = start.stance.number
        walk = PartialWalk(self.buffer, self._options, number, (first,), start.sensor)
        window = Window(replace(start, footfalls=(first,), first=number), walk)
        window.extend(later)
        return window.to_anchor(), walk

    def _solve_whole(self, task: Task) -> tuple[AnchorState, PartialWalk]:
        walk = self._collect_walk(task)
        return solve_from_start(walk, self._options, task.has_ended), walk

    def _collect_walk(self, task: Task) -> PartialWalk:
        """Return the walk of a task from the start, with its footfalls reviewed."""
        walk = PartialWalk(self.buffer, self._options, sensor=task.sensor)
        for footfall in self._review(task):
            walk.add(footfall)
        return walk

    def _review(self, task: Task) -> list[ReportedFootfall]:
        """Return the footfalls of a task, reviewed; that of its anchor state stays."""
        begins, until = 0, task.footfalls[-1].until
        if task.start is not None:
            stamp = self.buffer.stamp(int(task.footfalls[0].footfall.start[0]))
            begins = self.buffer.find_since(stamp - CONTEXT_S, until)
        recording = as_recording(self.buffer.between(begins, until), with_mag=False)
        if task.start is None:
            return review_footfalls(recording, begins, task.footfalls, self._stance)
        first, *later = task.footfalls
        reviewed = review_footfalls(recording, begins, later, self._stance)
        return [first, *(one for one in reviewed if one.footfall.start[0] >= first.footfall.stop[-1])]


def review_footfalls(
    recording: Recording, first: int, footfalls: Sequence[ReportedFootfall], parameters: StanceParameters
) -> list[ReportedFootfall]:
    """Return the footfalls after review: false ones taken out, missed stances put in.

    Parameters
    ----------
    recording : samples of the walk from number `first` on.
    footfalls : in it, in order.
    """
    try:
        stances = detect_stances(recording, parameters)
    except DetectionError:
        return list(footfalls)
    # The stances as footfalls, in samples of the walk.
    stillest = stances.stillest(recording.gyr) + first
    edges = np.searchsorted(stances.footfall, np.arange(1, stances.n_footfalls))
    threshold = np.full(len(stances), np.nan if stances.threshold is None else stances.threshold)
    parts = (np.split(part, edges) for part in (stances.start + first, stances.stop + first, threshold))
    rows = zip(*parts, stillest.tolist(), strict=True)
    detected = [Footfall(start, stop, level, at, continues=False) for start, stop, level, at in rows]
    # A footfall is confirmed by any detected stance that shares a sample with it.
    open_from = first + int(np.searchsorted(recording.t, recording.t[-1] - OPEN_S))
    begins = np.array([int(one.start[0]) for one in detected])
    ends = np.array([int(one.stop[-1]) for one in detected])
    kept: list[ReportedFootfall] = []
    matched: set[int] = set()
    for one in footfalls:
        start, stop = int(one.footfall.start[0]), int(one.footfall.stop[-1])
        alike = np.arange(np.searchsorted(ends, start, side="right"), np.searchsorted(begins, stop, side="left"))
        matched.update(alike.tolist())
        if len(alike) or stop > open_from or start < first:
            kept.append(one)
    missed = [
        ReportedFootfall(footfall, UNREPORTED, int(footfall.stop[-1]) + 1)
        for k, footfall in enumerate(detected)
        if k not in matched and footfall.stop[-1] <= open_from
    ]
    # Missed ones are put in where they do not overlap the next one's samples or those before.
    found: list[ReportedFootfall] = []
    for one in sorted([*kept, *missed], key=lambda one: int(one.footfall.start[0])):
        if found and one.footfall.start[0] < found[-1].footfall.stop[-1]:
            continue
        until = max(one.until, found[-1].until) if found else one.until
        found.append(ReportedFootfall(one.footfall, one.line, until))
    return found


# --- the whole walk --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WalkSolution:
    """A walk solved so far."""

    problem: WalkProblem  # With the field where that is used.
    solved: Solved  # Its minimum.
    field: OnlineField | None  # None where the field is not used.
    verdict: FieldVerdict  # On the field at all footfalls.
    returns: tuple[Return, ...]  # Stretches walked before.
    iron: MagnetometerCalibration | None  # By the walk itself; None where it shows none, or a calibration was given.
    solved_field: tuple[FieldSolution, FootfallField] | None = None  # Of the field, with the field at the footfalls.

    @property
    def stances(self) -> list[StanceNodes]:
        """Its footfalls."""
        return list_stances(self.problem.nodes, self.problem.recording.t)


def solve_from_start(walk: PartialWalk, options: OnlineOptions, has_ended: bool = False) -> AnchorState:
    """Solve the whole walk; return the anchor state at its newest footfall. Raises `UNSOLVED` without a solution."""
    found = solve_alone(walk, options, has_ended)
    return build_anchor(walk, options, found, marginalize_at(found, found.stances[-1]))


def solve_alone(walk: PartialWalk, options: OnlineOptions, has_ended: bool = False) -> WalkSolution:
    """Return the solution of a walk; note its clipped peaks' height and its iron in `walk.sensor`."""
    walk.align_magnetometer()
    recording, stances = walk.cut_whole(), walk.cut_stances(0, 0)
    found = solve_so_far(recording, stances, options, walk.continues, has_ended)
    walk.sensor = replace(walk.sensor, peak_height=found.problem.known.peak_height, iron=found.iron)
    return found


def build_anchor(walk: PartialWalk, options: OnlineOptions, found: WalkSolution, prior: MarginalPrior) -> AnchorState:
    """Return the anchor state of a solved walk at its newest footfall, whose marginal prior is given."""
    problem, values, stances = found.problem, found.solved.values, found.stances
    known, magnetometer = problem.known, walk.sensor.magnetometer
    verdicts = [
        CompassVerdict(*one)
        for one in zip(found.verdict.words, found.verdict.reason, found.verdict.compass_weight.tolist(), strict=True)
    ]
    covariances = found.solved.root.covariances(result_keys(stances))
    air = problem.find(BarometerFactors)
    shared = problem.parameters.moving_foot, air is not None
    rows = list_estimates(stances, verdicts, values, covariances, *shared)
    heights = np.asarray(list_positions(problem.nodes.result, values)[:, 2])
    longest_rest = max(known.rests, key=lambda rest: rest.stop - rest.start, default=None)
    return AnchorState(
        stance=stances[-1],
        verdict=verdicts[-1],
        prior=prior,
        past=Past(0, tuple(rows[:-1]), PathNodes.from_values(stances[:-1], values)),
        first=0,
        footfalls=walk.footfalls_since(0),
        t_first=stances[0].t,
        known=known,
        parameters=problem.parameters,
        field=found.field,
        barometer=None if air is None else air.barometer,
        rests=RestLedger(longest_rest, known.rests[-1] if known.rests else None),
        biases=BiasLedger.from_factors(problem.find(DifferentialFactors)),
        sensor=walk.sensor,
        counts=dict(count_factors(problem)),
        fixes=options.fixes,
        floors=track_floors(heights, problem.floor, walk.continues),
        heading_known=problem.heading_known,
        returns=found.returns,
        notes=(*known.notes, *found.verdict.notes, *(() if magnetometer is None else magnetometer.notes)),
    )


def marginalize_at(found: WalkSolution, stance: StanceNodes) -> MarginalPrior:
    """Return the marginal prior on the variables of a footfall, from the whole solved walk."""
    problem, values = found.problem, found.solved.values
    linear = problem.system.linearize(values)
    order, keep = order_variables(problem), list_variables(stance, values)
    return marginalize(linear, values, keep, [key for key in order.tolist() if key not in set(keep)])


def solve_so_far(
    recording: Recording,
    stances: Stances,
    options: OnlineOptions,
    continues: Bools | None = None,
    has_ended: bool = False,
) -> WalkSolution:
    """Solve a walk so far.

    Raises `EstimationError` where the batch smoother does.

    Parameters
    ----------
    recording : with the magnetometer as it measures, unless a calibration is among the options.
    options : of the fixes those are used that the walk has come to.
    continues : (F,) which footfalls are further pieces of a standing: on the same spot each has the deviation of the
        first, so the field there counts once. None where there is none.
    has_ended : whether no samples follow: then a standing at the end is a rest.
    """
    # The field at the footfalls, once for each standing.
    standings = stances
    if continues is not None:
        standings = replace(stances, footfall=(np.cumsum(~continues) - 1)[stances.footfall])
    measured = measure_online_field(recording, stances, options, standings)
    recording, field = measured.recording, measured.field
    field = field if field is None or continues is None else field.leave_out(continues)
    # The walk, by the recipe of the batch.
    so_far = InProgress(continues, measured.unseen, has_ended)
    given = WalkInput(recording, stances, options.heading_rad, field, options.parameters, fixes=options.fixes)
    found = fit_walk(replace(given, in_progress=so_far)).walk
    solved_field = None if found.field is None or field is None else (found.field, field)
    online_field = None if solved_field is None else OnlineField(*solved_field)
    verdict = replace(found.verdict, notes=(*measured.notes, *found.verdict.notes))
    return WalkSolution(found.problem, found.solved, online_field, verdict, found.returns, measured.iron, solved_field)


def measure_online_field(
    recording: Recording, stances: Stances, options: OnlineOptions, standings: Stances | None = None
) -> MeasuredField:
    """Return the field at the footfalls as in batch, none where it is not used; `standings` as there."""
    if not options.use_field or recording.mag is None:
        return MeasuredField(recording)
    return measure_walk_field(recording, stances, options.heading_rad, options.calibration, standings)


# --- two feet --------------------------------------------------------------------------------------------------------


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
            walk, has_ended = self._collect_walk(self._task), self._task.has_ended
            found = solve_alone(walk, self._options, has_ended)
            # The steps give the right foot its heading, once.
            heading = self._walks.find_heading(found, self._options) if self._side == "right" else None
            if heading is not None:
                self._options = replace(self._options, heading_rad=heading)
                found = solve_alone(walk, self._options, has_ended)
            self._walks.alone[self._side] = found
            self._walk = walk

    def _solve_whole(self, task: Task) -> tuple[AnchorState, PartialWalk]:
        for solver in self._walks.solvers.values():
            solver.prepare()
        walk = self._walk
        if walk is None:
            raise EstimationError(f"the walk of the {self._side} foot has no solution.")
        alone, both = self._walks.alone[self._side], self._walks.join()
        if both is None:
            return build_anchor(walk, self._options, alone, marginalize_at(alone, alone.stances[-1])), walk
        # The walk of this foot as it is in the graph of both.
        problem, solved = getattr(both.problem, self._side), getattr(both, self._side)
        found = replace(alone, problem=problem, solved=solved)
        if alone.solved_field is not None and (factors := problem.find(FieldFactors)) is not None:
            own, field = alone.solved_field
            own = replace(own, problem=problem, solved=solved, states=factors.states(solved.values))
            found = replace(found, field=OnlineField(own, field), solved_field=(own, field))
        prior = marginalize_root(solved.root, solved.values, list_variables(found.stances[-1], solved.values))
        return TiedAnchorState(**vars(build_anchor(walk, self._options, found, prior)), number=self._walks.count), walk
