"""Save, kill, resume: the same answer, whatever the instant."""

import json
from itertools import pairwise

import numpy as np
import pytest

from fg_nav.errors import EstimationError, FormatError, OutputError
from fg_nav.online import OnlineNavigator, load, save
from fg_nav.smoother.online import OnlineOptions
from tests.online.walks import TOLD, push, rows_of, short_walk, worst_difference


@pytest.fixture(scope="module")
def whole():
    navigator = OnlineNavigator(TOLD)
    push(navigator, rows_of(short_walk()))
    navigator.close()
    return navigator


def test_a_resumed_walk_ends_with_the_same_answer(whole, tmp_path):
    rows = rows_of(short_walk())
    rng = np.random.default_rng(5)
    navigator = OnlineNavigator(TOLD)
    at = [0, *np.sort(rng.integers(1, len(rows), 4)), len(rows)]
    for start, stop in pairwise(at):
        push(navigator, rows[start:stop], range(30, stop - start, 30))
        save(navigator, tmp_path / "walk.npz")
        push(navigator, rows[stop : stop + 100])  # walked after the save, and lost
        navigator = load(tmp_path / "walk.npz", TOLD)
    navigator.close()
    assert worst_difference(navigator.causal(), whole.causal()) < 1e-9
    assert worst_difference(navigator.smoothed(), whole.smoothed()) < 1e-9
    assert [p.name for p in tmp_path.iterdir()] == ["walk.npz"]


def test_what_the_checkpoint_knows_is_not_taken_twice(whole, tmp_path):
    rows = rows_of(short_walk())
    navigator = OnlineNavigator(TOLD)
    push(navigator, rows[:700])
    save(navigator, tmp_path / "walk.npz")
    told = []
    again = load(tmp_path / "walk.npz", remark=told.append)
    push(again, rows, range(20, len(rows), 20))  # a file is read from its beginning
    again.close()
    assert worst_difference(again.smoothed(), whole.smoothed()) < 1e-9
    assert again.judge.counts["known"] == 700
    assert len(told) == 1


def test_a_save_that_fails_leaves_the_old_checkpoint(tmp_path, monkeypatch):
    navigator = OnlineNavigator(TOLD)
    push(navigator, rows_of(short_walk())[:300])
    path = tmp_path / "walk.npz"
    save(navigator, path)
    before = path.read_bytes()
    push(navigator, rows_of(short_walk())[300:400])

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(OutputError, match="no space left"):
        save(navigator, path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["walk.npz"]


def test_what_is_no_checkpoint_is_refused(tmp_path):
    path = tmp_path / "walk.npz"
    for content in (b"", b"PK\x03\x04 broken", b"time_s,acc\n1,2\n"):
        path.write_bytes(content)
        with pytest.raises(FormatError, match="no checkpoint"):
            load(path)
    navigator = OnlineNavigator(TOLD)
    push(navigator, rows_of(short_walk())[:300])
    save(navigator, path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError):
        load(path)
    path.write_bytes(whole)
    with pytest.raises(EstimationError, match="other options"):
        load(path, OnlineOptions(heading_rad=1.0))
    arrays = dict(np.load(path))
    np.savez(path, **{**arrays, "version": np.array(99)})
    with pytest.raises(FormatError, match="version 99"):
        load(path)


def test_a_checkpoint_is_arrays_with_a_version(tmp_path):
    navigator = OnlineNavigator(TOLD)
    push(navigator, rows_of(short_walk())[:900])
    save(navigator, tmp_path / "walk.npz")
    with np.load(tmp_path / "walk.npz", allow_pickle=False) as content:
        assert int(content["version"]) == 1
        assert content["samples"].shape == (900, 10)
        assert len(content["footfall_stop"]) == len(navigator.footfalls) > 3
        assert json.loads(str(content["facts"]))["options"]["heading_rad"] == 0.0


def test_with_a_lag_there_is_no_checkpoint(tmp_path):
    with pytest.raises(EstimationError, match="lag"):
        save(OnlineNavigator(OnlineOptions(lag_s=60.0)), tmp_path / "walk.npz")
