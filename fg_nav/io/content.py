"""What a file holds: its first lines, or the variables of a MATLAB file (version 5 to 7.2).

Formats are recognized from this alone, never from the file's name. scipy's MATLAB reader trusts the file: on a damaged
one nearly any exception may come out of it. Only this module calls it.
"""

from __future__ import annotations

import csv
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import scipy.io

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError

_HEAD_BYTES = 65536


@dataclass(frozen=True)
class Content:
    """The beginning of a file: `lines` of text or `variables` of a MATLAB file; both empty for neither."""

    path: Path
    lines: tuple[str, ...] = ()
    variables: frozenset[str] = frozenset()

    def fields(self, line: int = 0) -> list[str]:
        """Comma-separated fields of one of the first lines, stripped; empty if there is no such line."""
        return split_fields(self.lines[line]) if line < len(self.lines) else []


def split_fields(line: str) -> list[str]:
    """Comma-separated fields of a line, quotes and surrounding blanks removed."""
    try:
        return [field.strip() for field in next(csv.reader([line]), [])]
    except csv.Error:
        return []


def read_content(path: Path) -> Content:
    """Open a file and see what it is made of.

    Raises `FormatError` if the path is no readable file, or the file is empty.
    """
    head = _read_head(path)
    if not head.strip():
        raise FormatError(f"{path.name} is empty: record or export it again.")
    if is_mat(head):
        return Content(path, variables=list_variables(path))
    if b"\0" in head:
        return Content(path)
    return Content(path, lines=tuple(_decode(head).splitlines()))


def _read_head(path: Path) -> bytes:
    if path.is_dir():
        raise FormatError(f"{path} is a directory: give one of the files in it.")
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except FileNotFoundError:
        raise FormatError(f"{path} does not exist: check the path.") from None
    except PermissionError:
        raise FormatError(f"{path} may not be read: check its permissions.") from None
    except (OSError, ValueError) as error:
        raise FormatError(f"{path} cannot be opened ({error}): check the path.") from None


def _decode(head: bytes) -> str:
    """Text of the head. A byte that is no UTF-8 (a degree or micro sign, mostly) is taken as Latin-1."""
    if len(head) == _HEAD_BYTES:  # a character may be cut in two at the end
        head = head[: head.rfind(b"\n") + 1] or head
    try:
        return head.decode("utf-8-sig")
    except UnicodeDecodeError:
        return head.decode("latin-1").removeprefix("ï»¿")


T = TypeVar("T")


def is_mat(head: bytes) -> bool:
    """Whether a file that begins like this is a MATLAB file (version 5 or later)."""
    return head.startswith(b"MATLAB ")


def list_variables(path: Path) -> frozenset[str]:
    """Names of the variables in a MATLAB file.

    Raises `FormatError` if the file is damaged or of version 7.3.
    """
    return frozenset(name for name, _, _ in _run_reader(path, scipy.io.whosmat))


def load_mat(path: Path) -> Mapping[str, Any]:
    """Variables of a MATLAB file by name.

    Raises `FormatError` if the file is damaged or of version 7.3.
    """
    return _run_reader(path, scipy.io.loadmat)


def mat_array(variables: Mapping[str, Any], name: str, path: Path, columns: int | None = None) -> Floats:
    """Take a variable as floats: (M, columns), or (M,) without `columns`.

    Raises `FormatError` if the variable is missing, not real numbers, or of another shape.
    """
    value = variables.get(name)
    if value is None:
        raise FormatError(f"{path.name} holds no variable '{name}': export it again with '{name}'.")
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
        raise FormatError(f"{path.name}: variable '{name}' is not an array of real numbers: export it again.")
    if columns is None and (value.ndim > 2 or value.size != max(value.shape, default=1)):
        raise FormatError(f"{path.name}: variable '{name}' has shape {value.shape} where a vector is needed.")
    if columns is not None and (value.ndim != 2 or value.shape[1] != columns):
        raise FormatError(f"{path.name}: variable '{name}' has shape {value.shape}, not (N, {columns}).")
    # uint8 would wrap in differences: everything is a float from here on.
    numbers = np.array(value, dtype=np.float64, order="C")
    return numbers.reshape(-1) if columns is None else numbers


def _run_reader(path: Path, reader: Callable[[str], T]) -> T:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # scipy warns of what it then raises or repairs
            return reader(str(path))
    except NotImplementedError:
        raise FormatError(
            f"{path.name} is a MATLAB 7.3 file, which is not read here: save it again with '-v7'."
        ) from None
    except Exception as error:  # the zoo: zlib, struct, Value, Type, Key, Index, Memory, Overflow ... errors
        reason = type(error).__name__
        raise FormatError(f"{path.name} is a damaged MATLAB file ({reason}): copy or export it again.") from None
