"""Three gyroscopes or three accelerometers: their errors of a rate or a specific force, and how their biases drift.

    y = digits(M x + G f + b + d(t) + n),    with M = I and G = 0 that is MD (17)

====== ===== ===========================================================================================
x      u     (3,) what is to be measured along the body's axes: rate (rad/s) or specific force (m/s^2)
M      1     (3, 3) identity plus scale errors on and cross-axis errors off the diagonal: fixed for a unit
G      u s^2/m (3, 3) g-sensitivity of a gyroscope, f the specific force: fixed for a unit
b      u     (3,) turn-on bias: new whenever the unit is switched on
d(t)   u     (3,) drift (below)
n      u     (3,) white noise, standard deviation N sqrt(f_s) a sample at the rate f_s (Hz)
digits       the end of the range, then the steps of the converter (`digitize`)
====== ===== ===========================================================================================

u is the unit of the triad. The noise density N (u/sqrt(Hz)) is the one estimators use: two-sided, the Allan
deviation at 1 s, the angle or velocity random walk. A data sheet's is one-sided and sqrt(2) times as large.

Six free off-diagonal elements of M hold both the turn of the triad against the body and its axes' skewness.

Drift is the slow part of a bias while the sensor is on: two processes and a trend, independent per axis, in the unit u:

    x_(k+1) = c x_k + s sqrt(1 - c^2) n_k,    c = exp(-d / T)     first-order Gauss-Markov, that is AR(1)
    w_(k+1) = w_k + q sqrt(d) n'_k                                random walk
    m t                                                           trend, of a sensor that warms up

d is the distance of knots (s), s the standard deviation of x at any time (u), T its correlation time (s),
q the density of the walk (u/sqrt(s)). x starts anywhere in its distribution, w at 0. Between knots, a
twentieth of T apart or a second, the drift is a straight line: it is slow, what is fast is white noise. So it
is a function of time, defined at any instant, whatever the rate.

MD writes the AR(1) with a driving noise of B/sqrt(tau) a sample, MD (24), tau = t_B f_s samples, MD (25), and
c = exp(-1/tau), MD (10), (11), B and t_B the lowest Allan deviation and where it lies. Hence
s = B/sqrt(2) for any rate worth the name, T = t_B. The Allan deviation of such a
process has its hump, 0.62 s, at 1.9 T: it is 0.44 B.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, TypeAlias

import numpy as np
from pydantic import Field
from scipy.signal import lfilter

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.checks import Checked, NotNegative, Share

KNOTS_PER_TIME = 20.0
"""Knots in a correlation time: half-way between two of them the variance is 2.5 per cent too small."""

MAX_STEP_S = 1.0  # Knots are no further apart than this, however slow the drift.
MIN_TIME_S = 1.0  # What is forgotten faster is noise.
MAX_ERROR = 1e3  # No error of a gyroscope (rad/s) or an accelerometer (m/s^2) is larger: a few times any range.
_CHUNK = 1024  # Knots are drawn this many at a time, so that the path does not depend on how far it is asked for.


Error: TypeAlias = Annotated[float, Field(ge=0.0, le=MAX_ERROR)]
Offset: TypeAlias = Annotated[float, Field(ge=-MAX_ERROR, le=MAX_ERROR)]
Offsets: TypeAlias = tuple[Offset, Offset, Offset]
Limit: TypeAlias = Annotated[float, Field(gt=0.0)]


@dataclass(frozen=True)
class Drift(Checked):
    """How the bias of a triad wanders; none by default."""

    sd: Error = 0.0  # Of the Gauss-Markov part at any time, u.
    time_s: Annotated[float, Field(ge=MIN_TIME_S, allow_inf_nan=False)] = 100.0  # Its correlation time, s.
    walk: Error = 0.0  # Density of the random walk, u/sqrt(s): after t seconds its standard deviation is walk sqrt(t).
    trend: Offsets = (0.0, 0.0, 0.0)  # m (3,), steady change per axis since t = 0, u/s.

    @property
    def step_s(self) -> float:
        """Distance of the knots, s."""
        return min(MAX_STEP_S, self.time_s / KNOTS_PER_TIME)


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
        trend = np.maximum(t, 0.0)[:, None] * self._drift.trend
        if self._absent or not len(t):
            return trend
        place = np.maximum(t, 0.0) / self._drift.step_s
        left = place.astype(np.int64)
        while left.max() + 1 >= len(self._knots):
            self._extend()
        slope = np.diff(self._knots[: left.max() + 2], axis=0)
        return np.asarray(trend + self._knots[left] + (place - left)[:, None] * slope[left])

    def _extend(self) -> None:
        noise = self._rng.standard_normal((_CHUNK, 2, 3))
        decay = np.exp(-self._drift.step_s / self._drift.time_s)
        push = self._drift.sd * np.sqrt(1 - decay**2) * noise[:, 0]
        markov, _ = lfilter([1.0], [1.0, -decay], push, axis=0, zi=decay * self._markov[None])
        walk = self._walk + np.cumsum(self._drift.walk * np.sqrt(self._drift.step_s) * noise[:, 1], axis=0)
        self._markov, self._walk = markov[-1], walk[-1]
        self._knots = np.vstack([self._knots, markov + walk])


@dataclass(frozen=True)
class TriadPrior(Checked):
    """What triads of one make are like; a perfect one by default. u is rad/s or m/s^2."""

    noise_density: Error = 0.0  # N, u/sqrt(Hz), two-sided.
    bias: Offsets = (0.0, 0.0, 0.0)  # Turn-on bias, expected (3,) and standard deviation about it per axis, u.
    bias_sd: Error = 0.0
    drift: Drift = field(default_factory=Drift)  # Of the bias.
    scale_sd: Share = 0.0  # Standard deviations of M's elements on and off the diagonal.
    cross_axis_sd: Share = 0.0
    g_sensitivity_sd: Error = 0.0  # Standard deviation of G's elements, u per m/s^2.
    limit: Limit = np.inf  # End of the range, u.
    resolution: NotNegative = 0.0  # Step of the converter, u; 0 for none.

    def draw(self, rng: np.random.Generator) -> Triad:
        """Draw one unit's triad; takes the same number of draws whatever the parameters."""
        matrix = draw_distortion(self.scale_sd, self.cross_axis_sd, rng)
        return Triad(self, matrix, self.g_sensitivity_sd * rng.standard_normal((3, 3)))


