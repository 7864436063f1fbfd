"""Folders, archives, pipes and MATLAB files are looked into, within bounds; no wrong byte ends the process."""

from __future__ import annotations

import codecs
import gzip
import io
import itertools
import os
import threading
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse

from fg_nav.errors import FormatError
from fg_nav.io import content as contents
from fg_nav.io import matlab, read_fixes, read_raw, read_truth, write_canonical
from fg_nav.io.content import read_content
from tests.io.samples import RAW, write_pyshoe, write_xio, write_zip


@pytest.fixture
def text(tmp_path: Path) -> bytes:
    write_canonical(RAW, tmp_path / "one.csv")
    return (tmp_path / "one.csv").read_bytes()


def write_folder(path: Path, files: Mapping[str, bytes]) -> Path:
    for name, data in files.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)
    return path


def refuse(path: Path | str, words: str, **options: str) -> None:
    with pytest.raises(FormatError, match=words):
        read_raw(path, **options)


JUNK = {"__MACOSX/._walk.csv": b"\0\5", ".DS_Store": b"\0", "Annotation.csv": b"", "readme.txt": b"of today\n"}


def test_the_one_recording_in_it_is_found(text: bytes, tmp_path: Path) -> None:
    cut_off = {"old.csv.gz": gzip.compress(b"t,ax\n")[:-9]}
    for k, (folder, more) in enumerate((("", {}), ("my walk/", {}), ("", cut_off))):
        files = {**{folder + name: data for name, data in JUNK.items()}, f"{folder}walk.csv": text, **more}
        for path in (write_folder(tmp_path / f"walk{k}", files), write_zip(tmp_path / f"walk{k}.zip", files)):
            raw = read_raw(path)
            np.testing.assert_array_equal(raw.acc, RAW.acc)
            assert raw.provenance.path.name == "walk.csv"
            assert sorted(read_content(path).members) == [*more, "readme.txt", "walk.csv"]


def test_what_is_no_one_recording_is_refused(text: bytes, tmp_path: Path) -> None:
    write_xio(RAW, tmp_path / "xio.csv")
    path = write_zip(tmp_path / "walk.zip", {"a.csv": text, "b.csv": (tmp_path / "xio.csv").read_bytes()})
    assert read_raw(path, "xio").provenance.format == "xio"
    refuse(path, r"holds 2 recordings \(a.csv, b.csv\): give one of them")
    refuse(path, r"walk\.zip is not a MATLAB file", format="pyshoe")
    write_folder(tmp_path / "walk", {"a/one.csv": text, "b/two.csv": b"no recording\n", "c/three.csv": text})
    refuse(tmp_path / "walk", r"walk holds 2 recordings \(a/one.csv, c/three.csv\)")
    refuse(tmp_path / "walk" / "b", r"none of the \d+ formats")
    with pytest.raises(FormatError, match="no column 'time_s'"):
        read_fixes(tmp_path / "walk")
    inner = write_zip(tmp_path / "walk.zip", {"one.csv": text})
    outer = write_zip(tmp_path / "all.zip", {"day/walk.zip": inner.read_bytes()})
    refuse(outer, r"'walk.zip', none of them a recording \(archives stay shut\)")
    # places that lead out
    (tmp_path / "in").mkdir()
    names = ["../walk.csv", "a/../../walk.csv", "/etc/walk.csv", "c:/walk.csv", "..\\walk.csv"]
    refuse(write_zip(tmp_path / "in" / "walk.zip", dict.fromkeys(names, text)), "holds no file")
    assert [path.name for path in (tmp_path / "in").iterdir()] == ["walk.zip"]
    assert not (tmp_path / "walk.csv").exists()


def test_gzip_of_text_and_of_matlab(text: bytes, tmp_path: Path) -> None:
    path = tmp_path / "walk"
    write_pyshoe(RAW, tmp_path / "walk.mat")
    files = {"walk.csv.gz": gzip.compress(text), "walk.mat.gz": b"no MATLAB file"}
    inside = write_zip(tmp_path / "walk.zip", files).read_bytes()
    for data in (
        gzip.compress(text[:300]) + gzip.compress(text[300:]),
        gzip.compress((tmp_path / "walk.mat").read_bytes()),
        inside,
        gzip.compress(inside),
    ):
        path.write_bytes(data)
        np.testing.assert_array_equal(read_raw(path).gyr, RAW.gyr)


def test_text_of_any_encoding(tmp_path: Path) -> None:
    write_xio(RAW, tmp_path / "xio.csv")
    words = (tmp_path / "xio.csv").read_text().replace("deg/s", "°/s").replace("(uT)", "(µT)")
    for encoding in ("utf-8", "utf-8-sig", "utf-16", "utf-16-be", "latin-1"):
        mark = b"\xfe\xff" if encoding == "utf-16-be" else b""
        (tmp_path / "walk.csv").write_bytes(mark + words.encode(encoding))
        np.testing.assert_allclose(read_raw(tmp_path / "walk.csv").gyr, RAW.gyr, rtol=1e-14)
        if encoding != "latin-1":
            assert read_content(tmp_path / "walk.csv").read_text() == words


