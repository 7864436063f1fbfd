"""Two recordings of one walk, a sensor on each foot, from the command line to the files."""

import json
import re
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest

from fg_nav.both_feet import navigate_feet, shows_sides
from fg_nav.errors import EstimationError
from fg_nav.feet.person import FeetSolution
from fg_nav.lab.simulation import simulate_feet
from fg_nav.lab.verbs.simulate import write_feet
from fg_nav.solution import STRIDE_COLUMNS
from tests.command_line import FgNav, Ran, names
from tests.commands.folders import config, strides, summary

FILES = {
    *("trajectory.tum", "trajectory_left.tum", "trajectory_right.tum", "strides_left.csv", "strides_right.csv"),
    *("person.csv", "gait.csv", "summary.json", "config.json"),
}
OTHER = {"left": "right", "right": "left"}


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with `left.csv` and `right.csv`, their truths and `person.tum`."""
    folder = tmp_path_factory.mktemp("feet")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fg_nav.report.plots.style.save", lambda figure, path: path.touch())
        write_feet(folder, simulate_feet("demo", 1))
    return folder


@pytest.fixture
def run(fg_nav: FgNav, walked: Path) -> Any:
    """Run two recordings, of the folder or of the working directory, into the folder `out`."""

    def run(left: str, right: str, *words: object, truth: tuple[str, str] = ("left", "right"), plots="none") -> Ran:
        recordings = [Path(one) if Path(one).exists() else walked / one for one in (left, right)]
        truths = [Path(f"{one}.tum") if Path(f"{one}.tum").exists() else walked / f"{one}.truth.tum" for one in truth]
        given = ("--mount", "feet", "--truth", ",".join(map(str, truths)), "--plots", plots)
        return fg_nav("run", *recordings, *given, *(() if "--out" in words else ("--out", "out")), *words)

    return run


def cut(walked: Path, side: str, start: float, stop: float) -> str:
    """Write one foot's recording without the samples between two times, s, and return its name."""
    table = pd.read_csv(walked / f"{side}.csv")
    table[(table["time_s"] < start) | (table["time_s"] > stop)].to_csv(f"cut-{side}.csv", index=False)
    return f"cut-{side}.csv"


def paths(*ends: str) -> list[np.ndarray]:
    return [np.loadtxt(f"out/trajectory{end}.tum") for end in ends]


def test_both_feet_are_one_walk(fg_nav: FgNav, run: Any, walked: Path) -> None:
    ran = run("left.csv", "right.csv", "--json", plots="html")
    assert (ran.code, ran.err) == (0, "")
    assert names(Path("out")) == FILES | {"report.html"}
    said, recordings = summary("out"), [str(walked / f"{side}.csv") for side in ("left", "right")]
    assert json.loads(ran.out) == {"recordings": recordings, "folder": "out", **said}
    assert (said["method"], said["mount"], said["sides"]) == ("smoother", "feet", ["left", "right"])
    assert (said["clock_offset_s"], said["clock_offset_known"]) == (0.0, "by the signals")
    assert said["width_m"] == pytest.approx(0.12, abs=3 * said["width_sigma_m"])
    assert said["cells"] > 5
    # the person is between the feet, and as near to the truth
    assert max(said["rmse_2d_m"], *(said[side]["rmse_2d_m"] for side in ("left", "right"))) < 0.1
    assert said["distance_m"] == pytest.approx(said["left"]["distance_m"], abs=2.0)
    person, left, right = paths("", "_left", "_right")
    assert np.abs(person[-1, 1:4] - 0.5 * (left[-1, 1:4] + right[-1, 1:4])).max() < 0.01
    for table in ("person.csv", "strides_left.csv", "strides_right.csv"):
        assert tuple(strides("out", table).columns) == STRIDE_COLUMNS
    assert said["strides"] == len(strides("out", "person.csv")) - 1
    # strides and steps of both feet, and the same means in summary and page
    table, page = strides("out", "gait.csv"), Path("out/report.html").read_text()
    for side, steady in table[table["steady"]].groupby("foot"):
        mean, sd = (said["gait"][side][name] for name in ("mean", "sd"))
        assert said["gait"][side]["strides"] == len(steady) > 20
        assert steady["step_length_m"].mean() == pytest.approx(mean["step_length_m"], rel=1e-6)
        assert f"<td>{mean['step_width_m']:.2f}\u00a0±\u00a0{sd['step_width_m']:.2f}</td>" in page
    assert f"step time {said['gait']['asymmetry_percent']['step_time_s']:+.1f} %" in page
    assert config("out")["left"]["recording"] == recordings[0]
    assert config("out")["parameters"]
    assert all(f'id="chart-{name}"' in page for name in ("path", "distance", "height", "sigma", "heading", "errors"))
    # and is what other programs are given
    exported = fg_nav("export", "out", "walk.geojson", "walk.tum", "--origin", "48.1,11.5")
    assert exported.code == 0
    assert "between the feet" in exported.out
    assert np.loadtxt("walk.tum") == pytest.approx(person, abs=1e-6)


