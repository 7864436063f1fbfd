"""Files that hold files: folders, zip archives and gzip. Nothing is unpacked onto the disk. Pipes are read once, whole.

A file in a folder or archive is known by its place there, with `/` between. Hidden files, empty ones and what macOS
adds are left out. Places that lead out of the archive are left out as well; they are names here, never paths.

An archive says how large its files are, and gzip does not: what is larger than `MAX_BYTES` unpacked is refused before
it fills the memory.
"""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import BinaryIO

from fg_nav.errors import FormatError

MAX_BYTES = 2**30  # A day of six sensors at 100 Hz in text; more does not fit the memory of a small computer.
MAX_FILES = 1000  # No tool writes as many files for one recording; a home folder has more.
MAX_DEPTH = 4  # Folders within folders that are searched.
_OVERHEAD_BYTES = 4096  # What does not shrink becomes a little longer by packing.
_PART_BYTES = 2**20  # Read from a pipe at a time.
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)

Fetch = Callable[[int | None], bytes]  # The first bytes of a file, at most as many as are given; all of them for None.


def fetch_file(path: Path) -> Fetch:
    """Return a function that reads the first `size` bytes of a plain file, or all (None).

    Raises `FormatError` when called, if the file cannot be read.
    """

    def fetch(size: int | None) -> bytes:
        with _open_file(path) as file:
            return file.read(-1 if size is None else size)

    return fetch


def fetch_once(path: Path) -> Fetch:
    """Read a pipe or device to its end, into memory; return a function for its first `size` bytes, or all (None).

    Raises `FormatError` if it cannot be read, or more comes than `MAX_BYTES`.
    """
    parts, left = list[bytes](), MAX_BYTES
    with _open_file(path) as file:
        while left >= 0 and (part := file.read(_PART_BYTES)):
            parts.append(part)
            left -= len(part)
    if left < 0:
        raise FormatError(f"{path} gives more than {_words(MAX_BYTES)}: write it into a file, and cut it.")
    data = b"".join(parts)
    return lambda size: data[:size]


@contextmanager
def _open_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file to read; raises `FormatError` if it cannot be opened or read."""
    try:
        with path.open("rb") as file:
            yield file
    except FileNotFoundError:
        raise FormatError(f"{path} does not exist: check the path.") from None
    except PermissionError:
        raise FormatError(f"{path} may not be read: check its permissions.") from None
    except (OSError, ValueError) as error:
        raise FormatError(f"{path} cannot be opened ({error}): check the path.") from None


def fetch_gzip(name: str, packed: Fetch) -> Fetch:
    """Return a function that unpacks the first `size` bytes of the gzip file read by `packed`, or all (None).

    Raises `FormatError` when called, if it is damaged or too large.
    """

    def fetch(size: int | None) -> bytes:
        left, needed = (MAX_BYTES + 1, None) if size is None else (size, size + _OVERHEAD_BYTES)
        parts, data = list[bytes](), packed(needed)
        while data and left > 0 and data.strip(b"\0"):  # one member after the other
            unpack = zlib.decompressobj(wbits=31)
            try:
                parts.append(unpack.decompress(data, left))
            except zlib.error:
                raise FormatError(f"{name} is a damaged gzip file: copy it again.") from None
            if size is None and len(parts[-1]) < left and not unpack.eof:
                raise FormatError(f"{name} is a gzip file that is cut off: copy it again.")
            left, data = left - len(parts[-1]), unpack.unused_data
        whole = b"".join(parts)
        if len(whole) > MAX_BYTES:
            raise FormatError(f"{name} is larger than {_words(MAX_BYTES)} unpacked: unpack it, and cut it.")
        return whole

    return fetch


def list_folder(path: Path) -> Mapping[str, Fetch]:
    """Return a reader for each file of a folder, by its relative path.

    Raises `FormatError` if it cannot be listed, or holds too many.
    """

    def refuse(error: OSError) -> None:
        raise FormatError(f"{error.filename} may not be listed: check its permissions.") from None

    found = {}
    for folder, folders, files in os.walk(path, onerror=refuse):
        place = Path(folder).relative_to(path)
        folders[:] = sorted(name for name in folders if not _is_hidden(name)) if len(place.parts) < MAX_DEPTH else []
        for name in sorted(files):
            file = Path(folder) / name
            if not _is_hidden(name) and file.is_file() and file.stat().st_size:
                found[(place / name).as_posix()] = fetch_file(file)
        _check_count(len(found), str(path))
    return found


def list_zip(name: str, packed: Fetch, path: Path | None = None) -> Mapping[str, Fetch]:
    """Return a reader for each file of a zip archive, by its path in it; the archive is `path` or read by `packed`.

    Raises `FormatError` if the archive is damaged, holds too many files or too large ones; when a file is fetched, if
    that one is damaged or locked.
    """

    @contextmanager
    def open_archive(what: str) -> Iterator[zipfile.ZipFile]:
        try:
            with zipfile.ZipFile(path if path is not None else io.BytesIO(packed(None))) as archive:
                yield archive
        except FormatError:
            raise
        except Exception as error:  # BadZipFile, struct, Value, OS, NotImplemented, Unicode ... errors
            raise FormatError(
                f"{what} is damaged or cut off ({type(error).__name__}): copy or export it again."
            ) from None

    def fetch(entry: zipfile.ZipInfo, size: int | None) -> bytes:
        if entry.flag_bits & 1:
            raise FormatError(f"{name} is locked by a password: unpack it first.")
        if entry.compress_type not in _METHODS:
            raise FormatError(f"{name} is packed in a way that is not read here: unpack it first.")
        with open_archive(f"{_place(entry)} in {name}") as archive, archive.open(entry) as file:
            return file.read() if size is None else file.read(size)

    with open_archive(name) as archive:
        entries = [entry for entry in archive.infolist() if not entry.is_dir() and entry.file_size > 0]
    wanted = []
    for entry in entries:
        parts = _place(entry).split("/")
        if all(parts) and ":" not in parts[0] and not any(map(_is_hidden, parts)):
            wanted.append(entry)
    _check_count(len(wanted), name)
    if sum(entry.file_size for entry in wanted) > MAX_BYTES:
        raise FormatError(f"{name} holds more than {_words(MAX_BYTES)}: unpack it, and give one recording of it.")
    return {_place(entry): partial(fetch, entry) for entry in wanted}


def _place(entry: zipfile.ZipInfo) -> str:
    return entry.filename.replace("\\", "/")


def _is_hidden(name: str) -> bool:
    return name.startswith(".") or name == "__MACOSX"


def _check_count(count: int, name: str) -> None:
    if count > MAX_FILES:
        raise FormatError(f"{name} holds more than {MAX_FILES} files: give the folder of one recording.")


def shared_folder(places: Iterable[str]) -> str:
    """Folder that all files are in, with a `/` at its end; empty if they share none."""
    parts = [place.split("/")[:-1] for place in places]
    levels = [len(set(names)) == 1 for names in zip(*parts, strict=False)]
    return "".join(f"{name}/" for name in parts[0][: (*levels, False).index(False)])


def _words(size: int) -> str:
    return f"{size // 2**30} GiB"
