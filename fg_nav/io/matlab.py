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

import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fg_nav.io.packed import MAX_BYTES

Element: TypeAlias = tuple[int, memoryview]  # Type and data of an element.

_HEADER_BYTES, _VERSION, _VERSION_7_3 = 128, slice(124, 126), 0x0200
_ORDERS = MappingProxyType({b"IM": "<", b"MI": ">"})

_MATRIX, _COMPRESSED = 14, 15
_INTEGERS_32, _TEXTS = (5, 6), (1, 2, 16)
_NUMBERS = MappingProxyType({
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
})  # fmt: skip
"""Types of elements that hold numbers, as numpy names them without the byte order."""

_OPAQUE, _NUMERIC_CLASSES, _COMPLEX = 17, range(6, 16), 0x0800

_BEGINNING_BYTES = 4096  # Flags, dimensions and name of a variable take less than 400.


class DamagedError(ValueError):
    """What a file says of itself cannot be: the message says what, in a few words."""


class TooNewError(ValueError):
    """A file of version 7.3, which is HDF5."""


@dataclass(frozen=True)
class _Variable:
    """The beginning of a matrix: its name, class, flags and dimensions, and the elements that follow."""

    name: str
    kind: int
    is_complex: bool
    dimensions: tuple[int, ...]
    rest: Iterator[Element]


def list_names(data: bytes) -> frozenset[str]:
    """Names of the variables in the bytes of a file; raises `DamagedError` or `TooNewError`."""
    order, names = _read_header(data), set[str]()
    for kind, part in _variables(data, order):
        if kind == _COMPRESSED:  # as far as the name is in it
            begin = memoryview(_decompress(zlib.decompressobj(), part[:_BEGINNING_BYTES], _BEGINNING_BYTES))
            part = begin[8 : 8 + _read_matrix_size(begin, order)]
        names.add(_open_variable(part, order).name)
    return frozenset(names - {""})


def load_arrays(data: bytes) -> dict[str, NDArray[Any] | None]:
    """Return the real arrays in the bytes of a file by name, in their stored type; None for other variables.

    Raises `DamagedError` or `TooNewError`.
    """
    order = _read_header(data)
    arrays, budget = {}, MAX_BYTES
    for kind, part in _variables(data, order):
        if kind == _COMPRESSED:  # of at most as many bytes as are left
            unpack = zlib.decompressobj()
            size = _read_matrix_size(memoryview(_decompress(unpack, part, 8)), order)
            if size > budget:
                raise DamagedError(f"it says that it holds more than {MAX_BYTES // 2**30} GiB")
            part = memoryview(_decompress(unpack, unpack.unconsumed_tail, size + 1))
            if len(part) != size or not unpack.eof:
                raise DamagedError("a compressed part is not as long as it says")
            budget -= size
        variable = _open_variable(part, order)
        if variable.name:  # MATLAB keeps functions in one without a name
            arrays[variable.name] = _read_numbers(variable, order)
    return arrays


def _read_header(data: bytes) -> str:
    """Byte order of a file."""
    order = _ORDERS.get(data[126:_HEADER_BYTES])
    if order is None:
        raise DamagedError("its header is not whole")
    if int.from_bytes(data[_VERSION], "little" if order == "<" else "big") == _VERSION_7_3:
        raise TooNewError
    return order


def _variables(data: bytes, order: str) -> Iterator[Element]:
    for kind, part in _elements(memoryview(data)[_HEADER_BYTES:], order):
        if kind not in (_MATRIX, _COMPRESSED):
            raise DamagedError("it holds something other than variables")
        yield kind, part


def _elements(data: memoryview, order: str) -> Iterator[Element]:
    """Yield type and data of each element, to the end; `order` is the byte order."""
    place = 0
    while place < len(data):
        kind, size = _read_tag(data[place:], order)
        within = kind >> 16
        start = place + (4 if within else 8)
        end = start + (within or size)
        if end > (place + 8 if within else len(data)):
            raise DamagedError("a part of it is larger than what holds it")
        yield kind & 0xFFFF if within else kind, data[start:end]
        place = place + 8 if within else end + (0 if kind == _COMPRESSED else -size % 8)


def _read_tag(data: memoryview, order: str) -> tuple[int, int]:
    if len(data) < 8:
        raise DamagedError("it is cut off")
    kind, size = np.frombuffer(data[:8], f"{order}u4").tolist()
    return kind, size


def _open_variable(data: memoryview, order: str) -> _Variable:
    """Read name, type and dimensions of a matrix, whose values may be cut off; the values stay unread."""
    elements = _elements(data, order)
    flags, *_ = _take_integers(elements, order, 2)
    kind = flags & 0xFF
    dimensions = () if kind == _OPAQUE else _take_integers(elements, order)
    type, name = next(elements, (0, data))
    if type not in _TEXTS or min(dimensions, default=0) < 0:
        raise DamagedError("a variable has no name, or no size")
    return _Variable(bytes(name).decode("latin-1"), kind, bool(flags & _COMPLEX), dimensions, elements)


def _take_integers(elements: Iterator[Element], order: str, count: int | None = None) -> tuple[int, ...]:
    """Integers of the next element: as many as given, else two or more, as dimensions are."""
    type, part = next(elements, (0, memoryview(b"")))
    if type not in _INTEGERS_32 or len(part) % 4 or len(part) < 8 or (count is not None and len(part) != 4 * count):
        raise DamagedError("a variable does not begin as one")
    return tuple(np.frombuffer(part, f"{order}i4").tolist())


def _read_numbers(variable: _Variable, order: str) -> NDArray[Any] | None:
    """Values of a variable; None if they are no real numbers."""
    if variable.kind not in _NUMERIC_CLASSES or variable.is_complex:
        return None
    type, part = next(variable.rest, (0, memoryview(b"")))
    stored = np.dtype(order + _NUMBERS.get(type, "V1"))
    if type not in _NUMBERS or math.prod(variable.dimensions) * stored.itemsize != len(part):
        raise DamagedError("a variable holds other than its size says")
    try:
        return np.frombuffer(part, stored).reshape(variable.dimensions, order="F")
    except ValueError:  # more dimensions than an array can have
        raise DamagedError("a variable has too many dimensions") from None


def _decompress(unpack: zlib._Decompress, packed: memoryview | bytes, most: int) -> bytes:
    try:
        return unpack.decompress(packed, most)
    except zlib.error:
        raise DamagedError("a compressed part cannot be unpacked") from None


def _read_matrix_size(data: memoryview, order: str) -> int:
    kind, size = _read_tag(data, order)
    if kind != _MATRIX:
        raise DamagedError("a compressed part is no variable")
    return size
