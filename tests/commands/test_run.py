"""The command line from end to end, on the demonstration walk."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import copy

import numpy as np
import pytest
from pymap3d import enu2geodetic

from fg_nav import pipeline
from fg_nav.commands.shared import name_walk
from fg_nav.io import write_canonical
from fg_nav.report import page
from fg_nav.walk import Walk
from tests.command_line import FgNav, in_a_process, names
from tests.commands.folders import METHOD_FILES, PICTURES, config, read_json, strides, summary
from tests.commands.recordings import recorded, recording, truth_of
from tests.commands.test_refusals import OWN_WALK


def test_a_run_says_its_verdict_figures_and_place(fg_nav: FgNav) -> None:
    truth = ("--truth", truth_of("walk"))
    ran = fg_nav("run", recorded("walk"), "--method", "iez", *truth, "--out", "deep/out", "--strict")
    assert (ran.code, ran.err) == (0, "")
    said = summary("deep/out")
    assert said["rmse_2d_m"] < 0.5
    assert said["heading_rmse_deg"] < 3
    assert 60 < said["distance_m"] < 85
    for words in (f"{said['rmse_2d_m']:.3f} m rms", "end: ", "report: deep/out/report.html"):
        assert words in ran.out
    assert len(ran.out.splitlines()) == 5
    assert (said["verdict"], said["reasons"], ran.out.splitlines()[0]) == ("trusted", [], "verdict: trusted")
    # without a folder into a fresh one
    for _ in range(2):
        quiet = fg_nav("run", recorded("part"), "--method", "iez", "--quiet", "--plots", "none")
        assert (quiet.code, quiet.out, quiet.err) == (0, "", "")
    assert names(Path("results")) == {"part-iez-1", "part-iez-2"}
    assert "rmse_2d_m" not in summary("results/part-iez-2")


def test_a_result_is_named_after_the_walk() -> None:
    for file, name in {
        "walk.csv": "walk",
        "monday/walk.csv.gz": "walk",
        "results/demo-1/recording.csv": "demo-1",
        "monday/Raw Data.csv": "monday",
        "monday/data.csv.gz": "monday",
        "/recording.csv": "recording",
    }.items():
        assert name_walk(Path(file)) == name, file


def test_options_reach_the_method_and_the_record(fg_nav: FgNav) -> None:
    arguments = ("run", recorded("part"), "--method", "iez", "--heading", "90", "--no-mag", "--out", "out", "--json")
    ran = fg_nav(*arguments).succeeded()
    assert json.loads(ran.out) == {"recording": str(recorded("part")), "folder": "out", **summary("out")}
    again = fg_nav(*arguments)
    assert (again.code, again.out) == (1, "")
    assert json.loads(again.err)["error"].startswith("out already holds a result")
    with subprocess.Popen([sys.executable, "-m", "fg_nav", "run", recorded("walk"), "--out", "ended"]) as ended:
        while ended.poll() is None and not Path("ended").exists():
            time.sleep(0.01)
        ended.terminate()
    assert (ended.returncode, Path("ended").exists()) == (143, False)
    first, last = (strides("out").iloc[k] for k in (0, 8))
    assert first["heading_deg"] == pytest.approx(90.0, abs=0.5)
    assert last["x_m"] - first["x_m"] > 5  # the walk starts straight ahead: now east
    assert abs(last["y_m"] - first["y_m"]) < 1
    assert (config("out")["heading_deg"], config("out")["use_magnetometer"]) == (90.0, False)


def test_compare_draws_methods_side_by_side(fg_nav: FgNav) -> None:
    truth = ("--truth", truth_of("walk"), "--plots", "all", "--out", "out")
    ran = fg_nav("compare", recorded("walk"), "--methods", "smoother, iez", *truth)
    assert ran.code == 0, ran.err
    pictures = {"trajectories.png", "errors.png", "stance_statistic.png"}
    shared = {"comparison.csv", "comparison.json", "report.html", *pictures}
    means = [summary(f"out/{name}")["gait"]["mean"]["length_m"] for name in ("smoother", "iez")]
    cells = "".join(f"<td>{mean:.2f}\u00a0±\u00a0[0-9.]+</td>" for mean in means)
    assert re.search(f"stride length \\(m\\)</th>{cells}", Path("out/report.html").read_text())
    assert names(Path("out")) == shared | {"smoother", "iez"}
    assert names(Path("out/smoother")) == names(Path("out/iez")) == METHOD_FILES | PICTURES
    assert all(word in ran.out for word in ("smoother", "iez", "max error (m)"))
    assert ran.out.splitlines()[-3:-1] == ["verdict (smoother): trusted", "verdict (iez): trusted"]
    assert fg_nav("compare", recorded("walk"), "--out", "out").refused("--force")
    asked = ("compare", recorded("part"), "--methods", "iez", "--out", "small", "--json", "--plots", "none")
    assert json.loads(fg_nav(*asked).out)["methods"] == json.loads(Path("small/comparison.json").read_text())


def test_demo_can_be_run_again_from_its_files(fg_nav: FgNav, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a shorter walk than its own."""
    monkeypatch.setattr("fg_nav.lab.verbs.simulate.DEMO_SCENARIO", "demo")
    ran = fg_nav("demo", "--out", "demo")
    assert ran.code == 0, ran.err
    assert {"recording.csv", "truth.tum", "comparison.csv", "report.html"} <= names(Path("demo"))
    first = summary("demo/iez")
    words = ("--truth", "demo/truth.tum", "--plots", "none", "--out", "again")
    fg_nav("run", "demo/recording.csv", "--method", "iez", *words).succeeded()
    assert summary("again")["rmse_2d_m"] == pytest.approx(first["rmse_2d_m"], rel=1e-3)  # stamps are to the ns
    assert fg_nav("run", "demo/recording.csv", "--out", "demo", "--force").refused("does not write")


