"""Inputs that people have: the small cases of ../shared/cases with their right values, and more of each kind.

Walks here are simulated, so that what is read can be held against what was written.
"""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, filtfilt

from fg_nav import navigate
from fg_nav.columns.mapping import CANONICAL
from fg_nav.detection.sensor_processing import estimate_gyro_delay, read_rate_at
from fg_nav.errors import FormatError, RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.inspection import inspect
from fg_nav.io import Reading, read, read_raw, read_truth
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.pipeline import Result
from fg_nav.recording import RawRecording, Recording
from fg_nav.samples.readings import find_saturated
from tests.command_line import FgNav, Ran
from tests.io.samples import axes, tilting
from tests.io.samples import write_columns as write
from tests.proposals import check_proposals
from tests.real_data import CASES, needs_cases

DEMO = simulate("demo", 1)
WALK = DEMO.recording.slice(2400, 7400)
T = WALK.t - WALK.t[0]
DEG = np.degrees(WALK.gyr)
G = WALK.acc / GRAVITY_M_S2


@cache
def solved() -> Result:
    """What the default method makes of the walk."""
    return navigate(WALK)


def xyz(*patterns: str) -> list[str]:
    return axes(*patterns, letters="xyz")


def is_the_walk(raw: RawRecording | Recording, tolerance: float = 1e-3, period: float = 1e-4) -> bool:
    np.testing.assert_allclose(raw.acc, WALK.acc, atol=tolerance)
    np.testing.assert_allclose(raw.gyr, WALK.gyr, atol=tolerance)
    assert abs(np.ptp(raw.t) / T[-1] - 1.0) < period
    return True


# 1: two sensors in one table


@needs_cases
def test_two_sensors_in_the_rows_of_one_table() -> None:
    folder = CASES / "01_two_sensors_in_one_table"
    alone, found = read(folder / "left_alone.csv.gz"), navigate(folder / "left_alone.csv.gz")
    for name, sensor, words in (("feet", "left_foot", "left_foot, right_foot"), ("sensor_id", "1", r"1, 2")):
        with pytest.raises(FormatError, match=rf"holds 2 sensors \({words}\): name one, such as `--sensor {sensor}`"):
            read(folder / f"{name}.csv.gz")
        one = read(folder / f"{name}.csv.gz", sensor=sensor)
        assert len(one) == len(alone)
        np.testing.assert_allclose(one.acc, alone.acc, atol=0.01)
        with pytest.raises(FormatError, match="has no one 'middle' among its sensors"):
            read(folder / f"{name}.csv.gz", sensor="middle")
    assert found.metrics.distance_m == pytest.approx(40.2, abs=0.2)
    assert found.metrics.strides_detected == 32


OTHER = WALK.acc[:, [2, 0, 1]] * [1.0, -1.0, 1.0]
BOTH = [np.stack(pair, axis=1) for pair in ((T, T), (WALK.acc, OTHER), (WALK.gyr, WALK.gyr[::-1]))]
MIXED = [both.reshape(-1, *both.shape[2:]) for both in BOTH]  # rows of the walk and of another sensor in turn
BELOW = [np.concatenate([both[:, 0], both[:, 1]]) for both in BOTH]  # one below the other
NAMES = ["t [s]", *xyz("acc_{} [m/s^2]", "gyr_{} [rad/s]")]


def test_two_sensors_by_a_column_of_their_names(tmp_path: Path) -> None:
    late = [MIXED[0] + 2e-3 * (np.arange(2 * len(T)) % 2), *MIXED[1:]]
    for names, label, columns in (
        ([*NAMES, "node"], ("A", "B"), late),
        ([*CANONICAL[:7], "sensor"], ("left", "right"), MIXED),
        ([*NAMES, "Gerät"], ("7", "8"), BELOW),
    ):
        who = list(np.repeat(label, len(T))) if columns is BELOW else list(label) * len(T)
        path = write(tmp_path / "walk.csv", names, [*columns, who])
        with pytest.raises(FormatError, match=rf"holds 2 sensors \({label[0]}, {label[1]}\)"):
            read(path)
        assert is_the_walk(read_raw(path, sensor=label[0].lower()))
        if label[0] == "A":  # and where the user maps the columns
            given = "time=t,acc=acc_x:acc_y:acc_z[m/s^2],gyr=gyr_x:gyr_y:gyr_z[rad/s]"
            assert is_the_walk(read_raw(path, sensor="A", columns=given))


