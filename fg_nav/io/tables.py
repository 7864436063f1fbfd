"""Tables in files of any kind (docs/formats.md): the names of their columns, and columns as floats at C speed.

Of a text with a known header (`find_header`) a line `sep=;` names the separator, as spreadsheets have it; else it is
the character of tab, semicolon and comma that is most often in the header, or a blank.

Of any other text (`open_table`) the first long run of lines with as many numbers each is the data; separator and
decimal sign are those by which most of its fields are numbers. What stands right above it with as many fields is the
header, in one or more rows.

Lines are counted from 1 as in an editor. Empty fields are NaN; wholly empty lines are left out.
"""

from __future__ import annotations

import io
import json
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.headers import find_quantity, read_header
from fg_nav.columns.samples import to_floats
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, explain_library, split_fields, split_lines

PARQUET_MARK, ZIP_MARK, NPY_MARK, HDF5_MARK = b"PAR1", b"PK\x03\x04", b"\x93NUMPY", b"\x89HDF"

MIN_NUMBERS = 6  # Columns of numbers that a table of force and rate has at least.
_MAX_TOP = 200  # Lines above the data.
_JUDGED = 40  # Lines of data from which the layout is found.
_MAX_HEADER_ROWS = 4
_MAX_LINES = 60  # Lines searched for a known header; the longest block of lines about a session is a third of this.

_SAID = re.compile(r'^"?sep=(\\t|.)"?', re.IGNORECASE)
_COMMA, _POINT = re.compile(r"\d,\d"), re.compile(r"\d\.\d")
_COMMENTS = ("#", "%", "//", "!", '"#')
_SEPARATORS = ("\t", ";", ",", r"\s+", "|")
_WAYS = tuple((separator, decimal) for separator in _SEPARATORS for decimal in ".," if separator != decimal)

_DATE = re.compile(r"\d{4}[-/.]\d\d?[-/.]\d\d?(?:[ T]\d\d?:\d\d(?::\d\d(?:[.,]\d*)?)?(?:Z|[+-]\d\d:?\d\d)?)?\s*$")
"""Of year, month and day, with a time of day or without: other orders leave month and day open."""

_CLOCK = re.compile(r"(?:^|[ T])(?P<h>\d\d?):(?P<m>\d\d):(?P<s>\d\d)(?:[.,:](?P<f>\d+))?\s*(?P<p>[AaPp]\.?[Mm])?")
"""A time of day, whatever date stands before it."""

_DAY_S = 86400.0

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
_EMPTY = frozenset({"", "nan", "NaN", "NAN", "inf", "-inf", "+nan", "null", "NULL", "NA", "n/a", "N/A", "-nan", "None"})

_split_row = partial(split_fields, skip_blanks=True)

BLOCK_ROWS = 1 << 19  # Parsed at once: a whole table takes the parser four times its memory; less scatters on the heap.

Arrays: TypeAlias = Mapping[str, np.ndarray[Any, Any]]


