"""`fg-nav calibrate` and `detect`: runs with a calibration, the verdicts on the field of every method, and noise."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.calibration.of_recording import (
    Calibration,
    CalibrationResult,
    Effect,
    read_calibration,
    write_calibration,
)
from fg_nav.commands.calibrate import print_calibration
from fg_nav.commands.requests import StreamRequest
from fg_nav.commands.stream import read_stream_options
from fg_nav.frames import wrap_angle
from fg_nav.io import write_canonical
from fg_nav.lab.field_survey import SURVEYED, USUAL, require_field
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.lab.verbs.detect import DETECT_FILES
from fg_nav.magnetic import average_footfall_field
from fg_nav.magnetic.axes import MagAxes
from fg_nav.magnetic.detectors import DEFAULT, apply_gate
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.smoother.graph import KINDS
from fg_nav.walk import read_walk
from tests.command_line import FgNav, names
from tests.commands.folders import config, read_json, strides, summary
from tests.commands.recordings import AXES, OFF_DEG_S, recorded, recording, truth_of
from tests.magnetic.turning_walks import EARTH, HARD_IRON, SOFT_IRON

IEZ = ("--method", "iez", "--plots")


@pytest.fixture
def loop_calibration(fg_nav: FgNav) -> Path:
    """That of the loop, made once."""
    path = recorded("loop").with_name("cal.json")
    if not path.exists():
        fg_nav("calibrate", recorded("loop"), "--out", path).succeeded()
    return path


def spread_deg(difference: np.ndarray) -> float:
    resultant = np.abs(np.exp(1j * difference).mean())
    return float(np.degrees(np.sqrt(-2 * np.log(resultant))))


@pytest.mark.parametrize("arguments", [(), ("--method", "levelled")], ids=["walk", "levelled"])
def test_a_calibration_from_a_loop_brings_the_compass_to_the_gyroscope(
    fg_nav: FgNav, arguments: tuple[str, ...]
) -> None:
    ran = fg_nav("calibrate", recorded("loop"), "--out", "deep/cal.json", *arguments)
    assert (ran.code, ran.err) == (0, "")
    assert names(Path("deep")) == {"cal.json"}
    for words in ("hard iron x (uT)", "gyro bias z (deg/s)", "before", "notes", "--calibration deep/cal.json"):
        assert words in ran.out
    assert ("as given" in ran.out) == bool(arguments)
    assert "acc scale" not in ran.out  # a loop cannot tell it from a bias
    assert read_calibration(Path("deep/cal.json")).recording == "loop.csv"
    ran = fg_nav(
        "detect", recorded("loop"), "--gate", "qsf", "--out", "cal", "--calibration", "deep/cal.json"
    ).succeeded()
    walk = prepare_walk(read_walk(recorded("loop")))
    assert walk.sensed is not None  # without a file the walk corrects itself
    raw = average_footfall_field(walk.sensed, walk.stances).heading_difference
    corrected_deg = spread_deg(np.radians(strides("cal", "field.csv")["difference_deg"].to_numpy()))
    assert corrected_deg < min(3.0, 0.5 * spread_deg(raw))
    assert "corrected by the calibration: magnetometer" in ran.out
    assert "by the walk itself" not in ran.out


@pytest.mark.parametrize("after_deg", [3.0, 9.0])
def test_a_calibration_that_makes_the_compass_worse_is_not_recommended(
    after_deg: float, capsys: pytest.CaptureFixture[str]
) -> None:
    found = CalibrationResult(Calibration(), "walk", effect=Effect(1.0, 1.1, 8.0, after_deg))
    print_calibration(found, Path("cal.json"))
    printed = capsys.readouterr().out
    assert ("to use it" in printed, "caution" in printed) == (after_deg < 8.0, after_deg > 8.0)


@pytest.mark.parametrize("method", ["ellipsoid", "sphere"])
def test_a_sensor_turned_over_is_calibrated_and_a_known_strength_gives_the_scale(fg_nav: FgNav, method: str) -> None:
    chosen = () if method == "ellipsoid" else ("--method", method)
    ran = fg_nav("calibrate", recorded("tumbled"), "--out", "plain.json", *chosen).succeeded()
    assert "turned over in all directions" in ran.out or chosen
    found, strength = read_calibration(Path("plain.json")).magnetometer, float(np.linalg.norm(EARTH))
    assert np.abs((found.hard_iron_uT - HARD_IRON) / found.sigma[:3]).max() < 5
    assert found.sigma[:3].max() < 0.1
    assert np.linalg.det(found.correction) == pytest.approx(1.0, abs=1e-6)  # the size of the readings is left
    assert found.strength_uT == pytest.approx(strength * np.cbrt(np.linalg.det(SOFT_IRON)), abs=0.2)
    told = ("--method", method, "--strength", strength, "--json")
    ran = fg_nav("calibrate", recorded("tumbled"), "--out", "cal.json", *told)
    assert json.loads(ran.out)["calibration"] == json.loads(Path("cal.json").read_text())
    found = read_calibration(Path("cal.json")).magnetometer
    corrected = found.correct(recording("tumbled").mag)
    assert np.linalg.norm(corrected, axis=1).mean() == pytest.approx(strength, abs=0.1)
    assert np.linalg.inv(found.correction) == pytest.approx(SOFT_IRON, abs=0.01)


def test_run_and_compare_tell_what_was_corrected(fg_nav: FgNav, loop_calibration: Path) -> None:
    told = (*IEZ, "html", "--calibration", loop_calibration)
    fg_nav("run", recorded("loop"), *told, "--out", "out").succeeded()
    assert "corrected by the calibration: magnetometer (walk)" in Path("out/report.html").read_text()
    said, known = config("out")["calibration"], read_calibration(loop_calibration).magnetometer
    assert (said["file"], said["made_from"]) == (str(loop_calibration), "loop.csv")
    assert said["corrected"] == ["magnetometer (walk)"]
    assert said["hard_iron_uT"] == known.hard_iron_uT.tolist()
    assert said["correction"] == known.correction.tolist()
    fg_nav("run", recorded("loop"), *IEZ, "html", "--out", "plain").succeeded()
    assert "corrected by the calibration" not in Path("plain/report.html").read_text()
    assert config("plain")["calibration"] is None
    bias, plain_bias = (strides(out).filter(like="gyro_bias") for out in ("out", "plain"))
    pd.testing.assert_frame_equal(bias, plain_bias)  # of a calibration the gyroscope's bias is not taken off
    both = ("--methods", "iez", "--plots", "none", "--calibration", loop_calibration, "--out", "both")
    fg_nav("compare", recorded("loop"), *both).succeeded()
    assert config("both/iez")["calibration"]["corrected"] == ["magnetometer (walk)"]
    # without the magnetometer its calibration is left out
    fg_nav("run", recorded("loop"), *told, "--no-mag", "--out", "bare").succeeded()
    assert config("bare")["calibration"]["corrected"] == []
    assert "corrected by the calibration: nothing" in Path("bare/report.html").read_text()
    assert fg_nav("run", recorded("loop-bare"), *told, "--out", "none").refused("no magnetometer")


def test_an_accelerometer_is_corrected_where_scale_and_bias_are_known(fg_nav: FgNav, loop_calibration: Path) -> None:
    known = read_calibration(loop_calibration)
    assert not known.accelerometer.separable
    accelerometer = replace(known.accelerometer, scale=1.02, bias=np.zeros(3), separable=True)
    write_calibration(Path("scaled.json"), replace(known, accelerometer=accelerometer))
    for name, file in {"cal": loop_calibration, "scaled": "scaled.json"}.items():
        fg_nav("run", recorded("loop"), *IEZ, "none", "--calibration", file, "--out", name).succeeded()
    assert config("scaled")["calibration"]["corrected"][1] == "accelerometer"
    assert summary("cal")["distance_m"] / summary("scaled")["distance_m"] == pytest.approx(1.02, abs=0.01)


def test_a_still_sensor_shows_the_bias_that_a_walk_begins_with(fg_nav: FgNav) -> None:
    ran = fg_nav("calibrate", recorded("still"), "--out", "cal.json").succeeded()
    assert "without the magnetometer" in ran.out
    known = read_calibration(Path("cal.json"))
    assert known.magnetometer is None
    prior = known.gyroscope.prior
    shown = [line.split()[-2:] for line in ran.out.splitlines() if "gyro bias" in line]
    expected = np.degrees([known.gyroscope.bias, known.gyroscope.sigma]).T
    np.testing.assert_allclose(np.array(shown, dtype=float), expected, atol=6e-4)
    assert fg_nav("calibrate", recorded("still"), "--out", "mag.json", "--method", "walk").code == 1
    given = [f"smoother.{name}={json.dumps(value)}" for name, value in prior.items()]
    for method in ("inertial", "online"):
        told = ("run", recorded("a"), "--method", method, "--plots", "none")
        fg_nav(*told, "--calibration", "cal.json", "--out", method).succeeded()
        fg_nav(*told, *(word for one in given for word in ("--set", one)), "--out", f"{method}-set").succeeded()
        pd.testing.assert_frame_equal(strides(method), strides(f"{method}-set"))  # the samples stay as they are
        assert tuple(config(method)["parameters"]["gyro_bias_deg_s"]) == prior["gyro_bias_deg_s"]
        assert "before the walk, from the calibration" in json.dumps(read_json(method, "summary.json"))
    streamed = read_stream_options(StreamRequest(source=str(recorded("a"))), Path("cal.json")).online
    assert streamed.parameters.gyro_bias_deg_s == prior["gyro_bias_deg_s"]


def test_walks_of_one_sensor_show_its_mean(fg_nav: FgNav) -> None:
    fg_nav("calibrate", *map(recorded, "abc"), "--out", "cal.json").succeeded()
    found = read_calibration(Path("cal.json")).gyroscope
    assert found.recordings == 3
    true = simulate("demo", 3).biases.gyr[0] + np.radians(OFF_DEG_S["a"])
    assert (np.abs(found.bias - true) < 3.0 * found.sigma).all()
    assert np.degrees(found.next_sigma) < 0.1


# --- axes of the magnetometer ----------------------------------------------------------------------------------------


def test_a_run_leaves_it_out_and_says_what_to_give(fg_nav: FgNav) -> None:
    fg_nav("run", recorded("turned"), "--method", "iez", "--plots", "none", "--out", "plain").succeeded()
    said = summary("plain")
    assert "axes" in str(said["magnetometer"])
    assert f"--mag-axes={AXES}" in str(said["notes"])
    assert said["magnetometer_delay"] is None
    fg_nav("run", recorded("turned"), "--method", "iez", f"--mag-axes={AXES}", "--out", "given").succeeded()
    said = summary("given")
    assert "mag-axes" not in str(said["notes"])
    assert "ms late" in str(said["notes"])
    assert said["magnetometer_delay"]["tau_s"] == pytest.approx(0.022, abs=0.001)
    assert config("given")["mag_axes"] == AXES
    forced = ("--mag-axes=x,y,z", "--plots", "none", "--out", "forced")
    fg_nav("run", recorded("turned"), "--method", "iez", *forced).succeeded()
    assert "used all the same" in str(summary("forced")["notes"])


def test_inspect_and_detect_say_it(fg_nav: FgNav) -> None:
    assert f"--mag-axes={AXES}" in "".join(fg_nav("inspect", recorded("turned")).out.split("\n")).replace(" ", "")
    for detectors in ("ma2018", "munoz-diaz"):
        assert fg_nav("detect", recorded("turned"), "--gate", detectors).refused(f"--mag-axes={AXES}")
        fg_nav("detect", recorded("turned"), "--gate", detectors, f"--mag-axes={AXES}").succeeded()


def test_a_calibration_is_of_the_axes_given(fg_nav: FgNav) -> None:
    calibrate = ("calibrate", recorded("turned"), "--out", "c.json", "--method")
    assert fg_nav(*calibrate, "levelled").refused(f"--mag-axes={AXES}")
    ran = fg_nav(*calibrate, "walk", f"--mag-axes={AXES}").succeeded()
    assert f"--mag-axes={AXES}" in ran.out.replace("\n", "")
    write_canonical(MagAxes.parse(AXES).apply_to(recording("turned")), Path("right.csv"))
    fg_nav("calibrate", Path("right.csv"), "--out", "right.json", "--method", "walk").succeeded()
    given, right = (read_calibration(Path(name)).magnetometer for name in ("c.json", "right.json"))
    np.testing.assert_allclose(given.hard_iron_uT, right.hard_iron_uT, atol=1e-3)


@pytest.mark.usefixtures("solved_here")
def test_a_stream_is_turned_row_by_row(fg_nav: FgNav) -> None:
    short = Path("short.csv")
    short.write_text("".join(recorded("turned").read_text().splitlines(keepends=True)[:2400]))
    assert f"--mag-axes={AXES}" in fg_nav("stream", short, "--speed", "max", "--lag", "30").err
    ran = fg_nav("stream", short, "--speed", "max", f"--mag-axes={AXES}", "--out", "out").succeeded()
    assert "mag-axes" not in ran.err
    assert "ms late" in str(summary("out")["notes"])
    assert config("out")["mag_axes"] == AXES


def test_detect_writes_figures_pictures_and_a_table(fg_nav: FgNav) -> None:
    ran = fg_nav("detect", recorded("walk"), "--truth", truth_of("walk"), "--out", "out")
    assert (ran.code, ran.err) == (0, "")
    assert names(Path("out")) == DETECT_FILES
    found, said = strides("out", "field.csv"), read_json("out", "detect.json")
    assert list(said["detectors"]) == list(USUAL)
    assert said["drawn_in_colour"] == DEFAULT
    for name, one in said["detectors"].items():
        assert one["quasi_static"] == (found[f"{name}_verdict"] == "quasi-static").sum()
        assert one["judged"] == found[f"{name}_statistic"].notna().sum()
        assert name in ran.out
    difference = np.radians(found["compass_heading_deg"] - found["gyro_heading_deg"])
    np.testing.assert_allclose(np.degrees(wrap_angle(difference)), found["difference_deg"], atol=1e-6)
    for words in ("longest run", "files: out", "field.png, field_map.png", "note: no calibration"):
        assert words in ran.out
    ran = fg_nav("detect", recorded("half"), "--gate", "all", "--out", "all", "--json")
    told = read_json("all", "detect.json")
    assert json.loads(ran.out) == {"folder": "all", **told}
    assert list(told["detectors"]) == list(SURVEYED)
    # it replaces its own files only
    again = ("detect", recorded("half"), "--gate", "qsf", "--out", "out")
    assert fg_nav(*again).refused("already holds a result", "--force")
    fg_nav(*again, "--force").succeeded()
    assert fg_nav("run", recorded("half"), "--out", "out", "--force").refused("does not write")


def test_every_method_without_a_compass_writes_the_same_verdicts(fg_nav: FgNav) -> None:
    verdicts = np.array(apply_gate(require_field(prepare_walk(read_walk(recorded("walk")))), "aiez").words)
    words = ("--methods", "inertial,iez", "--gate", "aiez", "--plots", "none", "--out", "out")
    fg_nav("compare", recorded("walk"), *words).succeeded()
    assert {"none", "disturbed", "quasi-static"} == set(verdicts)
    for method in ("inertial", "iez"):
        table, gate = strides(f"out/{method}"), config(f"out/{method}")["gate"]
        assert list(table["field"]) == list(verdicts)
        assert table["field_reason"][table["field"] != "none"].str.contains("threshold").all()
        assert gate["name"] == "aiez"
        assert gate["quasi_static"] == (verdicts == "quasi-static").sum()
        assert gate["parameters"]["channels"]


def test_heading_turns_the_gyroscope_and_place_the_compass(fg_nav: FgNav) -> None:
    pytest.importorskip("pygeomag", reason="the extra wmm is not installed")
    where = ("--place", "64.1,-21.9,2025-06-01")  # Reykjavik: about 11 deg west
    for out, more in {"plain": (), "turned": ("--heading", "30"), "there": where}.items():
        fg_nav("detect", recorded("half"), "--gate", "qsf", *more, "--out", out).succeeded()
    plain, turned, there = (strides(name, "field.csv") for name in ("plain", "turned", "there"))
    for column, change, other in (("gyro_heading_deg", 30.0, turned), ("compass_heading_deg", -11.0, there)):
        by = np.degrees(wrap_angle(np.radians(other[column] - plain[column])))
        np.testing.assert_allclose(by, change, atol=1.0)
        pd.testing.assert_series_equal(plain["qsf_statistic"], other["qsf_statistic"])


@pytest.mark.parametrize(
    ("words", "reason"),
    [("part --no-mag", "left out"), ("bare", "no magnetometer"), ("slow", "samples of the field")],
)
def test_a_field_that_cannot_be_judged_fails_no_run(fg_nav: FgNav, words: str, reason: str) -> None:
    name, *more = words.split()
    fg_nav("run", recorded(name), "--method", "iez", *more, "--plots", "html", "--out", "out").succeeded()
    assert set(strides("out")["field"]) == {"none"}
    assert strides("out")["field_reason"].str.contains(reason).all()
    assert config("out")["gate"] is None
    assert ("<li>the field was not judged" in Path("out/report.html").read_text()) == (name == "slow")


@pytest.mark.parametrize(("method", "gate"), [("smoother", "aiez:hard"), ("online", "aiez:hard"), ("online", "none")])
def test_what_passes_the_gate_is_what_the_graph_has_and_what_all_files_say(
    fg_nav: FgNav, method: str, gate: str
) -> None:
    words = ("--method", method, "--gate", gate, "--heading", "0", "--plots", "html", "--out", "out")
    fg_nav("run", recorded("half"), *words).succeeded()
    verdicts, known, graph = strides("out")["field"], config("out"), summary("out")["graph"]
    assert known["parameters"]["magnetic"]["gate"] == known["gate"]["name"] == gate
    assert known["gate"]["quasi_static"] == (verdicts == "quasi-static").sum() > 0
    assert known["gate"]["judged"] == (verdicts != "none").sum()
    assert (gate == "none") == ("disturbed" not in set(verdicts))
    assert list(graph) == list(KINDS)
    assert graph["imu"] == graph["zero_velocity"] - 1 > len(verdicts)
    counted = graph["magnetic_heading"], graph["magnetic_heading"] + graph["gated_out"]
    rows = (verdicts == "quasi-static").sum(), len(verdicts)
    # while a walk goes on, each piece of a long standing is a footfall of the graph, and one row
    assert counted == rows if method == "smoother" else np.greater_equal(counted, rows).all()
    assert f"inertial {graph['imu']}," in Path("out/report.html").read_text()


# --- noise -----------------------------------------------------------------------------------------------------------


def test_table_picture_and_figures(fg_nav):
    scenario = replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(65.0)])
    table = simulate(scenario, 1, Choices(sensor="mpu-9250", rate_hz=200.0))
    write_canonical(table.recording, Path("table.csv"))
    allan = ("lab", "allan", "table.csv", "--out", "noise")
    ran = fg_nav(*allan).succeeded()
    assert fg_nav(*allan).refused("--force")
    found = read_json("noise", "allan.json")
    assert names(Path("noise")) == {"allan.json", "allan.png"}
    assert found["seconds"] == pytest.approx(65.0, abs=1.5)
    gyr, density = found["sensors"]["gyr"], table.scenario.prior.gyr.noise_density
    assert gyr["x"]["N"]["value"] == pytest.approx(density, rel=0.05)
    assert len(gyr["z"]["tau_s"]) == len(gyr["z"]["deviation"]) == len(gyr["z"]["low"])
    assert found["sensors"]["mag"]["rate_hz"] == pytest.approx(100.0, rel=1e-3)
    for words in ("gyroscope, 200 Hz", "deg/s/√Hz", "accelerometer", "magnetometer, 100 Hz", "nT/√Hz", "< "):
        assert words in ran.out
    line = next(line for line in ran.out.splitlines() if line.startswith("x"))
    assert float(line.split()[1]) == pytest.approx(np.degrees(density), rel=0.05)
    # without a magnetometer, and with a dead axis
    acc = table.recording.acc.copy()
    acc[:, 0] = acc[0, 0]
    write_canonical(Recording(table.recording.t, acc, table.recording.gyr), Path("dead.csv"))
    ran = fg_nav("lab", "allan", "dead.csv", "--out", "noise", "--force", "--json")
    found = read_json("noise", "allan.json")
    assert json.loads(ran.out) == {"folder": "noise", **found}
    assert set(found["sensors"]) == {"gyr", "acc"}
    assert found["sensors"]["acc"]["x"]["N"]["seen"] is False
    write_canonical(table.recording.slice(0, 2000), Path("short.csv"))
    assert fg_nav("lab", "allan", "short.csv", "--out", "walk").refused("too short for an Allan deviation")
