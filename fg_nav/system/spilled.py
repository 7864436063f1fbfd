"""Long columns of samples in a file instead of in memory: what is not looked at takes none.

A column of many samples lies in a file without a name in the temporary files, so that nothing is left of it however
the process ends, and is mapped into memory page by page. The system writes pages out when others need the memory;
`drop_pages`, where a pass over the samples is over, takes all of them out of the process, and their content stays in
the system's cache or on the disk. Short columns lie in memory, and so do long ones where no file can be written or the
temporary files are in memory themselves. Processes that are forked share a long column, writes included.
`return_freed` gives memory that was let go of back to the system. A graph is millions of small pieces: between those
that stay, glibc keeps what the others leave, and long arrays do not fit there: 0.1 GB in an hour of walking.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import tempfile
import threading
from contextlib import suppress
from functools import cache
from pathlib import Path
from weakref import WeakSet

import numpy as np

from fg_nav.arrays import Floats, Ints

MIN_BYTES = 1 << 24  # Shorter columns stay in memory: an hour at 200 Hz of three axes has 17 MB.
BLOCK_ROWS = 1 << 18  # That are gone through at once.
MOUNTS = Path("/proc/mounts")  # What lies where, on Linux; elsewhere temporary files are on a disk.

_MAPS: WeakSet[mmap.mmap] = WeakSet()
_MAPS_LOCK = threading.Lock()


def empty_column(*shape: int) -> Floats:
    """Return an uninitialized array of this shape, memory-mapped to a file if it is large."""
    size = 8 * int(np.prod(shape))
    folder = _find_disk() if size >= MIN_BYTES else None
    if folder is None:
        return np.empty(shape)
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            os.posix_fallocate(file.fileno(), 0, size)  # a full disk shows here, and not when it is written to
            room = mmap.mmap(file.fileno(), size)
    except OSError:
        return np.empty(shape)
    with _MAPS_LOCK:
        _MAPS.add(room)
    return np.frombuffer(room, dtype=np.float64, count=size // 8).reshape(shape)


def take_rows(index: Ints | None, *columns: Floats) -> Floats:
    """Return rows `index` (K,), None for all, of `columns` (N, c) side by side; memory-mapped if large."""
    count = len(columns[0] if index is None else index)
    beside, at = empty_column(count, sum(one.shape[1] for one in columns)), 0
    for one in columns:
        for start in range(0, count, BLOCK_ROWS):
            part = slice(start, min(start + BLOCK_ROWS, count))
            beside[part, at : at + one.shape[1]] = one[part if index is None else index[part]]
            drop_pages()
        at += one.shape[1]
    return beside


def join_columns(*columns: Floats) -> Floats:
    """Return columns (N, c) side by side, in a file where they are long."""
    return take_rows(None, *columns)


def measure_rows(rows: Floats) -> Floats:
    """Return the lengths (N,) of rows (N, c)."""
    length = np.empty(len(rows))
    for start in range(0, len(rows), BLOCK_ROWS):
        part = slice(start, start + BLOCK_ROWS)
        length[part] = np.linalg.norm(rows[part], axis=1)
        drop_pages()
    return length


def join_rows(parts: list[Floats]) -> Floats:
    """Return the concatenated arrays, memory-mapped if large; each is taken off the list once copied."""
    joined, start = empty_column(sum(map(len, parts)), *parts[0].shape[1:]), 0
    parts.reverse()
    while parts:
        part = parts.pop()
        joined[start : start + len(part)] = part
        start += len(part)
        drop_pages()
    return joined


def drop_pages() -> None:
    """Take the pages of all columns out of the process; they are read again when they are looked at."""
    with _MAPS_LOCK:
        rooms = list(_MAPS)
    for room in rooms:
        room.madvise(mmap.MADV_DONTNEED)


def return_freed() -> None:
    """Give back to the system what is free, where its C library can: glibc's can."""
    drop_pages()
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


@cache
def _find_disk() -> Path | None:
    """Return a folder of temporary files that is on a disk; None where there is none or pages cannot be dropped."""
    if not (hasattr(mmap, "MADV_DONTNEED") and hasattr(os, "posix_fallocate")):
        return None
    try:
        folders = [Path(tempfile.gettempdir())]
    except OSError:  # nothing can be written at all
        return None
    if "TMPDIR" not in os.environ:
        folders.append(Path("/var/tmp"))  # on a disk where the other is not
    return next((one for one in folders if os.access(one, os.W_OK) and not _is_in_memory(one)), None)


def _is_in_memory(folder: Path) -> bool:
    """Whether a folder lies in a file system of the system's memory."""
    try:
        table = MOUNTS.read_text(encoding="utf-8", errors="surrogateescape")
    except OSError:
        return False
    place, mounts = folder.resolve(), [line.split() for line in table.splitlines()]
    # Of several at one place the last is on top.
    above = [mount for mount in reversed(mounts) if place.is_relative_to(mount[1].replace("\\040", " "))]
    return bool(above) and max(above, key=lambda mount: len(mount[1]))[2] in ("tmpfs", "ramfs")
