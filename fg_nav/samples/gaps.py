"""Lost samples, and the motion within a sample.

What a sensor would have read where a sample is missing follows from how the same foot moves elsewhere.

A sample is the mean over its period T; before a gap it stands for T only, and the h - T up to the next stamp are not
observed. A foot repeats itself, and so a recording shows what lies between such samples. With m the samples of acc and
gyr within R periods on either side, each sensor over its own spread, and l the means of acc and gyr between, those in a
gap are

    l = linear interpolation + W m + c,

W and c by least squares over the windows of the recording, as wide and without a gap, that look most like it: a local
linear regression (Cleveland 1979). Its sigma is measured, not assumed, and large for a long gap, few strides or a
stumble: the larger of what either half of these windows misses the other by, times what W and c are uncertain by, and
of what is in m and in none of these windows. Over a gap in a swing yaw is off by, deg rms, at 100 Hz
(`scripts/sample_errors.py gaps`)

============ ==== ============ =======
lost samples held interpolated learned
============ ==== ============ =======
1            0.34 0.20         0.02
2            0.89 0.62         0.06
4            2.06 1.49         0.13
============ ==== ============ =======

Where there is too little to learn from, and over gaps too long for a mean to stand for what moved, l is the linear
interpolation, and its sigma the spread s of the recording. In a gap of T > `MAX_S` that is no less than the spread
of a walking foot: a foot that stood before the gap may have walked in it.

Coning and sculling: a sample is the mean of rate w and specific force f over its period h, and strapdown integration
holds it. Where both change within the period that misses, to third order in h, the angle and the velocity

    h^3/12 w x w'                     coning: a swinging foot that rolls and pitches out of step seems to turn about up
    h^3/12 (w x f' - w' x f)          sculling

so the sample that integrates to the right angle and velocity, when held, is

    w + h/12 w x dw,     f + h/12 (w x df - dw x f),     with dw = h w', df = h f' from the neighboring samples.

At 100 Hz a walking foot's coning is some 0.035 deg/s about up, like a gyroscope bias that comes and goes with the
gait; it falls with the square of the rate. What is left is of fourth order
(`scripts/sample_errors.py integration`). Source: Savage (1998), "Strapdown inertial navigation integration algorithm
design", parts 1 and 2, for samples that are integrals over their period.

Before that, peaks beyond the sensors' range are rebuilt (`fg_nav.samples.saturation`), and a sample before a gap, held
until the next stamp, is made the mean over all of that time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.system.compiled import njit
from fg_nav.system.spilled import BLOCK_ROWS, drop_pages, empty_column

LOST_PERIODS = 1.5  # After a step between stamps of more periods than this, a sample or more is missing.
REACH = 6  # R, periods on either side: more samples show no more of the gap, and need more windows.

ALIKE = 500
"""Windows that W and c are learned from: several times the 12 R + 1 unknowns, and few enough to be of one phase of
gait."""

MAX_S = 0.1
"""In a longer gap a foot turns too far for one mean of force and rate to stand for its motion, however well known."""

MAX_HELD_S = 0.5
"""Over a longer gap the samples on either side say less of the motion than that a person walked: held, rate and force
are off by the spread of a walking foot (`WALKING`), which turns it by a radian and moves it by 1.4 m before it stands.
On simulated swings the sigmas of the place are alike at 0.45 s (1.25 m), and the errors at 0.7 (1.6 and 1.9 m)."""

MAX_COUNTED_S = 1.0  # Up to here the periods in a gap are counted one by one.

WALKING = np.repeat([5.0, 2.0], 3)
"""Spread of a walking foot's specific force, m/s^2, and rate, rad/s; both axis by axis, however the sensor sits."""

FEWEST = 100  # Windows that a regression needs.

MAX_WINDOWS = 20_000
"""Of those in the recording, evenly taken: minutes of walking; the time to look through them grows with each gap."""

DIGITS = 0.01  # Noise of a sample as a share of the sensor's spread, that W does not follow.


