"""Columns of a text table as floats, read at C speed; what does not parse is named by line and column.

Lines are counted from 1 as in an editor. Empty fields are NaN; wholly empty lines are left out. Many loggers repeat the
last magnetometer sample until there is a new one; an estimator would count each repeat as a measurement (`drop_held`).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.units import KNOWN_UNITS, Quantity, find_factor
from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.system.spilled import drop_pages, empty_column, join_rows, take_rows


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


def require_factor(quantity: Quantity, unit: str, column: str, path: Path) -> float:
    """Return how much of s, m/s^2, rad/s or uT the unit of a column is; raises `FormatError` if it is not known."""
    factor = find_factor(quantity, unit)
    if factor is None or not np.isfinite(factor):
        raise FormatError(
            f"{path.name}: column '{column}' has the unit '{unit}', which is not known here: convert it to one of "
            f"{KNOWN_UNITS[quantity]}."
        )
    return factor


def scale_values(values: Floats, unit: Floats | float) -> Floats:
    """Multiply by a unit. A nonsense number may become infinite, and is found as such later."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(values * unit)


BLOCK_ROWS = 1 << 19
"""Of a table, that are parsed at once: in one piece the parser takes four times the memory of the numbers. A smaller
block lies among others on the heap, and leaves its place there."""


def read_table(
    content: Content,
    header: Sequence[str],
    positions: Sequence[int],
    first_line: int,
    separator: str = ",",
    decimal: str = ".",
    comment: str | None = None,
) -> tuple[Floats, Ints]:
    r"""Read some columns of a text table, and the line of each row.

    Parameters
    ----------
    content : of the file.
    header : (C,) names of all columns of the file, for messages.
    positions : (K,) indices into `header` of the wanted columns, in the wanted order.
    first_line : counted from 1, that holds data.
    separator : one character, or the regular expression `\s+`.
    decimal : point or comma of the numbers.
    comment : a character that begins a comment, up to the end of its line.

    Returns
    -------
    (N, K) floats and (N,) line numbers.

    Raises `FormatError` if a field is no number, a row has too many fields, or there is no row.
    """
    # One column more than the header has: a separator may end each row, and a field too many shows.
    wanted: list[int] = [*positions, len(header)]
    options = table_options(header, first_line, separator) | {"decimal": decimal, "comment": comment}
    path = content.path
    blocks = _parse(content, wanted, options, [*header, "after the last"], first_line)[::-1]
    table, row = [], []
    while blocks:  # let go of as they are cut
        values = blocks.pop()
        line = np.arange(len(values), dtype=np.int64) + first_line
        first_line += len(values)
        longer = ~np.isnan(values[:, -1])
        if longer.any():
            raise FormatError(
                f"{path.name}, line {line[np.argmax(longer)]} has more fields than the header: correct that line."
            )
        filled = ~np.isnan(values).all(axis=1)
        table.append(take_rows(np.flatnonzero(filled), values[:, :-1]))
        row.append(line[filled])
    if not any(map(len, table)):
        raise FormatError(f"{path.name} has a header but no samples: record or export it again.")
    return join_rows(table), np.concatenate(row)


def _spill(values: Floats) -> Floats:
    """Return a block of rows where it takes no memory."""
    spilled = empty_column(*values.shape)
    spilled[...] = values
    drop_pages()
    return spilled


def read_integers(
    content: Content, header: Sequence[str], position: int, first_line: int, separator: str = ","
) -> Ints | None:
    """Read one column (N,) of a text table exactly, a number for each line from `first_line` on.

    None if one of them is no whole number of 64 bits: a float is as near as one gets then.
    """
    options = table_options(header, first_line, separator) | {"usecols": [position], "names": None}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of an infinite number, which is then raised
            frame = pd.read_csv(content.source(), dtype={position: np.int64}, **options)
    except (ValueError, TypeError, OverflowError, pd.errors.ParserError, pd.errors.EmptyDataError):
        return None
    return np.asarray(frame[position].to_numpy(dtype=np.int64))


def table_options(header: Sequence[str], first_line: int, separator: str) -> dict[str, Any]:
    """How pandas reads the rows from a line on, counted from 1: one name more than the header, for a last separator."""
    return {
        "header": None, "names": range(len(header) + 1), "index_col": False, "skiprows": first_line - 1,
        "sep": separator, "skip_blank_lines": False, "engine": "c", "low_memory": False,
        "encoding": "utf-8", "encoding_errors": "replace", "na_values": ["+nan", "+NaN", "NAN"], "compression": None,
    }  # fmt: skip


def _parse(
    content: Content, wanted: Sequence[int], options: dict[str, Any], names: Sequence[str], first_line: int
) -> list[Floats]:
    """Return blocks (n, K) of rows, in order."""
    path, options = content.path, options | {"chunksize": BLOCK_ROWS}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # of fields it leaves out
            with pd.read_csv(content.source(), dtype=dict.fromkeys(wanted, np.float64), **options) as frames:
                return [_spill(np.asarray(frame[wanted].to_numpy(dtype=np.float64))) for frame in frames]
    except pd.errors.EmptyDataError:
        return []
    except pd.errors.ParserWarning:
        raise FormatError(f"{path.name} has rows with more fields than the header: correct them.") from None
    except pd.errors.ParserError as error:
        reason = " ".join(str(error).removeprefix("Error tokenizing data. C error: ").split())
        raise FormatError(f"{path.name} is not a regular table ({reason}): correct that line.") from None
    except (ValueError, OverflowError):
        raise _find_bad_cell(content, wanted, options | {"chunksize": None}, names, first_line) from None


def _find_bad_cell(
    content: Content, wanted: Sequence[int], options: dict[str, Any], names: Sequence[str], first_line: int
) -> FormatError:
    """Find the first field that is no number. Slow, but only ever run on a broken file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pd.errors.ParserWarning)
        path = content.path
        text = pd.read_csv(content.source(), dtype=str, **options)[wanted]
    if options["decimal"] != ".":
        text = text.apply(lambda cells: cells.str.replace(options["decimal"], ".", regex=False))
    numbers = text.apply(pd.to_numeric, errors="coerce")
    bad = np.argwhere((numbers.isna() & text.notna()).to_numpy())
    if not len(bad):
        return FormatError(f"{path.name} does not read as numbers: look for odd characters in an editor.")
    row, column = bad[0]
    cell, name = str(text.iat[row, column])[:40], names[wanted[column]]
    return FormatError(
        f"{path.name}, line {row + first_line}, column '{name}': {cell!r} is not a number; correct or delete that line."
    )


_MOVING_RAD_S = 0.5  # Turning this fast, no real magnetometer gives the same three numbers twice by chance.
_HELD_SHARE = 0.1  # More repeats than this in motion are the logger's doing, not the quantization's.


def drop_held(mag: Floats, gyr: Floats) -> Floats:
    """Set rows of `mag` (N, D) that repeat the row before exactly to NaN, if the logger holds samples at all.

    `gyr` (N, 3) rad/s shows the motion: repeats at rest alone are quantization, and stay.
    """
    repeated = np.concatenate(([False], (mag[1:] == mag[:-1]).all(axis=1)))
    moving = (np.abs(gyr) > _MOVING_RAD_S).any(axis=1)
    judged = repeated[moving] if np.count_nonzero(moving) >= 100 else repeated
    if judged.mean() < _HELD_SHARE:
        return mag
    return np.where(repeated[:, None], np.nan, mag)
