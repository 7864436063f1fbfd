"""Samples in the text of a stream: lines of fields with commas between; a header or the user names the columns.

    Columns    which field is what, in which unit; `parse_columns` makes them of the user's words
    RowReader  bytes in pieces of any length -> samples (n, 11): t, acc, gyr, mag, pressure in s, m/s^2, rad/s, uT, Pa

A block of lines is parsed column by column; where that fails, line by line, and the first bad line is named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd

from fg_nav.arrays import Floats
from fg_nav.columns import mapping
from fg_nav.columns.headers import find_factor
from fg_nav.columns.mapping import ACC, CANONICAL, GYR, MAG, PASSED_OVER, PRESSURE, TIME
from fg_nav.columns.samples import SI_UNITS
from fg_nav.errors import FormatError, StreamError
from fg_nav.io.tables import find_column, scale_values
from fg_nav.recording import NOMINAL_SIGMA
from fg_nav.samples.plausibility import find_unit_problems, keep_air
from fg_nav.samples.readings import COLUMNS

MAX_LINE = 1 << 16  # bytes; a longer line has lost its end
MIN_BLOCK = 200  # lines; fewer are read faster one by one
MIN_NAMES = 6  # of a header, force and rate; fewer words are a message of the device
LINES_TO_REMARK = 20  # before the header; fewer were left in a device's buffer
MAX_BEFORE_HEADER = 5000  # lines; some senders repeat their header every second
HEADLESS, MIN_HEADLESS = 400, 100  # rows by which physics shows canonical order in SI; fewer at the end of the source
PLAIN = b"0123456789+-.eE,\n"  # characters of numbers that every parser reads alike
HINT = f"a line must name the columns ({TIME[0]},{ACC[0]},...), or --columns; --speed replays a whole recording"


@dataclass(frozen=True)
class Columns:
    """The columns of rows without a canonical header."""

    names: tuple[str, ...]  # Of all fields of a row, in order; those that are not in `CANONICAL` are skipped.
    units: tuple[float, ...] = (1.0,) * COLUMNS  # (11,) factors of the fields.
    rate_hz: float | None = None  # Of rows without a stamp, whose stamps are counted by it; None where they have one.
    mapping: str | None = None  # The user's words, where they name columns of a header to come, or numbers of fields.

    @property
    def rate_sigma(self) -> float:
        """Relative sigma of the nominal rate by which stamps are counted; 0 where rows have stamps."""
        return 0.0 if self.rate_hz is None else NOMINAL_SIGMA


def parse_columns(words: str | None, units: str | None = None, rate_hz: float | None = None) -> Columns | None:
    """Return the columns that the user names, in the grammar of `fg_nav.columns.mapping`; None without.

    Raises `StreamError` if a column is missing, doubled or unknown, or a unit is.
    """
    if words is None:
        for value, option in ((units, "--units"), (rate_hz, "--rate")):
            if value is not None:
                raise StreamError(f"{option} is for rows without a header: name their --columns too, or leave it out.")
        return None
    try:
        wanted = mapping.parse_columns(words, units)
    except FormatError as error:
        raise StreamError(str(error)) from None
    missing = [quantity for quantity in ("acc", "gyr") if quantity not in wanted.words]
    if missing:
        raise StreamError(f"--columns lacks {missing[0]}: write it as {mapping.EXAMPLE}.")
    if rate_hz is not None and not 0.0 < rate_hz < np.inf:
        raise StreamError(f"--rate {rate_hz:g} is no rate: give samples a second.")
    if "time" not in wanted.words and rate_hz is None:
        raise StreamError("--columns has no time: name it, or give the --rate by which stamps are counted.")
    if "time" in wanted.words and rate_hz is not None:
        raise StreamError("--rate is for rows without a stamp, and --columns names one: leave one of them out.")
    if wanted.width is None:
        return Columns((), rate_hz=rate_hz, mapping=words)
    return _place_columns(wanted, [str(k + 1) for k in range(wanted.width)], rate_hz, "--columns")


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
    """Parses bytes, in pieces of any length, into samples (n, 11).

    Without `columns` the first line that names canonical columns is the header, or the end of one if the source began
    before; where it was lost, rows of 7, 10 or 11 numbers are in canonical order if units and axes are then those of a
    sensor, and all of them are kept. Then each line is a row. One that has another number of fields, or a field that is
    no number, is left out and counted in `bad`; an empty field is NaN. The last line waits for its end.

    A line that names columns again is a header too: the rows behind it are in its order, in the units of its names.
    Behind one of other names, as where a sensor restarts with other software, rows are left out until one names those
    of before again. Where only its end is missing, or one name is damaged, the order stays.

    Raises `FormatError` from `read`, if no header comes, or the first one lacks a column, or names others than before
    the walk resumed.

    Parameters
    ----------
    name : of the source, for messages.
    remark : called with a sentence about the first bad row.
    columns : of rows without a header; None where the source must send one.
    """

    def __init__(
        self, name: str, remark: Callable[[str], None] = lambda words: None, columns: Columns | None = None
    ) -> None:
        self.bad = 0
        self._name, self._remark = name, remark
        # the unfinished line; lines read, stamps counted by the rate, lines before the header
        self._rest, self._is_too_long = b"", False
        self._line = self._counted = self._waited = 0
        # the order of the fields, the names of the header it is from, and whether the newest header has other names
        self._columns: Columns | None = None
        self._names: tuple[str, ...] | None = None
        self._positions: list[int] = []
        self._is_foreign, self._is_confirmed = False, True
        self._cut_header: FormatError | None = None
        # rows without a header, and their samples once their order is clear
        self._headless: list[list[str]] = []
        self._cut_names: tuple[str, ...] = ()
        self._released: list[list[float]] = []
        self._wanted = columns
        if columns is not None and columns.mapping is None:
            self._use(columns)

    def resume(self, header: Sequence[str]) -> None:
        """Use the header from before an interruption.

        A source that begins again sends it again, and it must name the same columns, in any order.
        """
        if self._columns is None and self._wanted is None:
            self._use(Columns(tuple(header)), header)
            self._is_confirmed = False

    @property
    def header(self) -> list[str] | None:
        """Names of the columns; None before they are known."""
        return None if self._columns is None else list(self._columns.names)

    def read(self, piece: bytes, away_s: float = 0.0) -> Floats:
        """Return the samples (n, 11) whose rows end in this piece: t, acc, gyr, mag, pressure (NaN without one).

        `away_s` is how long the source was not connected before the piece: a row that was cut off then is left out, and
        counted stamps go on behind it.
        """
        if away_s > 0.0:
            self._rest, self._is_too_long = b"", False
            rate_hz = None if self._columns is None else self._columns.rate_hz
            self._counted += round(away_s * (rate_hz or 0.0))
        if self._is_too_long:
            _, end, piece = piece.partition(b"\n")
            self._is_too_long = not end
        *lines, self._rest = (self._rest + piece).split(b"\n")
        rows = self._read_block(lines)
        if rows is None:
            found = [row for line in lines if (row := self._read_line(line)) is not None]
            rows = np.array([*self._released, *found], dtype=np.float64).reshape(-1, COLUMNS)
            self._released = []
        if len(self._rest) > MAX_LINE:
            self._line += 1
            self._leave_out(f"it is longer than {MAX_LINE} bytes")
            self._rest, self._is_too_long = b"", True
        return rows

    def finish(self, is_cut: bool = False) -> Floats:
        """Return the sample of a last line without an end, (0, 11) or (1, 11); none of a line `is_cut` by a signal.

        Raises `FormatError` if no header came.
        """
        rows = self.read(b"\n") if self._rest and not is_cut else np.empty((0, COLUMNS))
        if self._columns is None and len(self._headless) >= MIN_HEADLESS and self._take_headless():
            rows = np.array(self._released, dtype=np.float64)
        if self._columns is None:
            raise self._cut_header or FormatError(f"{self._name} ended before a header came: {HINT}.")
        return rows

    def _read_block(self, lines: list[bytes]) -> Floats | None:
        """Return the samples of lines that are plain rows, headers or empty; None if one is not, or they are few."""
        columns = self._columns
        if columns is None or self._is_foreign or len(lines) < MIN_BLOCK:
            return None
        # only characters of plain numbers, and the same number of fields in each line
        header, width = ",".join(columns.names).encode(), len(columns.names)
        filled = [line for line in (line.rstrip(b"\r") for line in lines) if line and line != header]
        text = b"\n".join(filled)
        if text.translate(None, PLAIN) or any(line.count(b",") != width - 1 for line in filled):
            return None
        fields = np.empty((0, width))
        if text:
            try:
                frame = pd.read_csv(
                    BytesIO(text), header=None, names=range(width), dtype=np.float64, skip_blank_lines=False
                )
            except (ValueError, OverflowError):
                return None
            fields = np.asarray(frame.to_numpy(dtype=np.float64))
        if len(fields) != len(filled):
            return None
        # in canonical order and units
        self._line += len(lines)
        table = np.full((len(fields), COLUMNS), np.nan)
        for k, position in enumerate(self._positions):
            if position >= 0:
                table[:, k] = scale_values(fields[:, position], columns.units[k])
        if columns.rate_hz:
            table[:, 0] = self._count_stamps(len(table), columns.rate_hz)
        return table

    def _read_line(self, line: bytes) -> list[float] | None:
        """Return the sample (11 numbers, SI) of a line; None for a header, and for what is no row."""
        self._line += 1
        if len(line) > MAX_LINE:
            self._leave_out(f"it is longer than {MAX_LINE} bytes")
            return None
        fields = [field.strip() for field in line.decode("utf-8", "replace").strip("\ufeff\r\n ").split(",")]
        if fields == [""]:
            return None
        if self._columns is not None:
            return self._read_row(fields, self._columns)
        if self._wanted is not None and self._wanted.mapping is not None:
            return self._find_mapped(fields, self._wanted)
        self._find_header(fields)
        return None

    def _find_header(self, fields: list[str]) -> None:
        """Use the first header; keep rows before it, which may be canonical themselves."""
        if not set(CANONICAL[:7]).isdisjoint(fields):
            try:
                self._use(columns := _name_columns(fields), columns.names)
                return
            except FormatError as error:
                if self._line > 1:
                    raise
                # of the first line the beginning may be cut off
                self._cut_header = error
                ends = (CANONICAL[:width] for width in (7, 10, 11))
                self._cut_names = next((names for names in ends if ",".join(names).endswith(",".join(fields))), ())
        known = len(self._headless[0]) if self._headless else 0
        is_row = len(fields) in (7, 10, 11) and all(not field or is_number(field) for field in fields)
        if is_row and len(fields) >= known:  # a shorter one was cut
            self._headless = [*(self._headless if len(fields) == known else []), fields]
            is_known = len(fields) == len(self._cut_names)
            if (is_known or len(self._headless) == HEADLESS) and not self._take_headless(is_known):
                self._headless = []
        if self._columns is None:
            self._count_waiting()

    def _take_headless(self, is_known: bool = False) -> bool:
        """Read the headless rows in canonical order, if `is_known` or their values are plausible; return whether so."""
        width = len(self._headless[0])
        if not is_known:
            table = np.array([[float(field or "nan") for field in fields] for fields in self._headless])
            mag = table[:, 7:10] if width > 7 else None
            is_no_air = width == 11 and keep_air(table[:, 10]) is None
            problems = find_unit_problems(table[:, 0], table[:, 1:4], table[:, 4:7], mag)
            if problems or is_no_air or (np.diff(table[:, 0]) <= 0).any():
                return False
        columns = Columns(CANONICAL[:width])
        self._use(columns, columns.names)
        self._released = [row for fields in self._headless if (row := self._read_row(fields, columns)) is not None]
        self._remark(
            f"no header came from {self._name}: its {width} fields are taken for {','.join(columns.names)}, in SI."
        )
        return True

    def _find_mapped(self, fields: list[str], given: Columns) -> list[float] | None:
        """Find the user's columns in a header, or by number in a first row; return that row's sample, else None."""
        wanted = mapping.parse_columns(given.mapping or "")
        is_row = any(map(is_number, fields))
        try:
            names = [str(k + 1) for k in range(len(fields))] if is_row else fields
            columns = _place_columns(wanted, names, given.rate_hz, self._name)
        except FormatError as error:
            self._cut_header = self._cut_header if is_row and self._cut_header else error
            self._count_waiting()
            return None
        self._use(columns, None if is_row else fields)
        return self._read_row(fields, columns) if is_row else None

    def _count_waiting(self) -> None:
        """Count a line before the header."""
        self._waited += 1
        if self._waited == LINES_TO_REMARK:
            if self._cut_header is not None:
                raise self._cut_header
            self._remark(f"no header yet from {self._name}, and rows before it are left out: {HINT}.")
        if self._waited > MAX_BEFORE_HEADER:
            raise FormatError(f"{self._name} sends no header: {HINT}.")

    def _read_row(self, fields: list[str], columns: Columns) -> list[float] | None:
        """Return the sample (11 numbers, SI) of a row; None for a repeated header, and for what is no row."""
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
                return [*self._count_stamps(1, columns.rate_hz), *row[1:]] if columns.rate_hz else row
            except ValueError:
                problem = "a field is not a number"
        if not set(CANONICAL[:7]).isdisjoint(fields):
            problem = self._use_header_again(fields, columns)
        elif is_header(fields):
            problem = self._use_own_header(fields)
        if problem:
            self._leave_out(problem)
        return None

    def _count_stamps(self, n: int, rate_hz: float) -> Floats:
        """Return the stamps (n,) s of the next rows of a sender that gives none."""
        self._counted += n
        return np.arange(self._counted - n, self._counted) / rate_hz

    def _use_header_again(self, fields: list[str], before: Columns) -> str:
        """Use a canonical header behind the first one, or behind a resume; return why not, if it lacks columns."""
        try:
            self._use(columns := _name_columns(fields), columns.names)
        except FormatError as error:
            self._leave_out_foreign(fields)
            return f"it is no header ({str(error).partition(':')[0]})"
        if not self._is_confirmed and set(MAG).isdisjoint(fields) != set(MAG).isdisjoint(before.names):
            raise FormatError(f"{self._name} names other columns than before the walk resumed: begin another walk.")
        self._is_confirmed = True
        return ""

    def _use_own_header(self, fields: list[str]) -> str:
        """Switch to a header in the sender's own names if the mapping fits it; else return why not, "" for a repeat."""
        if self._wanted is not None and self._wanted.mapping is not None:
            with suppress(FormatError):
                wanted = mapping.parse_columns(self._wanted.mapping)
                columns = _place_columns(wanted, fields, self._wanted.rate_hz, self._name)
                if not all(
                    word.isdigit() for words in wanted.words.values() for word in words
                ):  # column numbers fit any header
                    self._use(columns, fields)
                    return ""
        if self._names is None:
            self._names = tuple(fields)
        self._leave_out_foreign(fields)
        return "it names other columns" if self._is_foreign else ""

    def _leave_out_foreign(self, fields: list[str]) -> None:
        """Leave out the rows behind a header of other names, unless it is damaged or has no end."""
        known = self._names
        if known is None or (self._columns is not None and len(fields) < len(self._columns.names)):
            return
        fields = fields if fields[-1] else fields[:-1]
        is_known = len(fields) == len(known) and sum(map(str.__ne__, fields, known)) <= 1
        if not is_known and not self._is_foreign:
            self._remark(
                f"the header in line {self._line} of {self._name} names other columns "
                f"({mapping.shorten_names(fields, 12)}): rows are left out until one names those of before."
            )
        self._is_foreign = not is_known

    def _use(self, columns: Columns, names: Sequence[str] | None = None) -> None:
        """Set the columns of the rows, and the names of the header that they are from."""
        place = Path(self._name)
        others = (names for names in (MAG, PRESSURE) if not set(names).isdisjoint(columns.names))
        wanted = (() if columns.rate_hz else TIME) + ACC + GYR + sum(others, ())
        self._positions = [find_column(name, columns.names, place) if name in wanted else -1 for name in CANONICAL]
        self._columns, self._is_foreign = columns, False
        self._names = self._names if names is None else tuple(names)

    def _leave_out(self, why: str) -> None:
        """Count a bad line, and name the first one."""
        if self.bad == 0:
            self._remark(f"rows that cannot be read are left out, the first in line {self._line}: {why}.")
        self.bad += 1
        self._counted += 1


def _name_columns(fields: list[str]) -> Columns:
    """Columns of a canonical header, without the empty name behind a separator at its end; pressure may be in hPa."""
    names = fields if fields[-1] else fields[:-1]
    hpa = f"{PRESSURE[0][:-2]}hpa"
    if hpa not in names or PRESSURE[0] in names:
        return Columns(tuple(names))
    return Columns(tuple(PRESSURE[0] if name == hpa else name for name in names), (*[1.0] * (COLUMNS - 1), 100.0))


def is_header(fields: list[str]) -> bool:
    """Whether a line is made of names: as many as a sample has, all different, text, and no number among them."""
    names = fields if fields[-1] else fields[:-1]
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