class Gaps(NamedTuple):
    """G gaps and what lies in them.

    `sample` (G,) is the one before each, `unseen_s` (G,) s the time not observed. `acc` and `gyr` (G, 3) m/s^2 and
    rad/s are means over that time; `acc_sigma` and `gyr_sigma` (G, 3) are theirs, axis by axis.
    """

    sample: Ints
    unseen_s: Floats
    acc: Floats
    gyr: Floats
    acc_sigma: Floats
    gyr_sigma: Floats

    def within(self, start: int, stop: int) -> Gaps:
        """Return those between the samples `start <= i < stop`, counted from `start`."""
        there = (self.sample >= start) & (self.sample < stop - 1)
        sigmas = self.acc_sigma[there], self.gyr_sigma[there]
        return Gaps(self.sample[there] - start, self.unseen_s[there], self.acc[there], self.gyr[there], *sigmas)


def find_holes(t: Floats) -> Ints:
    """Find the samples (H,) before gaps between stamps `t` (N,) s that are too long for samples to be held over."""
    return np.flatnonzero(np.diff(t) > MAX_HELD_S)


def cross_holes(t: Floats, sample: Ints) -> Bools:
    """Whether there is a hole (M-1,) between each of the samples (M,), in order, and the next of them."""
    return np.asarray(np.diff(np.searchsorted(find_holes(t), sample)) > 0)


def find_unrecorded(t: Floats, recorded: Floats) -> Bools:
    """Which of the times t (N,) s are before, after or in a hole of stamps `recorded` (M,) s."""
    spans = list_unrecorded(recorded)
    return np.asarray(np.searchsorted(spans[:, 0], t) > np.searchsorted(spans[:, 1], t, side="right"))


def list_unrecorded(recorded: Floats) -> Floats:
    """List the spans (H, 2) s without stamps `recorded` (M,) s: before them, in each hole and after them."""
    hole = find_holes(recorded)
    begins, ends = np.append(recorded[hole], recorded[-1]), np.append(recorded[hole + 1], np.inf)
    return np.stack([np.append(-np.inf, begins), np.append(recorded[0], ends)], axis=1)


def list_bridged(recorded: Floats, beside: Floats) -> Floats:
    """List the holes (H, 2) s in stamps `recorded` (M,) s during which another recording (N,) s went on."""
    holes = list_unrecorded(recorded)[1:-1]
    went_on = [measure_unseen(begin, end, beside) < MAX_HELD_S for begin, end in holes]
    return np.asarray(holes[np.array(went_on, dtype=np.bool_)])


def measure_unseen(begin: float, end: float, t: Floats) -> float:
    """Longest time, s, from begin to end without one of the stamps (N,) s of another recording."""
    within = t[np.searchsorted(t, begin, side="right") : np.searchsorted(t, end)]
    return float(np.diff(np.concatenate([[begin], within, [end]])).max())


def count_periods(t: Floats, period_s: float) -> Ints:
    """Count (N,) how many periods, of samples that are there or missing, each stamp `t` (N,) s is behind the first.

    A gap longer than `MAX_COUNTED_S` counts as one of that: what lies in it is not known from its length.
    """
    most = 4 + np.ceil(MAX_COUNTED_S / period_s)
    return np.concatenate([[0], np.cumsum(np.clip(np.rint(np.diff(t) / period_s), 1, most).astype(np.int64))])


def fill_gaps(t: Floats, acc: Floats, gyr: Floats) -> Gaps:
    """Find the gaps between stamps `t` (N,) s, N > 1, and what lies in them, from specific force and rate (N, 3)."""
    step = np.diff(t)
    period = float(np.median(step))
    gap = np.flatnonzero(step > LOST_PERIODS * period)
    if not len(gap):
        nothing = np.empty((0, 3))
        return Gaps(gap, step[gap], nothing, nothing, nothing, nothing)
    scale = np.repeat([find_spread(acc), find_spread(gyr)], 3)
    values = np.hstack([acc, gyr]) / scale
    tick = count_periods(t, period)
    around = [_find_ticks(tick, int(i)) for i in gap]
    long = _Long(MAX_S / period, WALKING / scale)
    mean, sigma = np.empty((len(gap), 6)), np.empty((len(gap), 6))
    for offsets in set(around):
        here = np.array([one == offsets for one in around])
        mean[here], sigma[here] = _predict(values, gap, gap[here], np.array(offsets), long)
    mean, sigma = mean * scale, sigma * scale
    return Gaps(gap, step[gap] - period, mean[:, :3], mean[:, 3:], sigma[:, :3], sigma[:, 3:])


