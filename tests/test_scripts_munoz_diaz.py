"""The script that lays our figures beside those of Munoz Diaz et al. (2017)."""

import importlib
import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from fg_nav.frames import yaw_rotation
from fg_nav.pocket import PocketTrack
from fg_nav.simulation import SCENARIOS, Choices, courses, simulate
from fg_nav.simulation.path import straight

SCRIPTS = Path(__file__).parents[1] / "scripts"
sys.path.insert(0, str(SCRIPTS))
paper = importlib.import_module("reproduce_munoz_diaz2017")
rows = importlib.import_module("munoz_diaz2017_rows")
pictures = importlib.import_module("munoz_diaz2017_figures")


def run_with(minute, z=None, yaw=None):
    minute = np.asarray(minute, dtype=float)
    bias = np.zeros((len(minute), 3))
    bias[:, 2] = 0.0 if z is None else z
    yaw = np.zeros(len(minute)) if yaw is None else np.asarray(yaw, dtype=float)
    return pictures.Run(minute, bias, bias, yaw, None, np.zeros(len(minute), bool), np.zeros((1, 2)))


def setting_with(run, **columns):
    blank = pictures.Setting(*[np.zeros(1)] * 3, 1.0, np.zeros((1, 2)), np.zeros(4), np.zeros_like(run.bias))
    return replace(blank, **columns)


def true_track(recording, turning=0.0):
    """The truth as an estimate, whose yaw goes off by `turning` rad/s to the left."""
    turn = np.array([yaw_rotation(turning * t) for t in recording.t])
    n, nan = len(recording), np.full(len(recording), np.nan)
    R = turn @ recording.truth.nav_R_body
    zeros = np.zeros((n, 6))
    return PocketTrack(recording.t, R, zeros[:, :3], zeros, np.arange(0), np.zeros((0, 6, 6)), nan, nan)


@pytest.fixture(scope="module")
def short():
    course = partial(courses._to_and_fro, straight(40.0), 1, rest_s=5.0)
    return simulate(replace(SCENARIOS["pocket-long"], course=course), 3, Choices(sensor="ideal", aligned=True))


def test_minutes_ends_and_jumps_are_read_off_a_run():
    run = run_with([0, 1, 2, 3, 4], z=[0.0, -0.05, -0.08, -0.2, -0.1])
    setting = setting_with(run, passed_min=np.array([2.9, 0.0]))
    assert rows.reached(2, -0.08)(run, setting) == 2.0
    assert rows.reached(2, 0.08)(run, setting) == np.inf
    assert rows.at_end(2)(run, setting) == pytest.approx(-0.1)
    assert rows.at_minute(2, 2.5)(run, setting) == pytest.approx(-0.14)
    assert rows.largest(2)(run, setting) == pytest.approx(0.2)
    assert rows.largest(2, 3.5)(run, setting) == pytest.approx(0.1)
    fine = run_with(np.arange(0, 5, 0.1), z=np.where(np.arange(0, 5, 0.1) > 2.95, 0.3, 0.1))
    assert rows.jump(0)(fine, setting) == pytest.approx(0.2)
    assert rows.jump(1)(fine, setting) == pytest.approx(0.0)


def test_yaw_is_read_off_at_the_end_and_between_minutes():
    run = run_with([0, 1, 2, 3], yaw=[0.0, -10.0, 5.0, -20.0])
    setting = setting_with(run, ends=np.array([30.0, 60.0, 120.0]), legs=np.array([0, 1, 2]))
    assert rows.yaw_at_end(run, setting) == 20.0
    assert rows.yaw_range(0, 2)(run, setting) == 15.0
    assert rows.yaw_after(2)(run, setting) == 10.0


def test_with_the_true_attitude_the_way_is_nearly_the_true_one(short):
    setting = paper.setting_of(short)
    run = paper.run_of(true_track(short.recording), short.recording, short.recording.truth.nav_R_body, setting)
    assert np.abs(run.yaw_error).max() < 1e-9
    assert rows.away_after(2)(run, setting) < 3.0
    assert np.linalg.norm(run.path - setting.path, axis=1).max() < 4.0
    assert setting.length_m == pytest.approx(80.0, abs=1.0)
    assert set(setting.legs) == {0, 1}


def test_a_yaw_that_goes_off_is_told_and_turns_the_way(short):
    setting, truth = paper.setting_of(short), short.recording.truth.nav_R_body
    rate = np.radians(180.0) / setting.ends[setting.legs < 1][-1]
    run = paper.run_of(true_track(short.recording, rate), short.recording, truth, setting)
    half = run.minute * 60.0
    np.testing.assert_allclose(run.yaw_error, -np.degrees(rate) * half, atol=1e-6)
    assert rows.yaw_after(1)(run, setting) == pytest.approx(180.0, abs=0.5)


def test_a_quick_run_prints_every_row_and_writes_figures(capsys, tmp_path):
    arguments = ["--quick", "--seeds", "1", "--first", "7", "--estimators", "right", "--json", str(tmp_path / "a.json")]
    paper.main([*arguments, "--figures", str(tmp_path / "drawn")])
    said = capsys.readouterr().out
    written = json.loads((tmp_path / "a.json").read_text())
    assert [row["name"] for row in written["rows"]] == [row.words for row in rows.ROWS]
    assert "(seeds\n1 to 4)" in said
    assert all(section in said for section in ("Table 1", "Tables 2 and 3", "Figure 8", "Figure 14"))
    drawn = sorted(path.name for path in (tmp_path / "drawn").iterdir())
    assert drawn == ["figure-05.png", *(f"right-figure-{k:02d}.png" for k in (7, 8, 9, 10, 11, 13, 14))]
    by_name = {(row["section"], row["name"]): row["right"][0] for row in written["rows"]}
    # for two minutes, from rest: the bias along the thigh is not known to gravity, and the yaw goes off by it
    yaw = by_name["Figure 11a: gravity only", "yaw error at the end, deg"]
    assert 3.0 < yaw < 20.0
    assert abs(by_name["Figure 8: gravity only", "z at the end (true -0.1)"]) < 0.05


def test_the_medians_tell_what_never_came_and_what_ended():
    assert paper.spread([1.0, np.inf, np.inf], "{:.0f}") == "never (1, never)"
    assert paper.spread([1.0, 2.0, 3.0, np.nan], "{:.0f}") == "2 (1, 3, 1 ended)"
    assert paper.spread([np.nan], "{:.0f}") == "-"
