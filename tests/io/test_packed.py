"""Folders, archives and gzip files are looked into, within bounds, and never unpacked onto the disk."""

from __future__ import annotations

import codecs
import gzip
import itertools
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.io import content as contents
from fg_nav.io import read_fixes, read_raw, read_truth, write_canonical
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


def encode_utf16(data: bytes) -> bytes:
    return codecs.BOM_UTF16_BE + data.decode().encode("utf-16-be")


def test_a_pipe_is_read_once_and_whole(text: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_pyshoe(RAW, tmp_path / "walk.mat")
    zipped = write_zip(tmp_path / "walk.zip", {"walk.csv": text}).read_bytes()
    packed = (text, gzip.compress(text), zipped, encode_utf16(text), (tmp_path / "walk.mat").read_bytes())
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
