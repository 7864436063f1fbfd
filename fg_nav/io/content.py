"""What a file holds: its first lines, or the variables of a MATLAB file (version 5 to 7.2).

Formats are recognized from this alone, never from the file's name. scipy's MATLAB reader trusts the file: on a damaged
one nearly any exception may come out of it. Only this module calls it.

Text tables become float columns, read at C speed; what does not parse is named by line and column. Lines are counted
from 1 as in an editor. Empty fields are NaN; wholly empty lines are left out. Many loggers repeat the last magnetometer
sample until there is a new one; an estimator would count each repeat as a measurement (`drop_held`).
"""

from __future__ import annotations

import csv
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import scipy.io

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import FormatError

_HEAD_BYTES = 65536


@dataclass(frozen=True)
class Content:
    """The beginning of a file: `lines` of text or `variables` of a MATLAB file; both empty for neither.

    `rate_hz` and `sensor` are what the user says where the file does not: its rate, and which of several sensors.
    """

    path: Path
    lines: tuple[str, ...] = ()
    variables: frozenset[str] = frozenset()
    rate_hz: float | None = None
    sensor: str | None = None

    def fields(self, line: int = 0) -> list[str]:
        """Comma-separated fields of one of the first lines, stripped; empty if there is no such line."""
        return split_fields(self.lines[line]) if line < len(self.lines) else []


def split_fields(line: str) -> list[str]:
    """Comma-separated fields of a line, quotes and surrounding blanks removed."""
    try:
        return [field.strip() for field in next(csv.reader([line]), [])]
    except csv.Error:
        return []


def read_content(path: Path) -> Content:
    """Open a file and see what it is made of.

    Raises `FormatError` if the path is no readable file, or the file is empty.
    """
    head = _read_head(path)
    if not head.strip():
        raise FormatError(f"{path.name} is empty: record or export it again.")
    if is_mat(head):
        return Content(path, variables=list_variables(path))
    if b"\0" in head:
        return Content(path)
    return Content(path, lines=tuple(_decode(head).splitlines()))


def _read_head(path: Path) -> bytes:
    if path.is_dir():
        raise FormatError(f"{path} is a directory: give one of the files in it.")
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except FileNotFoundError:
        raise FormatError(f"{path} does not exist: check the path.") from None
    except PermissionError:
        raise FormatError(f"{path} may not be read: check its permissions.") from None
    except (OSError, ValueError) as error:
        raise FormatError(f"{path} cannot be opened ({error}): check the path.") from None


def _decode(head: bytes) -> str:
    """Text of the head. A byte that is no UTF-8 (a degree or micro sign, mostly) is taken as Latin-1."""
    if len(head) == _HEAD_BYTES:  # a character may be cut in two at the end
        head = head[: head.rfind(b"\n") + 1] or head
    try:
        return head.decode("utf-8-sig")
    except UnicodeDecodeError:
        return head.decode("latin-1").removeprefix("ï»¿")


T = TypeVar("T")


def is_mat(head: bytes) -> bool:
    """Whether a file that begins like this is a MATLAB file (version 5 or later)."""
    return head.startswith(b"MATLAB ")


def list_variables(path: Path) -> frozenset[str]:
    """Names of the variables in a MATLAB file.

    Raises `FormatError` if the file is damaged or of version 7.3.
    """
    return frozenset(name for name, _, _ in _run_reader(path, scipy.io.whosmat))


def load_mat(path: Path) -> Mapping[str, Any]:
    """Variables of a MATLAB file by name.

    Raises `FormatError` if the file is damaged or of version 7.3.
    """
    return _run_reader(path, scipy.io.loadmat)


def mat_array(variables: Mapping[str, Any], name: str, path: Path, columns: int | None = None) -> Floats:
    """Take a variable as floats: (M, columns), or (M,) without `columns`.

    Raises `FormatError` if the variable is missing, not real numbers, or of another shape.
    """
    value = variables.get(name)
    if value is None:
        raise FormatError(f"{path.name} holds no variable '{name}': export it again with '{name}'.")
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
        raise FormatError(f"{path.name}: variable '{name}' is not an array of real numbers: export it again.")
    if columns is None and (value.ndim > 2 or value.size != max(value.shape, default=1)):
        raise FormatError(f"{path.name}: variable '{name}' has shape {value.shape} where a vector is needed.")
    if columns is not None and (value.ndim != 2 or value.shape[1] != columns):
        raise FormatError(f"{path.name}: variable '{name}' has shape {value.shape}, not (N, {columns}).")
    # uint8 would wrap in differences: everything is a float from here on.
    numbers = np.array(value, dtype=np.float64, order="C")
    return numbers.reshape(-1) if columns is None else numbers


def mat_samples(variables: Mapping[str, Any], imu: str, stamps: str, path: Path) -> tuple[Floats, Floats, Floats]:
    """Take stamps (N,), specific force (N, 3) and rates (N, 3) from a vector, and an array of six columns.

    Raises `FormatError` if one is missing, damaged, or does not fit the other.
    """
    samples, t = mat_array(variables, imu, path, columns=6), mat_array(variables, stamps, path)
    if len(t) != len(samples):
        raise FormatError(f"{path.name} has {len(samples)} samples but {len(t)} time stamps: export it again.")
    return t, samples[:, :3].copy(), samples[:, 3:].copy()


