"""The command line from end to end, on the demonstration walk."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav import pipeline
from fg_nav.commands.shared import name_walk
from fg_nav.io import write_canonical, write_tum
from fg_nav.lab.simulation import simulate
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Walk
from tests.command_line import FgNav, in_a_process, names

METHOD_FILES = {"trajectory.tum", "strides.csv", "summary.json", "config.json"}
PICTURES = {"trajectory.png", "heading.png", "gyro_bias.png"}


@pytest.fixture(scope="module")
def demo() -> Recording:
    return simulate("demo", 5).recording


@pytest.fixture(scope="module")
def files(demo: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with `walk.csv` and `truth.tum`."""
    folder = tmp_path_factory.mktemp("recordings")
    truth = demo.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    write_canonical(demo, folder / "walk.csv")
    write_tum(folder / "truth.tum", truth.t, truth.position, truth.nav_R_body)
    return folder


def summary(folder: Path) -> dict[str, float]:
    content = json.loads((folder / "summary.json").read_text())
    assert isinstance(content, dict)
    return content


@pytest.mark.parametrize("method", ["smoother", "iez"])
def test_run_writes_the_contract(fg_nav: FgNav, files: Path, demo: Recording, method: str) -> None:
    ran = fg_nav("run", files / "walk.csv", "--method", method, "--truth", files / "truth.tum", "--out", "deep/out")
    assert ran.code == 0, ran.err
    assert ran.err == ""
    out = Path("deep/out")
    assert names(out) == METHOD_FILES | {"report.html"}
    assert len((out / "trajectory.tum").read_text().splitlines()) == len(demo)
    said = summary(out)
    strides = pd.read_csv(out / "strides.csv")
    assert said["method"] == method
    assert said["strides"] == len(strides) - 1
    assert said["duration_s"] == pytest.approx(demo.duration_s)
    assert said["rmse_2d_m"] < 0.5
    assert said["heading_rmse_deg"] < 3
    assert 60 < said["distance_m"] < 85
    assert said["realtime_factor"] == pytest.approx(said["duration_s"] / said["runtime_s"])
    assert said["magnetometer"] == ("used" if method == "smoother" else "not used")
    for words in (f"{said['rmse_2d_m']:.3f} m rms", f"{said['closure_m']:.3f} m from", "report: deep/out/report.html"):
        assert words in ran.out
    assert len(ran.out.splitlines()) == 5
    config = json.loads((out / "config.json").read_text())
    assert config["recording"] == str(files / "walk.csv")
    assert config["format"] == "canonical"
    assert config["parameters"]


def test_result_without_a_folder_goes_to_a_fresh_one(fg_nav: FgNav, files: Path) -> None:
    assert fg_nav("run", files / "walk.csv", "--method", "iez").code == 0
    quiet = fg_nav("run", files / "walk.csv", "--method", "iez", "--quiet")
    assert (quiet.code, quiet.out, quiet.err) == (0, "", "")
    assert names(Path("results")) == {"walk-iez-1", "walk-iez-2"}
    assert "rmse_2d_m" not in summary(Path("results/walk-iez-2"))


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("walk.csv", "walk"),
        ("monday/walk.v2.csv", "walk.v2"),
        ("monday/walk.csv.gz", "walk"),
        ("monday/recording_3.csv", "recording_3"),
        ("results/demo-1/recording.csv", "demo-1"),
        ("monday/Raw Data.csv", "monday"),
        ("monday/Gyroscope.csv", "monday"),
        ("monday/data.csv.gz", "monday"),
        ("/recording.csv", "recording"),
    ],
)
def test_a_result_is_named_after_the_walk(file: str, name: str) -> None:
    assert name_walk(Path(file)) == name


