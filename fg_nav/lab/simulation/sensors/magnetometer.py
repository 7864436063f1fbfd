"""The magnetometers of a module: the iron they are carried in, each chip, and their average.

Iron that is carried along: how shoe, battery and board bend the field before any chip measures it.

    B' = S B + h

B (uT) is the field in the body frame without the iron, h (uT) the field of what is magnetized for good (hard
iron), S (3, 3) the bending by what B itself magnetizes (soft iron). All chips of a module sit in the same B': it
does not average away. S is drawn as identity plus a symmetric matrix whose spread is the same in all directions:
standard deviation s on its diagonal and s/sqrt(2) off it.

Ma Table 1 calibrates in the levelled plane of a standing foot: offsets (137.95, 75.26) mG, and an
ellipse whose long axis lies at eta = 0.973 rad from x and whose axes have the ratio tau = 0.896. Their correction
shrinks the long axis by tau, Ma (9)-(12), so what they correct is S = I + (1/tau - 1) u u^T, u = (cos eta, sin eta,
0), h = offsets (`ma_table_1`).

A three-axis magnetometer chip: when it has a new sample, and how it misreads the field around it.

    y = digits(K B'(t - lag) + o + n)

B' (uT) is the field at the chip, bent by the iron; K (3, 3) holds the chip's own scale and cross-axis errors, o (uT)
its own offset, n (uT) white noise.

A chip has its own rate. A row of the recording is fresh if a new sample was ready since the row before; in all
others there is none (NaN), or, as many loggers have it, the last one again (`held`). The phase between the two
rates is chance. A sample is the field `lag` before the row in which it shows: the middle of the time the chip
took to measure. The field is asked for at those instants, so that the lag is exact.

All chips of a sensor are read at once, in the iron they share, and averaged (`Compass`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.lab.simulation.sensors import checks
from fg_nav.lab.simulation.sensors.checks import IDENTITY, ZERO, Matrix, Triple
from fg_nav.lab.simulation.sensors.triad import digitize, draw_distortion


def average_units(values: list[Floats]) -> Floats:
    """Average arrays of one shape, adding up in place."""
    total = values[0].copy()
    for value in values[1:]:
        total += value
    total /= len(values)
    return total


MA_OFFSET_UT = (13.795, 7.526)  # Hard iron of Ma's Table 1, 2-D method, along the levelled x and y axes, uT.
MA_ETA_RAD = 0.973  # Direction of the ellipse's long axis of Ma's Table 1, from x towards y.
MA_TAU = 0.896  # Ratio of the ellipse's short axis to its long one of Ma's Table 1.


MAX_UT = 1e4  # More than a magnet against the case, and twice the range of any of these chips.

MAX_SOFT, MAX_SOFT_SD = 10.0, 0.5

MAX_HARD_SPREAD = 2.0  # One shoe in forty then carries fifty times the usual.


@dataclass(frozen=True)
class IronPrior:
    """What iron sensors of one kind carry; none by default, and exactly `hard_uT` and `soft` without spreads.

    Attributes
    ----------
    hard_uT, hard_sd_uT : h, expected (3,) and standard deviation about it per axis, uT.
    hard_spread : of the logarithm of a shoe's own `hard_sd_uT`: most carry little iron, some a magnet.
    soft, soft_sd : S, expected (3, 3) and spread s about it.

    Raises `SimulationError` if a spread is negative or anything is not a number or more than can be, naming the field.
    """

    hard_uT: Triple = ZERO
    hard_sd_uT: float = 0.0
    soft: Matrix = IDENTITY
    soft_sd: float = 0.0
    hard_spread: float = 0.0

    def __post_init__(self) -> None:
        checks.up_to(MAX_UT, self, "hard_sd_uT")
        checks.up_to(MAX_HARD_SPREAD, self, "hard_spread")
        checks.up_to(MAX_SOFT_SD, self, "soft_sd")
        checks.vector(self, "hard_uT", most=MAX_UT)
        checks.vector(self, "soft", (3, 3), most=MAX_SOFT)

    def draw(self, rng: np.random.Generator) -> Iron:
        """Draw the iron of one sensor."""
        drawn = self.hard_sd_uT * rng.standard_normal(3)
        any_matrix = rng.standard_normal((3, 3))
        if self.hard_spread:
            drawn *= np.exp(self.hard_spread * rng.standard_normal())
        hard = self.hard_uT + drawn
        return Iron(hard, self.soft + self.soft_sd * (any_matrix + any_matrix.T) / 2)


@dataclass(frozen=True)
class Iron:
    """Iron of one particular sensor: `hard_uT` h (3,) and `soft` S (3, 3)."""

    hard_uT: Floats
    soft: Floats

    def bend(self, body_field: Floats) -> Floats:
        """Field (N, 3) uT where the chips sit, from the field `body_field` (N, 3) uT without the iron."""
        return np.asarray(body_field @ self.soft.T + self.hard_uT)


def ma_table_1(level_R_body: Floats | None = None) -> IronPrior:
    """Make exactly the iron of Ma's Table 1.

    Parameters
    ----------
    level_R_body : (3, 3)
        From the body to the levelled axes of the standing foot (x forward, y as the body's seen from above, z up),
        in which the table holds; the body stands level if left out. There is no iron along the vertical.
    """
    body_R_level = np.eye(3) if level_R_body is None else level_R_body.T
    long_axis = body_R_level @ np.array([np.cos(MA_ETA_RAD), np.sin(MA_ETA_RAD), 0.0])
    soft = np.eye(3) + (1 / MA_TAU - 1) * np.outer(long_axis, long_axis)
    return make_iron(body_R_level @ np.array([*MA_OFFSET_UT, 0.0]), soft)


def make_iron(hard_uT: Floats, soft: Floats | None = None) -> IronPrior:
    """Make exactly this iron: `hard_uT` (3,) and `soft` (3, 3), the latter none if left out."""
    x, y, z = (float(value) for value in hard_uT)
    rows = np.eye(3) if soft is None else soft
    a, b, c = ((float(row[0]), float(row[1]), float(row[2])) for row in rows)
    return IronPrior(hard_uT=(x, y, z), soft=(a, b, c))


MAX_SPREAD = 0.5  # Of a matrix' elements; beyond that the axes are anywhere.

MAX_LAG_S = 0.2


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

    Raises `SimulationError` if a standard deviation is negative or anything is not a number or more than can be, naming
    the field.
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
        checks.up_to(MAX_UT, self, "noise_sd_uT", "offset_sd_uT", "resolution_uT")
        checks.up_to(MAX_SPREAD, self, "scale_sd", "cross_axis_sd")
        checks.up_to(MAX_LAG_S, self, "lag_s")

    def draw(self, rng: np.random.Generator) -> Magnetometer:
        """Draw one chip; takes the same number of draws whatever the parameters."""
        matrix = draw_distortion(self.scale_sd, self.cross_axis_sd, rng)
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
        return digitize(reading, self.prior.limit_uT, self.prior.resolution_uT)


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


BodyField: TypeAlias = Callable[[Floats], Floats]
"""The field (M, 3) uT in the body frame, without iron, at rising instants (M,) s."""


class Compass:
    """The magnetometers of all units during one walk: they are read at once."""

    def __init__(
        self,
        prior: MagnetometerPrior | None,
        chips: list[Magnetometer | None],
        iron: Iron,
        board_R_body: Floats,
        rng: np.random.Generator,
    ) -> None:
        self._prior = prior
        self._chips = [chip for chip in chips if chip is not None]
        self._iron, self._turn = iron, board_R_body.T
        ticks_rng, *self._rngs = rng.spawn(1 + len(self._chips))
        timing = prior or MagnetometerPrior()
        self._ticks, self._lag_s = Ticks(timing.rate_hz, ticks_rng), timing.lag_s
        self._last = np.full((1, 3), np.nan)

    def measure(self, t: Floats, body_field: BodyField | None) -> tuple[Floats | None, Bools | None]:
        """Readings (N, 3) uT of the next N rows and which (N,) are fresh.

        Raises `SimulationError` if the field is not a finite vector for every instant it is asked for.
        """
        if self._prior is None or body_field is None:
            return None, None
        fresh = self._ticks.fresh(t)
        reading = self._read(body_field, t[fresh] - self._lag_s)
        if self._prior.held:
            return self._repeated(reading, fresh), fresh
        mag = np.full((len(t), 3), np.nan)
        mag[fresh] = reading
        return mag, fresh

    def _read(self, body_field: BodyField, instants: Floats) -> Floats:
        """Readings (M, 3) uT of the samples taken at these instants (M,) s; a block may have none."""
        if not len(instants):
            return np.zeros((0, 3))
        field = body_field(instants)
        checks.rows("field", field, instants)
        bent = self._iron.bend(field @ self._turn)
        return average_units([chip.read(bent, rng) for chip, rng in zip(self._chips, self._rngs, strict=True)])

    def _repeated(self, reading: Floats, fresh: Bools) -> Floats:
        known = np.vstack([self._last, reading])
        self._last = known[-1:]
        return np.asarray(known[np.cumsum(fresh)])
