"""Fewer points that look like all: evenly spread rows of a path, and the envelope of a signal."""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats, Ints


def spread_rows(n: int, at_most: int) -> Ints:
    """At most `at_most` of `n` rows, evenly spread, the first and the last among them."""
    rows = np.arange(0, n, max(-(-(n - 1) // max(at_most - 1, 1)), 1))
    return rows if rows[-1] == n - 1 else np.append(rows, n - 1)


def envelope(t: Floats, value: Floats, bins: int = 2000) -> tuple[Floats, Floats]:
    """Smallest and largest value of each of `bins` slices, in turn: drawn as a line it looks like the whole.

    `t`, `value` (N,); returns at most (2 bins,) of each. NaN is left out; a slice without a number stays NaN.
    """
    if len(t) <= 2 * bins:
        return t, value
    edge = np.linspace(0, len(t), bins, endpoint=False).astype(np.int64)
    low, high = np.fmin.reduceat(value, edge), np.fmax.reduceat(value, edge)
    middle = t[(edge + np.append(edge[1:], len(t))) // 2]
    return np.repeat(middle, 2), np.stack([low, high], axis=1).ravel()