def test_older_result_is_replaced_only_with_force(fg_nav: FgNav, files: Path) -> None:
    arguments = ("run", files / "walk.csv", "--method", "iez", "--out", "out")
    assert fg_nav(*arguments).code == 0
    Path("out/summary.json").write_text("old")
    assert fg_nav(*arguments).refused("out already holds a result", "--force")
    assert Path("out/summary.json").read_text() == "old"
    assert fg_nav(*arguments, "--force").code == 0
    assert summary(Path("out"))["method"] == "iez"
    assert names(Path("out")) == METHOD_FILES | {"report.html"}


def test_options_reach_the_method_and_the_record(fg_nav: FgNav, files: Path) -> None:
    arguments = ("run", files / "walk.csv", "--method", "iez", "--heading", "90", "--no-mag", "--out", "out", "--json")
    ran = fg_nav(*arguments)
    assert ran.code == 0
    assert json.loads(ran.out) == {"recording": str(files / "walk.csv"), "folder": "out", **summary(Path("out"))}
    again = fg_nav(*arguments)
    assert (again.code, again.out) == (1, "")
    assert json.loads(again.err)["error"].startswith("out already holds a result")
    first, last = (pd.read_csv("out/strides.csv").iloc[k] for k in (0, 8))
    assert first["heading_deg"] == pytest.approx(90.0, abs=0.5)
    assert last["x_m"] - first["x_m"] > 5  # the walk starts straight ahead: now east
    assert abs(last["y_m"] - first["y_m"]) < 1
    config = json.loads(Path("out/config.json").read_text())
    assert (config["heading_deg"], config["use_magnetometer"]) == (90.0, False)


def test_compare_lays_methods_side_by_side_on_the_same_stances(fg_nav: FgNav, files: Path) -> None:
    ran = fg_nav(
        "compare",
        files / "walk.csv",
        "--methods",
        "smoother, iez",
        "--truth",
        files / "truth.tum",
        "--plots",
        "all",
        "--out",
        "out",
    )
    assert ran.code == 0, ran.err
    pictures = {"trajectories.png", "errors.png", "stance_statistic.png"}
    shared = {"comparison.csv", "comparison.json", "report.html", *pictures}
    assert names(Path("out")) == shared | {"smoother", "iez"}
    assert names(Path("out/smoother")) == names(Path("out/iez")) == METHOD_FILES | PICTURES
    table = pd.read_csv("out/comparison.csv")
    assert list(table["method"]) == ["smoother", "iez"]
    assert table["rmse_2d_m"][1] == pytest.approx(summary(Path("out/iez"))["rmse_2d_m"])
    detectors = [json.loads(Path(f"out/{m}/config.json").read_text())["detector"] for m in ("smoother", "iez")]
    assert detectors[0] == detectors[1]
    assert all(word in ran.out for word in ("smoother", "iez", "max error (m)"))
    assert fg_nav("compare", files / "walk.csv", "--out", "out").refused("--force")
    asked = ("compare", files / "walk.csv", "--methods", "iez", "--out", "small", "--json")
    assert json.loads(fg_nav(*asked).out)["methods"] == json.loads(Path("small/comparison.json").read_text())


def test_demo_can_be_run_again_from_its_files(fg_nav: FgNav) -> None:
    ran = fg_nav("demo", "--out", "demo")
    assert ran.code == 0, ran.err
    assert {"recording.csv", "truth.tum", "comparison.csv", "report.html"} <= names(Path("demo"))
    first = summary(Path("demo/iez"))
    assert 340 < first["distance_m"] < 370
    errors = {name: summary(Path("demo", name))["rmse_2d_m"] for name in ("smoother", "card", "ma2018", "inertial")}
    assert max(errors["smoother"], errors["card"]) < errors["ma2018"] < errors["inertial"]
    assert errors["smoother"] < errors["inertial"] / 3
    again = fg_nav("run", "demo/recording.csv", "--method", "iez", "--truth", "demo/truth.tum", "--out", "again")
    assert again.code == 0, again.err
    assert summary(Path("again"))["rmse_2d_m"] == pytest.approx(first["rmse_2d_m"], rel=1e-3)  # stamps are to the ns
    assert fg_nav("run", "demo/recording.csv", "--out", "demo", "--force").refused("does not write")


