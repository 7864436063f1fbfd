"""`fg-nav detect`, and the verdicts on the field in the results of every method."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from fg_nav.frames import wrap_angle
from fg_nav.io import write_canonical, write_tum
from fg_nav.lab.field_survey import SAMPLEWISE, SURVEYED, USUAL, require_field
from fg_nav.lab.simulation import simulate
from fg_nav.lab.verbs.detect import DETECT_FILES
from fg_nav.magnetic.detectors import DEFAULT, apply_gate
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.smoother.graph import KINDS
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import read_walk
from tests.command_line import FgNav, names


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with `walk.csv`, its 30 s `half.csv`, `truth.tum`, `no-mag.csv`, and `slow.csv` with a field at 1 Hz."""
    folder = tmp_path_factory.mktemp("recordings")
    recording = simulate("demo", 5).recording
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    write_canonical(recording, folder / "walk.csv")
    write_canonical(recording.slice(0, 6000), folder / "half.csv")
    write_canonical(replace(recording, mag=None), folder / "no-mag.csv")
    write_canonical(slow(recording), folder / "slow.csv")
    write_tum(folder / "truth.tum", truth.t, truth.position, truth.nav_R_body)
    return folder


def slow(recording: Recording) -> Recording:
    """Of the magnetometer only one sample a second."""
    assert recording.mag is not None
    mag = np.full_like(recording.mag, np.nan)
    kept = np.arange(0, len(recording), round(1.0 / recording.period_s))
    mag[kept] = recording.mag[kept]
    return replace(recording, mag=mag)


def table(folder: str, name: str = "field.csv") -> pd.DataFrame:
    return pd.read_csv(Path(folder) / name, keep_default_na=False, na_values=[""])


def facts(folder: str, name: str = "detect.json") -> dict[str, Any]:
    content = json.loads((Path(folder) / name).read_text())
    assert isinstance(content, dict)
    return content


def test_detect_writes_figures_pictures_and_a_table(fg_nav: FgNav, files: Path) -> None:
    ran = fg_nav("detect", files / "walk.csv", "--truth", files / "truth.tum", "--out", "out")
    assert ran.code == 0, ran.err
    assert ran.err == ""
    assert names(Path("out")) == DETECT_FILES
    found, said = table("out"), facts("out")
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
    ran = fg_nav("detect", files / "walk.csv", "--gate", "all", "--out", "all", "--json")
    assert json.loads(ran.out) == {"folder": "all", **facts("all")}
    assert list(facts("all")["detectors"]) == list(SURVEYED)
    # it replaces its own files only
    again = ("detect", files / "walk.csv", "--gate", "qsf", "--out", "out")
    assert fg_nav(*again).refused("already holds a result", "--force")
    assert fg_nav(*again, "--force").code == 0
    assert fg_nav("run", files / "walk.csv", "--out", "out", "--force").refused("does not write")


def test_every_method_without_a_compass_writes_the_same_verdicts(fg_nav: FgNav, files: Path) -> None:
    verdicts = np.array(apply_gate(require_field(prepare_walk(read_walk(files / "walk.csv"))), "aiez").words)
    ran = fg_nav("compare", files / "walk.csv", "--methods", "inertial,iez", "--gate", "aiez", "--out", "out")
    assert ran.code == 0, ran.err
    assert {"none", "disturbed", "quasi-static"} == set(verdicts)
    for method in ("inertial", "iez"):
        strides = table(f"out/{method}", "strides.csv")
        assert list(strides["field"]) == list(verdicts)
        judged = strides["field"] != "none"
        assert strides["field_reason"][judged].str.contains("threshold").all()
        config = facts(f"out/{method}", "config.json")["gate"]
        assert config["name"] == "aiez"
        assert config["quasi_static"] == (verdicts == "quasi-static").sum()
        assert config["parameters"]["channels"]


