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
from fg_nav.estimators import METHODS, Method
from fg_nav.io import write_canonical, write_tum
from fg_nav.lab.simulation import Choices, simulate
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


def keeps_the_contract(folder: Path, recording: Recording, method: Method) -> bool:
    """Files of one method on one recording are all there and agree with it, and with each other."""
    online = {"online.csv"} if method.name == "online" else set()
    assert names(folder) - {"report.html"} - PICTURES == METHOD_FILES | online
    said, path = summary(folder), np.loadtxt(folder / "trajectory.tum")
    position = pd.read_csv(folder / "strides.csv")[["x_m", "y_m", "z_m"]].to_numpy()
    assert said["method"] == method.name
    assert said["strides"] == len(position) - 1
    assert said["duration_s"] == pytest.approx(recording.duration_s)
    assert said["realtime_factor"] == pytest.approx(said["duration_s"] / said["runtime_s"])
    assert said["closure_m"] == pytest.approx(np.linalg.norm(position[-1] - position[0]), abs=1e-5)
    assert said["magnetometer"] == ("used" if method.uses_field else "not used")
    assert said["rmse_2d_m"] < (1.0 if method.mount == "foot" else 5.0)
    np.testing.assert_allclose(path[[0, -1], 0], recording.t[[0, -1]], atol=1e-6)
    config = json.loads((folder / "config.json").read_text())
    assert (config["format"], Path(config["recording"]).stem) == ("canonical", "walk")
    return bool(config["parameters"])


def test_every_method_on_a_foot_keeps_one_contract(fg_nav: FgNav, files: Path, demo: Recording) -> None:
    """Also that of one method alone: all files are the same but for the time that it took."""
    part, truth = demo.slice(0, 4000), ("--truth", files / "truth.tum")
    write_canonical(part, Path("walk.csv"))
    methods = METHODS["foot"]
    ran = fg_nav("compare", "walk.csv", "--methods", ", ".join(methods), *truth, "--out", "all", "--plots", "none")
    assert ran.code == 0, ran.err
    table = pd.read_csv("all/comparison.csv").set_index("method")
    assert list(table.index) == list(methods)
    for name, method in methods.items():
        assert keeps_the_contract(Path("all", name), part, method), name
        assert table["rmse_2d_m"][name] == pytest.approx(summary(Path("all", name))["rmse_2d_m"])
    detectors = {json.dumps(json.loads(Path("all", one, "config.json").read_text())["detector"]) for one in methods}
    assert len(detectors) == 1  # on the same stances
    for name in ("smoother", "online", "iez-rts"):
        assert fg_nav("run", "walk.csv", "--method", name, *truth, "--out", name, "--plots", "none").code == 0
        for file in ("trajectory.tum", "strides.csv"):
            assert Path(name, file).read_text() == Path("all", name, file).read_text()


@pytest.mark.parametrize("method", METHODS["pocket"].values(), ids=lambda method: method.name)
def test_every_method_in_a_pocket_keeps_it_too(fg_nav: FgNav, method: Method) -> None:
    recording = simulate("demo", 103, Choices(worn="pocket", rate_hz=100.0)).recording.slice(0, 3000)
    write_canonical(recording, Path("walk.csv"))
    assert isinstance(recording.truth, TrajectoryTruth)
    assert recording.truth.nav_R_body is not None
    write_tum("truth.tum", recording.truth.t, recording.truth.position, recording.truth.nav_R_body)
    words = ("--mount", "pocket", "--method", method.name, "--truth", "truth.tum", "--plots", "none", "--out", "out")
    ran = fg_nav("run", "walk.csv", *words)
    assert ran.code == 0, ran.err
    assert keeps_the_contract(Path("out"), recording, method)


@pytest.mark.parametrize("ending", ["csv.gz", "parquet"])
def test_a_walk_in_another_kind_of_file_is_the_same_walk(fg_nav: FgNav, demo: Recording, ending: str) -> None:
    if ending == "parquet":
        pytest.importorskip("pyarrow", reason="Parquet needs pyarrow")
    write_canonical(demo.slice(0, 4000), Path("walk.csv"))
    assert fg_nav("convert", "walk.csv", f"walk.{ending}").code == 0
    for end in ("csv", ending):
        assert fg_nav("run", f"walk.{end}", "--method", "iez", "--plots", "none", "--out", end).code == 0
    np.testing.assert_allclose(*(np.loadtxt(Path(end, "trajectory.tum")) for end in ("csv", ending)), atol=1e-6)


