"""What is printed: figures that are known, and progress on a terminal only."""

import io
import sys
from pathlib import Path

import pytest

from fg_nav.report import terminal
from fg_nav.report.files import summarize
from fg_nav.report.terminal import collect_notes
from fg_nav.text import format_digits
from fg_nav.walk import Walk
from tests.report import walks


class Screen(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_table_has_a_column_for_each_method(walk: Walk, capsys: pytest.CaptureFixture[str]) -> None:
    for one in (walk, walks.without_truth(walk)):
        outcomes = [walks.outcome(one, "smoother", 1.0), walks.outcome(one, "iez", 3.0)]
        terminal.print_results([summarize(one, outcome) for outcome in outcomes], Path("results"))
        lines = capsys.readouterr().out.splitlines()
        assert lines[0].split() == ["smoother", "iez"]
        rows = [line.split() for line in lines if line.startswith("rmse 2-D (m)")]
        assert len(rows) == (one is walk)
        assert all(0 < float(row[-2]) < float(row[-1]) for row in rows)
    assert "start to end (m)" in "\n".join(lines)


def test_start_to_end_is_told_of_a_loop_only(walk: Walk, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    summary = summarize(walk, walks.outcome(walk))
    for percent, is_told in ((4.9, True), (5.1, False), (None, False)):
        one = {**summary, "closure_percent": percent}
        terminal.print_results([one], tmp_path)
        assert ("m from the start" in capsys.readouterr().out) == is_told
        assert any(words.startswith("start to end") for words, _ in terminal.tabulate_figures([one])) == is_told
        assert terminal.is_loop([one, {**summary, "closure_percent": 2.0}])


def test_remarks_are_what_to_know_and_how_it_was_solved() -> None:
    how = [
        "gyro bias from the walk alone, there is no rest in it",
        "1 level floor with 3 of 4 footfalls",
        "preset tuned",
    ]
    know = ["no rest at the start: gyro bias unknown to 0.2 deg/s", "16 gaps of more than two samples"]
    found = terminal.group_notes([("", note) for note in (*how, *know)])
    assert [[note for _, note in notes] for notes in found.values()] == [know, how]
    assert list(found) == ["What you should know", "How it was solved"]
    assert terminal.group_notes([]) == {}


def test_numbers_have_three_digits_and_no_exponent() -> None:
    for value, words in (
        (347.946, "348"), (-7.0835, "-7.08"), (0.0012, "0.001"), (-0.0, "0.00"), (12345.6, "12300"), (999.7, "1000"),
        (float("nan"), "-"),
    ):  # fmt: skip
        assert format_digits(value) == words
    assert [terminal.format_sigma(value) for value in (6.113, 0.0197, 53.0)] == ["6.1", "0.020", "53"]


def test_notes_say_whose_they_are() -> None:
    several = [{"method": "a", "notes": ["one", "two"]}, {"method": "b", "notes": ["three", "two"]}]
    assert collect_notes(several) == [("", "two"), ("a", "one"), ("b", "three")]
    assert collect_notes(several[:1]) == [("", "one"), ("", "two")]


def test_one_method_is_five_lines(walk: Walk, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "report.html").touch()
    summary = summarize(walk, walks.outcome(walk))
    terminal.print_results([summary], tmp_path)
    said = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in said] == ["verdict", "distance", "end", "error", "report"]
    assert said[1] == f"distance: {format_digits(summary['distance_m'])} m, in {summary['strides']} strides"
    assert f"{format_digits(summary['rmse_2d_m'])} m rms" in said[3]
    assert said[4] == f"report: {tmp_path / 'report.html'} (2 remarks in it)"
    bare = walks.without_truth(walk)
    terminal.print_results([summarize(bare, walks.outcome(bare))], tmp_path / "none")
    said = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in said] == ["verdict", "distance", "end", "files"]
    assert said[-1] == f"files: {tmp_path / 'none'}"


def test_lines_of_a_listing_end_with_their_value_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.console().print(terminal.listing([("rate", "200 Hz"), ("note", "word " * 150)]))
    assert capsys.readouterr().out.splitlines() == ["rate  200 Hz", "note  " + ("word " * 150).rstrip()]
    terminal.console().print(terminal.listing([("[bold]x", "[red]walk[/red].csv")]))  # is no markup
    assert capsys.readouterr().out.split() == ["[bold]x", "[red]walk[/red].csv"]


@pytest.mark.parametrize("stream", [Screen(), io.StringIO()], ids=["terminal", "pipe"])
def test_progress_is_for_terminals(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO) -> None:
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    with terminal.progress("smoother") as report:
        report(0.5)
    assert ("smoother" in stream.getvalue()) == stream.isatty()