def find_spread(samples: Floats) -> float:
    """Standard deviation of a sensor, whatever its axes; 1 for one that shows nothing."""
    return float(np.sqrt(samples.var(axis=0).mean())) or 1.0


def _find_ticks(tick: Ints, i: int) -> tuple[int, ...]:
    """Ticks from sample `i`, before a gap, to those samples within `REACH` of the gap that there are."""
    near = tick[max(i + 1 - REACH, 0) : i + 1 + REACH] - tick[i]
    after = tick[i + 1] - tick[i]
    return tuple(int(k) for k in near if -REACH < k < after + REACH)


class _Long(NamedTuple):
    """What a long gap is, in sample periods: of more than `ticks`; and the `least` (6,) spread."""

    ticks: float
    least: Floats


def _predict(values: Floats, gap: Ints, before: Ints, offsets: Ints, long: _Long) -> tuple[Floats, Floats]:
    """Mean and sigma (A, 6) in the gaps behind the samples `before` (A,), of which all have samples at these ticks."""
    after = int(offsets[offsets > 0][0])
    linear = (values[before] + values[before + 1]) / 2
    last = find_windows(gap, len(values), offsets)
    if after > long.ticks:
        return linear, np.tile(np.maximum(values.std(axis=0), long.least), (len(before), 1))
    if len(last) < FEWEST:
        return linear, np.tile(values.std(axis=0), (len(before), 1))
    known = values[last[:, None] + offsets].reshape(len(last), -1)
    total = np.vstack([np.zeros(6), np.cumsum(values, axis=0)])
    between = (total[last + after] - total[last + 1]) / (after - 1)
    beyond = between - (values[last] + values[last + after]) / 2
    near = np.arange(len(offsets)) - np.searchsorted(offsets, 0)
    patterns = values[before[:, None] + near].reshape(len(before), -1)
    found = [regress(known, beyond, one, np.arange(known.shape[1]) % 6) for one in patterns]
    missed = np.array([(one.missed**2).mean(axis=0) * one.stretch for one in found])
    sigma = np.sqrt(np.maximum(missed, [one.strange for one in found]))
    return linear + np.array([one.value for one in found]), sigma