def test_a_run_says_its_verdict_figures_and_place(fg_nav: FgNav, files: Path, demo: Recording) -> None:
    truth = ("--truth", files / "truth.tum")
    ran = fg_nav("run", files / "walk.csv", "--method", "iez", *truth, "--out", "deep/out", "--strict")
    assert (ran.code, ran.err) == (0, "")
    said = summary(Path("deep/out"))
    assert said["rmse_2d_m"] < 0.5
    assert said["heading_rmse_deg"] < 3
    assert 60 < said["distance_m"] < 85
    for words in (f"{said['rmse_2d_m']:.3f} m rms", f"{said['closure_m']:.3f} m from", "report: deep/out/report.html"):
        assert words in ran.out
    assert len(ran.out.splitlines()) == 5
    assert (said["verdict"], said["reasons"], ran.out.splitlines()[0]) == ("trusted", [], "verdict: trusted")
    # without a folder into a fresh one
    for _ in range(2):
        quiet = fg_nav("run", files / "walk.csv", "--method", "iez", "--quiet")
        assert (quiet.code, quiet.out, quiet.err) == (0, "", "")
    assert names(Path("results")) == {"walk-iez-1", "walk-iez-2"}
    assert "rmse_2d_m" not in summary(Path("results/walk-iez-2"))


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("walk.csv", "walk"),
        ("monday/walk.csv.gz", "walk"),
        ("results/demo-1/recording.csv", "demo-1"),
        ("monday/Raw Data.csv", "monday"),
        ("monday/data.csv.gz", "monday"),
        ("/recording.csv", "recording"),
    ],
)
def test_a_result_is_named_after_the_walk(file: str, name: str) -> None:
    assert name_walk(Path(file)) == name


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