OWN_WALK = """
like = "office"
field = "smooth"
[course]
points_m = [[0, 0], [0, 12], [9, 12], [9, 0], [0, 0]]
rest_s = 3.0
[sensor]
rate_hz = 100.0
[sensor.gyr]
noise_density = 2e-4
"""


def test_simulate_writes_the_contract(fg_nav: FgNav) -> None:
    ran = fg_nav("simulate", "demo", "--seed", "2", "--out", "walk")
    assert ran.code == 0, ran.err
    assert ran.err == ""
    assert names(Path("walk")) == {"recording.csv", "truth.tum", "truth.json", "map.png"}
    header = Path("walk/recording.csv").read_text().splitlines()[0]
    assert header.startswith("time_s,acc_x_m_s2") and header.endswith("mag_z_uT")  # noqa: PT018
    truth = json.loads(Path("walk/truth.json").read_text())
    seconds = np.diff(truth["biases"]["time_s"])
    np.testing.assert_allclose(seconds, 1.0, atol=1e-3)
    assert np.array(truth["biases"]["gyr_rad_s"]).shape == (len(seconds) + 1, 3)
    assert truth["field_model"]["kind"] == "Sum"
    again = fg_nav("compare", "walk/recording.csv", "--truth", "walk/truth.tum", "--out", "compared")
    assert again.code == 0, again.err
    assert summary(Path("compared/smoother"))["rmse_2d_m"] < 1.0
    assert fg_nav("simulate", "demo", "--out", "walk").refused("--force")


def test_simulate_writes_both_feet_with_their_truths(fg_nav: FgNav) -> None:
    ran = fg_nav("simulate", "demo", "--seed", "2", "--rate", "100", "--both-feet", "--out", "feet", "--json")
    assert ran.code == 0, ran.err
    assert 0.1 <= json.loads(ran.out)["step_width_m"] <= 0.2
    of_a_foot = {"csv", "truth.tum", "truth.json"}
    each = {f"{side}.{kind}" for side in ("left", "right") for kind in of_a_foot}
    assert names(Path("feet")) == each | {"person.tum", "map.png"}
    left, right, person = (np.loadtxt(f"feet/{name}.tum") for name in ("left.truth", "right.truth", "person"))
    np.testing.assert_array_equal(person[:, 0], right[:, 0])
    assert np.linalg.norm((left[0] - right[0])[1:4]) < 0.3
    again = fg_nav("run", "feet/left.csv", "--truth", "feet/left.truth.tum", "--out", "left")
    assert again.code == 0, again.err
    assert summary(Path("left"))["rmse_2d_m"] < 1.0
    assert fg_nav("simulate", "demo", "--worn", "pocket", "--both-feet").refused("'pocket' has none opposite")
    assert fg_nav("simulate", "demo", "--rate", "100", "--out", "feet", "--force").code == 0
    assert names(Path("feet")) == {"recording.csv", "truth.tum", "truth.json", "map.png"}


