"""The last rows of a stream, by their numbers since its beginning; what is older is forgotten."""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats


class Sliding:
    """Rows of a stream; `shape` is that of one row. `stop` counts those that were appended so far."""

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

    def copy(self) -> Sliding:
        """Return a copy of the rows that must be there."""
        found = Sliding.__new__(Sliding)
        found._keep, found.stop = self._keep, self.stop
        found._first = max(self._first, self.stop - self._keep)
        found._rows = self._rows[found._first - self._first : self.stop - self._first].copy()
        return found

    def is_sound(self, fresh: Sliding) -> bool:
        """Whether it can have come of one that was fresh."""
        same = self._keep == fresh._keep and self._rows.shape[1:] == fresh._rows.shape[1:]
        return same and 0 <= self.stop - self._first <= len(self._rows) and self._first >= 0

    def between(self, start: int, stop: int) -> Floats:
        """Return the rows `start <= i < stop` as a view that is good until the next `append`.

        Raises `IndexError` if they are no longer there, or not yet.
        """
        if not self._first <= start <= stop <= self.stop:
            raise IndexError(f"rows {start} to {stop} are not among {self._first} to {self.stop}")
        return self._rows[start - self._first : stop - self._first]

    def all(self) -> Floats:
        """Return the rows that must be there."""
        return self.between(max(self._first, self.stop - self._keep), self.stop)


def are_samples(t: Floats, acc: Floats, gyr: Floats) -> bool:
    """Whether stamps (n,) rise, and force and rate (n, 3) of each are known."""
    known = all(bool(np.isfinite(one).all()) for one in (t, acc, gyr))
    return known and bool((np.diff(t) > 0.0).all())
