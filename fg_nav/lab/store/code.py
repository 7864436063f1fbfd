"""Sums over the sources that make a result, with the libraries that they run on and without.

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

SHOWS_ONLY = ("report/", "commands/", "lab/verbs/", "cli/")  # Sources that change no result.
PAPERS = "lab/reproduce/"  # Sources that change results of papers alone, whose own parts have sums of their own.
LIBRARIES = ("gtsam", "numpy", "scipy", "numba", "pandas")  # Libraries that results depend on, to the last bit.


@cache
def code_sum() -> str:
    """Sum over the package's sources and their runtime, of what makes the result of a walk."""
    return sum_sources(list_sources((*SHOWS_ONLY, PAPERS)))


@cache
def source_sum() -> str:
    """Sum over the package's sources alone, those of the papers' experiments too; of one minor version of Python."""
    return sum_sources(list_sources(SHOWS_ONLY), "")


def list_sources(without: tuple[str, ...]) -> list[Path]:
    """List the package's sources but those whose names in it begin so."""
    root = Path(str(fg_nav.__file__)).parent
    sources = {*root.rglob("*.py"), *root.glob("factors/*.py")}  # factors is a link in a checkout
    return sorted(path for path in sources if not path.relative_to(root).as_posix().startswith(without))


def sum_sources(sources: Iterable[Path], runtime: str | None = None) -> str:
    """Sum over the executable part of these sources and a runtime, by default this one."""
    total = hashlib.sha256((describe_runtime() if runtime is None else runtime).encode())
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
