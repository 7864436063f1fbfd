"""What a checkpoint holds and what it costs: saves that add, a file that was damaged or made up, a lag."""

import json
import os
from collections import Counter, deque
from pathlib import Path

import numpy as np
import pytest
from fg_nav.online.checkpoint import VERSION, Checkpoint
from fg_nav.online.packing import pack, unpack, write_records

from fg_nav.errors import EstimationError, FormatError, OutputError
from fg_nav.online import OnlineNavigator, load, save
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.overlap import HEAD
from tests.online.walks import NORTH, push, short_walk, solve_in_windows, worst_difference


def push_and_save(options, rows, path, every=150, resume_at=()):
    """Walk with a save every so many rows; at some of the saves it is killed and resumed."""
    checkpoint, navigator = Checkpoint(path), OnlineNavigator(options)
    for number, start in enumerate(range(0, len(rows), every)):
        push(navigator, rows[start : start + every], range(10, every, 30))
        checkpoint.write(checkpoint.collect(navigator))
        if number in resume_at:
            push(navigator, rows[start + every : start + every + 90])  # walked after the save, and lost
            checkpoint = Checkpoint(path)
            navigator = checkpoint.resume(options)
    navigator.close()
    return navigator


@pytest.mark.parametrize(("lag_s", "strides"), [(None, 30), (12.0, 46)])
def test_killed_again_and_again_a_walk_in_windows_ends_with_the_same_answer(lag_s, strides, tmp_path, monkeypatch):
    """With a lag the samples of its beginning are not there any more, in memory nor in the file."""
    solve_in_windows(monkeypatch, behind=12)
    monkeypatch.setattr("fg_nav.online.checkpoint.MIN_BYTES", 0)
    rows, options = rows_of(short_walk(strides)), OnlineOptions(lag_s=lag_s)
    uninterrupted = OnlineNavigator(options)
    push(uninterrupted, rows)
    uninterrupted.close()
    path = tmp_path / "walk.checkpoint"
    navigator = push_and_save(options, rows, path, every=250, resume_at=range(1, 40, 2))
    assert worst_difference(navigator.causal(), uninterrupted.causal()) < 1e-9
    assert worst_difference(navigator.smoothed(), uninterrupted.smoothed()) < 1e-9
    assert navigator.buffer.first == uninterrupted.buffer.first
    assert (navigator.buffer.first > 0) == (lag_s is not None)
    # A source that begins again, from its first row on: what was discarded is too late, the rest is known.
    again = load(path, options)
    assert len(push(again, rows, range(100, len(rows), 100))) == 0
    counts = again.judge.counts
    assert counts["known"] + counts["late"] == len(rows)
    assert counts["late"] == max(again.buffer.first - HEAD, 0)
    assert (again.buffer.first > HEAD) == (lag_s is not None)


def test_a_resume_takes_no_samples_before_the_last_solution(tmp_path, monkeypatch):
    rows = rows_of(short_walk(20))
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows)
    save(navigator, tmp_path / "walk.checkpoint")
    seen = []
    monkeypatch.setattr(OnlineNavigator, "add_rows", lambda self, rows: seen.append(len(rows)))
    again = load(tmp_path / "walk.checkpoint")
    assert sum(seen) == 0
    assert again.buffer.stop == len(rows)


def test_each_save_adds_what_is_new(tmp_path):
    rows, path = rows_of(short_walk()), tmp_path / "walk.checkpoint"
    checkpoint, navigator = Checkpoint(path), OnlineNavigator(NORTH)
    push(navigator, rows[:900])
    checkpoint.write(checkpoint.collect(navigator))
    before = path.read_bytes()
    push(navigator, rows[900:910])
    checkpoint.write(checkpoint.collect(navigator))
    after = path.read_bytes()
    assert after.startswith(before)
    assert len(after) - len(before) < 10 * 80 + 8000
    # A file that somebody removed is written again, as a whole.
    path.unlink()
    push(navigator, rows[910:920])
    checkpoint.write(checkpoint.collect(navigator))
    assert load(path).buffer.stop == 920


