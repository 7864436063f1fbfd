"""Memory that was let go of goes back to the system.

A graph is millions of small pieces. Between those that stay, glibc keeps what the others leave, and what is asked for
next, in long arrays, does not fit there: an hour of walking holds 0.1 GB of it.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

from fg_nav.system.spilled import drop_pages


def return_freed() -> None:
    """Give back to the system what is free, where its C library can: glibc's can."""
    drop_pages()
    trim = _find_trim()
    if trim is not None:
        trim(0)


@cache
def _find_trim() -> Any:
    try:
        return getattr(ctypes.CDLL(None), "malloc_trim", None)
    except OSError:
        return None
