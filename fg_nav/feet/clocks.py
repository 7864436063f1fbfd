"""How far the clocks of two feet are apart, and whether one of them runs fast, by the steps.

Feet swing in turn. Let a_i be the middles of the first foot's swings and b_j those of the second's, by its own clock,
and tau what is to be added to that. Between two swings of the first, a_i and a_(i+1), there is one of the second, at
the phase

    phi = (b + tau - a_i) / (a_(i+1) - a_i) = 1/2 + l + noise,    sigma `PHASE_SIGMA`,

l by how much the person limps, of sigma `LIMP_SIGMA` and the same all along. Where there is none, or there are two, it
costs `MISSED` nats. Who walks evenly does so at every cycle's shift of the clocks: which cycle it is the bends of the
way show, as both feet turn alike. With the turn alpha of each stride, about up and within its time, it costs

    d^2 / (2 s^2),    d = alpha - alpha' - m,    s^2 = `TURN_SIGMA_RAD`^2 + (`TURN_SHARE` max alpha)^2,

alpha' the turn of the second foot over the same time, m the mean difference, which is that of the gyroscope biases, and
the largest alpha that of the stride or of one next to it: a foot turns in its swing what the person turns in a stride.
So do halts cost, where one foot has swings and the other has none. A stride during which the second foot did not record
costs `UNRELATED`, as any does of feet that have nothing to do with each other, and what the first did not record
nothing.

Clocks of cheap sensors run fast or slow by some percent, and stamps counted at a nominal rate do so too: tau(t) = tau_0
+ rho (t - t_0). L(tau_0, rho) is the sum, nats, of which `SHARE` counts, as the steps of a walk are alike; its turns
are less so, and count `TURN_WORTH` times as much. Most pairs are on one clock; of the others the logarithm of how many
offsets and rates there are is lost. The best is taken: zero, another that is by `ENOUGH` better than that of any other
cycle, or none, where feet that are unrelated are as likely.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.detection.stance import Stances
from fg_nav.errors import EstimationError
from fg_nav.feet.steps import find_longest_stride
from fg_nav.frames import GRAVITY_M_S2, level_attitude
from fg_nav.mechanisation import integrate_strides
from fg_nav.recording import Recording
from fg_nav.samples.gaps import cross_holes, list_unrecorded

PHASE_SIGMA, LIMP_SIGMA = 0.1, 0.05  # Of a cycle: steps of one foot are up to a tenth longer than the other's.
MISSED = 4.0  # nats: one swing in fifty has no partner, where one shuffles or the detector fails.
TURN_SIGMA_RAD, TURN_SHARE = 0.15, 0.5  # Of the turns of both feet over one stride: they turn by turns.
MAX_TURN_COST, TURN_WORTH = 4.0, 2.5  # nats, of a stride's turn; and how many swings it counts for.
MAX_ALONE = 3  # Swings in a stand of the other foot that count.
SHARE = 0.2  # Of independent steps.
ENOUGH = 3.0  # nats between two cycles: twenty to one.
FITTING, UNRELATED = 0.4, 1.8  # nats a swing: of clocks that fit 0.1 to 0.4; above, not one walk.
NEAR_S, SPACING_S = 30.0, 0.04  # Offsets that are searched first, and their spacing; then all with a moment in common.
COARSE_S = 0.2  # Spacing of these, before they are searched finely about the best.
MAX_DRIFT = 0.02  # By which one clock runs faster: oscillators of MEMS sensors are within a percent or two.
DRIFT_NATS = 4.0  # It costs that one runs faster at all.
APART_NATS, FAR_NATS = 5.5, 3.0  # It costs that clocks are apart: 300 offsets within `NEAR_S`; and more further away.
FOREIGN_NATS = 5.0  # It costs that recordings given as of one walk are not.
AT_ONCE = 2000  # Offsets that are weighed at once.
MIN_SWINGS, MAX_SWINGS = 3, 600  # Of the first foot that are compared: ten minutes.


@dataclass(frozen=True)
class ClockOffset:
    """What is to be added to the second recording's stamps, s, and a remark; zero and none where they fit."""

    offset_s: float
    note: str = ""
    drift: float = 0.0  # by how much more with each second after `at`, s/s
    at: float = 0.0  # s, by the second recording's own clock

    def shift(self, t: Floats) -> Floats:
        """Return stamps (N,) of the second recording by the first one's clock, s."""
        return t + self.offset_s + self.drift * (t - self.at)


@dataclass(frozen=True)
class Swings:
    """Swings of one foot, and its turns."""

    middle: Floats  # (S,) s
    t: Floats  # (T,) s
    heading: Floats  # (T,) rad at these times, from an arbitrary one
    holes: Floats  # (H, 2) s, those in the recording, with what is before and after it

    def hides(self, begin: Floats, end: Floats) -> Bools:
        """Whether some of each span, of any shape, s, lies in a hole."""
        first = np.searchsorted(self.holes[:, 1], begin, side="right")
        return np.asarray(first < np.searchsorted(self.holes[:, 0], end))


