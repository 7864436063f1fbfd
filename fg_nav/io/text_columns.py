"""Tables of text with a known header: where it stands, what separates fields, and columns as floats at C speed.

A line `sep=;` names the separator, as spreadsheets have it; else it is the character of tab, semicolon and comma that
is most often in the header, or a blank. Numbers have a decimal comma where that separates no fields and commas are more
than points among the digits of the next lines.

Lines are counted from 1 as in an editor. Empty fields are NaN; wholly empty lines are left out. What does not parse is
named by line and column.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, split_fields
from fg_nav.text import format_count

_MAX_LINES = 60  # Lines searched for a header; the longest block of lines about a session is a third of this.
_SEPARATORS = "\t;,"
_SAID = re.compile(r'^"?sep=(\\t|.)"?', re.IGNORECASE)
_COMMA, _POINT = re.compile(r"\d,\d"), re.compile(r"\d\.\d")

BLOCK_ROWS = 1 << 19  # Parsed at once: a whole table takes the parser four times its memory; less scatters on the heap.
_MOVING_RAD_S = 0.5  # Turning this fast, no real magnetometer gives the same three numbers twice by chance.
_HELD_SHARE = 0.1  # More repeats than this in motion are the logger's doing, not the quantization's.


@dataclass(frozen=True)
class Header:
    """The header of a table: its line, counted from 0, the names of its columns, what separates them, decimal sign."""

    line: int
    names: list[str]
    separator: str = ","
    decimal: str = "."

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def read(self, content: Content, names: Sequence[str], skip: int = 0) -> tuple[Floats, Ints]:
        """Read columns (N, K) and the line (N,) of each row, from `skip` lines below the header on.

        Raises `FormatError` if a column is missing or doubled, or a field is no number.
        """
        positions = [find_column(name, self.names, content.path) for name in names]
        return read_table(content, self.names, positions, self.line + 2 + skip, self.separator, self.decimal)

    def read_integers(self, content: Content, name: str, row: Ints) -> Ints | None:
        """Read one column exactly at the lines (N,) `row`; None if one of its numbers is no whole one of 64 bits.

        Raises `FormatError` if the column is missing or doubled.
        """
        position, first_line = find_column(name, self.names, content.path), self.line + 2
        options = table_options(self.names, first_line, self.separator) | {"usecols": [position], "names": None}
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # of an infinite number, which is then raised
                frame = pd.read_csv(content.source(), dtype={position: np.int64}, **options)
        except (ValueError, TypeError, OverflowError, pd.errors.ParserError, pd.errors.EmptyDataError):
            return None
        return np.asarray(frame[position].to_numpy(dtype=np.int64)[row - first_line])

    def read_words(self, content: Content, name: str, row: Ints, skip: int = 0) -> pd.Series:
        """Read a column as text in the lines `row` that `read` gave.

        Raises `FormatError` if the column is missing or doubled, or the file is no table.
        """
        position, first_line = find_column(name, self.names, content.path), self.line + 2 + skip
        try:
            options = table_options(self.names, first_line, self.separator)
            frame: pd.DataFrame = pd.read_csv(content.source(), dtype=str, **options)
            return frame[position].iloc[row - first_line]
        except (ValueError, IndexError, pd.errors.ParserError):
            raise FormatError(f"{content.path.name}: column '{name}' cannot be read: export it again.") from None


def find_header(content: Content, is_header: Callable[[list[str]], bool]) -> Header | None:
    """Return the first line whose fields `is_header` accepts, with separator and decimal sign; None without."""
    said = _SAID.match(content.lines[0]) if content.lines else None
    for line, text in enumerate(content.lines[:_MAX_LINES]):
        separator = said[1].replace("\\t", "\t") if said else guess_separator(text)
        names = split_fields(text, separator)
        if is_header(names):
            below = "\n".join(content.lines[line + 1 : line + 10])
            has_comma = separator != "," and len(_COMMA.findall(below)) > len(_POINT.findall(below))
            return Header(line, names, separator, "," if has_comma else ".")
    return None


def guess_separator(line: str) -> str:
    """Guess what separates the fields of a line."""
    best = max(_SEPARATORS, key=line.count)
    return best if best in line else " "


def has_rows(content: Content) -> bool:
    """Whether there is more than a header: apps write that alone for a sensor which a phone does not have."""
    return sum(bool(line.strip()) for line in content.lines[:_MAX_LINES]) > 1


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


def read_table(
    content: Content,
    header: Sequence[str],
    positions: Sequence[int],
    first_line: int,
    separator: str = ",",
    decimal: str = ".",
    comment: str | None = None,
) -> tuple[Floats, Ints]:
    r"""Read the columns at some `positions` (K,) of a text table, (N, K), and the line (N,) of each row.

    `header` (C,) has the names of all its columns, `first_line`, from 1, is the first of data; a `separator` is one
    character, or the regular expression `\s+`; `comment` begins one, up to the end of its line.

    Raises `FormatError` if a field is no number, a row has too many fields, or there is no row.
    """
    # One column more than the header has: a separator may end each row, and a field too many shows.
    wanted, name = [*positions, len(header)], content.path.name
    options = table_options(header, first_line, separator) | {"decimal": decimal, "comment": comment}
    blocks = list[Floats]()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # of fields it leaves out
            types = dict.fromkeys(wanted, np.float64)
            with pd.read_csv(content.source(), dtype=types, chunksize=BLOCK_ROWS, **options) as frames:
                blocks += (frame[wanted].to_numpy(dtype=np.float64) for frame in frames)
    except pd.errors.EmptyDataError:
        pass
    except pd.errors.ParserWarning:
        raise FormatError(f"{name} has rows with more fields than the header: correct them.") from None
    except pd.errors.ParserError as error:
        reason = " ".join(str(error).removeprefix("Error tokenizing data. C error: ").split())
        raise FormatError(f"{name} is not a regular table ({reason}): correct that line.") from None
    except (ValueError, OverflowError):
        raise _find_bad_cell(content, wanted, options, [*header, "after the last"], first_line) from None
    values = np.concatenate([np.zeros((0, len(wanted))), *blocks])
    longer, filled = ~np.isnan(values[:, -1]), ~np.isnan(values).all(axis=1)
    if longer.any():
        number = first_line + int(np.argmax(longer))
        raise FormatError(f"{name}, line {number} has more fields than the header: correct that line.")
    if not filled.any():
        raise FormatError(f"{name} has a header but no samples: record or export it again.")
    return np.ascontiguousarray(values[filled, :-1]), first_line + np.flatnonzero(filled)


def table_options(header: Sequence[str], first_line: int, separator: str) -> dict[str, Any]:
    """How pandas reads the rows from a line on, counted from 1: one name more than the header, for a last separator."""
    return {
        "header": None, "names": range(len(header) + 1), "index_col": False, "skiprows": first_line - 1,
        "sep": separator, "skip_blank_lines": False, "engine": "c", "low_memory": False,
        "encoding": "utf-8", "encoding_errors": "replace", "na_values": ["+nan", "+NaN", "NAN"], "compression": None,
    }  # fmt: skip


def _find_bad_cell(
    content: Content, wanted: Sequence[int], options: dict[str, Any], names: Sequence[str], first_line: int
) -> FormatError:
    """Find the first field that is no number. Slow, but only ever run on a broken file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pd.errors.ParserWarning)
        text = pd.read_csv(content.source(), dtype=str, **options)[wanted]
    if options["decimal"] != ".":
        text = text.apply(lambda cells: cells.str.replace(options["decimal"], ".", regex=False))
    numbers = text.apply(pd.to_numeric, errors="coerce")
    bad = np.argwhere((numbers.isna() & text.notna()).to_numpy())
    name = content.path.name
    if not len(bad):
        return FormatError(f"{name} does not read as numbers: look for odd characters in an editor.")
    row, column = bad[0]
    cell = str(text.iat[row, column])[:40]
    return FormatError(
        f"{name}, line {row + first_line}, column '{names[wanted[column]]}': {cell!r} is not a number; correct or "
        f"delete that line."
    )


