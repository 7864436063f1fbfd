"""Samples at the end of a sensor's range: tops too flat for the motion around them; and the peaks rebuilt.

A sensor that clips cuts the tops of its peaks. When the clipping comes before calibration or filtering, the
flat top is not quite constant: the other axes leak in through the calibration, and a low-pass bends its
corners. So:

* flat: neighboring samples near the extreme of an axis whose steps stay below a small share of the extreme;
* cut: within a few samples on either side, the steps are many times larger. On a parabola, the top of any
smooth peak, steps grow linearly from the middle: next to n steps below a bound, the j-th step outside is
below (n + 2 j) / n times the bound. A larger one is a corner;
* recurring: a range ends at the same level every time. One long flat top counts on its own, and so does
one of many peaks that pile up just below the extreme, where those of a natural motion thin out.

Where a signal is printed in steps coarser than what is flat, the extreme itself is counted.

Every sample at or above the lowest of the levels so found counts as clipped.

The peaks are rebuilt from their flanks, which show how steeply a peak was entered and left. Where the clipping comes
before a low-pass, the corners of the top are bent: the steps next to a run are too small, and cut samples next to it do
not reach the level. So a flank is the line through the steepest of the `FLANK_STEPS` steps next to the run, and
the peak reaches from where the line on one side meets the level to where that on the other does, T long. A parabola on
T with the slope s at its ends, the mean of the two, is s T / 4 high; if s was found at a distance d outside, where a
parabola is steeper, its height is H = s T / 4 * T / (T + 2 d), d less one step for flanks that bend the other way. A
sensor's range L is not chosen for motions of a multiple of it, so of H there is taken

    H / (1 + H / (`MAX_RANGES` L)),

and of its area, two thirds of height times T: never less than what was read.

What is rebuilt is off by `OFF_SHARE` of the parabola with d = 0, one sigma, and that is one error for the whole run: a
peak that was higher was so in all its samples. A simulated foot's peak cut at 95 per cent hides 4 deg, rms, and rebuilt
it is off by 1.1; at 85 per cent 5.6 and 2.4, at 70 per cent 10 and 3.4, at 50 per cent 21 and 6.4;
`scripts/sample_errors.py peaks` prints what is left over its sigma.

Runs of more than `MAX_S`, and those without flanks, are left as they are, and may hide as much as they show.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints, find_runs

_NEAR_EXTREME = 0.97  # Flat tops lie above this share of the extreme: calibration smears a level by a per cent or two.
_FLAT = 0.004  # Steps below this share of the extreme are flat.
_CORNER = 6.0  # A corner is a step this many times the flat bound; the parabola's largest within reach is four times.
_REACH = 3  # Samples next to a flat top in which its corner must come, or half the length of the top if that is more.
_LONE_STEPS = 5  # Flat steps of a top that counts though it does not recur.
_CUT_SHARE = 0.1  # Least share of the peaks that reach the level to be cut: chance makes a few flat tops in many.
COARSEST, RECURRENCES, MIN_CUT = 15.0, 2.0, 3  # Of a coarse signal: steps to its extreme, recurrence, cut peaks.
_PILE = 5  # Peaks within a per cent of the extreme that make a pile, if the next per cent holds less than half.
FLANK_STEPS = 4  # Next to a run; a low-pass behind the range bends the first two.
MIN_BEYOND = 0.25  # Samples by which a peak is longer than from its first cut sample to its last, on either side.
MAX_S = 0.3  # A swing lasts 0.4 s: in a longer run there is more than one peak.
MAX_RANGES = 2.0  # A peak is not more than this many ranges beyond the range.
OFF_SHARE = 0.6  # Of what is rebuilt, one sigma: peaks are flatter or more pointed than a parabola.


def find_saturated(samples: Floats, levels: Floats | None = None) -> Bools:
    """Find the clipped samples: those at the end of an axis's range.

    Parameters
    ----------
    samples : (N, 3) of one sensor, evenly sampled, any unit.
    levels : (2, 3) from which on it is clipped, where known; None to find them (`find_clipping_levels`).

    Returns
    -------
    (N, 3) True where an axis is clipped, at either end of its range.
    """
    upper, lower = find_clipping_levels(samples) if levels is None else levels
    return np.asarray((samples >= upper) | (samples <= -lower))


def find_clipping_levels(samples: Floats) -> Floats:
    """Levels (2, 3) from which on each axis is clipped, at its upper and its lower end (with the sign turned about).

    Infinite where it is not. `samples` (N, 3) as in `find_saturated`.
    """
    return np.array([[find_saturation_level(sign * samples[:, axis]) for axis in range(3)] for sign in (1.0, -1.0)])


def find_saturation_level(signal: Floats) -> float:
    """Upper level at which a signal (N,) is clipped, by repeated equal maxima; infinite if it is not."""
    if len(signal) < 2 * _REACH + 2 or not (top := float(np.max(signal))) > 0:
        return np.inf
    step = np.abs(np.diff(signal))
    bound = _FLAT * top
    moving = step[step > 0]
    if not moving.size:
        return np.inf
    if (quantum := float(moving.min())) > bound:
        # coarse steps: of a natural motion the extreme is read less often than the levels next to it, at a range's end
        # more often, by several samples in a row, with corners on either side steeper than those of a parabola
        if top < COARSEST * quantum:
            return np.inf
        below = top - quantum * np.arange(0.5, 4.5)
        counts = [int(np.count_nonzero((signal > low) & (signal <= low + quantum))) for low in below]
        tops = zip(*find_runs((signal[1:] > below[0]) & (signal[:-1] > below[0])), strict=True)
        n_cut = sum(_is_cut(step, run, _CORNER * quantum) for run in tops)
        return top if n_cut >= MIN_CUT and counts[0] >= RECURRENCES * max(*counts[1:], 1) else np.inf
    high = signal >= _NEAR_EXTREME * top
    flat = (step < bound) & high[1:] & high[:-1]
    cut = [
        run
        for run in zip(*find_runs(flat), strict=True)
        if run[1] - run[0] >= 2 and _is_cut(step, run, _CORNER * bound)
    ]
    if not cut:
        return np.inf
    level = min(float(np.min(signal[start : stop + 1])) for start, stop in cut)
    # the end of a range, and no chance shape: one long top, or many, or some that pile up below the extreme
    if any(stop - start >= _LONE_STEPS for start, stop in cut):
        return level
    at_level, upper, both = (len(find_runs(signal >= low)[0]) for low in (level, 0.99 * top, 0.98 * top))
    recurs = len(cut) > 1 or (upper >= _PILE and both - upper < upper / 2)
    return level if recurs and len(cut) >= max(1.0, _CUT_SHARE * at_level) else np.inf


def _is_cut(step: Floats, run: tuple[int, int], corner: float) -> bool:
    """Whether steps beyond `corner` come soon on both sides of a flat run of steps."""
    start, stop = run
    reach = max(_REACH, (stop - start) // 2)
    before, after = step[max(0, start - reach) : start], step[stop : stop + reach]
    return bool(before.size and after.size and before.max() > corner and after.max() > corner)


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

    `levels` (2, 3) from which on they are clipped, as in `find_saturated`. Where nothing was cut the samples are
    returned as they are, and the zeros take no memory.
    """
    clipped = find_saturated(samples, levels)
    if not clipped.any():
        nothing = np.broadcast_to(0.0, samples.shape)
        return Peaks(samples, nothing, nothing)
    peaks = Peaks(samples.copy(), np.zeros(samples.shape), np.zeros(samples.shape))
    for axis in np.flatnonzero(clipped.any(axis=0)):
        for sign in (1.0, -1.0):
            cut = clipped[:, axis] & (sign * samples[:, axis] > 0)
            rise, sigma, run = _rebuild_tops(sign * samples[:, axis], cut, clipped[:, axis], period_s)
            peaks.whole[:, axis] += sign * rise
            peaks.sigma[:, axis] += sigma
            peaks.run[:, axis] += run
    return peaks


