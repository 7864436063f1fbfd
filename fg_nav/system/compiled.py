"""Functions that numba compiles: the one place that decides where what was compiled is kept, and that lives without.

numba keeps machine code where `NUMBA_CACHE_DIR` says, else in `__pycache__` next to the source, else in the home of the
user, and refuses to load a function where none of these can be written. Then it is kept in `scratch`, or, where not
even that can be, compiled again in each process: each run takes as long as the first (`scripts/startup.py`), and the
numbers are the same.

What is kept may be damaged, and the disk full: that costs the time of compiling, and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from fg_nav.system.scratch import find_scratch

Function = TypeVar("Function", bound=Callable[..., Any])


def njit(**options: Any) -> Callable[[Function], Function]:
    """Return numba's decorator of this name; with `cache=True` what it compiles is kept where that can be."""

    def decorate(function: Function) -> Function:
        compiled: Function = numba.njit(**options | {"cache": False})(function)
        if options.get("cache") and hasattr(compiled, "enable_caching") and _keep(compiled):
            _forgive(compiled)
        return compiled

    return decorate


def _keep(compiled: Any) -> bool:
    """Have a function kept where numba finds a place, else in the scratch folder; return whether it is."""
    try:
        compiled.enable_caching()
        return True
    except RuntimeError:  # numba's word for no place
        folder = find_scratch()
    if folder is None:
        return False
    settings: Any = numba.config
    chosen, settings.CACHE_DIR = settings.CACHE_DIR, str(folder / "numba")
    try:
        compiled.enable_caching()
        return True
    except RuntimeError:
        return False
    finally:
        settings.CACHE_DIR = chosen


def _forgive(compiled: Any) -> None:
    """Let a function be compiled where what is kept of it cannot be read or written."""
    kept = compiled._cache
    for name in ("load_overload", "save_overload"):
        setattr(kept, name, _return_none_for_errors(getattr(kept, name)))


def _return_none_for_errors(work: Callable[..., Any]) -> Callable[..., Any]:
    def attempt(*arguments: Any) -> Any:
        try:
            return work(*arguments)
        except Exception:
            return None

    return attempt
