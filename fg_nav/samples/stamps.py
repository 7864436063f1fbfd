"""The stamps of a file: put in order, and evened out where the logger stamped samples on arrival.

What becomes of each fault: `docs/formats.md`. Of the parts that an end leaves, the longest is taken, with a remark.

Jitter. A sensor samples evenly by its own clock; sample i is the n_i-th tick, stamped when it arrived:

    t_i = s(n_i) + d_i,    s(n) = s_0 + T n + slow drift,    n_i - n_(i-1) = 1 + dropped samples

with a transport delay d_i >= 0 that is small on the whole, may be large for a burst, and does not accumulate. The
earliest of the next stamps, each taken back by its number of ticks, bounds the true time of a sample from above. Where
that bound jumps by whole ticks, samples were dropped; where it jumps otherwise, the clock was restarted. Drift is
followed by medians over a few seconds. Where the deviations from even ticks wander instead of staying put, the sensor
itself was uneven, and the stamps are returned as they are.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import RecordingError
from fg_nav.samples.gaps import LOST_PERIODS, MAX_HELD_S
from fg_nav.system.compiled import njit
from fg_nav.text import CUT, format_count

MAX_BRIDGED_S = MAX_HELD_S  # In a longer gap a foot may have turned anywhere: behind this, sigma of heading 1 rad.
MAX_GAP_S = 0.1  # Longer holes stay open: in mid-swing a foot speeds up by metres a second in one.
GAP_PERIODS = 2.5  # Between stamps of a gap; transport jitter makes shorter steps.
ROOM = 0.55  # Least distance of two samples' stamps, in periods: polling every 6 ms leaves 0.6 of a sensor's 5 ms.
SAME_S = 1e-7  # Stamps that rise by no more are the same: no sensor samples as fast, and no result is written finer.
JUMP_S, MAX_AHEAD = 1.0, 20  # Stamps so far ahead, and not more, are wrong if the next goes on from before them.
AROUND, JUMP = 20, 3.0  # No jump is less than so many times the largest change within so many samples on either side.
MAX_BACKWARD = 100

WINDOW_S = 0.25  # A burst of delayed stamps is over within this.
BLOCK_S = 2.0  # Drift is followed at this pace; crystals drift over minutes.
LAGS = (1, 10, 100, 1000)  # Ticks over which the period may show: above bursts, below the distance of dropped samples.
NEGLIGIBLE = 0.005  # Jitter below this share of the period is left alone: it moves nothing.
WANDERING = 3.0  # White deviations spread as far over half a second as over a tick, a random walk ten times as far.
MIN_CLOCKED = 50  # Samples; fewer show no clock.


class Ordered(NamedTuple):
    """Samples of a file in order of time, and what was done."""

    kept: Ints  # (M,) samples.
    t: Floats  # (M,) s, their stamps, strictly rising.
    remarks: tuple[str, ...]
    cut: int = 0  # Samples in parts that are not used.


def order_stamps(t: Floats, samples: Floats, row: Ints, longest_gap_s: float = MAX_BRIDGED_S) -> Ordered:
    """Put the samples of a file in order of time; raises `RecordingError` where the stamps are no clock.

    `t` (N,) s as in the file, force and rate `samples` (N, 6), all finite, and the `row` (N,) of each, for the remarks.
    """
    # mean step, of those that are neither backward nor gaps, so that polled samples count; what is no gap follows from
    # the step that is usual where the time goes, of which stamps that all but coincide take none
    step, period = np.diff(t), 0.0
    forward = np.sort(step[step > 0])
    if len(forward):
        forward = forward[forward <= max(forward[0], MAX_BRIDGED_S)]
        elapsed = np.cumsum(forward)
        usual = forward[np.searchsorted(elapsed, elapsed[-1] / 2)]
        period = float(step[(step >= 0) & (step < 10 * usual)].mean())
    parts, remarks = _follow_clock(t, samples, row, period)
    spread = [_spread_doubles(part, samples, row, period) for part in parts]
    # split at gaps that are too long to be bridged, and keep the longest piece
    pieces: list[tuple[Ints, Floats]] = []
    for part in spread:
        ends = np.flatnonzero(np.diff(part.t) > longest_gap_s) + 1
        pieces += zip(np.split(part.kept, ends), np.split(part.t, ends), strict=True)
    kept, stamps = max(pieces, key=lambda piece: len(piece[0]))
    remarks += [words for part in spread if kept[0] in part.kept for words in part.remarks]
    cut = sum(len(piece) for piece, _ in pieces) - len(kept)
    if len(pieces) > 1:
        at = next(i for i, (piece, _) in enumerate(pieces) if piece[0] == kept[0])
        why = []
        for (_, before), (index, after) in pairwise(pieces[max(at - 1, 0) : at + 2]):
            gap_s, where = float(after[0] - before[-1]), f"row {row[index[0]]}"
            why.append(
                f"there is a gap of {gap_s:.2f} s before {where}" if gap_s > 0 else f"the clock begins again at {where}"
            )
        remarks.append(
            f"{CUT} {row[kept[0]]} to {row[kept[-1]]} (t = {stamps[0]:.3f} to {stamps[-1]:.3f} s) are used, and "
            f"{format_count(cut, 'sample')} left out: {' and '.join(why)}"
        )
    return Ordered(kept, stamps, tuple(remarks), cut)


def _follow_clock(t: Floats, samples: Floats, row: Ints, period: float) -> tuple[list[Ordered], list[str]]:
    """Cut the samples where the clock restarts; return the sorted parts, nondecreasing in time, and remarks."""
    backward = np.flatnonzero(np.diff(t) < 0) + 1
    if len(backward) > MAX_BACKWARD:
        raise RecordingError(
            f"the stamps run backward {len(backward)} times, the first at row {row[backward[0]]}: mend their column."
        )
    t, keep, late = t.copy(), np.ones(len(t), dtype=np.bool_), np.zeros(len(t), dtype=np.bool_)
    begins, remarks = [0], []
    for at in backward.tolist():
        # wrong stamps, far ahead of this one
        wrong = next((i for i in range(at - 1, max(at - 1 - MAX_AHEAD, 0), -1) if t[i - 1] < t[at]), at)
        if t[wrong] - t[wrong - 1] > JUMP_S:
            keep[wrong:at] = False
        since = slice(begins[-1], at)
        last = float(t[since][keep[since]].max(initial=-np.inf))
        if t[at] > last:
            continue
        # samples that came late, unless the clock goes on from there
        beyond = np.flatnonzero(t[at:] > last)
        stop = at + int(beyond[0]) if beyond.size else len(t)
        if stop - at <= MAX_AHEAD if stop == len(t) else t[stop] - t[stop - 1] > LOST_PERIODS * period:
            late[at:stop] = True
            continue
        # a clock that began again
        if goes_on(samples, at):
            remarks.append(
                f"the clock began again at row {row[at]} (t = {t[at]:.3f} s, after {last:.3f} s) with nothing missing: "
                f"stamps are set on from there"
            )
            t[at:] += last + period - t[at]
        else:
            begins.append(at)
    return [_sort_part(t, keep, late, start, stop, row, period) for start, stop in pairwise([*begins, len(t)])], remarks


def goes_on(samples: Floats, at: int, jump: float = JUMP) -> bool:
    """Whether force and rate (N, 6) change from the sample before to this one as they do around them."""
    before, after = samples[max(at - AROUND, 0) : at], samples[at : at + AROUND]
    if len(before) < 2 or len(after) < 2:
        return False
    usual = np.maximum(np.abs(np.diff(before, axis=0)).max(axis=0), np.abs(np.diff(after, axis=0)).max(axis=0))
    return bool((np.abs(after[0] - before[-1]) <= jump * usual).all())


def _sort_part(t: Floats, keep: Bools, late: Bools, start: int, stop: int, row: Ints, period: float) -> Ordered:
    """Return samples start <= i < stop in order of time: those of `keep`, with the `late` ones moved to their place."""
    index = np.arange(start, stop)
    kept = index[keep[start:stop] & ~late[start:stop]]
    came_late = index[keep[start:stop] & late[start:stop]]
    place = np.searchsorted(t[kept], t[came_late])
    beside = np.clip(np.stack([place - 1, place], axis=1), 0, len(kept) - 1)
    away = np.abs(t[came_late][:, None] - t[kept][beside])
    fits = (away > ROOM * period).all(axis=1)
    both = np.concatenate([kept, came_late[fits]])
    both = both[np.argsort(t[both], kind="stable")]
    remarks = []
    for which, words in (
        (index[~keep[start:stop]], "far ahead of those around: left out"),
        (came_late[fits], "behind later ones: sorted"),
        (came_late[~fits], "behind later ones, where there are others: left out"),
    ):
        if len(which):
            remarks.append(f"{format_count(len(which), 'stamp')}, the first in row {row[which[0]]}, {words}")
    return Ordered(both, t[both], tuple(remarks))


def _spread_doubles(part: Ordered, samples: Floats, row: Ints, period: float) -> Ordered:
    """Space samples of equal stamps evenly if they differ; drop all but the first if they repeat."""
    t = part.t
    first = np.flatnonzero(np.diff(t, prepend=-np.inf) > SAME_S)
    if len(first) == len(t):
        return part
    keep, spread, even = np.ones(len(t), dtype=np.bool_), np.zeros(len(t), dtype=np.bool_), t.copy()
    for start, stop in pairwise([*first.tolist(), len(t)]):
        if stop - start == 1:
            continue
        same = (samples[part.kept[start + 1 : stop]] == samples[part.kept[start : stop - 1]]).all(axis=1)
        before = t[start - 1] if start else t[start] - (stop - start) * period
        if not same.any() and t[start] - before >= ROOM * period * (stop - start):
            spread[start:stop] = True
            even[start:stop] = before + (t[start] - before) * np.arange(1, stop - start + 1) / (stop - start)
        else:
            keep[start + 1 : stop] = False
    remarks = []
    if not keep.all():
        first = row[part.kept[np.argmin(keep)]]
        remarks.append(f"left out {format_count(int((~keep).sum()), 'repeated stamp')}, the first in row {first}")
    if spread.any():
        first = row[part.kept[np.argmax(spread)]]
        remarks.append(
            f"{int(spread.sum())} samples share their stamps with others, from row {first} on: spread evenly"
        )
    return Ordered(part.kept[keep], even[keep], (*part.remarks, *remarks))


# the clock behind the stamps


class Clock(NamedTuple):
    """A sensor's clock behind stamps (N,) s."""

    even: Floats  # (N,) s, its ticks.
    tick: Ints  # (N,) their numbers: more than one apart where samples were dropped.
    period: float  # Of a tick, s.
    n_stretches: int  # Between restarts.


