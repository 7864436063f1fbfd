"""What one method made of one walk, one file each, by its key.

A result holds as long as its settings are the same: the parameters of the method, of the walk, of the stances and of
the calibration. Code that differs does not make it invalid: each result has the sum over the code that made it
(`fg_nav.lab.store.code`), so that it can be shown, or made again.

Positions are rounded to the centimetre, errors are exact to the last bit.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from fg_nav.evaluation.walked import WalkErrors
from fg_nav.lab.store.entries import Entry, Number
from fg_nav.text import to_json

LONGEST_NAME, CUT = 200, 160
"""Bytes of a file's name before `.json`, and of a longer one after cutting: file systems allow 255."""

USED, NOT_USED = "u", "-"
"""Flag of a footfall in `Result.used`."""


@dataclass(frozen=True, order=True)
class Key:
    """A method on a walk: group (scenario, or folder of recordings), field, walk (seed or file), magnetometer."""

    group: str
    field: str
    walk: str
    magnetometer: str
    method: str

    @property
    def file(self) -> str:
        """Name of the file."""
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
    key, settings, code : which result, its settings, and the sum over the code that made it.
    failed : why there is no more; empty if there is.
    errors : by alignment (`fg_nav.evaluation.walked`).
    landmark : names, one a crossing.
    landmark_m : error at each crossing, by alignment.
    whitened : errors of position and heading over their sigma, by part (`fg_nav.evaluation.consistency`).
    estimate, truth : (K, 2) m, (M, 2) m at the footfalls, by alignment.
    every : whether the truth is that of every footfall.
    used : (K,) whether the method used the field.
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
    landmark_m: Mapping[str, Sequence[Number]] = field(default_factory=dict)
    whitened: Mapping[str, Sequence[Sequence[Number]]] = field(default_factory=dict)
    estimate: Mapping[str, Sequence[Sequence[Number]]] = field(default_factory=dict)
    truth: Sequence[Sequence[Number]] = ()
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


def drop_paths(result: Result) -> Result:
    """Return a result without estimate, truth and whitened errors, which are most of its memory."""
    return replace(result, estimate={}, truth=(), whitened={})


def encode_flags(used: Sequence[bool]) -> str:
    """Return one flag a footfall."""
    return "".join(USED if one else NOT_USED for one in used)


def write_result(folder: Path, result: Result) -> None:
    """Write a result; raises `OutputError` if the system refuses."""
    Entry(folder / result.key.file, result.settings).write(to_json(result))


def read_result(folder: Path, key: Key, settings: Mapping[str, Any]) -> Result | None:
    """Read a result; None if there is none that holds."""
    content = Entry(folder / key.file, settings).read()
    try:
        result = None if content is None else _adapter().validate_python(content)
    except ValidationError:
        return None
    return result if result is not None and result.key == key else None


@cache
def _adapter() -> TypeAdapter[Result]:
    return TypeAdapter(Result)
