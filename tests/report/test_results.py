"""The files of a result keep to the contract, and say what the solution says."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.estimators import METHODS, Method
from fg_nav.frames import compute_heading
from fg_nav.io import read_truth
from fg_nav.pipeline import run_method
from fg_nav.report.files import write_json, write_run
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Walk
from tests.report import walks

STRIDE_COLUMNS = (
    "index,time_s,x_m,y_m,z_m,heading_deg,gyro_bias_x_deg_s,gyro_bias_y_deg_s,gyro_bias_z_deg_s,"
    "sigma_x_m,sigma_y_m,sigma_z_m,sigma_heading_deg,field,field_reason,cov_xy_m2,cov_xz_m2,cov_yz_m2,"
    "same_place_as,place_score,gyro_bias_sigma_x_deg_s,gyro_bias_sigma_y_deg_s,gyro_bias_sigma_z_deg_s,compass_weight"
)
SUMMARY_KEYS = {
    "method", "duration_s", "distance_m", "strides", "closure_m", "closure_percent", "runtime_s", "realtime_factor",
}  # fmt: skip
TRUTH_KEYS = {"rmse_2d_m", "rmse_3d_m", "end_error_m", "max_error_m", "heading_rmse_deg", "alignment"}


def loaded(path: Path) -> dict[str, object]:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    content = json.loads(path.read_text(), parse_constant=refuse)
    assert isinstance(content, dict)
    return content


def test_strides_hold_the_stances_in_the_units_of_their_names(tmp_path: Path, walk: Walk) -> None:
    outcome = walks.outcome(walk)
    write_run(tmp_path, walk, outcome, "none")
    assert (tmp_path / "strides.csv").read_text().splitlines()[0] == STRIDE_COLUMNS
    strides, stances = pd.read_csv(tmp_path / "strides.csv"), outcome.solution.stances
    assert len(strides) == len(walk.stances)
    np.testing.assert_allclose(strides[["x_m", "y_m", "z_m"]], stances.position, atol=1e-6)
    np.testing.assert_allclose(strides["gyro_bias_y_deg_s"], -0.05, rtol=1e-6)
    np.testing.assert_allclose(strides["sigma_y_m"] ** 2, stances.position_cov[:, 1, 1], rtol=1e-6)
    np.testing.assert_allclose(strides["cov_xy_m2"], stances.position_cov[:, 0, 1], rtol=1e-6)
    np.testing.assert_allclose(strides["sigma_heading_deg"].iloc[:2], [0.2, 0.23], rtol=1e-6)
    assert strides["heading_deg"].between(0, 360, inclusive="left").all()
    np.testing.assert_allclose(
        np.cos(np.deg2rad(strides["heading_deg"])), np.cos(compute_heading(stances.nav_R_body)), atol=1e-6
    )
    assert set(strides["field_reason"]) == {"not used, as yet"}  # the comma survives
    back = read_truth(tmp_path / "trajectory.tum")
    assert isinstance(back, TrajectoryTruth)
    np.testing.assert_allclose(back.t, walk.recording.t, atol=1e-9)
    np.testing.assert_allclose(back.position, outcome.solution.position, atol=1e-8)
    np.testing.assert_allclose(back.nav_R_body, outcome.solution.nav_R_body, atol=1e-7)


def test_summary_has_the_keys_and_the_figures(tmp_path: Path, walk: Walk) -> None:
    outcome = walks.outcome(walk)
    write_run(tmp_path, walk, outcome, "none")
    summary = loaded(tmp_path / "summary.json")
    assert summary.keys() >= SUMMARY_KEYS | TRUTH_KEYS
    assert summary["strides"] == len(walk.stances) - 1
    assert summary["realtime_factor"] == pytest.approx(walk.recording.duration_s / 0.25)
    assert summary["rmse_2d_m"] == outcome.metrics.rmse_2d_m
    assert summary["alignment"] == "yaw"
    assert summary["magnetometer"] == "not used"
    assert "made for a test" in str(summary["notes"])
    assert "distance_sigma_m" not in summary
    # what is not known is not claimed
    surveyed, bare = walks.with_footprints(walk), walks.without_truth(walk)
    told = replace(walks.outcome(bare), solution=replace(walks.outcome(bare).solution, distance_sigma_m=0.25))
    for name, one, found in (("prints", surveyed, walks.outcome(surveyed)), ("bare", bare, told)):
        (tmp_path / name).mkdir()
        write_run(tmp_path / name, one, found, "none")
    prints, nothing = (loaded(tmp_path / name / "summary.json") for name in ("prints", "bare"))
    assert (prints["rmse_3d_m"], prints["heading_rmse_deg"]) == (None, None)
    assert 0 < float(str(prints["rmse_2d_m"])) < 1
    assert not TRUTH_KEYS & nothing.keys()
    assert nothing["distance_sigma_m"] == 0.25


def test_magnetometer_is_used_when_the_method_says_so(
    tmp_path: Path, walk: Walk, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = walks.outcome(walk).solution
    for word, words in (("quasi-static", "used"), ("none", "not used")):
        table = replace(own.stances, field=(word,) * len(own.stances))
        mine = Method("mine", lambda *_, table=table: replace(own, stances=table))
        monkeypatch.setitem(METHODS["foot"], "mine", mine)
        write_run(tmp_path, walk, run_method(walk, "mine"), "none")
        assert loaded(tmp_path / "summary.json")["magnetometer"] == words


def test_config_names_input_version_and_parameters(tmp_path: Path, walk: Walk) -> None:
    write_run(tmp_path, walk, walks.outcome(walk), "none")
    config, count = loaded(tmp_path / "config.json"), len(walk.stances)
    assert config["fg_nav_version"]
    for key, value in {
        "format": "simulated",
        "recording": None,
        "truth": "in the recording",
        "parameters": {"noise": {"acc_m_s2": 0.3}, "unknown": None},
        "detector": {"name": "TRUE SPEED", "threshold": walks.STILL_M_S, "stances": count, "footfalls": count},
    }.items():
        assert config[key] == value


def test_json_is_standard_whatever_numpy_hands_over(tmp_path: Path) -> None:
    content = {"a": np.inf, "b": np.arange(2), "c": (np.int64(3), np.bool_(True)), "d": Path("x"), 5: None}
    write_json(tmp_path / "x.json", content)
    assert loaded(tmp_path / "x.json") == {"a": None, "b": [0, 1], "c": [3, True], "d": "x", "5": None}
