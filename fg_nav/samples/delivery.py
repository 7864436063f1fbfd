"""What a source sends again, loses, or does not send.

Again. A source that a resumed walk follows either begins again, or somewhat earlier (a file, a logger's buffer), or
goes on from a later moment (a socket, a device). Its first `HEAD` rows show which: `MIN_KNOWN` of them are those of the
record, by value, or not. Where it begins again all is left out up to the last `TAIL` rows of the record, and rows from
a gap of it, lost before, are too late. If those last rows never come, `LOST` rows that the record does not hold, and
that are not from the gap behind the last one that it holds, are taken for new; at the end as many as there are.

Lost. A sensor samples evenly: the clock behind the stamps (`samples.stamps.fit_clock`) numbers its ticks, and a number
that no row has is of a lost sample. A row that is stamped late, the next ones close behind it, is none.
Longer steps than `MAX_STEP_S` are gaps; where most ticks had no row, the stamps show no clock. If the median step is
another in `IN_A_ROW` windows of `WINDOW` rows, the sensor's rate has changed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from fg_nav.arrays import Floats, Ints
from fg_nav.samples.plausibility import find_stamp_problem, median_period_s
from fg_nav.samples.readings import COLUMNS
from fg_nav.samples.stamps import MIN_CLOCKED, fit_clock
from fg_nav.text import format_count

HEAD = 16  # rows that show how a source goes on; so many wait until the last of them is there
MIN_KNOWN = 4  # of them, more than chance makes alike
TAIL = 8  # rows in a row that no walk has twice
LOST = 100  # rows in a row, about a second
UNKNOWN = -1  # in place of a row's number
HASH = np.random.default_rng(0).integers(1 << 62, 1 << 63, COLUMNS, dtype=np.uint64) * np.uint64(2) + np.uint64(1)
WINDOW, IN_A_ROW = 200, 3  # rows, most of whose steps are one period unless every third is lost; windows that agree
AROUND = 60  # rows on either side of a window that show whether one at its edge came late
MAX_STEP_S = 1.0  # from row to row; a longer step is a sensor that was off, or a clock that was set
ANOTHER = 1.2  # times longer or shorter is a period of another rate


class Overlap:
    """Leaves out the rows of a source that are recorded, `recorded` (n, 11) in their order; `left_out` so far.

    `skips` once it is clear that the source began again, `is_over` once nothing has to be left out any more.
    """

    def __init__(self, recorded: Floats) -> None:
        self.left_out, self.is_over = 0, len(recorded) == 0
        self.skips = False
        fingerprints = fingerprint_rows(recorded)
        self._order = np.argsort(fingerprints, kind="stable")
        self._fingerprints = fingerprints[self._order]
        self._t = np.concatenate([recorded[:, 0], [np.nan]])
        self._tail = _fill_missing(recorded[-TAIL:])
        self._before = self._held = np.empty((0, COLUMNS))
        self._last = -1

    def select_new(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return those of the held rows and of these (n, 11) that are new; `at_end` of the stream none is held on."""
        rows, self._held = np.concatenate([self._held, rows]), rows[:0]
        if self.is_over:
            return rows
        if not self.skips and len(rows) < HEAD and not at_end:
            self._held = rows
            return rows[:0]
        if not self.skips:
            self.skips = int((self._find_numbers(rows[:HEAD]) != UNKNOWN).sum()) >= MIN_KNOWN
            self.is_over = not self.skips
        return rows if self.is_over else self._skip_to_tail_end(rows, at_end)

    def _skip_to_tail_end(self, rows: Floats, at_end: bool) -> Floats:
        """Return the rows behind the last of the record, or from `LOST` new ones in a row on; hold the rest."""
        t, numbers = rows[:, 0], self._find_numbers(rows)
        # the last row of the record that has come up to each row; -1 before the first
        at = np.maximum.accumulate(np.where(numbers >= 0, np.arange(len(numbers)), -1))
        last = np.where(at >= 0, numbers[at], self._last)
        # rows from the gap between it and the next one, which ends before it begins if the clock restarted in it
        begin, end = self._t[last], self._t[last + 1]
        in_gap = (t > begin) & (t < end)
        in_gap |= (end < begin) & ((t > begin) | (t < end))
        is_new = (numbers == UNKNOWN) & ~in_gap
        # where the first run of `LOST` new rows begins, or one at the end that may become so long
        edges = np.concatenate([[-1], np.flatnonzero(~is_new), [len(rows)]])
        long = np.flatnonzero(np.diff(edges) > LOST)
        stop, self.is_over = int(edges[long[0]] if len(long) else edges[-2]) + 1, len(long) > 0
        # where the last rows of the record end, as far as they came
        came, first = _fill_missing(np.concatenate([self._before, rows])), len(self._before)
        for last_row in np.flatnonzero((came[first:] == self._tail[-1]).all(axis=1)).tolist():
            seen = came[max(0, first + last_row + 1 - len(self._tail)) : first + last_row + 1]
            if np.array_equal(seen, self._tail[-len(seen) :]):
                if not (self.is_over and stop + LOST <= last_row + 1):
                    stop, self.is_over = last_row + 1, True
                break
        self.is_over = self.is_over or at_end
        self.left_out += stop
        if self.is_over:
            return rows[stop:]
        self._last = int(last[stop - 1]) if stop else self._last
        self._held, self._before = rows[stop:], np.concatenate([self._before, rows[:stop]])[1 - TAIL :]
        return rows[:0]

    def _find_numbers(self, rows: Floats) -> Ints:
        """Return the number (n,) of each row in the record, `UNKNOWN` if it is not in it."""
        wanted = fingerprint_rows(rows)
        at = np.minimum(np.searchsorted(self._fingerprints, wanted), len(self._fingerprints) - 1)
        return np.where(self._fingerprints[at] == wanted, self._order[at], UNKNOWN)