def test_what_is_too_large_is_refused_before_it_is_unpacked(
    text: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = {f"{k}.csv": b"1" for k in range(4)}
    many = write_folder(tmp_path / "walk", files), write_zip(tmp_path / "many.zip", files)
    write_zip(tmp_path / "walk.zip", {"walk.csv": text, "zero.bin": bytes(50_000)})
    (tmp_path / "walk.gz").write_bytes(gzip.compress(text + b"\n" * 50_000))
    monkeypatch.setattr(contents, "MAX_BYTES", 50_000)
    refuse(tmp_path / "walk.zip", r"walk.zip holds more than .* unpack it")
    refuse(tmp_path / "walk.gz", r"walk.gz is larger than .* write it into a file")
    monkeypatch.setattr(contents, "MAX_FILES", 3)
    for path in many:
        refuse(path, "holds more than 3 files")


@contextmanager
def piped(data: bytes, path: Path) -> Iterator[Path]:
    """A named pipe that gives the data once."""
    os.mkfifo(path)
    writer = threading.Thread(target=path.write_bytes, args=(data,), daemon=True)
    writer.start()
    yield path
    writer.join(timeout=5.0)
    assert not writer.is_alive()


def test_a_pipe_is_read_once_and_whole(text: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_pyshoe(RAW, tmp_path / "walk.mat")
    zipped = write_zip(tmp_path / "walk.zip", {"walk.csv": text}).read_bytes()
    packed = (
        text,
        gzip.compress(text),
        zipped,
        codecs.BOM_UTF16_BE + text.decode().encode("utf-16-be"),
        (tmp_path / "walk.mat").read_bytes(),
    )
    for k, data in enumerate(packed):
        with piped(data, tmp_path / f"pipe{k}") as path:
            raw = read_raw(path)
        np.testing.assert_array_equal(raw.acc, RAW.acc)
        np.testing.assert_array_equal(raw.t, RAW.t)
    with piped(gzip.compress(b"0 1 2 3 0 0 0 1\n1 2 2 3 0 0 0 1\n"), tmp_path / "truth") as path:
        np.testing.assert_array_equal(read_truth(path).position[:, 0], [1.0, 2.0])
    with piped(b"", tmp_path / "empty") as path:
        refuse(path, "empty is empty")
    monkeypatch.setattr(contents, "MAX_BYTES", 1000)
    monkeypatch.setattr(contents, "_PART_BYTES", 500)
    refuse("/dev/zero", r"/dev/zero is larger than .* write it into a file, and cut it")


def test_line_ends_of_all_kinds_count_as_they_are_read(text: bytes, tmp_path: Path) -> None:
    lines = text.decode().splitlines()
    mixed = "".join(line + end for line, end in zip(lines, itertools.cycle(("\n", "\r\n", "\r"))))
    # an ellipsis of Windows is a line end to some, and none to the reader of tables
    ellipsis = b"# caf\xe9 \x85 25 \xb0C\n" + text.replace(b"acc_x_m_s2", b"ax [m/s\xb2]")
    for k, data in enumerate((mixed.encode(), ellipsis)):
        path = tmp_path / f"{k}.csv"
        path.write_bytes(data)
        raw = read_raw(path)
        np.testing.assert_array_equal(raw.acc, RAW.acc)
        assert raw.row[0] == 2 + k


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
    parts = [(6, [6, 0], ">u4"), (5, [2, 1], ">i4"), (1, [ord("x")], ">i1"), (9, [1.5, -2.5], ">f8")]
    matrix = b"".join(pack(kind, np.array(values, dtype=dtype).tobytes()) for kind, values, dtype in parts)
    data = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI" + pack(14, matrix)
    values = matlab.load_arrays(data, "walk.mat")["x"]
    np.testing.assert_array_equal(values, [[1.5], [-2.5]])
    np.testing.assert_array_equal(values, scipy.io.loadmat(io.BytesIO(data))["x"])


@pytest.mark.parametrize("compress", [False, True])
def test_one_wrong_byte_is_read_or_refused(compress: bool) -> None:
    """Of all places, three wrong bytes, a flipped bit, and the end; some would end the process of scipy's reader."""
    file = io.BytesIO()
    small = {"imu": np.zeros((2, 6)), "n": 3, "cube": CUBE[:1, :1, :2], "w": "text", "s": {"a": 1}, "c": 1j}
    scipy.io.savemat(file, small, do_compression=compress)
    whole = file.getvalue()
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
