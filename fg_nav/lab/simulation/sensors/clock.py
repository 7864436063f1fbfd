"""Clock and transport of a recording: which samples arrive, and which stamps they get.

    t_i = max((1 + e) s_i + d_i,  t_(i-1) + 2 % of the period)

s_i (s) is when sample i was truly taken. e is the scale error of the clock, fixed for a unit. d_i (s) is the delay
on the way to the logger, exponential and independent; its mean is taken off, so that stamps are right on average.
Samples queue: none overtakes another, so stamps rise strictly. This is the model that `fg_nav.samples.stamps` undoes.

Samples are lost in bursts: after a sample that arrived one is lost with a fixed chance, and after a lost one the
next is lost with another (Gilbert's channel), up to a longest gap. The first sample of all arrives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.sensors import checks
from fg_nav.system.compiled import njit

SPACING = 0.02  # Samples out of a queue are at least this share of a period apart: the time it takes to send one.

MAX_DROPPED = 0.5

MAX_JITTER_S = 0.05

MAX_SCALE_SD = 0.01  # A clock that is worse gains a quarter of an hour a day.

MAX_BURST = 1000.0

MAX_GAP_S = 1.0


@dataclass(frozen=True)
class ClockPrior:
    """What clocks and transports of one kind are like; perfect ones by default.

    Attributes
    ----------
    jitter_s : mean, and standard deviation, of the delay of a stamp, s.
    scale_sd : standard deviation of the clock's scale error e: 30e-6 for a crystal.
    dropped_share : of the samples, up to a half.
    burst : how many samples are lost in a row, on average, before the longest gap cuts it.
    longest_gap_s : longest time without a sample, s; a gap of more than 0.5 s cuts a recording that is read.

    Raises `SimulationError` if anything is negative, not a number or more than can be, naming the field.
    """

    jitter_s: float = 0.0
    scale_sd: float = 0.0
    dropped_share: float = 0.0
    burst: float = 1.0
    longest_gap_s: float = 0.05

    def __post_init__(self) -> None:
        checks.up_to(MAX_JITTER_S, self, "jitter_s")
        checks.up_to(MAX_SCALE_SD, self, "scale_sd")
        checks.up_to(MAX_DROPPED, self, "dropped_share")
        checks.between(1.0, MAX_BURST, self, "burst")
        checks.positive_finite(self, "longest_gap_s")
        checks.up_to(MAX_GAP_S, self, "longest_gap_s")

    def draw(self, rng: np.random.Generator) -> Clock:
        """Draw one clock."""
        return Clock(self, self.scale_sd * float(rng.standard_normal()))


@dataclass(frozen=True)
class Clock:
    """One particular clock; `scale_error` e stays the same from walk to walk."""

    prior: ClockPrior
    scale_error: float

    def read(self, t: Floats) -> Floats:
        """What the clock shows (N,) s at true times `t` (N,) s."""
        return np.asarray((1 + self.scale_error) * t)

    def switch_on(self, rng: np.random.Generator, rate_hz: float) -> ClockRun:
        """Start a recording at this rate; spawns its streams from `rng`.

        Raises `SimulationError` if samples are to be lost and the rate is so low that one of them is too many.
        """
        return ClockRun(self, rng, rate_hz)


class ClockRun:
    """Clock and transport during a recording."""

    def __init__(self, clock: Clock, rng: np.random.Generator, rate_hz: float) -> None:
        self.clock = clock
        self._delay_rng, self._loss_rng = rng.spawn(2)
        self._spacing_s = SPACING / rate_hz
        self._longest = _longest_burst(clock.prior, rate_hz)
        self._count, self._latest = 0, -np.inf
        self._lost = -1  # samples lost in the burst so far; the first sample of all has none before it

    def stamp(self, t: Floats) -> tuple[Floats, Floats, Ints]:
        """What the clock makes of the next N samples, taken at `t` (N,) s.

        Returns
        -------
        tuple
            Of the M that arrive: their stamps (M,) s, what the clock showed when they were taken (M,) s, (1 + e) s_i
            above, and which rows they are (M,).
        """
        rows = np.flatnonzero(self._arrived(len(t)))
        shown = self.clock.read(t)
        return self._stamps(shown)[rows], shown[rows], rows

    def _stamps(self, right: Floats) -> Floats:
        jitter_s = self.clock.prior.jitter_s
        if jitter_s == 0 or not len(right):
            return right
        # t_i - i spacing is the highest so far of s_i + d_i - i spacing
        line = self._spacing_s * (self._count + np.arange(len(right)))
        arrival = right + jitter_s * (self._delay_rng.standard_exponential(len(right)) - 1)
        highest = np.maximum(np.maximum.accumulate(arrival - line), self._latest)
        self._count, self._latest = self._count + len(right), float(highest[-1])
        return np.asarray(highest + line)

    def _arrived(self, count: int) -> Bools:
        prior = self.clock.prior
        if prior.dropped_share == 0:
            return np.ones(count, dtype=np.bool_)
        on = 1 - 1 / prior.burst
        mean_burst = prior.burst * (1 - on**self._longest)
        begin = min(1.0, prior.dropped_share / (mean_burst * (1 - prior.dropped_share)))
        chance = self._loss_rng.random(count)
        arrived, self._lost = _gilbert(chance, begin, on, self._longest, self._lost)
        return arrived


def _longest_burst(prior: ClockPrior, rate_hz: float) -> int:
    """Count the samples that may be lost in a row."""
    longest = int(prior.longest_gap_s * rate_hz + 1e-9) - 1
    if prior.dropped_share and longest < 1:
        raise SimulationError(
            f"at {rate_hz:g} Hz a single lost sample leaves a gap longer than the longest_gap_s of "
            f"{prior.longest_gap_s:g} s: raise it, or drop none."
        )
    return longest


@njit(cache=True)
def _gilbert(chance: Floats, begin: float, on: float, longest: int, lost: int) -> tuple[Bools, int]:
    """Which samples (N,) arrive, from uniform `chance` (N,), and how many were lost in a row at the end."""
    arrived = np.ones(len(chance), dtype=np.bool_)
    for i in range(len(chance)):
        if lost < 0:
            lost = 0
        elif lost == 0:
            lost = 1 if chance[i] < begin else 0
        else:
            lost = lost + 1 if lost < longest and chance[i] < on else 0
        arrived[i] = lost == 0
    return arrived, lost
