"""Where matplotlib keeps its list of fonts: in the home of the user, else in `scratch`.

Importing this module decides it, before the first import of matplotlib. Without a place matplotlib makes the list again
in each process, a second or two, and warns.
"""

from __future__ import annotations

import os
from pathlib import Path

from fg_nav.system.scratch import find_scratch

VARIABLE = "MPLCONFIGDIR"  # That tells matplotlib the place.

PLACES = {"XDG_CONFIG_HOME": ".config", "XDG_CACHE_HOME": ".cache"}
"""Variables, and the folders of the home that they stand for, in which it needs a folder of its own."""


def choose_place() -> None:
    """Name the scratch folder to matplotlib where it could not write, and the user has named none."""
    if os.environ.get(VARIABLE) or all(_can_be_written(Path(_find_base(name)) / "matplotlib") for name in PLACES):
        return
    scratch = find_scratch()
    if scratch is not None:
        os.environ[VARIABLE] = str(scratch / "matplotlib")


def _find_base(name: str) -> str:
    return os.environ.get(name) or os.path.join(os.path.expanduser("~"), PLACES[name])


def _can_be_written(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


choose_place()
