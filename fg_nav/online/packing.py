"""Values as bytes, and back, to the last bit: what a checkpoint is made of.

    count of bytes (8) | JSON: tree of the value, types and shapes of its arrays | the arrays, one behind the other

None, booleans, numbers, text and lists stand in the tree as they are; all else is an object with one key that says
what it is. Arrays keep their order in memory, so that what is computed from them later comes out the same.

Reading runs no code but this: of a class that the bytes name an object is made without a call, and given its
attributes. Only classes of this package are taken, from modules that are loaded.
"""

from __future__ import annotations

import dis
import json
import sys
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fg_nav.errors import FormatError

PACKAGE = "fg_nav."  # Whose classes are taken.
KINDS = "biufc"  # Of arrays: numbers.

SEQUENCES: dict[str, type[Any]] = {"tuple": tuple, "deque": deque}

Array = NDArray[Any]


def pack(value: object) -> bytes:
    """Return a value as bytes; raises `TypeError` for what is not listed above."""
    arrays: list[Array] = []
    tree = _Packer(arrays).pack(value)
    kept = [{"type": one.dtype.str, "shape": one.shape, "by_column": _is_by_column(one)} for one in arrays]
    head = json.dumps({"tree": tree, "arrays": kept}).encode()
    return b"".join([len(head).to_bytes(8, "little"), head, *(_bytes_of(one) for one in arrays)])


def unpack(content: bytes | memoryview) -> Any:
    """Return the value that some bytes are.

    Raises
    ------
    FormatError
        If they are none.
    """
    try:
        view = memoryview(content)
        behind = 8 + int.from_bytes(view[:8], "little")
        head = json.loads(bytes(view[8:behind]))
        return _Unpacker(list(_read_arrays(head["arrays"], view[behind:]))).unpack(head["tree"])
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, RecursionError):
        raise FormatError("these bytes are no values that can be read.") from None


class _Packer:
    """Puts arrays aside, and what is left into a tree."""

    def __init__(self, arrays: list[Array]) -> None:
        self._arrays = arrays

    def pack(self, value: object) -> Any:
        kind = type(value)
        if value is None or kind in (bool, int, float, str):
            return value
        if kind in (list, tuple, deque):
            assert isinstance(value, list | tuple | deque)
            return self._pack_sequence(value)
        if isinstance(value, np.ndarray):
            return {"array": self._put_aside(value)}
        if isinstance(value, np.generic):
            return {"scalar": self._put_aside(np.asarray(value))}
        if kind in (dict, Counter):
            assert isinstance(value, dict)
            return {kind.__name__: [[self.pack(key), self.pack(item)] for key, item in value.items()]}
        return self._pack_object(value)

    def _pack_sequence(self, value: Sequence[Any] | deque[Any]) -> Any:
        name = type(value).__name__
        if _is_stackable(value):
            packed: Any = {"rows": self._put_aside(np.array(value))}
        else:
            packed = [self.pack(item) for item in value]
        if isinstance(value, deque):
            return {name: [packed, value.maxlen]}
        return packed if isinstance(value, list) else {name: packed}

    def _pack_object(self, value: object) -> dict[str, Any]:
        kind = type(value)
        name = f"{kind.__module__}:{kind.__qualname__}"
        if _find_class(name) is not kind:
            raise TypeError(f"a checkpoint does not know {name}")
        if isinstance(value, tuple):
            return {"object": [name, [self.pack(item) for item in value]]}
        return {"object": [name, {key: self.pack(item) for key, item in vars(value).items()}]}

    def _put_aside(self, array: Array) -> int:
        if array.dtype.kind not in KINDS:
            raise TypeError(f"a checkpoint does not know arrays of {array.dtype}")
        self._arrays.append(array)
        return len(self._arrays) - 1


class _Unpacker:
    """Makes a value of a tree and its arrays."""

    def __init__(self, arrays: list[Array]) -> None:
        self._arrays = arrays

    def unpack(self, tree: Any) -> Any:
        if isinstance(tree, list):
            return [self.unpack(item) for item in tree]
        if not isinstance(tree, dict):
            return tree
        ((kind, content),) = tree.items()
        match kind:
            case "array":
                return self._arrays[content]
            case "scalar":
                return self._arrays[content][()]
            case "rows":
                return [row.copy() for row in self._arrays[content]]
            case "tuple":
                return tuple(self.unpack(content))
            case "deque":
                return deque(self.unpack(content[0]), maxlen=content[1])
            case "dict" | "Counter":
                found = {self.unpack(key): self.unpack(item) for key, item in content}
                return found if kind == "dict" else Counter(found)
            case "object":
                return self._make_object(*content)
        raise ValueError(f"no kind of value is called {kind}")

    def _make_object(self, name: str, content: Any) -> Any:
        kind: Any = _find_class(name)
        if kind is None:
            raise ValueError(f"{name} is no class of this package")
        parts = self.unpack(content) if isinstance(content, list) else None
        if issubclass(kind, tuple):
            if parts is None or len(parts) != len(getattr(kind, "_fields", ())):
                raise ValueError(f"{name} has other parts")
            return tuple.__new__(kind, parts)
        attributes = {str(key): self.unpack(item) for key, item in content.items()}
        if not _names_of(kind) <= set(attributes):
            raise ValueError(f"{name} has other fields")
        made = object.__new__(kind)
        vars(made).update(attributes)
        return made


@cache
def _names_of(kind: type[Any]) -> frozenset[str]:
    """Return the attributes that every object of a class has: its fields, or what its `__init__` sets."""
    if is_dataclass(kind):
        return frozenset(item.name for item in fields(kind))
    code = getattr(kind.__init__, "__code__", None)
    if code is None:
        return frozenset()
    return frozenset(one.argval for one in dis.get_instructions(code) if one.opname == "STORE_ATTR")


def _find_class(name: str) -> type[Any] | None:
    """Return a class of this package by `module:name`; None if there is none, or if its module is not loaded."""
    module, _, own = name.partition(":")
    found = getattr(sys.modules.get(module), own, None) if module.startswith(PACKAGE) else None
    return found if isinstance(found, type) and found.__module__ == module else None


def _is_stackable(value: Sequence[Any] | deque[Any]) -> bool:
    """Whether a sequence holds arrays that are rows of one."""
    if len(value) < 2 or not isinstance(value[0], np.ndarray) or value[0].ndim != 1:
        return False
    shape, dtype = value[0].shape, value[0].dtype
    return all(type(one) is np.ndarray and one.shape == shape and one.dtype == dtype for one in value)


def _is_by_column(array: Array) -> bool:
    return bool(array.flags.f_contiguous and not array.flags.c_contiguous)


def _bytes_of(array: Array) -> bytes:
    return array.tobytes("A")


def _read_arrays(kept: list[dict[str, Any]], content: memoryview) -> Iterator[Array]:
    """Yield the arrays, each with memory of its own."""
    at = 0
    for one in kept:
        dtype, shape = np.dtype(str(one["type"])), tuple(int(size) for size in one["shape"])
        if dtype.kind not in KINDS or min(shape, default=0) < 0:
            raise ValueError("these are no numbers")
        stop = at + dtype.itemsize * int(np.prod(shape, dtype=object))
        flat = np.frombuffer(content[at:stop], dtype=dtype).copy()
        yield flat.reshape(shape[::-1]).T if one["by_column"] else flat.reshape(shape)
        at = stop
    if at != len(content):
        raise ValueError("there are other arrays")
