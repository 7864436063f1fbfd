"""A result folder appears whole or not at all, and never in place of something else."""

import os
from pathlib import Path

import pytest

from fg_nav.errors import OutputError
from fg_nav.report import folder as folder_module
from fg_nav.report.folder import (
    check_free,
    claim_folder,
    hold_folder,
    result_file,
    result_files,
    result_folder,
)


def fill(folder: Path, words: str = "new") -> None:
    (folder / "summary.json").write_text(words)
    (folder / "config.json").write_text(words)


def make(out: Path, words: str) -> None:
    with result_folder(out) as folder:
        fill(folder, words)


def interrupted(out: Path, kind: type[BaseException]) -> None:
    with result_folder(out, force=True) as folder:
        fill(folder)
        raise kind


def content(out: Path) -> dict[str, str]:
    return {str(p.relative_to(out)): p.read_text() for p in out.rglob("*") if p.is_file()}


def test_result_is_not_visible_before_it_is_complete(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with result_folder(out) as folder:
        fill(folder)
        assert not (out / "summary.json").exists()
    assert content(out) == {"summary.json": "new", "config.json": "new"}
    assert sorted(p.name for p in out.iterdir()) == ["config.json", "summary.json"]


@pytest.mark.parametrize("kind", [RuntimeError, KeyboardInterrupt])
def test_failure_leaves_nothing(tmp_path: Path, kind: type[BaseException]) -> None:
    with pytest.raises(kind):
        interrupted(tmp_path / "out", kind)
    assert list(tmp_path.iterdir()) == []


def test_older_result_is_kept_without_force(tmp_path: Path) -> None:
    make(tmp_path / "out", "old")
    with pytest.raises(OutputError, match="--force"), result_folder(tmp_path / "out"):
        pass
    assert content(tmp_path / "out")["summary.json"] == "old"


def test_force_replaces_the_whole_older_result(tmp_path: Path) -> None:
    out = tmp_path / "out"
    make(out, "old")
    (out / "iez").mkdir()
    (out / "iez" / "strides.csv").write_text("old")
    with result_folder(out, force=True) as folder:
        fill(folder)
    assert content(out) == {"summary.json": "new", "config.json": "new"}


def test_force_that_fails_half_way_keeps_the_older_result(tmp_path: Path) -> None:
    make(tmp_path / "out", "old")
    with pytest.raises(RuntimeError):
        interrupted(tmp_path / "out", RuntimeError)
    assert content(tmp_path / "out") == {"summary.json": "old", "config.json": "old"}


@pytest.mark.parametrize("successes", range(4))
def test_a_move_that_fails_leaves_the_older_result_or_the_next_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, successes: int
) -> None:
    make(tmp_path / "out", "old")
    replace, calls = os.replace, []

    def fails_once(origin: Path, place: Path) -> None:
        calls.append(origin)
        if len(calls) == successes + 1:
            raise OSError(28, "No space left on device")
        replace(origin, place)

    monkeypatch.setattr(folder_module.os, "replace", fails_once)
    with (
        pytest.raises(OutputError, match="no space left"),
        result_folder(tmp_path / "out", force=True) as folder,
    ):
        fill(folder)
    with hold_folder(tmp_path / "out", force=True):
        words = "old" if successes < 3 else "new"
    assert content(tmp_path / "out") == {"summary.json": words, "config.json": words}
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["config.json", "summary.json"]


def test_summary_comes_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replace, order = os.replace, []
    monkeypatch.setattr(folder_module.os, "replace", lambda a, b: (order.append(Path(b).name), replace(a, b)))
    with result_folder(tmp_path / "out") as folder:
        fill(folder)
        (folder / "trajectory.tum").write_text("new")
    assert order[-1] == "summary.json"
    assert len([name for name in order if not name.startswith(".")]) == 3


