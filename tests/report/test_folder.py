"""A result folder appears whole or not at all, and never in place of something else."""

import os
from pathlib import Path

import pytest

from fg_nav.errors import OutputError
from fg_nav.report import folder as folder_module
from fg_nav.report.folder import check_free, claim_folder, hold_folder, result_file, result_files, result_folder


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
def test_failure_leaves_nothing_or_the_older_result_and_force_replaces_it_whole(
    tmp_path: Path, kind: type[BaseException]
) -> None:
    out = tmp_path / "out"
    with pytest.raises(kind):
        interrupted(out, kind)
    assert list(tmp_path.iterdir()) == []
    make(out, "old")
    with pytest.raises(OutputError, match="--force"), result_folder(out):
        pass
    with pytest.raises(kind):
        interrupted(out, kind)
    assert content(out) == {"summary.json": "old", "config.json": "old"}
    (out / "iez").mkdir()
    (out / "iez" / "strides.csv").write_text("old")
    with result_folder(out, force=True) as folder:
        fill(folder)
    assert content(out) == {"summary.json": "new", "config.json": "new"}


def test_foreign_files_are_never_touched(tmp_path: Path) -> None:
    for k, name in enumerate(("thesis.tex", "recording.csv", "data/walk.csv", "iez/notes.txt")):
        out = tmp_path / str(k)
        make(out, "old")
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text("mine")
        with pytest.raises(OutputError, match=name), result_folder(out, force=True):
            pass
        assert (out / name).read_text() == "mine"
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


@pytest.mark.parametrize("successes", range(5))
@pytest.mark.parametrize("error", [Killed(), OSError(28, "No space left on device")], ids=["killed", "full disk"])
def test_what_was_left_amid_the_moves_becomes_one_whole_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, successes: int, error: BaseException
) -> None:
    make(tmp_path / "out", "old")
    replace, calls = os.replace, []

    def move(origin: Path, place: Path) -> None:
        calls.append(Path(place).name)
        if len(calls) == successes + 1 or (isinstance(error, Killed) and len(calls) > successes):
            raise error
        replace(origin, place)

    with monkeypatch.context() as patched:
        patched.setattr(folder_module.os, "replace", move)
        with (
            pytest.raises(Killed if isinstance(error, Killed) else OutputError),
            result_folder(tmp_path / "out", force=True) as folder,
        ):
            fill(folder)
    if isinstance(error, Killed):
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