def scale_values(values: Floats, unit: Floats | float) -> Floats:
    """Multiply by a unit. A nonsense number may become infinite, and is found as such later."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(values * unit)


def drop_held(mag: Floats, gyr: Floats) -> Floats:
    """Set rows of `mag` (N, D) that repeat the row before exactly to NaN, if the logger holds samples at all.

    Many loggers repeat a sample until there is a new one; an estimator would count each repeat as a measurement.
    `gyr` (N, 3) rad/s shows the motion: repeats at rest alone are quantization, and stay.
    """
    repeated = np.concatenate(([False], (mag[1:] == mag[:-1]).all(axis=1)))
    moving = (np.abs(gyr) > _MOVING_RAD_S).any(axis=1)
    judged = repeated[moving] if np.count_nonzero(moving) >= 100 else repeated
    if judged.mean() < _HELD_SHARE:
        return mag
    return np.where(repeated[:, None], np.nan, mag)


def continue_counter(count: Floats, end: float, name: str) -> tuple[Floats, tuple[str, ...]]:
    """Return the counter or clock `count` (N,) unwrapped where it restarts at `end`, and a note if it does.

    A step of more than half of `end`, up or down, counts as a wrap: packets out of order stay so, and after a pause of
    more than half a cycle the time is wrong by whole cycles. NaN stays NaN; a column with numbers beyond `end` is no
    such counter, and is returned unchanged.
    """
    known = np.flatnonzero(np.isfinite(count))
    if not known.size or count[known].max() >= end or count[known].min() < 0:
        return count, ()
    whole = count.copy()
    whole[known] = np.unwrap(count[known], period=end)
    rounds = int(np.count_nonzero(np.diff(whole[known] - count[known]) > 0.5 * end))
    return whole, (f"{name} began again at its end {format_count(rounds, 'time')}: set on",) if rounds else ()
