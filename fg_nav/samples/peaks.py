"""Clipped peaks, rebuilt from their flanks, and how far what is rebuilt may be off.

A sensor cuts what is beyond its range (`fg_nav.samples.saturation` finds where). The flanks of a run of n cut samples,
T = n h long, tell how steeply the peak was entered and left. The parabola that stands on the run with these slopes, s
the mean of the two, is s T / 4 high. A sensor's range L is not chosen for motions of a multiple of it, so of that
height H there is taken

    H / (1 + H / (`MOST_RANGES` L)),

and of its area, two thirds of height times T: never less than what was read. A slope is the steeper of the last whole
step next to the run and the step into it, which the clipping can only have made smaller.

What is rebuilt is off by `OFF_SHARE` of the parabola, one sigma, and that is one error for the whole run: a peak that
was higher was so in all its samples. A simulated foot's peak cut at 95 per cent hides 4 deg, rms, and rebuilt it is off
by 1.1; at 85 per cent 5.6 and 2.4, at 70 per cent 10 and 3.4; `scripts/sample_errors.py
peaks` prints what is left over its sigma.

Runs of more than `LONGEST_S`, and those without flanks, are left as they are, and may hide as much as they show.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.samples.saturation import find_saturated

LONGEST_S = 0.3
"""A swing lasts 0.4 s: in a longer run there is more than one peak."""

MOST_RANGES = 2.0
"""A peak is not more than this many ranges beyond the range."""

OFF_SHARE = 0.6
"""Of what is rebuilt, one sigma: peaks are flatter or more pointed than a parabola."""


class Peaks(NamedTuple):
    """Samples (N, 3) with the peaks that were cut, and for each the sigma (N, 3) of what is still missing.

    The errors of the samples of a run are one error. The sigmas are those of independent ones that add up to it over
    the run: so they can be taken sample by sample. `run` (N, 3) is how many samples the run has. Both are zero where
    nothing was cut.
    """

    whole: Floats
    sigma: Floats
    run: Floats


def rebuild_peaks(samples: Floats, period_s: float, levels: Floats | None = None) -> Peaks:
    """Rebuild the peaks of rates or specific forces (N, 3), one sample every `period_s`.

    `levels` (2, 3) from which on they are clipped, as in `find_saturated`.
    """
    peaks = Peaks(samples.copy(), np.zeros(samples.shape), np.zeros(samples.shape))
    clipped = find_saturated(samples, levels)
    for axis in np.flatnonzero(clipped.any(axis=0)):
        for sign in (1.0, -1.0):
            cut = clipped[:, axis] & (sign * samples[:, axis] > 0)
            rise, sigma, run = _rebuild_tops(sign * samples[:, axis], cut, clipped[:, axis], period_s)
            peaks.whole[:, axis] += sign * rise
            peaks.sigma[:, axis] += sigma
            peaks.run[:, axis] += run
    return peaks


def _rebuild_tops(signal: Floats, cut: Bools, clipped: Bools, period_s: float) -> Floats:
    """What to add to each sample of a signal (N,) that is cut at its upper end, sigma and length of run: (3, N)."""
    found = np.zeros((3, len(signal)))
    edge = np.flatnonzero(np.diff(np.concatenate([[False], cut, [False]]).astype(np.int8)))
    start, stop = edge[::2], edge[1::2]
    count = stop - start
    slope = _measure_slope(signal, clipped, start, -1, period_s), _measure_slope(signal, clipped, stop - 1, 1, period_s)
    usable = (count * period_s <= LONGEST_S) & ~(np.isnan(slope[0]) & np.isnan(slope[1]))
    mean_slope = np.zeros(len(start))
    mean_slope[usable] = np.nanmean(np.array(slope)[:, usable], axis=0)
    height = mean_slope * count * period_s / 4
    area = 2 / 3 * height * count * period_s
    hidden = area / (1 + height / (MOST_RANGES * signal[start]))
    off = np.where(usable, OFF_SHARE * area, np.add.reduceat(np.append(signal, 0.0), edge)[::2] * period_s)
    within = np.arange(len(start)).repeat(count)
    middle = (np.arange(len(within)) - (np.cumsum(count) - count)[within] + 0.5) / count[within]
    shape = middle * (1 - middle)
    total = np.bincount(within, shape, len(start))
    found[0, cut] = (hidden / total)[within] * shape / period_s
    found[1, cut] = (off / np.sqrt(count))[within] / period_s
    found[2, cut] = count[within]
    return found


def _measure_slope(signal: Floats, clipped: Bools, last: Ints, side: int, period_s: float) -> Floats:
    """How steeply (R,) the signal rises to the samples `last` (R,) from before (`side` -1) or behind (1).

    NaN where there is nothing.
    """
    inside = (last + side >= 0) & (last + side < len(signal))
    outer = np.where(inside, last + side, last)
    beyond = np.clip(outer + side, 0, len(signal) - 1)
    into = signal[last] - signal[outer]
    whole = np.where(clipped[outer] | clipped[beyond], 0.0, signal[outer] - signal[beyond])
    return np.where(inside, np.maximum(np.maximum(into, whole), 0.0) / period_s, np.nan)
