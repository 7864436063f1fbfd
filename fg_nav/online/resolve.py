"""The walk so far solved again while it goes on, by the functions of the batch: in another process, or in this one.

    Task                  -> footfalls reviewed -> solution of the whole walk, or of the strides since an earlier anchor
                             state (`window`)
    footfalls meanwhile   -> added to it
                          -> AnchorState at the newest of these

Both are calls of a `WalkSolver`, each a future where that is in the other process, whose answer is the same to the bit.
Where that process cannot start, dies (memory, a signal), fails or has not answered for `MAX_S` (it was stopped), the
`WalkSolver` of this process takes its place, on the samples that are here.

Review: stances are detected again in all samples so far, as in a recording. A footfall without a sample in any of them
was none and is taken out; a stance without a sample in any footfall was missed and is put in. What ends less than
`OPEN_S` before the last sample stays. The whole walk is solved by the recipe of the batch (`smoother.batch`).

Two feet: each walk alone, then both in one graph (`smoother.feet.solve_feet`) when the first of them is due, and the
anchor state of each foot by the triangle of both; its newest strides go on from there alone, by its own marginal of one
solution: nothing is counted twice. Steps that tie fewer cells than `MIN_CELLS` do not show how the feet lie: then each
is as it is alone, the right one in a frame of its own. The frame of both is the left foot's. Where its heading was
given, or it has no magnetometer, the right foot's is set by the directions of the steps, once, and its walk solved
again with it: else its field and the steps would ask for two.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration import MagnetometerCalibration
from fg_nav.calibration.walk import MeasuredField, measure_walk_field
from fg_nav.detection import detect_stances
from fg_nav.detection.causal import Footfall
from fg_nav.detection.rest import find_longest
from fg_nav.detection.stance import Stances
from fg_nav.errors import DetectionError
from fg_nav.feet import SIDES, Side
from fg_nav.feet.steps import MIN_TURNS, measure_turns
from fg_nav.frames import compute_heading
from fg_nav.magnetic import FootfallField
from fg_nav.online.buffer import (
    OnlineOptions,
    Pace,
    PartialWalk,
    ReportedFootfall,
    SampleBuffer,
    SensorState,
    as_recording,
)
from fg_nav.online.estimates import CompassVerdict, Past, PathNodes, list_estimates
from fg_nav.online.field import OnlineField
from fg_nav.online.strides import RestLedger, list_stances, list_variables, result_keys, track_floors
from fg_nav.online.window import AnchorState, Window, marginalize
from fg_nav.recording import Recording
from fg_nav.smoother.batch import InProgress, SolvedWalk, WalkInput, fit_walk
from fg_nav.smoother.feet import SolvedFeet, list_footfalls, solve_feet
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.graph import count_factors
from fg_nav.smoother.heights import BarometerFactors
from fg_nav.smoother.solver import UNSOLVED, list_attitudes, list_positions
from fg_nav.system.processes import Worker

CONTEXT_S = 20.0  # Before an anchor state: to detect the stances behind it, and levels at which sensors clip.
OPEN_S = 1.5  # A swing and the beginning of the stance after it: by then a footfall has been seen from both sides.
UNREPORTED = -1  # Number of the line of a footfall that had none.
MIN_CELLS = 6  # That tie two feet in progress: the first ones are small, and each foot alone turns by its own drift.
MAX_S = 120.0  # For an answer of the other process: twenty times what a solution takes on two cores.
NICENESS = 5  # The process that reports the walk comes first.


@dataclass(frozen=True)
class Task:
    """Input of a solution."""

    start: AnchorState | None  # Where to begin, without its past; None for the start of the walk.
    footfalls: tuple[ReportedFootfall, ...]  # From that of the anchor state on.
    sensor: SensorState
    since: int  # First sample that it, or one after it, needs.
    has_ended: bool = False  # Whether nothing follows.


Work: TypeAlias = Task | tuple[ReportedFootfall, ...]
"""To be solved, or footfalls that came since the task, or the last of these."""


class WalkSolver:
    """Solves a walk by the samples of a buffer, and holds its newest solution."""

    def __init__(self, options: OnlineOptions, buffer: SampleBuffer) -> None:
        self._options, self.buffer = options, buffer
        self._solved: tuple[AnchorState, PartialWalk] | None = None

    def run(self, work: Work) -> AnchorState | None:
        """Solve a task, or add footfalls to its solution; return the anchor state, None where there is none."""
        try:
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

    def _solve(self, task: Task) -> tuple[AnchorState, PartialWalk] | None:
        """Solve a task; return the anchor state at its last footfall, and the walk."""
        # The footfalls, reviewed in all samples that are needed; that of an anchor state stays.
        start, footfalls, until = task.start, list(task.footfalls), task.footfalls[-1].until
        begins = 0
        if start is not None:
            stamp = self.buffer.stamp(int(footfalls[0].footfall.start[0]))
            begins = self.buffer.find_since(stamp - CONTEXT_S, until)
        recording = as_recording(self.buffer.between(begins, until), with_mag=False)
        if start is None:
            footfalls = review_footfalls(recording, begins, footfalls)
            walk = PartialWalk(self.buffer, self._options, sensor=task.sensor)
            for footfall in footfalls:
                walk.add(footfall)
            return self._solve_whole(walk, task.has_ended)
        first, number = footfalls[0], start.stance.number
        reviewed = review_footfalls(recording, begins, footfalls[1:])
        walk = PartialWalk(self.buffer, self._options, number, [first], start.sensor)
        window = Window(replace(start, footfalls=(first,), first=number), walk)
        window.extend(one for one in reviewed if one.footfall.start[0] >= first.footfall.stop[-1])
        return window.to_anchor(), walk

    def _solve_whole(self, walk: PartialWalk, has_ended: bool) -> tuple[AnchorState, PartialWalk] | None:
        return solve_from_start(walk, self._options, has_ended), walk


def review_footfalls(recording: Recording, first: int, footfalls: Sequence[ReportedFootfall]) -> list[ReportedFootfall]:
    """Return the footfalls of a recording from sample `first` on, reviewed: false ones out, missed stances put in."""
    try:
        stances = detect_stances(recording)
    except DetectionError:
        return list(footfalls)
    # The stances as footfalls, in samples of the walk.
    stillest = stances.stillest(recording.gyr) + first
    edges = np.searchsorted(stances.footfall, np.arange(1, stances.n_footfalls))
    threshold = np.full(len(stances), stances.threshold)
    parts = (np.split(part, edges) for part in (stances.start + first, stances.stop + first, threshold))
    rows = zip(*parts, stillest.tolist(), strict=True)
    detected = [Footfall(start, stop, level, at, continues=False) for start, stop, level, at in rows]
    # A footfall is confirmed by any detected stance that shares a sample with it.
    open_from = first + int(np.searchsorted(recording.t, recording.t[-1] - OPEN_S))
    begins, ends = (part + first for part in stances.spans)
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

    walk: SolvedWalk
    field: FootfallField | None  # At its footfalls; None where it is not used.
    iron: MagnetometerCalibration | None  # By the walk itself; None where it shows none, or a calibration was given.


def solve_from_start(walk: PartialWalk, options: OnlineOptions, has_ended: bool = False) -> AnchorState:
    """Solve the whole walk; return the anchor state at its newest footfall. Raises `UNSOLVED` without a solution."""
    return build_anchor(walk, options, solve_alone(walk, options, has_ended))


def solve_alone(walk: PartialWalk, options: OnlineOptions, has_ended: bool = False) -> WalkSolution:
    """Return the solution of a walk; note its clipped peaks' height and its iron in `walk.sensor`."""
    walk.align_magnetometer()
    recording, stances = walk.cut_whole(), walk.cut_stances(0, 0)
    found = solve_so_far(recording, stances, options, walk.continues, has_ended)
    walk.sensor = replace(walk.sensor, peak_height=found.walk.problem.known.peak_height, iron=found.iron)
    return found


