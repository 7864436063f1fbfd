"""How far the clocks of two feet are apart, by their steps.

Feet swing in turn. Let a_i be the middles of the first foot's swings and b_j those of the second's, by its own clock,
and tau what is to be added to that. Between two swings of the first, a_i and a_(i+1), there is one of the second, at
the phase

    phi = (b + tau - a_i) / (a_(i+1) - a_i),    1/2 +- `PHASE_SIGMA`,

and where there is none, or there are two, it costs `MISSED` nats. Who walks evenly does so at every cycle's shift of
the clocks: which cycle it is the bends of the way show, as both feet turn alike. With the turn alpha of each stride,
about up and within its time, it costs

    (alpha - alpha' - m)^2 / (2 `TURN_SIGMA_RAD`^2),

alpha' the turn of the second foot over the same time and m the mean difference, which is that of the gyroscope biases;
and so do halts, where one foot has swings and the other has none. A stride during which the second foot did not record
costs `HIDDEN`, and what the first did not record nothing.

L(tau) is the sum, nats. Steps of a walk are alike, so that L counts `SHARE` of it. Where a swing costs less than
`FITTING` at zero the clocks stay as they are, unless few are shared and another offset fits better. Where the best L is
by `ENOUGH` better than that of any other cycle it is taken. Else the recordings do not show it. Beyond `NEAR_S`, where
of very many offsets one may fit by chance, a swing is to cost less than `FITTING` there too.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.feet.steps import LONGEST_S
from fg_nav.frames import GRAVITY_M_S2, level_attitude
from fg_nav.mechanisation import integrate_strides
from fg_nav.recording import Recording
from fg_nav.samples.gaps import cross_holes, list_unrecorded
from fg_nav.stances import Stances

PHASE_SIGMA = 0.1
"""Of a cycle: steps of one foot are up to a tenth longer than those of the other."""

MISSED = 4.0
"""nats: one swing in fifty has no partner, where one shuffles or the detector fails."""

TURN_SIGMA_RAD = 0.15
"""Of the turns of both feet over one stride: they turn by turns."""

MOST_SHIFTS = 4.0
"""nats that a stride's turn costs at most."""

SHARE = 0.2
"""Of independent steps."""

ENOUGH = 5.0
"""nats."""

FITTING, FOREIGN = 0.8, 1.8
"""Mean cost of a swing, nats, below which clocks fit as they are (0.1 to 0.4 where they do, 0.7 where they are 0.1 s
apart), and above which the feet are not those of one walk (from 1.9 on, `scripts/two_feet.py`)."""

HIDDEN = 1.0
"""nats: a stride of which nothing is known neither fits nor speaks against it."""

NEAR_S, SPACING_S, COARSE_S = 30.0, 0.04, 0.2
"""How far clocks are looked for first, and in which steps; then as far as the recordings share a moment, coarsely, and
finely about the best of these."""

ENOUGH_SHARED = 0.5
"""Of the swings: clocks that fit for less of them may do so by chance, and others are looked for."""

FEWEST_SWINGS, MOST_SWINGS = 3, 600
"""Of the first foot that are compared: ten minutes."""


@dataclass(frozen=True)
class ClockOffset:
    """What is to be added to the stamps of the second recording, s, and a remark; zero and none where they fit."""

    offset_s: float
    note: str = ""


@dataclass(frozen=True)
class Swings:
    """Swings of one foot: their middles (S,) s, and times (T,) s and heading (T,) rad, of some moment, by the turns.

    `holes` (H, 2) s are those in the recording.
    """

    middle: Floats
    t: Floats
    heading: Floats
    holes: Floats

    def within(self, begin: float, end: float) -> Swings:
        """Return those of a stretch of time."""
        return replace(self, middle=self.middle[(self.middle >= begin) & (self.middle <= end)])

    def hides(self, begin: Floats, end: Floats) -> Bools:
        """Whether some of each span (S,) s lies in a hole."""
        first = np.searchsorted(self.holes[:, 1], begin)
        return np.asarray(first < np.searchsorted(self.holes[:, 0], end))


def align_clocks(first: Recording, first_stances: Stances, second: Recording, second_stances: Stances) -> ClockOffset:
    """Find what is to be added to the second recording's stamps so that the feet swing in turn.

    Raises `EstimationError` where the clocks do not fit as they are, and the recordings do not show by how much.
    """
    return match_swings(list_swings(first, first_stances), list_swings(second, second_stances))


def match_swings(a: Swings, b: Swings) -> ClockOffset:
    """Find what is to be added to the times of b so that the feet swing in turn; raises as `align_clocks`."""
    if min(len(a.middle), len(b.middle)) < FEWEST_SWINGS:
        return ClockOffset(0.0)
    a = a.within(a.middle[0], a.middle[min(len(a.middle), MOST_SWINGS) - 1])
    # Clocks that fit do so while both recorded: a sensor may have failed for the rest.
    shared = a.within(b.middle[0], b.middle[-1])
    fits = len(shared.middle) >= FEWEST_SWINGS and _weigh(shared, b, 0.0) > -FITTING * SHARE * len(shared.middle)
    if fits and len(shared.middle) > ENOUGH_SHARED * min(len(a.middle), len(b.middle)):
        return ClockOffset(0.0)
    if fits:
        # Few swings fit by chance as well: another offset is to be shown by all, and clearly.
        with suppress(EstimationError):
            found = _search(a, b)
            return found if _weigh(a, b, found.offset_s) > _weigh(a, b, 0.0) + ENOUGH else ClockOffset(0.0)
        return ClockOffset(0.0)
    return _search(a, b)


