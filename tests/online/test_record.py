"""What is recorded of a stream: all that could be read, to the last bit, whatever becomes of program and disk."""

import asyncio
import errno
import os
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError, OutputError
from fg_nav.io import read_raw, write_canonical
from fg_nav.online import record
from fg_nav.online.buffer import rows_of
from fg_nav.online.record import Record
from fg_nav.online.sources import Replay
from tests.online.walks import short_walk


@pytest.fixture(scope="module")
def rows():
    odd = rows_of(short_walk()).copy()
    odd[100:110, 2] = np.nan
    odd[200:300, 7:10] = np.nan
    odd[400, 1] = np.inf
    odd[500:520, 0] -= 3.0
    return odd


@pytest.fixture(autouse=True)
def hurry(monkeypatch):
    monkeypatch.setattr(record, "RETRY_S", 0.01)


def recorded(path: Path):
    raw = read_raw(path)
    assert raw.pressure is None
    return np.column_stack([raw.t, raw.acc, raw.gyr, raw.mag, np.full(len(raw.t), np.nan)])


def write(path, rows, goes_on=False, force=False, block=50):
    said = []
    recording = Record(path, goes_on, force, said.append)
    recording.begin({})
    for k in range(0, len(rows), block):
        recording.add(rows[k : k + block], None)
    recording.add(rows[:0], None, at_end=True)
    recording.close()
    return said


def test_an_older_file_is_kept_unless_it_may_be_replaced(rows, tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text("a letter\nto my mother")
    with pytest.raises(OutputError, match="there already"):
        write(path, rows)
    with pytest.raises(FormatError, match="not recorded by"):
        write(path, rows, goes_on=True)
    write(path, rows[:0], force=True)  # another source, of which no sample has come yet
    assert path.read_text() == "a letter\nto my mother"
    write(path, rows[:100], force=True)
    np.testing.assert_array_equal(recorded(path), rows[:100])
    with pytest.raises(OutputError, match="no such file"):
        write(tmp_path / "no folder" / "walk.csv", rows)


@pytest.mark.parametrize("kept", [0, 5, 700])
@pytest.mark.parametrize("back", [0, 30, 10_000], ids=["goes on", "some rows again", "from the beginning"])
def test_a_resumed_walk_goes_on_in_its_file(rows, tmp_path, kept, back):
    """Whose last line was cut off; what the source sends again is in it already."""
    path = tmp_path / "walk.csv"
    assert write(path, rows[:kept]) == []
    with path.open("a") as file:
        file.write("12.5,0.1,9" if kept else record.HEADER[:20])
    said = write(path, rows[max(kept - back, 0) :], goes_on=True)
    assert len(said) == (kept > 0 and back > 0)
    np.testing.assert_array_equal(recorded(path), rows)


def test_a_full_disk_does_not_end_the_walk(rows, tmp_path, monkeypatch):
    """It is said once, and what waited is written once there is room."""
    path, said, is_full = tmp_path / "walk.csv", [], [False]
    pwrite = os.pwrite

    def write_some(file, data, place):
        if is_full[0] and len(data) <= 100:
            raise OSError(errno.ENOSPC, "No space left on device")
        return pwrite(file, data[:100] if is_full[0] else data, place)

    monkeypatch.setattr(record.os, "pwrite", write_some)
    with closing(Record(path, False, False, said.append)) as recording:
        recording.begin({})
        for k in range(0, len(rows), 100):
            is_full[0] = 400 <= k < 900
            recording.add(rows[k : k + 100], None)
            time.sleep(0.02)
    np.testing.assert_array_equal(recorded(path), rows)
    assert [words.partition("walk.csv ")[2] for words in said] == [
        "cannot be written (no space left on device): the walk goes on, and it is tried again.",
        "is written again.",
    ]
    is_full[0], said[:] = True, []
    with closing(Record(tmp_path / "lost.csv", False, False, said.append)) as recording:
        recording.add(rows[:1000], None)  # with the entry on the walk
        recording.add_lines(["{}", "{}"])
    assert [words.rpartition(" lacks ")[2].split(" that")[0] for words in said[-2:]] == ["1000 samples", "3 lines"]


@pytest.mark.usefixtures("solved_here")
def test_a_replay_is_recorded_as_it_is_and_gives_its_walk(fg_nav, tmp_path):
    source = tmp_path / "walk.csv"
    write_canonical(short_walk(), source)
    words = ("stream", source, "--speed", "max", "--heading", 0, "--record", tmp_path / "record.csv", "--out")
    assert fg_nav(*words, tmp_path / "out").code == 0
    np.testing.assert_array_equal(recorded(tmp_path / "record.csv"), rows_of(short_walk()))
    assert fg_nav("run", source, "--method", "online", "--heading", 0, "--out", tmp_path / "run").code == 0
    ends = [np.loadtxt(tmp_path / name / "trajectory.tum")[-1, 1:4] for name in ("out", "run")]
    assert np.allclose(*ends, atol=1e-6)
    assert fg_nav(*words, tmp_path / "other").refused("record.csv", "--force")
    assert fg_nav("stream", source, "--record", source, "--force").refused("what is streamed")
    for speed in ("0", "-1", "nan", "fast"):
        assert fg_nav("stream", source, f"--speed={speed}").refused("--speed", "no factor")


def test_a_replay_takes_its_time():
    """Never faster than was asked; how much slower is up to the machine."""
    walk = short_walk()
    replay = Replay(walk, 40.0, "a walk")
    began, came = time.monotonic(), []

    async def read() -> None:
        while (rows := await replay.read()) is not None:
            came.extend(rows[:, 0].tolist())
            assert came == [] or (came[-1] - walk.t[0]) / 40.0 <= time.monotonic() - began

    asyncio.run(asyncio.wait_for(read(), 60.0))
    assert np.array_equal(came, walk.t)


def test_two_streams_into_one_file_are_refused(rows, tmp_path):
    path = tmp_path / "walk.csv"
    with closing(Record(path, False, False, print)) as first:
        first.begin({})
        for force in (False, True):
            with pytest.raises(OutputError, match="another stream records into"):
                Record(path, False, force, print)
        first.add(rows, None)
    np.testing.assert_array_equal(recorded(path), rows)
