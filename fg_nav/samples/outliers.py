"""Bad samples: what a sensor on a person cannot have read between what it read before and after.

A bit that flips, a byte that is lost, a connector that shakes: a sample or a few stand far off, and those around go on
as if nothing had been. One sample of 30 rad/s at 200 Hz turns all that follows by 8 deg.

A run of `LONGEST` samples or fewer leaves and returns where its first and its last one are both off by more than the
samples around allow. Off: the least of what it differs by from the sample next to the run, from the line between the
two next to it, and from the curve of third order through the four next to it. How well one can foresee a motion shows
on either side of the run: with c the largest second difference, x_j - (x_j-1 + x_j+1) / 2, of gyroscope or
accelerometer among the `AROUND` samples before and as many behind, what they allow is

    gyroscope        f (1 rad/s + 2 c_gyr + c_acc 0.1 rad/s / (m/s^2))
    accelerometer    f (20 m/s^2 + 6 c_acc)
    magnetometer     f (20 uT + 6 c_mag), among its own samples

since a shoe that is struck turns, which its accelerometer shows: at the very sample too, so where the forces of a run
are good they count in the c_acc of its rates. With a sample every T s f = 2.2 sqrt(T / 5 ms), and no
less than 2.2; where samples are missing it is larger by the square of how much longer the run with its neighbors lasts.
No sample of 80 real recordings, of feet, legs, hands, head and hip at 60 to 400 Hz, is found, nor with every second or
fourth sample alone. In four of them the first would be where f is lowered to 0.6 or 0.5 of that, in all others at less
(`scripts/sample_faults.py clean`).

At the very beginning, where only one side shows how shaken the motion is, and for the last two samples, f is three
times as large. A run is sought from the first sample on, each next to good ones: a stream finds the same `LOOK_AHEAD`
samples later.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.system.compiled import njit
from fg_nav.text import format_count

LONGEST = 6  # Samples of a run; a longer one is a motion, or a sensor that has failed.
AROUND = 4  # Samples on either side that show how shaken it is; `LONGEST` - 2, so that near runs are one, or apart.
LAST = 2  # Samples at the very end that may be a run without others behind it; more are a motion that was cut off.
LOOK_AHEAD = LONGEST + AROUND + 1  # Samples that must be there behind one at which a run may begin.
FACTOR, PERIOD_S = 2.2, 5e-3  # f up to this period: 1.6 times what any recording needs (`sample_faults.py clean`).
GYR_RAD_S, GYR_SHAKEN, GYR_STRUCK = 1.0, 2.0, 0.1
ACC_M_S2, ACC_SHAKEN = 20.0, 6.0
ACC_OUT, GYR_OUT, MAG_OUT = 1, 2, 4  # Of which sensor a run was found; the sum where it is of more.
BOTH_OUT = ACC_OUT + GYR_OUT


class Outliers(NamedTuple):
    """Which samples (N,) the accelerometer and the gyroscope cannot have read."""

    acc: Bools
    gyr: Bools

    @property
    def which(self) -> Ints:
        """Of which sensor each (N,) is: the sum of `ACC_OUT` and `GYR_OUT`."""
        return np.asarray(ACC_OUT * self.acc + GYR_OUT * self.gyr)


def find_outliers(t: Floats, acc: Floats, gyr: Floats, factor: float = FACTOR) -> Outliers:
    """Find bad samples among specific forces and rates (N, 3), m/s^2 and rad/s, at rising stamps (N,) s.

    `factor` is f up to `PERIOD_S`; a smaller one shows how near to it the samples of a recording come.
    """
    found, _ = scan_outliers(t, np.hstack([acc, gyr]), 0, True, factor)
    return Outliers((found & ACC_OUT) > 0, (found & GYR_OUT) > 0)


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


def note_bad(bad: Bools, sensor: str, t: Floats, row: Ints) -> list[str]:
    """Say that samples (N,) of a sensor are bad and not used, bridged where the other sensor was good."""
    if not bad.any():
        return []
    first = int(np.argmax(bad))
    where = f"row {row[first]} (t = {t[first]:.3f} s)"
    words = f"{format_count(int(bad.sum()), 'bad sample')} of the {sensor}"
    return [f"did not use {words}, far off what the samples around allow, the first in {where}"]


@njit(cache=True)
def scan_outliers(t: Floats, x: Floats, begin: int, at_end: bool, factor: float = FACTOR) -> tuple[Ints, int]:
    """Find outliers in x (N, 6), acc and gyr, from sample `begin` on; return sensor bits (N,), and the next to judge.

    Unless it is `at_end`, a sample at which a run may begin is judged once `LOOK_AHEAD` samples are behind it.
    """
    count = len(x)
    found = np.zeros(count, np.int64)
    good = np.arange(max(begin, AROUND + 1))  # the last of them, up to the place `last`
    last = begin
    kept = np.empty(count + len(good), np.int64)
    kept[:last] = good[:last]
    i = begin
    while i < count:
        # most samples go on from the one before: no step is larger than the least that is allowed anywhere
        leaves = last == 0
        for axis in range(6):
            least = ACC_M_S2 if axis < 3 else GYR_RAD_S
            leaves = leaves or abs(x[i, axis] - x[kept[last - 1], axis]) > factor * least
        if not leaves:
            kept[last] = i
            last += 1
            i += 1
            continue
        # a run may begin where the step exceeds what the samples before allow; those behind allow more
        before, may_begin = kept[max(last - AROUND - 1, 0) : last], last == 0
        if last > 0:
            acc, gyr = _measure_shaking(x, before)
            step = np.abs(x[i] - x[before[-1]])
            may_begin = step[:3].max() > factor * (ACC_M_S2 + ACC_SHAKEN * acc)
            may_begin = may_begin or step[3:].max() > factor * (GYR_RAD_S + GYR_SHAKEN * gyr + GYR_STRUCK * acc)
        if may_begin and i + LOOK_AHEAD >= count and not at_end:
            break
        # a run that leaves here and returns
        length, which = _find_run(t, x, before, i, factor) if may_begin else (0, 0)
        for j in range(i, i + length):
            found[j] = which
        if length == 0:
            kept[last] = i
            last += 1
        i += max(length, 1)
    return found, i


@njit(cache=True)
def _find_run(t: Floats, x: Floats, before: Ints, i: int, factor: float) -> tuple[int, int]:
    """Length of the shortest run of outliers from sample i on, and bits `ACC_OUT`, `GYR_OUT`; 0, 0 if none."""
    shaken = _measure_shaking(x, before)
    for length in range(1, LONGEST + 1):
        behind = np.arange(i + length, min(i + length + AROUND + 1, len(x)))
        if i + length > len(x) or (len(behind) < 2 and (len(before) < 2 or len(x) - i > LAST)):
            return 0, 0
        acc, gyr = np.maximum(shaken, _measure_shaking(x, behind))
        # raise the threshold for coarse sampling, missing samples and the ends of the recording
        period = float(np.median(np.concatenate((np.diff(t[before]), np.diff(t[behind])))))
        stretch = np.sqrt(3.0)  # at either end, where only one side shows what the motion is
        if len(before) and len(behind):
            stretch = max((t[behind[0]] - t[before[-1]]) / ((length + 1) * period), 1.0)
        f = factor * (max(np.sqrt(period / PERIOD_S), 1.0) * stretch**2)
        which = 0
        if _measure_run(x, before, behind, i, 0) > f * (ACC_M_S2 + ACC_SHAKEN * acc):
            which += ACC_OUT
        else:  # a strike is in the forces of the same samples
            run = np.concatenate((before[-1:], np.arange(i, i + length), behind[:1]))
            acc = max(acc, _measure_shaking(x, run)[0])
        if _measure_run(x, before, behind, i, 3) > f * (GYR_RAD_S + GYR_SHAKEN * gyr + GYR_STRUCK * acc):
            which += GYR_OUT
        if which:
            return length, which
    return 0, 0


@njit(cache=True)
def _measure_shaking(x: Floats, samples: Ints) -> Floats:
    """Largest deviation (2,) of acc and gyr, any axis, from the mean of both neighbours: half the second difference."""
    largest = np.zeros(2)
    for j in range(1, len(samples) - 1):
        for axis in range(6):
            middle = (x[samples[j - 1], axis] + x[samples[j + 1], axis]) / 2
            largest[axis // 3] = max(largest[axis // 3], abs(x[samples[j], axis] - middle))
    return largest


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
