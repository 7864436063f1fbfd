"""Counters and clocks of a few bits: they begin again at a known number, and are set on from there.

A step of more than half of that number, up or down, is one over the end. So packets that came in the wrong order stay
what they are, and after a longer pause than half a round the time is wrong by whole rounds.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats

PACKETS_16_BIT = float(2**16)
TICKS_32_BIT = float(2**32)


def continue_counter(count: Floats, end: float) -> tuple[Floats, int]:
    """Counter (N,) that goes on where that of the file begins again at `end`, and how often it does.

    NaN stays NaN. A column that holds numbers beyond the end is no such counter, and stays what it is.
    """
    known = np.flatnonzero(np.isfinite(count))
    if not known.size or count[known].max() >= end or count[known].min() < 0:
        return count, 0
    whole = count.copy()
    whole[known] = np.unwrap(count[known], period=end)
    return whole, int(np.count_nonzero(np.diff(whole[known] - count[known]) > 0.5 * end))