def test_simulate_writes_the_contract(fg_nav: FgNav) -> None:
    ran = fg_nav("simulate", "demo", "--seed", "2", "--out", "walk")
    assert (ran.code, ran.err) == (0, "")
    assert names(Path("walk")) == {"recording.csv", "truth.tum", "truth.json", "map.png"}
    header = Path("walk/recording.csv").read_text().splitlines()[0]
    assert header.startswith("time_s,acc_x_m_s2") and header.endswith("mag_z_uT")  # noqa: PT018
    truth = read_json("walk", "truth.json")
    seconds = np.diff(truth["biases"]["time_s"])
    np.testing.assert_allclose(seconds, 1.0, atol=1e-3)
    assert np.array(truth["biases"]["gyr_rad_s"]).shape == (len(seconds) + 1, 3)
    assert truth["field_model"]["kind"] == "Sum"
    again = fg_nav("run", "walk/recording.csv", "--truth", "walk/truth.tum", "--plots", "none", "--out", "run")
    assert again.code == 0, again.err
    assert summary("run")["rmse_2d_m"] < 1.0
    assert fg_nav("simulate", "demo", "--out", "walk").refused("--force")
    # both feet, each with its truth
    ran = fg_nav(
        "simulate", "demo", "--seed", "2", "--rate", "100", "--both-feet", "--out", "feet", "--json"
    ).succeeded()
    assert 0.1 <= json.loads(ran.out)["step_width_m"] <= 0.2
    each = {f"{side}.{kind}" for side in ("left", "right") for kind in ("csv", "truth.tum", "truth.json")}
    assert names(Path("feet")) == each | {"person.tum", "map.png"}
    left, right, person = (np.loadtxt(f"feet/{name}.tum") for name in ("left.truth", "right.truth", "person"))
    np.testing.assert_array_equal(person[:, 0], right[:, 0])
    assert np.linalg.norm((left[0] - right[0])[1:4]) < 0.3
    # a scenario of one's own
    Path("yard.toml").write_text(OWN_WALK)
    fg_nav("simulate", "yard.toml").succeeded()
    truth = read_json("results/yard-1", "truth.json")
    assert truth["drawn"]["sensor"]["prior"]["gyr"]["noise_density"] == 2e-4
    assert np.linalg.norm(truth["strides"]["footprint_m"][-1]) < 0.3


