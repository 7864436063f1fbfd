"""Locks of the system on files and folders: they end with the process that holds them, however that ends.

A disk or a system without locks keeps nobody out.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import IO


def lock(descriptor: int) -> bool:
    """Lock an open file or folder until it is closed; return whether there are locks.

    Raises `BlockingIOError` where another has it.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a disk without locks
        return False
    return True


def lock_folder(folder: Path) -> tuple[int, bool]:
    """Make a folder if it is missing and lock it; return its descriptor, to be closed, and whether there are locks.

    Raises `BlockingIOError` where another has it, and `OSError` where there can be no such folder.
    """
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            locks = lock(descriptor)
            if os.path.samestat(os.fstat(descriptor), os.stat(folder)):
                return descriptor, locks
        except FileNotFoundError:  # removed by who had the lock
            pass
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


class PathLock:
    """A lock on whatever file is at a path, renewed where a file took the place of another."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: IO[bytes] | None = None

    @property
    def is_held(self) -> bool:
        """Whether there was a file to lock."""
        return self._file is not None

    def renew(self) -> None:
        """Lock the file that is there now, if there is one; raises `BlockingIOError` where another has it."""
        if not self._path.exists():
            return
        file = self._path.open("rb")
        try:
            lock(file.fileno())
        except BlockingIOError:
            file.close()
            raise
        self.release()
        self._file = file

    def release(self) -> None:
        """Give it back."""
        if self._file is not None:
            self._file.close()
        self._file = None
