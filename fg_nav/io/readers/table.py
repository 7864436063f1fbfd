"""Any table of samples, by the names of its columns.

======== ==========================================================================================================
text     separated by comma, semicolon, tab, bar or blanks; decimal point or comma; comments; a row of units
JSON     an array or lines of objects, or an object of arrays
arrays   numpy's npz and npy, MATLAB files, HDF5 (needs h5py): an array a column, or (N, 3) for all axes of one
         quantity; (N, 6) or (N, 9) whose name has `imu` in it: force, rate and field
Parquet  a column a column (needs pyarrow); so is an Excel sheet (needs openpyxl)
======== ==========================================================================================================

`fg_nav.columns` reads names and units and judges what they do not say. The user says the rest: `Content.columns` is
what `--columns` maps, `Content.rate_hz` the rate of a table without stamps, `Content.sensor` which of several sensors.
These have columns with names of their own, or rows: then a column names them, or their rows alternate.
"""

from __future__ import annotations

import io
import json
import re
import shlex
import warnings
import zipfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.arrays import to_floats
from fg_nav.columns.choice import Asker, choose_columns, find_three_by_unit, has_word
from fg_nav.columns.headers import read_header
from fg_nav.columns.mapping import ACC, GYR, TIME, ColumnMap, parse_columns
from fg_nav.columns.samples import convert_samples, list_positions
from fg_nav.columns.units import Quantity
from fg_nav.errors import FgNavError, FormatError
from fg_nav.io.choice import choose_sensor
from fg_nav.io.content import Content, explain_missing, load_mat
from fg_nav.io.layout import MIN_NUMBERS, find_layout
from fg_nav.io.text_columns import drop_held
from fg_nav.recording import Provenance, RawRecording, Recording

PARQUET_MARK, ZIP_MARK, NPY_MARK, HDF5_MARK = b"PAR1", b"PK\x03\x04", b"\x93NUMPY", b"\x89HDF"

MAX_SENSORS, MIN_ROWS = 20, 20  # Of a column that names sensors: its values, and the rows that each of them has.

SENSOR_WORD = re.compile(r"sensor|dev|imu|foot|side|node|addr|mac|body|segment|limb", re.IGNORECASE)
_ALTERNATING = 0.1
"""Share of the rows at which a column changes that names their sensor; a label of what was done changes seldom."""

_APART, MAX_ALTERNATING = 0.25, 4
"""Rows of one sensor change by less than this much of what rows of two sensors do, median."""


@dataclass(frozen=True)
class Table:
    """Names of columns, and how to read some of them by their positions: (N, K) floats, and (N,) rows from 1.

    `words` reads a column as text, for the same rows.
    """

    names: Sequence[str]
    read: Callable[[Sequence[int]], tuple[Floats, Ints]]
    words: Callable[[int, Ints], NDArray[np.object_]]
    has_header: bool = True


def recognizes(content: Content) -> bool:
    """Whether a table names an accelerometer's and a gyroscope's axes."""
    try:
        table = open_table(content)
    except FormatError:
        return False
    if table is None or not table.has_header:
        return False
    kinds = find_kinds(table.names)
    return "gyr" in kinds and not kinds.isdisjoint({"acc", "no gravity", "gravity"})


def find_kinds(names: Iterable[str]) -> set[str]:
    """Which sensors' axes these names name."""
    names = list(names)
    kinds: set[str] = {meaning.kind for meaning in map(read_header, names) if meaning and meaning.axis}
    by_unit: tuple[Quantity, ...] = ("acc", "gyr")
    return kinds | {kind for kind in by_unit if kind not in kinds and find_three_by_unit(kind, names)}


def read(content: Content, format: str = "table") -> RawRecording:
    """Read a table by the names of its columns, or as the user maps them.

    Raises `FormatError` if a column or unit is missing and cannot be judged, a field is no number, or it is not said
    which of several sensors to take.
    """
    path, table = content.path, open_table(content)
    if table is None:
        if content.lines and sum(bool(line.strip()) for line in content.lines) == 1:
            raise FormatError(f"{path.name} has a header but no samples: record or export it again.")
        raise FormatError(f"{path.name} is no table of numbers: export it as CSV with a header.")
    columns = choose(content, table)
    values, row = table.read(list_positions(columns))
    # of several sensors the rows of one, the oldest first
    own, notes = _find_rows(content, table, columns, values, row)
    clock = _find_clock(columns, values[own])
    if clock is not None and np.count_nonzero(np.diff(clock) < 0) > 0.9 * len(clock):
        own, notes = own[::-1], [*notes, "the rows are newest first: turned round"]
    values, row = values[own], row[own]
    # units
    samples = convert_samples(values, columns, content.rate_hz, _asker(content))
    mag, air, is_ours = samples.mag, samples.pressure, set(TIME + ACC + GYR) <= set(table.names)
    return RawRecording(
        t=samples.t,
        acc=samples.acc,
        gyr=samples.gyr,
        mag=mag if mag is None or is_ours else drop_held(mag, samples.gyr),
        row=row,
        provenance=Provenance(path=path, format=format, notes=(*notes, *samples.notes)),
        pressure=air if air is None or is_ours else drop_held(air[:, None], samples.gyr)[:, 0],
    )


