"""One contract for all methods, mounts and formats: `run`, `compare` and `stream` of one walk say the same of it."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.estimators import METHODS, Method
from fg_nav.io import read_raw, write_canonical
from fg_nav.recording import RawRecording, Recording
from tests.command_line import FgNav, names
from tests.commands.folders import METHOD_FILES, PICTURES, config, strides, summary
from tests.commands.recordings import recorded, recording, truth_of
from tests.io.samples import tilting, write_sensorconnect, write_table
from tests.online.walks import whole_walk
from tests.smoother.test_fixes import demo, fixes_at

pytestmark = pytest.mark.usefixtures("solved_here")

POLISHED = {"trajectory_polished.tum", "strides_polished.csv"}
NO_PLOTS = ("--plots", "none")


def keeps_the_contract(folder: Path, recording: Recording, method: Method) -> bool:
    """Files of one method on one recording are all there and agree with it, and with each other."""
    online = {"online.csv"} if method.name == "online" else set()
    of_thigh = {"gait.csv"} if method.mount == "pocket" else set()
    assert names(folder) - {"report.html"} - PICTURES == METHOD_FILES - of_thigh | online
    assert ("gait" in summary(folder)) == (not of_thigh)
    said, path = summary(folder), np.loadtxt(folder / "trajectory.tum")
    position = strides(folder)[["x_m", "y_m", "z_m"]].to_numpy()
    assert said["method"] == method.name
    assert said["strides"] == len(position) - 1
    assert said["duration_s"] == pytest.approx(recording.duration_s)
    assert said["realtime_factor"] == pytest.approx(said["duration_s"] / said["runtime_s"])
    assert said["closure_m"] == pytest.approx(np.linalg.norm(position[-1] - position[0]), abs=1e-5)
    assert said["magnetometer"] == ("used" if method.uses_field else "not used")
    assert said["rmse_2d_m"] < (1.0 if method.mount == "foot" else 5.0)
    np.testing.assert_allclose(path[[0, -1], 0], recording.t[[0, -1]], atol=1e-6)
    known = config(folder)
    assert (known["format"], Path(known["recording"]).stem) == (
        "canonical",
        "part" if method.mount == "foot" else "pocket",
    )
    return bool(known["parameters"])


def test_every_method_on_a_foot_keeps_one_contract(fg_nav: FgNav) -> None:
    methods, truth = METHODS["foot"], ("--truth", truth_of("part"), *NO_PLOTS)
    fg_nav("compare", recorded("part"), "--methods", ", ".join(methods), *truth, "--out", "all").succeeded()
    table = pd.read_csv("all/comparison.csv").set_index("method")
    assert list(table.index) == list(methods)
    for name, method in methods.items():
        assert keeps_the_contract(Path("all", name), recording("part"), method), name
        assert table["rmse_2d_m"][name] == pytest.approx(summary(Path("all", name))["rmse_2d_m"])
    assert len({json.dumps(config(Path("all", one))["detector"]) for one in methods}) == 1  # on the same stances
    for name in ("smoother", "online", "iez-rts"):
        fg_nav("run", recorded("part"), "--method", name, *truth, "--out", name).succeeded()
        for file in ("trajectory.tum", "strides.csv"):
            assert Path(name, file).read_text() == Path("all", name, file).read_text()


@pytest.mark.parametrize("method", METHODS["pocket"].values(), ids=lambda method: method.name)
def test_every_method_in_a_pocket_keeps_it_too(fg_nav: FgNav, method: Method) -> None:
    words = ("--mount", "pocket", "--method", method.name, "--truth", truth_of("pocket"), *NO_PLOTS)
    fg_nav("run", recorded("pocket"), *words, "--out", "out").succeeded()
    assert keeps_the_contract(Path("out"), recording("pocket"), method)


def measure_gap(folder: str) -> None:
    """The gap of both paths is that of the summary."""
    path, other = (np.loadtxt(Path(folder, name)) for name in ("trajectory.tum", "trajectory_polished.tum"))
    apart, said = np.linalg.norm(path[:, 1:4] - other[:, 1:4], axis=1), summary(folder)
    assert said["polish_gap_max_m"] == pytest.approx(apart.max(), abs=1e-5)
    assert said["polish_gap_rms_m"] == pytest.approx(np.sqrt((apart**2).mean()), abs=1e-5)
    assert 0.0 < said["polish_gap_heading_deg"] < 0.5
    assert said["polished_distance_m"] == pytest.approx(said["distance_m"], abs=0.1)


def test_stream_and_run_write_the_same_and_polished_what_the_batch_has(fg_nav: FgNav) -> None:
    words, online = (recorded("short"), "--heading", 0), ("--method", "online", *NO_PLOTS)
    fg_nav("run", *words, *online, "--polish", "--out", "run").succeeded()
    fg_nav("stream", *words, "--speed", "max", "--polish", "--out", "stream").succeeded()
    fg_nav("run", *words, *NO_PLOTS, "--out", "batch").succeeded()
    for place in ("run", "stream"):
        assert names(Path(place)) >= {"online.csv", "strides.csv"} | POLISHED
        path = strides(place)
        pd.testing.assert_frame_equal(strides(place, "strides_polished.csv"), strides("batch"), atol=1e-6)
        assert np.allclose(path[["x_m", "y_m", "z_m"]], whole_walk()[0].finish().stances.position, atol=1e-6)
        assert len(strides(place, "online.csv")) == len(path)
        measure_gap(place)


def test_a_stream_in_a_pocket_prints_and_writes_what_a_run_does(fg_nav: FgNav) -> None:
    words = (recorded("pocket"), "--mount", "pocket", "--step-constant", 0.8, "--polish")
    ran = fg_nav("stream", *words, "--speed", "max").succeeded()
    told = [json.loads(line) for line in ran.out.splitlines()]
    rows = {kind: [one for one in told if one["kind"] == kind] for kind in ("now", "smoothed", "polished")}
    assert len(rows["now"]) == len(rows["smoothed"]) > 10
    for one in rows.values():
        assert [line["stance"] for line in one] == list(range(len(one)))
        assert one[0].keys() <= rows["now"][0].keys()
    now, smoothed = rows["now"][-1], rows["smoothed"][-1]
    assert now["heading_deg"] == pytest.approx(smoothed["heading_deg"], abs=2.0)
    fg_nav("stream", *words, "--speed", "max", "--out", "stream").succeeded()
    fg_nav("run", *words, "--method", "online", "--out", "run").succeeded()
    ends = [np.loadtxt(f"{folder}/trajectory.tum")[-1, 1:4] for folder in ("stream", "run")]
    assert np.linalg.norm(ends[0] - ends[1]) < 0.3  # a recording's magnetometer is aligned before
    assert Path("stream/online.csv").exists()


def test_smoother_stream_and_run_go_through_fixes(fg_nav: FgNav) -> None:
    write_canonical(demo().recording.slice(0, 4600), Path("walk.csv"))
    (one,) = fixes_at([12], 30.0, sigma=0.05)
    assert one.time_s < 20.0
    east, north, _ = one.position
    Path("fixes.csv").write_text(f"time_s,x_m,y_m,z_m,sigma_m\n{one.time_s},{east},{north},,0.05\n")
    words = ("walk.csv", "--fixes", "fixes.csv", "--out")
    for name, verb in {
        "smoother": ("run", *words, "smoother", *NO_PLOTS),
        "online": ("run", *words, "online", *NO_PLOTS, "--method", "online"),
        "stream": ("stream", *words, "stream", *NO_PLOTS, "--speed", "max"),
    }.items():
        assert fg_nav(*verb).code == 0, name
        path = np.loadtxt(f"{name}/trajectory.tum")
        at = path[np.argmin(np.abs(path[:, 0] - one.time_s)), 1:3]
        assert np.linalg.norm(at - one.position[:2]) < 0.1, name
    assert config("smoother")["fixes"] == "fixes.csv"


# --- `fg-nav convert` ------------------------------------------------------------------------------------------------


RAW = tilting(np.random.default_rng(31), duration_s=3.0, rate_hz=100.0, still_s=1.0)


def is_equal(one: RawRecording, other: RawRecording) -> bool:
    for name in ("t", "acc", "gyr", "mag"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    return True


@pytest.mark.parametrize("ending", [".csv", ".csv.gz", ".parquet"])
def test_what_is_written_is_read_back_to_the_last_bit(fg_nav: FgNav, ending: str, tmp_path) -> None:
    if ending == ".parquet":
        pytest.importorskip("pyarrow", reason="Parquet needs pyarrow")
    assert RAW.mag is not None
    RAW.mag[5] = np.nan
    write_sensorconnect(RAW, tmp_path / "walk.csv")
    out = tmp_path / "new" / f"out{ending}"
    ran = fg_nav("convert", tmp_path / "walk.csv", out)
    assert (ran.code, ran.err) == (0, "")
    assert "300 samples of format sensorconnect, with the magnetometer" in ran.out
    assert is_equal(read_raw(out), read_raw(tmp_path / "walk.csv"))
    before = out.read_bytes()
    fg_nav("convert", out, tmp_path / "again.csv").succeeded()
    assert is_equal(read_raw(tmp_path / "again.csv"), read_raw(out))
    assert fg_nav("convert", tmp_path / "walk.csv", out).refused("already exists", "--force")
    assert out.read_bytes() == before
    fg_nav("convert", tmp_path / "walk.csv", out, "--force").succeeded()
    assert out.read_bytes() == before
    (tmp_path / f"folder{ending}").mkdir()
    assert fg_nav("convert", out, tmp_path / f"folder{ending}").refused("is a folder")


def test_remarks_are_said_and_a_sensor_without_use_is_written(fg_nav: FgNav, tmp_path) -> None:
    write_canonical(RawRecording(RAW.t, RAW.acc - [0, 0, 9.8], RAW.gyr, RAW.row), tmp_path / "walk.csv")
    ran = fg_nav("convert", tmp_path / "walk.csv", "out.csv", "--json")
    said = json.loads(ran.out)
    assert said["samples"] == 300
    assert "these samples cannot be navigated with" in said["remarks"][0]
    write_table(RAW, tmp_path / "table.csv")
    assert "remark" not in fg_nav("convert", tmp_path / "table.csv", "table.csv").out


def test_columns_and_rate_for_a_file_without_a_header(fg_nav: FgNav, tmp_path) -> None:
    table = np.column_stack([RAW.acc / 9.80665, np.degrees(RAW.gyr)])
    np.savetxt(tmp_path / "walk.txt", table, fmt="%.10g")
    assert fg_nav("inspect", tmp_path / "walk.txt").refused("no header", "--columns")
    columns = ("--columns", "acc=1:2:3[g],gyr=4:5:6[deg/s]")
    assert fg_nav("inspect", tmp_path / "walk.txt", *columns).refused("no stamps", "--rate")
    said = json.loads(fg_nav("inspect", tmp_path / "walk.txt", *columns, "--rate", 100, "--json").out)
    assert said["usable"]
    assert said["stamps"]["rate_hz"] == pytest.approx(100.0)
    fg_nav("convert", tmp_path / "walk.txt", "out.csv", *columns, "--rate", 100).succeeded()
    np.testing.assert_allclose(read_raw("out.csv").gyr, RAW.gyr, atol=1e-9)
