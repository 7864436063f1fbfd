"""Entries of a store: a file with its content and the settings that made it.

An entry holds as long as its settings are the same; a missing, damaged or older file is read as None, and its content
is made again. Content is JSON, or arrays that come back to the last bit.
"""

from __future__ import annotations

import inspect
import json
import math
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator

from fg_nav.lab.store.code import code_sum, sum_sources
from fg_nav.lab.store.files import atomic_write, make_folder, write_text
from fg_nav.text import to_json

FORM = 2
"""Layout of the files; an entry of another form does not hold."""

Arrays: TypeAlias = Mapping[str, NDArray[Any]]

Number: TypeAlias = Annotated[float, BeforeValidator(lambda value: math.nan if value is None else value)]
"""A number that JSON has as null where it is NaN, and as a text where it is infinite (`encode_number`)."""


def encode_number(value: float) -> float | str | None:
    """Return a number as JSON has it."""
    if math.isnan(value):
        return None
    return value if math.isfinite(value) else str(value)


@dataclass(frozen=True)
class Entry:
    """One file, and the settings that its content is made with."""

    path: Path
    settings: Mapping[str, Any]

    def read(self) -> dict[str, Any] | None:
        """Return the content of a JSON file with its settings; None if it does not hold."""
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
            holds = content.pop("form") == FORM and content["settings"] == to_json(self.settings)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
        return content if holds else None

    def write(self, content: Mapping[str, Any]) -> None:
        """Write a JSON file; another process may write at the same time. Raises `OutputError` if the system refuses."""
        whole = {"form": FORM, **content, "settings": to_json(self.settings)}
        write_text(self.path, json.dumps(whole) + "\n")

    def read_arrays(self) -> dict[str, NDArray[Any]] | None:
        """Return the arrays of a `.npz` file; None if it does not hold."""
        try:
            with np.load(self.path) as found:
                arrays = dict(found)
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None
        return arrays if str(arrays.pop("settings", "")) == self._settings_text else None

    def write_arrays(self, arrays: Arrays) -> None:
        """Write a `.npz` file; raises `OutputError` if the system refuses."""
        with atomic_write(self.path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **{"settings": np.array(self._settings_text), **arrays})  # type: ignore[arg-type]

    @property
    def _settings_text(self) -> str:
        return json.dumps({"form": FORM, **to_json(self.settings)}, sort_keys=True)


MEASUREMENTS = "parts"
"""Folder of the measurements of a reproduction."""


@dataclass(frozen=True)
class Measurement:
    """Arrays that a function measures once for one seed, such as a calibration loop.

    They hold as long as the code is the same, to the last statement: the library's and the function's own module.

    Attributes
    ----------
    name : of the file.
    measure : call of a function of a module, which can be sent to another process.
    """

    name: str
    measure: partial[Arrays]

    def read(self, folder: Path) -> dict[str, NDArray[Any]] | None:
        """Return the stored arrays; None if there are none that hold."""
        return self._entry(folder).read_arrays()

    def run(self, folder: Path) -> None:
        """Measure and store; raises `OutputError` if the system refuses."""
        arrays = self.measure()
        make_folder(folder / MEASUREMENTS)
        self._entry(folder).write_arrays(arrays)

    def load(self, folder: Path) -> dict[str, NDArray[Any]]:
        """Return the arrays, measured now if they are missing."""
        if self.read(folder) is None:
            self.run(folder)
        found = self.read(folder)
        assert found is not None
        return found

    def _entry(self, folder: Path) -> Entry:
        settings = {"code": f"{code_sum()} {_sum_module(self.measure.func)}"}
        return Entry(folder / MEASUREMENTS / f"{self.name}.npz", settings)


@cache
def _sum_module(function: Callable[..., Any]) -> str:
    """Sum over the module of a function, which `code_sum` leaves out; it imports no other module of the experiments."""
    return sum_sources([Path(inspect.getfile(function))])
