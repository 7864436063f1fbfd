"""Results of methods on walks, one small JSON file each, so that later runs join what earlier ones made.

A result holds as long as what it was made with, its settings, is the same: the parameters of the method, of the walk,
of the stances and of the calibration. Settings that differ make it anew. Code that differs does not: each result keeps
a sum over the sources that made it and the libraries they ran on (`code_sum`), so that who prints it can tell, or make
it anew.

Places are kept to the centimetre, errors to the last bit.
"""

from __future__ import annotations

import ast
import hashlib
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import fg_nav
from fg_nav.evaluation.walked import WalkErrors
from fg_nav.lab.campaign.whole import whole
from fg_nav.plain import plain

FORM = 2
"""Of the files: a result of another form is none."""

SEEN_ONLY = ("report/", "commands/", "lab/reproduce/", "cli.py")
"""Of the packages' sources what changes no result."""

LIBRARIES = ("gtsam", "numpy", "scipy", "numba", "pandas")
"""That results rest on, to the last bit."""

LONGEST_NAME, CUT = 200, 160
"""Bytes of a file's name before `.json`, and what is left of a longer one: file systems take 255 with all that is
put behind it while it is written."""


@dataclass(frozen=True, order=True)
class Key:
    """Which result: of a group (scenario, or set of real walks) in a field, a walk (seed or number) and a method."""

    group: str
    field: str
    walk: str
    magnetometer: str
    method: str

    @property
    def file(self) -> str:
        """Name of its file."""
        words = (self.group, self.field, self.magnetometer, self.method, self.walk)
        name = "_".join(word.replace(" ", "-").replace(":", "-").replace("/", "~") for word in words)
        if len(name.encode()) > LONGEST_NAME:
            name = f"{name.encode()[:CUT].decode(errors='ignore')}~{hashlib.sha256(name.encode()).hexdigest()[:16]}"
        return f"{name}.json"


@dataclass(frozen=True)
class Result:
    """What one method made of one walk.

    Attributes
    ----------
    key, settings, code : what it is of, and what it was made with.
    failed : why there is no more; empty where there is.
    errors : by alignment (`fg_nav.evaluation.walked`).
    landmark : names, one a crossing.
    landmark_m : error at each crossing, by alignment.
    whitened : errors of place and heading over their claim, by part (`fg_nav.evaluation.consistency`).
    estimate, truth : (K, 2) m, (M, 2) m at the footfalls, by alignment.
    every : whether the truth is that of every footfall.
    used : (K,) whether the method believed the field.
    samples, runtime_s : of the method.
    parameters : effective ones of the method.
    notes : remarks.
    """

    key: Key
    settings: Mapping[str, Any]
    code: str
    failed: str = ""
    errors: Mapping[str, WalkErrors] = field(default_factory=dict)
    landmark: Sequence[str] = ()
    landmark_m: Mapping[str, Sequence[float]] = field(default_factory=dict)
    whitened: Mapping[str, Sequence[Sequence[float]]] = field(default_factory=dict)
    estimate: Mapping[str, Sequence[Sequence[float]]] = field(default_factory=dict)
    truth: Sequence[Sequence[float]] = ()
    every: bool = True
    used: str = ""
    samples: int = 0
    runtime_s: float = 0.0
    parameters: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()

    @property
    def us_per_sample(self) -> float:
        """Runtime of the method alone."""
        return 1e6 * self.runtime_s / max(self.samples, 1)


def without_paths(result: Result) -> Result:
    """Return what is left without estimate, truth and their errors: those of hundreds of walks are a lot of memory."""
    return replace(result, estimate={}, truth=(), whitened={})


USED, NOT_USED = "u", "-"
"""Marks of a footfall in the file."""


def marks(used: Sequence[bool]) -> str:
    """One mark a footfall."""
    return "".join(USED if one else NOT_USED for one in used)


def keep(folder: Path, result: Result) -> None:
    """Write a result; another process may write at the same time.

    Raises
    ------
    OutputError
        Where the system refuses.
    """
    with whole(folder / result.key.file) as path:
        path.write_text(json.dumps({"form": FORM, **plain(result)}) + "\n", encoding="utf-8")


def kept(folder: Path, key: Key, settings: Mapping[str, Any]) -> Result | None:
    """Read a result; None where there is none, or it was made with other settings, or the file is damaged."""
    try:
        content = json.loads((folder / key.file).read_text(encoding="utf-8"))
        found = _result(content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return found if found.key == key and found.settings == plain(settings) else None


def _result(content: dict[str, Any]) -> Result:
    if content.pop("form") != FORM:
        raise ValueError("another form")
    content["key"] = Key(**content["key"])
    content["errors"] = {mode: WalkErrors(**errors) for mode, errors in content["errors"].items()}
    return Result(**content)


@cache
def code_sum() -> str:
    """Sum over the sources that make a result, and what they run on."""
    root = Path(str(fg_nav.__file__)).parent
    sources = {*root.rglob("*.py"), *root.glob("factors/*.py")}  # factors is a link where the package is a checkout
    return sum_over(sorted(path for path in sources if not path.relative_to(root).as_posix().startswith(SEEN_ONLY)))


def sum_over(sources: Iterable[Path]) -> str:
    """Sum over what runs of these sources, and what they run on."""
    total = hashlib.sha256(runs_on().encode())
    for path in sources:
        total.update(what_runs(path.read_text(encoding="utf-8")).encode())
    return total.hexdigest()[:16]


@cache
def runs_on() -> str:
    """Python and libraries with their versions; of Python the first two numbers, as the others change no figure."""
    python = "Python {}.{}".format(*sys.version_info)
    return ", ".join([python, *(f"{name} {_version(name)}" for name in LIBRARIES)])


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:  # laid there by hand
        return "unknown"


def what_runs(source: str) -> str:
    """Return a source without what changes no result: comments, layout, and texts that stand alone."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [one for one in body if not _is_text(one)]
    return ast.dump(tree)


def _is_text(statement: ast.AST) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
