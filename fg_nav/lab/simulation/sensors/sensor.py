"""The whole sensor: one unit or several averaged, the iron around them, and the clock of the logger.

A module of several units (Ma's has eight) averages their readings row by row. Every unit is simulated on its own,
with its own errors, range and steps, and the readings are averaged after: so white noise falls with the square
root of their number, the units' own errors do too, and a peak beyond the range is cut before it is averaged. What
all units share does not average away: the iron.

No result depends on how the walk is cut into blocks: every kind of noise has a stream of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from fg_nav.arrays import Floats, Ints
from fg_nav.lab.simulation.checks import Checked, Positive
from fg_nav.lab.simulation.sensors.clock import ClockPrior, ClockRun
from fg_nav.lab.simulation.sensors.magnetometer import (
    BodyField,
    Compass,
    Iron,
    IronPrior,
    Magnetometer,
    MagnetometerPrior,
    average_units,
)
from fg_nav.lab.simulation.sensors.triad import Triad, TriadPrior, TriadRun
from fg_nav.text import to_json


@dataclass(frozen=True)
class SensorPrior(Checked):
    """What sensors of one make are like, and so what an estimator may assume of one; perfect by default."""

    name: str  # Of the preset or the make.
    rate_hz: Positive  # Rows a second.
    gyr: TriadPrior = field(default_factory=TriadPrior)  # Gyroscopes (rad/s) and accelerometers (m/s^2) of a unit.
    acc: TriadPrior = field(default_factory=TriadPrior)
    mag: MagnetometerPrior | None = field(default_factory=MagnetometerPrior)  # Its magnetometer; None for none.
    iron: IronPrior = field(default_factory=IronPrior)  # That all units carry along.
    clock: ClockPrior = field(default_factory=ClockPrior)  # Of the logger.
    units: Annotated[int, Field(ge=1, le=256)] = 1  # How many are averaged.

    @property
    def period_s(self) -> float:
        """Distance of the rows in s."""
        return 1 / self.rate_hz

    def at_rate(self, rate_hz: float) -> SensorPrior:
        """Make the same sensor with another rate: its noise density stays, its noise per sample does not."""
        return replace(self, rate_hz=rate_hz)

    def with_iron(self, iron: IronPrior) -> SensorPrior:
        """Make the same sensor with exactly this iron: its chips add no offset or scale error of their own."""
        if self.mag is None:
            return replace(self, iron=iron)
        exact = replace(self.mag, offset_sd_uT=0.0, scale_sd=0.0, cross_axis_sd=0.0)
        return replace(self, iron=iron, mag=exact)

    def draw(self, rng: np.random.Generator) -> Sensor:
        """Draw one particular sensor."""
        iron, clock_scale_error = self.iron.draw(rng), self.clock.scale_sd * float(rng.standard_normal())
        units = []
        for _ in range(self.units):
            mag = None if self.mag is None else self.mag.draw(rng)
            units.append(Unit(self.gyr.draw(rng), self.acc.draw(rng), mag))
        return Sensor(self, tuple(units), iron, clock_scale_error)


@dataclass(frozen=True)
class Unit:
    """One chip of a module: gyroscopes, accelerometers and magnetometer."""

    gyr: Triad
    acc: Triad
    mag: Magnetometer | None

    def as_dict(self) -> dict[str, Any]:
        """What is particular about it, for JSON; its prior is written once."""
        gyr, acc, mag = self.gyr, self.acc, self.mag
        drawn = {"gyr_matrix": gyr.matrix, "g_sensitivity": gyr.g_sensitivity, "acc_matrix": acc.matrix}
        if mag is not None:
            drawn |= {"mag_matrix": mag.matrix, "mag_offset_uT": mag.offset_uT}
        return {name: to_json(value) for name, value in drawn.items()}


@dataclass(frozen=True)
class Sensor:
    """One particular sensor: what stays the same from walk to walk.

    `units`, `iron` and the scale error of the logger's clock as drawn.
    """

    prior: SensorPrior
    units: tuple[Unit, ...]
    iron: Iron
    clock_scale_error: float

    @property
    def effective(self) -> dict[str, Floats]:
        """What the averaged readings make of a rate, a specific force and a field.

        `gyr_matrix`, `acc_matrix` and `soft_iron` (3, 3), `g_sensitivity` (3, 3) of the rate, rad/s per m/s^2, and
        `hard_iron_uT` (3,), what they show without a field; iron and the chips' own errors together.
        """
        gyr, acc = [unit.gyr for unit in self.units], [unit.acc for unit in self.units]
        mag = [unit.mag for unit in self.units if unit.mag is not None]
        chips = average_units([chip.matrix for chip in mag]) if mag else np.eye(3)
        offset = average_units([chip.offset_uT for chip in mag]) if mag else 0.0
        return {
            "gyr_matrix": average_units([triad.matrix for triad in gyr]),
            "acc_matrix": average_units([triad.matrix for triad in acc]),
            "g_sensitivity": average_units([triad.g_sensitivity for triad in gyr]),
            "soft_iron": chips @ self.iron.soft,
            "hard_iron_uT": chips @ self.iron.hard_uT + offset,
        }

    def switch_on(self, rng: np.random.Generator) -> SensorRun:
        """Switch on for one walk; spawns all its streams from `rng`, a new set with every call."""
        return SensorRun(self, rng)

    def as_dict(self) -> dict[str, Any]:
        """All that was drawn, for JSON: effective values of the average first, then unit by unit."""
        return {
            "prior": to_json(self.prior),
            **to_json(self.effective),
            "clock_scale_error": self.clock_scale_error,
            "iron": to_json(self.iron),
            "units": [unit.as_dict() for unit in self.units],
        }


@dataclass(frozen=True)
class Samples:
    """The rows of one block that arrived, M of N."""

    t: Floats  # (M,) s, stamps: strictly increasing, on from the block before.
    taken: Floats  # (M,) s, what the logger's clock showed when they were taken: stamps without delay, for the truth.
    acc: Floats  # (M, 3) m/s^2, rad/s.
    gyr: Floats
    mag: Floats | None  # (M, 3) uT, NaN (or the last one, if held) without a new sample; None without a magnetometer.
    row: Ints  # (M,) which instants of the block they are, for the truth.

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True)
class BiasTruth:
    """True biases of the averaged readings: `t` (N,) s, `gyr` (N, 3) rad/s, `acc` (N, 3) m/s^2."""

    t: Floats
    gyr: Floats
    acc: Floats


class SensorRun:
    """A sensor during one walk, from t = 0 on."""

    def __init__(self, sensor: Sensor, rng: np.random.Generator) -> None:
        self.sensor = sensor
        rate_hz = sensor.prior.rate_hz
        clock_rng, field_rng, *unit_rngs = rng.spawn(2 + 2 * len(sensor.units))
        pairs = list(zip(sensor.units, unit_rngs[::2], unit_rngs[1::2], strict=True))
        self._gyr = [TriadRun(unit.gyr, gyr_rng, rate_hz) for unit, gyr_rng, _ in pairs]
        self._acc = [TriadRun(unit.acc, acc_rng, rate_hz) for unit, _, acc_rng in pairs]
        self._clock = ClockRun(sensor.prior.clock, sensor.clock_scale_error, clock_rng, rate_hz)
        self._compass = Compass(sensor.prior.mag, [unit.mag for unit in sensor.units], sensor.iron, field_rng)

    def measure(self, t: Floats, rate: Floats, force: Floats, body_field: BodyField | None = None) -> Samples:
        """Take the next N samples.

        `rate` and `force` (N, 3) in the body frame are the means over [t, t + period], `t` (N,) s from 0 on. The field
        is asked for once, if the block has samples of the magnetometer: (M, 3) uT in the body frame, without iron, at M
        rising instants, a lag before their rows and so maybe a little before t[0] or 0.
        """
        gyr = average_units([unit.measure(t, rate, force) for unit in self._gyr])
        acc = average_units([unit.measure(t, force) for unit in self._acc])
        mag = self._compass.measure(t, body_field)
        stamps, taken, row = self._clock.stamp(t)
        return Samples(stamps, taken, acc[row], gyr[row], None if mag is None else mag[row], row)

    def biases_at(self, t: Floats) -> BiasTruth:
        """True biases at any instants `t` (N,) s of the walk, turn-on and drift together."""
        return BiasTruth(t, *(average_units([unit.bias_at(t) for unit in units]) for units in (self._gyr, self._acc)))

    def as_dict(self) -> dict[str, Any]:
        """What was new on this walk, for JSON: turn-on biases of the average, and unit by unit."""
        gyr, acc = ([unit.turn_on_bias for unit in units] for units in (self._gyr, self._acc))
        return {
            "gyr_turn_on_bias_rad_s": to_json(average_units(gyr)),
            "acc_turn_on_bias_m_s2": to_json(average_units(acc)),
            "units": [{"gyr": to_json(g), "acc": to_json(a)} for g, a in zip(gyr, acc, strict=True)],
        }
