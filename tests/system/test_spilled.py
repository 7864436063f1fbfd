"""Long columns lie in a file that has no name, and are the same numbers."""

import mmap
from pathlib import Path

import numpy as np
import pytest

from fg_nav.system import spilled
from fg_nav.system.spilled import drop_pages, empty_column, join_columns, take_rows


@pytest.fixture
def short_is_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """Columns of 800 bytes lie in a file."""
    if spilled._find_disk() is None:
        pytest.skip("no temporary files on a disk")
    monkeypatch.setattr(spilled, "MIN_BYTES", 800)
    monkeypatch.setattr(spilled, "BLOCK_ROWS", 7)


def _lies_in_file(column: np.ndarray) -> bool:
    """Whether the memory of an array is that of a mapped file."""
    base = column
    while isinstance(base, np.ndarray) and base.base is not None:
        base = base.base
    return isinstance(getattr(base, "obj", base), mmap.mmap)


@pytest.mark.usefixtures("short_is_long")
def test_a_long_column_lies_in_a_file_and_a_short_one_does_not() -> None:
    assert _lies_in_file(empty_column(50, 3))
    assert not _lies_in_file(empty_column(20, 3))


@pytest.mark.usefixtures("short_is_long")
def test_dropped_pages_come_back_with_what_was_written() -> None:
    column, numbers = empty_column(50, 3), np.random.default_rng(1).normal(size=(50, 3))
    column[...] = numbers
    drop_pages()
    assert np.array_equal(column, numbers)


@pytest.mark.usefixtures("short_is_long")
def test_rows_and_columns_are_those_of_numpy() -> None:
    rng = np.random.default_rng(2)
    one, other = rng.normal(size=(100, 3)), rng.normal(size=(100, 2))
    index = np.flatnonzero(rng.random(100) > 0.3)
    assert np.array_equal(take_rows(index, one, other), np.hstack([one, other])[index])
    assert np.array_equal(join_columns(one, other), np.hstack([one, other]))


def test_a_full_disk_leaves_the_column_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(spilled, "MIN_BYTES", 800)
    monkeypatch.setattr(spilled.os, "posix_fallocate", fail)
    column = empty_column(50, 3)
    column[...] = 1.0
    assert not _lies_in_file(column)


@pytest.mark.parametrize(
    ("mounts", "in_memory"),
    [
        ("/dev/sda / ext4 rw\n", False),
        ("/dev/sda / ext4 rw\ntmpfs {} tmpfs rw\n", True),
        ("tmpfs {} tmpfs rw\n/dev/sdb {} ext4 rw\n", False),
        ("/dev/sdb {} ext4 rw\ntmpfs {} tmpfs rw\n", True),
        ("tmpfs {} tmpfs rw\n/dev/sdc /media/M\udce4rz vfat rw\n", True),
    ],
    ids=["a disk", "memory", "a disk on top", "memory on top", "a name that is not UTF-8"],
)
def test_a_folder_in_memory_is_known_by_the_mount_on_top(
    mounts: str, in_memory: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = tmp_path / "mounts"
    folder = tmp_path / "a b"
    table.write_bytes(mounts.replace("{}", str(folder).replace(" ", "\\040")).encode("utf-8", "surrogateescape"))
    monkeypatch.setattr(spilled, "MOUNTS", table)
    assert spilled._is_in_memory(folder) is in_memory