def test_compare_draws_methods_side_by_side(fg_nav: FgNav, files: Path) -> None:
    truth = ("--truth", files / "truth.tum", "--plots", "all", "--out", "out")
    ran = fg_nav("compare", files / "walk.csv", "--methods", "smoother, iez", *truth)
    assert ran.code == 0, ran.err
    pictures = {"trajectories.png", "errors.png", "stance_statistic.png"}
    shared = {"comparison.csv", "comparison.json", "report.html", *pictures}
    assert names(Path("out")) == shared | {"smoother", "iez"}
    assert names(Path("out/smoother")) == names(Path("out/iez")) == METHOD_FILES | PICTURES
    assert all(word in ran.out for word in ("smoother", "iez", "max error (m)"))
    assert ran.out.splitlines()[-3:-1] == ["verdict (smoother): trusted", "verdict (iez): trusted"]
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
    # both feet, each with its truth
    ran = fg_nav("simulate", "demo", "--seed", "2", "--rate", "100", "--both-feet", "--out", "feet", "--json")
    assert ran.code == 0, ran.err
    assert 0.1 <= json.loads(ran.out)["step_width_m"] <= 0.2
    each = {f"{side}.{kind}" for side in ("left", "right") for kind in ("csv", "truth.tum", "truth.json")}
    assert names(Path("feet")) == each | {"person.tum", "map.png"}
    left, right, person = (np.loadtxt(f"feet/{name}.tum") for name in ("left.truth", "right.truth", "person"))
    np.testing.assert_array_equal(person[:, 0], right[:, 0])
    assert np.linalg.norm((left[0] - right[0])[1:4]) < 0.3
    # a scenario of one's own
    Path("yard.toml").write_text(OWN_WALK)
    assert fg_nav("simulate", "yard.toml").code == 0
    truth = json.loads(Path("results/yard-1/truth.json").read_text())
    assert truth["drawn"]["sensor"]["prior"]["gyr"]["noise_density"] == 2e-4
    assert np.linalg.norm(truth["strides"]["footprint_m"][-1]) < 0.3


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[0, 12], [9, 12]", "[0, 12], [0, 12]", ["yard.toml"]),
        ("[[0, 0], [0, 12], [9, 12], [9, 0], [0, 0]]", "[[0, 0]]", ["point"]),
        ("2e-4", "-2e-4", ["noise_density"]),
        ("noise_density", "noisiness", ["no parameter 'noisiness'"]),
        ('"smooth"', '"swampy"', ["no field 'swampy'"]),
        ("rate_hz = 100.0", 'rate_hz = "fast"', ["sensor.rate_hz", "fast"]),
        ("[course]", "[curse]", ["course"]),
        ("like =", "like", ["no TOML"]),
        ("rest_s = 3.0", "rest_s = -3.0", ["-3"]),
        ("rest_s = 3.0", "strides = 9.0", ["strides", "9.0"]),
        ("[9, 0], [0, 0]]", "[9, 0]]\nlaps = 2", ["laps", "closed"]),
        ('"office"', "[1]", ["like", "[1]"]),
        ('field = "smooth"', "magnets = [[1, 2]]", ["magnets"]),
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
        ("nowhere", "no scenario 'nowhere'"),
        ("nowhere.toml", "nowhere.toml"),
        ("demo --sensor sextant", "no sensor 'sextant'"),
        ("demo --field swampy", "no field 'swampy'"),
        ("demo --site atlantis", "no site"),
        ("demo --rate -5", "rate_hz"),
        ("demo --turn inf", "turned"),
        ("demo --worn pocket --both-feet", "'pocket' has none opposite"),
    ],
)
def test_simulate_refuses_what_cannot_be(fg_nav: FgNav, arguments: str, words: str) -> None:
    assert fg_nav("simulate", *arguments.split(), "--out", "out").refused(words)
    assert not Path("out").exists()


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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("run WALK --method magic", "no method 'magic'"),
        ("compare WALK --methods iez,,smoother", "no method ''"),
        ("run WALK --format magic", "magic"),
        ("run WALK --truth nowhere.tum", "nowhere.tum"),
        ("run WALK --method iez --truth late.tum", "share no time"),
        ("run WALK --out taken", "taken is a file"),
        ("run WALK --force", "--out"),
        ("run .", "fg-nav: "),
        ("run TRUTH", "truth.tum"),
        ("run WALK --method iez --preset magic", "no preset 'magic'"),
        ("run WALK --method aiez --no-mag", "aiez needs a magnetometer"),
        ("run WALK --gate magic", "no gate 'magic'"),
        ("run WALK --mag-axes=x,y", "'x,y' names no axes"),
    ],
)
def test_bad_choices_are_refused(fg_nav: FgNav, files: Path, demo: Recording, words: str, said: str) -> None:
    Path("taken").write_text("mine")
    truth = demo.truth
    assert isinstance(truth, TrajectoryTruth)
    write_tum("late.tum", truth.t + 1000, truth.position, np.broadcast_to(np.eye(3), (len(truth.t), 3, 3)))
    named = {"WALK": files / "walk.csv", "TRUTH": files / "truth.tum"}
    assert fg_nav(*(named.get(word, word) for word in words.split())).refused(said)
    assert names(Path()) == {"taken", "late.tum"}


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


@pytest.mark.parametrize("arguments", [["run", "--out", "out"], ["compare"]], ids=" ".join)
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
    Path("short.csv").write_text("\n".join((files / "walk.csv").read_text().splitlines()[:6]))
    ran = fg_nav("inspect", "short.csv")
    assert ran.code == 1
    assert "not to be used: it cannot be navigated with" in ran.out
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
    (tmp_path / "Zürich.csv").write_bytes(walk.read_bytes())
    ran = in_a_process("inspect", tmp_path / "Zürich.csv", PYTHONIOENCODING="ascii")
    assert (ran.code, ran.err) == (0, "")
    assert "Z\\xfcrich.csv" in ran.out


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_load_no_heavy_library(option: str) -> None:
    ran = in_a_process(option, python=("-X", "importtime"))
    assert ran.code == 0
    assert ran.out.strip()
    assert not any(name in ran.err for name in ("matplotlib", "gtsam", "numba", "scipy"))


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
