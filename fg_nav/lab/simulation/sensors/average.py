"""The average over the units of a module."""

from __future__ import annotations

from fg_nav.arrays import Floats


def mean_of(values: list[Floats]) -> Floats:
    """Average arrays of one shape, adding up in place."""
    total = values[0].copy()
    for value in values[1:]:
        total += value
    total /= len(values)
    return total
