"""What an experiment measures once and keeps: arrays of one seed in a file of their own, made anew by other code.

Walks by methods are kept by `fg_nav.lab.campaign.kept`; this is for all else, such as a calibration loop. A part holds
as long as the code that made it is the same, to the last statement, and the libraries that it ran on: there is no other
way to tell what its numbers rest on. Numbers come back to the last bit, so that rows made from kept parts are those
made at once.
"""

from __future__ import annotations

import inspect
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fg_nav.errors import OutputError
from fg_nav.lab.campaign.kept import code_sum, sum_over
from fg_nav.lab.campaign.whole import whole

Arrays: TypeAlias = Mapping[str, NDArray[Any]]

FOLDER = "parts"
"""Of the folder of a reproduction."""


@dataclass(frozen=True)
class Part:
    """The name of a part's file, and what makes its arrays: a call of a function of a module, to be sent to workers."""

    name: str
    make: partial[Arrays]

    def read(self, folder: Path) -> dict[str, NDArray[Any]] | None:
        """Return the arrays; None where there are none, or other code made them, or the file is damaged."""
        try:
            with np.load(self._path(folder)) as found:
                arrays = dict(found)
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None
        return arrays if str(arrays.pop("code", "")) == self._code else None

    def of(self, folder: Path) -> dict[str, NDArray[Any]]:
        """Return the arrays, made now where they are missing."""
        found = self.read(folder)
        if found is None:
            self.make_into(folder)
            found = self.read(folder)
        assert found is not None
        return found

    def make_into(self, folder: Path) -> None:
        """Make the arrays and keep them; raises `OutputError` where the system refuses."""
        arrays = self.make()
        path = self._path(folder)
        try:
            path.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{path.parent} could not be made ({error.strerror}): name another folder.") from error
        with whole(path) as beside, beside.open("wb") as file:
            np.savez_compressed(file, **{"code": np.array(self._code), **arrays})  # type: ignore[arg-type]

    def _path(self, folder: Path) -> Path:
        return folder / FOLDER / f"{self.name}.npz"

    @property
    def _code(self) -> str:
        return f"{code_sum()} {_sum_of(self.make.func)}"


@cache
def _sum_of(function: Callable[..., Any]) -> str:
    """Sum over the module of a function, which is not among what `code_sum` looks at: it needs no other of them."""
    return sum_over([Path(inspect.getfile(function))])
