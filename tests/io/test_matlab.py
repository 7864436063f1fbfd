"""MATLAB files: what other programs write is read as scipy reads it; one wrong byte never ends the process."""

from __future__ import annotations

import io
import zlib
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse

from fg_nav.errors import FormatError
from fg_nav.io import matlab

CUBE = np.arange(24, dtype=np.int16).reshape(2, 3, 4)

NUMBERS: dict[str, Any] = {
    "imu": np.linspace(-1.0, 9.8, 42).reshape(7, 6),
    "ts": np.linspace(0.0, 1.0, 7)[None, :],
    "small": np.array([[3]], dtype=np.uint8),
    "moved": np.array([[True, False, True]]),
    "cube": CUBE,
    "nothing": np.empty((0, 3)),
    "wide": np.array([[2**40, -1]], dtype=np.int64),
}
OTHERS: dict[str, Any] = {
    "words": "a text",
    "cells": np.array([1, "two"], dtype=object),
    "struct": {"acc": np.zeros((3, 2)), "inner": {"deep": 1.0}},
    "complex": np.array([[1.0 + 2.0j]]),
    "sparse": scipy.sparse.eye(3, format="csc"),
}


def pack(kind: int, data: bytes, order: str = ">") -> bytes:
    """An element, by default as a machine of the other byte order writes it."""
    return np.array([kind, len(data)], dtype=order + "u4").tobytes() + data + bytes(-len(data) % 8)


def big_endian_file() -> bytes:
    """A file of one 2 x 1 array of float64."""
    parts = [(6, [6, 0], ">u4"), (5, [2, 1], ">i4"), (1, [ord("x")], ">i1"), (9, [1.5, -2.5], ">f8")]
    matrix = b"".join(pack(kind, np.array(values, dtype=dtype).tobytes()) for kind, values, dtype in parts)
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI" + pack(14, matrix)


@pytest.mark.parametrize("compress", [False, True])
def test_arrays_are_those_that_scipy_reads(compress: bool) -> None:
    file = io.BytesIO()
    scipy.io.savemat(file, {**NUMBERS, **OTHERS}, do_compression=compress)
    data = file.getvalue()
    arrays = matlab.load_arrays(data, "walk.mat")
    assert set(arrays) == set(NUMBERS) | set(OTHERS)
    assert {name for name, values in arrays.items() if values is None} == set(OTHERS)
    expected = scipy.io.loadmat(io.BytesIO(data))
    for name in NUMBERS:
        np.testing.assert_array_equal(arrays[name], expected[name], strict=True)


def test_other_byte_order() -> None:
    data = big_endian_file()
    values = matlab.load_arrays(data, "walk.mat")["x"]
    np.testing.assert_array_equal(values, [[1.5], [-2.5]])
    np.testing.assert_array_equal(values, scipy.io.loadmat(io.BytesIO(data))["x"])


def small_file(compress: bool) -> bytes:
    file = io.BytesIO()
    small = {"imu": np.zeros((2, 6)), "n": 3, "cube": CUBE[:1, :1, :2], "w": "text", "s": {"a": 1}, "c": 1j}
    scipy.io.savemat(file, small, do_compression=compress)
    return file.getvalue()


@pytest.mark.parametrize("compress", [False, True])
def test_one_wrong_byte_is_read_or_refused(compress: bool) -> None:
    """Of all places, three wrong bytes, a flipped bit, and the end; some would end the process of scipy's reader."""
    whole = small_file(compress)
    values, refused = np.random.default_rng(5).integers(256, size=(len(whole), 3), dtype=np.uint8), 0
    for at in range(116, len(whole)):
        wrong = [whole[:at] + bytes([value]) + whole[at + 1 :] for value in (*values[at], whole[at] ^ 1)]
        for data in (*wrong, whole[:at]):
            try:
                matlab.load_arrays(data, "walk.mat")
            except FormatError:
                refused += 1
    assert refused > len(whole)
    if not compress:  # 250 for the type 9 of the values: scipy's table of types has no such row
        at = whole.index(b"imu") + 4
        with pytest.raises(FormatError, match="damaged MATLAB file"):
            matlab.load_arrays(whole[:at] + bytes([250]) + whole[at + 1 :], "walk.mat")


def test_a_bomb_is_refused_before_it_is_unpacked() -> None:
    claim = np.array([14, 2**31], dtype="<u4").tobytes()
    bomb = zlib.compress(claim + bytes(2**24))
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    with pytest.raises(FormatError, match="1 GiB"):
        matlab.load_arrays(header + pack(15, bomb, "<")[: 8 + len(bomb)], "walk.mat")
