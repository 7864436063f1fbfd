"""Lost samples, those that one sensor did not read, and the motion within a sample.

A sample is the mean over its period T; before a gap it stands for T only, and the h - T up to the next stamp are not
observed. A foot repeats itself, and so a recording shows what lies between such samples. With m the samples of acc and
gyr within R periods on either side, each sensor over its own spread, and l the means of acc and gyr between, those in a
gap are

    l = linear interpolation + W m + c,

W and c by least squares over the windows of the recording, as wide and without a gap, that look most like it: a local
linear regression (Cleveland 1979). Its sigma is measured: the larger of what either half of these windows misses the
other by, times what W and c are uncertain by, and of what is in m and in none of these windows. Over a gap of four
samples in a swing at 100 Hz yaw is off by 2.1 deg rms held, 1.5 interpolated, 0.13 learned (`sample_errors.py
gaps`). Where there is too little to learn from, and over gaps too long for a mean to stand for what moved, l is the
linear interpolation, and its sigma the spread s of the recording; in a gap of T > `MAX_S` no less than the spread of a
walking foot: a foot that stood before the gap may have walked in it.

What one sensor did not read while the other did follows from the samples within R periods on either side, of both
sensors, and from those of the other sensor between: with m all of these, the n samples of a run are

    x_k = linear interpolation + W_k m + c_k,        k = 1 .. n,

W and c as in a gap. The sigma of their mean, s, is measured there too. The errors of a run are one error, so each
sample is given the s sqrt(n) of independent ones that add up to it. Detectors use the linear interpolation in time
between the nearest samples of which both sensors are good: a stream knows no more when it passes them on.

Coning and sculling: a sample is the mean of rate w and specific force f over its period h, and strapdown integration
holds it. Where both change within the period that misses, to third order in h, the angle and the velocity

    h^3/12 w x w'                     coning: a swinging foot that rolls and pitches out of step seems to turn about up
    h^3/12 (w x f' - w' x f)          sculling

so the sample that integrates to the right angle and velocity, when held, is

    w + h/12 w x dw,     f + h/12 (w x df - dw x f),     with dw = h w', df = h f' from the neighboring samples.

At 100 Hz a walking foot's coning is some 0.035 deg/s about up; it falls with the square of the rate, and what is left
is of fourth order. Source: Savage (1998), "Strapdown inertial navigation integration algorithm design", parts 1 and 2,
for samples that are integrals over their period.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints, find_runs
from fg_nav.samples.readings import ACC_OUT, GYR_OUT
from fg_nav.system.compiled import njit

LOST_PERIODS = 1.5  # After a step between stamps of more periods than this, a sample or more is missing.
REACH = 6  # R, periods on either side: more samples show no more of the gap, and need more windows.
ALIKE = 500  # Windows that W and c are learned from: several times the 12 R + 1 unknowns, few enough of one gait phase.
MIN_WINDOWS, MAX_WINDOWS = 100, 20_000  # Of a regression, evenly taken: minutes of walking; the time grows with them.
DIGITS = 0.01  # Noise of a sample as a share of the sensor's spread, that W does not follow.
MAX_S = 0.1  # In a longer gap a foot turns too far for one mean of force and rate to stand for its motion.
MAX_COUNTED_S = 1.0  # Up to here the periods in a gap are counted one by one; a longer one counts as one of that.
BLOCK = 1 << 16  # Samples that are prepared at once: more need memory, and no longer fit a processor's cache.

# In a longer gap the samples on either side show only that a person walked: held, rate and force are off by the spread
# of a walking foot (`WALKING`), which turns it by a radian and moves it by 1.4 m before it stands. On simulated swings
# the sigmas of the place are alike at 0.45 s (1.25 m), and the errors at 0.7 (1.6 and 1.9 m).
MAX_HELD_S = 0.5
WALKING = np.repeat([5.0, 2.0], 3)  # Spread of a walking foot's force, m/s^2, and rate, rad/s, each axis.


class Gaps(NamedTuple):
    """G gaps and what lies in them."""

    sample: Ints  # (G,) before each.
    unseen_s: Floats  # (G,) s, the time not observed.
    acc: Floats  # (G, 3) m/s^2, mean over that time,
    gyr: Floats  # (G, 3) rad/s,
    acc_sigma: Floats  # (G, 3), axis by axis.
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
    """(M-1,) True where there is a hole between one of the samples (M,), in order, and the next."""
    return np.asarray(np.diff(np.searchsorted(find_holes(t), sample)) > 0)


def find_unrecorded(t: Floats, recorded: Floats) -> Bools:
    """(N,) True where a time t (N,) s is before, after or in a hole of stamps `recorded` (M,) s."""
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
    """Count (N,) how many periods, of samples that are there or missing, each stamp `t` (N,) s is behind the first."""
    most = 4 + np.ceil(MAX_COUNTED_S / period_s)
    return np.concatenate([[0], np.cumsum(np.clip(np.rint(np.diff(t) / period_s), 1, most).astype(np.int64))])


def fill_gaps(t: Floats, acc: Floats, gyr: Floats) -> Gaps:
    """Find the gaps between stamps `t` (N,) s, N > 1, and estimate the force and rate (N, 3) in them."""
    step = np.diff(t)
    period = float(np.median(step))
    gap = np.flatnonzero(step > LOST_PERIODS * period)
    if not len(gap):
        return Gaps(gap, step[gap], *[np.empty((0, 3))] * 4)
    scale = np.repeat([find_spread(acc), find_spread(gyr)], 3)
    values = np.hstack([acc, gyr]) / scale
    tick = count_periods(t, period)
    # ticks of the samples within `REACH` of each gap, from the one before it
    around = []
    for i in gap.tolist():
        near, after = tick[max(i + 1 - REACH, 0) : i + 1 + REACH] - tick[i], tick[i + 1] - tick[i]
        around.append(tuple(int(k) for k in near if -REACH < k < after + REACH))
    mean, sigma = np.empty((len(gap), 6)), np.empty((len(gap), 6))
    for offsets in set(around):
        here = np.array([one == offsets for one in around])
        mean[here], sigma[here] = _predict(values, gap, gap[here], np.array(offsets), MAX_S / period, WALKING / scale)
    mean, sigma = mean * scale, sigma * scale
    return Gaps(gap, step[gap] - period, mean[:, :3], mean[:, 3:], sigma[:, :3], sigma[:, 3:])


def find_spread(samples: Floats) -> float:
    """Standard deviation of a sensor over all axes; 1 for a constant one."""
    return float(np.sqrt(samples.var(axis=0).mean())) or 1.0


def _predict(
    values: Floats, gap: Ints, before: Ints, offsets: Ints, max_ticks: float, walking: Floats
) -> tuple[Floats, Floats]:
    """Mean and its sigma (A, 6) of force and rate over the gaps after samples `before` (A,), by regression.

    Regressors are the samples at ticks `offsets` from `before`. A gap of more than `max_ticks` periods is not
    regressed: its sigma is at least `walking` (6,).
    """
    after = int(offsets[offsets > 0][0])
    linear = (values[before] + values[before + 1]) / 2
    last = find_windows(gap, len(values), offsets)
    if after > max_ticks:
        return linear, np.tile(np.maximum(values.std(axis=0), walking), (len(before), 1))
    if len(last) < MIN_WINDOWS:
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
    """Origins (M,) of training windows: samples with no gap between the first and the last of `offsets`."""
    origin = np.arange(-offsets[0], count - offsets[-1])
    gaps_before = np.searchsorted(gap, origin + offsets[0])
    clear = origin[gaps_before == np.searchsorted(gap, origin + offsets[-1])]
    return np.asarray(clear[:: max(1, -(-len(clear) // MAX_WINDOWS))])


def regress(known: Floats, beyond: Floats, pattern: Floats, channel: Ints) -> Regression:
    """Local linear regression of `beyond` (M, K) at `pattern` (C,) on the rows of `known` (M, C) nearest to it.

    `channel` (C,) is the sensor axis, 0 to 5, of each column. The two halves validate each other.
    """
    distance = ((known - pattern) ** 2).sum(axis=1)
    alike = np.sort(np.argpartition(distance, min(ALIKE, len(known)) - 1)[:ALIKE])
    x, y = known[alike] - pattern, beyond[alike]
    half = len(x) // 2
    first, second = _fit_line(x[:half], y[:half]), _fit_line(x[half:], y[half:])
    missed = np.vstack([y[half:] - (first[0] + x[half:] @ first[1]), y[:half] - (second[0] + x[:half] @ second[1])])
    at_zero, _, stretch, unlike = _fit_line(x, y)
    strange = np.bincount(channel, unlike**2, 6) / np.maximum(np.bincount(channel, minlength=6), 1)
    return Regression(at_zero, missed, stretch, strange)


class Regression(NamedTuple):
    """Predicted values (K,), and residuals `missed` (M, K) of either half of the rows by the line of the other.

    `stretch` is how much larger the variance of a prediction is than that of a residual, by the uncertainty of the
    line. `strange` (6,) is the mean square, for each channel, of what is in the pattern but in no row: a motion of its
    own, of which a gap amid it holds as much.
    """

    value: Floats
    missed: Floats
    stretch: float
    strange: Floats


def _fit_line(x: Floats, y: Floats) -> tuple[Floats, Floats, float, Floats]:
    """Least squares of y (M, K) over x (M, C): value at zero (K,), slopes (C, K), `stretch`, `unlike` (C,).

    `stretch` is as in `Regression`; `unlike` is the part of the pattern outside the span of x. Ridge regression by
    `DIGITS` keeps the slopes from following noise.
    """
    x_mean, y_mean = x.mean(axis=0), y.mean(axis=0)
    x = x - x_mean
    noise = len(x) * DIGITS**2
    solved = np.linalg.solve(x.T @ x + noise * np.eye(x.shape[1]), np.column_stack([x.T @ (y - y_mean), x_mean]))
    slopes, unlike = solved[:, :-1], solved[:, -1]
    return y_mean - x_mean @ slopes, slopes, float(1.0 + 1.0 / len(x) + x_mean @ unlike), noise * unlike


# samples that one sensor did not read


class Bridge(NamedTuple):
    """Samples (B,) that a sensor did not read, what it would have (B, 3), and the sigma (B, 3) of that."""

    sample: Ints
    value: Floats
    sigma: Floats

    def within(self, start: int, stop: int) -> Bridge:
        """Return those among the samples `start <= i < stop`, counted from `start`."""
        there = (self.sample >= start) & (self.sample < stop)
        return Bridge(self.sample[there] - start, self.value[there], self.sigma[there])

    def put(self, samples: Floats) -> Floats:
        """Return samples (N, 3) with these in their place."""
        if not len(self.sample):
            return samples
        bridged = samples.copy()
        bridged[self.sample] = self.value
        return bridged


def bridge_unread(t: Floats, acc: Floats, gyr: Floats, unread: Ints | None) -> tuple[Bridge, Bridge]:
    """Estimate the unread samples of accelerometer and gyroscope, from samples (N, 3) as of `interpolate_unread`."""
    if unread is None or not unread.any():
        nothing = Bridge(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 3)))
        return nothing, nothing
    seen = _UnreadSamples(t, acc, gyr, unread)
    return seen.bridge(ACC_OUT), seen.bridge(GYR_OUT)


class _Run(NamedTuple):
    """Where a run and what is around it are, in periods from its first sample on; equal for runs that are alike."""

    near: tuple[int, ...]  # Ticks of the samples around and within,
    read: tuple[tuple[bool, ...], ...]  # and which of the six each of them has.
    bad: tuple[int, ...]  # Ticks that the sensor did not read,
    before: int  # and those between which it is interpolated.
    behind: int


class _UnreadSamples:
    """A recording and which of its samples a sensor did not read."""

    def __init__(self, t: Floats, acc: Floats, gyr: Floats, unread: Ints) -> None:
        step = np.diff(t)
        period = float(np.median(step))
        self._tick = count_periods(t, period)
        self._unread = unread
        self._scale = np.repeat([find_spread(acc), find_spread(gyr)], 3)
        self._values = np.hstack([acc, gyr]) / self._scale
        hurt = np.flatnonzero(unread)
        gap = np.flatnonzero(step > LOST_PERIODS * period)
        self._breaks = np.unique(np.concatenate([gap, hurt, hurt - 1]))

    def bridge(self, which: int) -> Bridge:
        """Return indices, values and sigmas of the unread samples of one sensor, `ACC_OUT` or `GYR_OUT`."""
        bad = (self._unread & which) > 0
        start, stop = find_runs(bad)
        axes = np.s_[:3] if which == ACC_OUT else np.s_[3:]
        # describe each run and what is around it
        runs = []
        for i, j in zip(start.tolist(), stop.tolist(), strict=True):
            near = np.arange(max(i - REACH, 0), min(j + REACH, len(self._tick)))
            tick, run = self._tick[near] - self._tick[i], self._tick[i:j] - self._tick[i]
            inside = (tick >= -REACH) & (tick < run[-1] + 1 + REACH)
            near, tick = near[inside], tick[inside]
            unread = self._unread[near]
            read = np.repeat(np.column_stack([unread & ACC_OUT, unread & GYR_OUT]) == 0, 3, axis=1)
            first, last = i - 1, j if j < len(self._tick) else max(i - 1, 0)
            before, behind = self._tick[[first if first >= 0 else last, last]] - self._tick[i]
            patterns = tuple(tick.tolist()), tuple(map(tuple, read.tolist())), tuple(run.tolist())
            runs.append(_Run(*patterns, int(before), int(behind)))
        # solve those that are alike at once
        sample = np.flatnonzero(bad)
        value, sigma = np.empty((len(sample), 3)), np.empty((len(sample), 3))
        for run in set(runs):
            alike = [(i, j) for i, j, one in zip(start, stop, runs, strict=True) if one == run]
            found = self._predict(run, np.array([i for i, _ in alike]), axes)
            for (i, j), one in zip(alike, found, strict=True):
                at = int(np.searchsorted(sample, i))
                value[at : at + j - i], sigma[at : at + j - i] = one[0], one[1] * np.sqrt(j - i)
        return Bridge(sample, value * self._scale[axes], sigma * self._scale[axes])

    def _predict(self, run: _Run, first: Ints, axes: slice) -> list[tuple[Floats, Floats]]:
        """Predict runs of one shape from samples `first` on: values (n, 3) and sigma (3,) of their mean, each."""
        x, near, bad = self._values, np.array(run.near), np.array(run.bad)
        extent = np.array([min(near[0], run.before), max(near[-1], run.behind)])
        windows = find_windows(self._breaks, len(x), extent)
        line = self._interpolate(run, first, axes)
        if len(windows) < MIN_WINDOWS:
            return [(one, x[:, axes].std(axis=0)) for one in line]
        column, channel = np.nonzero(np.array(run.read))
        beyond = x[windows[:, None] + bad][..., axes] - self._interpolate(run, windows, axes)
        known = x[windows[:, None] + near[column], channel]
        # the samples that are there, gaps or not, are those of the same ticks
        rows = np.searchsorted(self._tick, self._tick[first][:, None] + near[column])
        found = [regress(known, beyond.reshape(len(windows), -1), one, channel) for one in x[rows, channel]]
        values = line + np.array([one.value for one in found]).reshape(line.shape)
        missed = np.array([one.missed.reshape(len(one.missed), -1, 3).mean(axis=1) for one in found])
        variance = (missed**2).mean(axis=1) * np.array([[one.stretch] for one in found])
        sigma = np.sqrt(np.maximum(variance, [one.strange[axes] for one in found]))
        return list(zip(values, sigma, strict=True))

    def _interpolate(self, run: _Run, first: Ints, axes: slice) -> Floats:
        """Line (A, n, 3) between the samples before and behind the runs that begin with the samples `first` (A,)."""
        width = max(run.behind - run.before, 1)
        share = ((np.array(run.bad) - run.before) / width)[:, None] * (run.behind != run.before)
        rows = np.searchsorted(self._tick, self._tick[first][:, None] + [run.before, run.behind])
        before, behind = self._values[rows, axes].swapaxes(0, 1)[:, :, None]
        return np.asarray(before + (behind - before) * share)


# motion within a sample


def prepare_samples(acc: Floats, gyr: Floats, h: Floats, gaps: Gaps) -> tuple[Floats, Floats]:
    """Specific forces and rates (N, 3), held over `h` (N,) s, that integrate to the motion: gaps, coning, sculling."""
    force, rate = np.empty_like(acc), np.empty_like(gyr)
    for start in range(0, len(h), BLOCK):
        stop = min(start + BLOCK, len(h))
        # a sample's change is known from both of its neighbours
        first, last = max(start - 1, 0), min(stop + 1, len(h))
        part_acc, part_gyr, part_h = acc[first:last].copy(), gyr[first:last].copy(), h[first:last]
        # before a gap the mean over all of the time until the next stamp
        within = (gaps.sample >= first) & (gaps.sample < last)
        sample = gaps.sample[within] - first
        share = (gaps.unseen_s[within] / part_h[sample])[:, None]
        part_acc[sample] += share * (gaps.acc[within] - part_acc[sample])
        part_gyr[sample] += share * (gaps.gyr[within] - part_gyr[sample])
        found, inside = compensate_coning(part_acc, part_gyr, part_h), np.s_[start - first : stop - first]
        force[start:stop], rate[start:stop] = found[0][inside], found[1][inside]
    return force, rate


@njit(cache=True)
def compensate_coning(acc: Floats, gyr: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Return forces and rates (N, 3), means over periods `h` (N,) s, N > 1, with sculling and coning added."""
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
    """Write to `change` the change of sample i over its period: slope of a parabola, or of a line at either end."""
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
