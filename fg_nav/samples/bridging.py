"""A sensor that read wrongly for some samples while the other one did not: what it would have read.

Where only the gyroscope is bad, the accelerometer is kept, and tells: a shoe that is struck turns. What was not read
follows from the samples within R periods on either side, of both sensors, and from those of the other sensor between,
as in a gap (`fg_nav.samples.gaps`): with m all of these, each sensor over its own spread, the n samples of a run are

    x_k = linear interpolation + W_k m + c_k,        k = 1 .. n,

W and c by least squares over the windows of the recording, as wide and read throughout, that look most like it. The
sigma of their mean, s, is measured there, as that of a gap is. The errors of a run are one error, so each sample is
given the s sqrt(n) of independent ones that add up to it. Where there is too little to learn from, it is the linear
interpolation, and s the spread of the recording.

Detectors see the linear interpolation in time between the nearest samples of which both sensors are good: a stream
knows no more when it passes them on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.samples.gaps import (
    FEWEST,
    LOST_PERIODS,
    REACH,
    Regression,
    count_periods,
    find_spread,
    find_windows,
    regress,
)
from fg_nav.samples.outliers import ACC_OUT, GYR_OUT
from fg_nav.system.spilled import BLOCK_ROWS, drop_pages, join_columns


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


def interpolate_unread(t: Floats, acc: Floats, gyr: Floats, unread: Ints) -> None:
    """Write a line into acc or gyr (N, 3) where `unread` (N,), `ACC_OUT` or `GYR_OUT`, says that it was not read."""
    good = unread == 0
    for samples, which in ((acc, ACC_OUT), (gyr, GYR_OUT)):
        bad = (unread & which) > 0
        if bad.any() and good.any():
            for axis in samples.T:
                axis[bad] = np.interp(t[bad], t[good], axis[good])


def bridge_unread(t: Floats, acc: Floats, gyr: Floats, unread: Ints | None) -> tuple[Bridge, Bridge]:
    """Find what accelerometer and gyroscope would have read, from samples (N, 3) as of `interpolate_unread`."""
    if unread is None or not unread.any():
        nothing = Bridge(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 3)))
        return nothing, nothing
    seen = _Seen(t, acc, gyr, unread)
    return seen.bridge(ACC_OUT), seen.bridge(GYR_OUT)


class _Run(NamedTuple):
    """Where a run and what is around it are, in periods from its first sample on; equal for runs that are alike.

    `near` are the ticks of the samples around and within, `read` which of the six each of them has, `bad` the ticks
    that the sensor did not read, `before` and `behind` those between which it is interpolated.
    """

    near: tuple[int, ...]
    read: tuple[tuple[bool, ...], ...]
    bad: tuple[int, ...]
    before: int
    behind: int


class _Seen:
    """A recording and which of its samples a sensor did not read."""

    def __init__(self, t: Floats, acc: Floats, gyr: Floats, unread: Ints) -> None:
        step = np.diff(t)
        period = float(np.median(step))
        self._tick = count_periods(t, period)
        self._unread = unread
        self._scale = np.repeat([find_spread(acc), find_spread(gyr)], 3)
        self._values = join_columns(acc, gyr)
        for start in range(0, len(t), BLOCK_ROWS):
            self._values[start : start + BLOCK_ROWS] /= self._scale
            drop_pages()
        hurt = np.flatnonzero(unread)
        gap = np.flatnonzero(step > LOST_PERIODS * period)
        self._breaks = np.unique(np.concatenate([gap, hurt, hurt - 1]))

    def bridge(self, which: int) -> Bridge:
        """Find what one sensor would have read."""
        bad = (self._unread & which) > 0
        edge = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(np.int8)))
        start, stop = edge[::2], edge[1::2]
        axes = np.s_[:3] if which == ACC_OUT else np.s_[3:]
        runs = [self._describe(int(i), int(j), bad) for i, j in zip(start, stop, strict=True)]
        sample = np.flatnonzero(bad)
        value, sigma = np.empty((len(sample), 3)), np.empty((len(sample), 3))
        for run in set(runs):
            alike = [(i, j) for i, j, one in zip(start, stop, runs, strict=True) if one == run]
            found = self._predict(run, np.array([i for i, _ in alike]), axes)
            for (i, j), one in zip(alike, found, strict=True):
                at = int(np.searchsorted(sample, i))
                value[at : at + j - i], sigma[at : at + j - i] = one[0], one[1] * np.sqrt(j - i)
        return Bridge(sample, value * self._scale[axes], sigma * self._scale[axes])

    def _describe(self, start: int, stop: int, bad: Bools) -> _Run:
        """Describe the run of the samples `start <= i < stop`."""
        tick = self._tick - self._tick[start]
        near = np.arange(max(start - REACH, 0), min(stop + REACH, len(tick)))
        near = near[(tick[near] >= -REACH) & (tick[near] < tick[stop - 1] + 1 + REACH)]
        unread = self._unread[near]
        read = np.repeat(np.column_stack([unread & ACC_OUT, unread & GYR_OUT]) == 0, 3, axis=1)
        first, last = start - 1, stop if stop < len(tick) else max(start - 1, 0)
        ends = tick[first if first >= 0 else last], tick[last]
        run = tuple(tick[start:stop].tolist())
        return _Run(tuple(tick[near].tolist()), tuple(map(tuple, read.tolist())), run, int(ends[0]), int(ends[1]))

    def _predict(self, run: _Run, first: Ints, axes: slice) -> list[tuple[Floats, Floats]]:
        """Values (n, 3) and sigma (3,) of their mean for runs alike that begin with the samples `first`."""
        x, near, bad = self._values, np.array(run.near), np.array(run.bad)
        extent = np.array([min(near[0], run.before), max(near[-1], run.behind)])
        windows = find_windows(self._breaks, len(x), extent)
        line = self._interpolate(run, first, axes)
        if len(windows) < FEWEST:
            return [(one, x[:, axes].std(axis=0)) for one in line]
        column, channel = np.nonzero(np.array(run.read))
        beyond = x[windows[:, None] + bad][..., axes] - self._interpolate(run, windows, axes)
        known = x[windows[:, None] + near[column], channel]
        # The samples that are there, gaps or not, are those of the same ticks.
        rows = np.searchsorted(self._tick, self._tick[first][:, None] + near[column])
        found = [regress(known, beyond.reshape(len(windows), -1), one, channel) for one in x[rows, channel]]
        values = line + np.array([one.value for one in found]).reshape(line.shape)
        return [(value, _find_sigma(one, axes)) for value, one in zip(values, found, strict=True)]

    def _interpolate(self, run: _Run, first: Ints, axes: slice) -> Floats:
        """Line (A, n, 3) between the samples before and behind the runs that begin with the samples `first` (A,)."""
        width = max(run.behind - run.before, 1)
        share = ((np.array(run.bad) - run.before) / width)[:, None] * (run.behind != run.before)
        rows = np.searchsorted(self._tick, self._tick[first][:, None] + [run.before, run.behind])
        before, behind = self._values[rows, axes].swapaxes(0, 1)[:, :, None]
        return np.asarray(before + (behind - before) * share)


def _find_sigma(found: Regression, axes: slice) -> Floats:
    """Sigma (3,) of the mean of a run."""
    missed = found.missed.reshape(len(found.missed), -1, 3).mean(axis=1)
    return np.asarray(np.sqrt(np.maximum((missed**2).mean(axis=0) * found.stretch, found.strange[axes])))
