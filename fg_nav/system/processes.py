"""Processes of our own: modules of this package that another interpreter runs, and how all of them collect garbage."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Iterable

OBJECTS_BETWEEN_COLLECTIONS = 50_000
"""Of the garbage collector: what is loaded stays, and looking through it again and again takes a tenth of a run."""


def collect_seldom() -> None:
    """Have the garbage collector of this process look for cycles less often."""
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)


def start_module(name: str, *arguments: str, pass_fds: Iterable[int] = ()) -> subprocess.Popen[bytes]:
    """Run a module in a process with pipes for its input and output; Ctrl-C of a terminal does not reach it.

    It imports from where this process does, not from the folder that the user is in; `pass_fds` stay open in it.
    """
    places = os.pathsep.join(place or os.getcwd() for place in sys.path)
    return subprocess.Popen(
        [sys.executable, "-P", "-m", name, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        pass_fds=tuple(pass_fds),
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": places},
    )
