"""A file that appears whole or not at all: written beside its place, and moved there at the end."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fg_nav.errors import OutputError

FULL = (errno.ENOSPC, errno.EDQUOT)
"""Of errors: another folder would be on the same disk, and begin anew."""


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a path beside to write to; at the end of the block it becomes `path`, and goes away if the block fails.

    Raises
    ------
    OutputError
        Where the system refuses.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield beside
        beside.replace(path)
    except OSError as error:
        reason = (error.strerror or type(error).__name__).lower()
        hint = "make room, and the same command goes on" if error.errno in FULL else "name another folder"
        raise OutputError(f"{path} could not be written ({reason}): {hint}.") from error
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