def solve_so_far(
    recording: Recording,
    stances: Stances,
    options: OnlineOptions,
    continues: Bools | None = None,
    has_ended: bool = False,
) -> WalkSolution:
    """Solve a walk so far; raises `EstimationError` where the batch smoother does.

    `continues` (F,) are footfalls that are further pieces of a standing: on the same spot each has the deviation of the
    first, so the field there counts once. Where the walk `has_ended` a standing at the end is a rest.
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
    walk = fit_walk(replace(given, in_progress=so_far))
    verdict = replace(walk.verdict, notes=(*measured.notes, *walk.verdict.notes))
    return WalkSolution(replace(walk, verdict=verdict), field, measured.iron)


def measure_online_field(
    recording: Recording, stances: Stances, options: OnlineOptions, standings: Stances | None = None
) -> MeasuredField:
    """Return the field at the footfalls as in batch, none where it is not used; `standings` as there."""
    if not options.use_field or recording.mag is None:
        return MeasuredField(recording)
    return measure_walk_field(recording, stances, options.heading_rad, options.calibration, standings)


def build_anchor(
    walk: PartialWalk, options: OnlineOptions, found: WalkSolution, tied: int | None = None
) -> AnchorState:
    """Return the anchor state of a solved walk at its newest footfall; `tied` of a joint solution of two feet."""
    problem, solved, verdict = found.walk.problem, found.walk.solved, found.walk.verdict
    values, stances = solved.values, list_stances(problem.nodes, problem.recording.t)
    known, magnetometer = problem.known, walk.sensor.magnetometer
    # A row each footfall, and the path through their nodes.
    verdicts = list(map(CompassVerdict, verdict.words, verdict.reason, verdict.compass_weight.tolist()))
    covariances = solved.root.covariances(result_keys(stances))
    air = problem.find(BarometerFactors)
    shared = problem.parameters.moving_foot, air is not None
    rows = list_estimates(stances, verdicts, values, covariances, *shared)
    heights = np.asarray(list_positions(problem.nodes.result, values)[:, 2])
    return AnchorState(
        stance=stances[-1],
        verdict=verdicts[-1],
        prior=marginalize(solved.root, values, list_variables(stances[-1], values)),
        past=Past(0, tuple(rows[:-1]), PathNodes.from_values(stances[:-1], values)),
        first=0,
        footfalls=walk.footfalls_since(0),
        t_first=stances[0].t,
        known=known,
        parameters=problem.parameters,
        field=None if found.walk.field is None or found.field is None else OnlineField(found.walk.field, found.field),
        barometer=None if air is None else air.barometer,
        rests=RestLedger(find_longest(known.rests), known.rests[-1] if known.rests else None),
        sensor=walk.sensor,
        counts=dict(count_factors(problem)),
        fixes=options.fixes,
        floors=track_floors(heights, problem.floor, walk.continues),
        heading_known=problem.heading_known,
        returns=found.walk.returns,
        notes=(*known.notes, *verdict.notes, *(() if magnetometer is None else magnetometer.notes)),
        tied=tied,
    )


# --- two feet --------------------------------------------------------------------------------------------------------


class WalksAlone:
    """The walk of each foot alone as it was solved last, and both in one graph."""

    def __init__(self) -> None:
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
        if options.heading_rad is None and left.walk.problem.recording.mag is not None:
            return None
        turn = measure_turns(*(list_footfalls(one.walk.problem, one.walk.solved.values) for one in (right, left)))[1]
        if np.abs(turn).sum() < MIN_TURNS:
            return None
        self._is_turned = True
        start = compute_heading(list_attitudes([0], right.walk.solved.values)[0])
        return float(start + np.angle(np.sum(turn)))

    def join(self) -> SolvedFeet | None:
        """Solve both in one graph; None where they do not show how they lie. Raises `UNSOLVED`."""
        if self.is_parted or len(self.alone) < len(SIDES):
            return None
        pair = self.alone["right"], self.alone["left"]
        if not self._is_turned and pair[0].walk.field is not None and pair[1].walk.field is None:
            return None  # the one shows north, the other does not yet
        if not self._joined or any(one is not other for one, other in zip(pair, self._joined, strict=True)):
            self.both = solve_feet(*(replace(one.walk.problem, values=one.walk.solved.values) for one in pair))
            self._joined, self.count = pair, self.count + 1
        assert self.both is not None
        return self.both if self.both.problem.ties.cells >= MIN_CELLS else None


class FootSolver(WalkSolver):
    """Solves the walk of one foot with that of the other, whose solver has the same `walks`."""

    def __init__(self, side: Side, walks: WalksAlone, options: OnlineOptions, buffer: SampleBuffer) -> None:
        super().__init__(options, buffer)
        self._side, self._walks = side, walks
        self._alone: PartialWalk | None = None  # Solved by itself, and not joined to the other foot's yet.

    def run(self, work: Work) -> AnchorState | None:
        """As of `WalkSolver`; a whole walk is solved alone, and joined to the other foot's when it is to go on."""
        if isinstance(work, Task):
            self._alone = None
        elif self._alone is not None:
            walk, self._alone = self._alone, None
            with suppress(*UNSOLVED):
                self._solved = self._join(walk), walk
        return super().run(work)

    def _solve_whole(self, walk: PartialWalk, has_ended: bool) -> None:
        found = solve_alone(walk, self._options, has_ended)
        # The steps give the right foot its heading, once.
        heading = self._walks.find_heading(found, self._options) if self._side == "right" else None
        if heading is not None:
            self._options = replace(self._options, heading_rad=heading)
            found = solve_alone(walk, self._options, has_ended)
        self._walks.alone[self._side], self._alone = found, walk

    def _join(self, walk: PartialWalk) -> AnchorState:
        """Return the anchor state of a walk as it is in the graph of both feet; alone where that shows nothing."""
        alone, both = self._walks.alone[self._side], self._walks.join()
        if both is None:
            return build_anchor(walk, self._options, alone)
        problem, solved, field = getattr(both.problem, self._side), getattr(both, self._side), alone.walk.field
        if field is not None and (factors := problem.find(FieldFactors)) is not None:
            field = replace(field, problem=problem, solved=solved, states=factors.states(solved.values))
        found = replace(alone, walk=replace(alone.walk, problem=problem, solved=solved, field=field))
        return build_anchor(walk, self._options, found, self._walks.count)


