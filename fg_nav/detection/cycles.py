"""Stances of a foot that runs: the stillest moment of each cycle, where no level of stillness is ever reached.

A running foot turns at 0.7 to 1.7 rad/s in its stillest moment, with a gyroscope that clips in each swing: the free
velocity of `fg_nav.detection.footfalls` is then off by meters a second after few strides, and shows no longer which
minima are stances. What is left is the rhythm. In a gap without footfalls, a minimum of L (decades of SHOE) is a stance

* if the motion about it has a period T: the autocorrelation of L, cut off above and below, over `REACH_S` either side
  has its first high maximum there, by `MIN_CORRELATION` or more;
* if it is the lowest within `SHARE` T to either side: the middle of a swing is half a period from a stance. What is not
  yet recorded may be lower, and a walk in progress waits for it;
* if the foot came down before it: a specific force above `LANDING_M_S2` within `LANDING_S`;
* and where the gap is longer than `GAP` T.

A footfall above `DOUBTFUL_LEVEL` that is not the lowest of its own cycle is a mid-swing and is dropped before.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.system.compiled import njit

CYCLE_S = 0.5, 1.2  # From stance to stance of one foot: sprinters to those who walk fast.
REACH_S = 2.5  # Some three cycles on either side: less shows no rhythm, in more it changes.
STEP_S = 0.02  # Samples of L for the autocorrelation: SHOE is averaged over 0.05 s.

CUT_LEVELS = 4.0, 7.0
"""L is cut off at these: how still a rest is, and how hard a foot lands, says nothing of the rhythm."""

MIN_CORRELATION = 0.2  # White noise of as many samples as there are independent ones in the window stays below.
FIRST_MAXIMUM = 0.85  # Of the highest maximum: two periods correlate as well as one.
SHARE = 0.6  # Of a period.
GAP = 1.4  # Periods, from the end of a stance to the start of the next: with none left out there are less than one.

LANDING_M_S2, LANDING_S = 2 * GRAVITY_M_S2, 0.2
"""A foot that runs lands with 4 g and more, and stands 0.05 to 0.15 s later."""

MAX_LEVEL = 6.5  # A minimum above this is never a stance: 360 deg/s, or 36 m/s^2.
DOUBTFUL_LEVEL = 5.0  # Of feet that walk, one in a thousand has a stance above: 1.1 rad/s, or 6 m/s^2 off gravity.


def find_cycle_stances(t: Floats, acc: Floats, level: Floats, minima: Ints, start: Floats, stop: Floats) -> Ints:
    """Find the samples of stances between the intervals from `start` to `stop` (K,), among the `minima` of the level.

    Parameters
    ----------
    t, acc, level : (N,) s, (N, 3) m/s^2 and (N,) decades.
    """
    ends = np.array([0, len(t) - 1])
    before = np.concatenate([ends[:1], np.minimum(stop, ends[1])]).astype(np.int64)
    after = np.concatenate([start, ends[1:]]).astype(np.int64)
    gap = np.searchsorted(start, minima, side="right")
    longest_s = (t[after] - t[before])[gap] / GAP
    inside = (minima > before[gap]) & (minima < after[gap]) & (level[minima] < MAX_LEVEL)
    chosen = inside & (longest_s > CYCLE_S[0])
    found = [
        i
        for i, seconds in zip(minima[chosen], longest_s[chosen], strict=True)
        if is_lowest_of_cycle(t, level, i, CYCLE_S[0]) and _has_landed(t, acc, i)
        if _fills_cycle(t, level, i, seconds)
    ]
    return np.array(found, dtype=np.int64)


def _fills_cycle(t: Floats, level: Floats, sample: int, longest_s: float) -> bool:
    """Whether the level is lowest in its cycle, which is not longer than that and recorded as far as it counts."""
    period_s = measure_period(t, level, sample)
    recorded = t[sample] + SHARE * period_s <= t[-1]
    return 0.0 < period_s < longest_s and recorded and is_lowest_of_cycle(t, level, sample, period_s)


def find_mid_swings(t: Floats, level: Floats, stillest: Ints) -> Bools:
    """Find the footfalls, stillest at these samples (K,), that are above `DOUBTFUL_LEVEL` and not those of a cycle."""
    found = np.zeros(len(stillest), dtype=np.bool_)
    for k in np.flatnonzero(level[stillest] > DOUBTFUL_LEVEL):
        period_s = measure_period(t, level, stillest[k])
        found[k] = period_s > 0.0 and not is_lowest_of_cycle(t, level, stillest[k], period_s)
    return found


def measure_period(t: Floats, level: Floats, sample: int) -> float:
    """Measure the period of the motion about a sample, s; zero where it has none."""
    first, last = np.searchsorted(t, t[sample] + np.array([-REACH_S, REACH_S]))
    times = np.arange(t[first], t[min(last, len(t) - 1)], STEP_S)
    at = np.minimum(np.searchsorted(t, times), len(t) - 1)  # rounding may put the last beyond the end
    signal = np.clip(level[at], *CUT_LEVELS)
    lags = np.arange(round(CYCLE_S[0] / STEP_S) - 1, round(CYCLE_S[1] / STEP_S) + 2)
    if len(signal) < 2 * lags[-1]:
        return 0.0
    correlation = _correlate(signal - signal.mean(), lags)
    inner = correlation[1:-1]
    maxima = (inner >= correlation[:-2]) & (inner >= correlation[2:]) & (inner >= MIN_CORRELATION)
    if not maxima.any():
        return 0.0
    return float(STEP_S * lags[1:-1][maxima & (inner >= FIRST_MAXIMUM * inner[maxima].max())][0])


@njit(cache=True)
def _correlate(signal: Floats, lags: Ints) -> Floats:
    """Autocorrelation (L,) of a signal without mean, at each lag the mean over what overlaps; zero where it is even."""
    n, found = len(signal), np.zeros(len(lags))
    power = (signal**2).mean()
    if power > 0.0:
        for k, lag in enumerate(lags):
            found[k] = (signal[lag:] * signal[: n - lag]).mean() / power
    return found


def is_lowest_of_cycle(t: Floats, level: Floats, sample: int, period_s: float) -> bool:
    """Whether the level is lowest at a sample for `SHARE` of a period on either side, as far as that is recorded."""
    first, last = np.searchsorted(t, t[sample] + SHARE * period_s * np.array([-1.0, 1.0]))
    return bool(level[sample] <= level[first:last].min())


def _has_landed(t: Floats, acc: Floats, sample: int) -> bool:
    """Whether the foot came down shortly before a sample."""
    first = np.searchsorted(t, t[sample] - LANDING_S)
    return bool(np.linalg.norm(acc[first : sample + 1], axis=1).max() > LANDING_M_S2)


def is_next_to(t: Floats, samples: Ints, stances: Floats, longest_s: float) -> Bools:
    """Whether samples (K,) are outside the intervals (3, S), and less than `longest_s` away from one."""
    if stances.shape[1] == 0:
        return np.zeros(len(samples), dtype=np.bool_)
    start, stop = stances[:2].astype(np.int64)
    after = np.searchsorted(start, samples, side="right")
    before_s = np.where(after > 0, t[samples] - t[stop[after - 1] - 1], np.inf)
    until_s = np.where(after < len(start), t[start[np.minimum(after, len(start) - 1)]] - t[samples], np.inf)
    return np.asarray((before_s > 0) & (np.minimum(before_s, until_s) < longest_s))