def test_heading_turns_the_gyroscope_and_place_the_compass(fg_nav: FgNav, files: Path) -> None:
    pytest.importorskip("pygeomag", reason="the extra wmm is not installed")
    walk = files / "walk.csv"
    assert fg_nav("detect", walk, "--gate", "qsf", "--out", "plain").code == 0
    assert fg_nav("detect", walk, "--gate", "qsf", "--heading", "30", "--out", "turned").code == 0
    where = ("--place", "64.1,-21.9,2025-06-01")  # Reykjavik: about 11 deg west
    assert fg_nav("detect", walk, "--gate", "qsf", *where, "--out", "there").code == 0
    plain, turned, there = (table(name) for name in ("plain", "turned", "there"))
    for column, change, other in (("gyro_heading_deg", 30.0, turned), ("compass_heading_deg", -11.0, there)):
        by = np.degrees(wrap_angle(np.radians(other[column] - plain[column])))
        np.testing.assert_allclose(by, change, atol=1.0)
    pd.testing.assert_series_equal(plain["qsf_statistic"], turned["qsf_statistic"])
    pd.testing.assert_series_equal(plain["qsf_statistic"], there["qsf_statistic"])


@pytest.mark.parametrize(
    ("name", "arguments", "reason"),
    [
        ("walk.csv", ["--no-mag"], "left out"),
        ("no-mag.csv", [], "no magnetometer"),
        ("slow.csv", [], "samples of the field"),
    ],
    ids=["left out", "none", "too slow"],
)
def test_a_field_that_cannot_be_judged_fails_no_run(
    fg_nav: FgNav, files: Path, name: str, arguments: list[str], reason: str
) -> None:
    ran = fg_nav("run", files / name, "--method", "iez", *arguments, "--out", "out")
    assert ran.code == 0, ran.err
    strides = table("out", "strides.csv")
    assert set(strides["field"]) == {"none"}
    assert strides["field_reason"].str.contains(reason).all()
    assert facts("out", "config.json")["gate"] is None
    assert ("<li>the field was not judged" in Path("out/report.html").read_text()) == (name == "slow.csv")


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("no-mag.csv", [], ["no magnetometer"]),
        ("slow.csv", [], ["10 Hz"]),
        ("walk.csv", ["--gate", "magic"], ["no gate 'magic'", DEFAULT]),
        ("walk.csv", ["--place", "nowhere"], ["nowhere"]),
        ("walk.csv", ["--heading", "nan"], ["nan"]),
        ("walk.csv", ["--gate", SAMPLEWISE, "--truth", "truth.tum"], ["--truth", "no map"]),
        ("walk.csv", ["--truth", "nowhere.tum"], ["nowhere.tum"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else value,
)
def test_what_cannot_be_looked_at_is_refused_in_one_line(
    fg_nav: FgNav, files: Path, name: str, arguments: list[str], words: list[str]
) -> None:
    assert fg_nav("detect", files / name, *arguments, "--out", "out").refused(*words)
    assert not names(Path())


@pytest.mark.parametrize(("method", "gate"), [("smoother", "aiez:hard"), ("online", "aiez:hard"), ("online", "none")])
def test_what_passes_the_gate_is_what_the_graph_has_and_what_all_files_say(
    fg_nav: FgNav, files: Path, method: str, gate: str
) -> None:
    ran = fg_nav("run", files / "half.csv", "--method", method, "--gate", gate, "--heading", "0", "--out", "out")
    assert ran.code == 0, ran.err
    words, config, graph = (
        table("out", "strides.csv")["field"],
        facts("out", "config.json"),
        facts("out", "summary.json")["graph"],
    )
    assert config["parameters"]["magnetic"]["gate"] == config["gate"]["name"] == gate
    assert config["gate"]["quasi_static"] == (words == "quasi-static").sum() > 0
    assert config["gate"]["judged"] == (words != "none").sum()
    assert (gate == "none") == ("disturbed" not in set(words))
    assert list(graph) == list(KINDS)
    assert graph["imu"] == graph["zero_velocity"] - 1 > len(words)
    counted = graph["magnetic_heading"], graph["magnetic_heading"] + graph["gated_out"]
    rows = (words == "quasi-static").sum(), len(words)
    # while a walk goes on, each piece of a long standing is a footfall of the graph, and one row
    assert counted == rows if method == "smoother" else np.greater_equal(counted, rows).all()
    assert f"{graph['imu']} imu" in Path("out/report.html").read_text()
