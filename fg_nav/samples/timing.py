"""Even stamps out of jittered ones: when the sensor sampled, where the logger stamped on arrival.

Model. A sensor samples evenly by its own clock; sample i is the n_i-th tick, stamped when it arrived:

    t_i = s(n_i) + d_i,    s(n) = s_0 + T n + slow drift,    n_i - n_(i-1) = 1 + dropped samples

with a transport delay d_i that is small on the whole, may be large for a burst, and does not accumulate.
Since a stamp is late but never early, the earliest of the next stamps, each taken back by its number of
ticks, bounds the true time of a sample from above. Where that bound jumps by whole ticks, samples were
dropped; where it jumps otherwise, the clock was restarted. Drift is followed by medians over a few seconds.

Not every uneven stamp is late: a sensor may sample unevenly. Then the deviations from even ticks wander
instead of staying put, and the stamps are returned as they are.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.system.compiled import njit

_WINDOW_S = 0.25  # A burst of delayed stamps is over within this.
_BLOCK_S = 2.0  # Drift is followed at this pace; crystals drift over minutes.

_LAGS = (1, 10, 100, 1000)
"""Ticks over which the period may show: above the bursts, and below the distance between dropped samples."""

_NEGLIGIBLE = 0.005  # Jitter below this share of the period is left alone: it moves nothing.
_WANDERING = 3.0  # White deviations spread as far over half a second as over a tick, a random walk ten times as far.

_MIN_SAMPLES = 50


class Clock(NamedTuple):
    """A sensor's clock behind stamps (N,) s.

    `even` (N,) s are its ticks and `tick` (N,) their numbers: more than one apart where samples were dropped.
    `period` s is that of one tick, `n_stretches` counts the stretches between restarts.
    """

    even: Floats
    tick: Ints
    period: float
    n_stretches: int


def even_stamps(t: Floats) -> tuple[Floats, list[str]]:
    """Stamps without transport jitter: a sensor samples evenly, however its samples were stamped on the way."""
    even = remove_jitter(t)
    if np.array_equal(even, t):
        return t, []
    worst_ms = 1e3 * float(np.abs(even - t).max())
    return even, [f"evened out the jitter of the stamps, up to {worst_ms:.1f} ms"]


def remove_jitter(t: Floats) -> Floats:
    """Even out stamps whose jitter is that of their transport.

    From stamps (N,) s, strictly increasing, to the ticks of the sensor's clock, likewise. True gaps and dropped samples
    stay. `t` itself where the jitter is negligible, or not that of transport, or the samples are too few to decide.
    """
    clock = fit_clock(t)
    if not (np.diff(clock.even) > 0).all() or not _is_transport(t - clock.even, clock.period):
        return t
    return clock.even


def find_lost_share(gyr: Floats) -> float:
    """Share of the rows that are missing from rates (N, 3) without stamps, by double steps; 0 where they show none.

    Where the rate changes evenly, a step is the mean of those before and behind. With a row lost it is twice that: of
    such steps those that are missing as often by chance are taken off. Found are 0.7 of the rows that were lost.
    """
    step = np.diff(gyr[np.isfinite(gyr).all(axis=1)], axis=0)
    if len(step) < _MIN_SAMPLES:
        return 0.0
    before, here, after = step[:-2], step[1:-1], step[2:]
    usual = 0.5 * (before + after)
    size = np.linalg.norm(usual, axis=1)
    even = (size > np.quantile(size, 0.7)) & (np.linalg.norm(before - after, axis=1) < 0.5 * size)
    usual, here, size = usual[even], here[even], size[even]
    ratio = np.einsum("ij,ij->i", here, usual) / size**2
    along = np.linalg.norm(here - ratio[:, None] * usual, axis=1) < 0.5 * size
    double, none = (int(np.count_nonzero(along & (np.abs(ratio - at) < 0.4))) for at in (2.1, -0.1))
    is_clear = double - none > 3.0 * np.sqrt(double + none + 1.0)
    return (double - none) / (0.7 * len(ratio)) if is_clear else 0.0


def fit_clock(t: Floats) -> Clock:
    """Find the clock behind stamps.

    The median step is a poor estimate of its period: a logger that looks for samples every 6 ms stamps most
    samples of a 200 Hz sensor 6 ms apart, and some of them at once. So several periods are tried, and the
    clock with the fewest restarts, then the least deviation, is taken.

    `t` (N,) s, strictly increasing, N > 1. Fewer than 50 are taken as they are.
    """
    if len(t) < _MIN_SAMPLES:
        return Clock(t, np.arange(len(t)), float(np.median(np.diff(t))), 1)
    clocks = (_clock_near(t, float(np.median(t[lag:] - t[:-lag])) / lag) for lag in _LAGS if lag < len(t))
    return min(clocks, key=lambda clock: (clock.n_stretches, _spread(t - clock.even)))


def _clock_near(t: Floats, period: float) -> Clock:
    """Find the clock of about this period; the first count of ticks makes the period good for the second."""
    tick, _ = _count_ticks(t, period, _window(period))
    off = tick - tick.mean()  # a line by least squares; `polyfit` takes ten times the memory
    period = float(off @ (t - t[0]) / (off @ off))
    tick, stretch = _count_ticks(t, period, _window(period))
    n_stretches = int(stretch[-1]) + 1
    if n_stretches > 1 + len(t) // _MIN_SAMPLES:  # no clock at all
        return Clock(t, tick, period, n_stretches)
    edges = np.searchsorted(stretch, np.arange(n_stretches + 1))
    parts = [slice(start, stop) for start, stop in pairwise(edges)]
    even = np.concatenate([_tick_times(t[part], tick[part], period) for part in parts])
    return Clock(even, tick, period, n_stretches)


def _window(period: float) -> int:
    return int(np.clip(_WINDOW_S / period, 10, 1000))


def _is_transport(delay: Floats, period: float) -> bool:
    """Whether deviations (N,) from even ticks are worth removing, and those of transport."""
    if len(delay) < _MIN_SAMPLES:
        return False
    lag = int(np.clip(0.5 / period, 10, len(delay) // 2))
    near, far = (_spread(delay[step:] - delay[:-step]) for step in (1, lag))
    return near > _NEGLIGIBLE * period and far < _WANDERING * near


def _spread(values: Floats) -> float:
    """Estimate the standard deviation by the middle nine tenths: rare bursts do not count."""
    low, high = np.quantile(values, [0.05, 0.95])
    return float(high - low) / 3.29


def _tick_times(t: Floats, tick: Ints, period: float) -> Floats:
    """Time the ticks (N,) of one even stretch: a line through medians of blocks, bent at each."""
    residual = t - t[0] - period * (tick - tick[0])
    n_blocks = int(min((t[-1] - t[0]) / _BLOCK_S, len(t) / 20))
    if n_blocks < 2:
        return np.asarray(t - residual + np.median(residual))
    middle = np.array([np.median(x) for x in np.array_split(tick.astype(np.float64), n_blocks)])
    late = np.array([np.median(r) for r in np.array_split(residual, n_blocks)])
    line = np.polyfit(middle, late, 1)
    # The line goes on beyond the outermost medians, the bends do not.
    drift = np.polyval(line, tick) + np.interp(tick, middle, late - np.polyval(line, middle))
    return np.asarray(t - residual + drift)


@njit(cache=True)
def _count_ticks(t: Floats, period: float, window: int) -> tuple[Ints, Ints]:
    """Tick number (N,) of each stamp, and number (N,) of the stretch of even sampling it belongs to."""
    n = len(t)
    tick, stretch = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for i in range(1, n):
        tick[i], stretch[i] = tick[i - 1] + 1, stretch[i - 1]
        if t[i] - t[i - 1] < 1.5 * period:
            continue
        before = t[i - 1]
        for j in range(max(0, i - window), i - 1):
            if stretch[j] == stretch[i - 1]:
                before = min(before, t[j] + (tick[i - 1] - tick[j]) * period)
        after = t[i]
        for j in range(i + 1, min(n, i + window)):
            after = min(after, t[j] - (j - i) * period)
        steps = min((after - before) / period, 1e9)
        if steps > 1.5:
            whole = np.rint(steps)
            tick[i] = tick[i - 1] + int(whole)
            if abs(steps - whole) > 0.3:
                stretch[i] += 1
    return tick, stretch
