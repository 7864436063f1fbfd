"""The end of a stream where the disk is full, or nobody reads: what can be written is, and what is lost is said."""

import errno
import json
import os
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import pandas as pd
import pytest

from fg_nav.commands import stream
from fg_nav.commands.shared import Target
from fg_nav.commands.stream import End, LinePrinter, save_end
from fg_nav.errors import OutputError
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import rows_of
from fg_nav.online.follow import FollowedWalk
from fg_nav.report.files import summarize_lagged, write_footfalls, write_lagged
from tests.command_line import names
from tests.online.walks import NORTH, push, short_walk


@pytest.fixture(scope="module")
def solution():
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows_of(short_walk()))
    navigator.close()
    return navigator.finish()


@pytest.fixture
def end(solution):
    summary = summarize_lagged(solution)
    least = partial(write_footfalls, solution=solution, summary=summary)
    return End(summary, lambda: [], partial(write_lagged, solution=solution), least)


def fail(folder: Path, **given: object) -> None:
    """Write into a folder on a full disk."""
    raise OSError(errno.ENOSPC, "No space left on device")


def save(end, out) -> OutputError | None:
    with Target(out, False, "stream") as target:
        return save_end(end, target, "none")


def test_on_a_full_disk_the_footfalls_are_saved_where_there_is_room_and_it_says_where(
    end, solution, tmp_path, monkeypatch
):
    assert save(end, tmp_path / "room") is None
    assert names(tmp_path / "room") == {"online.csv", "strides.csv", "summary.json", "trajectory.tum"}
    monkeypatch.setattr(stream.tempfile, "tempdir", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    out, end = tmp_path / "out", replace(end, write=fail)
    failure = str(save(end, out))
    assert failure.startswith(f"{out} cannot be written (no space left on device)")
    assert failure.endswith(f"the footfalls alone are in {out}.")
    assert len(pd.read_csv(out / "strides.csv")) == len(solution.stances)
    assert names(out) == {"strides.csv", "summary.json"}
    # No room for them either: among the temporary files.
    with Target(tmp_path / "other", False, "stream") as target:
        monkeypatch.setattr(Target, "open", lambda self: stream.result_folder(Path(os.devnull) / "none"))
        words = str(save_end(end, target, "none"))
    (place,) = (tmp_path / "tmp").glob("fg-nav-stream-*/result")
    assert words.endswith(f"the footfalls alone are in {place}.")
    end = replace(end, write_least=fail)
    with pytest.raises(OutputError, match="the result of the walk is lost"), Target(out, True, "stream") as target:
        save_end(end, target, "none")


def test_lines_that_cannot_be_written_do_not_end_the_walk(monkeypatch, capsys):
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        printer = LinePrinter()
        printer("{}")
        printer("{}")
        monkeypatch.undo()
    assert printer.has_failed
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "the lines cannot be written any more (no space left on device)" in said


def test_a_walk_whose_lines_were_lost_is_written_into_a_fresh_folder(end, fg_nav, monkeypatch):
    monkeypatch.setattr(stream, "run_stream", lambda request, outlets: FollowedWalk({}, {}, None))
    monkeypatch.setattr(stream, "find_end", lambda walk, polish: replace(end, format_lines=lambda: ["{}"]))
    monkeypatch.setattr(stream.typer, "echo", lambda line: (_ for _ in ()).throw(BrokenPipeError))
    monkeypatch.setattr(stream.os, "dup2", lambda *descriptors: None)
    monkeypatch.setattr(sys.stdout, "fileno", lambda: 1, raising=False)
    ran = fg_nav("stream", "walk.csv", "--plots", "none")
    assert (ran.code, ran.out) == (0, "")
    assert "no reader any more" in ran.err
    summary = json.loads(Path("results/stream-1/summary.json").read_text())
    assert summary["strides"] >= 5
