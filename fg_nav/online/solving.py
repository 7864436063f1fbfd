"""A walk in progress is solved again while it goes on.

    Task                  -> footfalls reviewed -> solution of the whole walk (`resolve`), or of the strides since an
                             earlier anchor state (`window`)
    footfalls meanwhile   -> added to it
                          -> AnchorState at the newest of these

`WalkSolver` does so in this process, when the anchor state is needed; `background` in another, meanwhile. Both give the
same, to the bit.

Review: online, a footfall is reported before it is known how the walk goes on. Stances are detected again in all
samples so far, as in a recording. A footfall without a sample in any of those stances was none and is taken out; a
stance without a sample in any footfall was missed and is put in. What ends less than `OPEN_S` before the last sample
stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.detection import detect_stances
from fg_nav.detection.causal import Footfall
from fg_nav.detection.stance import StanceParameters
from fg_nav.errors import DetectionError
from fg_nav.online.anchor import AnchorState
from fg_nav.online.buffer import PartialWalk, ReportedFootfall, SampleBuffer, SensorState, as_recording
from fg_nav.online.options import OnlineOptions
from fg_nav.online.resolve import solve_from_start
from fg_nav.online.window import Window
from fg_nav.recording import Recording
from fg_nav.smoother.solver import UNSOLVED

CONTEXT_S = 20.0  # Before an anchor state: to detect the stances behind it, and levels at which sensors clip.
OPEN_S = 1.5  # A swing and the beginning of the stance after it: by then a footfall has been seen from both sides.
UNREPORTED = -1  # Number of the line of a footfall that had none.


@dataclass(frozen=True)
class Task:
    """Input of a re-solve."""

    start: AnchorState | None  # Where to begin, without its past; None for the start of the walk.
    footfalls: tuple[ReportedFootfall, ...]  # From that of the anchor state on.
    sensor: SensorState
    has_ended: bool = False  # Whether nothing follows.


class WalkSolver:
    """Solves a walk again while it goes on: in this process, when an anchor state is waited for."""

    is_here = True  # Whether it solves in this process.

    def __init__(self, options: OnlineOptions, stance: StanceParameters, buffer: SampleBuffer) -> None:
        self._options, self._stance, self._buffer = options, stance, buffer
        self._task: Task | None = None
        self._requested: list[Sequence[ReportedFootfall]] = []
        self._solved: tuple[AnchorState, PartialWalk] | None = None
        self._is_done = False

    def follow(self, until: int) -> None:
        """Take the samples of the walk before this one; here the buffer is the walk's."""

    def discard(self, before: int) -> None:
        """Discard samples that no task needs any more; here the buffer is the walk's."""

    def begin(self, task: Task) -> None:
        """Begin a task, all samples of whose footfalls are there."""
        self._task, self._requested, self._solved, self._is_done = task, [], None, False

    def request(self, footfalls: Sequence[ReportedFootfall]) -> None:
        """Request the anchor state at the last of these footfalls, which came since the task, or the last request."""
        self._requested.append(footfalls)
        self._is_done = False

    def is_ready(self) -> bool:
        """Return whether the requested anchor state is there."""
        return self._is_done

    def prepare(self) -> None:
        """Solve the task itself, before an anchor state is requested."""
        assert self._task is not None
        try:
            self._solved = self._solve(self._task)
        except UNSOLVED:
            self._solved = None

    def wait(self) -> None:
        """Solve the task and add the footfalls requested since, unless done."""
        if self._is_done:
            return
        assert self._task is not None
        try:
            anchor, walk = self._solve(self._task) if self._solved is None else self._solved
            for footfalls in self._requested:
                if footfalls:
                    window = Window(anchor, walk)
                    window.extend(footfalls)
                    anchor = window.to_anchor()
            self._solved = anchor, walk
        except UNSOLVED:
            self._solved = None
        self._requested, self._is_done = [], True

    def take(self) -> AnchorState | None:
        """Return the requested anchor state, once solved; None where the walk has no solution."""
        self.wait()
        return None if self._solved is None else self._solved[0]

    def close(self) -> WalkSolver:
        """Release what it holds; return the solver in this process, for what follows."""
        return self

    def _solve(self, task: Task) -> tuple[AnchorState, PartialWalk]:
        """Solve a task; return the anchor state at its last footfall, and the walk."""
        options, start = self._options, task.start
        if start is None:
            walk = self._collect_walk(task)
            return self._solve_whole(walk, task.has_ended), walk
        first, *later = self._review(task)
        number = start.stance.number
        walk = PartialWalk(self._buffer, options.use_field, options.axes_given, number, (first,), start.sensor)
        window = Window(replace(start, footfalls=(first,), first=number), walk)
        window.extend(later)
        return window.to_anchor(), walk

    def _collect_walk(self, task: Task) -> PartialWalk:
        """Return the walk of a task from the start, with its footfalls reviewed."""
        walk = PartialWalk(self._buffer, self._options.use_field, self._options.axes_given, sensor=task.sensor)
        for footfall in self._review(task):
            walk.add(footfall)
        return walk

    def _solve_whole(self, walk: PartialWalk, has_ended: bool) -> AnchorState:
        return solve_from_start(walk, self._options, has_ended)

    def _review(self, task: Task) -> list[ReportedFootfall]:
        """Return the footfalls of a task, reviewed; that of its anchor state stays."""
        begins, until = 0, task.footfalls[-1].until
        if task.start is not None:
            stamp = self._buffer.stamp(int(task.footfalls[0].footfall.start[0]))
            begins = self._buffer.find_since(stamp - CONTEXT_S, until)
        recording = as_recording(self._buffer.between(begins, until), with_mag=False)
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
