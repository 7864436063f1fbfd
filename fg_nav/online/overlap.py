"""What a source sends again of the samples that the record of a resumed walk holds already.

A source resumes in one of two ways, and its first `HEAD` rows show which:

* It begins again, or somewhat earlier: a file, a logger's buffer. `MIN_KNOWN` of these rows are among those of the
  record, with their stamp and all that was measured. Then all is left out up to the last `TAIL` rows of the record.
* It goes on from a later moment: a socket, a device. Then nothing is left out.

Rows are compared by value. Rows from a gap of the record, which were lost before and come now, are too late: they are
left out too. If the last rows of the record never come, because they were lost this time, `LOST` rows that it does not
hold, and that are not from the gap behind the last one that it holds, are taken for new; at the end of the stream as
many as there are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fg_nav.arrays import Floats, Ints
from fg_nav.online.buffer import COLUMNS

HEAD = 16  # rows that show how a source goes on; so many wait until the last of them is there
MIN_KNOWN = 4  # of them, more than chance makes alike
TAIL = 8  # rows in a row that no walk has twice
LOST = 100  # rows in a row, about a second
UNKNOWN = -1  # in place of a row's number
HASH = np.random.default_rng(0).integers(1 << 62, 1 << 63, COLUMNS, dtype=np.uint64) * np.uint64(2) + np.uint64(1)


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
        """Return those of the held rows and of these (n, 11) that are new; at the end of the stream no row is held on.

        Held are the first `HEAD` rows, and of a stream that began again those of which it is not clear yet whether they
        are new.
        """
        rows, self._held = np.concatenate([self._held, rows]), rows[:0]
        if self.is_over:
            return rows
        if not self.skips:
            if len(rows) < HEAD and not at_end:
                self._held = rows
                return rows[:0]
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
        # where the last rows of the record end
        tail = self._find_tail_end(rows)
        if tail is not None and not (self.is_over and stop + LOST <= tail):
            stop, self.is_over = tail, True
        self.is_over = self.is_over or at_end
        self.left_out += stop
        if self.is_over:
            return rows[stop:]
        self._last = int(last[stop - 1]) if stop else self._last
        self._held, self._before = rows[stop:], np.concatenate([self._before, rows[:stop]])[1 - TAIL :]
        return rows[:0]

    def _find_tail_end(self, rows: Floats) -> int | None:
        """Return the index of the row behind the last ones of the record, as far as they came; None without."""
        came = _fill_missing(np.concatenate([self._before, rows]))
        first = len(self._before)
        for last in np.flatnonzero((came[first:] == self._tail[-1]).all(axis=1)).tolist():
            seen = came[max(0, first + last + 1 - len(self._tail)) : first + last + 1]
            if np.array_equal(seen, self._tail[-len(seen) :]):
                return int(last) + 1
        return None

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
