"""Tables of text below lines about the session: where the header is, and what separates its fields.

A line `sep=;` says it, as spreadsheets have it; else it is the character of tab, semicolon and comma that is most often
in the header, and a blank where there is none of them. Numbers have a decimal comma where that separates no fields, and
commas are more than points among the digits of the next lines.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pandas as pd

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.io.text_columns import find_column, read_integers, read_table, table_options

_MAX_LINES = 60  # The longest block of lines about a session is a third of this.

_SEPARATORS = "\t;,"

_SAID = re.compile(r'^"?sep=(\\t|.)"?', re.IGNORECASE)
_COMMA, _POINT = re.compile(r"\d,\d"), re.compile(r"\d\.\d")


@dataclass(frozen=True)
class Header:
    """The header of a table: its line, counted from 0, the names of its columns, what separates them, decimal sign."""

    line: int
    names: list[str]
    separator: str
    decimal: str

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def read(self, content: Content, names: list[str], skip: int = 0) -> tuple[Floats, Ints]:
        """Read columns (N, K) and the line (N,) of each row, from `skip` lines below the header on.

        Raises `FormatError` if a column is missing or doubled, or a field is no number.
        """
        positions = [find_column(name, self.names, content.path) for name in names]
        return read_table(content, self.names, positions, self.line + 2 + skip, self.separator, self.decimal)

    def read_integers(self, content: Content, name: str, row: Ints) -> Ints | None:
        """Read one column exactly at the lines (N,) `row`; None if one of its numbers is not whole.

        Raises `FormatError` if the column is missing or doubled.
        """
        position = find_column(name, self.names, content.path)
        numbers = read_integers(content, self.names, position, self.line + 2, self.separator)
        return None if numbers is None else numbers[row - (self.line + 2)]

    def read_words(self, content: Content, name: str, row: Ints, skip: int = 0) -> pd.Series:
        """Read a column as text in the lines `row` that `read` gave.

        Raises `FormatError` if the column is missing or doubled, or the file is no table.
        """
        position = find_column(name, self.names, content.path)
        first_line = self.line + 2 + skip
        try:
            options = table_options(self.names, first_line, self.separator)
            frame: pd.DataFrame = pd.read_csv(content.source(), dtype=str, **options)
            return frame[position].iloc[row - first_line]
        except (ValueError, IndexError, pd.errors.ParserError):
            raise FormatError(f"{content.path.name}: column '{name}' cannot be read: export it again.") from None


def find_header(content: Content, is_header: Callable[[list[str]], bool]) -> Header | None:
    """Find the first line whose fields are those of a header."""
    said = find_said_separator(content)
    for line, text in enumerate(content.lines[:_MAX_LINES]):
        separator = said or guess_separator(text)
        names = split_line(text, separator)
        if is_header(names):
            return Header(line, names, separator, _guess_decimal(content.lines[line + 1 : line + 10], separator))
    return None


def has_rows(content: Content) -> bool:
    """Whether there is more than a header: apps write that alone for a sensor which a phone does not have."""
    return sum(bool(line.strip()) for line in content.lines[:_MAX_LINES]) > 1


def find_said_separator(content: Content) -> str | None:
    """Find the separator that a line `sep=` at the top names."""
    match = _SAID.match(content.lines[0]) if content.lines else None
    return match[1].replace("\\t", "\t") if match else None


def _guess_decimal(lines: Sequence[str], separator: str) -> str:
    below = "\n".join(lines)
    return "," if separator != "," and len(_COMMA.findall(below)) > len(_POINT.findall(below)) else "."


def guess_separator(line: str) -> str:
    """Guess what separates the fields of a line."""
    best = max(_SEPARATORS, key=line.count)
    return best if best in line else " "


def split_line(line: str, separator: str) -> list[str]:
    """Fields of a line, quotes and surrounding blanks removed."""
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error:
        return []
