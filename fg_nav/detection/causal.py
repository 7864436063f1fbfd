"""Stances of a walk in progress: a footfall is reported when the swing after it has begun, and never changed again.

The same statistic, thresholds and choice among candidates as for a whole recording (`fg_nav.detection.footfalls`), over
a window of the last `window_s` that slides on by `step_s`:

1. SHOE is known up to half its own window before the last sample. The free strapdown pass runs forward only.
2. The search for footfalls is repeated on the window after each step.
3. A footfall is reported once the foot has turned as in a swing after it, and `settle_s` have gone by since its end.
4. Of one that lasts longer than `piece_s` (a standing) the part until now is reported, the rest as ones to continue it.
5. Later footfalls lie after those reported, and those too close to one for a swing are left out.

Steps are counted in samples from the first one, so it does not matter how the samples come in blocks. The work and the
memory for each sample are the same however long the walk is.

`Sliding` holds the last samples of a stream, in order and in one piece of memory: rows are counted from the first that
was ever appended, and at least the last `keep` of them are there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.footfalls import (
    MIN_SWING_S,
    REST_LEVEL,
    ROUGH,
    SWING_RATE_RAD_S,
    WALKING,
    StrapdownPass,
    find_footfalls,
    is_too_close,
)
from fg_nav.detection.stance import MIN_S, WINDOW_S, StanceParameters, Stances, shoe
from fg_nav.errors import DetectionError
from fg_nav.samples.gaps import find_holes
from fg_nav.samples.stamps import MAX_GAP_S

FIRST_SAMPLES = 64  # Their median period is that of the samples; nothing is searched before.


@dataclass(frozen=True)
class CausalParameters:
    """Search for stances in a stream."""

    stance: StanceParameters = field(default_factory=StanceParameters)
    window_s: float = 20.0  # Some fifteen strides, among which a footfall is chosen; a longer one changes nothing.
    step_s: float = 0.1  # Interval of the searches.
    settle_s: float = 0.3  # Since the end of a footfall: longer than the still middle of a runner's swing.
    piece_s: float = 2.0  # Length of the pieces in which standing is reported.
    edge_s: float = 0.1  # From the end of a piece to the last sample: a swing may be about to begin.
    warm_up_s: float = 1.5  # Before the first search: by then the foot has stood once, for the direction of up.


@dataclass(frozen=True)
class Footfall:
    """A footfall, or a piece of a long one. Samples are counted from the first of the stream."""

    start: Ints  # (K,) first sample of each stance interval,
    stop: Ints  # (K,) and sample after its last.
    threshold: Floats  # (K,) of SHOE, in each interval.
    stillest: int  # Sample at which SHOE is lowest over its threshold.
    continues: bool  # A further piece of the footfall before: the foot has not swung since.


@dataclass(frozen=True)
class Seen:
    """Stance intervals `start <= i < stop`, (K,) each, of a search in the samples `first <= i < last`."""

    first: int
    last: int
    start: Ints
    stop: Ints

    def lacks(self, start: int, stop: int) -> bool:
        """Whether the samples `start <= i < stop` were searched, and are of no stance."""
        within = self.first <= start and stop <= self.last
        return within and not ((self.start < stop) & (start < self.stop)).any()


class CausalStances:
    """Finds footfalls in a stream; `DetectionError` for any detector but SHOE with automatic thresholds."""

    def __init__(self, parameters: CausalParameters = CausalParameters()) -> None:
        p = parameters.stance
        if p.detector != "shoe" or p.threshold is not None or p.false_alarm_rate is not None:
            raise DetectionError("a stream is searched with shoe and automatic thresholds: leave both as they are.")
        self._p = parameters
        self._waiting: deque[tuple[Floats, Floats, Floats]] = deque()
        self._n_waiting = 0
        self._search: _Search | None = None

    def push(self, t: Floats, acc: Floats, gyr: Floats) -> list[Footfall]:
        """Add samples (arguments of `search`) and return the footfalls that they complete, in order."""
        return list(self.search(t, acc, gyr))

    def search(self, t: Floats, acc: Floats, gyr: Floats) -> Iterator[Footfall]:
        """Add samples and yield each footfall that they complete, while `seen` is still the search that found it.

        `t` (n,) s, `acc` (n, 3) m/s^2, `gyr` (n, 3) rad/s: finite, stamps increasing from call to call; n may be 0.
        """
        self._waiting.append((t, acc, gyr))
        self._n_waiting += len(t)
        while self._n_waiting >= (size := FIRST_SAMPLES if self._search is None else self._search.step):
            yield from self._started_search().advance(*self._take(size))

    @property
    def seen(self) -> Seen | None:
        """Stance intervals of the last search; None before the first."""
        return None if self._search is None else self._search.seen

    def finish(self) -> list[Footfall]:
        """Return the footfalls left at the end of the stream; `push` no more after it."""
        if self._search is None and self._n_waiting < 2:
            return []
        return self._started_search().advance(*self._take(self._n_waiting), at_end=True)

    @property
    def stands(self) -> bool:
        """Whether the foot stands at the last samples."""
        return self._search is not None and self._search.stands

    def _started_search(self) -> _Search:
        """Return the search, created at the first call with the median period of the first samples."""
        if self._search is None:
            t = np.concatenate([block[0] for block in self._waiting])[:FIRST_SAMPLES]
            self._search = _Search(float(np.median(np.diff(t))), self._p)
        return self._search

    def _take(self, size: int) -> tuple[Floats, Floats, Floats]:
        """Remove the first `size` queued samples; return stamps (n,), specific force (n, 3) and rate (n, 3)."""
        taken, lacking = [(np.empty(0), np.empty((0, 3)), np.empty((0, 3)))], size
        while lacking:
            block = self._waiting.popleft()
            if len(block[0]) > lacking:
                t, acc, gyr = block
                self._waiting.appendleft((t[lacking:], acc[lacking:], gyr[lacking:]))
                block = t[:lacking], acc[:lacking], gyr[:lacking]
            taken.append(block)
            lacking -= len(block[0])
        self._n_waiting -= size
        t, acc, gyr = (np.concatenate(part) for part in zip(*taken, strict=True))
        return t, acc, gyr


class _Search:
    """Search in a sliding window, advanced by `step` samples at a time."""

    def __init__(self, period_s: float, p: CausalParameters) -> None:
        self.period_s, self._p = period_s, p
        lengths = ((p.step_s, 1), (WINDOW_S, 3), (p.window_s, 100), (p.settle_s, 1), (p.edge_s, 1))
        samples = (max(least, round(seconds / period_s)) for seconds, least in lengths)
        self.step, self._shoe_window, self._window, self._settle, self._edge = samples
        self._reach = self._shoe_window - 1 - self._shoe_window // 2
        keep = self._window + self.step + 4 * self._shoe_window + FIRST_SAMPLES
        self._t, self._level = Sliding(keep), Sliding(keep)
        self._acc, self._gyr = Sliding(keep, (3,)), Sliding(keep, (3,))
        self._passes = [StrapdownPass(link.still_level, MAX_GAP_S) for link in (WALKING, ROUGH)]
        self._velocity = [Sliding(keep, (3,)) for _ in self._passes]
        self._reported, self._stands, self._last_end = 0, False, 0
        self.seen: Seen | None = None

    @property
    def stands(self) -> bool:
        """Whether the last interval found reaches to the last sample, or a standing goes on."""
        stop = self._level.stop
        return self._last_end > stop - self.step or (self._stands and not self._has_swung(self._reported, stop))

    def advance(self, t: Floats, acc: Floats, gyr: Floats, at_end: bool = False) -> list[Footfall]:
        """Add samples, search the window, and return the footfalls that are now final; at the end of the stream all."""
        for column, rows in ((self._t, t), (self._acc, acc), (self._gyr, gyr)):
            column.append(rows)
        if at_end:
            last = self._t.between(self._t.stop - 1, self._t.stop) + self.period_s
            self._extend(self._t.stop, last)
            return list(self._settled(at_end=True))
        if self._t.stop * self.period_s < self._p.warm_up_s:
            return []
        self._extend(self._t.stop - self._reach)
        return list(self._settled(at_end=False))

    def _extend(self, stop: int, after_last: Floats | None = None) -> None:
        """Append log10 SHOE and free velocities up to sample `stop`; `after_last` (1,) s ends the last period."""
        known = self._level.stop
        if stop <= known:
            return
        first = max(0, known - self._shoe_window)
        acc, gyr = self._acc.between(first, self._t.stop), self._gyr.between(first, self._t.stop)
        statistic = shoe(acc, gyr, self._shoe_window)
        self._level.append(np.log10(statistic[known - first : stop - first] + 1e-3))
        t = self._t.between(known, min(stop + 1, self._t.stop))
        t = t if after_last is None else np.append(t, after_last)
        new = (self._acc.between(known, stop), self._gyr.between(known, stop), self._level.between(known, stop))
        for free, velocity in zip(self._passes, self._velocity, strict=True):
            velocity.append(free.velocity(t, *new))

    def _settled(self, at_end: bool) -> Iterator[Footfall]:
        """Yield the final footfalls: with a swing after them, or at the end; of a long standing the piece until now."""
        stop = self._level.stop
        for start, end, threshold in self._footfalls(stop):
            if at_end or (stop - end[-1] >= self._settle and self._is_apart(int(end[-1]), stop)):
                yield self._report(start, end, threshold, int(end[-1]), stands=False)
                continue
            cut = stop - self._edge
            if (cut - start[0]) * self.period_s >= self._p.piece_s:
                inside = start < cut
                yield self._report(start[inside], np.minimum(end[inside], cut), threshold[inside], cut, stands=True)
            return

    def _footfalls(self, stop: int) -> list[tuple[Ints, Ints, Floats]]:
        """Search up to `stop`; return start, stop, log10 threshold (k,) of each footfall not yet reported."""
        first = max(0, stop - self._window)
        t, acc, gyr, level = (x.between(first, stop) for x in (self._t, self._acc, self._gyr, self._level))
        velocity = [column.between(first, stop) for column in self._velocity]
        found = find_footfalls(t, acc, gyr, level, velocity)
        self.seen = Seen(first, stop, found[0] + first, found[1] + first)
        # cut off, or leave out, what was reported or is too close to that; leave out what is too short
        start, end, threshold = self.seen.start, self.seen.stop, found[2]
        if self._reported and not self._stands:
            keep = start >= self._reported
        else:
            keep, start = end > self._reported, np.maximum(start, self._reported)
        keep &= (end - 1 - start) * self.period_s >= MIN_S
        keep[keep] = [not self._follows_too_soon(a, b) for a, b in zip(start[keep], end[keep], strict=True)]
        start, end, threshold = start[keep], end[keep], threshold[keep]
        self._last_end = int(end[-1]) if len(end) else 0
        if len(start) == 0:
            return []
        swings = [self._is_apart(a, b) for a, b in zip(end[:-1], start[1:], strict=True)]
        edges = np.flatnonzero(swings) + 1
        return list(zip(*(np.split(part, edges) for part in (start, end, threshold)), strict=True))

    def _follows_too_soon(self, start: int, stop: int) -> bool:
        """Whether the samples `start <= i < stop`, no rest, follow the last footfall without a swing between."""
        last = self._reported - 1  # sample of that footfall
        is_rest = self._level.between(start, stop).min(initial=np.inf) <= REST_LEVEL
        if self._reported == 0 or start <= last or is_rest:
            return False
        t, gyr = self._t.between(last, start + 1), self._gyr.between(last, start + 1)
        return bool(t[-1] - t[0] < MIN_SWING_S) and is_too_close(t, gyr, 1, start - last)

    def _has_swung(self, start: int, stop: int) -> bool:
        """Whether the foot turns as in a swing in the samples `start <= i < stop`."""
        rate = np.linalg.norm(self._gyr.between(start, stop), axis=1)
        return bool(rate.max(initial=0.0) > SWING_RATE_RAD_S)

    def _is_apart(self, end: int, stop: int) -> bool:
        """Whether the foot swings from the end of an interval to the sample `stop`, or samples are missing."""
        return self._has_swung(end, stop) or len(find_holes(self._t.between(end - 1, min(stop + 1, self._t.stop)))) > 0

    def _report(self, start: Ints, stop: Ints, threshold: Floats, until: int, stands: bool) -> Footfall:
        """Return the footfall of these intervals; mark samples before `until` reported, `stands` if it goes on."""
        continues = self._stands and not self._is_apart(self._reported, int(start[0]))
        relative = [self._level.between(a, b) - x for a, b, x in zip(start, stop, threshold, strict=True)]
        k = int(np.argmin([part.min() for part in relative]))
        stillest = int(start[k] + np.argmin(relative[k]))
        self._reported, self._stands = until, stands
        return Footfall(start, stop, 10.0**threshold, stillest, continues)


def join_footfalls(footfalls: Sequence[Footfall], n_samples: int) -> Stances:
    """Return the stances of `n_samples`: pieces of one footfall become one; `DetectionError` without any."""
    if not footfalls:
        raise DetectionError(f"no stance was found in {n_samples} samples: is the sensor on a foot?")
    start, stop = (np.concatenate([getattr(f, name) for f in footfalls]) for name in ("start", "stop"))
    number = np.cumsum([not f.continues for f in footfalls]) - 1
    footfall = np.repeat(number - number[0], [len(f.start) for f in footfalls])
    joined = np.flatnonzero((start[1:] == stop[:-1]) & (footfall[1:] == footfall[:-1]))
    threshold = float(np.median(np.concatenate([f.threshold for f in footfalls])))
    return Stances(
        np.delete(start, joined + 1), np.delete(stop, joined), np.delete(footfall, joined), n_samples, "shoe", threshold
    )


class Sliding:
    """The last rows of a stream, by their numbers since its beginning; `shape` of a row, `stop` the number so far."""

    def __init__(self, keep: int, shape: tuple[int, ...] = ()) -> None:
        self._keep = keep
        self._rows = np.empty((0, *shape))  # memory is taken when rows come
        self._first = 0
        self.stop = 0

    def append(self, rows: Floats) -> None:
        """Append rows (n, ...)."""
        used = self.stop - self._first
        if used + len(rows) > len(self._rows):
            kept = min(self._keep, used)
            size = max(2 * self._keep, kept + len(rows))
            fresh = np.empty((size, *self._rows.shape[1:]))
            fresh[:kept] = self._rows[used - kept : used]
            self._rows, self._first, used = fresh, self.stop - kept, kept
        self._rows[used : used + len(rows)] = rows
        self.stop += len(rows)

    def between(self, start: int, stop: int) -> Floats:
        """Return the rows `start <= i < stop` as a view that is good until the next `append`.

        Raises `IndexError` if they are no longer there, or not yet.
        """
        if not self._first <= start <= stop <= self.stop:
            raise IndexError(f"rows {start} to {stop} are not among {self._first} to {self.stop}")
        return self._rows[start - self._first : stop - self._first]
