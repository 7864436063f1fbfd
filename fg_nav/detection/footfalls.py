"""Footfalls among the moments of stillness: an automatic threshold for each footfall of each recording.

The steps, 1 to 7, with their reasons and figures are in docs/models.md, "Stances". Two more cases: both ends of the
recording may cut a slope, and are minima only below `FLOOR`; a chain may leave out the first or last `MAX_SWING_S` of a
recording, and no link of it is longer than `MAX_LINK_S`, unless nothing is between. Behind a hole in the samples
(`fg_nav.samples.gaps`) all begins anew: no stance and no link reaches over one.

Levels L are in decades of SHOE at the noise of `fg_nav.detection.stance`: L is reached by an angular rate of 0.2 deg/s,
or a specific force that is off gravity by 0.02 m/s^2, times 10^(L/2). A sensor at rest has L of about 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.frames import GRAVITY_M_S2, level_attitude
from fg_nav.mechanisation import TILT_TIME_S, NavState, nudge_tilt, strapdown
from fg_nav.samples.gaps import MAX_HELD_S, find_holes
from fg_nav.system.compiled import njit


class Link(NamedTuple):
    """Noise of the free velocity between two footfalls, and the level of tilt correction on the path."""

    still_level: float  # Below it the tilt is nudged toward the specific force.
    velocity_sigma: float  # s_0 in m/s: error of a stance's velocity and of one shock.
    acc_sigma: float  # s_a in m/s^2, of the acceleration by tilt, bias and scale.
    reward: float  # Worth of a perfectly still candidate, in units of log likelihood.


# From gait, not from single walks: stride counts do not change over wide ranges of these.
WALKING = Link(4.0, 0.2, 0.3, 3.0)  # For the first search.
ROUGH = Link(5.0, 0.3, 0.5, 4.0)  # For the gaps: running, with clipped peaks and no stance that levels the sensor.
PROMINENCE = 0.3  # Decades by which a minimum must lie below its surroundings.
REST_LEVEL = 3.0  # L is cut off below: a foot this still rests, however its noise ripples.
MAX_LEVEL = 5.8  # A minimum above this is never a stance: 160 deg/s, or 16 m/s^2.
EASY_LEVEL = 3.5  # L_0: up to here a candidate earns the full reward.
MAX_LINK_S = 2.5  # A stride takes no longer.
MAX_SWING_S, MIN_SWING_S = 1.2, 0.25  # Of a walking or running person; sprinters need 0.35.
SWING_RATE_RAD_S = 2.0  # No swing without a peak rate above this.
MARGIN = 0.6  # A stance's own threshold above its minimum, decades.
FLOOR, CEILING = 4.0, 5.3  # Of that: 20 deg/s or 2 m/s^2, 90 deg/s or 9 m/s^2, unless the minimum itself is above.
MIN_REST_S = 0.2  # No swing is below `REST_LEVEL` for longer.
MIN_REACH_S = 0.01  # Of the stance of a foot that runs, on either side of its stillest moment.
BROKEN = 24.0  # Price of a chain that begins or ends more than a swing inside the recording; of a link at most half.
FREE_FALL_M_S2 = 1.0  # Specific force of a foot that stands is above.
CYCLE_S = 0.5, 1.2  # From stance to stance of one foot: sprinters to those who walk fast.
REACH_S = 2.5  # Some three cycles on either side: less has no rhythm, in more it changes.
STEP_S = 0.02  # Samples of L for the autocorrelation: SHOE is averaged over 0.05 s.
CUT_LEVELS = 4.0, 7.0  # L is clipped: how still a rest is, and how hard a foot lands, is not part of the rhythm.
MIN_CORRELATION = 0.2  # White noise of as many independent samples stays below.
FIRST_MAXIMUM = 0.85  # Of the highest maximum: two periods correlate as well as one.
SHARE = 0.6  # Of a period.
GAP = 1.4  # Periods, from the end of a stance to the start of the next: with none left out there are less than one.
LANDING_M_S2, LANDING_S = 2 * GRAVITY_M_S2, 0.2  # A runner lands with 4 g and more, and stands within 0.15 s.
MAX_CYCLE_LEVEL = 6.5  # A minimum above this is never a stance: 360 deg/s, or 36 m/s^2.
MANY = 1 << 40  # Still samples since a hole, where there was none.
DOUBTFUL_LEVEL = 5.0  # Of feet that walk, one in a thousand has a stance above: 1.1 rad/s, or 6 m/s^2 off gravity.

Intervals: TypeAlias = tuple[Ints, Ints, Floats]  # First sample, sample after the last, log10 threshold, each (K,).


def find_footfalls(
    t: Floats, acc: Floats, gyr: Floats, level: Floats, velocity: Sequence[Floats] | None = None
) -> Intervals:
    """Find the stance intervals of a walk; return first sample, sample after the last and log10 threshold, (K,) each.

    Parameters
    ----------
    t, acc, gyr : (N,) s, (N, 3) m/s^2 and (N, 3) rad/s.
    level : (N,) decades, log10 of SHOE.
    velocity : (N, 3) m/s each, of the free strapdown passes for `WALKING` and `ROUGH`; None to integrate them (step 2).
    """
    found = []
    for begin, end in pairwise([0, *(find_holes(t) + 1).tolist(), len(t)]):
        part = np.s_[begin:end]
        samples = t[part], acc[part], gyr[part], level[part]
        if velocity is None:
            stamps = np.append(t[part], t[end - 1] + MAX_HELD_S)  # for the last period no velocity follows
            passes = (StrapdownPass(link.still_level, MAX_HELD_S) for link in (WALKING, ROUGH))
            free = [one.velocity(stamps, *samples[1:]) for one in passes]
        else:
            free = [one[part] for one in velocity]
        start, stop, threshold = _choose_in_part(*samples, free)
        found.append((begin + start, begin + stop, threshold))
    start, stop, threshold = (np.concatenate(column) for column in zip(*found, strict=True))
    return start, stop, threshold


def _choose_in_part(t: Floats, acc: Floats, gyr: Floats, level: Floats, velocity: Sequence[Floats]) -> Intervals:
    """Stance intervals of a part without holes, from the free velocities for `WALKING`, `ROUGH`: steps 1, 3 to 7."""
    # first and last sample (2, C) of the local minima; they differ where the foot rests
    cut = np.maximum(level, REST_LEVEL)
    minima = np.stack(_find_minima(cut, PROMINENCE))
    at_an_end = (minima[0] == 0) | (minima[1] == len(level) - 1)
    low = cut[minima[0]] < np.where(at_an_end, FLOOR, MAX_LEVEL)
    candidates = minima[:, low & ~is_falling(acc[minima[0]])]
    if candidates.size == 0:
        nothing = np.empty(0, dtype=np.int64)
        return nothing, nothing, np.empty(0)
    found = [_search(t, level, v, candidates, link) for v, link in zip(velocity, (WALKING, ROUGH), strict=True)]
    stances, rough = (_grow_intervals(level, samples) for samples in found)
    merged = _fill_cycles(t, acc, level, _fill_gaps(t, stances, rough))
    start, stop, threshold = merged[0].astype(np.int64), merged[1].astype(np.int64), merged[2]
    kept = _choose_apart(t, gyr, level, start, stop)
    return start[kept], stop[kept], threshold[kept]


def _search(t: Floats, level: Floats, velocity: Floats, candidates: Ints, link: Link) -> Ints:
    """Samples (F,) of the best chain of candidates (2, C), the first and last samples of the minima: step 3."""
    first = candidates[0]
    worth = link.reward - np.maximum(level[first] - EASY_LEVEL, 0.0)
    sigmas = link.velocity_sigma, link.acc_sigma
    chain = _find_best_chain(t[candidates], worth, velocity[candidates], *sigmas, MAX_LINK_S, MAX_SWING_S)
    return np.asarray(first[chain])


def _grow_intervals(level: Floats, samples: Ints) -> Floats:
    """Start, stop, log10 threshold (3, K) of the intervals about `samples` (F,), overlapping ones merged: step 4."""
    own = np.clip(level[samples] + MARGIN, FLOOR, np.maximum(CEILING, level[samples] + 0.2))
    found = np.empty((3, len(samples)))
    return found[:, : _grow_and_merge(level, samples, own, found)]


def _fill_gaps(t: Floats, stances: Floats, rough: Floats) -> Floats:
    """Add to the stances (3, K) those of `rough` (3, R) in gaps too long for a swing; return all by time: step 5."""
    if stances.shape[1] == 0:
        return rough
    before = np.concatenate([[0.0], stances[1]])
    after = np.concatenate([stances[0], [len(t)]])
    gap = np.searchsorted(stances[0], rough[0], side="right")
    inside = (rough[0] >= before[gap]) & (rough[1] <= after[gap])
    edges = np.minimum(np.stack([before, after]), len(t) - 1).astype(np.int64)
    wide = (t[edges[1]] - t[edges[0]])[gap] > MAX_SWING_S
    return _join(stances, rough[:, inside & wide])


def _fill_cycles(t: Floats, acc: Floats, level: Floats, stances: Floats) -> Floats:
    """Drop mid-swings from the stances (3, K), fill gaps with those of a running foot; return all by time: step 6."""
    start, stop = stances[:2].astype(np.int64)
    stillest = np.array([a + np.argmin(level[a:b]) for a, b in zip(start, stop, strict=True)], dtype=np.int64)
    kept = stances[:, ~find_mid_swings(t, level, stillest)]
    first, last = _find_minima(np.maximum(level, REST_LEVEL), PROMINENCE)
    found = find_cycle_stances(t, acc, level, first[~is_falling(acc[first])], *kept[:2])
    # no less than `MIN_REACH_S` on either side
    grown = _grow_intervals(level, found)
    of = np.searchsorted(grown[0], found, side="right") - 1
    np.minimum.at(grown[0], of, np.searchsorted(t, t[found] - MIN_REACH_S))
    np.maximum.at(grown[1], of, np.minimum(np.searchsorted(t, t[found] + MIN_REACH_S) + 1, len(t)))
    known = _join(kept, grown)
    # a rest is a footfall, even where a run that ends in it shows no velocity: if it is next to a stance
    rests = first[t[last] - t[first] >= MIN_REST_S]
    start, stop = known[:2].astype(np.int64)
    if not len(start):
        return known
    after = np.searchsorted(start, rests, side="right")
    before_s = np.where(after > 0, t[rests] - t[stop[after - 1] - 1], np.inf)
    until_s = np.where(after < len(start), t[start[np.minimum(after, len(start) - 1)]] - t[rests], np.inf)
    is_near = (before_s > 0) & (np.minimum(before_s, until_s) < MAX_LINK_S)
    return _join(known, _grow_intervals(level, rests[is_near]))


def _join(stances: Floats, others: Floats) -> Floats:
    """Both sets of intervals (3, K), sorted by start."""
    both = np.concatenate([stances, others], axis=1)
    return both[:, np.argsort(both[0], kind="stable")]


def _choose_apart(t: Floats, gyr: Floats, level: Floats, start: Ints, stop: Ints) -> Ints:
    """Indices of the intervals kept: of two too close for a swing only the stiller, but every rest: step 7."""
    least = np.array([level[a:b].min() for a, b in zip(start, stop, strict=True)])
    kept: list[int] = []
    for k in range(len(start)):
        while kept and is_too_close(t, gyr, stop[kept[-1]], start[k]) and least[k] <= least[kept[-1]] > REST_LEVEL:
            kept.pop()
        if not kept or least[k] <= REST_LEVEL or not is_too_close(t, gyr, stop[kept[-1]], start[k]):
            kept.append(k)
    return np.array(kept, dtype=np.int64)


def is_too_close(t: Floats, gyr: Floats, stop: int, start: int) -> bool:
    """Whether between an interval's `stop` and the next one's `start` the foot turns as in a swing, but too briefly."""
    if t[start] - t[stop - 1] >= MIN_SWING_S:
        return False
    return bool(np.linalg.norm(gyr[stop : start + 1], axis=1).max() > SWING_RATE_RAD_S)


@njit(cache=True)
def _find_minima(level: Floats, prominence: float) -> tuple[Ints, Ints]:
    """First and last lowest sample (M,) of the minima from which the level rises by `prominence` before it falls lower.

    Beyond both ends the level is high. (`scipy.signal.find_peaks` takes quadratic time where many minima are cut off
    at one level.)
    """
    first, last = np.empty(len(level), dtype=np.int64), np.empty(len(level), dtype=np.int64)
    count, falling = 0, True
    low = high = level[0]
    first[0] = last[0] = 0
    for i in range(len(level)):
        x = level[i]
        if falling and x < low:
            low = x
            first[count] = last[count] = i
        elif falling and x == low:
            last[count] = i
        elif falling and x >= low + prominence:
            count, falling, high = count + 1, False, x
        elif not falling and x <= high - prominence:
            falling, low = True, x
            first[count] = last[count] = i
        elif not falling:
            high = max(high, x)
    count += falling
    return first[:count], last[:count]


def _find_best_chain(
    t: Floats, worth: Floats, velocity: Floats, s0: float, sa: float, longest: float, swing: float
) -> Ints:
    """Indices of the candidates of the best chain, in order: the dynamic programme of step 3; `worth` (C,) is u.

    `t` (2, C) s and `velocity` (2, C, 3) m/s at the candidates' first and last samples: links lead from last to first.
    """
    best, previous = np.empty(len(worth)), np.full(len(worth), -1)
    _link(t, worth, velocity, s0, sa, longest, swing, best, previous)
    chain = [int(np.argmax(best - np.where(t[1, -1] - t[1] > swing, BROKEN, 0.0)))]
    while previous[chain[-1]] >= 0:
        chain.append(previous[chain[-1]])
    return np.array(chain[::-1])


@njit(cache=True)
def _link(
    t: Floats,
    worth: Floats,
    velocity: Floats,
    s0: float,
    sa: float,
    longest: float,
    swing: float,
    best: Floats,
    previous: Ints,
) -> None:
    """Write the score `best` (C,) of the best chain that ends at each candidate, and its `previous` (C,) candidate."""
    for j in range(len(worth)):
        best[j] = worth[j] - (BROKEN if t[0, j] - t[0, 0] > swing else 0.0)
        for i in range(j - 1, -1, -1):
            elapsed = t[0, j] - t[1, i]
            if elapsed > longest and j - i > 1:
                break
            change = 0.0
            for axis in range(3):
                change += (velocity[0, j, axis] - velocity[1, i, axis]) ** 2
            cost = 2.0 * np.log1p(change / (4.0 * (s0 * s0 + (sa * elapsed) ** 2)))
            total = best[i] + worth[j] - min(cost, BROKEN / 2)
            if total > best[j]:
                best[j], previous[j] = total, i


@njit(cache=True)
def _grow_and_merge(level: Floats, samples: Ints, threshold: Floats, found: Floats) -> int:
    """Grow intervals about `samples` (F,) below their thresholds, merged into `found` (3, F); return their number."""
    start, stop, own = found[0], found[1], found[2]
    k = 0
    for n in range(len(samples)):
        i, limit = samples[n], threshold[n]
        if k > 0 and i < stop[k - 1] and limit <= own[k - 1]:
            continue
        a, b = i, i + 1
        while a > 0 and level[a - 1] < limit:
            a -= 1
        while b < len(level) and level[b] < limit:
            b += 1
        if k > 0 and a <= stop[k - 1]:
            stop[k - 1] = max(stop[k - 1], b)
            continue
        start[k], stop[k], own[k] = a, b, limit
        k += 1
    return k


def find_cycle_stances(t: Floats, acc: Floats, level: Floats, minima: Ints, start: Floats, stop: Floats) -> Ints:
    """Find the stances of a running foot between the intervals `start` to `stop` (K,); return samples from `minima`."""
    ends = np.array([0, len(t) - 1])
    before = np.concatenate([ends[:1], np.minimum(stop, ends[1])]).astype(np.int64)
    after = np.concatenate([start, ends[1:]]).astype(np.int64)
    gap = np.searchsorted(start, minima, side="right")
    longest_s = (t[after] - t[before])[gap] / GAP
    inside = (minima > before[gap]) & (minima < after[gap]) & (level[minima] < MAX_CYCLE_LEVEL)
    chosen = inside & (longest_s > CYCLE_S[0])
    found = []
    for i, seconds in zip(minima[chosen], longest_s[chosen], strict=True):
        # the foot has landed shortly before
        since = np.searchsorted(t, t[i] - LANDING_S)
        landed = np.linalg.norm(acc[since : i + 1], axis=1).max() > LANDING_M_S2
        if not landed or not is_lowest_of_cycle(t, level, i, CYCLE_S[0]):
            continue
        # lowest of its cycle, which fits into the gap and is recorded as far as it counts
        period_s = measure_period(t, level, i)
        recorded = t[i] + SHARE * period_s <= t[-1]
        if 0.0 < period_s < seconds and recorded and is_lowest_of_cycle(t, level, i, period_s):
            found.append(i)
    return np.array(found, dtype=np.int64)


def find_mid_swings(t: Floats, level: Floats, stillest: Ints) -> Bools:
    """Mask (K,) of footfalls, by stillest sample, above `DOUBTFUL_LEVEL` and not lowest of their gait cycle."""
    found = np.zeros(len(stillest), dtype=np.bool_)
    for k in np.flatnonzero(level[stillest] > DOUBTFUL_LEVEL):
        period_s = measure_period(t, level, stillest[k])
        found[k] = period_s > 0.0 and not is_lowest_of_cycle(t, level, stillest[k], period_s)
    return found


def measure_period(t: Floats, level: Floats, sample: int) -> float:
    """Return the gait period about a sample, s, by the autocorrelation of `level` (N,); zero where it shows none."""
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
    """Autocorrelation (L,) of a zero-mean signal, at each lag the mean of the overlap; zero for a constant signal."""
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


def is_falling(acc: Floats) -> Bools:
    """Mask (N,) of the samples in free fall, or with gravity removed: no specific force to level by."""
    return np.asarray(np.linalg.norm(acc, axis=1) < FREE_FALL_M_S2)


class StrapdownPass:
    """The free strapdown pass of step 2, of a part or of a stream: never over a gap. The velocity has a slow drift.

    It begins at rest at the stillest of the samples of the first call, levelled there, and goes back to the very first.
    At still samples the tilt is nudged toward the specific force. Behind a hole the tilt is unknown: up is the mean of
    the still samples that follow, until they are many.
    """

    def __init__(self, still_level: float, longest_step_s: float) -> None:
        self._still_level, self._longest_step_s = still_level, longest_step_s
        self._state: NavState | None = None
        self._still_since_hole = np.array([MANY])

    def velocity(self, t: Floats, acc: Floats, gyr: Floats, level: Floats) -> Floats:
        """Return the free velocity (n, 3) m/s at n more samples; `t` (n + 1,) s includes the stamp after the last."""
        h, hole = np.minimum(np.diff(t), self._longest_step_s), np.diff(t) > MAX_HELD_S
        still, since = level < self._still_level, self._still_since_hole
        if self._state is not None:
            return np.asarray(_continue_pass(self._state, since, acc, gyr, h, still, hole, GRAVITY_M_S2))
        falls = is_falling(acc)
        if falls.all():  # then no sample is a candidate
            return np.zeros_like(acc)
        first = int(np.argmin(np.where(falls, np.inf, level)))
        self._state = start_at_rest(level_attitude(acc[first]))
        return integrate_both_ways(self._state, since, first, acc, gyr, h, still, hole)


def start_at_rest(nav_R_body: Floats) -> NavState:
    """State at rest at the origin, with this attitude (3, 3)."""
    return NavState(np.zeros(3), np.zeros(3), nav_R_body.copy(), np.zeros(3), np.zeros(3))


def integrate_both_ways(
    state: NavState, since: Ints, first: int, acc: Floats, gyr: Floats, h: Floats, still: Bools, hole: Bools
) -> Floats:
    """Velocity (n, 3) m/s of a pass from a state at the sample `first`; `state` and `since` are those of its end."""
    there, back, begun = np.arange(first, len(acc)), np.arange(first)[::-1], start_at_rest(state.nav_R_body)
    after = _continue_pass(state, since, acc[there], gyr[there], h[there], still[there], hole[there], GRAVITY_M_S2)
    before = _continue_pass(
        begun, np.array([MANY]), acc[back], gyr[back], -h[back], still[back], hole[back], GRAVITY_M_S2
    )
    return np.concatenate([before[::-1], after])


@njit(cache=True)
def _continue_pass(
    state: NavState, since: Ints, acc: Floats, gyr: Floats, h: Floats, still: Bools, hole: Bools, gravity: float
) -> Floats:
    """Propagate `state` over n samples in place, backward where `h` < 0; return velocity (n, 3) m/s at their stamps.

    `since` (1,) counts the still samples since the last hole: the first ones level the sensor by their mean.
    """
    velocity = np.empty((len(h), 3))
    turn, push = np.empty((3, 3)), np.empty(3)
    for i in range(len(h)):
        if h[i] > 0.0:
            velocity[i] = state.velocity
        strapdown(state, acc[i], gyr[i], h[i], gravity, turn, push)
        if hole[i]:
            since[0] = 0
        elif still[i]:
            since[0] += 1
            nudge_tilt(state.nav_R_body, acc[i], max(min(abs(h[i]) / TILT_TIME_S, 1.0), 1.0 / since[0]))
        if h[i] < 0.0:
            velocity[i] = state.velocity
    return velocity
