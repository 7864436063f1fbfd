"""`fg-nav detect`, and the verdicts on the field in the results of every method."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pandas as pd
import pytest
import typer
import typer.core

from fg_nav.cli import app
from fg_nav.errors import DetectionError
from fg_nav.frames import wrap_angle
from fg_nav.io import read, write_canonical, write_tum
from fg_nav.lab.field_survey import SAMPLEWISE, SURVEYED, USUAL, require_field
from fg_nav.lab.sample_field import judge_samples
from fg_nav.lab.simulation import simulate
from fg_nav.lab.verbs.detect import DETECT_FILES
from fg_nav.magnetic.axes import align_magnetometer
from fg_nav.magnetic.detectors import DEFAULT, DETECTORS, apply_gate
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


def test_all_detectors_are_those_and_the_printed(fg_nav: FgNav, files: Path) -> None:
    ran = fg_nav("detect", files / "walk.csv", "--gate", "all", "--out", "out", "--json")
    assert ran.code == 0
    assert json.loads(ran.out) == {"folder": "out", **json.loads(Path("out/detect.json").read_text())}
    said = facts("out")
    assert list(said["detectors"]) == list(SURVEYED) == [*DETECTORS, SAMPLEWISE]
    assert set(SURVEYED) - set(USUAL) == {name for name in DETECTORS if "printed" in name}
    assert said["drawn_in_colour"] == DEFAULT


def swinging(disturbed_s: tuple[float, float] = (8.0, 12.0)) -> Recording:
    """A sensor on a swinging thigh, which never stands; the field grows by a half for a while."""
    rng = np.random.default_rng(4)
    t = np.arange(2000) / 100.0
    angle = 0.5 * np.sin(2 * np.pi * t)
    gyr = np.stack([np.zeros_like(t), np.pi * np.cos(2 * np.pi * t), np.zeros_like(t)], axis=1)
    up = np.stack([-np.sin(angle), np.zeros_like(t), np.cos(angle)], axis=1)
    acc = 9.8 * up + 2.0 * rng.normal(size=(len(t), 3))
    among = (t > disturbed_s[0]) & (t < disturbed_s[1])
    strength = 48.0 * (1.0 + 0.5 * among * np.sin(np.pi * (t - disturbed_s[0]) / np.ptp(disturbed_s)))
    return Recording(t, acc, gyr, -strength[:, None] * up + 0.1 * rng.normal(size=(len(t), 3)))


def test_the_samplewise_detector_alone_needs_no_footfalls(fg_nav: FgNav, monkeypatch: pytest.MonkeyPatch) -> None:
    def none_found(*_: object) -> NoReturn:
        raise DetectionError("the foot never stands: wear it.")

    recording = swinging()
    write_canonical(recording, Path("pocket.csv"))
    monkeypatch.setattr("fg_nav.walk.detect_stances", none_found)
    assert fg_nav("detect", "pocket.csv").refused("never stands")
    ran = fg_nav("detect", "pocket.csv", "--gate", SAMPLEWISE, "--out", "out")
    assert ran.code == 0, ran.err
    assert names(Path("out")) == {"field.png", "detect.json"} <= DETECT_FILES
    in_time = align_magnetometer(recording).recording
    found = facts("out")["sample_detectors"][SAMPLEWISE]
    assert found["share"] == pytest.approx(judge_samples(in_time).quasi_static.sum() / found["judged"])
    assert 0.6 < found["share"] < 0.85  # 4 s of 20 and the second after them are not still
    assert 7.0 < found["longest_s"] < 9.0
    assert f"{100 * found['share']:.1f} %" in ran.out
    assert fg_nav("detect", "pocket.csv", "--gate", SAMPLEWISE, "--out", "out").refused("already holds")


def test_footfalls_that_cannot_be_compared_are_refused(fg_nav: FgNav, files: Path) -> None:
    standing = read(files / "walk.csv").slice(0, 700)  # the first stance lasts for 4.7 s
    write_canonical(standing, Path("standing.csv"))
    assert fg_nav("detect", "standing.csv").refused("footfall", "too few", SAMPLEWISE)
    assert names(Path()) == {"standing.csv"}


def test_a_gate_with_nothing_to_pass_is_a_contradiction(fg_nav: FgNav, files: Path) -> None:
    for command in ("run", "compare", "stream"):
        assert fg_nav(command, files / "walk.csv", "--no-mag", "--gate", "aiez").refused("--no-mag", "--gate")


def test_every_method_without_a_compass_writes_the_same_verdicts(fg_nav: FgNav, files: Path) -> None:
    """Those of the gate, which is the detector of the filter of that name; `detect` shows the physical one."""
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


def test_detect_replaces_its_own_files_only(fg_nav: FgNav, files: Path) -> None:
    arguments = ("detect", files / "walk.csv", "--gate", "qsf")
    assert fg_nav(*arguments).code == 0
    assert names(Path("results")) == {"walk-detect-1"}
    out = ("--out", "results/walk-detect-1")
    assert fg_nav(*arguments, *out).refused("already holds a result", "--force")
    assert fg_nav(*arguments, *out, "--force").code == 0
    assert fg_nav("run", files / "walk.csv", *out, "--force").refused("does not write")
    Path("results/walk-detect-1/notes.txt").write_text("mine")
    assert fg_nav(*arguments, *out, "--force").refused("notes.txt")


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("no-mag.csv", [], ["no magnetometer"]),
        ("slow.csv", [], ["10 Hz"]),
        ("walk.csv", ["--gate", "magic"], ["no gate 'magic'", DEFAULT]),
        ("walk.csv", ["--gate", "qsf,,aiez"], ["no gate ''"]),
        ("walk.csv", ["--place", "nowhere"], ["nowhere"]),
        ("walk.csv", ["--heading", "nan"], ["nan"]),
        ("walk.csv", ["--gate", SAMPLEWISE, "--truth", "truth.tum"], ["--truth", "no map"]),
        ("no-mag.csv", ["--gate", SAMPLEWISE], ["no magnetometer"]),
        ("walk.csv", ["--truth", "nowhere.tum"], ["nowhere.tum"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else value,
)
def test_what_cannot_be_looked_at_is_refused_in_one_line(
    fg_nav: FgNav, files: Path, name: str, arguments: list[str], words: list[str]
) -> None:
    assert fg_nav("detect", files / name, *arguments, "--out", "out").refused(*words)
    assert not names(Path())


def test_a_filter_with_a_detector_of_its_own_takes_no_gate(fg_nav: FgNav, files: Path) -> None:
    walk = files / "walk.csv"
    assert fg_nav("run", walk, "--method", "qsf-rts", "--gate", "aiez").refused("qsf-rts", "makes no use of --gate")
    assert fg_nav("compare", walk, "--methods", "qsf,aiez", "--gate", "aiez").refused("qsf makes no use of --gate")
    assert fg_nav("run", walk, "--method", "smoother", "--polish").refused("--polish", "or choose online")
    assert not names(Path())


@pytest.mark.parametrize("gate", ["aiez", "none"])
def test_the_gate_is_one_in_the_graph_and_in_all_files(fg_nav: FgNav, files: Path, gate: str) -> None:
    """What passes is what has a magnetic heading in the graph, in batch and while the walk goes on."""
    for method in ("smoother", "online"):
        ran = fg_nav("run", files / "half.csv", "--method", method, "--gate", gate, "--plots", "none", "--out", method)
        assert ran.code == 0, ran.err
        words = list(table(method, "strides.csv")["field"])
        config = facts(method, "config.json")
        assert config["parameters"]["magnetic"]["gate"] == config["gate"]["name"] == gate
        assert config["gate"]["quasi_static"] == words.count("quasi-static")
        assert config["gate"]["judged"] == len(words) - words.count("none")
        assert (gate == "none") == ("disturbed" not in words)
        assert words.count("quasi-static") > 0


def test_run_refuses_a_gate_that_there_is_not(fg_nav: FgNav, files: Path) -> None:
    for command in ("run", "compare", "stream"):
        assert fg_nav(command, files / "walk.csv", "--gate", "magic").refused("no gate 'magic'", DEFAULT)
    assert not names(Path())


@pytest.mark.parametrize("command", ["run", "compare", "stream"])
def test_the_help_names_the_default_gate(command: str) -> None:
    commands = typer.main.get_command(app)
    assert isinstance(commands, typer.core.TyperGroup)
    options = commands.commands[command].params
    (words,) = [str(getattr(option, "help", "")) for option in options if option.name == "gate"]
    assert f"[default: {DEFAULT}]" in words


@pytest.mark.parametrize("method", ["smoother", "online", "inertial"])
def test_the_summary_counts_the_factors_of_the_graph(fg_nav: FgNav, files: Path, method: str) -> None:
    """Headings and those gated out are all footfalls with a field; nothing magnetic is in a graph without one."""
    ran = fg_nav("run", files / "half.csv", "--method", method, "--gate", "aiez:hard", "--heading", "0", "--out", "out")
    assert ran.code == 0, ran.err
    graph, words = facts("out", "summary.json")["graph"], table("out", "strides.csv")["field"]
    assert list(graph) == list(KINDS)
    assert graph["imu"] == graph["zero_velocity"] - 1 > len(words)
    if method == "inertial":
        assert set(graph.values()) == {0, graph["imu"], graph["zero_velocity"]}
        return
    counted = graph["magnetic_heading"], graph["magnetic_heading"] + graph["gated_out"]
    rows = (words == "quasi-static").sum(), len(words)
    # while a walk goes on, each piece of a long standing is a footfall of the graph, and one row
    assert counted == rows if method == "smoother" else np.greater_equal(counted, rows).all()
    assert f"{graph['imu']} imu" in Path("out/report.html").read_text()