def _search(a: Swings, b: Swings) -> ClockOffset:
    """Find the offset that is clearly the best; raises as `align_clocks`."""
    worth, cycle = SHARE * len(a.middle), float(np.median(np.diff(a.middle)))
    # Sensors that were set to one time are apart by seconds.
    tau, nats = _scan(a, b, -NEAR_S, NEAR_S, SPACING_S)
    if nats.max() >= -FOREIGN * worth:
        return _choose(tau, nats, cycle)
    # Those that count from when they were switched on are apart by any; of so many offsets one fits by chance.
    far, coarse = _scan(a, b, a.middle[0] - b.middle[-1], a.middle[-1] - b.middle[0], COARSE_S)
    best = float(far[np.argmax(coarse)])
    tau, nats = _scan(a, b, best - NEAR_S, best + NEAR_S, SPACING_S)
    if nats.max() >= -FITTING * worth:
        return _choose(tau, nats, cycle)
    raise EstimationError(
        "the two recordings do not show the feet of one walk: with no offset of their clocks do they swing in turn; "
        "check the files, or give --clock-offset."
    )


def _scan(a: Swings, b: Swings, begin: float, end: float, spacing: float) -> tuple[Floats, Floats]:
    """Offsets (T,) s from begin to end, and L (T,) of each."""
    tau = np.arange(begin, end + 0.5 * spacing, spacing)
    return tau, np.array([_weigh(a, b, float(one)) for one in tau])


def _choose(tau: Floats, nats: Floats, cycle: float) -> ClockOffset:
    """Choose among offsets (T,) s of these nats (T,), of swings that are `cycle` s apart."""
    best = int(np.argmax(nats))
    others = nats[np.abs(tau - tau[best]) > 0.5 * cycle]
    if len(others) and others.max() > nats[best] - ENOUGH:
        raise EstimationError(
            "the clocks of the two recordings do not fit, as both feet swing at once, and their steps do not show "
            f"by how much: it may be {tau[best]:+.2f} s or a stride more or less; give --clock-offset."
        )
    offset = _refine(tau, nats, best)
    return ClockOffset(offset, f"clocks aligned by the steps: {offset:+.2f} s added to the second recording's stamps")


def _refine(tau: Floats, nats: Floats, best: int) -> float:
    """Middle of the offsets that are as good as the best one."""
    near = np.abs(tau - tau[best]) < 0.5
    weight = np.exp(nats[near] - nats[best])
    return float(weight @ tau[near] / weight.sum())


def _weigh(a: Swings, b: Swings, tau: float) -> float:
    """L of an offset, nats."""
    begin, end = a.middle[:-1], a.middle[1:]
    counts, recorded = np.diff(np.searchsorted(b.middle, [begin - tau, end - tau]), axis=0)[0], ~a.hides(begin, end)
    walks = end - begin < LONGEST_S
    cost = _weigh_strides(a, b, tau, begin[walks & recorded], end[walks & recorded])
    # Swings of the second foot while the first one stands for long.
    alone = counts[~walks & recorded].sum() if walks.any() else len(b.middle)
    return -SHARE * float(cost + MISSED * alone)


def _weigh_strides(a: Swings, b: Swings, tau: float, begin: Floats, end: Floats) -> float:
    """Cost of the first foot's strides, from middle to middle of its swings (S,) s."""
    if not len(begin):
        return 0.0
    at = np.searchsorted(b.middle, [begin - tau, end - tau])
    phase = (b.middle[np.minimum(at[0], len(b.middle) - 1)] + tau - begin) / (end - begin)
    cost = np.where(at[1] - at[0] == 1, np.minimum(0.5 * ((phase - 0.5) / PHASE_SIGMA) ** 2, MISSED), MISSED)
    turned = [np.interp([begin - d, end - d], one.t, one.heading) for one, d in ((a, 0.0), (b, tau))]
    differ = (turned[0][1] - turned[0][0]) - (turned[1][1] - turned[1][0])
    hidden = b.hides(begin - tau, end - tau)
    differ = differ - np.median(differ[~hidden]) if not hidden.all() else differ
    cost += np.minimum(0.5 * (differ / TURN_SIGMA_RAD) ** 2, MOST_SHIFTS)
    return float(np.where(hidden, HIDDEN, cost).sum())


def list_swings(recording: Recording, stances: Stances) -> Swings:
    """List the swings between footfalls, and how the foot turned about up from stance to stance."""
    t = recording.t
    arrives, leaves = stances.spans
    begin, end = t[leaves[:-1] - 1], t[arrives[1:]]
    sample = stances.stillest(recording.gyr)
    seen = ~cross_holes(t, sample)
    return Swings(0.5 * (begin + end)[seen], t[sample], _sum_turns(recording, sample), list_unrecorded(t)[1:-1])


def _sum_turns(recording: Recording, sample: Ints) -> Floats:
    """Heading (F,) rad at footfalls, from zero, counter-clockwise: what each stride turned about up."""
    acc, gyr = recording.integrable
    level = np.array([level_attitude(up) for up in acc[sample[:-1]]]).reshape(-1, 3, 3)
    attitude, h = level.copy(), np.append(np.diff(recording.t), recording.period_s)
    integrate_strides(acc, gyr, h, sample[:-1], sample[1:], attitude, np.zeros((len(level), 3)), GRAVITY_M_S2)
    turn = attitude @ np.swapaxes(level, 1, 2)
    twist = np.arctan2(turn[:, 1, 0] - turn[:, 0, 1], turn[:, 0, 0] + turn[:, 1, 1])
    return np.concatenate([[0.0], np.cumsum(twist)])
