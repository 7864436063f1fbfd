"""Samples in the text of a stream: lines of fields with commas between; a header or the user names the columns.

Lines are read one by one, 50 000 a second; the first bad one is named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns import mapping
from fg_nav.columns.headers import find_factor
from fg_nav.columns.mapping import ACC, CANONICAL, GYR, MAG, PASSED_OVER, PRESSURE, TIME
from fg_nav.columns.samples import SI_UNITS
from fg_nav.errors import FormatError, StreamError
from fg_nav.io.tables import find_column
from fg_nav.samples.plausibility import find_unit_problems, keep_air
from fg_nav.samples.readings import COLUMNS

OWN = frozenset(CANONICAL[:7])  # names of which a canonical header has some
MAX_LINE = 1 << 16  # bytes; a longer line has lost its end
MIN_NAMES = 6  # of a header, force and rate; fewer words are a message of the device
LINES_TO_REMARK = 20  # before the header; fewer were left in a device's buffer
MAX_BEFORE_HEADER = 5000  # lines; some senders repeat their header every second
HEADLESS, MIN_HEADLESS = 400, 100  # rows by which physics shows canonical order in SI; fewer at the end of the source
WIDTHS = (7, 10, 11)  # fields of canonical rows: without a field and pressure, without pressure, all
HINT = f"a line must name the columns ({TIME[0]},{ACC[0]},...), or --columns; --speed replays a whole recording"


@dataclass(frozen=True)
class Columns:
    """The columns of rows without a canonical header."""

    names: tuple[str, ...]  # Of all fields of a row, in order; those that are not in `CANONICAL` are skipped.
    units: tuple[float, ...] = (1.0,) * COLUMNS  # (11,) factors of the fields.
    rate_hz: float | None = None  # Of rows without a stamp, whose stamps are counted by it; None where they have one.
    mapping: str | None = None  # The user's words, where they name columns of a header to come, or numbers of fields.


def parse_columns(words: str | None, units: str | None = None, rate_hz: float | None = None) -> Columns | None:
    """Return the columns that the user names (`fg_nav.columns.mapping`), None without; raises `StreamError`."""
    if words is None:
        for value, option in ((units, "--units"), (rate_hz, "--rate")):
            if value is not None:
                raise StreamError(f"{option} is for rows without a header: name their --columns too, or leave it out.")
        return None
    try:
        wanted = mapping.parse_columns(words, units)
    except FormatError as error:
        raise StreamError(str(error)) from None
    for quantity in ("acc", "gyr"):
        if quantity not in wanted.words:
            raise StreamError(f"--columns lacks {quantity}: write it as {mapping.EXAMPLE}.")
    if rate_hz is not None and not 0.0 < rate_hz < np.inf:
        raise StreamError(f"--rate {rate_hz:g} is no rate: give samples a second.")
    if "time" not in wanted.words and rate_hz is None:
        raise StreamError("--columns has no time: name it, or give the --rate by which stamps are counted.")
    if "time" in wanted.words and rate_hz is not None:
        raise StreamError("--rate is for rows without a stamp, and --columns names one: leave one of them out.")
    if wanted.width is None:
        return Columns((), rate_hz=rate_hz, mapping=words)
    return _place_columns(wanted, list(map(str, range(1, wanted.width + 1))), rate_hz, "--columns")


def _place_columns(wanted: mapping.Columns, fields: Sequence[str], rate_hz: float | None, source: str) -> Columns:
    """Return the columns of rows whose fields have these names."""
    found = wanted.find(fields, source)
    names, factors = [PASSED_OVER] * len(fields), np.ones(COLUMNS)
    for quantity, own in mapping.QUANTITIES.items():
        channel = found.get(quantity)
        if channel is not None:
            for position, name in zip(channel.positions, own, strict=True):
                names[position] = name
            factors[[CANONICAL.index(name) for name in own]] = find_factor(quantity, channel.unit or SI_UNITS[quantity])
    return Columns(tuple(names), tuple(factors.tolist()), rate_hz)


class RowReader:
    """Parses bytes, in pieces of any length, into samples (n, 11): t, acc, gyr, mag, pressure in SI, mag in uT.

    Without `columns` the first line that names canonical columns is the header, or the end of one if the source began
    before; where it was lost, rows of 7, 10 or 11 numbers are in canonical order if units and axes are then those of a
    sensor, and all of them are kept. Then each line is a row. One that has another number of fields, or a field that is
    no number, is left out and counted in `bad`; an empty field is NaN. Of a further header (docs/online.md) that lacks
    its end, or has one damaged name, the order stays.

    Raises `FormatError` from `read`, if no header comes, or the first one lacks a column, or names others than before
    the walk resumed.
    """

    def __init__(
        self, name: str, remark: Callable[[str], None] = lambda words: None, columns: Columns | None = None
    ) -> None:
        self.name, self.remark, self.bad = name, remark, 0
        # The unfinished line; lines read, stamps counted by the rate, lines before the header.
        self._rest, self._is_too_long = b"", False
        self._line = self._counted = self._waited = 0
        # The order of the fields, the names of the header it is from, and whether the newest header has other names.
        self._columns: Columns | None = None
        self._names: tuple[str, ...] | None = None
        self._positions: list[int] = []
        self._is_foreign, self._is_confirmed = False, True
        # What a first header lacks; rows without one, until their order is clear.
        self._problem: FormatError | None = None
        self._headless: list[list[str]] = []
        # The user's words for the columns, where a header or the first row shows their places, and the user's rate.
        self._mapping, self._rate_hz = None, None if columns is None else columns.rate_hz
        if columns is not None and columns.mapping is not None:
            self._mapping = mapping.parse_columns(columns.mapping)
        elif columns is not None:
            self._use(columns)

    def resume(self, header: Sequence[str]) -> None:
        """Use the header from before an interruption; one that comes again must name the same columns, in any order."""
        if self._columns is None and self._mapping is None:
            self._use(Columns(tuple(header)), header)
            self._is_confirmed = False

    @property
    def header(self) -> list[str] | None:
        """Names of the columns; None before they are known."""
        return None if self._columns is None else list(self._columns.names)

    def read(self, piece: bytes, away_s: float = 0.0) -> Floats:
        """Return the samples (n, 11) whose rows end in this piece.

        `away_s` is how long the source was not connected before the piece: a row that was cut off then is left out, and
        counted stamps go on behind it.
        """
        if away_s > 0.0:
            self._rest, self._is_too_long = b"", False
            self._counted += round(away_s * (self._rate_hz or 0.0)) if self._columns is not None else 0
        if self._is_too_long:
            _, end, piece = piece.partition(b"\n")
            self._is_too_long = not end
        *lines, self._rest = (self._rest + piece).split(b"\n")
        rows = [row for line in lines for row in self._read_line(line)]
        if len(self._rest) > MAX_LINE:  # left out already, up to the end that is to come
            self._read_line(self._rest)
            self._rest, self._is_too_long = b"", True
        return np.array(rows, dtype=np.float64).reshape(-1, COLUMNS)

    def finish(self, is_cut: bool = False) -> Floats:
        """Return the samples (n, 11) left at the end, none of a last line that `is_cut`; raises `FormatError`."""
        rows = self.read(b"" if is_cut or not self._rest else b"\n")
        if self._columns is None and len(self._headless) >= MIN_HEADLESS:
            rows = np.array(self._read_headless()).reshape(-1, COLUMNS)
        if self._columns is None:
            raise self._problem or FormatError(f"{self.name} ended before a header came: {HINT}.")
        return rows

    def _read_line(self, line: bytes) -> list[list[float]]:
        """Return the samples (11 numbers each, SI) that a line completes: one, or all those without a header so far."""
        self._line += 1
        if len(line) > MAX_LINE:
            self._leave_out(f"it is longer than {MAX_LINE} bytes")
            return []
        fields = [field.strip() for field in line.decode("utf-8", "replace").strip("\ufeff\r\n ").split(",")]
        if fields == [""]:
            return []
        if self._columns is not None:
            return self._read_row(fields, self._columns)
        rows = self._find_header(fields) if self._mapping is None else self._find_mapped(fields, self._mapping)
        if self._columns is None:
            self._waited += 1
            if self._waited == LINES_TO_REMARK:
                if self._problem is not None:
                    raise self._problem
                self.remark(f"no header yet from {self.name}, and rows before it are left out: {HINT}.")
            if self._waited > MAX_BEFORE_HEADER:
                raise FormatError(f"{self.name} sends no header: {HINT}.")
        return rows

    # --- the first header --------------------------------------------------------------------------------------------

    def _find_header(self, fields: list[str]) -> list[list[float]]:
        """Use the first header; keep rows before it, and return those whose values show that they are canonical."""
        if not OWN.isdisjoint(fields):
            try:
                self._use(columns := _name_columns(fields if fields[-1] else fields[:-1]), columns.names)
            except FormatError as error:
                if self._line > 1:
                    raise
                # Of the first line the beginning may be cut off.
                self._problem, end = error, ",".join(fields)
                width = next((width for width in WIDTHS if ",".join(CANONICAL[:width]).endswith(end)), None)
                if width is not None:
                    self._assume(width)
        elif len(fields) in WIDTHS and all(not field or is_number(field) for field in fields):
            known = len(self._headless[0]) if self._headless else 0
            if len(fields) >= known:  # a shorter one was cut
                self._headless = [*(self._headless if len(fields) == known else []), fields]
            if len(self._headless) == HEADLESS:
                return self._read_headless()
        return []

    def _assume(self, width: int) -> Columns:
        """Use the canonical order for rows of so many fields, and return it."""
        columns = Columns(CANONICAL[:width])
        self._use(columns, columns.names)
        names = ",".join(columns.names)
        self.remark(f"no header came from {self.name}: its {width} fields are taken for {names}, in SI.")
        return columns

    def _read_headless(self) -> list[list[float]]:
        """Return the rows without a header, in canonical order, if their values are plausible then; drop others."""
        kept, self._headless = self._headless, []
        width = len(kept[0])
        table = np.array([[float(field or "nan") for field in fields] for fields in kept])
        mag = table[:, 7:10] if width > 7 else None
        is_no_air = width == 11 and keep_air(table[:, 10]) is None
        problems = find_unit_problems(table[:, 0], table[:, 1:4], table[:, 4:7], mag)
        if problems or is_no_air or (np.diff(table[:, 0]) <= 0).any():
            return []
        columns = self._assume(width)
        return [row for fields in kept for row in self._read_row(fields, columns)]

    def _find_mapped(self, fields: list[str], wanted: mapping.Columns) -> list[list[float]]:
        """Find the user's columns in a header, or by number in a first row; return that row's sample, if it is one."""
        is_row = any(map(is_number, fields))
        try:
            names = list(map(str, range(1, len(fields) + 1))) if is_row else fields
            columns = _place_columns(wanted, names, self._rate_hz, self.name)
        except FormatError as error:
            self._problem = self._problem if is_row and self._problem else error
            return []
        self._use(columns, None if is_row else fields)
        return self._read_row(fields, columns) if is_row else []

    # --- rows, and further headers -----------------------------------------------------------------------------------

    def _read_row(self, fields: list[str], columns: Columns) -> list[list[float]]:
        """Return the one sample (11 numbers, SI) of a row; none of a repeated header, and of what is no row."""
        width = len(columns.names)
        if len(fields) == width + 1 and not fields[-1]:
            fields.pop()  # a separator at the end of the row
        problem = f"it has {len(fields)} fields and the header {width}"
        if self._is_foreign:
            problem = "it follows a header that names other columns"
        elif len(fields) == width:
            try:
                row = [
                    float(fields[i]) * unit if i >= 0 and fields[i] else np.nan
                    for i, unit in zip(self._positions, columns.units, strict=True)
                ]
            except ValueError:
                problem = "a field is not a number"
            else:
                if columns.rate_hz:
                    row[0] = self._counted / columns.rate_hz
                    self._counted += 1
                return [row]
        names = fields if fields[-1] else fields[:-1]  # a separator at the end
        if not OWN.isdisjoint(names) or is_header(names):
            problem = self._read_names(names, columns)
        if problem:
            self._leave_out(problem)
        return []

    def _read_names(self, fields: list[str], before: Columns) -> str:
        """Use a header behind the first one, or behind a resume; return why not, "" where the order stays."""
        is_own, why = not OWN.isdisjoint(fields), "it names other columns"
        columns, wanted = None, self._mapping
        try:
            if is_own:
                columns = _name_columns(fields)
                self._use(columns, columns.names)
            elif wanted is not None and not all(word.isdigit() for words in wanted.words.values() for word in words):
                columns = _place_columns(wanted, fields, self._rate_hz, self.name)  # numbers would fit any header
                self._use(columns, fields)
        except FormatError as error:
            columns, why = None, f"it is no header ({str(error).partition(':')[0]})" if is_own else why
        if columns is not None:
            if not self._is_confirmed and set(MAG).isdisjoint(fields) != set(MAG).isdisjoint(before.names):
                raise FormatError(f"{self.name} names other columns than before the walk resumed: begin another walk.")
            self._is_confirmed = True
            return ""
        # Behind one of other names rows are left out, unless it is damaged or has no end.
        self._names = known = self._names or tuple(fields)
        if len(fields) >= len(before.names):
            is_known = len(fields) == len(known) and sum(map(str.__ne__, fields, known)) <= 1
            if not is_known and not self._is_foreign:
                self.remark(
                    f"the header in line {self._line} of {self.name} names other columns "
                    f"({mapping.shorten_names(fields, 12)}): rows are left out until one names those of before."
                )
            self._is_foreign = not is_known
        return why if is_own or self._is_foreign else ""

    def _use(self, columns: Columns, names: Sequence[str] | None = None) -> None:
        """Set the columns of the rows, and the names of the header that they are from."""
        place = Path(self.name)
        others = (names for names in (MAG, PRESSURE) if not set(names).isdisjoint(columns.names))
        wanted = (() if columns.rate_hz else TIME) + ACC + GYR + sum(others, ())
        self._positions = [find_column(name, columns.names, place) if name in wanted else -1 for name in CANONICAL]
        self._columns, self._is_foreign = columns, False
        self._names = self._names if names is None else tuple(names)

    def _leave_out(self, why: str) -> None:
        """Count a bad line, and name the first one."""
        if self.bad == 0:
            self.remark(f"rows that cannot be read are left out, the first in line {self._line}: {why}.")
        self.bad += 1
        self._counted += 1


def _name_columns(names: Sequence[str]) -> Columns:
    """Columns of a canonical header; pressure may be in hPa."""
    hpa = f"{PRESSURE[0][:-2]}hpa"
    if hpa not in names or PRESSURE[0] in names:
        return Columns(tuple(names))
    return Columns(tuple(PRESSURE[0] if name == hpa else name for name in names), (*[1.0] * (COLUMNS - 1), 100.0))


def is_header(names: Sequence[str]) -> bool:
    """Whether a line is made of names: as many as a sample has, all different, text, and no number among them."""
    return len(set(names)) == len(names) >= MIN_NAMES and all(
        name.isprintable() and "\ufffd" not in name and any(map(str.isalpha, name)) and not is_number(name)
        for name in names
    )


def is_number(field: str) -> bool:
    """Return whether a field is a number, NaN included."""
    try:
        float(field)
    except ValueError:
        return False
    return True
