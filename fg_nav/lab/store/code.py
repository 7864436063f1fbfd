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
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):  # without texts that stand alone
            body = getattr(node, "body", None)
            if isinstance(body, list):
                body[:] = [x for x in body if not (isinstance(x, ast.Expr) and isinstance(x.value, ast.Constant))]
        total.update(ast.dump(tree).encode())
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
