"""Functions that numba compiles: the one place that decides where what was compiled is kept, and that lives without.

numba keeps machine code where `NUMBA_CACHE_DIR` says, else in `__pycache__` next to the source, else in the home of the
user, and refuses to load a function where none of these can be written. Then it is kept in the folder for scratch, or,
where not even that can be, compiled again in each process (`scripts/measure.py commands --only start`). What is kept
may be damaged, and the disk full: that costs the time of compiling, and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from fg_nav.system.processes import find_scratch

LEAN = {"error_model": "numpy", "no_cfunc_wrapper": True}  # no checks for 0 and nothing for C: 6 % sooner compiled
unliteral = cast("Callable[[int], int]", np.int64)  # Of a number passed on: a literal is a type of its own to numba.

Function = TypeVar("Function", bound=Callable[..., Any])


def njit(**options: Any) -> Callable[[Function], Function]:
    """Return `numba.njit` with these options; with `cache=True` machine code is cached on disk where possible."""

    def decorate(function: Function) -> Function:
        compiled: Function = numba.njit(**options | LEAN | {"cache": False})(function)
        dispatcher: Any = compiled
        if not options.get("cache") or not hasattr(dispatcher, "enable_caching"):
            return compiled
        # Cached where numba finds a folder, else in the scratch folder.
        try:
            dispatcher.enable_caching()
        except RuntimeError:  # numba's word for no place
            folder, settings = find_scratch(), cast(Any, numba.config)
            if folder is None:
                return compiled
            chosen, settings.CACHE_DIR = settings.CACHE_DIR, str(folder / "numba")
            try:
                dispatcher.enable_caching()
            except RuntimeError:
                return compiled
            finally:
                settings.CACHE_DIR = chosen
        # If the cache cannot be read or written, compile without it.
        kept = dispatcher._cache
        for name in ("load_overload", "save_overload"):
            setattr(kept, name, _return_none_for_errors(getattr(kept, name)))
        return compiled

    return decorate


def _return_none_for_errors(work: Callable[..., Any]) -> Callable[..., Any]:
    def attempt(*arguments: Any) -> Any:
        try:
            return work(*arguments)
        except Exception:
            return None

    return attempt