def choose(content: Content, table: Table) -> ColumnMap:
    """Choose the columns of a table by their names, or as the user maps them.

    Raises `FormatError` if one is missing, or there is a choice.
    """
    asker = _asker(content)
    if not table.has_header and content.columns is None:
        raise FormatError(
            f"{asker.name} has {len(table.names)} columns and no header: say which is what by number, "
            f"{ask_by_numbers(content)}."
        )
    return choose_columns(table.names, asker, content.sensor, content.columns, content.rate_hz is not None)


def ask_by_numbers(content: Content) -> str:
    """Return what to type for a table whose names say nothing: columns in a usual order that make a recording."""
    orders = ("time=1,acc=2:3:4,gyr=5:6:7", "time=1,acc=5:6:7,gyr=2:3:4", "time=2,acc=3:4:5,gyr=6:7:8")
    asker = _asker(content)
    return asker.ask(*orders, *(f"{order}[{unit}]" for order in orders[:2] for unit in ("deg/s", "rad/s")))


def _asker(content: Content) -> Asker:
    command = f"fg-nav inspect {shlex.quote(str(content.path))} --columns"
    return Asker(
        content.path.name, command, works=(lambda words: False) if content.is_trial else partial(_try, content)
    )


def _try(content: Content, words: str) -> bool:
    """Whether a mapping, in a command that is to be proposed, makes a recording of a table."""
    try:
        Recording.from_raw(read(replace(content, columns=parse_columns(words), is_trial=True)))
    except FgNavError:
        return False
    return True


def _find_clock(columns: ColumnMap, values: Floats) -> Floats | None:
    """Stamps or counter (N,) in the unit of the table; None without."""
    channel = columns.time or columns.counter
    return None if channel is None else channel.add(values[:, : len(channel.positions)])[:, 0]


def _find_rows(content: Content, table: Table, columns: ColumnMap, values: Floats, row: Ints) -> tuple[Ints, list[str]]:
    """Rows of the sensor that is asked for, where there are several, and what is to be said of them.

    A column that is no measurement names the sensors if its few values recur, and the stamps, which repeat or step
    back, rise among the rows of each value; or if it is called so and changes from row to row.
    """
    names, everything = table.names, np.arange(len(values))
    clock, used = _find_clock(columns, values), set(list_positions(columns))
    stuck = 0.0 if clock is None else float(np.mean(np.diff(clock) <= 0))
    in_a_name = any(has_word(name, content.sensor) for name in names)
    for position in range(len(names)):
        called = bool(SENSOR_WORD.search(names[position]))
        if position in used or not (called or stuck > 0) or (not called and read_header(names[position]) is not None):
            continue
        words = table.words(position, row)
        found = [word for word in dict.fromkeys(words.tolist()) if word is not None]
        groups = [np.flatnonzero(words == word) for word in found[: MAX_SENSORS + 1]]
        if not 2 <= len(groups) <= MAX_SENSORS or min(map(len, groups)) < MIN_ROWS:
            continue
        changes = float(np.mean(words[1:] != words[:-1]))
        inside = 0.0 if clock is None else max(float(np.mean(np.diff(clock[group]) <= 0)) for group in groups)
        if (stuck > 0 and inside < 0.25 * stuck) or (called and changes > _ALTERNATING and inside <= stuck):
            chosen = choose_sensor([str(word) for word in found], content.sensor, content.path)
            return groups[[str(word) for word in found].index(chosen)], [f"of {len(found)} sensors: {chosen}"]
    count = _count_alternating(values[:, -3 * (2 + (columns.mag is not None)) :][:, :3])
    if count > 1:
        alternate = [str(k + 1) for k in range(count)]
        chosen = choose_sensor(alternate, content.sensor, content.path, "sensors in alternating rows")
        return everything[int(chosen) - 1 :: count], [
            f"of {count} sensors in alternating rows: the one in row {chosen}"
        ]
    if content.sensor is not None and not in_a_name:
        raise FormatError(
            f"{content.path.name} holds one sensor, and nothing in it is called '{content.sensor}': leave --sensor out."
        )
    return everything, []


