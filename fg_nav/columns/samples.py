"""Columns of numbers become samples in SI; what their names do not say is judged by physics (docs/formats.md).

Units of the user's own arrays and data frames are a list, `"ms, g, deg/s"`, of which each says its quantity, or by
quantity, `{"acc": "g"}`. Arrays without one are in s, m/s^2, rad/s and uT.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fg_nav.arrays import Floats
from fg_nav.columns.headers import KNOWN_UNITS, Quantity, find_factor, find_scale
from fg_nav.columns.mapping import (
    QUANTITIES,
    Channel,
    ColumnMap,
    Columns,
    Hints,
    check_unit,
    choose_columns,
    parse_columns,
    parse_units,
    write_mapping,
)
from fg_nav.errors import FormatError, RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.samples import plausibility

if TYPE_CHECKING:
    import pandas as pd

Units: TypeAlias = str | Mapping[Quantity, str] | None  # Words for the units: a list with commas, or one a quantity.

ColumnNames: TypeAlias = str | Mapping[Quantity, str | Sequence[str]] | None
"""A mapping as of `--columns`, or the names by quantity."""

SI_UNITS: dict[Quantity, str] = {"time": "s", "acc": "m/s^2", "gyr": "rad/s", "mag": "uT", "pressure": "Pa"}
"""Words of the units of `Samples`."""

_COUNTS_AT_REST = 1500.0  # A larger reading of gravity is no mg: it counts the steps of a converter.
_COARSE_SHARE = 0.4  # Of the steps between stamps, that are none: a clock that is coarser than the rate.
_DATES_S = (9e8, 4e9)  # Seconds since 1970, of this century.
_COUNTER_ENDS = (2.0**8, 2.0**16, 2.0**32)  # Counters of packets begin again at one of these.


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


@np.errstate(over="ignore", invalid="ignore")  # nonsense numbers are found as such later
def convert_samples(values: Floats, columns: ColumnMap, rate_hz: float | None, hints: Hints) -> Samples:
    """Return SI samples from `values` (N, K), the columns in the order of `list_positions`."""
    notes: list[str] = []
    parts = (columns.time or columns.counter, columns.acc, columns.gyr, columns.mag)
    ends = np.cumsum([len(part.positions) if part else 0 for part in parts])
    clock, acc, gyr, mag, air = np.split(values, ends, axis=1)
    acc, gyr, time, period_s = columns.acc.add(acc), columns.gyr.add(gyr), columns.time, np.nan
    if time is not None and len(time.factors) > 1:  # seconds and a part of them, which may be a whole clock by itself
        whole, part = clock[:, :1], clock[:, 1:] * time.factors[1]
        clock = whole + part if np.nanmax(np.abs(part), initial=0.0) <= 1.0 else part
    if time is not None:
        period_s = plausibility.median_period_s(clock) * (find_factor("time", time.unit or "") or np.nan)
    unit = columns.acc.unit or _judge_acc(acc, gyr, period_s, columns, hints, notes)
    acc = _scale(acc, "acc", columns.acc, unit, hints)
    if len(columns.acc.factors) > 1:
        sign = np.sign(columns.acc.factors[0])
        if find_factor("acc", unit) == GRAVITY_M_S2 and sign > 0:  # in g it is Apple's too
            acc, sign = -acc, -1.0
        notes.append(f"acc is {'-' if sign < 0 else ''}({columns.acc.names[0]} + {columns.acc.names[3]})")
        notes[-1] += ", as an iPhone has the sign turned" if sign < 0 else ""
    t = _make_time(clock, acc, gyr, columns, rate_hz, hints, notes)
    period_s = plausibility.median_period_s(t)
    # unit of the rate, where physics decides it
    said, judged = columns.gyr.unit, None if columns.gyr.unit else plausibility.find_gyr_unit(acc, gyr, period_s)
    if not said:
        peak = float(np.abs(gyr[np.isfinite(gyr).all(axis=1)]).max(initial=-1.0))
        peak = peak if peak >= 0.0 else np.nan
        if judged is None:
            words = f"gyr ('{columns.gyr.names[0]}' ..., peak {peak:.4g}) names no unit, and its samples show none"
            units = "deg/s, rad/s, mdeg/s or as 1/16.4 deg/s"
            raise hints.ask(f": {words}: say it ({units})", write_mapping(columns, gyr="UNIT"))
        notes.append(f"gyr is taken for {judged}, by its peak of {peak:.4g} next to acc")
    gyr = _scale(gyr, "gyr", columns.gyr, said or judged or "", hints)
    field = None if columns.mag is None else _convert_mag(mag, columns.mag, hints, notes)
    channel = columns.pressure
    pressure = None if channel is None else convert_pressure(air[:, 0], channel, notes)
    return Samples(t, acc, gyr, field, (*columns.notes, *notes), pressure)


def convert_pressure(values: Floats, channel: Channel, notes: list[str]) -> Floats | None:
    """Return pressures (N,) in Pa, NaN where implausible for air; None, with a note, if all are.

    Without a unit in its name the column is in Pa, hPa or kPa by its magnitude.
    """
    units = [channel.unit] if channel.unit else ["Pa", "hPa", "kPa"]
    factors = [find_factor("pressure", unit) or 1.0 for unit in units]
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


def _scale(values: Floats, quantity: Quantity, channel: Channel, unit: str, hints: Hints) -> Floats:
    factor = find_scale(quantity, unit, channel.names[0], hints.name)
    return np.ascontiguousarray(values * factor)


def _make_time(
    clock: Floats, acc: Floats, gyr: Floats, columns: ColumnMap, rate_hz: float | None, hints: Hints, notes: list[str]
) -> Floats:
    if rate_hz is not None and not 0.0 < rate_hz < np.inf:
        raise FormatError(f"a rate of {rate_hz:g} Hz is none: give samples a second.")
    if columns.time is not None:
        if rate_hz is not None:
            words = f"{hints.name} has stamps, '{columns.time.names[0]}'"
            raise FormatError(f"{words}: leave the rate out, or name the columns to use without time.")
        return _convert_time(clock[:, 0], acc, gyr, columns, columns.time, hints, notes)
    if rate_hz is None:
        counted = f" but '{columns.counter.names[0]}', which counts samples" if columns.counter else ""
        raise FormatError(f"{hints.name} has no stamps{counted}: give its rate, such as {hints.rate}.")
    if columns.counter is not None:
        count = clock[:, 0].copy()
        known = np.isfinite(count)
        largest = float(count[known].max(initial=0.0))
        end = next((end for end in _COUNTER_ENDS if largest < end), np.inf)
        if (np.diff(count[known]) < -0.5 * end).any():  # from the end of the fewest bits that hold it to its beginning
            count[known] = np.unwrap(count[known], period=end)
        if _counts_samples(count):
            notes.append(f"time is '{columns.counter.names[0]}' at {rate_hz:g} Hz")
            return np.asarray((count - float(count[known][0])) / rate_hz)
    notes.append(f"time is the number of the row at {rate_hz:g} Hz")
    return np.arange(len(clock)) / rate_hz


def _counts_samples(count: Floats) -> bool:
    """Whether numbers (N,) rise by ones, but where samples are lost."""
    step = np.diff(count[np.isfinite(count)])
    return bool(step.size) and float(np.median(step)) == 1.0 and bool((step >= 0).all())


def _convert_time(
    t: Floats, acc: Floats, gyr: Floats, columns: ColumnMap, channel: Channel, hints: Hints, notes: list[str]
) -> Floats:
    # periods, s, by which gravity turns as the gyroscope says, in its unit or in each that it can have; or by gait
    factor = None if columns.gyr.unit is None else find_factor("gyr", columns.gyr.unit)
    if factor is None and np.nanmax(np.abs(gyr), initial=0.0) > plausibility.TOO_FAST_RAD_S:
        factor = np.pi / 180.0
    period_s = plausibility.measure_turning_period(acc, gyr)
    turning_s = tuple(period_s / one for one in ((factor,) if factor else (1.0, np.pi / 180.0)))
    if np.isnan(period_s):
        turning_s = (plausibility.measure_gait_period(gyr),)
    # unit
    unit = channel.unit if channel.unit and find_factor("time", channel.unit) is not None else None
    finite = t[np.isfinite(t)]
    steps = np.diff(finite)
    is_coarse = len(steps) > 0 and np.count_nonzero(steps == 0) >= _COARSE_SHARE * len(steps)
    period = float(np.ptp(finite)) / len(steps) if is_coarse else plausibility.median_period_s(t)
    if unit is None:
        fitting = {plausibility.find_time_unit(period, one) for one in turning_s} - {None}
        if not fitting and columns.gyr.unit is None:  # the gyroscope may be in any unit
            fitting = {plausibility.find_time_unit(period)} - {None}
        found = fitting & {"s", "ms", "us", "ns"} or fitting
        is_date = is_coarse and _DATES_S[0] < float(np.median(finite)) < _DATES_S[1]
        unit = "s" if is_date else found.pop() if len(found) == 1 else None
        counts = _counts_samples(finite) and bool((finite == np.round(finite)).all())
        if unit is None or (counts and (np.isnan(turning_s[0]) or unit not in ("s", "ms", "us", "ns"))):
            how = "rises by ones" if counts else f"steps by {period:.6g}"
            words = f"column '{channel.names[0]}' {how} and names no unit, and its samples show none"
            otherwise = f", or name the columns without time, if it counts samples, and give {hints.rate}"
            raise hints.ask(f": {words}: say it", write_mapping(columns, time="UNIT"), otherwise)
        if unit != "s":
            shown = "by their step" if np.isnan(turning_s[0]) else "as gravity turns and by their step"
            notes.append(f"the stamps '{channel.names[0]}' are taken for {unit}, {shown} of {period:.6g}")
    t = _scale(t, "time", channel, unit, hints)
    return _spread_coarse(t, notes) if is_coarse else t


def _spread_coarse(t: Floats, notes: list[str]) -> Floats:
    """Return stamps (N,) s of a clock coarser than the rate, rows that share one spread over the time to the next."""
    known = np.flatnonzero(np.isfinite(t))
    first = known[np.diff(t[known], prepend=-np.inf) != 0]
    if len(first) < 3 or (np.diff(t[first]) < 0).any():
        return t
    tick, inner = float(np.median(np.diff(t[first]))), first[1:]  # the first one may have lost its beginning
    rows = np.arange(len(t), dtype=np.float64)
    line = np.polyfit(inner, t[inner], 1)
    even = np.polyval(line, rows)
    if np.abs(even[inner] - t[inner]).max() > tick:  # rows were lost: from each stamp to the next
        pace = np.median(np.diff(t[inner]) / np.diff(inner))
        before, after = (rows - inner[0]) * pace, (rows - inner[-1]) * pace
        even = np.interp(rows, inner, t[inner])
        even = np.where(rows < inner[0], t[inner[0]] + before, np.where(rows > inner[-1], t[inner[-1]] + after, even))
    notes.append(
        f"the stamps are whole steps of {tick:.3g} s, shared by {len(known) / len(first):.3g} rows: spread evenly"
    )
    return np.where(np.isfinite(t), even, np.nan)


def _judge_acc(acc: Floats, gyr: Floats, period_s: float, columns: ColumnMap, hints: Hints, notes: list[str]) -> str:
    """Return the unit of acc (N, 3), `m/s^2`, `g` or `mg`, from its norm at rest."""
    rest = plausibility.measure_rest_acc(acc, period_s)
    unit = plausibility.find_acc_unit(acc, period_s)
    if unit in ("m/s^2", "g", "mg"):
        notes.append(f"acc is taken for {unit}, by its {rest:.4g} at rest")
        return unit
    if rest > _COUNTS_AT_REST:
        full = write_mapping(columns, acc=f"1/{2 ** round(np.log2(rest))} g", gyr="UNIT")
        words = f": acc is {rest:.5g} at rest, so it counts steps of a converter: say how much one is"
        raise hints.ask(f"{words} (of gyr as 1/16.4 deg/s)", full)
    turned = plausibility.find_acc_unit(gyr, period_s)
    if turned is not None:
        exchanged = replace(columns, acc=replace(columns.gyr, unit=turned), gyr=columns.acc)
        words = f"the columns called {', '.join(columns.gyr.names)} measure gravity"
        words += f" ({plausibility.measure_rest_acc(gyr, period_s):.4g} at rest), and {', '.join(columns.acc.names)} do"
        raise hints.ask(f": {words} not: say so", write_mapping(exchanged, gyr="UNIT"))
    problem = plausibility.find_acc_problem(acc, period_s)
    if problem is None or "removed" not in problem:
        words = f": acc is {rest:.4g} at rest and names no unit: say it"
        raise hints.ask(words, write_mapping(columns, acc="UNIT"))
    raise FormatError(f"{hints.name}: {problem}.")


def _convert_mag(mag: Floats, channel: Channel, hints: Hints, notes: list[str]) -> Floats | None:
    """Return the magnetometer in uT; None, with a note, where its unit is arbitrary or not clear."""
    unit = channel.unit
    if unit is None:
        unit = plausibility.find_mag_unit(mag)
        if unit is None:
            median = plausibility.find_median_strength(mag)
            notes.append(
                f"the magnetometer names no unit, and its strength of {median:.4g} shows none: left out; "
                f"--columns mag=...[{KNOWN_UNITS['mag'].split(',')[0]}] says it"
            )
            return None
        notes.append(f"mag is taken for {unit}, by its strength")
    scaled = _scale(mag, "mag", channel, unit, hints)
    if np.isnan(find_factor("mag", unit) or 0.0):
        notes.append("the magnetometer is in arbitrary units and was left out")
        return None
    return scaled


# Arrays and data frames

_FRAME = Hints("the table", "columns=", "rate_hz=100", "")
_ARRAYS = Hints("the arrays", "units=", "rate_hz=100", "")


def convert_arrays(t: ArrayLike, acc: ArrayLike, gyr: ArrayLike, mag: ArrayLike | None, units: Units) -> Samples:
    """Convert stamps (N,), force, rate and field (N, 3) to SI."""
    words = {**SI_UNITS, **_read_units(units)}
    stamps = to_floats(np.asarray(t), "t", "the arrays")
    if np.asarray(t).dtype.kind == "M":
        words["time"] = "s"
    force, rate = (to_floats(np.asarray(one), name, "the arrays") for name, one in (("acc", acc), ("gyr", gyr)))
    field = None if mag is None else to_floats(np.asarray(mag), "mag", "the arrays")
    check_shapes(stamps, force, rate, field)
    values = [stamps[:, None], force, rate, *([] if field is None else [field])]
    places: dict[Quantity, tuple[int, ...]] = {"time": (0,), "acc": (1, 2, 3), "gyr": (4, 5, 6), "mag": (7, 8, 9)}
    channels = [Channel(at, (name,), words[name]) for name, at in places.items()]
    columns = ColumnMap(channels[1], channels[2], None if mag is None else channels[3], channels[0])
    return convert_samples(np.concatenate(values, axis=1), columns, None, _ARRAYS)


def check_shapes(
    t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None, pressure: Floats | None = None
) -> None:
    """Raise `RecordingError` where there is not one stamp, and one row of each sensor, a sample."""
    if t.ndim != 1:
        raise RecordingError(f"t has shape {t.shape}, not (N,): give one stamp a sample.")
    for name, value in (("acc", acc), ("gyr", gyr), ("mag", mag)):
        if value is not None and value.shape != (len(t), 3):
            raise RecordingError(f"{name} has shape {value.shape}, not ({len(t)}, 3): give one row a stamp.")
    if pressure is not None and pressure.shape != t.shape:
        raise RecordingError(f"pressure has shape {pressure.shape}, not ({len(t)},): give one a stamp, NaN for none.")


def convert_frame(frame: pd.DataFrame, columns: ColumnNames, units: Units, rate_hz: float | None) -> Samples:
    """Convert the columns of a data frame, by their names or as mapped, to SI."""
    if frame.index.name is not None or frame.index.dtype.kind == "M":
        frame = frame.reset_index(names=[frame.index.name or "time"])
    names = [" ".join(map(str, name)) if isinstance(name, tuple) else str(name) for name in frame.columns]
    given = None
    if isinstance(columns, str):
        given = parse_columns(columns)
    elif columns is not None:
        words: dict[Quantity, tuple[str, ...]] = {}
        for quantity, own in columns.items():
            words[quantity] = (own,) if isinstance(own, str) else tuple(map(str, own))
            if quantity not in QUANTITIES or len(words[quantity]) != len(QUANTITIES[quantity]):
                counts = "time and pressure one, acc, gyr and mag three"
                raise FormatError(f"columns of '{quantity}' are {words[quantity]}: give {counts}.")
        given = Columns(words, {})
    found = choose_columns(names, _FRAME, given=given, has_rate=rate_hz is not None)
    for quantity, unit in _read_units(units).items():
        channel = getattr(found, quantity)
        found = found if channel is None else replace(found, **{quantity: replace(channel, unit=unit)})
    stamps = found.time
    if stamps is not None and frame.dtypes.iloc[stamps.positions[0]].kind == "M":
        found = replace(found, time=replace(stamps, unit="s"))
    taken = [to_floats(frame.iloc[:, at].to_numpy(), names[at], _FRAME.name) for at in list_positions(found)]
    return convert_samples(np.column_stack(taken), found, rate_hz, _FRAME)


def _read_units(units: Units) -> dict[Quantity, str]:
    """Read unit words; raises `FormatError` for one that is not known."""
    if units is None or isinstance(units, str):
        return parse_units(units)
    for quantity, word in units.items():
        if quantity not in QUANTITIES:
            raise FormatError(f"units name '{quantity}': choose of {', '.join(QUANTITIES)}.")
        check_unit(quantity, word)
    return dict(units)


def to_floats(column: np.ndarray[Any, Any], name: str, source: str) -> Floats:
    """Return a column as floats, instants as seconds since 1970; what is empty is NaN."""
    if column.dtype.kind == "M":
        seconds = column.astype("datetime64[ns]").astype(np.int64) * 1e-9
        return np.where(np.isnat(column), np.nan, seconds)
    if column.dtype.kind in "fiub":
        return np.asarray(column, dtype=np.float64)
    import pandas as pd

    flat = column.reshape(-1)
    values = pd.Series(flat)
    numbers = np.asarray(pd.to_numeric(values, errors="coerce"), dtype=np.float64)
    bad = np.isnan(numbers) & values.notna().to_numpy() & (values.astype(str).str.lower() != "nan").to_numpy()
    if bad.any():
        at = int(np.argmax(bad))
        row = at // max(1, flat.size // max(1, len(column))) + 1
        raise FormatError(
            f"{source}, row {row}, column '{name}': {str(flat[at])[:40]!r} is not a number; correct or delete that row."
        )
    return numbers.reshape(column.shape)
