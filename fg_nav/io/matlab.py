"""MATLAB files of version 5 to 7.2: the names of their variables, and those that are arrays of real numbers.

A file is a header of 128 bytes (124 of text and an offset, 2 of version, 2 that show the byte order) and elements:

    element     tag (4 bytes type, 4 bytes size) and data, filled up to 8 bytes; or at most 4 bytes of data within the
                tag, if the upper half of the type is their number
    variable    an element `matrix`, or one that is compressed (zlib) as a whole, without filling
    matrix      elements: flags and class; dimensions; name; for numbers the values, by columns

Sizes are checked before anything is taken. The reader of scipy trusts what a file says, in compiled code: one wrong
byte may end the whole process there. Values of other classes (text, cells, structs, sparse arrays, complex numbers) are
not looked at: no recording is read from them.

Source: MathWorks, MAT-File Format, chapter 1.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError

Variables: TypeAlias = Mapping[str, NDArray[Any] | None]
"""Of a MATLAB file, by name: arrays of real numbers, None for all else."""

Element: TypeAlias = tuple[int, memoryview]  # Type and data of an element.

_MAX_BYTES = 2**30  # Of all variables unpacked, as `fg_nav.io.content.MAX_BYTES`.
_BEGINNING_BYTES = 4096  # Flags, dimensions and name of a variable take less than 400.
_ORDERS = MappingProxyType({b"IM": "<", b"MI": ">"})

_MATRIX, _COMPRESSED = 14, 15
_TEXTS = (1, 2, 16)
_NUMBERS = MappingProxyType({  # Types of elements that hold numbers, as numpy names them without the byte order.
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
})  # fmt: skip

_OPAQUE, _NUMERIC_CLASSES, _COMPLEX = 17, range(6, 16), 0x0800


def list_names(data: bytes, source: str) -> frozenset[str]:
    """Names of the variables in the bytes of the file `source`, of which the beginnings alone are unpacked."""
    with _explain_damage(source):
        order = _read_order(data, source)
        parts = _read_variables(data, order, _BEGINNING_BYTES)
        return frozenset(_open_variable(part, order)[0] for part in parts) - {""}


def load_arrays(data: bytes, source: str) -> Variables:
    """Return the real arrays in the bytes of the file `source` by name, in their stored type; None for others."""
    arrays = dict[str, NDArray[Any] | None]()
    with _explain_damage(source):
        order = _read_order(data, source)
        for part in _read_variables(data, order, _MAX_BYTES):
            name, is_real, dimensions, rest = _open_variable(part, order)
            type, values = next(rest, (0, part)) if is_real else (0, part)
            if is_real and type not in _NUMBERS:
                raise ValueError("a variable holds no numbers")
            if name:  # MATLAB keeps functions in one without a name
                stored = np.frombuffer(values, order + _NUMBERS[type]) if is_real else None
                arrays[name] = None if stored is None else stored.reshape(dimensions, order="F")
    return arrays


@contextmanager
def _explain_damage(source: str) -> Iterator[None]:
    """Raise `FormatError` where what a file says of itself cannot be."""
    try:
        yield
    except (ValueError, zlib.error) as error:
        raise FormatError(f"{source} is a damaged MATLAB file ({error}): copy or export it again.") from None


def _read_order(data: bytes, source: str) -> str:
    """Byte order of a file."""
    order = _ORDERS.get(data[126:128])
    if order is None:
        raise ValueError("its header is not whole")
    if int.from_bytes(data[124:126], "little" if order == "<" else "big") == 0x0200:
        raise FormatError(f"{source} is a MATLAB 7.3 file, which is not read here: save it again with '-v7'.")
    return order


def _read_variables(data: bytes, order: str, most: int) -> Iterator[memoryview]:
    """Yield the matrices of a file, of a compressed one at most as many bytes as given, and as are left of all."""
    budget = _MAX_BYTES
    for kind, part in _read_elements(memoryview(data)[128:], order):
        if kind == _COMPRESSED:
            unpack = zlib.decompressobj()
            kind, size = _read_tag(unpack.decompress(part, 8), order)
            budget -= size
            if budget < 0 and most == _MAX_BYTES:
                raise ValueError(f"it says that it holds more than {_MAX_BYTES // 2**30} GiB")
            part = memoryview(unpack.decompress(unpack.unconsumed_tail, min(size + 1, most)))
            if len(part) != size and most == _MAX_BYTES:
                raise ValueError("a compressed part is not as long as it says")
        if kind != _MATRIX:
            raise ValueError("it holds something other than variables")
        yield part


def _read_elements(data: memoryview, order: str) -> Iterator[Element]:
    """Yield type and data of each element, to the end; `order` is the byte order."""
    place = 0
    while place < len(data):
        kind, size = _read_tag(data[place : place + 8], order)
        within = kind >> 16
        start = place + (4 if within else 8)
        end = start + (within or size)
        if end > (place + 8 if within else len(data)):
            raise ValueError("a part of it is larger than what holds it")
        yield kind & 0xFFFF if within else kind, data[start:end]
        place = place + 8 if within else end + (0 if kind == _COMPRESSED else -size % 8)


def _read_tag(data: memoryview | bytes, order: str) -> tuple[int, int]:
    kind, size = np.frombuffer(data, f"{order}u4", count=2).tolist()
    return kind, size


def _open_variable(data: memoryview, order: str) -> tuple[str, bool, list[int], Iterator[Element]]:
    """Return name and dimensions of a matrix, whether it holds real numbers, and its further elements, unread."""
    elements = _read_elements(data, order)
    flags, _ = np.frombuffer(next(elements, (0, b""))[1], f"{order}i4").tolist()
    kind = flags & 0xFF
    dimensions = [] if kind == _OPAQUE else np.frombuffer(next(elements, (0, b""))[1], f"{order}i4").tolist()
    type, name = next(elements, (0, data))
    if type not in _TEXTS or min(dimensions, default=0) < 0:
        raise ValueError("a variable has no name, or no size")
    return bytes(name).decode("latin-1"), kind in _NUMERIC_CLASSES and not flags & _COMPLEX, dimensions, elements


def mat_array(variables: Variables, name: str, path: Path, columns: int | None = None) -> Floats:
    """Return the variable `name` as floats: (M, columns), or (M,) without `columns`."""
    value = variables.get(name)
    if value is None:
        raise FormatError(f"{path.name} holds no variable '{name}' of real numbers: export it again with '{name}'.")
    is_vector = value.ndim <= 2 and value.size == max(value.shape, default=1)
    if not (is_vector if columns is None else value.ndim == 2 and value.shape[1] == columns):
        needed = "a vector" if columns is None else f"(N, {columns})"
        raise FormatError(f"{path.name}: variable '{name}' has shape {value.shape}, not {needed}: export it again.")
    # uint8 would wrap in differences: everything is a float from here on
    numbers = np.array(value, dtype=np.float64, order="C")
    return numbers.reshape(-1) if columns is None else numbers
