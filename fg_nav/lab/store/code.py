"""Sum over the sources that make a result and the libraries that they run on.

Comments, layout and docstrings do not count, nor does code that only shows results.
"""

from __future__ import annotations

import ast
import hashlib
import sys
import threading
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from pathlib import Path

import fg_nav

SHOWS_ONLY = ("report/", "commands/", "lab/verbs/", "lab/reproduce/", "cli/")  # Sources that change no result.
LIBRARIES = ("gtsam", "numpy", "scipy", "numba", "pandas")  # Libraries that results depend on, to the last bit.

_PARSING = threading.Lock()
"""Python 3.11 fails where two threads of a worker parse at once (its recursion depth is one for all)."""


@cache
def code_sum() -> str:
    """Sum over the package's sources and their runtime."""
    root = Path(str(fg_nav.__file__)).parent
    sources = {*root.rglob("*.py"), *root.glob("factors/*.py")}  # factors is a link in a checkout
    return sum_sources(sorted(path for path in sources if not path.relative_to(root).as_posix().startswith(SHOWS_ONLY)))


def sum_sources(sources: Iterable[Path]) -> str:
    """Sum over the executable part of these sources and their runtime."""
    total = hashlib.sha256(describe_runtime().encode())
    for path in sources:
        total.update(strip_source(path.read_text(encoding="utf-8")).encode())
    return total.hexdigest()[:16]


@cache
def describe_runtime() -> str:
    """Return Python and libraries with versions; of Python major and minor, as the rest changes no result."""
    python = "Python {}.{}".format(*sys.version_info)
    return ", ".join([python, *(f"{name} {_version(name)}" for name in LIBRARIES)])


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:  # copied by hand
        return "unknown"


def strip_source(source: str) -> str:
    """Return a source without comments, layout and texts that stand alone."""
    with _PARSING:
        tree = ast.parse(source)
    return repr(_outline(tree))


def _outline(part: object) -> object:
    """Return a part of a tree as nested tuples: a third faster than `ast.dump`, and each worker waits for it."""
    if isinstance(part, list):
        return [_outline(one) for one in part if not _is_text(one)]
    if not isinstance(part, ast.AST):
        return part
    fields = (getattr(part, name) for name in part._fields if name != "ctx")  # load or store: its place says which
    return (type(part).__name__, *map(_outline, fields))


def _is_text(statement: object) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