@dataclass(frozen=True)
class TextTable:
    """A table of text."""

    content: Content
    names: Sequence[str]  # (C,) of all columns; numbers from 1 where it has no header
    first_line: int = 2  # of the data, from 1
    separator: str = ","  # one character, or the regular expression of blanks
    decimal: str = "."
    comment: str | None = None  # what begins one, up to the end of its line
    has_header: bool = True

    def __contains__(self, name: object) -> bool:
        return name in self.names

    @property
    def line(self) -> int:
        """Line of the header that is right above the data, from 0."""
        return self.first_line - 2

    @property
    def options(self) -> dict[str, Any]:
        """How pandas reads the rows: with one name more than the header, for a separator at their end."""
        return {
            "header": None, "names": range(len(self.names) + 1), "index_col": False, "skiprows": self.first_line - 1,
            "sep": self.separator, "skip_blank_lines": False, "engine": "c", "low_memory": False,
            "encoding": "utf-8", "encoding_errors": "replace", "na_values": ["+nan", "+NaN", "NAN"],
            "compression": None, "comment": self.comment,
        }  # fmt: skip

    def read_columns(self, names: Sequence[str]) -> tuple[Floats, Ints]:
        """Read columns of numbers (N, K) by name and the line (N,) of each row."""
        return self.read_numbers([find_column(name, self.names, self.content.path) for name in names])

    def read_numbers(self, positions: Sequence[int]) -> tuple[Floats, Ints]:
        """Read columns of numbers (N, K) and the line (N,) of each row."""
        # One column more than the header has: a separator may end each row, and a field too many shows.
        wanted, name = [*positions, len(self.names)], self.content.path.name
        blocks = list[Floats]()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", pd.errors.ParserWarning)  # of fields it leaves out
                how = self.options | {"decimal": self.decimal, "dtype": dict.fromkeys(wanted, np.float64)}
                with pd.read_csv(self.content.source(), chunksize=BLOCK_ROWS, **how) as frames:
                    blocks += (frame[wanted].to_numpy(dtype=np.float64) for frame in frames)
        except pd.errors.EmptyDataError:
            pass
        except (pd.errors.ParserWarning, pd.errors.ParserError) as error:
            reason = " ".join(str(error).removeprefix("Error tokenizing data. C error: ").split())
            raise FormatError(f"{name} is not a regular table ({reason}): correct that line.") from None
        except (ValueError, OverflowError):
            raise self._find_bad_cell(wanted) from None
        values = np.concatenate([np.zeros((0, len(wanted))), *blocks])
        longer, filled = ~np.isnan(values[:, -1]), ~np.isnan(values).all(axis=1)
        if longer.any():
            number = self.first_line + int(np.argmax(longer))
            raise FormatError(f"{name}, line {number} has more fields than the header: correct that line.")
        if not filled.any():
            raise FormatError(f"{name} has a header but no samples: record or export it again.")
        return np.ascontiguousarray(values[filled, :-1]), self.first_line + np.flatnonzero(filled)

    def _find_bad_cell(self, wanted: Sequence[int]) -> FormatError:
        """Find the first field that is no number. Slow, but only ever run on a broken file."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pd.errors.ParserWarning)
            text = pd.read_csv(self.content.source(), dtype=str, **self.options)[wanted]
        numbers = text.apply(lambda cells: pd.to_numeric(cells.str.replace(self.decimal, "."), errors="coerce"))
        bad, name = np.argwhere((numbers.isna() & text.notna()).to_numpy()), self.content.path.name
        if not len(bad):
            return FormatError(f"{name} does not read as numbers: look for odd characters in an editor.")
        row, column = bad[0]
        cell, called = str(text.iat[row, column])[:40], [*self.names, "after the last"][wanted[column]]
        where = f"{name}, line {row + self.first_line}, column '{called}'"
        return FormatError(f"{where}: {cell!r} is not a number; correct or delete that line.")

    def _read_column(self, position: int, row: Ints, type: type[str] | type[np.int64]) -> Any:
        how = self.options | {"usecols": [position], "names": None, "dtype": {position: type}}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of an infinite number, which is then raised
            return pd.read_csv(self.content.source(), **how)[position].iloc[row - self.first_line]

    def read_integers(self, name: str, row: Ints) -> Ints | None:
        """Read one column exactly at the lines (N,) `row`; None if one of its numbers is no whole one of 64 bits."""
        position = find_column(name, self.names, self.content.path)
        try:
            return np.asarray(self._read_column(position, row, np.int64), dtype=np.int64)
        except (ValueError, TypeError, OverflowError, IndexError):  # those of pandas are ValueError
            return None

    def read_words(self, position: int, row: Ints) -> NDArray[np.object_]:
        """Read a column as text in the lines (N,) `row`, None where a field is empty; `FormatError` if it cannot be."""
        try:
            words = self._read_column(position, row, str).str.strip()
        except (ValueError, IndexError):
            name = self.names[position]
            raise FormatError(f"{self.content.path.name}: column '{name}' cannot be read: export it again.") from None
        return np.asarray(words.replace({np.nan: None}), dtype=object)

    def read(self, positions: Sequence[int]) -> tuple[Floats, Ints]:
        """Read columns of numbers, dates and times of day (N, K), the latter in s, and the line (N,) of each row."""
        # columns most of whose first fields are dates (True), or times of day
        lines = self.content.lines[self.first_line - 1 :][:_JUDGED]
        rows, clocks = [_split_row(line, self.separator) for line in lines], dict[int, bool]()
        for position in positions:
            fields = [row[position] for row in rows if len(row) > position]
            for is_date, words in ((True, _DATE), (False, _CLOCK)):
                if sum(bool(words.search(field)) for field in fields) * 2 > len(rows):
                    clocks.setdefault(position, is_date)
        # numbers, then these
        values, row = self.read_numbers([position for position in positions if position not in clocks])
        for place, position in enumerate(positions):
            if position in clocks:
                text = self.read_words(position, row)
                values = np.insert(values, place, (_read_dates if clocks[position] else _read_times)(text), axis=1)
        if self.comment is None:
            return values, row
        # lines of comments alone are not among the rows
        all_lines = split_lines(self.content.read_text())
        kept = [n for n, line in enumerate(all_lines, 1) if n >= self.first_line and not line.startswith(self.comment)]
        return values, np.array([*kept, len(all_lines)])[np.minimum(row - self.first_line, len(kept))]


def find_header(content: Content, is_header: Callable[[list[str]], bool]) -> TextTable | None:
    """Return the table below the first line whose fields `is_header` accepts; None without."""
    said = _SAID.match(content.lines[0]) if content.lines else None
    for line, text in enumerate(content.lines[:_MAX_LINES]):
        separator = said[1].replace("\\t", "\t") if said else guess_separator(text)
        names = split_fields(text, separator)
        if is_header(names):
            below = "\n".join(content.lines[line + 1 : line + 10])
            has_comma = separator != "," and len(_COMMA.findall(below)) > len(_POINT.findall(below))
            return TextTable(content, names, line + 2, separator, "," if has_comma else ".")
    return None


def guess_separator(line: str) -> str:
    """Guess what separates the fields of a line."""
    best = max("\t;,", key=line.count)
    return best if best in line else " "


def has_rows(content: Content) -> bool:
    """Whether there is more than a header: apps write that alone for a sensor which a phone does not have."""
    return sum(bool(line.strip()) for line in content.lines[:_MAX_LINES]) > 1


def find_column(name: str, header: Sequence[str], path: Path) -> int:
    """Index of the one column of this name; raises `FormatError` if there is none, or more than one."""
    count = list(header).count(name)
    if count == 0:
        raise FormatError(f"{path.name} has no column '{name}': export the recording again with it.")
    if count > 1:
        raise FormatError(f"{path.name} has {count} columns '{name}': keep one of them.")
    return list(header).index(name)


@dataclass(frozen=True)
class ArrayTable:
    """Columns (N,) in memory, by name; rows are counted from 1."""

    source: str
    names: Sequence[str]
    columns: Sequence[np.ndarray[Any, Any]]
    has_header: bool = True

    def read(self, positions: Sequence[int]) -> tuple[Floats, Ints]:
        """Return columns (N, K) and rows (N,) from 1; raises `FormatError` for what is no number."""
        values = [to_floats(self.columns[position], self.names[position], self.source) for position in positions]
        return np.column_stack(values), np.arange(1, len(self.columns[0]) + 1)

    def read_words(self, position: int, row: Ints) -> NDArray[np.object_]:
        """Return a column as text, in the rows (N,) `row`."""
        return self.columns[position][row - 1].astype(str).astype(object)


Table: TypeAlias = TextTable | ArrayTable


def open_table(content: Content, min_numbers: int = MIN_NUMBERS) -> Table | None:
    """Return the content as a table; None if it is none, or text with fewer than `min_numbers` numbers in a row.

    It is opened once, however often it is asked for.
    """
    first = content.lines[0].lstrip()[:1] if content.lines else ""
    key = min_numbers if content.lines and first not in ("{", "[") else 0
    if key not in content.opened:
        content.opened[key] = _open(content, min_numbers)
    opened: Table | None = content.opened[key]
    return opened


def _open(content: Content, min_numbers: int) -> Table | None:
    head, name = content.head, content.path.name
    if head.startswith(PARQUET_MARK):
        with explain_library(name, "a Parquet file", "pyarrow", "parquet"):
            import pyarrow.parquet

            frame = pyarrow.parquet.read_table(content.source()).to_pandas()
        frame = frame.reset_index() if any(frame.index.names) else frame
        return open_arrays({str(column): frame[column].to_numpy() for column in frame.columns}, name)
    if head.startswith(NPY_MARK):
        array = _load_numpy(content, "npy")["npy"]
        if array.dtype.names:
            return open_arrays({key: array[key] for key in array.dtype.names}, name)
        if array.ndim == 2:
            columns = {str(k + 1): column for k, column in enumerate(array.T)}
            return replace(open_arrays(columns, name), has_header=False)
        raise FormatError(f"{name} holds an array of shape {array.shape}: save one of (N, 7), or names its columns.")
    if head.startswith(HDF5_MARK):
        return _open_hdf5(content)
    if head.startswith(ZIP_MARK):
        if any(place.startswith(("xl/", "worksheets/")) for place in content.members):
            return _open_sheet(content)
        are_arrays = content.members and all(place.endswith(".npy") for place in content.members)
        return open_arrays(_load_numpy(content, "npz"), name) if are_arrays else None
    if content.variables:
        arrays = {key: value for key, value in content.load_variables().items() if value is not None}
        return open_arrays({key: value.squeeze() for key, value in arrays.items()}, name)
    if content.lines and content.lines[0].lstrip()[:1] in ("{", "["):
        return _open_json(content)
    return _open_text(content, min_numbers) if content.lines else None


def _open_text(content: Content, min_numbers: int) -> TextTable | None:
    lines = content.lines
    # the first line that has, with the next two, enough numbers by the same separator
    start = None
    for k in range(min(len(lines), _MAX_TOP)):
        block = [line for line in lines[k : k + 6] if line.strip() and not _is_comment(line)][:3]
        if len(block) < 2 or not lines[k].strip() or _is_comment(lines[k]):
            continue
        if any(all(_count_numbers(_split_row(line, s), d) >= min_numbers for line in block) for s, d in _WAYS):
            start = k
            break
    if start is None:
        return None
    data = [line for line in lines[start : start + _JUDGED] if line.strip() and not _is_comment(line)]
    separator, decimal = max(_WAYS, key=lambda way: _score(data, way[0], way[1], min_numbers))
    widths = [len(_split_row(line, separator)) for line in data]
    width = max(set(widths), key=widths.count)
    names = _read_names(lines[:start], separator, width)
    comment = "#" if any("#" in line for line in lines[start:]) else None
    numbered = tuple(str(k + 1) for k in range(width))
    return TextTable(content, tuple(names or numbered), start + 1, separator, decimal, comment, names is not None)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _count_numbers(fields: Sequence[str], decimal: str) -> int:
    """Count the fields that are numbers."""
    if decimal == ",":
        whole = [field for field in fields if "." not in field and not field.endswith(",")]
        fields = [field.replace(",", ".", 1) for field in whole]
    return sum(bool(_NUMBER.match(field)) for field in fields)


def _score(data: Sequence[str], separator: str, decimal: str, min_numbers: int) -> tuple[float, float]:
    """How well the lines split: the share of lines of enough numbers, and that of fields that are numbers or empty."""
    rows = [_split_row(line, separator) for line in data]
    counts = [_count_numbers(row, decimal) for row in rows]
    enough = sum(count >= min_numbers for count in counts) / len(rows)
    known = sum(count + sum(field in _EMPTY for field in row) for row, count in zip(rows, counts, strict=True))
    return round(enough, 1), known / max(1, sum(map(len, rows)))


def _read_names(above: Sequence[str], separator: str, width: int) -> list[str] | None:
    """Return the `width` column names from the header rows right above the data; None if there are none."""
    rows = list[list[str]]()
    for line in reversed(above):
        if not line.strip():
            if rows:
                break
            continue
        text = re.sub(r"^[\s#%/!\"]+", "", line) if _is_comment(line) else line
        splits = (_split_row(text, way) for way in (separator, *_SEPARATORS))
        fit = (f for f in splits if abs(len(f) - width) <= 1 and _count_numbers(f, ".") * 2 < width and any(f))
        fields = next(fit, None)
        if fields is None or len(rows) == _MAX_HEADER_ROWS:
            break
        rows.insert(0, fields + [""] * (width - len(fields)))
    return _join_rows(rows) if rows else None


def _join_rows(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return one name per column, `name [unit]`, from the header rows above the data."""
    width = max(map(len, rows))
    filled = [[*row, *[""] * (width - len(row))] for row in rows]
    units = None
    for row in filled[1:]:  # the first of which most words are units
        words = [word for word in row if word]
        if units is None and words and sum(find_quantity(word) is not None for word in words) * 2 > len(words):
            units = row
    named = [row for row in filled if row is not units]
    if len(named) > 1:  # a name above the first of several columns is that of all
        for row in named:
            for k in range(1, width):
                row[k] = row[k] or row[k - 1]
        joined = [" ".join(words) for words in zip(*named, strict=True)]
        if _count_axes(named[-1]) >= _count_axes(joined) and len(set(named[-1])) == len(named[-1]):
            named = named[-1:]
    names = [" ".join(dict.fromkeys(word for word in words if word)) for words in zip(*named, strict=True)]
    if units is None:
        return names
    return [f"{name} [{unit}]" if find_quantity(unit) else name for name, unit in zip(names, units, strict=True)]


