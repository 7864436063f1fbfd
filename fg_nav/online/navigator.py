"""A walk in progress: samples in blocks of any size, one estimate for each footfall.

    samples -> judge -> store -> causal stances -> footfall -> online smoother -> estimate

The smoother is handed the samples up to one behind the footfall, so that nothing depends on how the samples came in
blocks. Estimates are those of the moment: what was known when the footfall was complete, told once. `smoothed` tells
what is known of all of them now. At the end the whole walk is solved once more with hindsight: stances and field are
found in all that was recorded, as for a recording, so a walk ends where the batch solution ends.

With a lag the samples are forgotten when the smoother has them, and there is no hindsight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from itertools import compress
from time import perf_counter
from typing import Any

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.detection import detect_stances
from fg_nav.detection.causal import CausalParameters, CausalStances, Footfall, stances_of
from fg_nav.errors import EstimationError
from fg_nav.magnetic import FootfallField
from fg_nav.online.estimates import StanceEstimate
from fg_nav.online.judge import SampleJudge
from fg_nav.online.propagate import Track
from fg_nav.online.resolve import field_seen
from fg_nav.online.smoother import OnlineOptions, OnlineSmoother
from fg_nav.online.store import SampleStore
from fg_nav.online.unsolved import straight_between
from fg_nav.online.walk import Footfall as WalkFootfall
from fg_nav.online.walk import Samples
from fg_nav.recording import MIN_SAMPLES, Recording
from fg_nav.smoother import smooth
from fg_nav.solution import Solution, StanceTable
from fg_nav.stances import Stances

METHOD = "online"

LONGEST_FREE_S = 3.0
"""A stride and the wait for its footfall; a free strapdown is metres off by then."""


class OnlineNavigator:
    """Navigates while samples come in.

    Attributes
    ----------
    options : of the smoother.
    detection : how footfalls are found.
    footfalls : those told so far, in the order of their estimates.
    store, judge : the samples so far, and what was left out of them.
    source : what a checkpoint keeps of the source for who reads it, as JSON knows it.
    """

    def __init__(
        self,
        options: OnlineOptions = OnlineOptions(),
        remark: Callable[[str], None] = lambda words: None,
        detection: CausalParameters = CausalParameters(),
        judge: SampleJudge | None = None,
    ) -> None:
        """`remark` is told, in a sentence, what is odd about the samples; once for each kind of oddity."""
        self.options = options
        self.footfalls: list[Footfall] = []
        self.store = SampleStore()
        self.judge = SampleJudge(remark) if judge is None else judge
        self.source: dict[str, Any] = {}
        self.detection = detection
        self._stances = CausalStances(detection)
        self._smoother = OnlineSmoother(options)
        self._remark, self._waits = remark, False
        self._handed = 0
        self._closed = False
        self._busy_s = 0.0

    def push(self, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None) -> list[StanceEstimate]:
        """Take in samples and return the estimates of the footfalls that they complete.

        Parameters
        ----------
        t, acc, gyr, mag
            (n,) s, (n, 3) m/s^2, (n, 3) rad/s and (n, 3) uT, as they come; n may be 0 or 1. What cannot be used is left
            out (`fg_nav.online.judge`).

        Raises
        ------
        RecordingError
            Where the first seconds show that a unit is wrong.
        EstimationError
            After the end.
        """
        if self._closed:
            raise EstimationError("this walk has ended: begin a new one for more samples.")
        began = perf_counter()
        rows = self.judge.admit(t, acc, gyr, mag)
        self._busy_s += perf_counter() - began
        return self.take(rows)

    def take(self, rows: Floats) -> list[StanceEstimate]:
        """Take in rows (n, 10) that were judged, here or as a recording: t, acc, gyr, mag."""
        began = perf_counter()
        found = self._take(rows)
        self._busy_s += perf_counter() - began
        return found

    def _take(self, rows: Floats) -> list[StanceEstimate]:
        self.store.append(rows)
        return self._estimates(self._stances.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7]))

    def close(self) -> list[StanceEstimate]:
        """End the walk and return the estimates of the footfalls that were still open."""
        if self._closed:
            return []
        self._closed = True
        found = self._take(self.judge.rest())
        if self.store.stop < MIN_SAMPLES:
            return found
        return found + self._estimates(f for f in self._stances.finish() if self._first_of(f) < self.store.stop)

    def finish(
        self,
        progress: Callable[[float], None] | None = None,
        stances: Stances | None = None,
        field: FootfallField | None = None,
    ) -> Solution:
        """End the walk and solve it as a whole; with a lag, return what left it.

        Parameters
        ----------
        progress
            Told from time to time which fraction is done.
        stances, field
            Of `recording()`, where they are known; with `stances` no field is looked for.

        Raises
        ------
        RecordingError, DetectionError, EstimationError
            Where there was no walk.
        """
        began = perf_counter()
        self.close()
        if self.options.lag_s is None:
            recording = self.recording()
            if stances is None:
                stances = detect_stances(recording, self.detection.stance)
                field, _ = field_seen(recording, stances, self.options.heading_rad, self.options.use_field)
            found = self._solved(recording, stances, field, progress)
        else:
            self.stances()  # or there was no walk
            found = self._footfalls_of(self._smoother.finish(progress))
        busy = self._busy_s + perf_counter() - began
        notes = (*found.notes, *self.judge.notes)
        return replace(found, method=METHOD, runtime_s=busy, notes=notes, moment=self._moment())

    def recording(self) -> Recording:
        """Return all samples that were taken; raises `EstimationError` with a lag, and `RecordingError` if too few."""
        if self.options.lag_s is not None:
            raise EstimationError("with a lag the samples of a walk are not kept: leave the lag out.")
        rows = self.store.between(0, self.store.stop)
        mag = rows[:, 7:] if np.isfinite(rows[:, 7:]).all(axis=1).any() else None
        return Recording(rows[:, 0], rows[:, 1:4], rows[:, 4:7], mag)

    def stances(self) -> Stances:
        """Return the stances that were told so far; raises `DetectionError` if there is none."""
        return stances_of(self.footfalls, self.store.stop)

    def pose(self) -> Track | None:
        """Where the foot is at the last sample: a path of one row; None before the first footfall.

        Strapdown from the last footfall on. Nothing bounds the error of that: after `LONGEST_FREE_S` the place is held.
        """
        if not self.footfalls:
            return None
        rows = self.store.between(self._handed, self.store.stop)
        since = self.store.between(self._handed - 1, self._handed)[0, 0]
        known = int(np.searchsorted(rows[:, 0], since + LONGEST_FREE_S))
        track = self._smoother.propagate(self._as_samples(rows[:known]))
        last = Track(*(part[-1:] for part in track))
        if known == len(rows):
            return last
        return last._replace(t=rows[-1:, 0], velocity=np.zeros((1, 3)))

    @property
    def has_ended(self) -> bool:
        """Whether the walk was closed."""
        return self._closed

    def causal(self) -> StanceTable:
        """Return one row an estimate, as it was told."""
        return self._smoother.causal()

    def smoothed(self) -> StanceTable:
        """Return one row an estimate, as it is known now."""
        return self._smoother.smoothed()

    def _estimates(self, footfalls: Iterable[Footfall]) -> list[StanceEstimate]:
        """Return the estimates of footfalls; a walk begins at the first of them that it can begin at."""
        found = []
        for footfall in footfalls:
            try:
                found.append(self._add(footfall))
            except EstimationError as error:
                if self.footfalls:
                    raise
                if not self._waits:
                    self._remark(f"the walk does not begin yet: {error}")
                self._waits = True
                self._smoother = OnlineSmoother(self.options)
        return found

    def _add(self, footfall: Footfall) -> StanceEstimate:
        """Hand a footfall and the samples up to the one behind it to the smoother."""
        footfall = replace(footfall, continues=footfall.continues and bool(self.footfalls))
        until = min(max(int(footfall.stop[-1]) + 1, MIN_SAMPLES), self.store.stop)
        stop = np.minimum(footfall.stop, until - 1)
        inside = footfall.start < stop
        found = WalkFootfall(
            footfall.start[inside], stop[inside], min(footfall.stillest, until - 2), footfall.continues
        )
        estimate = self._smoother.add_footfall(self._samples(self._handed, until), found)
        self._handed = until
        self.footfalls.append(footfall)
        if self.options.lag_s is not None:
            self.store.forget(until - 1)
        return estimate

    def _moment(self) -> StanceTable | None:
        """One row a footfall, as it was told first: without the further pieces of a long standing."""
        return _rows(self.causal(), self._new()) if self.footfalls else None

    def _new(self) -> Bools:
        """(K,) True for the first piece of each footfall."""
        return np.array([not footfall.continues for footfall in self.footfalls], dtype=bool)

    def _first_of(self, footfall: Footfall) -> int:
        """Return the first sample of a footfall, and one more: a stance of the very last sample alone is none."""
        return int(footfall.start[0]) + 1

    def _samples(self, start: int, stop: int) -> Samples:
        return self._as_samples(self.store.between(start, stop))

    def _as_samples(self, rows: Floats) -> Samples:
        mag = np.ascontiguousarray(rows[:, 7:]) if self.options.use_field else None
        return Samples(rows[:, 0].copy(), rows[:, 1:4].copy(), rows[:, 4:7].copy(), mag)

    def _footfalls_of(self, found: Solution) -> Solution:
        """Return a solution that is told at footfalls only, without the further pieces of a long standing."""
        table = _rows(found.stances, self._new())
        return replace(
            found,
            t=table.t,
            position=table.position,
            velocity=found.velocity[self._new()],
            nav_R_body=table.nav_R_body,
            stances=table,
        )

    def _solved(
        self,
        recording: Recording,
        stances: Stances,
        field: FootfallField | None,
        progress: Callable[[float], None] | None,
    ) -> Solution:
        """Solve the walk as a whole; without its field, or not at all, where that does not work: a walk must end."""
        heading, p = self.options.heading_rad, self.options.parameters
        why = ""
        for with_field in (field, None) if field is not None else (None,):
            try:
                found = smooth(recording, stances, p, heading, progress, with_field)
            except (EstimationError, RuntimeError, np.linalg.LinAlgError) as error:
                why = why or str(error).strip().partition("\n")[0]
                continue
            left_out = (f"the field was left out at the end: {why}",) if why else ()
            return replace(found, notes=(*found.notes, *left_out))
        if not self.footfalls:
            raise EstimationError(why)
        return straight_between(recording, _rows(self.smoothed(), self._new()), why)


def _rows(table: StanceTable, keep: Bools) -> StanceTable:
    """Return the rows of a table that are kept, (K,) flags."""
    kept: dict[str, Any] = {}
    for item in fields(table):
        column = getattr(table, item.name)
        kept[item.name] = tuple(compress(column, keep)) if isinstance(column, tuple) else column
        if isinstance(column, np.ndarray):
            kept[item.name] = column[keep]
    return StanceTable(**kept)
