"""What a path holds: the first lines of a text, the variables of a MATLAB file, or further files.

A folder, a zip archive and a gzip file are looked into (`fg_nav.io.packed`); nothing is unpacked onto the disk. Formats
are recognized from the content alone, never from a name. Text is UTF-8, with or without a byte-order mark, UTF-16 with
one, or Latin-1.
"""

from __future__ import annotations

import codecs
import csv
import io
import os
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from fg_nav.arrays import Floats
from fg_nav.columns.mapping import Columns
from fg_nav.errors import FgNavError, FormatError
from fg_nav.io import matlab
from fg_nav.io.packed import Fetch, fetch_file, fetch_gzip, fetch_once, list_folder, list_zip, shared_folder

_HEAD_BYTES = 65536
_GZIP, _ZIP, _MAT = b"\x1f\x8b", (b"PK\x03\x04", b"PK\x05\x06"), b"MATLAB "

TEXT, MATLAB, MEMBERS, BINARY = "a text file", "a MATLAB file", "a folder or archive", "a binary file"

_NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True)
class Content:
    """What a path holds, as far as needed to recognize it: `lines`, `variables` or `members`; else `head` alone.

    A reader takes the columns of a text by a `TextTable` of it, the whole text by `read_text()` and the bytes by
    `read_bytes()`, all at C speed and unpacked where they were packed; `source()` is what the reader of a library
    takes. For a folder or an archive it does so with `members[name]`.
    """

    # of the file, for messages (`path.name`) and provenance; that of a member goes on behind that of its archive
    path: Path
    lines: tuple[str, ...] = ()  # first lines of a text
    variables: frozenset[str] = frozenset()  # names in a MATLAB file
    # files of a folder or archive, by their place in it with `/` between, without folders that all share
    members: Mapping[str, Content] = field(default_factory=lambda: _NOTHING)
    head: bytes = b""  # first bytes of a file, unpacked
    encoding: str = "utf-8"  # of the text
    fetch: Fetch | None = None  # reads the bytes where the file is packed; None for a plain file
    # what the user says where the file does not: its rate, which of several sensors, and which columns of a table are
    # what
    rate_hz: float | None = None
    sensor: str | None = None
    columns: Columns | None = None
    is_trial: bool = False  # whether it is read to try what is to be proposed
    opened: dict[int, Any] = field(default_factory=dict, compare=False, repr=False)  # as a table (`fg_nav.io.tables`)

    @property
    def kind(self) -> str:
        """What it is, for messages: one of `TEXT`, `MATLAB`, `MEMBERS` and `BINARY`."""
        if self.members:
            return MEMBERS
        return MATLAB if self.variables else TEXT if self.lines else BINARY

    def fields(self, line: int = 0) -> list[str]:
        """Comma-separated fields of one of the first lines, stripped; empty if there is no such line."""
        return split_fields(self.lines[line]) if line < len(self.lines) else []

    def parts(self) -> list[Content]:
        """Files and folders right in a folder or archive."""
        folders: dict[str, dict[str, Content]] = {}
        files = []
        for place, member in self.members.items():
            folder, _, rest = place.partition("/")
            if rest:
                folders.setdefault(folder, {})[rest] = member
            else:
                files.append(member)
        return files + [Content(self.path / name, members=inner) for name, inner in folders.items()]

    def files(self) -> list[Content]:
        """Files right in a folder or archive; the file itself if it is one."""
        return [part for part in self.parts() if not part.members] if self.members else [self]

    def read_bytes(self) -> bytes:
        """All bytes, unpacked. Raises `FormatError` if they cannot be read, or are damaged where packed."""
        return (self.fetch or fetch_file(self.path))(None)

    def read_text(self) -> str:
        """All text, without a byte-order mark; what is no character of the encoding is a replacement character."""
        return self.read_bytes().decode(self.encoding, errors="replace").removeprefix("\ufeff")

    def source(self) -> Path | io.BytesIO:
        """Path of a plain file, else its bytes in memory; text of UTF-16 in UTF-8."""
        if self.encoding == "utf-16":
            return io.BytesIO(self.read_text().encode())
        return self.path if self.fetch is None else io.BytesIO(self.fetch(None))


def read_content(path: Path) -> Content:
    """Return the content of a path: lines of a text, head of a binary file, members of a folder or archive.

    Raises `FormatError` if there is nothing to read, or it is empty, damaged where packed, or too large.
    """
    path = path.resolve() if path.name in ("", "..") else path
    if os.path.isdir(path):
        return _look_inside(path, list_folder(path), is_folder=True)
    is_packed = os.path.exists(path) and not os.path.isfile(path)  # a pipe is kept in memory
    fetch = fetch_once(path) if is_packed else fetch_file(path)
    head = fetch(_HEAD_BYTES)
    if head.startswith(_GZIP):
        is_packed, fetch = True, fetch_gzip(path.name, fetch)
        head = fetch(_HEAD_BYTES)
    if not head.strip():
        raise FormatError(f"{path.name} is empty: record or export it again.")
    if head.startswith(_ZIP):
        files = list_zip(path.name, fetch, None if is_packed else path)
        return _look_inside(path, files, is_folder=False, head=head, fetch=fetch if is_packed else None)
    content = _look_at_file(path, fetch if is_packed else None, head)
    return replace(content, variables=_parse_mat(content, matlab.list_names)) if head.startswith(_MAT) else content