def _rebuild_tops(signal: Floats, cut: Bools, clipped: Bools, period_s: float) -> Floats:
    """Rise above the level, its sigma and length of run (3, N) at each sample of a signal (N,) cut at its upper end."""
    found = np.zeros((3, len(signal)))
    edge = np.flatnonzero(np.diff(np.concatenate([[False], cut, [False]]).astype(np.int8)))
    start, stop = edge[::2], edge[1::2]
    count = stop - start
    level = np.add.reduceat(np.append(signal, 0.0), edge)[::2] / np.maximum(count, 1)
    # flanks of each run
    before = _measure_flank(signal, clipped, start, level, -1)
    flanks = np.stack([before, _measure_flank(signal, clipped, stop - 1, level, 1)])
    usable = (count * period_s <= MAX_S) & ~np.isnan(flanks[:, 0]).all(axis=0)
    slope, beyond, outward = np.zeros((3, len(start)))
    slope[usable], beyond[usable], outward[usable] = np.nanmean(flanks[:, :, usable], axis=0)
    # area of the peak beyond the level, and its sigma
    length = count - 1 + 2 * beyond
    area = slope * length**2 / 6 * period_s
    inward = length / np.maximum(length + 2 * outward, 1.0)
    hidden = area * inward / (1 + slope * length * inward / (4 * MAX_RANGES * level))
    off = np.where(usable, OFF_SHARE * area, level * count * period_s)
    # as parabolas over the samples
    within = np.arange(len(start)).repeat(count)
    middle = (np.arange(len(within)) - (np.cumsum(count) - count)[within] + 0.5) / count[within]
    shape = middle * (1 - middle)
    total = np.bincount(within, shape, len(start))
    found[0, cut] = (hidden / total)[within] * shape / period_s
    found[1, cut] = (off / np.sqrt(count))[within] / period_s
    found[2, cut] = count[within]
    return found


def _measure_flank(signal: Floats, clipped: Bools, last: Ints, level: Floats, side: int) -> Floats:
    """Flanks up to the `level` (R,) of runs that begin (`side` -1) or end (1) with the samples `last` (R,).

    Rows of (3, R): steepest slope; distance outside `last` at which its tangent meets the level; and distance of that
    slope from there less one, in samples. NaN without a flank.
    """
    index = last + side * np.arange(FLANK_STEPS + 1)[:, None]
    inside = (index >= 0) & (index < len(signal))
    index = np.clip(index, 0, len(signal) - 1)
    value, cut = signal[index], clipped[index]
    known = inside[1:] & ~cut[1:]
    known[1:] &= ~cut[1:-1]
    step = np.where(known, value[:-1] - value[1:], -np.inf)
    outer = step.argmax(axis=0) + 1
    steepest = np.maximum(np.take_along_axis(step, outer[None] - 1, axis=0)[0], 0.0)
    below = level - np.take_along_axis(value, outer[None], axis=0)[0]
    meets = np.clip(outer - below / np.maximum(steepest, 1e-12), MIN_BEYOND, outer)
    flank = np.stack([steepest, meets, np.maximum(outer - 1.5 - meets, 0.0)])
    return np.where(known.any(axis=0), flank, np.nan)
