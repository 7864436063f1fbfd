"""Readings that are not those of the motion: bad samples, and peaks cut at the end of a sensor's range and rebuilt.

Bad samples. A sample or a few stand far off, and those around go on as if nothing had been. A run of `LONGEST` samples
or fewer leaves and returns where its first and its last one are both off by more than the samples around allow. Off:
the least of what it differs by from the sample next to the run, from the line between the two next to it, and from the
curve of third order through the four next to it. With c the largest second difference, x_j - (x_j-1 + x_j+1) / 2, of
gyroscope or accelerometer among the `AROUND` samples before and as many behind, they allow

    gyroscope        f (1 rad/s + 2 c_gyr + c_acc 0.1 rad/s / (m/s^2))
    accelerometer    f (20 m/s^2 + 6 c_acc)
    magnetometer     f (20 uT + 6 c_mag), among its own samples

since a shoe that is struck turns: where the forces of a run are good they count in the c_acc of its rates. With a
sample every T s f = 2.2 sqrt(T / 5 ms), and no less than 2.2; where samples are missing it is larger by the square of
how much longer the run with its neighbors lasts, and at either end, where one side alone shows how shaken the motion
is, three times as large. No sample of 80 real recordings is found, and in all but four none with half of that f
(`sample_faults.py` of b894e160). A run is sought from the first sample on, each next to good ones: a stream finds the
same `LOOK_AHEAD` samples later.

Clipping. A sensor at the end of its range cuts the tops of its peaks, of which calibration or filtering behind it
leaves a top that is not quite constant:

* flat: neighboring samples near the extreme of an axis whose steps stay below a small share of the extreme;
* cut: within a few samples on either side, the steps are many times larger. On a parabola, next to n steps below a
  bound, the j-th step outside is below (n + 2 j) / n times the bound. A larger one is a corner;
* recurring: a range ends at the same level every time. One long flat top counts on its own, and so does one of many
  peaks that pile up just below the extreme, where those of a natural motion thin out.

Every sample at or above the lowest of the levels so found counts as clipped.

The peaks are rebuilt from their flanks. A low-pass behind the clipping bends the corners, so a flank is the line
through the steepest of the `FLANK_STEPS` steps next to the run, and the peak reaches from where the line on one side
meets the level to where that on the other does, T long. A parabola on T with the slope s at its ends, the mean of the
two, is s T / 4 high; if s was found at a distance d outside, where a parabola is steeper, its height is
H = s T / 4 * T / (T + 2 d), d less one step for flanks that bend the other way. A sensor's range L is not chosen for
motions of a multiple of it, so of H there is taken

    H / (1 + H / (`MAX_RANGES` L)),

and of its area, two thirds of height times T: never less than what was read. What is rebuilt is off by `OFF_SHARE` of
the parabola with d = 0, one sigma, and that is one error for the whole run (`sample_errors.py` of b894e160). Runs of
more than `MAX_S`, and those without flanks, are left as they are, and may hide as much as they show.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints, find_runs
from fg_nav.system.compiled import njit, unliteral

COLUMNS = 11  # of a row: t (s), acc (m/s^2), gyr (rad/s), mag (uT), pressure (Pa), the last two NaN without a sample
TAKEN = COLUMNS + 1  # Behind them, once it is judged: which sensor was bad, as `unread` of a recording; 0 for none.

LONGEST = 6  # Samples of a run; a longer one is a motion, or a sensor that has failed.
AROUND = 4  # Samples on either side that show how shaken it is; `LONGEST` - 2, so that near runs are one, or apart.
LAST = 2  # Samples at the very end that may be a run without others behind it; more are a motion that was cut off.
LOOK_AHEAD = LONGEST + AROUND + 1  # Samples that must be there behind one at which a run may begin.
FACTOR, PERIOD_S = 2.2, 5e-3  # f up to this period: 1.6 times what any recording needs.
GYR_RAD_S, GYR_SHAKEN, GYR_STRUCK = 1.0, 2.0, 0.1
ACC_M_S2, ACC_SHAKEN = 20.0, 6.0
ACC_OUT, GYR_OUT, MAG_OUT = 1, 2, 4  # Of which sensor a run was found; the sum where it is of more.
BOTH_OUT = ACC_OUT + GYR_OUT

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


# bad samples


def find_outliers(t: Floats, acc: Floats, gyr: Floats) -> Ints:
    """Sum (N,) of `ACC_OUT` and `GYR_OUT` where acc and gyr (N, 3), m/s^2 and rad/s, at rising t (N,) s, are bad."""
    return scan_outliers(t, np.hstack([acc, gyr]), 0, True)[0]


def find_mag_outliers(t: Floats, mag: Floats) -> Bools:
    """Find bad samples (N,) of a magnetometer, uT, among those of mag (N, 3) that are finite."""
    found = np.zeros(len(t), dtype=np.bool_)
    there = np.isfinite(mag).all(axis=1)
    found[there] = scan_mag(t[there], mag[there], 0, True)[0] > 0
    return found


def scan_mag(t: Floats, mag: Floats, begin: int, at_end: bool) -> tuple[Ints, int]:
    """As `scan_outliers`, of finite samples mag (N, 3); they have the limits in uT that forces have in m/s^2."""
    found, until = scan_outliers(t, np.hstack([mag, np.zeros_like(mag)]), begin, at_end)
    return MAG_OUT * (found > 0), until


def interpolate_unread(t: Floats, acc: Floats, gyr: Floats, unread: Ints) -> None:
    """Write a line into acc or gyr (N, 3) where `unread` (N,), `ACC_OUT` or `GYR_OUT`, marks it as not read."""
    good = unread == 0
    for samples, which in ((acc, ACC_OUT), (gyr, GYR_OUT)):
        bad = (unread & which) > 0
        if bad.any() and good.any():
            for axis in samples.T:
                axis[bad] = np.interp(t[bad], t[good], axis[good])


class OutlierFilter:
    """Leaves bad samples out of rows (n, 11) in order of time, as of a file; one is held until it is clear."""

    def __init__(self) -> None:
        self._held = self._before = self._fields = np.empty((0, COLUMNS))

    def push(self, rows: Floats, at_end: bool = False) -> tuple[Floats, Floats]:
        """Return the good (m, 12) and the bad (k, 12) of these rows and of those that were held; `at_end` none is held.

        The good ones have a line in place of a bad sensor, NaN of a bad field, and the last column of `TAKEN`. The bad
        ones are as they came, with the sum of `ACC_OUT`, `GYR_OUT` and `MAG_OUT`; with the first two they are no good.
        """
        # the last rows of which no sensor was bad, and the last with a field, lead in
        seen, begin = np.concatenate([self._before, self._held, rows]), len(self._before)
        found, stop = scan_outliers(seen[:, 0].copy(), seen[:, 1:7].copy(), begin, at_end)
        # magnetometer, among its own samples
        there = begin + np.flatnonzero((found[begin:stop] != BOTH_OUT) & np.isfinite(seen[begin:stop, 7]))
        series, known = np.concatenate([self._fields, seen[there]]), len(self._fields)
        bad, until = scan_mag(series[:, 0].copy(), series[:, 7:10].copy(), known, at_end)
        found[there] += bad[known:]
        # what an unread sample is bridged to must be judged too
        stop = int(there[until - known]) if until < len(series) else stop
        while not at_end and stop > begin and found[stop - 1] & BOTH_OUT:
            stop -= 1
        # a line, or no field, in place of a bad sensor
        judged = np.column_stack([seen[:stop], found[:stop]])
        good, unread = judged.copy(), found[:stop] & BOTH_OUT
        good[:, COLUMNS] = unread
        interpolate_unread(good[:, 0], good[:, 1:4], good[:, 4:7], unread)
        good[(found[:stop] & MAG_OUT) > 0, 7:10] = np.nan
        good = good[begin:][unread[begin:] != BOTH_OUT]
        lead = -AROUND - 1
        self._before = np.concatenate([self._before, good[good[:, COLUMNS] == 0, :COLUMNS]])[lead:]
        self._fields = np.concatenate([self._fields, good[np.isfinite(good[:, 7]), :COLUMNS]])[lead:]
        self._held = seen[stop:]
        return good, judged[begin:][found[begin:stop] > 0]


@njit(cache=True)
def scan_outliers(t: Floats, x: Floats, begin: int, at_end: bool) -> tuple[Ints, int]:
    """Find outliers in x (N, 6), acc and gyr, from sample `begin` on; return sensor bits (N,), and the next to judge.

    Unless it is `at_end`, a sample at which a run may begin is judged once `LOOK_AHEAD` samples are behind it.
    """
    count, found = len(x), np.zeros(len(x), np.int64)
    kept = np.arange(count)  # the good ones, up to the place `last`
    last = i = begin
    while i < count:
        # most samples go on from the one before: no step is larger than the least that is allowed anywhere
        leaves = last == 0
        for axis in range(6):
            least = ACC_M_S2 if axis < 3 else GYR_RAD_S
            leaves = leaves or abs(x[i, axis] - x[kept[last - 1], axis]) > FACTOR * least
        if not leaves:
            kept[last] = i
            last += 1
            i += 1
            continue
        # a run may begin where the step exceeds what the samples before allow; those behind allow more
        before, may_begin = kept[max(last - AROUND - 1, 0) : last], last == 0
        if last > 0:
            acc, gyr = _measure_shaking(x, before)
            for axis in range(6):
                most = ACC_M_S2 + ACC_SHAKEN * acc if axis < 3 else GYR_RAD_S + GYR_SHAKEN * gyr + GYR_STRUCK * acc
                may_begin = may_begin or abs(x[i, axis] - x[before[-1], axis]) > FACTOR * most
        if may_begin and i + LOOK_AHEAD >= count and not at_end:
            break
        # a run that leaves here and returns
        length, which = _find_run(t, x, before, i) if may_begin else (0, 0)
        for j in range(i, i + length):
            found[j] = which
        if length == 0:
            kept[last] = i
            last += 1
        i += max(length, 1)
    return found, i


@njit(cache=True)
def _find_run(t: Floats, x: Floats, before: Ints, i: int) -> tuple[int, int]:
    """Length of the shortest run of outliers from sample i on, and bits `ACC_OUT`, `GYR_OUT`; 0, 0 if none."""
    shaken = _measure_shaking(x, before)
    for length in range(1, LONGEST + 1):
        behind = np.arange(i + length, min(i + length + AROUND + 1, len(x)))
        if i + length > len(x) or (len(behind) < 2 and (len(before) < 2 or len(x) - i > LAST)):
            return 0, 0
        acc, gyr = _measure_shaking(x, behind)
        acc, gyr = max(acc, shaken[0]), max(gyr, shaken[1])
        # raise the threshold for coarse sampling, missing samples and the ends of the recording
        period = _find_period(t, before, behind)
        stretch = np.sqrt(3.0)  # at either end, where only one side shows what the motion is
        if len(before) and len(behind):
            stretch = max((t[behind[0]] - t[before[-1]]) / ((length + 1) * period), 1.0)
        f = FACTOR * (max(np.sqrt(period / PERIOD_S), 1.0) * stretch**2)
        which = 0
        if _measure_run(x, before, behind, i, unliteral(0)) > f * (ACC_M_S2 + ACC_SHAKEN * acc):
            which += ACC_OUT
        else:  # a strike is in the forces of the same samples
            run = np.arange(i - min(len(before), 1), min(i + length + 1, len(x)))
            run[0] = before[-1] if len(before) else i
            acc = max(acc, _measure_shaking(x, run)[0])
        if _measure_run(x, before, behind, i, unliteral(3)) > f * (GYR_RAD_S + GYR_SHAKEN * gyr + GYR_STRUCK * acc):
            which += GYR_OUT
        if which:
            return length, which
    return 0, 0


@njit(cache=True)
def _find_period(t: Floats, before: Ints, behind: Ints) -> float:
    """Median step of t from each sample to the next, of those before and of those behind; `np.median` compiles 2 s."""
    steps, many = np.empty(len(before) + len(behind)), 0
    for j in range(1, len(steps)):
        k = j - len(before)
        if k != 0:
            step = t[before[j]] - t[before[j - 1]] if k < 0 else t[behind[k]] - t[behind[k - 1]]
            # where it belongs among those so far
            place = many
            while place > 0 and steps[place - 1] > step:
                steps[place] = steps[place - 1]
                place -= 1
            steps[place] = step
            many += 1
    return float(0.5 * (steps[(many - 1) // 2] + steps[many // 2]))


@njit(cache=True)
def _measure_shaking(x: Floats, samples: Ints) -> tuple[float, float]:
    """Largest deviation of acc and of gyr, any axis, from the mean of both neighbours: half the second difference."""
    acc, gyr = 0.0, 0.0
    for j in range(1, len(samples) - 1):
        for axis in range(6):
            off = abs(x[samples[j], axis] - (x[samples[j - 1], axis] + x[samples[j + 1], axis]) / 2)
            acc, gyr = (max(acc, off), gyr) if axis < 3 else (acc, max(gyr, off))
    return acc, gyr


@njit(cache=True)
def _measure_run(x: Floats, before: Ints, behind: Ints, i: int, first_axis: int) -> float:
    """Smaller deviation, first or last sample of the run from i on, from its neighbours, on the worst of three axes."""
    most_first, most_last = 0.0, 0.0
    for axis in range(first_axis, first_axis + 3):
        if len(behind) == 0:  # at the very end: off what the two before it lead to as well
            left, left2, first, last = x[before[-1], axis], x[before[-2], axis], x[i, axis], x[-1, axis]
            most_first = max(most_first, min(abs(first - left), abs(first - 2 * left + left2)))
            most_last = max(most_last, min(abs(last - left), abs(last - 2 * left + left2)))
            continue
        first, last = x[i, axis], x[behind[0] - 1, axis]
        right = x[behind[0], axis]
        if len(before) == 0:  # a run at the very beginning
            most_first, most_last = max(most_first, abs(first - right)), max(most_last, abs(last - right))
            continue
        left, width = x[before[-1], axis], behind[0] - i + 1.0
        off_first = min(abs(first - left), abs(first - (left + (right - left) / width)))
        off_last = min(abs(last - right), abs(last - (right + (left - right) / width)))
        if len(before) > 1 and len(behind) > 1:
            left2, right2 = x[before[-2], axis], x[behind[1], axis]
            off_first = min(off_first, abs(first - _interpolate(left2, left, right, right2, width)))
            off_last = min(off_last, abs(last - _interpolate(right2, right, left, left2, width)))
        most_first, most_last = max(most_first, off_first), max(most_last, off_last)
    return min(most_first, most_last)


@njit(cache=True)
def _interpolate(near2: float, near: float, far: float, far2: float, width: float) -> float:
    """Value at 1 of the cubic through samples at -1, 0, `width` and `width` + 1."""
    w = width
    return (
        near2 * (1 - w) * -w / ((-1) * (-1 - w) * (-2 - w))
        + near * 2 * (1 - w) * -w / (-w * (-w - 1))
        + far * 2 * -w / ((w + 1) * w * -1)
        + far2 * 2 * (1 - w) / ((w + 2) * (w + 1))
    )


# clipped peaks


def find_saturated(samples: Floats, levels: Floats | None = None) -> Bools:
    """Find where samples (N, 3) of one sensor, evenly sampled, are clipped: at either end of an axis's range.

    `levels` (2, 3) from which on they are, where known; None to find them (`find_clipping_levels`).
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

    `levels` (2, 3) from which on they are clipped, as in `find_saturated`.
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