def test_rows_that_alternate_without_a_name_and_labels_that_do_not(tmp_path: Path) -> None:
    path = write(tmp_path / "walk.csv", NAMES[1:], MIXED[1:])
    with pytest.raises(FormatError, match=r"holds 2 sensors in alternating rows \(1, 2\)"):
        read(path, rate_hz=200.0)
    np.testing.assert_allclose(read_raw(path, rate_hz=200.0, sensor="2").acc, OTHER, atol=1e-6)
    # a label of what was done names no sensor
    what = np.where(T % 5.0 < 2.5, "walk", "run")
    assert is_the_walk(read(write(path, [*NAMES, "activity"], [T, WALK.acc, WALK.gyr, what])))
    with pytest.raises(FormatError, match="holds one sensor, and nothing in it is called 'left'"):
        read(path, sensor="left")


@needs_cases
def test_both_feet_of_one_table_are_one_walk(fg_nav: FgNav) -> None:
    path = CASES / "01_two_sensors_in_one_table" / "feet.csv.gz"
    ran = fg_nav("run", path, "--mount", "feet", "--json")
    found = json.loads(ran.out)
    assert (found["verdict"], found["sides_known"]) == ("trusted", "named")
    assert found["distance_m"] == pytest.approx(40.4, abs=0.5)
    assert fg_nav("run", path, "--mount", "feet", "--sensor", "left").refused("--sensor A,B")


# 2: nominal clocks


@needs_cases
@pytest.mark.parametrize("rate_hz", [190.0, 210.0])
def test_a_nominal_rate_stands_in_the_sigmas(rate_hz: float) -> None:
    folder = CASES / "02_wrong_nominal_rate"
    walk = read(folder / "rows.csv.gz", rate_hz=rate_hz)
    found = navigate(walk, truth=folder / "footprints.csv")
    off = abs(found.metrics.distance_m - 76.3)
    assert off < 3.0 * found.outcome.solution.distance_sigma_m
    assert found.verdict.reasons
    assert "the sample rate is nominal, known to 2 %, and the path to 4 %" in " ".join(found.verdict.reasons)


def test_lost_rows_are_seen_in_the_gyroscope(tmp_path: Path) -> None:
    whole = write(tmp_path / "walk.csv", NAMES[1:], [WALK.acc, WALK.gyr])
    assert read(whole, rate_hz=200.0).provenance.rate_sigma == 0.02
    assert Reading(rate_hz=200.0, rate_sigma=0.001).read(whole).provenance.rate_sigma == 0.001
    kept = np.random.default_rng(4).random(len(T)) > 0.06
    lost = read(write(whole, NAMES[1:], [WALK.acc[kept], WALK.gyr[kept]]), rate_hz=200.0)
    assert lost.provenance.rate_sigma == pytest.approx(np.hypot(0.02, 0.06), abs=0.025)
    assert "of the rows are lost" in " ".join(lost.provenance.notes)


def test_lines_of_a_stream_have_the_sigma_of_its_nominal_rate(tmp_path: Path, fg_nav: FgNav) -> None:
    path = tmp_path / "rows.txt"
    np.savetxt(path, np.hstack([WALK.acc, WALK.gyr])[:2500], delimiter=",", fmt="%.6f")
    ran = fg_nav("stream", path, "--columns", "ax,ay,az,gx,gy,gz", "--rate", "200", "--silence", "1")
    lines = [line for line in map(json.loads, ran.out.splitlines()) if "position_sigma_m" in line]
    assert len(lines) > 8
    for line in lines:
        assert np.linalg.norm(line["position_sigma_m"]) > 0.039 * np.linalg.norm(line["position_m"])
        assert "the sample rate is nominal" in " ".join(line["reasons"])


# 3: limits on estimated nuisances


