"""Files that appear complete or not at all, and marker files.

A hidden marker file in a folder says which command fills it. A command writes into no folder that something else fills.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fg_nav.errors import OutputError, describe_reason

CAMPAIGN_MARKER, REPRODUCTION_MARKER = ".fg-nav-campaign", ".fg-nav-reproduce"
MARKERS = (CAMPAIGN_MARKER, REPRODUCTION_MARKER)

PART = ".part"  # End of a file's name while it is written.

_DISK_FULL = (errno.ENOSPC, errno.EDQUOT)


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to; it becomes `path` at the end of the block and goes away if the block fails.

    Raises
    ------
    OutputError
        If the system refuses.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}{PART}")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        reason = describe_reason(error)
        full = error.errno in _DISK_FULL  # another folder would be on the same disk, and start again
        hint = "make room, and the same command goes on" if full else "name another folder"
        raise OutputError(f"{path} could not be written ({reason}): {hint}.") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically; raises `OutputError` if the system refuses."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def make_folder(path: Path) -> Path:
    """Return the folder, made if it is missing; raises `OutputError` if the system refuses."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path} could not be made ({error.strerror}): name another folder.") from error
    return path


def list_visible(out: Path) -> list[str]:
    """Return the sorted names in a folder that are not hidden; none if there is no folder."""
    return sorted(entry.name for entry in out.iterdir() if not entry.name.startswith(".")) if out.exists() else []