def test_the_steps_show_which_foot_is_which_and_names_are_kept_and_doubted(run: Any, walked: Path) -> None:
    ran = run("right.csv", "left.csv", "--heading", "90", "--no-mag", truth=("right", "left")).succeeded()
    assert "feet: right and left, as the steps show; " in ran.out
    said = summary("out")
    assert (said["sides"], said["sides_known"]) == (["right", "left"], "shown")
    assert said["width_m"] > 0.0
    assert any("first recording is of the right foot" in note for note in said["notes"])
    assert said["left"]["recording"] == str(walked / "left.csv")
    # the frame is the left foot's, as the heading
    first = strides("out", "strides_left.csv").iloc[0]
    assert abs(first["x_m"]) + abs(first["y_m"]) < 0.1
    assert first["heading_deg"] == pytest.approx(90.0, abs=0.5)
    named = ("--sides", "left,right", "--method", "inertial", "--out", "named")
    run("right.csv", "left.csv", *named, truth=("right", "left")).succeeded()
    said = summary("named")
    assert (said["method"], said["sides"], said["sides_known"]) == ("inertial", ["left", "right"], "named")
    assert said["left"]["recording"] == str(walked / "right.csv")
    assert said["verdict"] == "doubtful"
    assert "the feet look swapped" in said["reasons"][0]
    assert said["reasons"][0] in said["notes"]


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_foot_that_is_lost_for_a_while(run: Any, walked: Path, side: str) -> None:
    recordings = {one: f"{one}.csv" for one in OTHER} | {side: cut(walked, side, 15.0, 30.0)}
    run(*recordings.values(), "--sides", "left,right", "--no-mag", plots="html").succeeded()
    said, other = summary("out"), OTHER[side]
    note = f"the {side} foot was not recorded from 15.0 to 30.0 s: the person goes as the {other} one does"
    assert note in said["notes"]
    assert said["verdict"] == "doubtful", said["reasons"]
    assert [reason.split(":")[0] for reason in said["reasons"]] == [f"{side} foot"]
    assert "nothing was recorded for 15.0" in said["reasons"][0]
    assert max(said[one]["rmse_2d_m"] for one in recordings) < 0.1  # 0.012 m without the hole
    assert said["rmse_2d_m"] < 0.2  # the person goes as one foot, half a step off
    assert said[other]["verdict"] == "trusted"
    assert said["distance_m"] == pytest.approx(76.0, abs=4.0)
    assert np.diff(paths("")[0][:, 0]).max() < 0.02
    # and nothing is drawn where it was not recorded
    page = Path("out/report.html").read_text()
    charts = json.loads(re.findall(r'<script type="application/json" id="charts">(.*?)</script>', page, re.DOTALL)[0])
    traces = {trace.get("name"): trace for trace in reversed(charts["path"]["data"])}  # of a name the path is first
    assert [traces[f"{one} foot"]["x"].count(None) for one in (side, other)] == [1, 0]


def test_both_feet_lost_at_once(run: Any, walked: Path) -> None:
    run(*(cut(walked, side, 15.0, 30.0) for side in OTHER), "--no-mag").succeeded()
    said = summary("out")
    assert said["verdict"] == "not to be used"
    assert any("nothing was recorded for 15.0" in reason and "of neither foot" in reason for reason in said["reasons"])
    assert np.hypot(*said["end_sigma_m"][:2]) > 5.0


def test_a_sensor_that_fails_leaves_the_other_foot_intact(fg_nav: FgNav, run: Any, walked: Path) -> None:
    fg_nav("run", walked / "left.csv", "--plots", "none", "--out", "alone").succeeded()
    ran = run("left.csv", cut(walked, "right", 1.0, 100.0)).succeeded()
    assert "verdict: doubtful: the right foot is missing: cut-right.csv has 1 footfall; " in ran.out
    said = summary("out")
    assert names(Path("out")) == FILES - {"trajectory_right.tum", "strides_right.csv"}
    assert said["right"] is None
    assert set(strides("out", "gait.csv")["foot"]) == said["gait"].keys() == {"left"}
    assert said["left"]["distance_m"] == said["distance_m"] == pytest.approx(summary("alone")["distance_m"], abs=1e-9)
    assert Path("out/trajectory_left.tum").read_text() == Path("alone/trajectory.tum").read_text()
    assert said["left"]["rmse_2d_m"] == pytest.approx(said["rmse_2d_m"], abs=1e-9)
    assert said["reasons"][0] in said["notes"]
    lost = run(cut(walked, "left", 1.0, 100.0), "cut-right.csv", "--out", "none")
    assert lost.refused("neither foot can be navigated", "cut-left.csv", "cut-right.csv")