def _look_inside(path: Path, files: Mapping[str, Fetch], is_folder: bool, **known: Any) -> Content:
    """Content of a folder or archive. Members that are archives stay shut."""
    if not files:
        raise FormatError(f"{path.name} holds no file that is not empty: record or export it again.")
    shared, members = len(shared_folder(files)), dict[str, Content]()
    for place, fetch in files.items():
        is_packed, head = not is_folder, fetch(_HEAD_BYTES)
        if head.startswith(_GZIP):
            is_packed, fetch = True, fetch_gzip((path / place).name, fetch)
            head = fetch(_HEAD_BYTES)
        member = _look_at_file(path / place, fetch if is_packed else None, head)
        if head.startswith(_MAT):
            with suppress(FormatError):  # it may be none that is needed
                member = replace(member, variables=_parse_mat(member, matlab.list_names))
        members[place[shared:]] = member
    return Content(path, members=MappingProxyType(members), **known)


def _look_at_file(path: Path, fetch: Fetch | None, head: bytes) -> Content:
    """Content of a text or binary file. A byte that is no UTF-8 (a degree or micro sign, mostly) is Latin-1."""
    encoding = "utf-16" if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8"
    if head.startswith(_MAT) or (b"\0" in head and encoding == "utf-8"):
        return Content(path, head=head, fetch=fetch)
    if encoding == "utf-16":
        text = head[: len(head) // 2 * 2].decode(encoding, errors="replace")
    else:
        is_cut = len(head) == _HEAD_BYTES  # perhaps within a character
        whole = (head[: head.rfind(b"\n") + 1] or head) if is_cut else head
        try:
            text = whole.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = whole.decode("latin-1").removeprefix("ï»¿")
    return Content(path, tuple(split_lines(text)), head=head, encoding=encoding, fetch=fetch)


def split_lines(text: str) -> list[str]:
    """Lines of a text as the readers of tables count them: by LF, CR LF or CR, no other character ends one."""
    lines = re.split("\r\n|\r|\n", text)
    return lines if lines[-1] else lines[:-1]


def split_fields(line: str, separator: str = ",", skip_blanks: bool = False) -> list[str]:
    r"""Fields of a line, quotes and surrounding blanks removed; by any blanks where the separator is `\s+`.

    With `skip_blanks` a quote may stand behind a blank.
    """
    if separator == r"\s+":
        return line.split()
    try:
        rows = csv.reader([line], delimiter=separator, skipinitialspace=skip_blanks)
        return [field.strip() for field in next(rows, [])]
    except csv.Error:
        return []


@contextmanager
def explain_library(
    name: str, what: str, library: str = "", extra: str = "", remedy: str = "export it again"
) -> Iterator[None]:
    """Raise `FormatError` where the library that reads a file is absent, with the extra to install, or cannot read."""
    try:
        yield
    except FgNavError:
        raise
    except ImportError:
        raise FormatError(f"{name} is {what}, which {library} reads: pip install 'fg-nav[{extra}]'.") from None
    except Exception as error:  # libraries raise errors of their own, and of what they are built on
        kind = what.split(" ", 1)[1]
        raise FormatError(f"{name} is a damaged {kind} ({type(error).__name__}): {remedy}.") from None


def choose_sensor(
    names: Sequence[str], asked: str | None, path: Path, what: str = "sensors", before: str = "`--sensor "
) -> str:
    """Return the only name, or the only one that contains `asked`; `before` is the option quoted in an error.

    Raises `FormatError` if there are several and none is asked for, or what is asked for is not one of them.
    """
    if asked is None:
        if len(names) == 1:
            return names[0]
        example = next((name for name in names if "foot" in name.lower()), names[0])
        raise FormatError(
            f"{path.name} holds {len(names)} {what} ({', '.join(names)}): name one, such as "
            f"{before}{shlex.quote(example)}`."
        )
    same = [name for name in names if name.lower() == asked.lower()]
    alike = same or [name for name in names if asked.lower() in name.lower()]
    if len(alike) != 1:
        raise FormatError(f"{path.name} has no one '{asked}' among its {what}: choose one of {', '.join(names)}.")
    return alike[0]


T = TypeVar("T")

Variables: TypeAlias = Mapping[str, NDArray[Any] | None]
"""Of a MATLAB file, by name: arrays of real numbers, None for all else."""


def _parse_mat(content: Content, parse: Callable[[bytes], T]) -> T:
    name = content.path.name
    try:
        return parse(content.read_bytes())
    except matlab.TooNewError:
        raise FormatError(f"{name} is a MATLAB 7.3 file, which is not read here: save it again with '-v7'.") from None
    except matlab.DamagedError as error:
        raise FormatError(f"{name} is a damaged MATLAB file ({error}): copy or export it again.") from None


def load_mat(content: Content) -> Variables:
    """Variables of a MATLAB file by name.

    Raises `FormatError` if the file is damaged or of version 7.3.
    """
    return _parse_mat(content, matlab.load_arrays)


def mat_array(variables: Variables, name: str, path: Path, columns: int | None = None) -> Floats:
    """Return the variable `name` as floats: (M, columns), or (M,) without `columns`.

    Raises `FormatError` if the variable is missing, not real numbers, or of another shape.
    """
    if name not in variables:
        raise FormatError(f"{path.name} holds no variable '{name}': export it again with '{name}'.")
    value = variables[name]
    if value is None:
        raise FormatError(f"{path.name}: variable '{name}' is not an array of real numbers: export it again.")
    if columns is None and (value.ndim > 2 or value.size != max(value.shape, default=1)):
        raise FormatError(f"{path.name}: variable '{name}' has shape {value.shape} where a vector is needed.")
    if columns is not None and (value.ndim != 2 or value.shape[1] != columns):
        raise FormatError(f"{path.name}: variable '{name}' has shape {value.shape}, not (N, {columns}).")
    # uint8 would wrap in differences: everything is a float from here on.
    numbers = np.array(value, dtype=np.float64, order="C")
    return numbers.reshape(-1) if columns is None else numbers