def _count_axes(names: Sequence[str]) -> int:
    return sum(meaning is not None and meaning.axis != "" for meaning in map(read_header, names))


def _read_dates(text: NDArray[np.object_]) -> Floats:
    """Dates as s since 1970, NaN where there is none."""
    words = pd.Series(text, dtype=object).str.replace("/", "-")
    dates = pd.to_datetime(words, errors="coerce", utc=True, format="ISO8601")
    other = dates.isna() & words.notna()
    if other.any():  # each by itself, which is slow
        dates[other] = pd.to_datetime(words[other], errors="coerce", utc=True, format="mixed", dayfirst=False)
    stamps = dates.to_numpy(dtype="datetime64[ns]")
    return np.where(np.isnat(stamps), np.nan, stamps.astype(np.int64) * 1e-9)


def _read_times(text: NDArray[np.object_]) -> Floats:
    """Return times of day (N,) in s, continued over midnight; NaN where there is none."""
    parts = pd.Series(text, dtype=object).astype(str).str.extract(_CLOCK)
    numbers = parts[["h", "m", "s"]].apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    fraction = pd.to_numeric("0." + parts["f"].fillna("0"), errors="coerce").to_numpy(dtype=np.float64)
    half = parts["p"].str.lower().str[0]
    hours = np.where(half.isna(), numbers[:, 0], numbers[:, 0] % 12 + 12 * (half == "p"))
    t = 3600.0 * hours + 60.0 * numbers[:, 1] + numbers[:, 2] + fraction
    known = np.isfinite(t)
    t[known] = np.unwrap(t[known], period=_DAY_S)
    return np.asarray(t, dtype=np.float64)