@needs_cases
@pytest.mark.parametrize(
    ("name", "truth", "distance_m", "end_m"),
    [("rectangle", None, 53.6, 0.6), ("surveyed", "footprints.csv", 76.6, 1.0)],
)
def test_a_bias_that_rests_show_is_no_fault(name: str, truth: str | None, distance_m: float, end_m: float) -> None:
    folder = CASES / "04_gyro_bias_called_out_of_range"
    found = navigate(folder / f"{name}.csv.gz", truth=None if truth is None else folder / truth)
    assert found.verdict.word == "trusted", found.verdict.reasons
    assert found.metrics.distance_m == pytest.approx(distance_m, abs=0.2)
    assert found.metrics.closure_m < end_m
    assert truth is None or found.metrics.rmse_2d_m < 0.11


# 4: corrections from a short rest or a disturbed field


@needs_cases
def test_a_disturbed_field_does_not_bend_a_lap() -> None:
    found = navigate(CASES / "05_field_gives_false_gyro_scale" / "lap.csv.gz")
    assert found.metrics.distance_m == pytest.approx(363.0, abs=1.0)
    assert found.metrics.closure_m < 15.0
    end = found.outcome.solution.position[-1]
    assert np.all(np.abs(end[:2]) < 3.0 * np.sqrt(np.diag(found.outcome.solution.stances.position_cov[-1]))[:2])


@pytest.mark.parametrize(("sensor", "field", "keep_mag"), [("demo", "indoor-old", True), ("mpu-9250", None, False)])
def test_a_foot_that_sways_in_its_one_short_rest(sensor: str, field: str | None, keep_mag: bool) -> None:
    """1.2 deg/s of sway in the last 1.4 s, and no other rest."""
    walk = simulate("demo", 2, Choices(sensor=sensor, field=field))
    recording = walk.recording
    first, last = np.searchsorted(recording.t, [walk.flat[0, 1] - 0.3, walk.flat[-1, 0] + 1.5])
    recording = recording.slice(int(first), int(last))
    after = np.maximum(recording.t - walk.flat[-1, 0] - 0.1, 0.0)
    rng = np.random.default_rng(2)
    sway = sum(rng.normal(size=3) * np.sin(2.0 * np.pi * f * after[:, None] + rng.uniform(size=3)) for f in (0.6, 1.1))
    gyr = recording.gyr + np.radians(1.2) * sway * (after > 0.0)[:, None]
    found = navigate(replace(recording, gyr=gyr, mag=recording.mag if keep_mag else None))
    sigma = np.sqrt(np.diag(found.outcome.solution.stances.position_cov[-1]))
    assert found.metrics.end_error_m < max(3.0 * np.linalg.norm(sigma[:2]), 0.5)
    assert found.metrics.end_error_m < 4.0
    assert found.metrics.distance_m == pytest.approx(75.5, rel=0.02)


# 5: clipping at any resolution


@needs_cases
def test_clipping_is_found_behind_rounding() -> None:
    folder = CASES / "06_clipping_hidden_by_rounding"
    for name in ("two_decimals_of_g.csv", "three_decimals_of_g.csv.gz"):
        found = inspect(read_raw(folder / name))
        assert found.acc_range.share[0] == pytest.approx(0.14, abs=0.01)
        assert found.acc_range.level[0] == pytest.approx(2.0 * GRAVITY_M_S2, rel=0.01)
    result = navigate(folder / name, truth=folder / "footprints.csv")
    assert result.metrics.distance_m == pytest.approx(76.3, abs=1.0)
    assert result.verdict.word != "trusted"


def test_checks_that_end_for_want_of_data_say_so() -> None:
    whole, short = (RawRecording(T[:n], WALK.acc[:n], WALK.gyr[:n], np.arange(n)) for n in (len(T), 700))
    assert not any("Not judged" in words for words in inspect(whole).verdict)
    (words,) = (words for words in inspect(short).verdict if "Not judged" in words)
    assert "axes and clocks of gyroscope and accelerometer (3 strides)" in words
    assert "whether the samples are smoothed (3 s at 200 Hz)" in words


def test_a_coarse_gyroscope_at_the_end_of_its_range() -> None:
    limit, worst = 0.6 * np.abs(DEG).max(), int(np.argmax(np.abs(DEG).max(axis=0)))
    share = np.mean(np.abs(DEG[:, worst]) > limit)
    for step in (0.5, 2.0, 5.0):
        clipped = np.round(np.clip(DEG, -limit, limit) / step) * step
        assert find_saturated(clipped)[:, worst].mean() == pytest.approx(share, rel=0.5)
        assert not find_saturated(np.round(DEG / step) * step).any()