def test_simulate_reads_a_scenario_of_ones_own(fg_nav: FgNav) -> None:
    Path("yard.toml").write_text(OWN_WALK)
    ran = fg_nav("simulate", "yard.toml")
    assert ran.code == 0, ran.err
    truth = json.loads(Path("results/yard-1/truth.json").read_text())
    assert truth["drawn"]["sensor"]["prior"]["gyr"]["noise_density"] == 2e-4
    assert np.linalg.norm(truth["strides"]["footprint_m"][-1]) < 0.3
    assert "smooth" in ran.out


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[0, 12], [9, 12]", "[0, 12], [0, 12]", ["yard.toml"]),
        ("[0, 12], [9, 12]", "[0, 0.5], [0.5, 0.5]", ["yard.toml"]),
        ("[[0, 0], [0, 12], [9, 12], [9, 0], [0, 0]]", "[[0, 0]]", ["point"]),
        ("2e-4", "-2e-4", ["noise_density"]),
        ("noise_density", "noisiness", ["no parameter 'noisiness'"]),
        ('"smooth"', '"swampy"', ["no field 'swampy'"]),
        ('"office"', '"offfice"', ["no scenario 'offfice'"]),
        ("rate_hz = 100.0", 'rate_hz = "fast"', ["sensor.rate_hz", "fast"]),
        ("[course]", "[curse]", ["course"]),
        ("like =", "like", ["no TOML"]),
        ("rest_s = 3.0", "rest_s = -3.0", ["-3"]),
        ("rest_s = 3.0", "strides = 9.0", ["strides", "9.0"]),
        ("rest_s = 3.0", "strides = nan", ["strides", "nan"]),
        ("[9, 0], [0, 0]]", "[9, 0]]\nlaps = 2", ["laps", "closed"]),
        ('"office"', "[1]", ["like", "[1]"]),
        ('field = "smooth"', "magnets = [[1, 2]]", ["magnets"]),
        ('field = "smooth"', 'name = "house"', ["no parameter 'name'"]),
    ],
)
def test_a_scenario_that_cannot_be_is_refused(fg_nav: FgNav, old: str, new: str, words: list[str]) -> None:
    assert old in OWN_WALK
    Path("yard.toml").write_text(OWN_WALK.replace(old, new))
    assert fg_nav("simulate", "yard.toml", "--out", "yard").refused("yard.toml", *words)
    assert not Path("yard").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], ["no scenario 'nowhere'", "office", "mall"]),
        (["nowhere.toml"], ["nowhere.toml"]),
        (["demo", "--sensor", "sextant"], ["no sensor 'sextant'", "mpu-9250"]),
        (["demo", "--field", "swampy"], ["no field 'swampy'", "indoor"]),
        (["demo", "--site", "atlantis"], ["no site", "munich"]),
        (["demo", "--rate", "-5"], ["rate_hz"]),
        (["demo", "--rate", "nan"], ["rate_hz"]),
        (["demo", "--turn", "inf"], ["turned"]),
    ],
)
def test_simulate_refuses_what_cannot_be(fg_nav: FgNav, arguments: list[str], words: list[str]) -> None:
    assert fg_nav("simulate", *arguments, "--out", "out").refused(*words)
    assert not Path("out").exists()


def test_simulate_lists_what_there_is(fg_nav: FgNav) -> None:
    ran = fg_nav("simulate", "--list")
    assert ran.code == 0
    assert all(word in ran.out for word in ("office", "pocket-street", "mpu-9250x8", "indoor", "equator"))
    listed = json.loads(fg_nav("simulate", "--json", "--list").out)
    assert "office" in listed["scenarios"]
    assert "indoor" in listed["fields"]
    assert fg_nav("simulate").code == 2


@pytest.mark.parametrize("command", [["inspect"], ["run"], ["compare"]], ids=" ".join)
@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("missing.csv", None),
        ("empty.csv", b""),
        ("letter.txt", b"Dear sir,\nno data.\n"),
        ("raw.bin", bytes(range(256))),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_bad_recordings_are_refused_in_one_line(
    fg_nav: FgNav, command: list[str], name: str, content: bytes | None
) -> None:
    if content is not None:
        Path(name).write_bytes(content)
    before = names(Path())
    assert fg_nav(*command, name).refused(name)
    assert names(Path()) == before


