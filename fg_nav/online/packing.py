"""What a checkpoint is made of: values as bytes, to the last bit, and a file of such records that only grows.

    value    count of bytes (8) | JSON: tree of the value, types and shapes of its arrays | the arrays, one by one
    file     "fg-nav walk" | version (2) | length (8), CRC-32 (4), bytes | length, CRC-32, bytes | ...

None, booleans, numbers, text and lists stand in the tree as they are; all else is an object with one key that names its
kind. Arrays keep their order in memory, so that later results of them are the same.

Reading runs no code but this: of a class that the bytes name an object is made without a call, and given its
attributes. Only classes of this package are accepted, from modules that are loaded.

A record is there as a whole or not at all: what a process that was killed, or a full disk, left of one at the end is
not read, and the next one is written in its place. Every record is on the disk before the call that writes it returns.
"""

from __future__ import annotations

import dis
import json
import os
import sys
import tempfile
import zlib
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from fg_nav.errors import FormatError

PACKAGE = "fg_nav."  # whose classes are accepted
KINDS = "biufc"  # of arrays: numbers
MAGIC = b"fg-nav walk"
CHECK = 12  # bytes before those of a record

Array = NDArray[Any]


def pack(value: object) -> bytes:
    """Return a value as bytes; raises `TypeError` for what is not listed above."""
    arrays: list[Array] = []
    tree = _to_tree(value, arrays)
    kept = [
        {
            "type": one.dtype.str,
            "shape": one.shape,
            "by_column": bool(one.flags.f_contiguous and not one.flags.c_contiguous),
        }
        for one in arrays
    ]
    head = json.dumps({"tree": tree, "arrays": kept}).encode()
    return b"".join([len(head).to_bytes(8, "little"), head, *(one.tobytes("A") for one in arrays)])


def unpack(content: bytes | memoryview) -> Any:
    """Return the value of some bytes; raises `FormatError` if they are none."""
    try:
        view = memoryview(content)
        behind = 8 + int.from_bytes(view[:8], "little")
        head = json.loads(bytes(view[8:behind]))
        return _from_tree(head["tree"], list(_read_arrays(head["arrays"], view[behind:])))
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, RecursionError):
        raise FormatError("these bytes are no values that can be read.") from None


def _to_tree(value: object, arrays: list[Array]) -> Any:
    """Return a value as values of JSON; arrays are moved into a list."""
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind in (list, tuple, deque):
        assert isinstance(value, list | tuple | deque)
        # rows of one shape and type are one array
        first = value[0] if len(value) > 1 else None
        if (
            isinstance(first, np.ndarray)
            and first.ndim == 1
            and all(type(one) is np.ndarray and one.shape == first.shape and one.dtype == first.dtype for one in value)
        ):
            packed: Any = {"rows": _move(np.array(value), arrays)}
        else:
            packed = [_to_tree(item, arrays) for item in value]
        if isinstance(value, deque):
            return {"deque": [packed, value.maxlen]}
        return packed if isinstance(value, list) else {"tuple": packed}
    if isinstance(value, np.ndarray):
        return {"array": _move(value, arrays)}
    if isinstance(value, np.generic):
        return {"scalar": _move(np.asarray(value), arrays)}
    if kind in (dict, Counter):
        assert isinstance(value, dict)
        return {kind.__name__: [[_to_tree(key, arrays), _to_tree(item, arrays)] for key, item in value.items()]}
    # an object of this package
    name = f"{kind.__module__}:{kind.__qualname__}"
    if _find_class(name) is not kind:
        raise TypeError(f"a checkpoint does not know {name}")
    if isinstance(value, tuple):
        return {"object": [name, [_to_tree(item, arrays) for item in value]]}
    return {"object": [name, {key: _to_tree(item, arrays) for key, item in vars(value).items()}]}


def _move(array: Array, arrays: list[Array]) -> int:
    """Add an array to a list; return its number."""
    if array.dtype.kind not in KINDS:
        raise TypeError(f"a checkpoint does not know arrays of {array.dtype}")
    arrays.append(array)
    return len(arrays) - 1