# 6: delay between the sensors


@pytest.mark.parametrize("delay_s", [0.025, -0.03])
def test_a_late_gyroscope_is_found_and_taken_off(delay_s: float) -> None:
    late = replace(WALK, gyr=read_rate_at(WALK.t, WALK.gyr, -delay_s))
    found = estimate_gyro_delay(late)
    assert found.sigma_s < 0.005
    assert found.tau_s == pytest.approx(delay_s, abs=3.0 * found.sigma_s)
    assert found.is_clear
    known, whole = solved(), navigate(late)
    assert whole.metrics.distance_m == pytest.approx(known.metrics.distance_m, rel=0.015)
    side = "late" if delay_s > 0 else "early"
    assert any(f"ms {side} " in note for note in whole.walk.recording.provenance.notes)


def test_sensors_on_one_clock_are_left_alone() -> None:
    assert not estimate_gyro_delay(WALK).is_clear
    assert np.array_equal(solved().walk.recording.gyr, WALK.gyr)


# 7: smoothed samples


@needs_cases
def test_smoothed_samples_are_doubtful() -> None:
    found = navigate(CASES / "08_smoothed_at_5_Hz" / "smoothed.csv.gz")
    assert found.verdict.word == "doubtful"
    assert "the samples are smoothed" in found.verdict.reasons[0]


@pytest.mark.parametrize(("cut_hz", "order", "is_smooth"), [(4.0, 1, True), (12.0, 2, False)])
def test_what_a_low_pass_leaves(cut_hz: float, order: int, is_smooth: bool) -> None:
    b, a = butter(order, cut_hz / 100.0)
    smooth = replace(WALK, acc=filtfilt(b, a, WALK.acc, axis=0), gyr=filtfilt(b, a, WALK.gyr, axis=0))
    assert any("smoothed" in reason for reason in navigate(smooth).verdict.reasons) == is_smooth


# 8: units of time


def test_ticks_of_other_lengths(tmp_path: Path) -> None:
    for stamps, words in (
        (np.round(T * 1e5) + 77, "taken for 10 us"),
        (np.floor(T / 0.016) * 16, "whole steps of 0.016 s"),
        (np.floor(1.7e9 + T), "whole steps of 1 s"),
        (np.round(T * 1e7), "taken for 100 ns"),
    ):
        raw = read_raw(write(tmp_path / "walk.csv", ["time", *NAMES[1:]], [stamps, WALK.acc, WALK.gyr]))
        assert is_the_walk(raw, period=0.002)
        assert words in " ".join(raw.provenance.notes)


def test_a_unit_that_is_said_wrongly_is_named(tmp_path: Path) -> None:
    own = tilting(np.random.default_rng(1), duration_s=20.0, rate_hz=100.0)
    path = write(tmp_path / "walk.csv", ["time [ms]", *NAMES[1:]], [own.t * 1e4, own.acc, own.gyr])
    with pytest.raises(RecordingError, match=r"stamps seem to be in another unit.*divide them by 10"):
        read(path)
    assert not inspect(read_raw(path)).is_usable


def test_nothing_too_short_or_without_a_stance_is_usable() -> None:
    raw = RawRecording(T[:100], WALK.acc[:100], WALK.gyr[:100], np.arange(100))
    assert "lasts 0.49" in inspect(raw).obstacle
    turning = np.tile([3.0, 0.0, 0.0], (2000, 1)) + np.random.default_rng(0).normal(size=(2000, 3))
    shaken = RawRecording(T[:2000], WALK.acc[:2000] + 9.0 * turning, turning, np.arange(2000))
    assert not inspect(shaken).is_usable


# 9: names and units


