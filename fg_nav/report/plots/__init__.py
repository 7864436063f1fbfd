"""Pictures. Matplotlib keeps its list of fonts in the home of the user, else in `scratch`.

Importing this package decides the place, before the first import of matplotlib. Without one matplotlib makes the list
again in each process, a second or two, and warns.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from fg_nav.system.processes import find_scratch

VARIABLE = "MPLCONFIGDIR"  # The place, for matplotlib.
PLACES = {"XDG_CONFIG_HOME": ".config", "XDG_CACHE_HOME": ".cache"}
"""Variables, and their defaults in the home, of the folders in which it needs a folder of its own."""


def choose_place() -> None:
    """Set the scratch folder for matplotlib where it could not write, and the user has named none."""
    if os.environ.get(VARIABLE):
        return
    writable = True
    for name, default in PLACES.items():
        base = os.environ.get(name) or os.path.join(os.path.expanduser("~"), default)
        folder = Path(base) / "matplotlib"
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
        writable = writable and folder.is_dir() and os.access(folder, os.W_OK)
    scratch = None if writable else find_scratch()
    if scratch is not None:
        os.environ[VARIABLE] = str(scratch / "matplotlib")


choose_place()
