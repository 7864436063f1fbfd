"""The files of a result keep to the contract and appear whole or not at all, and what is printed of them."""

import io
import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.errors import OutputError
from fg_nav.estimators import METHODS, Method
from fg_nav.frames import compute_heading
from fg_nav.io import read_truth
from fg_nav.pipeline import run_method
from fg_nav.report import folder as folder_module
from fg_nav.report import terminal
from fg_nav.report.files import summarize, write_json, write_run
from fg_nav.report.folder import check_free, claim_folder, hold_folder, result_file, result_files, result_folder
from fg_nav.report.terminal import collect_notes
from fg_nav.text import format_digits
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Walk
from tests.report import walks

STRIDE_COLUMNS = (
    "index,time_s,x_m,y_m,z_m,heading_deg,gyro_bias_x_deg_s,gyro_bias_y_deg_s,gyro_bias_z_deg_s,"
    "sigma_x_m,sigma_y_m,sigma_z_m,sigma_heading_deg,field,field_reason,cov_xy_m2,cov_xz_m2,cov_yz_m2,"
    "same_place_as,place_score,gyro_bias_sigma_x_deg_s,gyro_bias_sigma_y_deg_s,gyro_bias_sigma_z_deg_s,compass_weight"
)
SUMMARY_KEYS = {
    "method", "duration_s", "distance_m", "strides", "closure_m", "closure_percent", "runtime_s", "realtime_factor",
}  # fmt: skip
TRUTH_KEYS = {"rmse_2d_m", "rmse_3d_m", "end_error_m", "max_error_m", "heading_rmse_deg", "alignment"}


def loaded(path: Path) -> dict[str, object]:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    content = json.loads(path.read_text(), parse_constant=refuse)
    assert isinstance(content, dict)
    return content


def test_strides_hold_the_stances_in_the_units_of_their_names(tmp_path: Path, walk: Walk) -> None:
    outcome = walks.outcome(walk)
    write_run(tmp_path, walk, outcome, "none")
    assert (tmp_path / "strides.csv").read_text().splitlines()[0] == STRIDE_COLUMNS
    strides, stances = pd.read_csv(tmp_path / "strides.csv"), outcome.solution.stances
    assert len(strides) == len(walk.stances)
    np.testing.assert_allclose(strides[["x_m", "y_m", "z_m"]], stances.position, atol=1e-6)
    np.testing.assert_allclose(strides["gyro_bias_y_deg_s"], -0.05, rtol=1e-6)
    np.testing.assert_allclose(strides["sigma_y_m"] ** 2, stances.position_cov[:, 1, 1], rtol=1e-6)
    np.testing.assert_allclose(strides["cov_xy_m2"], stances.position_cov[:, 0, 1], rtol=1e-6)
    np.testing.assert_allclose(strides["sigma_heading_deg"].iloc[:2], [0.2, 0.23], rtol=1e-6)
    assert strides["heading_deg"].between(0, 360, inclusive="left").all()
    np.testing.assert_allclose(
        np.cos(np.deg2rad(strides["heading_deg"])), np.cos(compute_heading(stances.nav_R_body)), atol=1e-6
    )
    assert set(strides["field_reason"]) == {"not used, as yet"}  # the comma survives
    back = read_truth(tmp_path / "trajectory.tum")
    assert isinstance(back, TrajectoryTruth)
    np.testing.assert_allclose(back.t, walk.recording.t, atol=1e-9)
    np.testing.assert_allclose(back.position, outcome.solution.position, atol=1e-8)
    np.testing.assert_allclose(back.nav_R_body, outcome.solution.nav_R_body, atol=1e-7)