def remove_jitter(t: Floats) -> Floats:
    """Return stamps (N,) s, strictly increasing, at the ticks of the sensor's clock; gaps and dropped samples stay.

    `t` itself where the jitter is negligible, or not that of transport, or the samples are too few to decide.
    """
    clock = fit_clock(t)
    delay = t - clock.even
    if not (np.diff(clock.even) > 0).all() or len(t) < MIN_CLOCKED:
        return t
    # worth removing, and of transport: white deviations, and no random walk
    lag = int(np.clip(0.5 / clock.period, 10, len(t) // 2))
    near, far = (_spread(delay[step:] - delay[:-step]) for step in (1, lag))
    return clock.even if near > NEGLIGIBLE * clock.period and far < WANDERING * near else t


def find_lost_share(gyr: Floats) -> float:
    """Share of the rows that are missing from rates (N, 3) without stamps, by double steps; 0 where they show none.

    Where the rate changes evenly, a step is the mean of those before and after; with a row lost it is twice that. The
    chance level of double steps is subtracted, and the rest divided by 0.7, the share of lost rows that is detected.
    """
    step = np.diff(gyr[np.isfinite(gyr).all(axis=1)], axis=0)
    if len(step) < MIN_CLOCKED:
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
    """Find the clock behind stamps (N,) s, strictly increasing, N > 1; fewer than 50 are taken as they are.

    The median step is a poor estimate of its period: a logger that looks for samples every 6 ms stamps most of a 200 Hz
    sensor 6 ms apart, and some at once. Of several periods that with the fewest restarts, least deviation is taken.
    """
    if len(t) < MIN_CLOCKED:
        return Clock(t, np.arange(len(t)), float(np.median(np.diff(t))), 1)
    clocks = (_clock_near(t, float(np.median(t[lag:] - t[:-lag])) / lag) for lag in LAGS if lag < len(t))
    return min(clocks, key=lambda clock: (clock.n_stretches, _spread(t - clock.even)))


def _clock_near(t: Floats, period: float) -> Clock:
    """Fit a clock near `period` s: count ticks, refine the period by them, count again."""
    tick, _ = _count_ticks(t, period, int(np.clip(WINDOW_S / period, 10, 1000)))
    off = tick - tick.mean()  # a line by least squares; `polyfit` takes ten times the memory
    period = float(off @ (t - t[0]) / (off @ off))
    tick, stretch = _count_ticks(t, period, int(np.clip(WINDOW_S / period, 10, 1000)))
    n_stretches = int(stretch[-1]) + 1
    if n_stretches > 1 + len(t) // MIN_CLOCKED:  # no clock at all
        return Clock(t, tick, period, n_stretches)
    edges = np.searchsorted(stretch, np.arange(n_stretches + 1))
    parts = [slice(start, stop) for start, stop in pairwise(edges)]
    even = np.concatenate([_tick_times(t[part], tick[part], period) for part in parts])
    return Clock(even, tick, period, n_stretches)


def _spread(values: Floats) -> float:
    """Estimate the standard deviation by the middle nine tenths: rare bursts do not count."""
    low, high = np.quantile(values, [0.05, 0.95])
    return float(high - low) / 3.29


def _tick_times(t: Floats, tick: Ints, period: float) -> Floats:
    """Times (N,) s of the ticks of one even stretch: piecewise linear through block medians, against clock drift."""
    residual = t - t[0] - period * (tick - tick[0])
    n_blocks = int(min((t[-1] - t[0]) / BLOCK_S, len(t) / 20))
    if n_blocks < 2:
        return np.asarray(t - residual + np.median(residual))
    middle = np.array([np.median(x) for x in np.array_split(tick.astype(np.float64), n_blocks)])
    late = np.array([np.median(r) for r in np.array_split(residual, n_blocks)])
    line = np.polyfit(middle, late, 1)
    # the line goes on beyond the outermost medians, the bends do not
    drift = np.polyval(line, tick) + np.interp(tick, middle, late - np.polyval(line, middle))
    return np.asarray(t - residual + drift)


@njit(cache=True)
def _count_ticks(t: Floats, period: float, window: int) -> tuple[Ints, Ints]:
    """Tick number (N,) of each stamp by a median over `window`, and number (N,) of its stretch of even sampling."""
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
