"""A three-axis magnetometer chip: when it has a new sample, and how it misreads the field around it.

    y = digits(K B'(t - lag) + o + n)

B' (uT) is the field at the chip, bent by the iron that is carried along (`fg_nav.lab.simulation.sensors.iron`); K
(3, 3) holds the chip's own scale and cross-axis errors, o (uT) its own offset, n (uT) white noise.

A chip has its own rate. A row of the recording is fresh if a new sample was ready since the row before; in all
others there is none (NaN), or, as many loggers have it, the last one again (`held`). The phase between the two
rates is chance. A sample is the field `lag` before the row in which it shows: the middle of the time the chip
took to measure. The field is asked for at those instants, so that the lag is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.lab.simulation.sensors import checks
from fg_nav.lab.simulation.sensors.triad import digitised, distortion

MOST_UT = 1e4
"""Twice the range of any of these chips."""

MOST_SPREAD = 0.5
"""Of a matrix' elements; beyond that the axes are anywhere."""

MOST_LAG_S = 0.2


@dataclass(frozen=True)
class MagnetometerPrior:
    """What chips of one make are like; a perfect one with a sample in every row by default.

    Attributes
    ----------
    rate_hz : samples a second; infinite for one in every row.
    noise_sd_uT : white noise of a sample, uT.
    offset_sd_uT : of the chip's own offset, uT per axis.
    scale_sd, cross_axis_sd : of the elements of K on and off the diagonal.
    lag_s : age of a fresh sample, s.
    limit_uT : end of the range, uT.
    resolution_uT : step of the converter, uT; 0 for none.
    held : rows without a new sample repeat the last one instead of having none.

    Raises
    ------
    SimulationError
        If a standard deviation is negative or anything is not a number or more than can be, naming the field.
    """

    rate_hz: float = np.inf
    noise_sd_uT: float = 0.0
    offset_sd_uT: float = 0.0
    scale_sd: float = 0.0
    cross_axis_sd: float = 0.0
    lag_s: float = 0.0
    limit_uT: float = np.inf
    resolution_uT: float = 0.0
    held: bool = False

    def __post_init__(self) -> None:
        checks.positive(self, "rate_hz", "limit_uT")
        checks.up_to(MOST_UT, self, "noise_sd_uT", "offset_sd_uT", "resolution_uT")
        checks.up_to(MOST_SPREAD, self, "scale_sd", "cross_axis_sd")
        checks.up_to(MOST_LAG_S, self, "lag_s")

    def draw(self, rng: np.random.Generator) -> Magnetometer:
        """Draw one chip; takes the same number of draws whatever the parameters."""
        matrix = distortion(self.scale_sd, self.cross_axis_sd, rng)
        return Magnetometer(self, matrix, self.offset_sd_uT * rng.standard_normal(3))


@dataclass(frozen=True)
class Magnetometer:
    """One particular chip: `matrix` K (3, 3) and `offset_uT` o (3,)."""

    prior: MagnetometerPrior
    matrix: Floats
    offset_uT: Floats

    def read(self, field: Floats, rng: np.random.Generator) -> Floats:
        """Readings (N, 3) uT of the next N fresh samples of the field (N, 3) uT at the chip."""
        noise = self.prior.noise_sd_uT * rng.standard_normal(field.shape)
        reading = np.asarray(field @ self.matrix.T + self.offset_uT + noise)
        return digitised(reading, self.prior.limit_uT, self.prior.resolution_uT)


class Ticks:
    """When there is a new sample: the chip's rate against the rows of the recording."""

    def __init__(self, rate_hz: float, rng: np.random.Generator) -> None:
        self._rate_hz = rate_hz
        self._phase = float(rng.uniform())
        self._last = -np.inf

    def fresh(self, t: Floats) -> Bools:
        """Mark the fresh ones (N,) of the next N rows at `t` (N,) s; the first row of all is one."""
        if not np.isfinite(self._rate_hz) or not len(t):
            return np.ones(len(t), dtype=np.bool_)
        tick = np.floor(t * self._rate_hz + self._phase)
        fresh = np.diff(tick, prepend=self._last) > 0
        self._last = float(tick[-1])
        return fresh
