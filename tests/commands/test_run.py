"""The command line from end to end, on the demonstration walk."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav import pipeline
from fg_nav.commands.shared import name_walk
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
    for words in (f"{said['rmse_2d_m']:.3f} m rms", f"{said['closure_m']:.3f} m from", "report: deep/out/report.html"):
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
    assert found["verdict"][0] == "trusted: it can be navigated with."
    assert found["stamps"]["rate_hz"] == pytest.approx(200.0, abs=0.1)
    assert found["field"]["strength_uT"] > 0
    Path("short.csv").write_text("\n".join((recorded("walk")).read_text().splitlines()[:6]))
    ran = fg_nav("inspect", "short.csv")
    assert ran.code == 1
    assert "not to be used: it cannot be navigated with" in ran.out
    told = fg_nav("inspect", "short.csv", "--json")
    assert (told.code, json.loads(told.out)["usable"]) == (1, False)
    assert json.loads(told.err)["error"] == json.loads(told.out)["refusal"] == ran.err.removeprefix("fg-nav: ").strip()


def test_a_pipe_that_holds_no_other_letters_gets_plain_text(tmp_path: Path) -> None:
    odd = tmp_path / "Zürich.csv"
    odd.write_bytes(recorded("part").read_bytes())
    ran = in_a_process("inspect", odd, cwd=tmp_path, PYTHONIOENCODING="ascii")
    assert (ran.code, ran.err) == (0, "")
    assert not set("\x1b━┃│╭") & set(ran.out)
    assert "Z\\xfcrich.csv" in ran.out
