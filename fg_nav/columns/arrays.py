"""Arrays and data frames of the user's own become samples in SI, through the same words as a file's columns.

Units are words: a list, `"ms, g, deg/s"`, of which each says its quantity, or by quantity, `{"acc": "g"}`. Arrays
without one are in s, m/s^2, rad/s and uT. Of a data frame counts what the names of its columns say, and what they do
not say is judged, as of a table in a file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fg_nav.arrays import Floats
from fg_nav.columns.choice import Asker, choose_columns
from fg_nav.columns.mapping import QUANTITIES, Channel, ColumnMap, Columns, parse_columns, parse_units
from fg_nav.columns.samples import SI_UNITS, Samples, convert_samples, list_positions
from fg_nav.columns.units import KNOWN_UNITS, Quantity, find_factor
from fg_nav.errors import FormatError, RecordingError

if TYPE_CHECKING:
    import pandas as pd

Units: TypeAlias = str | Mapping[Quantity, str] | None
"""Words for the units: a list with commas, or one a quantity."""

ColumnNames: TypeAlias = str | Mapping[Quantity, str | Sequence[str]] | None
"""A mapping as of `--columns`, or the names by quantity."""

_FRAME = Asker("the table", "columns=", "rate_hz=100", "")
_ARRAYS = Asker("the arrays", "units=", "rate_hz=100", "")


def convert_arrays(t: ArrayLike, acc: ArrayLike, gyr: ArrayLike, mag: ArrayLike | None, units: Units) -> Samples:
    """Convert stamps (N,), force, rate and field (N, 3) to SI.

    Raises `FormatError` for a unit that is not known, and `RecordingError` for what are no numbers of that shape.
    """
    words = {**SI_UNITS, **read_units(units)}
    stamps = to_floats(np.asarray(t), "t", "the arrays")
    if np.asarray(t).dtype.kind == "M":
        words["time"] = "s"
    values = [stamps.reshape(-1, 1) if stamps.ndim == 1 else stamps]
    for name, vectors in (("acc", acc), ("gyr", gyr), ("mag", mag)):
        if vectors is not None or name != "mag":
            values.append(_take_vectors(vectors, name, len(stamps)))
    if stamps.ndim != 1:
        raise RecordingError(f"t has shape {stamps.shape}, not (N,): give one stamp a sample.")
    places: dict[Quantity, tuple[int, ...]] = {"time": (0,), "acc": (1, 2, 3), "gyr": (4, 5, 6), "mag": (7, 8, 9)}
    channels = [Channel(at, (name,), words[name]) for name, at in places.items()]
    columns = ColumnMap(channels[1], channels[2], None if mag is None else channels[3], channels[0])
    return convert_samples(np.concatenate(values, axis=1), columns, None, _ARRAYS)


def _take_vectors(vectors: ArrayLike | None, name: str, count: int) -> Floats:
    values = to_floats(np.asarray(vectors), name, "the arrays")
    if values.shape != (count, 3):
        raise RecordingError(f"{name} has shape {values.shape}, not ({count}, 3): give one row a stamp.")
    return values


def convert_frame(frame: pd.DataFrame, columns: ColumnNames, units: Units, rate_hz: float | None) -> Samples:
    """Convert the columns of a data frame, by their names or as mapped, to SI.

    Raises `FormatError` if a column or unit is missing and cannot be judged, or a value is no number.
    """
    if frame.index.name is not None or frame.index.dtype.kind == "M":
        frame = frame.reset_index(names=[frame.index.name or "time"])
    names = [" ".join(map(str, name)) if isinstance(name, tuple) else str(name) for name in frame.columns]
    given = _read_names(columns)
    found = choose_columns(names, _FRAME, given=given, has_rate=rate_hz is not None)
    for quantity, unit in read_units(units).items():
        channel = getattr(found, quantity)
        found = found if channel is None else replace(found, **{quantity: replace(channel, unit=unit)})
    stamps = found.time
    if stamps is not None and frame.dtypes.iloc[stamps.positions[0]].kind == "M":
        found = replace(found, time=replace(stamps, unit="s"))
    taken = [to_floats(frame.iloc[:, at].to_numpy(), names[at], _FRAME.name) for at in list_positions(found)]
    return convert_samples(np.column_stack(taken), found, rate_hz, _FRAME)


def _read_names(columns: ColumnNames) -> Columns | None:
    if columns is None or isinstance(columns, str):
        return None if columns is None else parse_columns(columns)
    words: dict[Quantity, tuple[str, ...]] = {}
    for quantity, names in columns.items():
        words[quantity] = (names,) if isinstance(names, str) else tuple(map(str, names))
        if quantity not in QUANTITIES or len(words[quantity]) != len(QUANTITIES[quantity]):
            raise FormatError(
                f"columns of '{quantity}' are {words[quantity]}: give time and pressure one, acc, gyr and mag three."
            )
    return Columns(words, {})


def read_units(units: Units) -> dict[Quantity, str]:
    """Read unit words; raises `FormatError` for one that is not known."""
    if units is None or isinstance(units, str):
        return parse_units(units)
    for quantity, word in units.items():
        if quantity not in QUANTITIES:
            raise FormatError(f"units name '{quantity}': choose of {', '.join(QUANTITIES)}.")
        if find_factor(quantity, word) is None:
            raise FormatError(f"there is no unit '{word}' of {quantity}: choose one of {KNOWN_UNITS[quantity]}.")
    return dict(units)


def to_floats(column: np.ndarray[Any, Any], name: str, source: str) -> Floats:
    """Return a column as floats, instants as seconds since 1970; what is empty is NaN.

    Raises `FormatError` with the row of what is no number.
    """
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