def test_a_save_that_fails_leaves_the_old_checkpoint(tmp_path, monkeypatch):
    navigator, path = OnlineNavigator(NORTH), tmp_path / "walk.checkpoint"
    checkpoint = Checkpoint(path)
    push(navigator, rows_of(short_walk())[:300])
    checkpoint.write(checkpoint.collect(navigator))
    before = path.read_bytes()
    push(navigator, rows_of(short_walk())[300:400])

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OutputError, match="no space left"):
            checkpoint.write(checkpoint.collect(navigator))
        assert path.read_bytes() == before
        with pytest.raises(OutputError, match="no space left"):
            save(navigator, path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    checkpoint.write(checkpoint.collect(navigator))  # there is room again
    assert load(path).buffer.stop == 400


def test_a_save_that_was_cut_off_is_left_out(tmp_path):
    rows, path, told = rows_of(short_walk()), tmp_path / "walk.checkpoint", []
    checkpoint, navigator, sizes = Checkpoint(path), OnlineNavigator(NORTH), []
    for start in (0, 400):
        push(navigator, rows[start : start + 400])
        checkpoint.write(checkpoint.collect(navigator))
        sizes.append(path.stat().st_size)
    content, whole = path.read_bytes(), sizes[0]
    for cut in (content[: whole + 5], content[:-1], content[:-9] + b"x" + content[-8:]):
        path.write_bytes(cut)
        assert load(path, remark=told.append).buffer.stop == 400
        assert path.stat().st_size == whole
    assert len(told) == 3
    assert all("not whole" in words for words in told)


def test_what_is_no_checkpoint_is_refused(tmp_path):
    path, head = tmp_path / "walk.npz", b"fg-nav walk" + bytes([VERSION])
    for content in (b"", b"PK\x03\x04 broken", b"time_s,acc\n1,2\n", head + b"\x00", head + b"\x00abc"):
        path.write_bytes(content)
        with pytest.raises(FormatError, match="no checkpoint"):
            load(path)
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows_of(short_walk())[:300])
    save(navigator, path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError):
        load(path)
    path.write_bytes(whole)
    with pytest.raises(EstimationError, match="other options"):
        load(path, OnlineOptions(heading_rad=1.0))
    path.write_bytes(whole.replace(head, b"fg-nav walk\x63"))
    with pytest.raises(FormatError, match="version 99"):
        load(path)


@pytest.mark.parametrize(
    "value",
    [
        {"object": ["os:system", ["true"]]},
        {"object": ["fg_nav.errors:np", []]},
        {"object": ["fg_nav.online.anchor:Past", {"first": 1}]},
        {"object": ["fg_nav.online.anchor:PathNodes", [1]]},
        {"array": 3},
        {"call": "os"},
    ],
)
def test_a_file_that_was_made_up_runs_nothing(value, tmp_path):
    head = json.dumps({"tree": value, "arrays": []}).encode()
    with pytest.raises(FormatError):
        unpack(len(head).to_bytes(8, "little") + head)
    for record in (pack({"other": 1}), len(head).to_bytes(8, "little") + head):
        write_records(tmp_path / "walk", VERSION, [record])
        with pytest.raises(FormatError, match="no checkpoint"):
            load(tmp_path / "walk")


def test_values_come_back_to_the_last_bit():
    by_column = np.asfortranarray(np.random.default_rng(0).normal(size=(3, 4)))
    value = {
        "numbers": [1, 0.1, float("nan"), float("-inf"), True, None, "x"],
        ("a", 2): (by_column, np.float64(0.3), np.arange(3)[::2]),
        "rows": deque([np.arange(3.0), np.ones(3)], maxlen=5),
        "counts": Counter(a=2),
        "options": NORTH,
        "empty": np.empty((0, 10)),
    }
    again = unpack(pack(value))
    assert pack(again) == pack(value)
    assert again["a", 2][0].flags.f_contiguous
    assert again["rows"].maxlen == 5
    assert again["options"] == NORTH
    with pytest.raises(TypeError):
        pack(Path())


def test_two_streams_into_one_checkpoint_are_refused_whichever_was_there_first(tmp_path):
    path, rows = tmp_path / "walk", rows_of(short_walk())[:300]
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows)
    first, second = Checkpoint(path), Checkpoint(path)
    with first.hold(), second.hold():  # neither has saved yet
        first.write(first.collect(navigator))
        with pytest.raises(OutputError, match="another stream saves its walk in"):
            second.write(second.collect(navigator))
        first.write(first.collect(navigator))
        with pytest.raises(OutputError, match="another stream"), Checkpoint(path).hold():
            pass
    with Checkpoint(path).hold():
        assert load(path).buffer.stop == 300
