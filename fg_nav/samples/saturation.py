"""Samples at the end of a sensor's range: tops too flat for the motion around them.

A sensor that clips cuts the tops of its peaks. When the clipping comes before calibration or filtering, the
flat top is not quite constant: the other axes leak in through the calibration, and a low-pass bends its
corners. So:

* flat: neighboring samples near the extreme of an axis whose steps stay below a small share of the extreme;
* cut: within a few samples on either side, the steps are many times larger. On a parabola, the top of any
smooth peak, steps grow linearly from the middle: next to n steps below a bound, the j-th step outside is
below (n + 2 j) / n times the bound. A larger one is a corner;
* recurring: a range ends at the same level every time. One long flat top counts on its own, and so does
one of many peaks that pile up just below the extreme, where those of a natural motion thin out.

Every sample at or above the lowest of the levels so found counts as saturated.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from fg_nav.arrays import Bools, Floats

_NEAR_EXTREME = 0.97
"""Flat tops lie above this share of the extreme: calibration smears a level by a per cent or two."""

_FLAT = 0.004
"""Steps below this share of the extreme are flat."""

_CORNER = 6.0
"""A corner is a step this many times the flat bound; the parabola's largest within reach is four times."""

_REACH = 3
"""Samples next to a flat top in which its corner must come, or half the length of the top if that is more."""

_LONE_STEPS = 5
"""Flat steps of a top that counts though it does not recur."""

_CUT_SHARE = 0.1
"""At least this share of the peaks that reach the level must be cut: chance makes a few flat tops in many."""

_PILE = 5
"""Peaks within a per cent of the extreme that make a pile, if the next per cent holds less than half."""


def find_saturated(samples: Floats, levels: Floats | None = None) -> Bools:
    """Find the samples at the end of an axis's range.

    Parameters
    ----------
    samples : (N, 3) of one sensor, evenly sampled, any unit.
    levels : (2, 3) from which on it is clipped, where known; None to find them (`find_clipping_levels`).

    Returns
    -------
    (N, 3) True where an axis is saturated, at either end of its range.
    """
    upper, lower = find_clipping_levels(samples) if levels is None else levels
    return np.asarray((samples >= upper) | (-samples >= lower))


def find_clipping_levels(samples: Floats) -> Floats:
    """Levels (2, 3) from which on each axis is clipped, at its upper and its lower end (with the sign turned about).

    Infinite where it is not. `samples` (N, 3) as in `find_saturated`.
    """
    return np.array([[find_saturation_level(sign * samples[:, axis]) for axis in range(3)] for sign in (1.0, -1.0)])


def find_saturation_level(signal: Floats) -> float:
    """Level from which on a signal (N,) is clipped at its upper end; infinite if it is not."""
    if len(signal) < 2 * _REACH + 2 or not (top := float(np.max(signal))) > 0:
        return np.inf
    step = np.abs(np.diff(signal))
    bound = _FLAT * top
    moving = step[step > 0]
    if not moving.size or moving.min() > bound:  # too coarsely quantized to tell flat from still
        return np.inf
    high = signal >= _NEAR_EXTREME * top
    flat = (step < bound) & high[1:] & high[:-1]
    cut = [run for run in _runs(flat) if run[1] - run[0] >= 2 and _is_cut(step, run, _CORNER * bound)]
    if not cut:
        return np.inf
    level = min(float(np.min(signal[start : stop + 1])) for start, stop in cut)
    return level if _recurs(signal, cut, level) else np.inf


def _recurs(signal: Floats, cut: list[tuple[int, int]], level: float) -> bool:
    """Whether cut tops are the end of a range and not a chance shape."""
    if any(stop - start >= _LONE_STEPS for start, stop in cut):
        return True
    if len(cut) < max(1.0, _CUT_SHARE * _peaks_above(signal, level)):
        return False
    top = float(np.max(signal))
    upper, both = (_peaks_above(signal, share * top) for share in (0.99, 0.98))
    return len(cut) > 1 or (upper >= _PILE and both - upper < upper / 2)


def _peaks_above(signal: Floats, level: float) -> int:
    """Count the times a signal rises to a level."""
    above = signal >= level
    return int(np.count_nonzero(above[1:] & ~above[:-1]) + above[0])


def _runs(flat: Bools) -> list[tuple[int, int]]:
    """List the runs `start <= i < stop` of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flat, [False])).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in list(pairwise(edges))[::2]]


def _is_cut(step: Floats, run: tuple[int, int], corner: float) -> bool:
    """Whether steps beyond `corner` come soon on both sides of a flat run of steps."""
    start, stop = run
    reach = max(_REACH, (stop - start) // 2)
    before, after = step[max(0, start - reach) : start], step[stop : stop + reach]
    return bool(before.size and after.size and before.max() > corner and after.max() > corner)