def test_bad_choices_are_refused_in_one_line(fg_nav: FgNav, files: Path) -> None:
    walk, truth = files / "walk.csv", files / "truth.tum"
    Path("taken").write_text("mine")
    assert fg_nav("run", walk, "--method", "magic").refused("no method 'magic'", "smoother", "iez")
    assert fg_nav("compare", walk, "--methods", "iez,,smoother").refused("no method ''")
    assert fg_nav("run", walk, "--format", "magic").refused("magic", "canonical")
    assert fg_nav("run", walk, "--truth", "nowhere.tum").refused("nowhere.tum")
    assert fg_nav("run", walk, "--out", "taken").refused("taken is a file")
    assert fg_nav("run", walk, "--force").refused("--out")
    assert fg_nav("run", Path()).refused()
    assert fg_nav("run", truth).refused("truth.tum")
    assert names(Path()) == {"taken"}


def test_truth_of_another_time_is_refused_and_nothing_written(fg_nav: FgNav, files: Path, demo: Recording) -> None:
    truth = demo.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    write_tum("late.tum", truth.t + 1000, truth.position, truth.nav_R_body)
    ran = fg_nav("run", files / "walk.csv", "--method", "iez", "--truth", "late.tum")
    assert ran.refused("share no time")
    assert names(Path()) == {"late.tum"}


def test_truth_of_another_time_in_the_recording_is_left_out(demo: Recording) -> None:
    truth = demo.truth
    assert isinstance(truth, TrajectoryTruth)
    late = replace(demo, truth=replace(truth, t=truth.t + 1000))
    outcome = pipeline.run_method(pipeline.prepare_walk(Walk.of(late)), "iez")
    assert outcome.comparison is None
    assert outcome.metrics.rmse_2d_m is None
    assert any("share no time" in note for note in outcome.metrics.notes)


@pytest.mark.parametrize("arguments", [["run"], ["run", "x", "--alignment", "best"], ["dance"], ["run", "x", "-q"]])
def test_commands_not_understood_exit_with_2(fg_nav: FgNav, arguments: list[str]) -> None:
    ran = fg_nav(*arguments)
    assert ran.code == 2
    assert "Usage" in ran.err
    assert "Traceback" not in ran.err


def failing(error: BaseException) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


def test_bug_exits_with_70_and_its_traceback(fg_nav: FgNav, files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "run_method", failing(ZeroDivisionError("a slip")))
    ran = fg_nav("run", files / "walk.csv")
    assert ran.code == 70
    assert "Traceback" in ran.err
    assert "a slip" in ran.err
    assert ran.err.splitlines()[-1].startswith("fg-nav: this is a bug (ZeroDivisionError)")
    assert names(Path()) == set()


def test_interrupt_exits_with_130_and_leaves_nothing(
    fg_nav: FgNav, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fg_nav.report import page

    monkeypatch.setattr(page, "write_page", failing(KeyboardInterrupt()))
    ran = fg_nav("run", files / "walk.csv", "--method", "iez", "--out", "out")
    assert (ran.code, ran.err) == (130, "")
    assert names(Path()) == set()


@pytest.mark.parametrize("arguments", [["run", "--out", "out"], ["run"], ["compare", "--out", "out"]], ids=" ".join)
def test_full_disk_is_one_line_and_leaves_no_result(
    fg_nav: FgNav, files: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str]
) -> None:
    from fg_nav.report import page

    monkeypatch.setattr(page, "write_page", failing(OSError(28, "No space left on device")))
    command, *rest = arguments
    option = "--method" if command == "run" else "--methods"
    ran = fg_nav(command, files / "walk.csv", option, "iez", *rest)
    assert ran.refused("cannot be written", "no space left on device")
    assert list(Path().rglob("*.*")) == []


