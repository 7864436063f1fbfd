"""`fg-nav lab reproduce`: the folder, what is in it, and what is printed; the experiments are a stand-in's."""

import os
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from fg_nav import cli
from fg_nav.errors import OutputError
from fg_nav.lab.reproduce import command
from fg_nav.lab.reproduce.results import PAPERS, read_reproduction
from tests.command_line import in_a_process, names
from tests.lab.reproduce.made import drawn, reproduction


@pytest.fixture
def papers(monkeypatch):
    """What the paper's experiments were asked for; with nine workers they are stopped, with eight one is lost."""
    asked = []

    def experiments(name, folder, seeds, workers, progress, quick):
        asked.append((tuple(seeds), workers, quick))
        progress(0.5)
        if workers in (8, 9):
            drawn(folder, "pictures/figure-half.png")
            raise KeyboardInterrupt if workers == 9 else BrokenProcessPool
        return replace(reproduction(folder), seeds=tuple(seeds), parameters={"filter": {"sigmas": (1.0, 2.0)}})

    monkeypatch.setattr(command, "run_paper", experiments)
    return asked


def test_a_run_writes_all_and_prints_every_row(papers, tmp_path, capsys):
    command.print_rows(command.reproduce("ma2018", tmp_path / "out", seeds=2, first=7, workers=3), tmp_path / "out")
    assert papers == [((7, 8), 3, False)]
    assert names(tmp_path / "out") == {".fg-nav-reproduce", "report.html", "results.json", "pictures"}
    said = capsys.readouterr().out
    for words in ("M-E1  The <first>", "end < error & more (m)", "0.50 to 0.60", "never", "report: "):
        assert words in said
    assert "missed (explained): M-E1, heading (deg): Their field" in said
    assert "missed: M-E1, landmarks\n" in said
    assert "5 figures compared: 1 reproduced, 1 better, 1 missed (explained), 2 missed." in said
    assert "fg-nav lab reproduce ma2018 --seeds 2 --first 7" in (tmp_path / "out" / "report.html").read_text()
    assert "numpy" in read_reproduction(tmp_path / "out" / "results.json").versions
    # the same walks give the same bytes, wherever and by however many
    command.reproduce("ma2018", tmp_path / "two", seeds=2, first=7, workers=2)
    for file in ("results.json", "report.html"):
        assert (tmp_path / "out" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_quick_is_fewer_seeds_unless_they_are_counted(papers, tmp_path):
    for name, more in (("a", {}), ("b", {"quick": True}), ("c", {"quick": True, "seeds": 5})):
        command.reproduce("ma2018", tmp_path / name, **more)
    assert [(seeds, quick) for seeds, _, quick in papers] == [
        (tuple(range(101, 151)), False),
        ((101, 102, 103), True),
        (tuple(range(101, 106)), True),
    ]
    assert all(1 <= workers <= os.cpu_count() for _, workers, _ in papers)
    assert "--seeds 5 --first 101 --quick" in read_reproduction(tmp_path / "c" / "results.json").command


def test_a_run_that_was_ended_goes_on_and_only_an_older_result_is_replaced_by_force(papers, tmp_path):
    out = tmp_path / "out"
    for workers, error, words in (
        (9, KeyboardInterrupt, None),
        (8, OutputError, "run the same command again, it goes on"),
    ):
        with pytest.raises(error, match=words):
            command.reproduce("ma2018", out, seeds=2, workers=workers)
        assert names(out) == {".fg-nav-reproduce", "pictures"}
    command.reproduce("ma2018", out, seeds=2)
    with pytest.raises(OutputError, match="already holds a result"):
        command.reproduce("ma2018", out, seeds=2)
    for name in ("mine.png", "pictures/mine.png", "pictures/figure-older.png"):
        drawn(out, name)
    with pytest.raises(KeyboardInterrupt):
        command.reproduce("ma2018", out, workers=9, force=True)
    assert names(out) == {".fg-nav-reproduce", "mine.png", "pictures"}
    command.reproduce("ma2018", out, seeds=3)
    assert names(out / "pictures") == {"mine.png", "figure-one.png", "figure-two.png"}
    assert len(read_reproduction(out / "results.json").seeds) == 3


def test_nothing_else_is_written_into(papers, tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.png").write_bytes(b"mine")
    (tmp_path / "file").write_bytes(b"mine")
    command.reproduce("ma2018", tmp_path / "ours", seeds=1)
    for place, words in (("photos", "'one.png', which"), ("file", "is a file"), ("ours", "the results of ma2018")):
        with pytest.raises(OutputError, match=words):
            command.reproduce("aiez2017", tmp_path / place, force=True)
    assert (tmp_path / "photos" / "one.png").read_bytes() == b"mine"


def test_the_command_line_passes_its_options_and_knows_each_paper(papers, tmp_path):
    words = ["lab", "reproduce", "aiez2017", "--quick", "--first", "5", "--workers", "2", "--out", str(tmp_path / "a")]
    ran = CliRunner().invoke(cli.app, words)
    assert ran.exit_code == 0, ran.output
    assert papers == [((5, 6, 7), 2, True)]
    ran = in_a_process("lab", "reproduce", "none-of-them", COLUMNS="200")
    assert ran.code == 2
    assert all(paper in ran.err for paper in PAPERS)