def test_truth_of_another_time_in_the_recording_is_left_out() -> None:
    part = recording("part")
    late = replace(part, truth=replace(part.truth, t=part.truth.t + 1000))
    outcome = pipeline.run_method(pipeline.prepare_walk(Walk.of(late)), "iez")
    assert outcome.comparison is None
    assert outcome.metrics.rmse_2d_m is None
    assert any("share no time" in note for note in outcome.metrics.notes)


# --- what goes wrong -------------------------------------------------------------------------------------------------


def failing(error: BaseException) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


def test_bug_exits_with_70_and_its_traceback(fg_nav: FgNav, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "run_method", failing(ZeroDivisionError("a slip")))
    ran = fg_nav("run", recorded("part"))
    assert ran.code == 70
    assert "Traceback" in ran.err
    assert "a slip" in ran.err
    assert ran.err.splitlines()[-1].startswith("fg-nav: this is a bug (ZeroDivisionError)")
    assert names(Path()) == set()


@pytest.mark.parametrize("verb", ["run --method", "compare --methods"])
def test_an_interrupt_or_a_full_disk_leaves_no_result(
    fg_nav: FgNav, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    command, option = verb.split()
    words = (command, recorded("part"), option, "iez", "--out", "out")
    monkeypatch.setattr(page, "write_page", failing(KeyboardInterrupt()))
    ran = fg_nav(*words)
    assert (ran.code, ran.err) == (130, "")
    assert names(Path()) == set()
    monkeypatch.setattr(page, "write_page", failing(OSError(28, "No space left on device")))
    for some in (words, words[:-2]):
        assert fg_nav(*some).refused("cannot be written", "no space left on device")
        assert list(Path().rglob("*.*")) == []
    monkeypatch.setattr("fg_nav.commands.run.read_walk", failing(PermissionError(13, "Permission denied", "walk.csv")))
    assert fg_nav(*words).refused("permission denied", "walk.csv")


def test_strict_fails_on_a_path_that_is_not_to_be_used_and_writes_it(fg_nav: FgNav) -> None:
    for out, strict in {"out0": (), "out1": ("--strict",)}.items():
        ran = fg_nav("run", recorded("thin"), "--method", "iez", "--out", out, *strict)
        assert ran.code == len(strict)
        assert summary(out)["verdict"] == "not to be used"
        assert names(Path(out)) == METHOD_FILES | {"report.html"}
        [verdict] = [line for line in ran.out.splitlines() if line.startswith("verdict: not to be used: ")]
        assert "sample rate of 20 Hz" in verdict
    assert ran.err == "fg-nav: the path is not to be used: see its reasons in out1/summary.json.\n"


# --- what is said ----------------------------------------------------------------------------------------------------


def test_inspect_gives_figures_and_a_verdict(fg_nav: FgNav) -> None:
    ran = fg_nav("inspect", recorded("walk")).succeeded()
    assert "200" in ran.out
    assert "verdict" in ran.out.lower()
    found = json.loads(fg_nav("inspect", recorded("walk"), "--json").out)
    assert (found["usable"], found["refusal"]) == (True, None)
    assert found["verdict"][0] == "usable: `fg-nav run` judges the path."
    assert found["stamps"]["rate_hz"] == pytest.approx(200.0, abs=0.1)
    assert found["field"]["strength_uT"] > 0
    Path("short.csv").write_text("\n".join((recorded("walk")).read_text().splitlines()[:6]))
    ran = fg_nav("inspect", "short.csv")
    assert ran.code == 1
    assert "not to be used: it cannot be navigated with" in ran.out
    told = fg_nav("inspect", "short.csv", "--json")
    assert (told.code, json.loads(told.out)["usable"]) == (1, False)
    assert json.loads(told.err)["error"] == json.loads(told.out)["refusal"] == ran.err.removeprefix("fg-nav: ").strip()


def test_remarks_are_logged_as_they_come_by_level(fg_nav: FgNav) -> None:
    """Plain runs print none of those of the result; a file has them all, and why a run failed, also of a quiet one."""
    run = ("run", recorded("part"), "--method", "inertial", "--plots", "none")
    ran = fg_nav(*run, "-v", "--out", "out")
    notes = summary("out")["notes"]
    assert ran.err.splitlines()[0] == f"{recorded('part')}: 4000 samples of format canonical at 200 Hz"
    assert set(notes) <= set(ran.err.splitlines())
    assert "Gauss-Newton: " not in ran.err
    assert "Gauss-Newton: " in fg_nav(*run, "-vv", "--out", "more").err
    quiet = fg_nav(*run, "--quiet", "--log", "log.txt", "--out", "quiet")
    assert (quiet.code, quiet.out, quiet.err) == (0, "", "")
    assert fg_nav(*run, "--log", "log.txt", "--out", "quiet").refused("already holds a result")
    lines = [line.split(" ", 3)[2:] for line in Path("log.txt").read_text().splitlines()]
    assert {level for level, _ in lines} == {"DEBUG", "INFO", "ERROR"}
    assert set(notes) <= {words.partition(": ")[2] for level, words in lines if level == "INFO"}
    assert lines[-1][1].startswith("fg_nav: quiet already holds a result")
    assert fg_nav(*run, "--log", "no/log.txt").refused("no/log.txt cannot be written", "another --log")


def test_a_truth_beside_a_recording_is_taken_where_it_belongs(fg_nav: FgNav) -> None:
    """`truth.tum` of the only recording, or of one among others that begins and ends with it; `NAME.truth.tum`."""
    run = ("--method", "iez", "--plots", "none", "--out")
    for folder in ("alone", "several", "named", "late"):
        Path(folder).mkdir()
        copy(recorded("part"), Path(folder, "walk.csv"))
    copy(recorded("part"), "several/other.csv")
    for file in ("alone/truth.tum", "several/truth.tum", "named/walk.truth.tum"):
        copy(truth_of("walk"), file)  # of a longer walk
    copy(truth_of("walk", 1000.0), "late/truth.tum")
    for folder, taken in (("alone", True), ("several", False), ("named", True), ("late", False)):
        ran = fg_nav("run", f"{folder}/walk.csv", *run, f"out-{folder}")
        assert (ran.code, "is taken for its truth; --no-truth" in ran.err) == (0, taken), folder
        assert ("rmse_2d_m" in summary(f"out-{folder}")) == taken
        assert ("late/truth.tum, beside the recording, is not used: the truth" in ran.err) == (folder == "late")
    lines = Path("several/truth.tum").read_text().splitlines(keepends=True)
    Path("several/truth.tum").write_text("".join(lines[:4000]))
    assert "is taken" in fg_nav("compare", "several/walk.csv", "--methods", "iez", *run[2:], "fits").err
    assert fg_nav("run", "alone/walk.csv", "--no-truth", *run, "none").err == ""
    assert fg_nav("run", "alone/walk.csv", "--no-truth", "--truth", "alone/truth.tum").refused("contradict")
    again = fg_nav("run", "alone/walk.csv", "--config", "out-alone/config.json", *run[2:], "again")
    assert (again.err, summary("again")["rmse_2d_m"]) == ("", summary("out-alone")["rmse_2d_m"])


def test_fixes_and_what_is_left_out_are_said_first(fg_nav: FgNav) -> None:
    """Fixes in degrees, of which one is wrong, are the origin of a map; a part behind a hole is named."""
    walk = recording("walk")
    t, truth = walk.t, walk.truth.position
    rows = [int(np.searchsorted(t, at)) for at in (5.0, 15.0, 25.0, 35.0)]
    place = truth[rows] + [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    degrees = np.stack(enu2geodetic(*place.T, 48.0, 11.0, 500.0), axis=1)
    lines = [f"{t[row]},{north:.9f},{east:.9f},0.3" for row, (north, east, _) in zip(rows, degrees, strict=True)]
    Path("fixes.csv").write_text("\n".join(["time_s,latitude_deg,longitude_deg,sigma_m", *lines]))
    write_canonical(replace(walk, truth=None).take((t < 40.0) | (t > 60.0)), Path("walk.csv"))
    ran = fg_nav("run", "walk.csv", "--fixes", "fixes.csv", "--method", "inertial", "--plots", "none", "--out", "out")
    assert ran.code == 0, ran.err
    said = ran.out.splitlines()
    assert said[1].startswith("note: only rows 2 to ")
    assert said[1].endswith("before row 8002")
    fixes = summary("out")["fixes"]
    assert said[4] == f"fixes: 4, {fixes['rms_m']:.2f} m rms off over ground, 1 beyond 3 sigma"
    assert summary("out")["origin"] == [*(pytest.approx(one, abs=1e-8) for one in degrees[0, :2]), None]
    assert any("of the first fix, at 48.0" in note for note in summary("out")["notes"])
    assert fg_nav("run", "walk.csv", "--fixes", "fixes.csv", "--out", "page").code == 0
    page = Path("page/report.html").read_text()
    assert "North is true, by the fixes." in page
    assert "covariance, which includes the uncertainty of the start and of north" in page
    assert "Only rows 2 to" in fg_nav("inspect", "walk.csv").out
    ran = fg_nav("export", "out", "walk.geojson", "--json")
    assert "north is true" in json.loads(ran.out)["remarks"][0]
    drawn = [one["geometry"] for one in json.loads(Path("walk.geojson").read_text())["features"]]
    line = np.array(next(one["coordinates"] for one in drawn if one["type"] == "LineString"))[:, :2]
    assert np.abs(line - degrees[2, [1, 0]]).max(axis=1).min() < 2e-5  # it comes by the third one, to a metre
    for verb in ("stream --speed max", "run --method online"):
        assert fg_nav(*verb.split(), "walk.csv", "--fixes", "fixes.csv").refused("m from there")


def test_a_pocket_is_inspected_and_its_methods_compared(fg_nav: FgNav) -> None:
    ran = fg_nav("inspect", recorded("pocket"))
    assert "usable, as that of a trouser pocket (--mount pocket): `fg-nav run` judges the path." in ran.out
    ran = fg_nav("inspect", recorded("pocket"), "--mount", "foot", "--json")
    assert json.loads(ran.out)["refusal"].startswith("the sensor was")
    assert fg_nav("compare", recorded("pocket")).refused("the sensor was in a trouser pocket", "--mount pocket")
    ran = fg_nav("run", recorded("pocket"), "--mount", "pocket", "--step-constant", 0.8, "--plots", "none")
    assert "step constant 0.8 m (given), sigma 0.0" in ran.out
    ran = fg_nav("compare", recorded("pocket"), "--mount", "pocket", "--plots", "none", "--out", "out", "--json")
    assert [one["method"] for one in json.loads(ran.out)["methods"]] == ["pocket", "munoz-diaz2017"]
    assert config("out/pocket")["given"]["mount"] == "pocket"


def test_help_keeps_what_is_seldom_needed_until_it_is_asked_for(fg_nav: FgNav) -> None:
    for verb, seldom in (
        ((), ("lab",)),
        (("run",), ("--preset", "matched")),
        (("compare",), ("--preset",)),
    ):
        plain, full = in_a_process(*verb, "--help"), in_a_process(*verb, "--help-all")
        assert plain.code == full.code == 0
        assert "--help-all" in plain.out
        for word in seldom:
            assert re.search(rf"\W{word}\W", full.out), word
            assert not re.search(rf"\W{word}\W", plain.out), word
    assert all(re.search(rf"\W{verb}\W", in_a_process("--help").out) for verb in ("detect", "simulate"))
    assert "feet" not in in_a_process("compare", "--help").out
    preset = ("--method", "iez", "--preset", "magic")  # is there all the same
    assert fg_nav("run", "a.csv", *preset).refused("no preset 'magic'")


def test_a_pipe_that_holds_no_other_letters_gets_plain_text(tmp_path: Path) -> None:
    odd = tmp_path / "Zürich.csv"
    odd.write_bytes(recorded("part").read_bytes())
    ran = in_a_process("inspect", odd, cwd=tmp_path, PYTHONIOENCODING="ascii")
    assert (ran.code, ran.err) == (0, "")
    assert not set("\x1b━┃│╭") & set(ran.out)
    assert "Z\\xfcrich.csv" in ran.out
