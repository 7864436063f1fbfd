"""The store: what one method made of one walk, and what a paper's experiments measured, one file each.

A result holds as long as its settings are the same: the parameters of the method, of the walk, of the stances and of
the calibration. Code that differs does not make it invalid: each result has the sum over the code that made it, so that
it can be shown, or made again. Measurements hold as long as the code is the same. A missing, damaged or older file is
read as None, and its content is made again.

Positions are rounded to the centimetre, errors and arrays are exact to the last bit.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, TypeAdapter

from fg_nav.lab.store.code import code_sum, sum_sources
from fg_nav.lab.store.files import atomic_write, make_folder, write_text
from fg_nav.lab.walked import WalkErrors
from fg_nav.text import to_json

FORM = 2  # Layout of the files; one of another form does not hold.

Arrays: TypeAlias = Mapping[str, NDArray[Any]]

Number: TypeAlias = Annotated[float, BeforeValidator(lambda value: math.nan if value is None else value)]
"""A number that JSON has as null where it is NaN, and as a text where it is infinite (`encode_number`)."""


def encode_number(value: float) -> float | str | None:
    """Return a number as JSON has it."""
    if math.isnan(value):
        return None
    return value if math.isfinite(value) else str(value)


MEASUREMENTS = "parts"  # Folder of the measurements of a reproduction.


@dataclass(frozen=True)
class Measurement:
    """Arrays that a function measures once for one seed, such as a calibration loop.

    They hold as long as the code is the same, to the last statement: the library's, and that of all modules in the
    folder of the function's own, which `code_sum` leaves out.
    """

    name: str  # of the file
    measure: partial[Arrays]  # call of a function of a module, which can be sent to another process

    def read(self, folder: Path) -> Arrays | None:
        """Return the stored arrays; None if there are none that hold."""
        try:
            with np.load(folder / MEASUREMENTS / f"{self.name}.npz") as found:
                arrays = dict(found)
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None
        return arrays if str(arrays.pop("code", "")) == self._code else None

    def run(self, folder: Path) -> None:
        """Measure and store; raises `OutputError` if the system refuses."""
        arrays = {"code": np.array(self._code), **self.measure()}
        path = make_folder(folder / MEASUREMENTS) / f"{self.name}.npz"
        with atomic_write(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]

    def load(self, folder: Path) -> Arrays:
        """Return the arrays, measured now if they are missing."""
        if self.read(folder) is None:
            self.run(folder)
        found = self.read(folder)
        assert found is not None
        return found

    @property
    def _code(self) -> str:
        return f"{FORM} {code_sum()} {_sum_folder(Path(inspect.getfile(self.measure.func)).parent)}"


@cache
def _sum_folder(folder: Path) -> str:
    return sum_sources(sorted(folder.glob("*.py")))


MAX_NAME, CUT = 200, 160  # Bytes of a file's name before `.json`, and of a longer one after cutting: 255 are allowed.

USED, NOT_USED = "u", "-"  # Flag of a footfall in `Result.used`.


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
        if len(name.encode()) > MAX_NAME:
            name = f"{name.encode()[:CUT].decode(errors='ignore')}~{hashlib.sha256(name.encode()).hexdigest()[:16]}"
        return f"{name}.json"


@dataclass(frozen=True)
class Result:
    """What one method made of one walk."""

    key: Key
    settings: Mapping[str, Any]
    code: str  # sum over the code that made it
    failed: str = ""  # why there is no more; empty if there is
    errors: Mapping[str, WalkErrors] = field(default_factory=dict)  # by alignment (`fg_nav.lab.walked`)
    landmark: Sequence[str] = ()  # names, one a crossing
    landmark_m: Mapping[str, Sequence[Number]] = field(default_factory=dict)  # error at each crossing, by alignment
    whitened: Mapping[str, Sequence[Sequence[Number]]] = field(
        default_factory=dict
    )  # by part (`fg_nav.lab.consistency`)
    estimate: Mapping[str, Sequence[Sequence[Number]]] = field(
        default_factory=dict
    )  # (K, 2) m at footfalls, by alignment
    truth: Sequence[Sequence[Number]] = ()  # (M, 2) m
    used: str = ""  # (K,) whether the method used the field
    samples: int = 0
    runtime_s: float = 0.0  # of the method
    parameters: Mapping[str, Any] = field(default_factory=dict)  # effective ones of the method
    notes: Sequence[str] = ()

    @property
    def us_per_sample(self) -> float:
        """Runtime of the method alone."""
        return 1e6 * self.runtime_s / max(self.samples, 1)


def write_result(folder: Path, result: Result) -> None:
    """Write a result; another process may write at the same time. Raises `OutputError` if the system refuses."""
    write_text(folder / result.key.file, json.dumps({"form": FORM, **to_json(result)}) + "\n")


def read_result(folder: Path, key: Key, settings: Mapping[str, Any]) -> Result | None:
    """Read a result; None if there is none that holds."""
    try:
        content = json.loads((folder / key.file).read_text(encoding="utf-8"))
        if content.pop("form") != FORM or content["settings"] != to_json(settings):
            return None
        result = _adapter().validate_python(content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return result if result.key == key else None


@cache
def _adapter() -> TypeAdapter[Result]:
    return TypeAdapter(Result)