def test_summary_has_the_keys_and_the_figures(tmp_path: Path, walk: Walk) -> None:
    outcome = walks.outcome(walk)
    write_run(tmp_path, walk, outcome, "none")
    summary = loaded(tmp_path / "summary.json")
    assert summary.keys() >= SUMMARY_KEYS | TRUTH_KEYS
    assert summary["strides"] == len(walk.stances) - 1
    assert summary["realtime_factor"] == pytest.approx(walk.recording.duration_s / 0.25)
    assert summary["rmse_2d_m"] == outcome.metrics.rmse_2d_m
    assert summary["alignment"] == "yaw"
    assert summary["magnetometer"] == "not used"
    assert "made for a test" in str(summary["notes"])
    assert "distance_sigma_m" not in summary
    # what is not known is not claimed
    surveyed, bare = walks.with_footprints(walk), walks.without_truth(walk)
    told = replace(walks.outcome(bare), solution=replace(walks.outcome(bare).solution, distance_sigma_m=0.25))
    for name, one, found in (("prints", surveyed, walks.outcome(surveyed)), ("bare", bare, told)):
        (tmp_path / name).mkdir()
        write_run(tmp_path / name, one, found, "none")
    prints, nothing = (loaded(tmp_path / name / "summary.json") for name in ("prints", "bare"))
    assert (prints["rmse_3d_m"], prints["heading_rmse_deg"]) == (None, None)
    assert 0 < float(str(prints["rmse_2d_m"])) < 1
    assert not TRUTH_KEYS & nothing.keys()
    assert nothing["distance_sigma_m"] == 0.25


def test_magnetometer_is_used_when_the_method_says_so(
    tmp_path: Path, walk: Walk, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = walks.outcome(walk).solution
    for word, words in (("quasi-static", "used"), ("none", "not used")):
        table = replace(own.stances, field=(word,) * len(own.stances))
        mine = Method("mine", lambda *_, table=table: replace(own, stances=table))
        monkeypatch.setitem(METHODS["foot"], "mine", mine)
        write_run(tmp_path, walk, run_method(walk, "mine"), "none")
        assert loaded(tmp_path / "summary.json")["magnetometer"] == words


def test_config_names_input_version_and_parameters(tmp_path: Path, walk: Walk) -> None:
    write_run(tmp_path, walk, walks.outcome(walk), "none")
    config, count = loaded(tmp_path / "config.json"), len(walk.stances)
    assert config["fg_nav_version"]
    for key, value in {
        "format": "simulated",
        "recording": None,
        "truth": "in the recording",
        "parameters": {"noise": {"acc_m_s2": 0.3}, "unknown": None},
        "detector": {"name": "TRUE SPEED", "threshold": walks.STILL_M_S, "stances": count, "footfalls": count},
    }.items():
        assert config[key] == value


def test_json_is_standard_whatever_numpy_hands_over(tmp_path: Path) -> None:
    content = {"a": np.inf, "b": np.arange(2), "c": (np.int64(3), np.bool_(True)), "d": Path("x"), 5: None}
    write_json(tmp_path / "x.json", content)
    assert loaded(tmp_path / "x.json") == {"a": None, "b": [0, 1], "c": [3, True], "d": "x", "5": None}


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


class Screen(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_start_to_end_is_of_a_loop_only(walk: Walk, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    summary = summarize(walk, walks.outcome(walk))
    for percent, is_shown in ((4.9, True), (5.1, False), (None, False)):
        one = {**summary, "closure_percent": percent}
        terminal.print_results([one], tmp_path)
        assert ("m from the start" in capsys.readouterr().out) == is_shown
        assert any(words.startswith("start to end") for words, _ in terminal.tabulate_figures([one])) == is_shown
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


@pytest.mark.parametrize("has_truth", [True, False])
def test_of_one_method_a_line_each_is_said(
    walk: Walk, capsys: pytest.CaptureFixture[str], tmp_path: Path, has_truth: bool
) -> None:
    (tmp_path / "report.html").touch()
    one = walk if has_truth else walks.without_truth(walk)
    terminal.print_results([summarize(one, walks.outcome(one))], tmp_path if has_truth else tmp_path / "none")
    said = [line.partition(":")[0] for line in capsys.readouterr().out.splitlines()]
    assert said == ["verdict", "distance", "end", *(["error", "report"] if has_truth else ["files"])]


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
