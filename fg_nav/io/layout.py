"""How a table of text is laid out: separator, decimal sign, header, units row, comments, first line of data.

The first long run of lines with as many numbers each is the data; separator and decimal sign are those by which most of
its fields are numbers. What stands right above it with as many fields is the header, in one or more rows, which
may be a comment; of these a row of units goes into brackets behind the names.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.headers import read_header
from fg_nav.columns.units import find_quantity
from fg_nav.io.content import Content, split_lines
from fg_nav.io.text_columns import read_table, table_options

MIN_NUMBERS = 6  # Columns of numbers that a table of force and rate has at least.
_MAX_TOP = 200  # Lines above the data.
_JUDGED = 40  # Lines of data from which the layout is told.

_MAX_HEADER_ROWS = 4

_COMMENTS = ("#", "%", "//", "!", '"#')

_SEPARATORS = ("\t", ";", ",", r"\s+", "|")

_DATE = re.compile(r"\d{4}[-/.]\d\d?[-/.]\d\d?(?:[ T]\d\d?:\d\d(?::\d\d(?:[.,]\d*)?)?(?:Z|[+-]\d\d:?\d\d)?)?\s*$")
"""Of year, month and day, with a time of day or without: other orders leave month and day open."""

_CLOCK = re.compile(r"(?:^|[ T])(?P<h>\d\d?):(?P<m>\d\d):(?P<s>\d\d)(?:[.,:](?P<f>\d+))?\s*(?P<p>[AaPp]\.?[Mm])?")
"""A time of day, whatever date stands before it."""

_DAY_S = 86400.0

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
_EMPTY = frozenset({"", "nan", "NaN", "NAN", "inf", "-inf", "+nan", "null", "NULL", "NA", "n/a", "N/A", "-nan", "None"})


@dataclass(frozen=True)
class Layout:
    """How a table is laid out. `names` are numbers from 1 where it has no header; `first_line` of data is from 1."""

    names: tuple[str, ...]
    first_line: int
    separator: str
    decimal: str
    comment: str | None
    has_header: bool

    def read(self, content: Content, positions: Sequence[int]) -> tuple[Floats, Ints]:
        """Read columns (N, K) and the line (N,) of each row; raises `FormatError` as `read_table` does."""
        clocks = self._find_clocks(content, positions)
        numbers = [position for position in positions if position not in clocks]
        values, row = read_table(
            content, self.names, numbers, self.first_line, self.separator, self.decimal, self.comment
        )
        for place, position in enumerate(positions):
            if position in clocks:
                text = self.read_words(content, position)[row - self.first_line]
                values = np.insert(values, place, (_read_dates if clocks[position] else _read_times)(text), axis=1)
        if self.comment is None:
            return values, row
        lines = split_lines(content.read_text())  # lines of comments alone are not among the rows
        kept = [n for n, line in enumerate(lines, 1) if n >= self.first_line and not line.startswith(self.comment)]
        return values, np.array([*kept, len(lines)])[np.minimum(row - self.first_line, len(kept))]

    def read_words(self, content: Content, position: int) -> NDArray[np.object_]:
        """Read a column as text, one a line from `first_line` on; None where a field is empty."""
        options = table_options(self.names, self.first_line, self.separator)
        frame = pd.read_csv(content.source(), dtype={position: str}, comment=self.comment, **options)
        return np.asarray(frame[position].str.strip().replace({np.nan: None}), dtype=object)

    def _find_clocks(self, content: Content, positions: Sequence[int]) -> dict[int, bool]:
        """Columns most of whose first fields are dates (True), or times of day."""
        rows = [split_row(line, self.separator) for line in content.lines[self.first_line - 1 :][:_JUDGED]]
        found = dict[int, bool]()
        for position in positions:
            fields = [row[position] for row in rows if len(row) > position]
            for is_date, words in ((True, _DATE), (False, _CLOCK)):
                if sum(bool(words.search(field)) for field in fields) * 2 > len(rows):
                    found.setdefault(position, is_date)
        return found


def _read_dates(text: NDArray[np.object_]) -> Floats:
    """Dates as s since 1970, NaN where there is none."""
    words = pd.Series(text)
    dates = pd.to_datetime(words, errors="coerce", utc=True, format="ISO8601")
    other = dates.isna() & words.notna()
    if other.any():  # each by itself, which is slow
        dates[other] = pd.to_datetime(words[other], errors="coerce", utc=True, format="mixed", dayfirst=False)
    stamps = dates.to_numpy(dtype="datetime64[ns]")
    return np.where(np.isnat(stamps), np.nan, stamps.astype(np.int64) * 1e-9)


def _read_times(text: NDArray[np.object_]) -> Floats:
    """Times of day as s, set on over midnight, NaN where there is none."""
    parts = pd.Series(text, dtype=object).astype(str).str.extract(_CLOCK)
    numbers = parts[["h", "m", "s"]].apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    fraction = pd.to_numeric("0." + parts["f"].fillna("0"), errors="coerce").to_numpy(dtype=np.float64)
    half = parts["p"].str.lower().str[0]
    hours = np.where(half.isna(), numbers[:, 0], numbers[:, 0] % 12 + 12 * (half == "p"))
    t = 3600.0 * hours + 60.0 * numbers[:, 1] + numbers[:, 2] + fraction
    known = np.isfinite(t)
    t[known] = np.unwrap(t[known], period=_DAY_S)
    return np.asarray(t, dtype=np.float64)


def find_layout(content: Content, fewest: int = MIN_NUMBERS) -> Layout | None:
    """Find the table in a text, with so many numbers in a row at least; None if there is none."""
    lines = content.lines
    start = next((k for k in range(min(len(lines), _MAX_TOP)) if _is_data_from(lines, k, fewest)), None)
    if start is None:
        return None
    data = [line for line in lines[start : start + _JUDGED] if line.strip() and not _is_comment(line)]
    separator, decimal = max(
        ((s, d) for s in _SEPARATORS for d in ".," if s != d), key=lambda way: _score(data, way[0], way[1], fewest)
    )
    width = _width(data, separator)
    names = _read_header_rows(lines[:start], separator, width)
    comment = "#" if any("#" in line for line in lines[start:]) else None
    header = names or [str(k + 1) for k in range(width)]
    return Layout(tuple(header), start + 1, separator, decimal, comment, names is not None)


def _is_data_from(lines: Sequence[str], start: int, fewest: int) -> bool:
    """Whether a line and the next that are not empty have enough numbers, by the same separator."""
    block = [line for line in lines[start : start + 6] if line.strip() and not _is_comment(line)][:3]
    if len(block) < 2 or not lines[start].strip() or _is_comment(lines[start]):
        return False
    return any(
        all(_count_numbers(split_row(line, s), d) >= fewest for line in block)
        for s in _SEPARATORS
        for d in ".,"
        if s != d
    )


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def split_row(line: str, separator: str) -> list[str]:
    """Fields of a line, quotes and surrounding blanks removed."""
    if separator == r"\s+":
        return line.split()
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]
    except csv.Error:
        return []


def _count_numbers(fields: Sequence[str], decimal: str) -> int:
    """Count the fields that are numbers."""
    if decimal == ",":
        whole = [field for field in fields if "." not in field and not field.endswith(",")]
        return sum(bool(_NUMBER.match(field.replace(",", ".", 1))) for field in whole)
    return sum(bool(_NUMBER.match(field)) for field in fields)


def _score(data: Sequence[str], separator: str, decimal: str, fewest: int) -> tuple[float, float]:
    """How well the lines split: the share of lines of enough numbers, and that of fields that are numbers or empty."""
    rows = [split_row(line, separator) for line in data]
    counts = [_count_numbers(row, decimal) for row in rows]
    enough = sum(count >= fewest for count in counts) / len(rows)
    known = sum(count + sum(field in _EMPTY for field in row) for row, count in zip(rows, counts, strict=True))
    return round(enough, 1), known / max(1, sum(map(len, rows)))


def _width(data: Sequence[str], separator: str) -> int:
    widths = [len(split_row(line, separator)) for line in data]
    return max(set(widths), key=widths.count)


def _read_header_rows(above: Sequence[str], separator: str, width: int) -> list[str] | None:
    """Names of the columns, from the rows right above the data; None if there are none."""
    rows: list[list[str]] = []
    for line in reversed(above):
        if not line.strip():
            if rows:
                break
            continue
        fields = _split_header(line, separator, width)
        if fields is None or len(rows) == _MAX_HEADER_ROWS:
            break
        rows.insert(0, fields)
    return _join_rows(rows) if rows else None


def _split_header(line: str, separator: str, width: int) -> list[str] | None:
    """Fields of a line above the data if they can be names of its columns."""
    text = re.sub(r"^[\s#%/!\"]+", "", line) if _is_comment(line) else line
    for way in (separator, *_SEPARATORS):
        fields = split_row(text, way)
        if abs(len(fields) - width) <= 1 and _count_numbers(fields, ".") * 2 < width and any(fields):
            return fields + [""] * (width - len(fields))
    return None


def _join_rows(rows: Sequence[Sequence[str]]) -> list[str]:
    """Make one name of what stands above each column."""
    width = max(map(len, rows))
    rows = [[*row, *[""] * (width - len(row))] for row in rows]
    units = next((row for row in rows[1:] if _is_units(row)), None)
    named = [_fill(row) if len(rows) - (units is not None) > 1 else list(row) for row in rows if row is not units]
    joined = [" ".join(words) for words in zip(*named, strict=True)]
    if len(named) > 1 and _knows(named[-1]) >= _knows(joined) and len(set(named[-1])) == len(named[-1]):
        named = named[-1:]
    names = [" ".join(dict.fromkeys(word for word in words if word)) for words in zip(*named, strict=True)]
    if units is None:
        return names
    return [f"{name} [{unit}]" if find_quantity(unit) else name for name, unit in zip(names, units, strict=True)]


def _fill(row: Sequence[str]) -> list[str]:
    """Names that stand above the first of several columns are those of all."""
    filled: list[str] = []
    for name in row:
        filled.append(name or (filled[-1] if filled else ""))
    return filled


def _is_units(row: Sequence[str]) -> bool:
    """Whether most of the words in a row are units."""
    words = [word for word in row if word]
    return bool(words) and sum(find_quantity(word) is not None for word in words) * 2 > len(words)


def _knows(names: Sequence[str]) -> int:
    return sum(meaning is not None and meaning.axis != "" for meaning in map(read_header, names))