# --- in the other process ---------------------------------------------------------------------------------------------


class SolverProcess:
    """The other process, which starts with the first call; `options` by side of the foot, None of one foot alone."""

    def __init__(self, options: Mapping[Side | None, OnlineOptions]) -> None:
        self._worker, self.pace, self.is_closed = Worker(_set_up, options), Pace(), False

    @property
    def pid(self) -> int | None:
        """Process id; None before it starts."""
        return self._worker.pid

    def submit(self, side: Side | None, first: int, rows: Floats, work: Work) -> Future[AnchorState | None]:
        """Run work there, with the samples from number `first` on; raises `BrokenProcessPool` where it has died."""
        if self.is_closed:
            raise BrokenProcessPool
        return self._worker.submit(_run, side, first, rows, work)

    def part(self) -> None:
        """Leave each of two feet alone from here on."""
        with suppress(BrokenProcessPool):
            self._worker.submit(_part)

    def close(self) -> None:
        """Kill the process."""
        self.is_closed = True
        self._worker.kill()


class Solver:
    """Solves a walk again: in another process, or `here`, with all samples, where there is none, or none any more.

    `side` is that of the foot, None of one foot alone; `remark` is given a sentence where the process cannot go on.
    """

    def __init__(
        self,
        here: WalkSolver,
        process: SolverProcess | None = None,
        remark: Callable[[str], None] = lambda words: None,
        side: Side | None = None,
    ) -> None:
        self.pace, self.is_here = Pace() if process is None else process.pace, process is None
        self._here, self._process, self._remark, self._side = here, process, remark, side
        self._sent, self._requested_s = 0, time.monotonic()
        self._work: list[Work] = []  # The newest task and what followed it, as far as it is not solved here.
        self._futures: list[Future[AnchorState | None]] = []  # One for each of it; empty where it is solved here.

    def start(self) -> None:
        """Get ready for tasks to come: it takes some seconds until the other process has loaded what it needs."""
        self._submit(())

    def begin(self, task: Task) -> None:
        """Begin a task, all samples of whose footfalls are there."""
        self._work, self._futures, self._sent = [], [], max(self._sent, task.since)
        self._submit(task, task.footfalls)

    def request(self, footfalls: Sequence[ReportedFootfall]) -> None:
        """Request the anchor state at the last of these footfalls, which came since the task, or the last request."""
        self._requested_s = time.monotonic()
        self._submit(tuple(footfalls), footfalls)

    def is_ready(self) -> bool:
        """Return whether the requested anchor state is there."""
        return not self._futures or self._futures[-1].done() or self._left_s <= 0.0

    def take(self) -> AnchorState | None:
        """Return the requested anchor state; None where the walk has no solution."""
        if self._futures:
            try:
                # The answer is the last one; any before it may have failed.
                return [future.result(max(self._left_s, 0.0)) for future in self._futures][-1]
            except BrokenProcessPool:
                self._go_on_here("has died")
            except TimeoutError:
                self._go_on_here(f"has not answered for {MAX_S:.0f} s")
            except Exception as error:  # its memory may have been too small
                self._go_on_here(f"has failed ({type(error).__name__})")
        found = self._here.run(())
        while self._work:
            found = self._here.run(self._work.pop(0))
        return found

    def close(self) -> None:
        """Solve in this process from here on; that of a foot leaves the process to the other foot."""
        if self._side is None and self._process is not None:
            self._process.close()
        self.is_here, self._futures = True, []

    @property
    def _left_s(self) -> float:
        """Seconds left until the answer is overdue."""
        return self._requested_s + MAX_S - time.monotonic()

    def _submit(self, work: Work, footfalls: Sequence[ReportedFootfall] = ()) -> None:
        """Submit work, with the samples not sent up to the last of some footfalls; here it waits for `take`."""
        self._work.append(work)
        if not self.is_here:
            first, self._sent = self._sent, max(self._sent, footfalls[-1].until if footfalls else 0)
            try:
                assert self._process is not None
                rows = self._here.buffer.between(first, self._sent)
                self._futures.append(self._process.submit(self._side, first, rows, work))
            except BrokenProcessPool:
                self._go_on_here("has died")
            except Exception as error:  # the system has no process or no semaphore left, or this process may start none
                self._go_on_here(f"cannot be started ({type(error).__name__})")
        elif isinstance(work, Task) and self._side is not None:
            self._here.run(self._work.pop())  # Of two feet both are solved before either is taken: they are joined.

    def _go_on_here(self, why: str) -> None:
        assert self._process is not None
        if not self._process.is_closed:  # Else it was reported for the other foot, or nobody waits for it any more.
            self._remark(f"the process that solves the walk again {why}: this one does its work from here on.")
        self._process.close()
        self.is_here, self._futures = True, []


_solvers: dict[Side | None, WalkSolver] = {}
_walks = WalksAlone()


def _set_up(options: Mapping[Side | None, OnlineOptions]) -> None:
    os.nice(NICENESS)
    for side, given in options.items():
        walk = given, SampleBuffer()
        _solvers[side] = WalkSolver(*walk) if side is None else FootSolver(side, _walks, *walk)


def _run(side: Side | None, first: int, rows: Floats, work: Work) -> AnchorState | None:
    solver = _solvers[side]
    if first > solver.buffer.stop:
        solver.buffer.skip_to(first)
    solver.buffer.append(rows)
    if isinstance(work, Task):
        solver.buffer.discard(work.since)
    return solver.run(work)


def _part() -> None:
    _walks.is_parted = True