def test_system_error_outside_the_result_is_one_line(
    fg_nav: FgNav, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fg_nav.commands.run.read_walk", failing(PermissionError(13, "Permission denied", "walk.csv")))
    assert fg_nav("run", files / "walk.csv").refused("permission denied", "walk.csv")


def test_inspect_gives_figures_and_a_verdict(fg_nav: FgNav, files: Path) -> None:
    ran = fg_nav("inspect", files / "walk.csv")
    assert ran.code == 0, ran.err
    assert "200" in ran.out
    assert "verdict" in ran.out.lower()
    found = json.loads(fg_nav("inspect", files / "walk.csv", "--json").out)
    assert (found["usable"], found["refusal"]) == (True, None)
    assert found["verdict"][0] == "trusted: it can be navigated with."
    assert found["stamps"]["rate_hz"] == pytest.approx(200.0, abs=0.1)
    assert found["field"]["strength_uT"] > 0


def test_inspect_of_what_cannot_be_navigated_with_is_an_error(fg_nav: FgNav, files: Path) -> None:
    Path("short.csv").write_text("\n".join((files / "walk.csv").read_text().splitlines()[:6]))
    ran = fg_nav("inspect", "short.csv")
    assert ran.code == 1
    assert "not to be used: it cannot be navigated with" in ran.out
    assert ran.err.startswith("fg-nav: ")
    told = fg_nav("inspect", "short.csv", "--json")
    assert (told.code, json.loads(told.out)["usable"]) == (1, False)
    assert json.loads(told.err)["error"] == json.loads(told.out)["refusal"] == ran.err.removeprefix("fg-nav: ").strip()


def test_pipes_get_plain_text_and_silence(files: Path, tmp_path: Path) -> None:
    walk = files / "walk.csv"
    for arguments in (["inspect", walk], ["run", walk, "--method", "iez", "--out", "out"]):
        ran = in_a_process(*arguments, cwd=tmp_path)
        assert (ran.code, ran.err) == (0, "")
        assert "\x1b" not in ran.out
        assert not set("━┃│╭") & set(ran.out)
        assert ran.out.strip()


def test_file_name_that_the_terminal_cannot_show_is_no_bug(files: Path, tmp_path: Path) -> None:
    walk = tmp_path / "Zürich.csv"
    walk.write_bytes((files / "walk.csv").read_bytes())
    ran = in_a_process("inspect", walk, PYTHONIOENCODING="ascii")
    assert (ran.code, ran.err) == (0, "")
    assert "Z\\xfcrich.csv" in ran.out


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_load_no_heavy_library(option: str) -> None:
    ran = in_a_process(option, python=("-X", "importtime"))
    assert ran.code == 0
    assert ran.out.strip()
    assert not any(name in ran.err for name in ("matplotlib", "gtsam", "numba", "scipy"))


def test_every_run_ends_with_a_verdict(fg_nav: FgNav, files: Path) -> None:
    ran = fg_nav("run", files / "walk.csv", "--method", "iez", "--out", "out", "--strict")
    assert ran.code == 0
    said = summary(Path("out"))
    assert (said["verdict"], said["reasons"]) == ("trusted", [])
    assert ran.out.splitlines()[0] == "verdict: trusted"
    compared = fg_nav("compare", files / "walk.csv", "--out", "both")
    assert compared.out.splitlines()[-3:-1] == ["verdict (smoother): trusted", "verdict (iez): trusted"]


def test_strict_fails_on_a_path_that_is_not_to_be_used_and_writes_it(
    fg_nav: FgNav, demo: Recording, tmp_path: Path
) -> None:
    thin = replace(demo, t=demo.t[::10], acc=demo.acc[::10], gyr=demo.gyr[::10], mag=None, truth=None)
    write_canonical(thin, tmp_path / "thin.csv")
    for strict, code in (((), 0), (("--strict",), 1)):
        out = f"out{code}"
        ran = fg_nav("run", tmp_path / "thin.csv", "--method", "iez", "--out", out, *strict)
        assert ran.code == code
        assert summary(Path(out))["verdict"] == "not to be used"
        assert names(Path(out)) == METHOD_FILES | {"report.html"}
        [verdict] = [line for line in ran.out.splitlines() if line.startswith("verdict: not to be used: ")]
        assert "sample rate of 20 Hz" in verdict
    assert ran.err == "fg-nav: the path is not to be used: see its reasons in out1/summary.json.\n"
