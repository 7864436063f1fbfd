"""Two recordings of one walk, a sensor on each foot, from the command line to the files."""

import json
import re
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
from tests.command_line import FgNav, names

FILES = {
    *("trajectory.tum", "trajectory_left.tum", "trajectory_right.tum", "strides_left.csv", "strides_right.csv"),
    *("person.csv", "summary.json", "config.json", "report.html"),
}
FEET = ("--mount", "feet")


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with `left.csv` and `right.csv`, their truths and `person.tum`."""
    folder = tmp_path_factory.mktemp("feet")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fg_nav.report.plots.style.save", lambda figure, path: path.touch())
        write_feet(folder, simulate_feet("demo", 1))
    return folder


@pytest.fixture
def cut(walked: Path, tmp_path: Path) -> Any:
    """Write one foot's recording without the samples between two times, s, and return its place."""

    def write(side: str, start: float, stop: float) -> Path:
        table = pd.read_csv(walked / f"{side}.csv")
        kept = (table["time_s"] < start) | (table["time_s"] > stop)
        table[kept].to_csv(tmp_path / f"cut-{side}.csv", index=False)
        return tmp_path / f"cut-{side}.csv"

    return write


def summary(folder: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((Path(folder) / "summary.json").read_text())
    return content


def test_both_feet_are_one_walk(fg_nav: FgNav, walked: Path) -> None:
    truths = f"{walked / 'left.truth.tum'},{walked / 'right.truth.tum'}"
    recordings = (walked / "left.csv", walked / "right.csv")
    ran = fg_nav("run", *recordings, *FEET, "--truth", truths, "--out", "out", "--json")
    assert (ran.code, ran.err) == (0, "")
    assert names(Path("out")) == FILES
    said = summary("out")
    assert json.loads(ran.out) == {"recordings": [str(one) for one in recordings], "folder": "out", **said}
    assert (said["method"], said["mount"], said["sides"]) == ("smoother", "feet", ["left", "right"])
    assert (said["clock_offset_s"], said["clock_offset_known"]) == (0.0, "by the signals")
    assert said["width_m"] == pytest.approx(0.12, abs=3 * said["width_sigma_m"])
    assert said["cells"] > 5
    # the person is between the feet, and as near to the truth
    assert said["rmse_2d_m"] < 0.1
    assert max(said[side]["rmse_2d_m"] for side in ("left", "right")) < 0.1
    assert said["distance_m"] == pytest.approx(said["left"]["distance_m"], abs=2.0)
    person = np.loadtxt("out/trajectory.tum")
    left, right = (np.loadtxt(f"out/trajectory_{side}.tum") for side in ("left", "right"))
    middle = 0.5 * (left[-1, 1:4] + right[-1, 1:4])
    assert np.abs(person[-1, 1:4] - middle).max() < 0.01
    for table in ("person.csv", "strides_left.csv", "strides_right.csv"):
        assert tuple(pd.read_csv(f"out/{table}").columns) == STRIDE_COLUMNS
    assert said["strides"] == len(pd.read_csv("out/person.csv")) - 1
    config = json.loads(Path("out/config.json").read_text())
    assert config["left"]["recording"] == str(recordings[0])
    assert config["parameters"]
    page = Path("out/report.html").read_text()
    assert all(f'id="chart-{name}"' in page for name in ("path", "distance", "height", "sigma", "heading", "errors"))
    # and is what other programs are given
    exported = fg_nav("export", "out", "walk.geojson", "walk.tum", "--origin", "48.1,11.5")
    assert exported.code == 0
    assert "between the feet" in exported.out
    assert np.loadtxt("walk.tum") == pytest.approx(person, abs=1e-6)


def test_the_steps_show_which_foot_is_which(fg_nav: FgNav, walked: Path) -> None:
    heading = ("--heading", "90", "--plots", "none", "--no-mag")
    ran = fg_nav("run", walked / "right.csv", walked / "left.csv", *FEET, *heading, "--out", "out")
    assert ran.code == 0, ran.err
    assert "feet: right and left, as the steps show; " in ran.out
    said = summary("out")
    assert (said["sides"], said["sides_known"]) == (["right", "left"], "shown")
    assert said["width_m"] > 0.0
    assert any("first recording is of the right foot" in note for note in said["notes"])
    assert said["left"]["recording"] == str(walked / "left.csv")
    # the frame is the left foot's, as the heading
    first = pd.read_csv("out/strides_left.csv").iloc[0]
    assert abs(first["x_m"]) + abs(first["y_m"]) < 0.1
    assert first["heading_deg"] == pytest.approx(90.0, abs=0.5)


def test_names_of_the_feet_are_kept_and_doubted(fg_nav: FgNav, walked: Path) -> None:
    arguments = ("run", walked / "right.csv", walked / "left.csv", *FEET, "--sides", "left,right", "--plots", "none")
    assert fg_nav(*arguments, "--method", "inertial", "--out", "out").code == 0
    said = summary("out")
    assert (said["method"], said["sides"], said["sides_known"]) == ("inertial", ["left", "right"], "named")
    assert said["left"]["recording"] == str(walked / "right.csv")
    assert said["verdict"] == "doubtful"
    assert "the feet look swapped" in said["reasons"][0]
    assert said["reasons"][0] in said["notes"]


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_foot_that_is_lost_for_a_while(fg_nav: FgNav, walked: Path, cut: Any, side: str) -> None:
    """Both parts of its recording are used: the other foot goes on between them."""
    recordings = {one: walked / f"{one}.csv" for one in ("left", "right")}
    recordings[side] = cut(side, 15.0, 30.0)
    truths = ("--truth", f"{walked / 'left.truth.tum'},{walked / 'right.truth.tum'}", "--sides", "left,right")
    ran = fg_nav("run", *recordings.values(), *FEET, *truths, "--no-mag", "--out", "out")
    assert ran.code == 0, ran.err
    said, other = summary("out"), {"left": "right", "right": "left"}[side]
    assert (
        f"the {side} foot was not recorded from 15.0 to 30.0 s: the person goes as the {other} one does"
        in said["notes"]
    )
    assert said["verdict"] == "doubtful", said["reasons"]
    assert [reason.split(":")[0] for reason in said["reasons"]] == [f"{side} foot"]
    assert "nothing was recorded for 15.0" in said["reasons"][0]
    assert max(said[one]["rmse_2d_m"] for one in recordings) < 0.1  # 0.012 m without the hole
    assert said["rmse_2d_m"] < 0.2  # the person goes as one foot, half a step off
    assert said[other]["verdict"] == "trusted"
    assert said["distance_m"] == pytest.approx(76.0, abs=4.0)
    t = np.loadtxt("out/trajectory.tum")[:, 0]
    assert np.diff(t).max() < 0.02
    # and nothing is drawn where it was not recorded
    page = Path("out/report.html").read_text()
    charts = json.loads(re.findall(r'<script type="application/json" id="charts">(.*?)</script>', page, re.DOTALL)[0])
    traces = {trace.get("name"): trace for trace in reversed(charts["path"]["data"])}  # of a name the path is first
    assert traces[f"{side} foot"]["x"].count(None) == 1
    assert None not in traces[f"{other} foot"]["x"]


def test_both_feet_lost_at_once(fg_nav: FgNav, walked: Path, cut: Any) -> None:
    """Nothing shows how the person went on, and that is said."""
    recordings = [cut(side, 15.0, 30.0) for side in ("left", "right")]
    assert fg_nav("run", *recordings, *FEET, "--no-mag", "--plots", "none", "--out", "out").code == 0
    said = summary("out")
    assert said["verdict"] == "not to be used"
    assert any("nothing was recorded for 15.0" in reason and "of neither foot" in reason for reason in said["reasons"])
    assert np.hypot(*said["end_sigma_m"][:2]) > 5.0


def test_a_sensor_that_fails_leaves_the_other_foot_intact(fg_nav: FgNav, walked: Path, cut: Any) -> None:
    assert fg_nav("run", walked / "left.csv", "--plots", "none", "--out", "alone").code == 0
    truths = ("--truth", f"{walked / 'left.truth.tum'},{walked / 'right.truth.tum'}")
    ran = fg_nav("run", walked / "left.csv", cut("right", 1.0, 100.0), *FEET, *truths, "--out", "out")
    assert ran.code == 0, ran.err
    assert "verdict: doubtful: the right foot is missing: cut-right.csv has 1 footfall; " in ran.out
    said, alone = summary("out"), summary("alone")
    assert names(Path("out")) == FILES - {"trajectory_right.tum", "strides_right.csv"}
    assert said["right"] is None
    assert said["left"]["distance_m"] == said["distance_m"] == pytest.approx(alone["distance_m"], abs=1e-9)
    assert Path("out/trajectory_left.tum").read_text() == Path("alone/trajectory.tum").read_text()
    assert said["left"]["rmse_2d_m"] == pytest.approx(said["rmse_2d_m"], abs=1e-9)
    assert said["reasons"][0] in said["notes"]
    wrong = fg_nav("run", walked / "left.csv", walked / "right.csv", *FEET, "--truth", "no.tum,nothing.tum")
    assert wrong.refused("no.tum")
    lost = fg_nav("run", cut("left", 1.0, 100.0), cut("right", 1.0, 100.0), *FEET, "--out", "none")
    assert lost.refused("neither foot can be navigated", "cut-left.csv", "cut-right.csv")


def test_clocks_that_differ(fg_nav: FgNav, walked: Path, tmp_path: Path) -> None:
    late = tmp_path / "late.csv"
    table = pd.read_csv(walked / "right.csv")
    table["time_s"] += 7.0
    table.to_csv(late, index=False)
    truth = np.loadtxt(walked / "right.truth.tum")
    truth[:, 0] += 7.0
    np.savetxt(tmp_path / "late.tum", truth, fmt="%.9f")
    truths = ("--truth", f"{walked / 'left.truth.tum'},{tmp_path / 'late.tum'}")
    arguments = ("run", walked / "left.csv", late, *FEET, *truths, "--method", "inertial", "--plots", "none")
    assert fg_nav(*arguments, "--clock-offset", "-7", "--out", "out").code == 0
    said = summary("out")
    assert (said["clock_offset_s"], said["clock_offset_known"]) == (-7.0, "given")
    assert said["rmse_2d_m"] < 0.1
    assert said["right"]["rmse_2d_m"] < 0.1
    t = [np.loadtxt(f"out/trajectory{end}.tum")[0, 0] for end in ("", "_left", "_right")]
    assert max(t) - min(t) < 0.1
    assert fg_nav(*arguments, "--out", "told").code == 0
    told = summary("told")
    assert told["clock_offset_known"] == "by the signals"
    assert told["clock_offset_s"] == pytest.approx(-7.0, abs=0.05)
    assert told["rmse_2d_m"] < 0.15
    assert any("clocks aligned" in note for note in told["notes"])


@pytest.mark.parametrize(
    ("width_m", "sigma_m", "shown"),
    [(0.15, 0.1, False), (0.15, 0.095, False), (0.15, 0.038, True), (-0.11, 0.0373, True), (0.02, 0.03, False)],
)
def test_a_width_shows_the_sides_without_its_prior(width_m: float, sigma_m: float, shown: bool) -> None:
    nothing = cast("Any", None)
    assert shows_sides(FeetSolution(nothing, nothing, nothing, width_m, sigma_m, 9, 0)) is shown


def test_feet_that_nothing_ties_are_two_walks_with_a_remark(fg_nav: FgNav, walked: Path) -> None:
    ran = fg_nav("run", walked / "left.csv", walked / "right.csv", *FEET, "--clock-offset", "100", "--plots", "html")
    assert ran.code == 0
    assert "verdict: doubtful: the feet are solved as two walks, and the left one is the person's path: " in ran.out
    assert "two walks" in ran.out
    folder = next(Path("results").iterdir())
    told = json.loads((folder / "summary.json").read_text())
    assert (told["width_m"], told["cells"]) == (None, 0)
    alone = {side: np.loadtxt(folder / f"trajectory_{side}.tum") for side in ("left", "right")}
    np.testing.assert_allclose(np.loadtxt(folder / "trajectory.tum")[:, 1:4], alone["left"][:, 1:4], atol=1e-6)
    assert np.linalg.norm(np.diff(alone["right"][:, 1:3], axis=0), axis=1).sum() > 50.0
    assert "Nothing ties the feet" in (folder / "report.html").read_text()


def test_what_cannot_be_two_feet_is_refused(fg_nav: FgNav, walked: Path, tmp_path: Path) -> None:
    left, right = walked / "left.csv", walked / "right.csv"
    table = pd.read_csv(right)
    table[[name for name in table if name.startswith("gyr")]] *= -1.0
    table.to_csv(tmp_path / "mirrored.csv", index=False)
    assert fg_nav("run", left, tmp_path / "mirrored.csv", *FEET).refused("mirrored.csv: ")
    for given, said in {(left, right, left): "3 of them", (left,): "--sensor A,B", (left, left): "one twice"}.items():
        assert fg_nav("run", *given, *FEET).refused("takes two recordings", said)
    with pytest.raises(EstimationError, match="left,right or right,left"):
        navigate_feet(left, right, sides="right, left")  # type: ignore[arg-type]
    with pytest.raises(EstimationError, match="a truth for each recording"):
        navigate_feet(left, right, truth=None)  # type: ignore[arg-type]