READ = """
09_unit_of_time_from_the_step_alone/ticks_of_0.1_ms.csv
09_unit_of_time_from_the_step_alone/ticks_of_10_ms.csv
09_unit_of_time_from_the_step_alone/whole_seconds.csv
10_angular_rate_by_other_names/AngularVel.csv
10_angular_rate_by_other_names/As_deg.txt
10_angular_rate_by_other_names/acce.csv
10_angular_rate_by_other_names/w_a_RS.csv
11_temperature_taken_for_time/clock.txt
12_MTi_log_taken_for_a_DOT/at_100_Hz.csv
12_MTi_log_taken_for_a_DOT/at_200_Hz.csv
14_gravity_and_user_acceleration/coremotion.csv.gz
15_one_table_a_sensor/polar
15_one_table_a_sensor/realworld
15_one_table_a_sensor/ronin
17_sentences_that_mislead/gps_time.csv
17_sentences_that_mislead/newest_first.csv
"""


@needs_cases
@pytest.mark.parametrize("place", READ.split())
def test_cases_that_are_read(place: str) -> None:
    found = inspect(read_raw(CASES / place))
    assert found.is_usable, found.verdict
    assert found.stamps.rate_hz == pytest.approx(100.0 if "100_Hz" in place else 200.0, rel=2e-3)
    assert found.rest.acc_m_s2 == pytest.approx(9.82, abs=0.03)


@needs_cases
def test_swapped_labels_are_named_with_a_command_that_works() -> None:
    path = CASES / "17_sentences_that_mislead" / "labels_swapped.csv"
    with pytest.raises(FormatError, match=r"columns called gx, gy, gz measure gravity \(1.002 at rest\)") as caught:
        read(path)
    mapping = shlex.split(str(caught.value))[-1].rstrip(".").replace("UNIT", "deg/s")
    assert len(read(path, columns=mapping)) == 4001


OTHER_NAMES = [
    (["Zeitstempel [ms]", *xyz("Beschleunigung {} (m/s²)", "Drehrate {} (°/s)")], [T * 1e3, WALK.acc, DEG]),
    (["sec", "nanosec", *xyz("imu.linear_acceleration.{}", "imu.angular_velocity.{}")],
     [np.floor(T + 5e8), np.round((T % 1.0) * 1e9), WALK.acc, WALK.gyr]),
    (["iTOW (ms)", *xyz("sf_{} [g]", "body_rates_{} [dps]")], [T * 1e3 + 4e8, G, DEG]),
    (["Date", "GPS time (s)", "Timestamp (us)", *xyz("P{} [mg]", "Q{} [mdps]")],
     [["2024-05-01"] * len(T), T + 9.0, T * 1e6, G * 1e3, DEG * 1e3]),
    (["t", *xyz("RotRate{} [deg/s]", "Spec. force {} [m/s²]")], [T, DEG, WALK.acc]),
    (["t", "ax", "ay", "az", "roll rate (deg/s)", "pitch rate (deg/s)", "yaw rate (deg/s)"], [T, WALK.acc, DEG]),
    (["t", "fwd [m/s2]", "left [m/s2]", "up [m/s2]", "p [deg/s]", "q [deg/s]", "r [deg/s]"], [T, WALK.acc, DEG]),
    (["Temps (s)", *xyz("accélération_{}", "vitesse angulaire {} (rad/s)")], [T, WALK.acc, WALK.gyr]),
    (["phone time [ms]", "device time [us]", *xyz("ACC{}[G]", "w{}[deg/s]"), "T(°C)"],
     [T * 1e3 + 3.0, T * 1e6, G, DEG, T * 0 + 20.0]),
]  # fmt: skip


def test_other_names(tmp_path: Path) -> None:
    for names, columns in OTHER_NAMES:
        assert is_the_walk(read_raw(write(tmp_path / "walk.csv", names, columns, "\t"))), names


def test_a_clock_without_a_date_over_midnight_and_newest_first(tmp_path: Path) -> None:
    words = pd.to_datetime(1.7e9 - 1.7e9 % 86400 - 5.0 + T, unit="s").strftime("%H:%M:%S.%f")
    back = write(tmp_path / "walk.csv", ["clock", *NAMES[1:]], [list(words)[::-1], WALK.acc[::-1], WALK.gyr[::-1]])
    raw = read_raw(back)
    assert is_the_walk(raw)
    assert "the rows are newest first: turned round" in raw.provenance.notes


def test_a_table_of_an_mti_that_is_read_as_a_dot_names_the_other(tmp_path: Path) -> None:
    names = ["PacketCounter", "SampleTimeFine", *axes("Acc_{}", "Gyr_{}")]
    path = write(tmp_path / "walk.csv", names, [np.arange(len(T)), np.round(T * 1e4), WALK.acc, WALK.gyr])
    with pytest.raises(FormatError, match=r"fg-nav inspect .* --format xsens"):
        read(path)
    assert is_the_walk(read_raw(path, "xsens"))


