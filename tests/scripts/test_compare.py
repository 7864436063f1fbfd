"""The comparison of methods: what is kept, what is printed beside the papers, and that it runs."""

from dataclasses import replace

import pytest
from rich.console import Console

from fg_nav.errors import EstimationError, SimulationError
from fg_nav.lab.store.results import Key, Result
from fg_nav.lab.walked import AS_STARTED, WalkErrors
from tests.lab.store.stored import check_that_it_alone_is_read
from tests.scripts import load_script

script = load_script("compare_ekf")

KEY = Key("mall", "indoor", "101", "loop", "ma2018")
SETTINGS = {"method": {"sigma": 0.1, "names": ["a", "b"]}, "walk": None}


def result(method="ma2018", walk="101", at_landmarks=(1.0, 2.0), failed="", heading_deg=-5.0):
    """Stand in for a method's walk of 100 m."""
    errors = WalkErrors(AS_STARTED, 100.0, 3.0, -0.2, heading_deg, 1.5, 6.0, rmse_m=2.1)
    blank = Result(replace(KEY, method=method, walk=walk), SETTINGS, "code", failed)
    if failed:
        return blank
    at = {AS_STARTED: list(at_landmarks)}
    return replace(blank, errors={AS_STARTED: errors}, landmark=("A", "B"), landmark_m=at, used="u-u", samples=1000,
                   runtime_s=0.004)  # fmt: skip


def rows_of(printed, begins):
    return [line for line in printed.splitlines() if line.startswith(begins)]


def test_a_result_of_other_settings_or_form_or_a_damaged_one_is_none(tmp_path):
    assert check_that_it_alone_is_read(tmp_path, result()).errors == result().errors


def test_medians_stand_over_the_paper_in_tables_of_the_terminal_s_width(capsys, monkeypatch):
    monkeypatch.setattr(script, "console", lambda: Console(width=80))  # in a pipe there is no width
    theirs = [result("iez", "1", (9, 11)), result("iez", "2", (30, 50))]
    ours = [result(walk="1", at_landmarks=(1, 2)), result(walk="2", at_landmarks=(10, 10), heading_deg=5.0)]
    script.print_cases([*theirs, *ours])
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 80
    assert "5.75 (1.9" in printed  # means of 1.5 and 10 m at the landmarks
    assert "0.20 (0.1" in printed  # over 10 and 40 m
    assert "5.00 (5.00 to 5.00)" in printed  # headings count by their size
    assert any("1.5" in line.split() for line in rows_of(printed, "  Ma 2018, proposed"))


def test_a_failed_walk_is_infinitely_wrong_and_named(capsys):
    some = [result(walk=str(k)) for k in range(3)] + [result(walk=str(k), failed="no such walk.") for k in (3, 4)]
    script.print_cases(some)
    script.print_remarks(some)
    printed = capsys.readouterr().out
    assert "3.00 (3.00 to failed)" in printed
    assert "failed: mall, 3, ma2018: no such walk." in printed
    assert "5 of 5 results were made by other code (ma2018)" in " ".join(printed.split())


def test_what_cannot_be_is_said_before_anything_is_simulated():
    with pytest.raises(EstimationError, match="mistake"):
        script.parse(["--methods", "mistake"])
    with pytest.raises(SimulationError, match="nowhere"):
        script.parse(["--scenarios", "nowhere"])
    chosen = script.parse(["--quick"])
    assert {"smoother", "online", "card", "iez"} <= set(chosen.methods)
    assert chosen.seeds == 2


def test_it_makes_its_folder_runs_and_joins_what_is_there(tmp_path, capsys):
    given = ["--out", str(tmp_path / "new" / "folder"), "--scenarios", "demo", "--fields", "smooth", "--seeds", "1"]
    given += ["--magnetometer", "perfect", "--jobs", "1", "--methods", "iez"]
    script.main(given)
    first = capsys.readouterr().out
    made = {path: path.stat().st_mtime_ns for path in (tmp_path / "new" / "folder").glob("*.json")}
    script.main([*given, "ma2018:as-printed"])
    second = capsys.readouterr().out
    assert len(made) == 1
    assert all(path.stat().st_mtime_ns == at for path, at in made.items())
    assert rows_of(first, "iez")[0].split()[1] == rows_of(second, "iez")[0].split()[1]
    assert rows_of(second, "ma2018:as-printed")