@pytest.mark.parametrize("name", ["thesis.tex", "recording.csv", "data/walk.csv", "iez/notes.txt"])
def test_foreign_files_are_never_touched(tmp_path: Path, name: str) -> None:
    make(tmp_path / "out", "old")
    (tmp_path / "out" / name).parent.mkdir(exist_ok=True)
    (tmp_path / "out" / name).write_text("mine")
    with pytest.raises(OutputError, match=name), result_folder(tmp_path / "out", force=True):
        pass
    assert (tmp_path / "out" / name).read_text() == "mine"


def test_empty_folder_and_hidden_files_are_welcome(tmp_path: Path) -> None:
    (tmp_path / ".gitignore").write_text("mine")
    make(tmp_path, "new")
    assert content(tmp_path) == {".gitignore": "mine", "summary.json": "new", "config.json": "new"}


def test_file_in_place_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(OutputError, match="is a file"):
        check_free(tmp_path / "out", force=True)
    with pytest.raises(OutputError, match="cannot be written"), claim_folder(tmp_path / "out", "walk"):
        pass
    with pytest.raises(OutputError, match="cannot be written"), result_folder(tmp_path / "out" / "deeper"):
        pass


def test_claimed_folders_never_clash_and_go_away_on_failure(tmp_path: Path) -> None:
    with claim_folder(tmp_path / "results", "walk-iez") as first:
        fill(first)
        with claim_folder(tmp_path / "results", "walk-iez") as second:
            assert [first.name, second.name] == ["walk-iez-1", "walk-iez-2"]
    assert not second.exists()
    assert first.exists()


class Killed(BaseException):
    """A process that ends where it stands."""


def kill_while_moving(out: Path, monkeypatch: pytest.MonkeyPatch, successes: int) -> None:
    """Write a result with `force`, and end at some move, with nothing cleaned up."""
    replace, done = os.replace, []

    def move(origin: Path, place: Path) -> None:
        if len(done) == successes:
            raise Killed
        done.append(replace(origin, place))

    with monkeypatch.context() as patched:
        patched.setattr(folder_module.os, "replace", move)
        with pytest.raises(Killed), result_folder(out, force=True) as folder:
            fill(folder)


@pytest.mark.parametrize("successes", range(5))
def test_what_a_process_killed_amid_the_moves_left_becomes_one_whole_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, successes: int
) -> None:
    make(tmp_path / "out", "old")
    kill_while_moving(tmp_path / "out", monkeypatch, successes)
    assert len(list((tmp_path / "out").glob(".fg-nav-*"))) == min(successes, 1)
    with pytest.raises(OutputError, match="already holds a result"):
        make(tmp_path / "out", "newer")
    words = "old" if successes < 3 else "new"
    assert content(tmp_path / "out") == {"summary.json": words, "config.json": words}
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["config.json", "summary.json"]


def test_of_two_runs_into_one_folder_the_second_is_refused_before_its_work(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with result_folder(out) as folder:
        fill(folder)
        for force in (False, True):
            with pytest.raises(OutputError, match=r"another run is at work in .*out"), hold_folder(out, force):
                pass
    assert content(out) == {"summary.json": "new", "config.json": "new"}


def write_two(folder: Path) -> None:
    """Write d.csv and c.csv, of which another makes the second meanwhile."""
    with result_files([folder / "d.csv", folder / "c.csv"], Path.is_file) as made:
        for file in made:
            file.write_text("second")
        (folder / "c.csv").write_text("first")


def test_a_file_that_another_made_meanwhile_is_not_replaced_and_what_was_left_is_swept(tmp_path: Path) -> None:
    (tmp_path / ".fg-nav-new-dead").mkdir()
    with result_file(tmp_path / "a.csv", Path.is_file) as mine, result_file(tmp_path / "b.csv", Path.is_file) as other:
        assert len(list(tmp_path.glob(".fg-nav-new-*"))) == 2  # the dead one is gone, neither of these is
        mine.write_text("mine")
        other.write_text("other")
    with pytest.raises(OutputError, match=r"c\.csv already exists"):
        write_two(tmp_path)
    assert content(tmp_path) == {"a.csv": "mine", "b.csv": "other", "c.csv": "first"}


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_folder_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="permission denied"):
        make(tmp_path / "out", "new")
    tmp_path.chmod(0o700)