def match_swings(a: Swings, b: Swings) -> ClockOffset:
    """Find what is to be added to the stamps of the second foot b so that the feet swing in turn.

    Raises `EstimationError` where the clocks do not fit as they are, and the swings do not show by how much.
    """
    if min(len(a.middle), len(b.middle)) < MIN_SWINGS:
        return ClockOffset(0.0)
    a = replace(a, middle=a.middle[:MAX_SWINGS])
    # on one clock
    as_it_is = float(_Match.of(a, b, np.zeros(1)).weigh(0.0)[0])
    if as_it_is > -APART_NATS:
        return ClockOffset(0.0)
    # set to one time, and apart by seconds
    found = [_search(a, b, np.arange(-NEAR_S, NEAR_S, SPACING_S), -APART_NATS)]
    unrelated = -SHARE * UNRELATED * (len(a.middle) - 1) - FOREIGN_NATS
    if max(as_it_is, found[0].nats) < unrelated + FOREIGN_NATS + ENOUGH:
        # counted from when each was switched on: apart by any time
        far = np.arange(a.middle[0] - b.middle[-1], a.middle[-1] - b.middle[0], COARSE_S)
        pieces = np.array_split(far, 1 + len(far) // AT_ONCE)
        best = far[np.argmax(np.concatenate([_Match.of(a, b, some).weigh(0.0) for some in pieces]))]
        found.append(_search(a, b, best + np.arange(-NEAR_S, NEAR_S, SPACING_S), -APART_NATS - FAR_NATS))
    best_found = max(found, key=lambda one: one.nats)
    if max(as_it_is, best_found.nats) < unrelated:
        raise EstimationError(
            "the two recordings do not show the feet of one walk: with no offset of their clocks do they swing in "
            "turn; check the files, or give --clock-offset."
        )
    if as_it_is >= best_found.nats:
        return ClockOffset(0.0)
    best, drift = best_found.best, best_found.drift
    if best_found.rival > best_found.nats - ENOUGH:
        raise EstimationError(
            "the clocks of the two recordings do not fit, as both feet swing at once, and their steps do not show "
            f"by how much: it may be {best:+.2f} s or a stride more or less; give --clock-offset."
        )
    # tau(t) = best + drift (t - t_0), t by the first clock; the offset is by the second's
    at = float(b.t[0])
    began = (at + best - drift * best_found.t) / (1.0 - drift)
    offset, drift = began - at, drift / (1.0 - drift)
    note = f"clocks aligned by the steps: {offset:+.2f} s added to the second recording's stamps"
    if drift:
        note += f", and {100.0 * drift:+.2f} % of the time since its start: one of the clocks runs fast"
    return ClockOffset(offset, note, drift, at)


class _Found(NamedTuple):
    """The best offset of the second clock, s at `t` s, its nats, and those of the best one of another cycle."""

    nats: float
    rival: float
    best: float
    drift: float
    t: float


def _search(a: Swings, b: Swings, tau: Floats, prior: float) -> _Found:
    """Maximize likelihood plus `prior` (T,) nats over offsets `tau` (T,) s, evenly spaced, and over clock drift."""
    match, spacing = _Match.of(a, b, tau), tau[1] - tau[0]
    span = match.t[-1] - match.t[0]
    rates, nats = np.zeros(1), match.weigh(0.0)[None]
    # search drift only if no constant offset fits
    if nats.max() < -SHARE * FITTING * len(match.t):
        count = int(0.5 * MAX_DRIFT * span / (2.0 * spacing))
        rates = np.append(rates, np.delete(np.linspace(-MAX_DRIFT, MAX_DRIFT, 2 * count + 1), count))
        nats = np.stack([nats[0], *(match.weigh(rate) - DRIFT_NATS for rate in rates[1:])])
    nats += prior
    row, best = np.unravel_index(np.argmax(nats), nats.shape)
    # posterior mean within that gait cycle, without the limp, which is indistinguishable from an offset
    evenly = match.weigh(rates[row], limps=False)
    near = np.abs(tau - tau[best]) < 0.5 * match.cycle
    weight = np.exp(evenly[near] - evenly[near].max())
    middle = float(weight @ tau[near] / weight.sum())
    t, drift = float(0.5 * (match.t[0] + match.t[-1])), float(rates[row])
    others = nats.max(axis=0)[np.abs(tau - middle) > 0.5 * match.cycle]
    return _Found(float(nats[row, best]), float(others.max(initial=-np.inf)), middle, drift, t)


@dataclass(frozen=True)
class _Match:
    """Strides of the first foot, in which the second foot swings, with its clock set on by each of some offsets."""

    tau: Floats  # (T,) s, offsets
    t: Floats  # (S,) s, middles of the strides
    phase: Floats  # (S, T) of the one swing of the second foot, less 1/2; NaN where there is not one
    rest: Floats  # (S, T) nats, what all else costs
    cycle: float  # s, usual time of a stride

    @classmethod
    def of(cls, a: Swings, b: Swings, tau: Floats) -> _Match:
        """Match the second foot's swings to strides (mid-swing to mid-swing) of the first, at each offset `tau`."""
        begin, end = (one[:, None] for one in (a.middle[:-1], a.middle[1:]))
        walks = end - begin < find_longest_stride(a.middle)
        hidden, unseen = b.hides(begin - tau, end - tau), a.hides(begin, end)
        at = np.searchsorted(b.middle, np.stack([begin - tau, end - tau]))
        count = at[1] - at[0]
        phase = (b.middle[np.minimum(at[0], len(b.middle) - 1)] + tau - begin) / (end - begin) - 0.5
        # turns of both over the same time
        turn, other = (
            np.interp(end - d, one.t, one.heading) - np.interp(begin - d, one.t, one.heading)
            for one, d in ((a, 0.0), (b, tau))
        )
        differ = np.where(hidden | ~walks | unseen, np.nan, turn - other)
        known = np.isfinite(differ).any(axis=0)
        differ[:, known] -= np.nanmedian(differ[:, known], axis=0)
        around = np.pad(np.abs(turn), ((1, 1), (0, 0)))
        sigma = np.hypot(TURN_SIGMA_RAD, TURN_SHARE * np.maximum(np.maximum(around[:-2], around[2:]), np.abs(turn)))
        of_turn = np.nan_to_num(np.minimum(0.5 * (differ / sigma) ** 2, MAX_TURN_COST))
        rest = TURN_WORTH * of_turn + MISSED * (count != 1)
        # while the first one stands for long the second one has none
        rest = np.where(walks, rest, MISSED * np.minimum(count, MAX_ALONE))
        rest = np.where(hidden, UNRELATED, rest)
        phase = np.where((count == 1) & walks & ~hidden & ~unseen, phase, np.nan)
        return cls(tau, 0.5 * (begin + end)[:, 0], phase, np.where(unseen, 0.0, rest), float(np.median(end - begin)))

    def weigh(self, drift: float, limps: bool = True) -> Floats:
        """Log likelihood (T,) nats of the offset at mid-walk, at relative clock `drift`; `limps`: estimate a limp."""
        phase, rest = self.phase, self.rest
        if drift:
            late = drift * (self.t - 0.5 * (self.t[0] + self.t[-1])) / (self.tau[1] - self.tau[0])
            column = np.arange(len(self.tau)) + np.rint(late).astype(np.int64)[:, None]
            column = np.clip(column, 0, len(self.tau) - 1)
            phase, rest = (np.take_along_axis(one, column, axis=1) for one in (phase, rest))
        is_one = np.isfinite(phase)
        phase = np.where(is_one, phase, 0.0)
        limp = np.zeros(phase.shape[1])
        if limps:
            count = is_one.sum(axis=0)
            limp = phase.sum(axis=0) / (count + (PHASE_SIGMA / LIMP_SIGMA) ** 2 / SHARE)
        cost = np.minimum(0.5 * ((phase - limp) / PHASE_SIGMA) ** 2, MISSED) * is_one + rest
        return np.asarray(-SHARE * cost.sum(axis=0) - 0.5 * (limp / LIMP_SIGMA) ** 2)


def list_swings(recording: Recording, stances: Stances) -> Swings:
    """Return the times of swings and stances, heading change between stances, and unrecorded spans."""
    t = recording.t
    arrives, leaves = stances.spans
    begin, end = t[leaves[:-1] - 1], t[arrives[1:]]
    sample = stances.stillest(recording.gyr)
    # heading: what each stride turned about up, counter-clockwise
    acc, gyr = recording.integrable
    level = level_attitude(acc[sample[:-1]])
    attitude, h = level.copy(), recording.periods_s
    integrate_strides(acc, gyr, h, sample[:-1], sample[1:], attitude, np.zeros((len(level), 3)), GRAVITY_M_S2)
    turn = attitude @ np.swapaxes(level, 1, 2)
    twist = np.arctan2(turn[:, 1, 0] - turn[:, 0, 1], turn[:, 0, 0] + turn[:, 1, 1])
    heading = np.repeat(np.concatenate([[0.0], np.cumsum(twist)]), 2)
    # it turns while the foot swings
    stands = np.stack([t[arrives], t[leaves - 1]], axis=1).ravel()
    return Swings(0.5 * (begin + end)[~cross_holes(t, sample)], stands, heading, list_unrecorded(t))
