"""What a path holds: the first lines of a text, the variables of a MATLAB file, or further files (docs/formats.md).

A file in a folder or archive is known by its place there, with `/` between. Hidden files, empty ones, what macOS adds
and places that lead out of the archive are left out. What is packed and larger than `MAX_BYTES` is refused before it
fills the memory.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import os
import posixpath
import re
import shlex
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any, cast

from fg_nav.columns.mapping import Columns
from fg_nav.errors import FgNavError, FormatError
from fg_nav.io import matlab
from fg_nav.text import suggest_install

MAX_BYTES = 2**30  # A day of six sensors at 100 Hz in text; more does not fit the memory of a small computer.
MAX_FILES = 1000  # No tool writes as many files for one recording; a home folder has more.
MAX_DEPTH = 4  # Folders within folders that are searched.
_HEAD_BYTES = 65536
_PART_BYTES = 2**20  # Read at a time of what may be endless.
_GZIP, _ZIP, _MAT = b"\x1f\x8b", (b"PK\x03\x04", b"PK\x05\x06"), b"MATLAB "

TEXT, MATLAB, MEMBERS, BINARY = "a text file", "a MATLAB file", "a folder or archive", "a binary file"

_NOTHING: Mapping[str, Any] = MappingProxyType({})

Opener = Callable[[], AbstractContextManager[IO[bytes]]]  # Opens a file, unpacked where it is packed.


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
    opener: Opener | None = None  # opens what is packed; None for a plain file
    # what the user says where the file does not: its rate, which of several sensors, and which columns of a table are
    # what
    rate_hz: float | None = None
    sensor: str | None = None
    columns: Columns | None = None
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
        return _read_bytes(self.path, self.opener)

    def read_text(self) -> str:
        """All text, without a byte-order mark; what is no character of the encoding is a replacement character."""
        return self.read_bytes().decode(self.encoding, errors="replace").removeprefix("\ufeff")

    def source(self) -> Path | io.BytesIO:
        """Path of a plain file, else its bytes in memory; text of UTF-16 in UTF-8."""
        if self.encoding == "utf-16":
            return io.BytesIO(self.read_text().encode())
        return self.path if self.opener is None else io.BytesIO(self.read_bytes())

    def load_variables(self) -> matlab.Variables:
        """Variables of a MATLAB file by name; raises `FormatError` if it is damaged or of version 7.3."""
        return matlab.load_arrays(self.read_bytes(), self.path.name)


def read_content(path: Path) -> Content:
    """Return the content of a path: lines of a text, head of a binary file, members of a folder or archive."""
    path = path.resolve() if path.name in ("", "..") else path
    if os.path.isdir(path):
        with _explain_file(path):
            found = _list_folder(path)
        return Content(path, members=_open_members(path, found))
    opener: Opener | None = None
    if os.path.exists(path) and not os.path.isfile(path):  # a pipe is kept in memory
        opener = partial(io.BytesIO, _read_bytes(path, _open_plain(path)))
    content = _open_file(path, opener)
    if not content.head.strip():
        raise FormatError(f"{path.name} is empty: record or export it again.")
    if not content.head.startswith(_ZIP):
        return content
    # entries of an archive, without hidden ones and places that lead out of it
    archive = content.opener or _open_plain(path)
    with _explain_file(path), archive() as file, zipfile.ZipFile(file) as opened:
        entries = {entry.filename.replace("\\", "/"): entry for entry in opened.infolist() if entry.file_size > 0}
    places = [place.split("/") for place in entries]
    wanted = ["/".join(p) for p in places if all(p) and ":" not in p[0] and not any(map(_is_hidden, p))]
    if sum(entries[place].file_size for place in wanted) > MAX_BYTES:
        raise FormatError(
            f"{path.name} holds more than {MAX_BYTES // 2**30} GiB: unpack it, and give one recording of it."
        )
    return replace(
        content, members=_open_members(path, {place: partial(_unpack, archive, entries[place]) for place in wanted})
    )


def _open_file(path: Path, opener: Opener | None, has_others: bool = False) -> Content:
    """Content of a text or binary file. A byte that is no UTF-8 (a degree or micro sign, mostly) is Latin-1."""
    content = Content(path, head=_read_bytes(path, opener, _HEAD_BYTES), opener=opener)
    try:
        if content.head.startswith(_GZIP):
            opener = partial(_unpack, opener or _open_plain(path))
            content = Content(path, head=_read_bytes(path, opener, _HEAD_BYTES), opener=opener)
        if content.head.startswith(_MAT):
            return replace(content, variables=matlab.list_names(content.read_bytes(), path.name))
    except FormatError:
        if has_others:  # it may be none that is needed
            return content
        raise
    head = content.head
    is_utf32 = head.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE))  # which is not read
    encoding = "utf-16" if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) and not is_utf32 else "utf-8"
    if encoding == "utf-16":
        text = head[: len(head) // 2 * 2].decode(encoding, errors="replace")
    elif b"\0" in head:
        return content
    else:
        is_cut = len(head) == _HEAD_BYTES  # perhaps within a character
        whole = (head[: head.rfind(b"\n") + 1] or head) if is_cut else head
        try:
            text = whole.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = whole.decode("latin-1").removeprefix("ï»¿")
    return replace(content, lines=tuple(split_lines(text)), encoding=encoding)


# Files that hold files


def _read_bytes(path: Path, opener: Opener | None, size: int = -1) -> bytes:
    """Read the first `size` bytes of a file, or all (-1); raises `FormatError` if it cannot be, or is too large."""
    with _explain_file(path), path.open("rb") if opener is None else opener() as file:
        if opener is None or size >= 0:
            return file.read(size)
        parts = islice(iter(partial(file.read, _PART_BYTES), b""), MAX_BYTES // _PART_BYTES + 1)
        data = b"".join(parts)
    if len(data) > MAX_BYTES:
        raise FormatError(f"{path} is larger than {MAX_BYTES // 2**30} GiB unpacked: write it into a file, and cut it.")
    return data


@contextmanager
def _explain_file(path: Path) -> Iterator[None]:
    """Raise `FormatError` where a file cannot be opened, or is damaged where packed."""
    try:
        yield
    except FileNotFoundError:
        raise FormatError(f"{path} does not exist: check the path.") from None
    except Exception as error:  # OS, EOF, BadZipFile, zlib, Runtime, Value, Unicode ... errors
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise FormatError(
            f"{path} cannot be opened, or is damaged ({reason}): check its permissions, copy it again, or unpack it."
        ) from None


def _open_plain(path: Path) -> Opener:
    return lambda: path.open("rb")


@contextmanager
def _unpack(packed: Opener, entry: zipfile.ZipInfo | None = None) -> Iterator[IO[bytes]]:
    """Open what is packed by gzip, or an entry of an archive."""
    with packed() as file:
        if entry is None:
            with gzip.open(file) as unpacked:
                yield cast(IO[bytes], unpacked)
        else:
            with zipfile.ZipFile(file) as archive, archive.open(entry) as member:
                yield member


def _list_folder(path: Path) -> dict[str, Opener | None]:
    """Return the places of the files in a folder; too many are cut off, and refused later."""
    found = dict[str, Opener | None]()

    def refuse(error: OSError) -> None:
        raise error

    for folder, folders, files in os.walk(path, onerror=refuse):
        place = Path(folder).relative_to(path)
        folders[:] = sorted(name for name in folders if not _is_hidden(name)) if len(place.parts) < MAX_DEPTH else []
        for name in sorted(files):
            file = Path(folder) / name
            if not _is_hidden(name) and file.is_file() and file.stat().st_size:
                found[(place / name).as_posix()] = None
        if len(found) > MAX_FILES:
            break
    return found


def _is_hidden(name: str) -> bool:
    return name.startswith(".") or name == "__MACOSX"


def _open_members(path: Path, found: Mapping[str, Opener | None]) -> Mapping[str, Content]:
    """Contents of the files in a folder or archive, by place, without the folders that all share."""
    if not found:
        raise FormatError(f"{path.name} holds no file that is not empty: record or export it again.")
    if len(found) > MAX_FILES:
        raise FormatError(f"{path.name} holds more than {MAX_FILES} files: give the folder of one recording.")
    shared = posixpath.commonpath([posixpath.dirname(place) for place in found])
    return MappingProxyType({
        posixpath.relpath(place, shared or "."): _open_file(path / place, opener, has_others=len(found) > 1)
        for place, opener in found.items()
    })  # fmt: skip


# Text


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
        raise FormatError(f"{name} is {what}, which {library} reads: {suggest_install(extra)}.") from None
    except Exception as error:  # libraries raise errors of their own, and of what they are built on
        kind = what.split(" ", 1)[1]
        raise FormatError(f"{name} is a damaged {kind} ({type(error).__name__}): {remedy}.") from None


def choose_sensor(
    names: Sequence[str], asked: str | None, path: Path, what: str = "sensors", before: str = "`--sensor "
) -> str:
    """Return the only name, or the only one that contains `asked`; `before` is the option quoted in an error."""
    if not names:
        raise FormatError(f"{path.name} holds no {what} of this format: export it again.")
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
