"""What of a resumed stream its checkpoint holds already.

A source resumes in one of two ways, and its first `HEAD` rows show which:

* It begins again, or somewhat earlier: a file, a logger's buffer. `MIN_KNOWN` of these rows are among those of the
  checkpoint, with the stamp that the sensor gave them and all that it measured. Then all is left out up to the
  last `TAIL` rows that were seen before the checkpoint, those that were not taken and restarts of the clock among them.
* It goes on from a later moment: a socket, a device. Then nothing is left out.

Rows are compared by value. Rows from a gap of the
checkpoint, which were lost before and come now, are too late: they are left out too. If the last rows of the checkpoint
never come, because they were lost this time, `LOST` rows that it does not hold, and that are not from the gap behind
the last one that it holds, are taken for new; at the end of the stream as many as there are.

With a lag a checkpoint holds the first `HEAD` rows of the walk and the last ones. A source that begins again at its
beginning is known by the first of these, and what comes up to the others is too late.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from fg_nav.arrays import Floats, Ints
from fg_nav.online.buffer import COLUMNS

HEAD = 16  # rows that show how a source goes on; so many wait until the last of them is there
MIN_KNOWN = 4  # of them, more than chance makes alike; fewer are left out by their stamps
TAIL = 8  # rows in a row that no walk has twice
LOST = 100  # rows in a row, about a second
LEFT_OUT, UNKNOWN = -1, -2  # in place of a sample's number
TICK_S = 1e-6  # to which stamps are compared: an offset of the clock and its removal round differently
HASH = np.random.default_rng(0).integers(1 << 62, 1 << 63, COLUMNS, dtype=np.uint64) * np.uint64(2) + np.uint64(1)


class Overlap:
    """Leaves out the rows of a resumed stream that a checkpoint holds, `known` so far, and those `late` from its gaps.

    `skips` once it is clear that the stream began again, `is_over` once nothing has to be left out any more; the last
    row that was left out had the stamp `known_until`, s, NaN before there is one.

    Parameters
    ----------
    blocks : of samples, (n, 11) or (n, 12) each, one behind the other.
    clocks : the sample at which each clock of the sensor began, and by how much its stamps were set on, s.
    left : `fingerprint_rows` rows that came too, and were left out for their stamps.
    tail : (m, 11) the last usable rows before the checkpoint, as the sensor sent them; m <= `TAIL`.
    held : (n, 11) rows that waited when the checkpoint was saved.
    first : number of the first sample of the blocks in the walk.
    head : (m, 11) the very first samples of the walk, where those before `first` were discarded.
    """

    def __init__(
        self,
        blocks: Sequence[Floats],
        clocks: Sequence[tuple[int, float]],
        left: Iterable[int],
        tail: Floats,
        held: Floats,
        first: int = 0,
        head: Floats = np.empty((0, COLUMNS)),
    ) -> None:
        self.known, self.late, self.known_until = 0, 0, np.nan
        self.held = held
        self.skips, self.is_over = False, len(tail) == 0
        known: list[NDArray[np.uint64]] = []
        sent_t: list[Floats] = []
        begins = [0, *(first + np.cumsum([0, *map(len, blocks)])).tolist()]
        for at, rows in zip(begins, [head, *blocks], strict=False):
            sent = restore_stamps(rows[:, :COLUMNS], at, clocks)
            known.append(fingerprint_rows(sent))
            sent_t.append(sent[:, 0].copy())
        fingerprints = np.concatenate([*known, np.array(list(left), dtype=np.uint64)])
        order = np.argsort(fingerprints, kind="stable")
        self._fingerprints = fingerprints[order]
        self._sent_t = np.concatenate([*sent_t, [np.nan]])
        self._numbers = np.where(order < len(self._sent_t) - 1, order, LEFT_OUT)
        self._before_hole = len(head) - 1 if first > len(head) else UNKNOWN
        self._tail = _fill_missing(tail)
        self._before = np.empty((0, COLUMNS))
        self._last = -1

    def select_new(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return those of the held rows and of these (n, 11) that are new; at the end of the stream no row is held on.

        Held are the first `HEAD` rows, and of a stream that began again those of which it is not clear yet whether they
        are new.
        """
        rows, self.held = np.concatenate([self.held, rows]), rows[:0]
        if self.is_over:
            return rows
        if not self.skips:
            if len(rows) < HEAD and not at_end:
                self.held = rows
                return rows[:0]
            self.skips = int((self._find_numbers(rows[:HEAD]) != UNKNOWN).sum()) >= MIN_KNOWN
            self.is_over = not self.skips
        return rows if self.is_over else self._skip_to_tail_end(rows, at_end)

    def _skip_to_tail_end(self, rows: Floats, at_end: bool) -> Floats:
        """Return the rows behind the last of the checkpoint, or from `LOST` new ones in a row on; hold the rest."""
        t, numbers = rows[:, 0], self._find_numbers(rows)
        # the last sample of the checkpoint that has come up to each row; -1 before the first
        at = np.maximum.accumulate(np.where(numbers >= 0, np.arange(len(numbers)), -1))
        last = np.where(at >= 0, numbers[at], self._last)
        # rows from the gap between it and the next one, which ends before it begins if the clock restarted in it, and
        # those between what was not discarded
        begin, end = self._sent_t[last], self._sent_t[last + 1]
        in_gap = (t > begin) & (t < end)
        in_gap |= (end < begin) & ((t > begin) | (t < end))
        in_gap |= last == self._before_hole
        is_new = (numbers == UNKNOWN) & ~in_gap
        # where the first run of `LOST` new rows begins, or one at the end that may become so long
        edges = np.concatenate([[-1], np.flatnonzero(~is_new), [len(rows)]])
        long = np.flatnonzero(np.diff(edges) > LOST)
        stop, self.is_over = int(edges[long[0]] if len(long) else edges[-2]) + 1, len(long) > 0
        # where the last rows of the checkpoint end
        tail = self._find_tail_end(rows)
        if tail is not None and not (self.is_over and stop + LOST <= tail):
            stop, self.is_over = tail, True
        self.is_over = self.is_over or at_end
        held = int((numbers[:stop] != UNKNOWN).sum())
        self.known, self.late = self.known + held, self.late + stop - held
        self.known_until = float(rows[stop - 1, 0]) if stop else self.known_until
        if self.is_over:
            return rows[stop:]
        self._last = int(last[stop - 1]) if stop else self._last
        self.held, self._before = rows[stop:], np.concatenate([self._before, rows[:stop]])[1 - TAIL :]
        return rows[:0]

    def _find_tail_end(self, rows: Floats) -> int | None:
        """Return the index of the row behind the last ones of the checkpoint, as far as they came; None without."""
        came = _fill_missing(np.concatenate([self._before, rows]))
        first = len(self._before)
        for last in np.flatnonzero((came[first:] == self._tail[-1]).all(axis=1)).tolist():
            seen = came[max(0, first + last + 1 - len(self._tail)) : first + last + 1]
            if np.array_equal(seen, self._tail[-len(seen) :]):
                return int(last) + 1
        return None

    def _find_numbers(self, rows: Floats) -> Ints:
        """Return the number (n,) of each row in the checkpoint; `LEFT_OUT` if left out, `UNKNOWN` if not in it."""
        if not len(self._fingerprints):
            return np.full(len(rows), UNKNOWN)
        wanted = fingerprint_rows(rows)
        at = np.minimum(np.searchsorted(self._fingerprints, wanted), len(self._fingerprints) - 1)
        return np.where(self._fingerprints[at] == wanted, self._numbers[at], UNKNOWN)


def restore_stamps(samples: Floats, first: int, clocks: Sequence[tuple[int, float]]) -> Floats:
    """Return samples of the walk, from number `first` on, with the stamps that the sensor gave them.

    `clocks` are the sample at which each clock of the sensor began, and by how much its stamps were set on, s.
    """
    begins, offset = np.array(clocks).T
    sent = samples.copy()
    sent[:, 0] -= offset[np.searchsorted(begins, first + np.arange(len(samples)), side="right") - 1]
    return sent


def _fill_missing(rows: Floats) -> Floats:
    """Return rows with infinity, which no sample is, for NaN: so missing readings compare equal."""
    return np.where(np.isnan(rows), np.inf, rows)


def fingerprint_rows(rows: Floats) -> NDArray[np.uint64]:
    """Return a hash (n,) of 64 bits of each row (n, 11) as it was sent."""
    alike = np.ascontiguousarray(_fill_missing(rows))
    alike[:, 0] = np.rint(alike[:, 0] / TICK_S)
    bits = (alike + 0.0).view(np.uint64)  # + 0: one zero of two
    return np.asarray(((bits ^ (bits >> np.uint64(29))) * HASH).sum(axis=1, dtype=np.uint64))
