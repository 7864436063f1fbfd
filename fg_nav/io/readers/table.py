"""Any table of samples: delimited text, numpy's npz, Parquet. The names of its columns say what is what.

======== ==========================================================================================================
text     separated by comma, semicolon, tab, bar or blanks; decimal point or comma; comments; a row of units
npz      an array a column, or (N, 3) for all axes of one quantity; (N, 6) or (N, 9) whose name has `imu` in it:
         force, rate and field
Parquet  a column a column (needs pyarrow)
======== ==========================================================================================================

`fg_nav.columns` reads names and units and judges what they do not say. The user says the rest: `Content.columns` is
what `--columns` maps, `Content.rate_hz` the rate of a table without stamps.
"""

from __future__ import annotations

import shlex
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.arrays import to_floats
from fg_nav.columns.choice import Asker, choose_columns
from fg_nav.columns.headers import read_header
from fg_nav.columns.mapping import ACC, GYR, TIME, ColumnMap
from fg_nav.columns.samples import convert_samples, list_positions
from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.io.layout import find_layout
from fg_nav.io.text_columns import drop_held
from fg_nav.recording import Provenance, RawRecording

PARQUET_MARK, ZIP_MARK = b"PAR1", b"PK\x03\x04"


@dataclass(frozen=True)
class Table:
    """Names of columns, and how to read some of them by their positions: (N, K) floats, and (N,) rows from 1."""

    names: Sequence[str]
    read: Callable[[Sequence[int]], tuple[Floats, Ints]]
    has_header: bool = True


def recognizes(content: Content) -> bool:
    """Whether a table names an accelerometer's and a gyroscope's axes."""
    try:
        table = open_table(content)
    except FormatError:
        return False
    if table is None or not table.has_header:
        return False
    kinds = {meaning.kind for meaning in map(read_header, table.names) if meaning and meaning.axis}
    return "gyr" in kinds and not kinds.isdisjoint({"acc", "no gravity"})


def read(content: Content) -> RawRecording:
    """Read a table by the names of its columns, or as the user maps them.

    Raises `FormatError` if a column or unit is missing and cannot be judged, or a field is no number.
    """
    path, table = content.path, open_table(content)
    if table is None:
        raise FormatError(f"{path.name} is no table of numbers: export it as CSV with a header.")
    columns = choose(content, table)
    values, row = table.read(list_positions(columns))
    samples = convert_samples(values, columns, content.rate_hz, _asker(content))
    mag, air, is_ours = samples.mag, samples.pressure, set(TIME + ACC + GYR) <= set(table.names)
    return RawRecording(
        t=samples.t,
        acc=samples.acc,
        gyr=samples.gyr,
        mag=mag if mag is None or is_ours else drop_held(mag, samples.gyr),
        row=row,
        provenance=Provenance(path=path, format="table", notes=samples.notes),
        pressure=air if air is None or is_ours else drop_held(air[:, None], samples.gyr)[:, 0],
    )


def choose(content: Content, table: Table) -> ColumnMap:
    """Choose the columns of a table by their names, or as the user maps them.

    Raises `FormatError` if one is missing, or there is a choice.
    """
    asker = _asker(content)
    if content.columns is not None:
        return content.columns.find(table.names, asker.name)
    if not table.has_header:
        raise FormatError(
            f"{asker.name} has {len(table.names)} columns and no header: say which is what by number, as "
            f"{asker.ask('time=1[s],acc=2:3:4[g],gyr=5:6:7[deg/s]')}."
        )
    return choose_columns(table.names, asker, content.sensor)


def _asker(content: Content) -> Asker:
    return Asker(content.path.name, f"fg-nav inspect {shlex.quote(str(content.path))} --columns")


def open_table(content: Content) -> Table | None:
    """Open what is a table; None if it is none.

    Raises `FormatError` if it is one and damaged, or needs a library that is not installed.
    """
    if content.head.startswith(PARQUET_MARK):
        return _open_parquet(content)
    if content.head.startswith(ZIP_MARK):
        return _open_npz(content) if content.members and _are_arrays(content) else None
    layout = find_layout(content) if content.lines else None
    if layout is None:
        return None
    return Table(layout.names, lambda positions: layout.read(content, positions), layout.has_header)


def _are_arrays(content: Content) -> bool:
    return all(name.endswith(".npy") for name in content.members)


def _open_parquet(content: Content) -> Table:
    name = content.path.name
    try:
        import pyarrow.parquet
    except ImportError:
        raise FormatError(f"{name} is a Parquet file, which pyarrow reads: pip install 'fg-nav[parquet]'.") from None
    try:
        frame = pyarrow.parquet.read_table(content.source()).to_pandas()
    except Exception as error:  # pyarrow raises its own errors, OSError and ValueError on damaged files
        raise FormatError(f"{name} is a damaged Parquet file ({type(error).__name__}): export it again.") from None
    frame = frame.reset_index() if any(frame.index.names) else frame
    return open_arrays({str(column): frame[column].to_numpy() for column in frame.columns}, name)


def _open_npz(content: Content) -> Table:
    name = content.path.name
    try:
        with np.load(BytesIO(content.read_bytes()), allow_pickle=False) as arrays:
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
        if array.ndim not in (1, 2) or len(flat) != length or array.dtype.kind not in "fiubMO":
            continue
        names += _expand_name(name, flat.shape[1])
        columns += list(flat.T)
    if not names:
        raise FormatError(f"{source} holds no arrays of samples: save t (N,), acc (N, 3) and gyr (N, 3).")

    def read_columns(positions: Sequence[int]) -> tuple[Floats, Ints]:
        values = [to_floats(columns[position], names[position], source) for position in positions]
        return np.column_stack(values), np.arange(1, length + 1)

    return Table(names, read_columns)


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