def _run_reader(path: Path, reader: Callable[[str], T]) -> T:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # scipy warns of what it then raises or repairs
            return reader(str(path))
    except NotImplementedError:
        raise FormatError(
            f"{path.name} is a MATLAB 7.3 file, which is not read here: save it again with '-v7'."
        ) from None
    except Exception as error:  # the zoo: zlib, struct, Value, Type, Key, Index, Memory, Overflow ... errors
        reason = type(error).__name__
        raise FormatError(f"{path.name} is a damaged MATLAB file ({reason}): copy or export it again.") from None


def find_column(name: str, header: Sequence[str], path: Path) -> int:
    """Index of the one column of this name.

    Raises `FormatError` if there is none, or more than one.
    """
    count = list(header).count(name)
    if count == 0:
        raise FormatError(f"{path.name} has no column '{name}': export the recording again with it.")
    if count > 1:
        raise FormatError(f"{path.name} has {count} columns '{name}': keep one of them.")
    return list(header).index(name)


def scale_values(values: Floats, unit: Floats | float) -> Floats:
    """Multiply by a unit. A nonsense number may become infinite, and is found as such later."""
    with np.errstate(over="ignore"):
        return np.asarray(values * unit)


def read_table(
    path: Path, header: Sequence[str], positions: Sequence[int], first_line: int, separator: str = ","
) -> tuple[Floats, Ints]:
    r"""Read some columns of a text table, and the line of each row.

    Parameters
    ----------
    path : the file.
    header : (C,) names of all columns of the file, for messages.
    positions : (K,) indices into `header` of the wanted columns, in the wanted order.
    first_line : counted from 1, that holds data.
    separator : one character, or the regular expression `\s+`.

    Returns
    -------
    (N, K) floats and (N,) line numbers.

    Raises `FormatError` if a field is no number, a row has too many fields, or there is no row.
    """
    # One column more than the header has: a separator may end each row, and a field too many shows.
    wanted: list[int] = [*positions, len(header)]
    options: dict[str, Any] = {
        "header": None, "names": range(len(header) + 1), "index_col": False, "skiprows": first_line - 1,
        "sep": separator, "skip_blank_lines": False, "engine": "c", "low_memory": False,
        "encoding": "utf-8", "encoding_errors": "replace", "na_values": ["+nan", "+NaN"],
    }  # fmt: skip
    values = _parse(path, wanted, options, [*header, "after the last"], first_line)
    row = np.arange(len(values), dtype=np.int64) + first_line
    longer = ~np.isnan(values[:, -1])
    if longer.any():
        raise FormatError(
            f"{path.name}, line {row[np.argmax(longer)]} has more fields than the header: correct that line."
        )
    filled = ~np.isnan(values).all(axis=1)
    if not filled.any():
        raise FormatError(f"{path.name} has a header but no samples: record or export it again.")
    return np.ascontiguousarray(values[filled, :-1]), row[filled]


def _parse(path: Path, wanted: Sequence[int], options: dict[str, Any], names: Sequence[str], first_line: int) -> Floats:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # of fields it leaves out
            frame = pd.read_csv(path, dtype=dict.fromkeys(wanted, np.float64), **options)
    except pd.errors.EmptyDataError:
        return np.empty((0, len(wanted)))
    except pd.errors.ParserWarning:
        raise FormatError(f"{path.name} has rows with more fields than the header: correct them.") from None
    except pd.errors.ParserError as error:
        reason = " ".join(str(error).removeprefix("Error tokenizing data. C error: ").split())
        raise FormatError(f"{path.name} is not a regular table ({reason}): correct that line.") from None
    except (ValueError, OverflowError):
        raise _find_bad_cell(path, wanted, options, names, first_line) from None
    return np.asarray(frame[wanted].to_numpy(dtype=np.float64))


def _find_bad_cell(
    path: Path, wanted: Sequence[int], options: dict[str, Any], names: Sequence[str], first_line: int
) -> FormatError:
    """Find the first field that is no number. Slow, but only ever run on a broken file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pd.errors.ParserWarning)
        text = pd.read_csv(path, dtype=str, **options)[wanted]
    numbers = text.apply(pd.to_numeric, errors="coerce")
    bad = np.argwhere((numbers.isna() & text.notna()).to_numpy())
    if not len(bad):
        return FormatError(f"{path.name} does not read as numbers: look for odd characters in an editor.")
    row, column = bad[0]
    cell, name = str(text.iat[row, column])[:40], names[wanted[column]]
    return FormatError(
        f"{path.name}, line {row + first_line}, column '{name}': {cell!r} is not a number; correct or delete that line."
    )


_MOVING_RAD_S = 0.5
"""Turning this fast, no real magnetometer gives the same three numbers twice by chance."""

_HELD_SHARE = 0.1
"""More repeats than this in motion are the logger's doing, not the quantization's."""


def drop_held(mag: Floats, gyr: Floats) -> Floats:
    """Set rows of `mag` (N, 3) that repeat the row before exactly to NaN, if the logger holds samples at all.

    `gyr` (N, 3) rad/s shows the motion: repeats at rest alone are quantization, and stay.
    """
    repeated = np.concatenate(([False], (mag[1:] == mag[:-1]).all(axis=1)))
    moving = (np.abs(gyr) > _MOVING_RAD_S).any(axis=1)
    judged = repeated[moving] if np.count_nonzero(moving) >= 100 else repeated
    if judged.mean() < _HELD_SHARE:
        return mag
    return np.where(repeated[:, None], np.nan, mag)