def _count_alternating(acc: Floats) -> int:
    """Count the sensors whose rows (N, 3) come in turn: as many apart they change by far less than side by side."""
    acc = acc[np.isfinite(acc).all(axis=1)]
    if len(acc) < MIN_ROWS * MAX_ALTERNATING:
        return 1
    apart = [float(np.median(np.linalg.norm(acc[k:] - acc[:-k], axis=1))) for k in range(1, MAX_ALTERNATING + 1)]
    found = (k + 1 for k in range(1, MAX_ALTERNATING) if apart[k] < _APART * min(apart[:k]))
    return next(found, 1)


def open_table(content: Content, fewest: int = MIN_NUMBERS) -> Table | None:
    """Open what is a table, of so many numbers in a row at least; None if it is none.

    Raises `FormatError` if it is one and damaged, or needs a library that is not installed.
    """
    if content.head.startswith(PARQUET_MARK):
        return _open_parquet(content)
    if content.head.startswith(NPY_MARK):
        return _open_npy(content)
    if content.head.startswith(HDF5_MARK):
        return _open_hdf5(content)
    if content.head.startswith(ZIP_MARK):
        if any(place.startswith(("xl/", "worksheets/")) for place in content.members):
            return _open_sheet(content)
        return _open_npz(content) if content.members and _are_arrays(content) else None
    if content.variables:
        arrays = {name: value for name, value in load_mat(content).items() if value is not None}
        return open_arrays({name: value.squeeze() for name, value in arrays.items()}, content.path.name)
    if content.lines and content.lines[0].lstrip()[:1] in ("{", "["):
        return _open_json(content)
    layout = find_layout(content, fewest) if content.lines else None
    if layout is None:
        return None

    def read_words(position: int, row: Ints) -> NDArray[np.object_]:
        return layout.read_words(content, position)[row - layout.first_line]

    return Table(layout.names, lambda positions: layout.read(content, positions), read_words, layout.has_header)


def _are_arrays(content: Content) -> bool:
    return all(name.endswith(".npy") for name in content.members)


def _open_parquet(content: Content) -> Table:
    name = content.path.name
    with explain_missing(name, "a Parquet file", "pyarrow", "parquet"):
        import pyarrow.parquet
    try:
        frame = pyarrow.parquet.read_table(content.source()).to_pandas()
    except Exception as error:  # pyarrow raises its own errors, OSError and ValueError on damaged files
        raise FormatError(f"{name} is a damaged Parquet file ({type(error).__name__}): export it again.") from None
    return _open_frame(frame.reset_index() if any(frame.index.names) else frame, name)


def _open_frame(frame: Any, name: str) -> Table:
    return open_arrays({str(column): frame[column].to_numpy() for column in frame.columns}, name)


def _open_sheet(content: Content) -> Table:
    """Open the first sheet of an Excel file as a table of text is opened."""
    import pandas as pd

    name = content.path.name
    with explain_missing(name, "an Excel file", "openpyxl", "xlsx"):
        import openpyxl  # noqa: F401
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            frame = pd.read_excel(io.BytesIO(content.read_bytes()), header=None)
    except Exception as error:  # of the zip, the XML and the sheet
        raise FormatError(f"{name} is a damaged Excel file ({type(error).__name__}): save it again.") from None
    text = frame.to_csv(index=False, header=False, sep="\t")
    sheet = Content(content.path, lines=tuple(text.splitlines()[:400]), fetch=lambda n: text.encode()[:n])
    found = open_table(sheet)
    if found is None:
        raise FormatError(f"{name} has no table of samples in its first sheet: save that alone, or as CSV.")
    return found


def _open_json(content: Content) -> Table | None:
    """Open an array or lines of objects, or an object of arrays; names of what is nested go with points."""
    import pandas as pd

    name, text = content.path.name, content.read_text()
    try:
        lines = [line for line in text.splitlines() if line.strip()]
        is_lines = len(lines) > 1 and lines[0].rstrip().endswith("}") and lines[1].lstrip().startswith("{")
        value = [json.loads(line) for line in lines] if is_lines else json.loads(text)
        while isinstance(value, dict) and len(value) == 1 and isinstance(next(iter(value.values())), dict | list):
            value = next(iter(value.values()))
        if isinstance(value, dict):
            lists = {key: values for key, values in value.items() if isinstance(values, list)}
            rows = max(lists.values(), key=len, default=[])
            if not rows or not isinstance(rows[0], dict):
                return open_arrays({key: np.asarray(values) for key, values in lists.items()}, name)
            value = rows
        if not value or not isinstance(value[0], dict):
            return None
        frame = pd.json_normalize(value)
    except (ValueError, RecursionError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())[:80]
        raise FormatError(f"{name} is no whole JSON of samples ({reason}): export it again.") from None
    for column in list(frame.columns):  # [x, y, z]
        cells = frame[column].dropna()
        if len(cells) and all(isinstance(cell, list) and len(cell) == 3 for cell in cells.head(20)):
            vectors = np.array([c if isinstance(c, list) and len(c) == 3 else [np.nan] * 3 for c in frame[column]])
            for k, axis in enumerate("xyz"):
                frame[f"{column}.{axis}"] = vectors[:, k]
            del frame[column]
    return _open_frame(frame, name)


