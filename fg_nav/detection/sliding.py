"""The last samples of a stream, in order and in one piece of memory, whatever the length of the stream.

Rows are counted from the first that was ever appended. At least the last `keep` of them are there.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats


class Sliding:
    """Rows of a stream; `shape` is that of one row. `stop` counts those that were appended so far."""

    def __init__(self, keep: int, shape: tuple[int, ...] = ()) -> None:
        self._keep = keep
        self._rows = np.empty((2 * keep, *shape))
        self._first = 0
        self.stop = 0

    def append(self, rows: Floats) -> None:
        """Append rows (n, ...)."""
        used = self.stop - self._first
        if used + len(rows) > len(self._rows):
            kept = min(self._keep, used)
            size = max(len(self._rows), kept + len(rows))
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