def _open_sheet(content: Content) -> Table:
    """Open the first sheet of an Excel file as a table of text is opened."""
    name = content.path.name
    with explain_library(name, "an Excel file", "openpyxl", "xlsx"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        frame = pd.read_excel(io.BytesIO(content.read_bytes()), header=None, engine="openpyxl")
    text = frame.to_csv(index=False, header=False, sep="\t")
    sheet = Content(content.path, lines=tuple(text.splitlines()[:400]), opener=lambda: io.BytesIO(text.encode()))
    found = open_table(sheet)
    if found is None:
        raise FormatError(f"{name} has no table of samples in its first sheet: save that alone, or as CSV.")
    return found


def _open_json(content: Content) -> ArrayTable | None:
    """Open JSON (array or lines of objects, or object of arrays) as a table, nested names dotted; else None."""
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
        arrays = dict[str, np.ndarray[Any, Any]]()
        for column in frame.columns:
            cells, vectors = frame[column].to_numpy(), frame[column].dropna().head(20)
            if len(vectors) and all(isinstance(cell, list) and len(cell) == 3 for cell in vectors):  # [x, y, z]
                cells = np.array([c if isinstance(c, list) and len(c) == 3 else [np.nan] * 3 for c in cells])
            arrays[str(column)] = cells
    except (ValueError, RecursionError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())[:80]
        raise FormatError(f"{name} is no whole JSON of samples ({reason}): export it again.") from None
    return open_arrays(arrays, name)


def _load_numpy(content: Content, kind: str) -> Arrays:
    """Return the arrays of an npz file by name, or that of an npy file under the name `npy`."""
    with explain_library(content.path.name, f"an {kind} file"):
        loaded = np.load(io.BytesIO(content.read_bytes()), allow_pickle=False)
        return {kind: loaded} if kind == "npy" else {key: loaded[key] for key in loaded.files}


def _open_hdf5(content: Content) -> ArrayTable:
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    with explain_library(content.path.name, "an HDF5 file", "h5py", "hdf5"):
        import h5py

        def keep(place: str, node: Any) -> None:
            if isinstance(node, h5py.Dataset) and not place.startswith("#"):
                value = node[()]
                if value.dtype.names:
                    arrays.update({f"{place}/{key}": value[key] for key in value.dtype.names})
                elif value.dtype.kind in "fiubS" and value.size > 1:
                    flat = value.squeeze()  # MATLAB's arrays lie on their side
                    arrays[place] = flat.T if flat.ndim == 2 and flat.shape[0] < flat.shape[1] else flat

        with h5py.File(io.BytesIO(content.read_bytes()), "r") as file:
            file.visititems(keep)
    lengths = [len(array) for array in arrays.values()]
    longest = max(set(lengths), key=lengths.count) if lengths else 0
    own = {place: array for place, array in arrays.items() if len(array) == longest}
    short = [place.rsplit("/", 1)[-1] for place in own]
    names = [one if short.count(one) == 1 else place.replace("/", " ") for place, one in zip(own, short, strict=True)]
    return open_arrays(dict(zip(names, own.values(), strict=True)), content.path.name)


def open_arrays(arrays: Arrays, source: str) -> ArrayTable:
    """Open arrays (N,), (N, 3), (N, 6) or (N, 9) by name as a table; those of other lengths and kinds are left out."""
    lengths = [len(array) for array in arrays.values() if array.ndim in (1, 2) and array.size]
    length = max(set(lengths), key=lengths.count) if lengths else 0
    names, columns = list[str](), list[np.ndarray[Any, Any]]()
    for name, array in arrays.items():
        flat = array[:, None] if array.ndim == 1 else array
        if array.ndim in (1, 2) and len(flat) == length and array.dtype.kind in "fiubMOUS":
            names += _expand_name(name, flat.shape[1])
            columns += list(flat.T)
    if not names:
        raise FormatError(f"{source} holds no arrays of samples: save t (N,), acc (N, 3) and gyr (N, 3).")
    return ArrayTable(source, names, columns)


def _expand_name(name: str, width: int) -> list[str]:
    """Return column names for an array `width` columns wide: axis or number appended, before the unit."""
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
