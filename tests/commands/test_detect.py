"""`fg-nav detect`, the verdicts on the field in the results of every method, and `fg-nav lab allan`."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.frames import wrap_angle
from fg_nav.io import write_canonical
from fg_nav.lab.field_survey import SURVEYED, USUAL, require_field
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.lab.verbs.detect import DETECT_FILES
from fg_nav.magnetic.detectors import DEFAULT, apply_gate
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.smoother.graph import KINDS
from fg_nav.walk import read_walk
from tests.command_line import FgNav, names
from tests.commands.folders import config, read_json, strides, summary
from tests.commands.recordings import recorded, truth_of


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
    assert fg_nav(*again, "--force").code == 0
    assert fg_nav("run", recorded("half"), "--out", "out", "--force").refused("does not write")


def test_every_method_without_a_compass_writes_the_same_verdicts(fg_nav: FgNav) -> None:
    verdicts = np.array(apply_gate(require_field(prepare_walk(read_walk(recorded("walk")))), "aiez").words)
    words = ("--methods", "inertial,iez", "--gate", "aiez", "--plots", "none", "--out", "out")
    ran = fg_nav("compare", recorded("walk"), *words)
    assert ran.code == 0, ran.err
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
        assert fg_nav("detect", recorded("half"), "--gate", "qsf", *more, "--out", out).code == 0
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
    ran = fg_nav("run", recorded(name), "--method", "iez", *more, "--plots", "html", "--out", "out")
    assert ran.code == 0, ran.err
    assert set(strides("out")["field"]) == {"none"}
    assert strides("out")["field_reason"].str.contains(reason).all()
    assert config("out")["gate"] is None
    assert ("<li>the field was not judged" in Path("out/report.html").read_text()) == (name == "slow")


@pytest.mark.parametrize(("method", "gate"), [("smoother", "aiez:hard"), ("online", "aiez:hard"), ("online", "none")])
def test_what_passes_the_gate_is_what_the_graph_has_and_what_all_files_say(
    fg_nav: FgNav, method: str, gate: str
) -> None:
    words = ("--method", method, "--gate", gate, "--heading", "0", "--plots", "html", "--out", "out")
    ran = fg_nav("run", recorded("half"), *words)
    assert ran.code == 0, ran.err
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
    assert f"{graph['imu']} imu" in Path("out/report.html").read_text()


# --- noise -----------------------------------------------------------------------------------------------------------


def test_table_picture_and_figures(fg_nav):
    scenario = replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(65.0)])
    table = simulate(scenario, 1, Choices(sensor="mpu-9250", rate_hz=200.0))
    write_canonical(table.recording, Path("table.csv"))
    allan = ("lab", "allan", "table.csv", "--out", "noise")
    ran = fg_nav(*allan)
    assert ran.code == 0
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