# 10: gravity and user acceleration

UP = np.tile([0.0, 0.6, 0.8], (len(T), 1)) * GRAVITY_M_S2


def test_gravity_is_added(tmp_path: Path) -> None:
    apple, air = (WALK.acc - UP) / -GRAVITY_M_S2, np.full(len(T), 101.3)
    for names, columns in (
        (["t", *xyz("motionUserAcceleration{}(G)", "motionGravity{}(G)", "rotationRate.{}")],
         [T, apple, -UP / GRAVITY_M_S2, WALK.gyr]),
        (["t", *xyz("gravity_{}", "lin_acc_{}", "gyro_{}")], [T, UP, WALK.acc - UP, WALK.gyr]),
        (["t", *xyz("LinearAccel{} (m/s2)", "Gravity{} (m/s2)", "Gyro{} (dps)"), "pressure (kPa)"],
         [T, WALK.acc - UP, UP, DEG, air]),
    ):  # fmt: skip
        raw = read_raw(write(tmp_path / "walk.csv", names, columns))
        assert is_the_walk(raw)
        assert any("as an iPhone has the sign turned" in note for note in raw.provenance.notes) == ("User" in names[1])
        assert (raw.pressure is None) == ("pressure" not in names[-1])
    assert np.nanmedian(raw.pressure) == pytest.approx(101300.0)


# 11: one table a sensor


def test_tables_of_two_sensors_in_a_folder(tmp_path: Path, fg_nav: FgNav) -> None:
    two = tmp_path / "two"
    two.mkdir()
    acc = write(two / "left_Accelerometer.csv", ["time", "x", "y", "z"], [T * 1e3, WALK.acc])
    gyr = write(two / "left_Gyroscope.csv", ["time", "x", "y", "z"], [T * 1e3, WALK.gyr])
    assert is_the_walk(read_raw(two))
    for ran in (fg_nav("inspect", acc), fg_nav("run", acc, gyr)):
        assert ran.refused("the tables of one recording into a folder of their own", "fg-nav inspect FOLDER")


# 12: further inputs


