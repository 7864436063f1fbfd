"""A file that appears whole or not at all: written beside its place, and moved there at the end."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fg_nav.errors import OutputError


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
        raise OutputError(f"{path} could not be written ({reason}): name another folder.") from error
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
