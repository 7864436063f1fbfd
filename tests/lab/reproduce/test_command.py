"""`fg-nav lab reproduce`: the folder, what is in it, and what is printed; the experiments are a stand-in's."""

import json
import math
import os
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

import pytest
from pydantic import TypeAdapter
from typer.testing import CliRunner

from fg_nav import cli
from fg_nav.errors import OutputError
from fg_nav.lab.reproduce import command
from fg_nav.lab.reproduce.results import (
    PAPERS,
    Spread,
    describe_counts,
    format_seeds,
    format_spread,
    read_reproduction,
    spread_of,
    write_reproduction,
)
from fg_nav.lab.store.results import Number, encode_number
from tests.command_line import in_a_process, names
from tests.lab.reproduce.made import drawn, reproduction, row


@pytest.fixture
def papers(monkeypatch):
    """What the paper's experiments were asked for."""
    asked = []

    def experiments(name, folder, seeds, workers, progress, quick):
        asked.append((tuple(seeds), workers, quick))
        progress(0.5)
        if workers == 9:
            drawn(folder, "pictures/figure-half.png")
            raise KeyboardInterrupt
        return replace(reproduction(folder), seeds=tuple(seeds), parameters={"filter": {"sigmas": (1.0, 2.0)}})

    monkeypatch.setattr(command, "run_paper", experiments)
    return asked


def same(one, other):
    """Equality in which NaN is NaN, and a list is a tuple."""
    return repr(one).translate(LISTS) == repr(other).translate(LISTS)


LISTS = str.maketrans({"[": "(", "]": ")", ",": None})


def test_the_file_comes_back_as_it_was(tmp_path):
    found = reproduction(tmp_path)
    (tmp_path / "a.json").write_text(write_reproduction(found))
    again = read_reproduction(tmp_path / "a.json")
    assert same(again, found)
    assert write_reproduction(again) == write_reproduction(found)
    never = again.experiments[0].rows[4].ours["filter"]
    assert never.median == math.inf
    assert never.low == 10.0
    verdicts = [one["verdict"] for one in json.loads(write_reproduction(found))["experiments"][0]["rows"]]
    assert verdicts == [one.verdict for one in found.experiments[0].rows]


@pytest.mark.parametrize("value", [1.5, -math.inf, math.inf, math.nan])
def test_a_number_comes_back_with_its_sign(value):
    text = json.dumps(encode_number(value), allow_nan=False)
    again = TypeAdapter(Number).validate_python(json.loads(text))
    assert repr(again) == repr(value)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"form": 0}', '{"form": 2, "seeds": [1]}'])
def test_what_is_no_result_is_refused_in_one_sentence(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(OutputError, match="is no result of"):
        read_reproduction(tmp_path / "a.json")


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


def test_the_same_walks_give_the_same_bytes_wherever_and_by_however_many(papers, tmp_path):
    for name, workers in (("one", 1), ("two", 2)):
        command.reproduce("ma2018", tmp_path / name, seeds=2, workers=workers)
    for file in ("results.json", "report.html"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_quick_is_fewer_seeds_unless_they_are_counted(papers, tmp_path):
    for name, more in (("a", {}), ("b", {"quick": True}), ("c", {"quick": True, "seeds": 5})):
        command.reproduce("ma2018", tmp_path / name, **more)
    all_of = os.cpu_count()
    assert [(seeds, quick) for seeds, _, quick in papers] == [
        (tuple(range(101, 151)), False),
        ((101, 102, 103), True),
        (tuple(range(101, 106)), True),
    ]
    assert all(1 <= workers <= all_of for _, workers, _ in papers)
    assert "--seeds 5 --first 101 --quick" in read_reproduction(tmp_path / "c" / "results.json").command


def test_a_run_that_was_ended_goes_on_and_a_result_is_replaced_by_force_only(papers, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        command.reproduce("ma2018", out, seeds=2, workers=9)
    assert names(out) == {".fg-nav-reproduce", "pictures"}
    command.reproduce("ma2018", out, seeds=2)
    with pytest.raises(OutputError, match="already holds a result"):
        command.reproduce("ma2018", out, seeds=2)
    command.reproduce("ma2018", out, seeds=3, force=True)
    assert len(read_reproduction(out / "results.json").seeds) == 3


def test_pictures_of_an_older_result_are_taken_away_and_nothing_else(papers, tmp_path):
    out = tmp_path / "out"
    command.reproduce("ma2018", out, seeds=2)
    for name in ("mine.png", "pictures/mine.png", "pictures/figure-older.png"):
        drawn(out, name)
    with pytest.raises(KeyboardInterrupt):
        command.reproduce("ma2018", out, workers=9, force=True)
    assert names(out) == {".fg-nav-reproduce", "mine.png", "pictures"}
    command.reproduce("ma2018", out, seeds=2)
    assert names(out / "pictures") == {"mine.png", "figure-one.png", "figure-two.png"}


def test_a_worker_that_was_ended_is_shown_in_one_sentence(monkeypatch, tmp_path):
    def experiments(*_):
        raise BrokenProcessPool

    monkeypatch.setattr(command, "run_paper", experiments)
    with pytest.raises(OutputError, match="run the same command again, it goes on"):
        command.reproduce("ma2018", tmp_path / "out")


def test_nothing_else_is_written_into(papers, tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.png").write_bytes(b"mine")
    (tmp_path / "file").write_bytes(b"mine")
    command.reproduce("ma2018", tmp_path / "ours", seeds=1)
    for place, words in (("photos", "'one.png', which"), ("file", "is a file"), ("ours", "the results of ma2018")):
        with pytest.raises(OutputError, match=words):
            command.reproduce("aiez2017", tmp_path / place, force=True)
    assert (tmp_path / "photos" / "one.png").read_bytes() == b"mine"


def test_the_command_line_hands_on_what_was_said(papers, tmp_path):
    words = ["lab", "reproduce", "aiez2017", "--quick", "--first", "5", "--workers", "2", "--out", str(tmp_path / "a")]
    ran = CliRunner().invoke(cli.app, words)
    assert ran.exit_code == 0, ran.output
    assert papers == [((5, 6, 7), 2, True)]


def test_the_command_line_knows_each_paper():
    ran = in_a_process("lab", "reproduce", "none-of-them", COLUMNS="200")
    assert ran.code == 2
    assert all(paper in ran.err for paper in PAPERS)


def test_figures_are_shown_with_what_never_came_and_how_many_there_are():
    one = row("minutes", "min", "3", 3.0, 3.0)
    several = {
        "a": spread_of([1.0, math.inf, math.inf]),
        "b": spread_of([1.0, 2.0]),
        "c": Spread(math.nan, math.nan, math.nan, 0),
    }
    asked = replace(one, ours=several)
    assert [format_spread(asked, name, 3) for name in "abc"] == [
        "never (1.00 to never)",
        "1.50 (1.05 to 1.95, n 2)",
        "-",
    ]
    assert format_spread(replace(asked, unit="m"), "a", 3) == "failed (1.00 to failed)"
    assert format_spread(replace(asked, unit=""), "a", 3) == "infinite (1.00 to infinite)"


def test_seeds_and_counts_are_shown(tmp_path):
    found = reproduction(tmp_path)
    assert format_seeds(found) == "101 to 103"
    assert format_seeds(replace(found, seeds=(101, 104))) == "101, 104"
    assert describe_counts(replace(found, experiments=())) == "0 figures compared: none compared."