def _open_npy(content: Content) -> Table:
    name = content.path.name
    try:
        array = np.load(io.BytesIO(content.read_bytes()), allow_pickle=False)
    except (ValueError, OSError, EOFError, SyntaxError, MemoryError, TypeError) as error:
        raise FormatError(f"{name} is a damaged npy file ({type(error).__name__}): save it again.") from None
    if array.dtype.names:
        return open_arrays({key: array[key] for key in array.dtype.names}, name)
    if array.ndim != 2:
        raise FormatError(f"{name} holds an array of shape {array.shape}: save one of (N, 7), or names its columns.")
    return replace(open_arrays({str(k + 1): column for k, column in enumerate(array.T)}, name), has_header=False)


def _open_hdf5(content: Content) -> Table:
    name = content.path.name
    with explain_missing(name, "an HDF5 file", "h5py", "hdf5"):
        import h5py
    arrays: dict[str, np.ndarray[Any, Any]] = {}

    def keep(place: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and not place.startswith("#"):
            value = node[()]
            if value.dtype.names:
                arrays.update({f"{place}/{key}": value[key] for key in value.dtype.names})
            elif value.dtype.kind in "fiubS" and value.size > 1:
                flat = value.squeeze()  # MATLAB's arrays lie on their side
                arrays[place] = flat.T if flat.ndim == 2 and flat.shape[0] < flat.shape[1] else flat

    try:
        with h5py.File(io.BytesIO(content.read_bytes()), "r") as file:
            file.visititems(keep)
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{name} is a damaged HDF5 file ({type(error).__name__}): save it again.") from None
    lengths = [len(array) for array in arrays.values()]
    longest = max(set(lengths), key=lengths.count) if lengths else 0
    own = {place: array for place, array in arrays.items() if len(array) == longest}
    short = [place.rsplit("/", 1)[-1] for place in own]
    names = [one if short.count(one) == 1 else place.replace("/", " ") for place, one in zip(own, short, strict=True)]
    return open_arrays(dict(zip(names, own.values(), strict=True)), name)


def _open_npz(content: Content) -> Table:
    name = content.path.name
    try:
        with np.load(io.BytesIO(content.read_bytes()), allow_pickle=False) as arrays:
            return open_arrays({key: arrays[key] for key in arrays.files}, name)
    except FormatError:
        raise
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile, MemoryError, SyntaxError, TypeError) as error:
        raise FormatError(f"{name} is a damaged npz file ({type(error).__name__}): save it again.") from None


def open_arrays(arrays: dict[str, np.ndarray[Any, Any]], source: str) -> Table:
    """Open arrays (N,), (N, 3), (N, 6) or (N, 9) by name as a table; those of other lengths and kinds are left out.

    Raises `FormatError` if there is none.
    """
    lengths = [len(array) for array in arrays.values() if array.ndim in (1, 2) and array.size]
    length = max(set(lengths), key=lengths.count) if lengths else 0
    names, columns = list[str](), list[np.ndarray[Any, Any]]()
    for name, array in arrays.items():
        flat = array[:, None] if array.ndim == 1 else array
        if array.ndim not in (1, 2) or len(flat) != length or array.dtype.kind not in "fiubMOUS":
            continue
        names += _expand_name(name, flat.shape[1])
        columns += list(flat.T)
    if not names:
        raise FormatError(f"{source} holds no arrays of samples: save t (N,), acc (N, 3) and gyr (N, 3).")

    def read_columns(positions: Sequence[int]) -> tuple[Floats, Ints]:
        values = [to_floats(columns[position], names[position], source) for position in positions]
        return np.column_stack(values), np.arange(1, length + 1)

    return Table(names, read_columns, lambda position, row: columns[position][row - 1].astype(str).astype(object))


def _expand_name(name: str, width: int) -> list[str]:
    """Names of the columns of an array: an axis goes before the unit."""
    if width == 1:
        return [name]
    words = ("acc x", "acc y", "acc z", "gyr x", "gyr y", "gyr z", "mag x", "mag y", "mag z")
    if width in (6, 9) and "imu" in name.lower():
        return list(words[:width])
    meaning = read_header(name)
    if width != 3 or meaning is None or meaning.axis:
        return [f"{name} {k + 1}" for k in range(width)]
    unit = f" [{meaning.unit}]" if meaning.unit else ""
    return [f"{meaning.stem} {axis}{unit}" for axis in "xyz"]