def _from_tree(tree: Any, arrays: list[Array]) -> Any:
    """Return the value of a tree and its arrays."""
    if isinstance(tree, list):
        return [_from_tree(item, arrays) for item in tree]
    if not isinstance(tree, dict):
        return tree
    ((kind, content),) = tree.items()
    match kind:
        case "array":
            return arrays[content]
        case "scalar":
            return arrays[content][()]
        case "rows":
            return [row.copy() for row in arrays[content]]
        case "tuple":
            return tuple(_from_tree(content, arrays))
        case "deque":
            return deque(_from_tree(content[0], arrays), maxlen=content[1])
        case "dict" | "Counter":
            found = {_from_tree(key, arrays): _from_tree(item, arrays) for key, item in content}
            return found if kind == "dict" else Counter(found)
        case "object":
            name, parts = content
            return _make_object(name, parts, arrays)
    raise ValueError(f"no kind of value is called {kind}")


def _make_object(name: str, content: Any, arrays: list[Array]) -> Any:
    """Return an object of a class, which is not called, with its parts or attributes."""
    kind: Any = _find_class(name)
    if kind is None:
        raise ValueError(f"{name} is no class of this package")
    parts = _from_tree(content, arrays) if isinstance(content, list) else None
    if issubclass(kind, tuple):
        if parts is None or len(parts) != len(getattr(kind, "_fields", ())):
            raise ValueError(f"{name} has other parts")
        return tuple.__new__(kind, parts)
    attributes = {str(key): _from_tree(item, arrays) for key, item in content.items()}
    if not _list_attributes(kind) <= set(attributes):
        raise ValueError(f"{name} has other fields")
    made = object.__new__(kind)
    vars(made).update(attributes)
    return made


@cache
def _list_attributes(kind: type[Any]) -> frozenset[str]:
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


def write_records(path: Path, version: int, records: Iterable[bytes]) -> int:
    """Write a file of records in place of another, which stays as it is until this one is complete; its size.

    Raises `OSError` if that cannot be.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(MAGIC + version.to_bytes(2, "little"))
            for record in records:
                _write_record(file, record)
            file.flush()
            os.fsync(file.fileno())
            size = file.tell()
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # the new name too
    finally:
        os.close(folder)
    return size


def append_record(path: Path, size: int, record: bytes) -> int:
    """Append a record to the first `size` bytes of a file, in place of what is behind them; its size then.

    Raises `OSError` if that cannot be: then the file ends where it did.
    """
    with path.open("r+b") as file:
        file.truncate(size)
        file.seek(size)
        try:
            _write_record(file, record)
            file.flush()
            os.fsync(file.fileno())
        except OSError:
            with suppress(OSError):
                file.truncate(size)
            raise
        return file.tell()


def read_records(path: Path, version: int) -> Iterator[tuple[bytes, int]]:
    """Yield the records of a file, each with the size of the file up to its end.

    Raises `FormatError` if the file is none, or one of another version.
    """
    with path.open("rb") as file:
        begin = file.read(len(MAGIC) + 2)
        if len(begin) < len(MAGIC) + 2 or not begin.startswith(MAGIC):
            raise FormatError(f"{path.name} is no checkpoint of a walk: name another file, or remove it.")
        other = int.from_bytes(begin[len(MAGIC) :], "little")
        if other != version:
            raise FormatError(
                f"{path.name} is a checkpoint of version {other} and this program reads {version}: begin again."
            )
        whole = os.fstat(file.fileno()).st_size
        while True:
            # up to one that is not there, or not as it was written
            check = file.read(CHECK)
            length, crc = int.from_bytes(check[:8], "little"), int.from_bytes(check[8:], "little")
            if len(check) < CHECK or length > whole - file.tell():
                return
            record = file.read(length)
            if len(record) != length or zlib.crc32(record) != crc:
                return
            yield record, file.tell()


def _write_record(file: IO[bytes], record: bytes) -> None:
    file.write(len(record).to_bytes(8, "little") + zlib.crc32(record).to_bytes(4, "little"))
    file.write(record)
