"""Sum over the sources that make a result and the libraries that they run on.

Comments, layout and docstrings do not count, nor does code that only shows results.
"""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from pathlib import Path

import fg_nav

SHOWS_ONLY = ("report/", "commands/", "lab/verbs/", "lab/reproduce/", "cli/")  # Sources that change no result.
LIBRARIES = ("gtsam", "numpy", "scipy", "numba", "pandas")  # Libraries that results depend on, to the last bit.


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
    versions = ["Python {}.{}".format(*sys.version_info)]
    for name in LIBRARIES:
        try:
            versions.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:  # copied by hand
            versions.append(f"{name} unknown")
    return ", ".join(versions)


def strip_source(source: str) -> str:
    """Return a source without comments, layout and texts that stand alone."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [one for one in body if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))]
    return ast.dump(tree)
