"""MATLAB files (version 4 to 7.2) as float arrays of the expected shape, or a FormatError.

scipy's reader trusts the file: on a damaged one nearly any exception may come out of it. Only this module
calls it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import scipy.io

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError

T = TypeVar("T")


def is_mat(head: bytes) -> bool:
    """Whether a file that begins like this is a MATLAB file (version 5 or later)."""
    return head.startswith(b"MATLAB ")


def variable_names(path: Path) -> frozenset[str]:
    """Names of the variables in a MATLAB file.

    Raises
    ------
    FormatError
        If the file is damaged or of version 7.3.
    """
    return frozenset(name for name, _, _ in _guarded(path, scipy.io.whosmat))


def load(path: Path) -> Mapping[str, Any]:
    """Variables of a MATLAB file by name.

    Raises
    ------
    FormatError
        If the file is damaged or of version 7.3.
    """
    return _guarded(path, scipy.io.loadmat)


def array(variables: Mapping[str, Any], name: str, path: Path, columns: int | None = None) -> Floats:
    """Take a variable as floats: (M, columns), or (M,) without `columns`.

    Raises
    ------
    FormatError
        If the variable is missing, not real numbers, or of another shape.
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


def _guarded(path: Path, reader: Callable[[str], T]) -> T:
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
