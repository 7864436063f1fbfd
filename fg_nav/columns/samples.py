"""Columns of numbers become samples in SI; what their names do not say is judged by physics, and said.

====== ==========================================================================================
time   of the units s, ms, us and ns one makes the rate that of an inertial sensor
acc    at rest it is gravity: 9.8 m/s^2, 1 g or 1000 mg
gyr    above 40 it is no rad/s, below 17 on a walk no deg/s; gravity turns as it says; else the user says it
mag    a field on Earth is 5 to 200 uT; one whose unit is not clear is left out
air    its pressure is 300 to 1200 hPa; one that is nowhere is left out
====== ==========================================================================================

Without stamps a counter, or else the rows, give the time by the rate that the user says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.choice import Asker, write_mapping
from fg_nav.columns.mapping import Channel, ColumnMap
from fg_nav.columns.units import KNOWN_UNITS, Quantity, find_factor
from fg_nav.errors import FormatError
from fg_nav.samples import plausibility

SI_UNITS: dict[Quantity, str] = {"time": "s", "acc": "m/s^2", "gyr": "rad/s", "mag": "uT", "pressure": "Pa"}
"""Words of the units of `Samples`."""

_COUNTS_AT_REST = 1500.0
"""A larger reading of gravity is no mg: it counts the steps of a converter."""

_COUNTER_ENDS = (2.0**8, 2.0**16, 2.0**32)
"""Counters of packets begin again at one of these."""


@dataclass(frozen=True)
class Samples:
    """Samples in SI: t (N,) s, acc (N, 3) m/s^2, gyr (N, 3) rad/s; mag (N, 3) uT, pressure (N,) Pa or None; `notes`."""

    t: Floats
    acc: Floats
    gyr: Floats
    mag: Floats | None
    notes: tuple[str, ...] = ()
    pressure: Floats | None = None


def list_positions(columns: ColumnMap) -> list[int]:
    """Positions (K,) in a table of the columns that `convert_samples` takes, in its order."""
    channels = (columns.time or columns.counter, columns.acc, columns.gyr, columns.mag, columns.pressure)
    return [position for channel in channels if channel is not None for position in channel.positions]


def convert_samples(values: Floats, columns: ColumnMap, rate_hz: float | None, asker: Asker) -> Samples:
    """Convert the columns of `list_positions`, (N, K), to SI.

    Raises `FormatError` if there is neither time nor rate, or a unit that nothing shows.
    """
    notes: list[str] = []
    clock = 0 if columns.time is None and columns.counter is None else 1
    t = _make_time(values[:, :clock], columns, rate_hz, asker, notes)
    period_s = plausibility.median_period_s(t)
    acc, gyr = values[:, clock : clock + 3], values[:, clock + 3 : clock + 6]
    unit = columns.acc.unit or _judge_acc(acc, period_s, columns, asker, notes)
    acc = _scale(acc, "acc", columns.acc, unit, asker)
    unit = columns.gyr.unit or _judge_gyr(acc, gyr, period_s, columns, asker, notes)
    gyr = _scale(gyr, "gyr", columns.gyr, unit, asker)
    field = values[:, clock + 6 : clock + 9]
    mag = None if columns.mag is None else _convert_mag(field, columns, columns.mag, asker, notes)
    air = columns.pressure
    pressure = None if air is None else convert_pressure(values[:, -1], air, asker.name, notes)
    return Samples(t, acc, gyr, mag, (*columns.notes, *notes), pressure)


def convert_pressure(values: Floats, channel: Channel, name: str, notes: list[str]) -> Floats | None:
    """Return pressures (N,) in Pa, NaN where they are none of air; None where they are nowhere, with a note.

    Without a unit in the name of the column the median says it, of Pa, hPa and kPa.
    """
    factors = [
        find_factor("pressure", unit) or 1.0 for unit in ([channel.unit] if channel.unit else ("Pa", "hPa", "kPa"))
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = [plausibility.keep_air(values * factor) for factor in factors]
    counts = [0 if one is None else int(np.isfinite(one).sum()) for one in scaled]
    if max(counts) > 0:
        return scaled[int(np.argmax(counts))]
    if not np.isfinite(values).any():
        return None
    median = float(np.nanmedian(values))
    unit = f" {channel.unit}" if channel.unit else ""
    notes.append(f"'{channel.names[0]}' reads {median:.6g}{unit} in the median, which is no pressure of air: left out")
    return None


def _scale(values: Floats, quantity: Quantity, channel: Channel, unit: str, asker: Asker) -> Floats:
    factor = find_factor(quantity, unit)
    if factor is None:
        raise FormatError(
            f"{asker.name}: column '{channel.names[0]}' has the unit '{unit}', which is not known: "
            f"write one of {KNOWN_UNITS[quantity]}."
        )
    with np.errstate(over="ignore", invalid="ignore"):  # nonsense numbers are found as such later
        return np.ascontiguousarray(values * factor)


def _make_time(clock: Floats, columns: ColumnMap, rate_hz: float | None, asker: Asker, notes: list[str]) -> Floats:
    if rate_hz is not None and not 0.0 < rate_hz < np.inf:
        raise FormatError(f"a rate of {rate_hz:g} Hz is none: give samples a second.")
    if columns.time is not None:
        if rate_hz is not None:
            raise FormatError(
                f"{asker.name} has stamps, '{columns.time.names[0]}': leave the rate out, or name the columns to use "
                f"without time."
            )
        return _convert_time(clock[:, 0], columns, columns.time, asker, notes)
    if rate_hz is None:
        counted = f" but '{columns.counter.names[0]}', which counts samples" if columns.counter else ""
        raise FormatError(f"{asker.name} has no stamps{counted}: give its rate, such as {asker.rate}.")
    if columns.counter is not None and _counts_samples(count := _continue_counter(clock[:, 0])):
        notes.append(f"time is '{columns.counter.names[0]}' at {rate_hz:g} Hz")
        return np.asarray((count - float(count[np.isfinite(count)][0])) / rate_hz)
    notes.append(f"time is the number of the row at {rate_hz:g} Hz")
    return np.arange(len(clock)) / rate_hz


def _continue_counter(count: Floats) -> Floats:
    """Counter (N,) set on where it falls from the end of the fewest bits that hold it to its beginning."""
    known = np.isfinite(count)
    largest = float(count[known].max(initial=0.0))
    end = next((end for end in _COUNTER_ENDS if largest < end), np.inf)
    if not (np.diff(count[known]) < -0.5 * end).any():
        return count
    whole = count.copy()
    whole[known] = np.unwrap(count[known], period=end)
    return whole


def _counts_samples(count: Floats) -> bool:
    """Whether numbers (N,) rise by ones, but where samples are lost."""
    step = np.diff(count[np.isfinite(count)])
    return bool(step.size) and float(np.median(step)) == 1.0 and bool((step >= 0).all())


def _convert_time(t: Floats, columns: ColumnMap, channel: Channel, asker: Asker, notes: list[str]) -> Floats:
    unit = channel.unit if channel.unit and find_factor("time", channel.unit) is not None else None
    if unit is None:
        finite = t[np.isfinite(t)]
        if _counts_samples(finite) and (finite == np.round(finite)).all():
            raise FormatError(
                f"{asker.name}: column '{channel.names[0]}' rises by ones and names no unit, so it counts samples or "
                f"is in ms: say {asker.ask(write_mapping(columns, time='ms', acc='m/s^2', gyr='deg/s'))}, or name the "
                f"columns without time and give {asker.rate}."
            )
        period = plausibility.median_period_s(t)
        unit = plausibility.find_time_unit(period)
        if unit is None:
            raise FormatError(
                f"{asker.name}: column '{channel.names[0]}' steps by {period:.6g} and names no unit, and in none of s, "
                f"ms, us and ns is that a sensor's rate: say it, as "
                f"{asker.ask(write_mapping(columns, time='ms', acc='m/s^2', gyr='deg/s'))}."
            )
        if unit != "s":
            notes.append(f"the stamps '{channel.names[0]}' are taken for {unit}, by their step of {period:.6g}")
    return _scale(t, "time", channel, unit, asker)


def _judge_acc(acc: Floats, period_s: float, columns: ColumnMap, asker: Asker, notes: list[str]) -> str:
    """Find the unit of acc (N, 3) by its norm at rest."""
    rest = plausibility.measure_rest_acc(acc, period_s)
    unit = plausibility.find_acc_unit(acc, period_s)
    if unit in ("m/s^2", "g", "mg"):
        notes.append(f"acc is taken for {unit}, by its {rest:.4g} at rest")
        return unit
    if rest > _COUNTS_AT_REST:
        full = f"1/{2 ** round(np.log2(rest))} g"
        raise FormatError(
            f"{asker.name}: acc is {rest:.5g} at rest, so it counts steps of a converter: say how much one is, as "
            f"{asker.ask(write_mapping(columns, time='s', acc=full, gyr='1/16.4 deg/s'))}."
        )
    problem = plausibility.find_acc_problem(acc, period_s)
    if problem is None or "removed" not in problem:
        problem = f"acc is {rest:.4g} at rest and names no unit: say it, as " + asker.ask(
            write_mapping(columns, time="s", acc="g", gyr="deg/s")
        )
    raise FormatError(f"{asker.name}: {problem}.")


def _judge_gyr(acc: Floats, gyr: Floats, period_s: float, columns: ColumnMap, asker: Asker, notes: list[str]) -> str:
    """Find the unit of gyr (N, 3) where physics decides it; `acc` (N, 3) is in m/s^2."""
    unit = plausibility.find_gyr_unit(acc, gyr, period_s)
    finite = np.abs(gyr[np.isfinite(gyr).all(axis=1)])
    peak = float(finite.max()) if finite.size else np.nan
    if unit is not None:
        notes.append(f"gyr is taken for {unit}, by its peak of {peak:.4g} next to acc")
        return unit
    words = asker.ask(write_mapping(columns, gyr="deg/s"))
    raise FormatError(
        f"{asker.name}: gyr ('{columns.gyr.names[0]}' ..., peak {peak:.4g}) names no unit, and its samples show none: "
        f"say {words} if it is in deg/s, else [rad/s] in its place."
    )


def _convert_mag(mag: Floats, columns: ColumnMap, channel: Channel, asker: Asker, notes: list[str]) -> Floats | None:
    """Return the magnetometer in uT; None, with a note, where its unit is arbitrary or not clear."""
    unit = channel.unit
    if unit is None:
        unit = plausibility.find_mag_unit(mag)
        if unit is None:
            strength = plausibility.measure_field_strength(mag)
            median = float(np.nanmedian(strength)) if np.isfinite(strength).any() else np.nan
            notes.append(
                f"the magnetometer names no unit, and its strength of {median:.4g} shows none: left out; "
                f"--columns mag=...[{KNOWN_UNITS['mag'].split(',')[0]}] says it"
            )
            return None
        notes.append(f"mag is taken for {unit}, by its strength")
    scaled = _scale(mag, "mag", channel, unit, asker)
    if find_factor("mag", unit) is not None and np.isnan(find_factor("mag", unit) or 0.0):
        notes.append("the magnetometer is in arbitrary units and was left out")
        return None
    return scaled
