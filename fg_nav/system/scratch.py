"""A folder of this user for what is made once and read again, where neither installation nor home can be written.

Containers and services run so. What is kept there is read back as code (numba) or trusted (fonts): a folder in the
temporary files that belongs to somebody else, is a link, or that others may write, is not used.
"""

from __future__ import annotations

import os
import stat
import tempfile
from functools import cache
from pathlib import Path

OWNER_ONLY = 0o700
OTHERS = 0o077


@cache
def find_scratch() -> Path | None:
    """Return the folder, `fg-nav-UID` in the temporary files; None where there is none that is safe."""
    try:
        folder = Path(tempfile.gettempdir()) / f"fg-nav-{os.geteuid()}"
        folder.mkdir(OWNER_ONLY, exist_ok=True)
        return folder if _is_ours_alone(folder) else None
    except OSError:  # nothing can be written at all
        return None


def _is_ours_alone(folder: Path) -> bool:
    """Whether this user owns a folder and nobody else reaches into it; a link to one is none."""
    found = folder.lstat()
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & OTHERS
