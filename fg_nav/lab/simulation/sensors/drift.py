"""The slow part of a bias: what wanders while the sensor is on.

Two processes and a trend beside each other, independent per axis, in the unit u of their sensor (rad/s or m/s^2):

    x_(k+1) = c x_k + s sqrt(1 - c^2) n_k,    c = exp(-d / T)     first-order Gauss-Markov, that is AR(1)
    w_(k+1) = w_k + q sqrt(d) n'_k                                random walk
    m t                                                           trend, of a sensor that warms up

d is the distance of knots (s), s the standard deviation of x at any time (u), T its correlation time (s),
q the density of the walk (u/sqrt(s)). x starts anywhere in its distribution, w at 0. Between knots, a
twentieth of T apart or a second, the drift is a straight line: it is slow, what is fast is white noise. So it
is a function of time that can be asked for any instant, and depends neither on the rate nor on who asks.

Munoz Diaz et al. 2017 write the AR(1) with a driving noise of B/sqrt(tau) a sample (Eq. 24), tau = t_B f_s
samples (Eq. 25), c = exp(-1/tau) (Eq. 10-11), B and t_B the lowest Allan deviation and where it lies. Hence
s = B/sqrt(2) for any rate worth the name, T = t_B: `Drift.of_instability`. The Allan deviation of such a
process has its hump, 0.62 s, at 1.9 T: it is 0.44 B.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.sensors import checks
from fg_nav.lab.simulation.sensors.checks import ZERO, Triple

KNOTS_PER_TIME = 20.0
"""Knots in a correlation time: half-way between two of them the variance is 2.5 per cent too small."""

LONGEST_STEP_S = 1.0
"""Knots are no further apart than this, however slow the drift."""

SHORTEST_TIME_S = 1.0
"""What is forgotten faster is noise."""

_CHUNK = 1024
"""Knots are drawn this many at a time, so that the path does not depend on how far it is asked for."""


@dataclass(frozen=True)
class Drift:
    """How the bias of a triad wanders; none by default.

    Attributes
    ----------
    sd : of the Gauss-Markov part at any time, u.
    time_s : its correlation time, s.
    walk : density of the random walk, u/sqrt(s): after t seconds its standard deviation is walk sqrt(t).
    trend : m (3,), steady change per axis since t = 0, u/s.
    """

    sd: float = 0.0
    time_s: float = 100.0
    walk: float = 0.0
    trend: Triple = ZERO

    def __post_init__(self) -> None:
        checks.not_negative(self, "sd", "walk")
        checks.at_least(self, "time_s", SHORTEST_TIME_S)
        checks.vector(self, "trend")

    @classmethod
    def of_instability(cls, lowest_allan: float, time_s: float, walk: float = 0.0) -> Drift:
        """Gauss-Markov part after Munoz Diaz Eq. 24-25: from the Allan deviation's minimum (u) and where it is (s)."""
        return cls(sd=float(lowest_allan / np.sqrt(2)), time_s=time_s, walk=walk)

    @property
    def step_s(self) -> float:
        """Distance of the knots, s."""
        return min(LONGEST_STEP_S, self.time_s / KNOTS_PER_TIME)


class DriftPath:
    """One drift of a triad over time, from t = 0 on; drawn as far as it is asked for."""

    def __init__(self, drift: Drift, rng: np.random.Generator) -> None:
        self._drift = drift
        self._rng = rng
        self._markov = drift.sd * rng.standard_normal(3)
        self._walk = np.zeros(3)
        self._knots = self._markov[None]
        self._absent = drift.sd == 0 and drift.walk == 0

    def at(self, t: Floats) -> Floats:
        """Drift (N, 3) u at any instants `t` (N,) s; before 0 it is as at 0."""
        wander = self._wander(t)
        if any(self._drift.trend):
            wander += np.maximum(t, 0.0)[:, None] * self._drift.trend
        return wander

    def _wander(self, t: Floats) -> Floats:
        """The part that is chance."""
        if self._absent or not len(t):
            return np.zeros((len(t), 3))
        place = np.maximum(t, 0.0) / self._drift.step_s
        left = place.astype(np.int64)
        while left.max() + 1 >= len(self._knots):
            self._extend()
        slope = np.diff(self._knots[: left.max() + 2], axis=0)
        return np.asarray(self._knots[left] + (place - left)[:, None] * slope[left])

    def _extend(self) -> None:
        noise = self._rng.standard_normal((_CHUNK, 2, 3))
        decay = np.exp(-self._drift.step_s / self._drift.time_s)
        push = self._drift.sd * np.sqrt(1 - decay**2) * noise[:, 0]
        markov, _ = lfilter([1.0], [1.0, -decay], push, axis=0, zi=decay * self._markov[None])
        walk = self._walk + np.cumsum(self._drift.walk * np.sqrt(self._drift.step_s) * noise[:, 1], axis=0)
        self._markov, self._walk = markov[-1], walk[-1]
        self._knots = np.vstack([self._knots, markov + walk])
