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
"""

from __future__ import annotations

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
        self._waiting = np.empty((0, 7))  # stamps, specific forces and rates that no search has seen yet
        self._search: _Search | None = None

    def push(self, t: Floats, acc: Floats, gyr: Floats) -> list[Footfall]:
        """Add samples (arguments of `search`) and return the footfalls that they complete, in order."""
        return list(self.search(t, acc, gyr))

    def search(self, t: Floats, acc: Floats, gyr: Floats) -> Iterator[Footfall]:
        """Add samples and yield each footfall that they complete, while `seen` is still the search that found it.

        `t` (n,) s, `acc` (n, 3) m/s^2, `gyr` (n, 3) rad/s: finite, stamps increasing from call to call; n may be 0.
        """
        self._waiting = np.concatenate([self._waiting, np.column_stack([t, acc, gyr])])
        while len(self._waiting) >= (size := FIRST_SAMPLES if self._search is None else self._search.step):
            yield from self._advance(size)

    @property
    def seen(self) -> Seen | None:
        """Stance intervals of the last search; None before the first."""
        return None if self._search is None else self._search.seen

    def finish(self) -> list[Footfall]:
        """Return the footfalls left at the end of the stream; `push` no more after it."""
        if self._search is None and len(self._waiting) < 2:
            return []
        return self._advance(len(self._waiting), at_end=True)

    @property
    def stands(self) -> bool:
        """Whether the foot stands at the last samples."""
        return self._search is not None and self._search.stands

    def _advance(self, size: int, at_end: bool = False) -> list[Footfall]:
        """Search with the first `size` samples that wait; the first of all have the median period of the samples."""
        if self._search is None:
            self._search = _Search(float(np.median(np.diff(self._waiting[:FIRST_SAMPLES, 0]))), self._p)
        rows, self._waiting = self._waiting[:size], self._waiting[size:]
        return self._search.advance(rows, at_end)


class _Search:
    """Search in a sliding window, advanced by `step` samples at a time.

    Samples are counted from the first of the stream; of each column the last `_keep` rows are there, from `_first` on.
    """

    def __init__(self, period_s: float, p: CausalParameters) -> None:
        self.period_s, self._p = period_s, p
        lengths = ((p.step_s, 1), (WINDOW_S, 3), (p.window_s, 100), (p.settle_s, 1), (p.edge_s, 1))
        samples = (max(least, round(seconds / period_s)) for seconds, least in lengths)
        self.step, self._shoe_window, self._window, self._settle, self._edge = samples
        self._reach = self._shoe_window - 1 - self._shoe_window // 2
        self._keep, self._first = self._window + self.step + 4 * self._shoe_window + FIRST_SAMPLES, 0
        self._t, self._level = np.empty(0), np.empty(0)
        self._acc, self._gyr = np.empty((0, 3)), np.empty((0, 3))
        self._passes = [StrapdownPass(link.still_level, MAX_GAP_S) for link in (WALKING, ROUGH)]
        self._velocity = [np.empty((0, 3)) for _ in self._passes]
        self._reported, self._stands, self._last_end = 0, False, 0
        self.seen: Seen | None = None

    @property
    def stands(self) -> bool:
        """Whether the last interval found reaches to the last sample, or a standing goes on."""
        stop = self._first + len(self._level)
        return self._last_end > stop - self.step or (self._stands and not self._has_swung(self._reported, stop))

    def advance(self, rows: Floats, at_end: bool) -> list[Footfall]:
        """Add samples (n, 7), search the window, and return the footfalls that are now final; at the end all."""
        # the columns, without what no search needs any more
        gone = max(len(self._level) - self._keep, 0)
        self._first += gone
        self._t = np.concatenate([self._t[gone:], rows[:, 0]])
        self._acc = np.concatenate([self._acc[gone:], rows[:, 1:4]])
        self._gyr = np.concatenate([self._gyr[gone:], rows[:, 4:7]])
        self._level, self._velocity = self._level[gone:], [column[gone:] for column in self._velocity]
        # log10 SHOE and free velocities, up to half a window before the last sample
        if at_end:
            self._extend(len(self._t), self._t[-1:] + self.period_s)
            return list(self._settled(at_end=True))
        if (self._first + len(self._t)) * self.period_s < self._p.warm_up_s:
            return []
        self._extend(len(self._t) - self._reach)
        return list(self._settled(at_end=False))

    def _extend(self, stop: int, after_last: Floats | None = None) -> None:
        """Append log10 SHOE and free velocities up to row `stop`; `after_last` (1,) s ends the last period."""
        known = len(self._level)
        if stop <= known:
            return
        first, new = max(0, known - self._shoe_window), slice(known, stop)
        level = np.log10(
            shoe(self._acc[first:], self._gyr[first:], self._shoe_window)[known - first : stop - first] + 1e-3
        )
        t = self._t[known : stop + 1] if after_last is None else np.append(self._t[known:], after_last)
        self._level = np.concatenate([self._level, level])
        self._velocity = [
            np.concatenate([velocity, free.velocity(t, self._acc[new], self._gyr[new], level)])
            for free, velocity in zip(self._passes, self._velocity, strict=True)
        ]

    def _part(self, column: Floats, start: int, stop: int) -> Floats:
        """Rows of a column that are still there, by their numbers since the beginning of the stream."""
        return column[max(start - self._first, 0) : stop - self._first]

    def _settled(self, at_end: bool) -> Iterator[Footfall]:
        """Yield the final footfalls: with a swing after them, or at the end; of a long standing the piece until now."""
        stop = self._first + len(self._level)
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
        first, columns = max(0, stop - self._window), (self._t, self._acc, self._gyr, self._level, *self._velocity)
        t, acc, gyr, level, *velocity = (self._part(column, first, stop) for column in columns)
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
        is_rest = self._part(self._level, start, stop).min(initial=np.inf) <= REST_LEVEL
        if self._reported == 0 or start <= last or is_rest:
            return False
        t, gyr = self._part(self._t, last, start + 1), self._part(self._gyr, last, start + 1)
        return bool(t[-1] - t[0] < MIN_SWING_S) and is_too_close(t, gyr, 1, start - last)

    def _has_swung(self, start: int, stop: int) -> bool:
        """Whether the foot turns as in a swing in the samples `start <= i < stop`."""
        rate = np.linalg.norm(self._part(self._gyr, start, stop), axis=1)
        return bool(rate.max(initial=0.0) > SWING_RATE_RAD_S)

    def _is_apart(self, end: int, stop: int) -> bool:
        """Whether the foot swings from the end of an interval to the sample `stop`, or samples are missing."""
        return self._has_swung(end, stop) or len(find_holes(self._part(self._t, end - 1, stop + 1))) > 0

    def _report(self, start: Ints, stop: Ints, threshold: Floats, until: int, stands: bool) -> Footfall:
        """Return the footfall of these intervals; mark samples before `until` reported, `stands` if it goes on."""
        continues = self._stands and not self._is_apart(self._reported, int(start[0]))
        relative = [self._part(self._level, a, b) - x for a, b, x in zip(start, stop, threshold, strict=True)]
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
