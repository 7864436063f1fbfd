"""What of a resumed stream its checkpoint holds already.

A source may be taken up again in two ways, and its first `HEAD` rows tell which:

* It begins again, or some way back: a file, a logger's buffer. `LEAST` of these rows are among those that the
  checkpoint knows, with the stamp that the sensor gave them and all that it measured. Then all is left out up to the
  last `TAIL` rows that were seen before the checkpoint, those that were not taken and restarts of the clock among them.
* It goes on from a later moment: a socket, a device. Then nothing is left out.

Rows are compared by value, so it does not matter how often the sensor's clock began anew. If the last rows of the
checkpoint never come, because they were lost on the way, `LOST` rows that it does not hold and whose stamps lie behind
its last are believed to be new.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from fg_nav.arrays import Bools, Floats
from fg_nav.online.store import COLUMNS

HEAD = 16
"""Rows that show how a source goes on; so many wait until the last of them is there."""

LEAST = 4
"""Of them, more than chance makes alike; fewer are left out by their stamps."""

TAIL = 8
"""Rows in a row that no walk has twice."""

LOST = 100
"""Rows in a row, about a second."""

TICK_S = 1e-6
"""To which stamps are compared: an offset of the clock and its removal round differently."""


class Overlap:
    """Leaves out the rows of a resumed stream that a checkpoint holds; `known` of them so far.

    Parameters
    ----------
    samples : (N, 10) of the checkpoint.
    clocks : the sample at which each clock of the sensor began, and by how much its stamps were set on, s.
    left : `prints_of` rows that came too, and were left out for their stamps.
    tail : (m, 10) the last usable rows before the checkpoint, as the sensor sent them; m <= `TAIL`.
    held : (n, 10) rows that waited when the checkpoint was saved.
    """

    def __init__(
        self, samples: Floats, clocks: Sequence[tuple[int, float]], left: Iterable[int], tail: Floats, held: Floats
    ) -> None:
        self.known = 0
        self.held = held
        self.is_over = len(tail) == 0
        taken = prints_of(_as_sent(samples, clocks))
        self._prints = np.sort(np.append(taken, np.array(list(left), dtype=np.uint64)))
        self._tail = _plain(tail)
        self._before = np.empty((0, COLUMNS))
        self._skips = False

    def beyond(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return those of the held rows and of these (n, 10) that are new; at the end of the stream none are held."""
        rows, self.held = np.concatenate([self.held, rows]), rows[:0]
        if self.is_over:
            return rows
        if not self._skips:
            if len(rows) < HEAD and not at_end:
                self.held = rows
                return rows[:0]
            self._skips = int(self._holds(rows[:HEAD]).sum()) >= LEAST
            self.is_over = not self._skips
        return rows if self.is_over else self._behind_tail(rows)

    def _behind_tail(self, rows: Floats) -> Floats:
        """Leave out all up to the last rows of the checkpoint, or what is known where they did not come."""
        stop = self._end_of_tail(rows)
        if stop is None:
            stop = int(np.max(np.flatnonzero(self._holds(rows)), initial=-1)) + 1
            unknown = rows[stop:]
            self.is_over = len(unknown) >= LOST and bool((unknown[-LOST:, 0] > self._tail[-1, 0]).all())
            if not self.is_over:
                stop = max(stop, len(rows) - LOST)
                self.held, self._before = rows[stop:], np.concatenate([self._before, rows[:stop]])[1 - TAIL :]
        else:
            self.is_over = True
        self.known += stop
        return rows[stop:] if self.is_over else rows[:0]

    def _end_of_tail(self, rows: Floats) -> int | None:
        """Row after the first at which the last rows of the checkpoint have come, as far as they came at all."""
        came = _plain(np.concatenate([self._before, rows]))
        first = len(self._before)
        for last in np.flatnonzero((came[first:] == self._tail[-1]).all(axis=1)).tolist():
            seen = came[max(0, first + last + 1 - len(self._tail)) : first + last + 1]
            if np.array_equal(seen, self._tail[-len(seen) :]):
                return int(last) + 1
        return None

    def _holds(self, rows: Floats) -> Bools:
        """(n,) True for rows that are samples of the checkpoint."""
        wanted = prints_of(rows)
        at = np.minimum(np.searchsorted(self._prints, wanted), len(self._prints) - 1)
        return np.asarray(self._prints[at] == wanted) if len(self._prints) else np.zeros(len(rows), dtype=np.bool_)


def _as_sent(samples: Floats, clocks: Sequence[tuple[int, float]]) -> Floats:
    """Samples with the stamps that the sensor gave them."""
    sent = samples.copy()
    for first, offset in reversed(clocks):
        sent[first : len(samples), 0] -= offset
        samples = samples[:first]
    return sent


def _plain(rows: Floats) -> Floats:
    """Rows that equal each other where NaN stands too: infinity in its place, which no sample is."""
    return np.where(np.isnan(rows), np.inf, rows)


def prints_of(rows: Floats) -> NDArray[np.uint64]:
    """Return a number (n,) for each row (n, 10) as it was sent; other rows have others, as far as 64 bits go."""
    alike = np.ascontiguousarray(_plain(rows))
    alike[:, 0] = np.rint(alike[:, 0] / TICK_S)
    bits = (alike + 0.0).view(np.uint64)  # + 0: one zero of two
    return np.asarray(((bits ^ (bits >> np.uint64(29))) * _ODD).sum(axis=1, dtype=np.uint64))


_ODD = np.random.default_rng(0).integers(1 << 62, 1 << 63, COLUMNS, dtype=np.uint64) * np.uint64(2) + np.uint64(1)