def _fill_missing(rows: Floats) -> Floats:
    """Return rows with infinity, which no sample is, for NaN: so missing readings compare equal."""
    return np.where(np.isnan(rows), np.inf, rows)


def fingerprint_rows(rows: Floats) -> NDArray[np.uint64]:
    """Return a hash (n,) of 64 bits of each row (n, 11)."""
    bits = (np.ascontiguousarray(_fill_missing(rows)) + 0.0).view(np.uint64)  # + 0: one zero of two
    return np.asarray(((bits ^ (bits >> np.uint64(29))) * HASH).sum(axis=1, dtype=np.uint64))


class LossCounter:
    """Counts the samples that are missing by the stamps, whatever the blocks, and those that came."""

    def __init__(self, remark: Callable[[str], None]) -> None:
        self.samples = self.came = 0
        self._remark = remark
        self._window, self._first = np.empty(0), 0  # Stamps, and the first of them that is not counted.
        self._period_s, self._others = np.nan, 0

    def push(self, t: Floats) -> None:
        """Count by the stamps (n,) s of rows as they were sent; NaN is ignored."""
        self.came += len(t)
        self._window = np.concatenate([self._window, t[np.isfinite(t)]])
        while len(self._window) > self._first + WINDOW + AROUND:
            self._count(self._first + WINDOW)
            self._check_rate(self._window[self._first : self._first + WINDOW + 1])
            self._window, self._first = self._window[self._first + WINDOW - AROUND :], AROUND

    def finish(self) -> None:
        """Count, at the end, the rows of a window that is not full."""
        self._count(len(self._window) - 1)
        self._window, self._first = self._window[-1:], 0

    def _count(self, last: int) -> None:
        """Count the samples that are missing behind the rows from the first that is not counted to before `last`."""
        t = self._window
        missing, step = np.zeros(len(t), dtype=np.int64), np.diff(t)
        edges = np.flatnonzero((step <= 0.0) | (step > MAX_STEP_S)) + 1
        for rows in np.split(np.arange(len(t)), edges):
            if len(rows) >= MIN_CLOCKED:
                between = np.diff(fit_clock(t[rows]).tick) - 1
                missing[rows[:-1]] = between * (between.sum() < len(rows))
        missing = missing[self._first : last]
        lost = int(missing.sum())
        if lost and not self.samples:
            first = int(np.argmax(missing > 0))
            self._remark(
                f"samples are lost on the way here, by the stamps: the first {missing[first]} before "
                f"t = {t[self._first + first + 1]:.3f} s."
            )
        self.samples += lost

    def _check_rate(self, t: Floats) -> None:
        """Remark if the rate has changed."""
        period_s = median_period_s(t)
        if find_stamp_problem(period_s) is not None:
            return  # no rate: stamps in another unit
        if not max(period_s / self._period_s, self._period_s / period_s) > ANOTHER:
            self._period_s, self._others = period_s, 0
            return
        self._others += 1
        if self._others == IN_A_ROW:
            self._remark(
                f"the rate of the sensor has changed near t = {t[0]:.3f} s, from {1.0 / self._period_s:.4g} to "
                f"{1.0 / period_s:.4g} Hz."
            )
            self._period_s, self._others = period_s, 0


def describe_losses(lost: Mapping[str, int]) -> tuple[str, ...]:
    """Describe what was lost in all: `samples`, where `came` samples came, and `datagrams`; nothing if nothing was."""
    words = []
    if lost.get("samples"):
        words.append(
            f"by the stamps {format_count(lost['samples'], 'sample')} of {lost['samples'] + lost['came']} were lost "
            "on the way, steps of more than a second not counted"
        )
    if lost.get("datagrams"):
        words.append(f"this machine had no room for {format_count(lost['datagrams'], 'datagram')}")
    return tuple(words)


class Silence:
    """Time without a sample: `stalled_s` is remarked, after `until_silent_s` the walk is over; None to wait on."""

    def __init__(
        self, name: str, stalled_s: float, until_silent_s: float | None, remark: Callable[[str], None]
    ) -> None:
        self._name, self._stalled_s, self._until_silent_s, self._remark = name, stalled_s, until_silent_s, remark
        self._since = time.monotonic()
        self._remarked = False

    def is_over(self, n_samples: int) -> bool:
        """Note how many samples have come; return whether the silence is so long that the walk is over."""
        now = time.monotonic()
        silent = now - self._since
        if n_samples:
            if self._remarked:
                self._remark(f"{self._name} sends again after {silent:.0f} s.")
            self._since, self._remarked = now, False
            return False
        if silent >= self._stalled_s and not self._remarked:
            self._remark(f"no sample has come from {self._name} for {silent:.0f} s: waiting.")
            self._remarked = True
        return self._until_silent_s is not None and silent >= self._until_silent_s
