"""A file that only grows: records, one behind the other, each with its length and a check of its bytes.

    "fg-nav walk" | version (2) | length (8), CRC-32 (4), bytes | length, CRC-32, bytes | ...

A record is there as a whole or not at all: what a process that was killed, or a full disk, left of one at the end is
not read, and the next one is written in its place. Every record is on the disk before the call that writes it returns.
"""

from __future__ import annotations

import os
import tempfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO

from fg_nav.errors import FormatError

MAGIC = b"fg-nav walk"

_CHECK = 12  # Bytes before those of a record.


def write_records(path: Path, version: int, records: Iterable[bytes]) -> int:
    """Write a log in place of another, which stays as it is until this one is complete; its size.

    Raises `OSError` where that cannot be.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(_begin(version))
            for record in records:
                _write(file, record)
            file.flush()
            os.fsync(file.fileno())
            size = file.tell()
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # the new name too
    finally:
        os.close(folder)
    return size


def append_record(path: Path, size: int, record: bytes) -> int:
    """Append a record to the first `size` bytes of a log, in place of what is behind them; its size then.

    Raises `OSError` where that cannot be: then the log ends where it did.
    """
    with path.open("r+b") as file:
        file.truncate(size)
        file.seek(size)
        try:
            _write(file, record)
            file.flush()
            os.fsync(file.fileno())
        except OSError:
            with suppress(OSError):
                file.truncate(size)
            raise
        return file.tell()


def read_records(path: Path, version: int) -> Iterator[tuple[bytes, int]]:
    """Yield the records of a log, each with the size of the log up to its end.

    Raises
    ------
    FormatError
        If the file is none, or one of another version.
    """
    with path.open("rb") as file:
        begin = file.read(len(MAGIC) + 2)
        if len(begin) < len(MAGIC) + 2 or not begin.startswith(MAGIC):
            raise FormatError(f"{path.name} is no checkpoint of a walk: name another file, or remove it.")
        other = int.from_bytes(begin[len(MAGIC) :], "little")
        if other != version:
            raise FormatError(
                f"{path.name} is a checkpoint of version {other} and this program reads {version}: begin again."
            )
        whole = os.fstat(file.fileno()).st_size
        while (record := _read(file, whole)) is not None:
            yield record, file.tell()


def _begin(version: int) -> bytes:
    return MAGIC + version.to_bytes(2, "little")


def _write(file: IO[bytes], record: bytes) -> None:
    file.write(len(record).to_bytes(8, "little") + zlib.crc32(record).to_bytes(4, "little"))
    file.write(record)


def _read(file: IO[bytes], whole: int) -> bytes | None:
    """Read the next record of a file of `whole` bytes; None where there is none, or not as it was written."""
    check = file.read(_CHECK)
    length, crc = int.from_bytes(check[:8], "little"), int.from_bytes(check[8:], "little")
    if len(check) < _CHECK or length > whole - file.tell():
        return None
    record = file.read(length)
    return record if len(record) == length and zlib.crc32(record) == crc else None