def find_windows(gap: Ints, count: int, offsets: Ints) -> Ints:
    """Sample (M,) from which the offsets count, of each window of the recording that has no gap in it."""
    clear_blocks = [np.empty(0, dtype=np.int64)]
    for start in range(-offsets[0], count - offsets[-1], BLOCK_ROWS):
        last = np.arange(start, min(start + BLOCK_ROWS, count - offsets[-1]))
        gaps_before = np.searchsorted(gap, [last + offsets[0], last + offsets[-1]])
        clear_blocks.append(last[gaps_before[0] == gaps_before[1]])
    clear = np.concatenate(clear_blocks)
    return np.asarray(clear[:: max(1, -(-len(clear) // MAX_WINDOWS))])


def regress(known: Floats, beyond: Floats, pattern: Floats, channel: Ints) -> Regression:
    """What follows (K,) from a `pattern` (C,), by the rows `known` (M, C) most like it and their `beyond` (M, K).

    `channel` (C,) is which of the six of acc and gyr each column is of.
    """
    distance = ((known - pattern) ** 2).sum(axis=1)
    alike = np.sort(np.argpartition(distance, min(ALIKE, len(known)) - 1)[:ALIKE])
    x, y = known[alike] - pattern, beyond[alike]
    half = len(x) // 2
    first, second = _fit_line(x[:half], y[:half]), _fit_line(x[half:], y[half:])
    missed = np.vstack([y[half:] - first.at(x[half:]), y[:half] - second.at(x[:half])])
    line = _fit_line(x, y)
    strange = np.bincount(channel, line.unlike**2, 6) / np.maximum(np.bincount(channel, minlength=6), 1)
    return Regression(line.at_zero, missed, line.stretch, strange)


class Regression(NamedTuple):
    """What a pattern leads to (K,), by how much either half of the rows `missed` (M, K) the other, and its uncertainty.

    `stretch` is how much larger the variance of a prediction is than that of a residual, by the uncertainty of the
    line. `strange` (6,) is the mean square, for each channel, of what is in the pattern but in no row: a motion of its
    own, of which a gap amid it holds as much.
    """

    value: Floats
    missed: Floats
    stretch: float
    strange: Floats


class _Line(NamedTuple):
    """Least squares of y (M, K) over x (M, C): value at zero (K,) and slopes (C, K).

    `stretch` as of a `Regression`; `unlike` (C,) is what is at zero but in no x.
    """

    at_zero: Floats
    slopes: Floats
    stretch: float
    unlike: Floats

    def at(self, x: Floats) -> Floats:
        """Values (M, K) at x (M, C)."""
        return np.asarray(self.at_zero + x @ self.slopes)


def _fit_line(x: Floats, y: Floats) -> _Line:
    """Fit a line; `DIGITS` keeps it from following noise."""
    x_mean, y_mean = x.mean(axis=0), y.mean(axis=0)
    x = x - x_mean
    noise = len(x) * DIGITS**2
    solved = np.linalg.solve(x.T @ x + noise * np.eye(x.shape[1]), np.column_stack([x.T @ (y - y_mean), x_mean]))
    slopes, unlike = solved[:, :-1], solved[:, -1]
    return _Line(y_mean - x_mean @ slopes, slopes, float(1.0 + 1.0 / len(x) + x_mean @ unlike), noise * unlike)


BLOCK = 1 << 16  # Samples that are prepared at once: more need memory, and no longer fit a processor's cache.


def prepare_samples(acc: Floats, gyr: Floats, h: Floats, gaps: Gaps) -> tuple[Floats, Floats]:
    """Specific forces and rates (N, 3), from rebuilt ones, that integrate to the motion when held over `h` (N,) s."""
    force, rate = empty_column(*acc.shape), empty_column(*gyr.shape)
    for start in range(0, len(h), BLOCK):
        stop = min(start + BLOCK, len(h))
        # A sample's change is known from both of its neighbors.
        first, last = max(start - 1, 0), min(stop + 1, len(h))
        inside = np.s_[start - first : stop - first]
        found = _prepare_block(acc[first:last].copy(), gyr[first:last].copy(), h[first:last], gaps, first)
        force[start:stop], rate[start:stop] = found[0][inside], found[1][inside]
        drop_pages()
    return force, rate


def _prepare_block(acc: Floats, gyr: Floats, h: Floats, gaps: Gaps, first: int) -> tuple[Floats, Floats]:
    """Prepare the samples from `first` on; they are written over."""
    inside = (gaps.sample >= first) & (gaps.sample < first + len(h))
    sample = gaps.sample[inside] - first
    share = (gaps.unseen_s[inside] / h[sample])[:, None]
    acc[sample] += share * (gaps.acc[inside] - acc[sample])
    gyr[sample] += share * (gaps.gyr[inside] - gyr[sample])
    return compensate_coning(acc, gyr, h)


@njit(cache=True)
def compensate_coning(acc: Floats, gyr: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Add sculling to specific forces and coning to rates, both (N, 3) means over periods `h` (N,) s, N > 1."""
    force, rate, d_acc, d_gyr = acc.copy(), gyr.copy(), np.empty(3), np.empty(3)
    for i in range(len(h)):
        _differentiate(acc, h, i, d_acc)
        _differentiate(gyr, h, i, d_gyr)
        share = h[i] / 12.0
        for axis in range(3):
            j, k = (axis + 1) % 3, (axis + 2) % 3
            sculling = gyr[i, j] * d_acc[k] - gyr[i, k] * d_acc[j] - d_gyr[j] * acc[i, k] + d_gyr[k] * acc[i, j]
            force[i, axis] += share * sculling
            rate[i, axis] += share * (gyr[i, j] * d_gyr[k] - gyr[i, k] * d_gyr[j])
    return force, rate


@njit(cache=True)
def _differentiate(samples: Floats, h: Floats, i: int, change: Floats) -> None:
    """Write by how much a sample changes over its own period: a parabola's slope, at either end that to the next."""
    before = 0.5 * (h[i - 1] + h[i]) if i > 0 else np.inf
    after = 0.5 * (h[i] + h[i + 1]) if i + 1 < len(h) else np.inf
    from_before = h[i] / before / (1.0 + before / after)
    to_after = h[i] / after / (1.0 + after / before)
    for axis in range(3):
        change[axis] = 0.0
        if i > 0:
            change[axis] += from_before * (samples[i, axis] - samples[i - 1, axis])
        if i + 1 < len(h):
            change[axis] += to_after * (samples[i + 1, axis] - samples[i, axis])
