"""The samples of a walk in progress, one row each: t, acc, gyr, mag.

Kept in chunks, so that a long walk is never copied as a whole while it grows, and can be forgotten from its beginning.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats

COLUMNS = 10
"""t (s), acc (m/s^2), gyr (rad/s), mag (uT; NaN without a sample)."""

CHUNK = 1 << 14
"""Rows; 1.3 MB."""


class SampleStore:
    """Rows (10,) counted from the first of the walk; `stop` of them have come."""

    def __init__(self) -> None:
        self._chunks: list[Floats] = []
        self._first = 0
        self.stop = 0

    def append(self, rows: Floats) -> None:
        """Append rows (n, 10)."""
        while len(rows):
            used = self.stop % CHUNK
            if used == 0:
                self._chunks.append(np.empty((CHUNK, COLUMNS)))
            taken = min(CHUNK - used, len(rows))
            self._chunks[-1][used : used + taken] = rows[:taken]
            self.stop += taken
            rows = rows[taken:]

    def between(self, start: int, stop: int) -> Floats:
        """Return a copy (stop - start, 10) of the rows `start <= i < stop`, which must not have been forgotten."""
        pieces = [np.empty((0, COLUMNS))]
        for number in range(start // CHUNK, -(-stop // CHUNK)):
            chunk, offset = self._chunks[number - self._first], number * CHUNK
            pieces.append(chunk[max(start - offset, 0) : min(stop - offset, CHUNK)])
        return np.concatenate(pieces)

    def forget(self, before: int) -> None:
        """Give back the memory of rows `i < before`; they must not be asked for again."""
        gone = min(before, self.stop) // CHUNK - self._first
        if gone > 0:
            self._chunks = self._chunks[gone:]
            self._first += gone