@dataclass(frozen=True)
class Triad:
    """One particular triad. `matrix` M (3, 3) and `g_sensitivity` G (3, 3) stay the same from walk to walk."""

    prior: TriadPrior
    matrix: Floats
    g_sensitivity: Floats


class TriadRun:
    """A triad while it is on. `turn_on_bias` (3,) u stays, the drift is on top of it."""

    def __init__(self, triad: Triad, rng: np.random.Generator, rate_hz: float) -> None:
        self.triad = triad
        self.turn_on_bias = triad.prior.bias + triad.prior.bias_sd * rng.standard_normal(3)
        drift_rng, self._rng = rng.spawn(2)
        self._drift = DriftPath(triad.prior.drift, drift_rng)
        self._noise_sd = triad.prior.noise_density * float(np.sqrt(rate_hz))

    def bias_at(self, t: Floats) -> Floats:
        """True bias (N, 3) u at any instants `t` (N,) s."""
        return np.asarray(self.turn_on_bias + self._drift.at(t))

    def measure(self, t: Floats, true: Floats, force: Floats | None = None) -> Floats:
        """Readings (N, 3) u of the next N samples at `t` (N,) s; gyroscopes feel `force` (N, 3) m/s^2 too."""
        reading = true @ self.triad.matrix.T + self.bias_at(t)
        if force is not None and self.triad.prior.g_sensitivity_sd:
            reading += force @ self.triad.g_sensitivity.T
        if self._noise_sd:
            reading += self._noise_sd * self._rng.standard_normal(reading.shape)
        return digitize(reading, self.triad.prior.limit, self.triad.prior.resolution)


def draw_distortion(scale_sd: float, cross_axis_sd: float, rng: np.random.Generator) -> Floats:
    """Draw a matrix M (3, 3): identity plus errors of these standard deviations on and off the diagonal."""
    spread = np.where(np.eye(3, dtype=np.bool_), scale_sd, cross_axis_sd)
    return np.asarray(np.eye(3) + spread * rng.standard_normal((3, 3)))


def digitize(reading: Floats, limit: float, resolution: float) -> Floats:
    """Clip readings (N, 3) at the ends of the range, then round to steps of the converter; changes `reading`."""
    if np.isfinite(limit):
        np.clip(reading, -limit, limit, out=reading)
    if resolution:
        reading /= resolution
        np.rint(reading, out=reading)
        reading *= resolution
    return reading
