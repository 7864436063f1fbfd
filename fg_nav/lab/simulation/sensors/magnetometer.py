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

A three-axis chip misreads the field around it:

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
from typing import Annotated, TypeAlias

import numpy as np
from pydantic import Field

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.checks import Checked, Share
from fg_nav.lab.simulation.sensors.triad import Limit, digitize, draw_distortion


def average_units(values: list[Floats]) -> Floats:
    """Average arrays of one shape."""
    return np.asarray(np.mean(values, axis=0))


MA_OFFSET_UT = (13.795, 7.526)  # Hard iron of Ma's Table 1, 2-D method, along the levelled x and y axes, uT.
MA_ETA_RAD = 0.973  # Direction of the ellipse's long axis of Ma's Table 1, from x towards y.
MA_TAU = 0.896  # Ratio of the ellipse's short axis to its long one of Ma's Table 1.

MAX_UT = 1e4  # More than a magnet against the case, and twice the range of any of these chips.

Field_uT: TypeAlias = Annotated[float, Field(ge=-MAX_UT, le=MAX_UT)]
Error_uT: TypeAlias = Annotated[float, Field(ge=0.0, le=MAX_UT)]
Element: TypeAlias = Annotated[float, Field(ge=-10.0, le=10.0)]
Row: TypeAlias = tuple[Element, Element, Element]


@dataclass(frozen=True)
class IronPrior(Checked):
    """What iron sensors of one kind carry; none by default, and exactly `hard_uT` and `soft` without spreads.

    Attributes
    ----------
    hard_uT, hard_sd_uT : h, expected (3,) and standard deviation about it per axis, uT.
    hard_spread : of the logarithm of a shoe's own `hard_sd_uT`: most carry little iron, some a magnet.
    soft, soft_sd : S, expected (3, 3) and spread s about it.
    """

    hard_uT: tuple[Field_uT, Field_uT, Field_uT] = (0.0, 0.0, 0.0)
    hard_sd_uT: Error_uT = 0.0
    soft: tuple[Row, Row, Row] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    soft_sd: Share = 0.0
    hard_spread: Annotated[float, Field(ge=0.0, le=2.0)] = 0.0

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


def ma_table_1(level_R_body: Floats | None = None) -> IronPrior:
    """Make exactly the iron of Ma's Table 1; there is none along the vertical.

    It holds in the levelled axes of the standing foot (x forward, y as the body's seen from above, z up), to which
    `level_R_body` (3, 3) turns the body's; the body stands level if left out.
    """
    body_R_level = np.eye(3) if level_R_body is None else level_R_body.T
    long_axis = body_R_level @ np.array([np.cos(MA_ETA_RAD), np.sin(MA_ETA_RAD), 0.0])
    soft = np.eye(3) + (1 / MA_TAU - 1) * np.outer(long_axis, long_axis)
    return make_iron(body_R_level @ np.array([*MA_OFFSET_UT, 0.0]), soft)


def make_iron(hard_uT: Floats, soft: Floats | None = None) -> IronPrior:
    """Make exactly this iron: `hard_uT` (3,) and `soft` (3, 3), the latter none if left out."""
    x, y, z = map(float, hard_uT)
    a, b, c = ((float(i), float(j), float(k)) for i, j, k in (np.eye(3) if soft is None else soft))
    return IronPrior(hard_uT=(x, y, z), soft=(a, b, c))


@dataclass(frozen=True)
class MagnetometerPrior(Checked):
    """What chips of one make are like; a perfect one with a sample in every row by default."""

    rate_hz: Limit = np.inf  # Samples a second; infinite for one in every row.
    noise_sd_uT: Error_uT = 0.0  # White noise of a sample, uT.
    offset_sd_uT: Error_uT = 0.0  # Of the chip's own offset, uT per axis.
    scale_sd: Share = 0.0  # Of the elements of K on and off the diagonal.
    cross_axis_sd: Share = 0.0
    lag_s: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0  # Age of a fresh sample, s.
    limit_uT: Limit = np.inf  # End of the range, uT.
    resolution_uT: Error_uT = 0.0  # Step of the converter, uT; 0 for none.
    held: bool = False  # Rows without a new sample repeat the last one instead of having none.

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


BodyField: TypeAlias = Callable[[Floats], Floats]
"""The field (M, 3) uT in the body frame, without iron, at rising instants (M,) s."""


class Compass:
    """The magnetometers of all units during one walk: they are read at once."""

    def __init__(
        self,
        prior: MagnetometerPrior | None,
        chips: list[Magnetometer | None],
        iron: Iron,
        rng: np.random.Generator,
    ) -> None:
        self._prior = prior
        self._chips = [chip for chip in chips if chip is not None]
        self._iron = iron
        ticks_rng, *self._rngs = rng.spawn(1 + len(self._chips))
        self._phase, self._tick = float(ticks_rng.uniform()), -np.inf
        self._last = np.full((1, 3), np.nan)

    def measure(self, t: Floats, body_field: BodyField | None) -> Floats | None:
        """Readings (N, 3) uT of the next N rows."""
        if self._prior is None or body_field is None:
            return None
        fresh = np.ones(len(t), dtype=np.bool_)
        if np.isfinite(self._prior.rate_hz) and len(t):
            tick = np.floor(t * self._prior.rate_hz + self._phase)
            fresh = np.diff(tick, prepend=self._tick) > 0
            self._tick = float(tick[-1])
        reading = self._read(body_field, t[fresh] - self._prior.lag_s)
        if self._prior.held:
            known = np.vstack([self._last, reading])
            self._last = known[-1:]
            return np.asarray(known[np.cumsum(fresh)])
        mag = np.full((len(t), 3), np.nan)
        mag[fresh] = reading
        return mag

    def _read(self, body_field: BodyField, instants: Floats) -> Floats:
        """Readings (M, 3) uT of the samples taken at these instants (M,) s; a block may have none."""
        if not len(instants):
            return np.zeros((0, 3))
        bent = body_field(instants) @ self._iron.soft.T + self._iron.hard_uT
        return average_units([chip.read(bent, rng) for chip, rng in zip(self._chips, self._rngs, strict=True)])