def test_a_marker_of_a_c3d_file_is_the_truth(tmp_path: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    there = np.cumsum(np.random.default_rng(2).normal(size=(3, 300)), axis=1)
    for unit, per_m in (("m", 1.0), ("mm", 1e3)):
        file, points = ezc3d.c3d(), np.ones((4, 2, 300))
        for key, value in (("RATE", [100.0]), ("UNITS", [unit]), ("LABELS", ["HEEL", "TOE"])):
            file["parameters"]["POINT"][key]["value"] = value
        points[:3, 0], points[:3, 1] = per_m * there, 0.0
        file["data"]["points"] = points
        file.write(str(tmp_path / "walk.c3d"))
        truth = read_truth(tmp_path / "walk.c3d:heel")
        np.testing.assert_allclose(truth.position, there.T, atol=1e-4)
        assert truth.t[-1] == pytest.approx(2.99)
    with pytest.raises(FormatError, match=r"holds 2 markers \(HEEL, TOE\): name one, such as `--truth walk.c3d:HEEL`"):
        read_truth(tmp_path / "walk.c3d")


def test_the_sigma_of_a_rate_may_be_said(tmp_path: Path, fg_nav: FgNav) -> None:
    path = write(tmp_path / "walk.csv", NAMES[1:], [WALK.acc, WALK.gyr])
    assert "known to 0.05 %" in fg_nav("inspect", path, "--rate", "200+-0.1").out
    assert "known to 2 %" in fg_nav("inspect", path, "--rate", "200").out
    assert fg_nav("inspect", path, "--rate", "fast").refused("a rate of fast Hz is none")


# proposals


def _refused_files(folder: Path) -> list[Path]:
    """Files of the kinds that are refused, simulated and of the cases."""
    t, acc, gyr = T[:2500], WALK.acc[:2500], WALK.gyr[:2500]
    g, deg, still = acc / GRAVITY_M_S2, np.degrees(gyr), 0.02 * np.random.default_rng(1).normal(size=acc.shape)
    plain, dot = ["t", *xyz("a{}", "g{}")], ["PacketCounter", "SampleTimeFine", *axes("Acc_{}", "Gyr_{}")]
    files: dict[str, tuple[list[str], list[object]]] = {
        "counts.csv": (plain, [t, np.round(g * 2048), np.round(deg * 16.4)]),
        "still.csv": (plain, [t, still + np.array([0.0, 0.0, 9.81]), still]),
        "swapped.csv": (plain, [t, gyr, acc]),
        "steps.csv": (plain, [t * 2e4, acc, gyr]),
        "twice.csv": (["t", *xyz("a{}", "acc_{}", "g{}")], [t, g, g, deg]),
        "clocks.csv": (["time", *plain], [t, t, g, deg]),
        "pqr.csv": ([*plain[:4], "p", "q", "r"], [t, acc, gyr]),
        "bare file.csv": ([*map(str, range(1, 8))], [t, acc, gyr]),
        "odd.csv": ([f"c{k}" for k in range(7)], [t, acc, gyr]),
        "none.csv": (plain[1:], [acc, gyr]),
        "fives.csv": (plain, [t, acc / 2.0, gyr]),
        "foot print.csv": (["stride", "x_m", "y_m"], [np.arange(4)] * 3),
        "dot.csv": (dot, [np.arange(len(t)), np.round(t * 1e4), acc, gyr]),
        "one/acc.csv": (["t", "x", "y", "z"], [t, acc]),
        "one/gyro.csv": (["t", "x", "y", "z"], [t, gyr]),
    }
    (folder / "one").mkdir()
    made = [write(folder / name, *content) for name, content in files.items()]
    bare = folder / "bare file.csv"
    bare.write_text(bare.read_text().split("\n", 1)[1])
    patterns = ("01*/feet*", "01*/sensor*", "02*/*.csv*", "17*/labels*")
    return [*made, *(path for pattern in patterns if CASES is not None for path in sorted(CASES.glob(pattern)))]


def test_no_refusal_proposes_what_fails(tmp_path: Path, fg_nav: FgNav) -> None:
    tried = 0
    for path in _refused_files(tmp_path):
        ran = fg_nav("inspect", path)
        if ran.code == 1:
            assert ran.err.startswith("fg-nav: ")
            tried += check_proposals(fg_nav, ["inspect", path], ran)
    assert tried >= 6


def test_a_proposal_that_fails_is_found(tmp_path: Path, fg_nav: FgNav) -> None:
    path = write(tmp_path / "walk.csv", NAMES, [T, WALK.acc, WALK.gyr])
    for words in (f"type fg-nav inspect {path} --sensor left.", "say which, such as `--columns t`.", "add --quieter."):
        with pytest.raises(AssertionError):
            check_proposals(fg_nav, ["inspect", path], Ran(1, "", f"fg-nav: {words}"))
    works = f"type fg-nav inspect {path} --json, or leave --rate out."
    assert check_proposals(fg_nav, ["inspect", path, "--rate", "9"], Ran(1, "", f"fg-nav: {works}")) == 2


# pressure of the air among them


def test_pressure_is_found_beside_mapped_columns_and_at_a_nominal_rate(tmp_path: Path) -> None:
    pressure = 101325.0 + np.arange(len(T)) % 7
    names = ["Pressure (hPa)", *xyz("f{}", "Gyro_{} (deg/s)")]
    path = write(tmp_path / "walk.csv", names, [pressure / 100.0, WALK.acc, DEG])
    given = "acc=fx:fy:fz[m/s^2]"
    completed = Reading(columns=given, rate_hz=200.0).read_raw(path)
    assert is_the_walk(completed)
    assert completed.pressure is not None
    np.testing.assert_allclose(completed.pressure, pressure, atol=1e-3)
    assert completed.provenance.rate_sigma == 0.02
    mapped = f"{given},gyr=5:6:7[deg/s],pressure=1[hPa]"
    np.testing.assert_allclose(read_raw(path, columns=mapped, rate_hz=200.0).pressure, pressure, atol=1e-3)
    assert read_raw(path, columns=mapped.rpartition(",")[0], rate_hz=200.0).pressure is None