def test_clocks_that_differ(run: Any, walked: Path) -> None:
    table, truth = pd.read_csv(walked / "right.csv"), np.loadtxt(walked / "right.truth.tum")
    table["time_s"] += 7.0
    table.to_csv("late.csv", index=False)
    truth[:, 0] += 7.0
    np.savetxt("late.tum", truth, fmt="%.9f")
    late = partial(run, "left.csv", "late.csv", "--method", "inertial", truth=("left", "late"))
    late("--clock-offset", "-7").succeeded()
    said = summary("out")
    assert (said["clock_offset_s"], said["clock_offset_known"]) == (-7.0, "given")
    assert max(said["rmse_2d_m"], said["right"]["rmse_2d_m"]) < 0.1
    assert np.ptp([path[0, 0] for path in paths("", "_left", "_right")]) < 0.1
    late("--out", "told").succeeded()
    told = summary("told")
    assert told["clock_offset_known"] == "by the signals"
    assert told["clock_offset_s"] == pytest.approx(-7.0, abs=0.05)
    assert told["rmse_2d_m"] < 0.15
    assert any("clocks aligned" in note for note in told["notes"])


def test_feet_that_nothing_ties_are_two_walks_with_a_remark(run: Any) -> None:
    ran = run("left.csv", "right.csv", "--clock-offset", "100", "--method", "inertial", plots="html").succeeded()
    assert "verdict: doubtful: the feet are solved as two walks, and the left one is the person's path: " in ran.out
    assert (summary("out")["width_m"], summary("out")["cells"]) == (None, 0)
    person, left, right = paths("", "_left", "_right")
    np.testing.assert_allclose(person[:, 1:4], left[:, 1:4], atol=1e-6)
    assert np.linalg.norm(np.diff(right[:, 1:3], axis=0), axis=1).sum() > 50.0
    page = Path("out/report.html").read_text()
    assert "the feet are solved as two walks" in page
    assert 'id="distance"' not in page


def test_what_cannot_be_two_feet_is_refused(walked: Path) -> None:
    left, right = walked / "left.csv", walked / "right.csv"
    with pytest.raises(EstimationError, match="left,right or right,left"):
        navigate_feet(left, right, sides="right, left")  # type: ignore[arg-type]
    with pytest.raises(EstimationError, match="a truth for each recording"):
        navigate_feet(left, right, truth=None)  # type: ignore[arg-type]
    nothing = cast("Any", None)  # a width shows the sides without its prior
    for width_m, sigma_m, shown in (
        (0.15, 0.1, False), (0.15, 0.095, False), (0.15, 0.038, True), (-0.11, 0.0373, True), (0.02, 0.03, False),
    ):  # fmt: skip
        assert shows_sides(FeetSolution(nothing, nothing, nothing, width_m, sigma_m, 9, 0)) is shown


def test_both_feet_of_one_file_are_found_by_the_names_of_its_columns(fg_nav: FgNav, walked: Path) -> None:
    """Left and right are looked for; other names are given, and of one letter each stands by itself."""
    left, right = (pd.read_csv(walked / f"{side}.csv", index_col="time_s") for side in ("left", "right"))
    run = ("--mount", "feet", "--method", "inertial", "--plots", "none", "--json")
    found = []
    for words, given in ((("left", "right"), ()), (("L", "R"), ("--sensor", "L,R")), (("R", "L"), ("--sensor", "R,L"))):
        first, second = (left, right) if words[0][0] in "lL" else (right, left)
        both = [one.add_prefix(f"{word}_") for one, word in zip((first, second), words, strict=True)]
        pd.concat(both, axis=1, join="inner").to_csv("both.csv")
        found.append(json.loads(fg_nav("run", "both.csv", *run, *given).out))
        assert (found[-1]["sides_known"], found[-1]["sides"][0][0]) == ("named", words[0][0].lower())
    assert len({one["distance_m"] for one in found[:2]}) == 1
    assert fg_nav("run", "both.csv", *run[:2]).refused("both sensors, which --sensor A,B names, but ")
