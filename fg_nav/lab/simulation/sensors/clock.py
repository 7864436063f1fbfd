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
from typing import Annotated

import numpy as np
from pydantic import Field

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.checks import Checked, Share
from fg_nav.system.compiled import njit

SPACING = 0.02  # Samples out of a queue are at least this share of a period apart: the time it takes to send one.


@dataclass(frozen=True)
class ClockPrior(Checked):
    """What clocks and transports of one kind are like; perfect ones by default.

    Attributes
    ----------
    jitter_s : mean, and standard deviation, of the delay of a stamp, s.
    scale_sd : standard deviation of the clock's scale error e: 30e-6 for a crystal.
    dropped_share : of the samples, up to a half.
    burst : how many samples are lost in a row, on average, before the longest gap cuts it.
    longest_gap_s : longest time without a sample, s; a gap of more than 0.5 s cuts a recording that is read.
    """

    jitter_s: Annotated[float, Field(ge=0.0, le=0.05)] = 0.0
    scale_sd: Annotated[float, Field(ge=0.0, le=0.01)] = 0.0  # a worse clock gains a quarter of an hour a day
    dropped_share: Share = 0.0
    burst: Annotated[float, Field(ge=1.0, le=1000.0)] = 1.0
    longest_gap_s: Annotated[float, Field(gt=0.0, le=1.0)] = 0.05


class ClockRun:
    """Clock and transport during a recording at a rate.

    Raises `SimulationError` if samples are to be lost and the rate is so low that one of them is too many.
    """

    def __init__(self, prior: ClockPrior, scale_error: float, rng: np.random.Generator, rate_hz: float) -> None:
        self.prior, self.scale_error = prior, scale_error
        self._delay_rng, self._loss_rng = rng.spawn(2)
        self._spacing_s = SPACING / rate_hz
        self._longest = int(prior.longest_gap_s * rate_hz + 1e-9) - 1  # samples that may be lost in a row
        if prior.dropped_share and self._longest < 1:
            raise SimulationError(
                f"at {rate_hz:g} Hz a single lost sample leaves a gap longer than the longest_gap_s of "
                f"{prior.longest_gap_s:g} s: raise it, or drop none."
            )
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
        shown = (1 + self.scale_error) * t
        return self._stamps(shown)[rows], shown[rows], rows

    def _stamps(self, right: Floats) -> Floats:
        jitter_s = self.prior.jitter_s
        if jitter_s == 0 or not len(right):
            return right
        # t_i - i spacing is the highest so far of s_i + d_i - i spacing
        line = self._spacing_s * (self._count + np.arange(len(right)))
        arrival = right + jitter_s * (self._delay_rng.standard_exponential(len(right)) - 1)
        highest = np.maximum(np.maximum.accumulate(arrival - line), self._latest)
        self._count, self._latest = self._count + len(right), float(highest[-1])
        return np.asarray(highest + line)

    def _arrived(self, count: int) -> Bools:
        prior = self.prior
        if prior.dropped_share == 0:
            return np.ones(count, dtype=np.bool_)
        on = 1 - 1 / prior.burst
        mean_burst = prior.burst * (1 - on**self._longest)
        begin = min(1.0, prior.dropped_share / (mean_burst * (1 - prior.dropped_share)))
        chance = self._loss_rng.random(count)
        arrived, self._lost = _gilbert(chance, begin, on, self._longest, self._lost)
        return arrived


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
