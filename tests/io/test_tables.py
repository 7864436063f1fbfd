"""Any table, and inputs that people have: the small cases of ../shared/cases with their values, and more of each kind.

Of a table its layout, the words of its header, units that the samples show, and what is asked where they do not. Walks
are simulated, so that what is read can be held against what was written.
"""

from __future__ import annotations

import gzip
import json
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

from fg_nav import navigate
from fg_nav.columns.mapping import CANONICAL
from fg_nav.errors import FormatError, RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.inspection import inspect
from fg_nav.io import Reading, read, read_raw, read_truth
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.recording import RawRecording, Recording
from fg_nav.samples.readings import find_saturated
from tests.command_line import FgNav
from tests.io.samples import axes, tilting
from tests.io.samples import write_columns as write
from tests.real_data import CASES, needs_cases

DEMO = simulate("demo", 1)
WALK = DEMO.recording.slice(2400, 7400)
T = WALK.t - WALK.t[0]
DEG = np.degrees(WALK.gyr)
G = WALK.acc / GRAVITY_M_S2


def xyz(*patterns: str) -> list[str]:
    return axes(*patterns, letters="xyz")


def is_the_walk(raw: RawRecording | Recording, tolerance: float = 1e-3, period: float = 1e-4) -> bool:
    np.testing.assert_allclose(raw.acc, WALK.acc, atol=tolerance)
    np.testing.assert_allclose(raw.gyr, WALK.gyr, atol=tolerance)
    assert abs(np.ptp(raw.t) / T[-1] - 1.0) < period
    return True


class Walked(NamedTuple):
    """What `navigate` is to make of a case."""

    place: str
    distance_m: float
    within_m: float
    closure_m: float = np.inf
    verdict: str = ""
    reason: str = ""
    truth: str | None = None  # beside it
    rate_hz: float | None = None


NOMINAL = "the sample rate is nominal, known to 2 %, and the path to 4 %"
PRINTS = "footprints.csv"


@needs_cases
@pytest.mark.parametrize(
    "case",
    [
        Walked("01_two_sensors_in_one_table/left_alone.csv.gz", 40.2, 0.2, verdict="trusted"),
        Walked("02_wrong_nominal_rate/rows.csv.gz", 76.3, 12.0, reason=NOMINAL, truth=PRINTS, rate_hz=190.0),
        Walked("02_wrong_nominal_rate/rows.csv.gz", 76.3, 12.0, reason=NOMINAL, truth=PRINTS, rate_hz=210.0),
        Walked("04_gyro_bias_called_out_of_range/rectangle.csv.gz", 53.6, 0.2, 0.6, "trusted"),
        Walked("04_gyro_bias_called_out_of_range/surveyed.csv.gz", 76.6, 0.2, 1.0, "trusted", truth=PRINTS),
        Walked("05_field_gives_false_gyro_scale/lap.csv.gz", 363.0, 1.0, 15.0),
        Walked("06_clipping_hidden_by_rounding/two_decimals_of_g.csv", 76.3, 1.0, verdict="doubtful", truth=PRINTS),
        Walked("06_clipping_hidden_by_rounding/three_decimals_of_g.csv.gz", 76.3, 1.0, verdict="doubtful"),
        Walked("08_smoothed_at_5_Hz/smoothed.csv.gz", 76.3, 12.0, np.inf, "doubtful", "the samples are smoothed"),
    ],
    ids=lambda case: case.place,
)
def test_cases_that_are_walked(case: Walked) -> None:
    path = CASES / case.place
    found = navigate(read(path, rate_hz=case.rate_hz), truth=case.truth and path.parent / case.truth)
    solution, metrics = found.outcome.solution, found.metrics
    assert case.verdict in ("", found.verdict.word), found.verdict.reasons
    assert case.reason in " ".join(found.verdict.reasons)
    assert metrics.distance_m == pytest.approx(case.distance_m, abs=case.within_m)
    assert abs(metrics.distance_m - case.distance_m) < 3.0 * solution.distance_sigma_m
    assert metrics.closure_m < case.closure_m
    if np.isfinite(case.closure_m):
        sigma = np.sqrt(np.diag(solution.stances.position_cov[-1]))
        assert np.all(np.abs(solution.position[-1, :2]) < 3.0 * sigma[:2])
    assert case.truth is None or case.verdict != "trusted" or metrics.rmse_2d_m < 0.11


# two sensors in one table


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


# nominal clocks


def test_lost_rows_are_seen_in_the_gyroscope(tmp_path: Path) -> None:
    whole = write(tmp_path / "walk.csv", NAMES[1:], [WALK.acc, WALK.gyr])
    assert read(whole, rate_hz=200.0).provenance.rate_sigma == 0.02
    assert Reading(rate_hz=200.0, rate_sigma=0.001).read(whole).provenance.rate_sigma == 0.001
    kept = np.random.default_rng(4).random(len(T)) > 0.06
    lost = read(write(whole, NAMES[1:], [WALK.acc[kept], WALK.gyr[kept]]), rate_hz=200.0)
    assert lost.provenance.rate_sigma == pytest.approx(np.hypot(0.02, 0.06), abs=0.025)
    assert "of the rows are lost" in " ".join(lost.provenance.notes)


@pytest.mark.parametrize(("sensor", "field", "keep_mag"), [("demo", "indoor", True), ("mpu-9250", None, False)])
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


# clipping at any resolution


@needs_cases
def test_clipping_is_found_behind_rounding() -> None:
    for name in ("two_decimals_of_g.csv", "three_decimals_of_g.csv.gz"):
        found = inspect(read_raw(CASES / "06_clipping_hidden_by_rounding" / name))
        assert found.acc_range.share[0] == pytest.approx(0.14, abs=0.01)
        assert found.acc_range.level[0] == pytest.approx(2.0 * GRAVITY_M_S2, rel=0.01)


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


# units of time


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


# names and units


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


# gravity and user acceleration

UP = np.tile([0.0, 0.6, 0.8], (len(T), 1)) * GRAVITY_M_S2


def test_gravity_is_added(tmp_path: Path) -> None:
    apple, air = (WALK.acc - UP) / -GRAVITY_M_S2, np.full(len(T), 101.3)
    for names, columns in (
        (["t", *xyz("motionUserAcceleration{}(G)", "motionGravity{}(G)", "rotationRate.{}")],
         [T, apple, -UP / GRAVITY_M_S2, WALK.gyr]),
        (["t", *xyz("gravity_{}", "lin_acc_{}", "gyro_{}")], [T, UP, WALK.acc - UP, WALK.gyr]),
        (["t", *xyz("lin_acc_{} [g]", "gravity_{} [g]", "gyro_{}")], [T, apple, -UP / GRAVITY_M_S2, WALK.gyr]),
        (["t", *xyz("LinearAccel{} (m/s2)", "Gravity{} (m/s2)", "Gyro{} (dps)"), "pressure (kPa)"],
         [T, WALK.acc - UP, UP, DEG, air]),
    ):  # fmt: skip
        raw = read_raw(write(tmp_path / "walk.csv", names, columns))
        assert is_the_walk(raw)
        turned = any("as an iPhone has the sign turned" in note for note in raw.provenance.notes)
        assert turned == names[1].endswith(("(G)", "[g]"))
        assert (raw.pressure is None) == ("pressure" not in names[-1])
    assert np.nanmedian(raw.pressure) == pytest.approx(101300.0)


# one table a sensor


def test_tables_of_two_sensors_in_a_folder(tmp_path: Path) -> None:
    two = tmp_path / "two"
    two.mkdir()
    write(two / "left_Accelerometer.csv", ["time", "x", "y", "z"], [T * 1e3, WALK.acc])
    write(two / "left_Gyroscope.csv", ["time", "x", "y", "z"], [T * 1e3, WALK.gyr])
    assert is_the_walk(read_raw(two))


# further inputs


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


TILTING = tilting(np.random.default_rng(12), duration_s=6.0, rate_hz=100.0, still_s=1.0)
SHORT = ["t", "ax", "ay", "az", "gx", "gy", "gz"]


def table_of(raw: RawRecording = TILTING, time: float = 1.0, acc: float = 1.0, gyr: float = 1.0) -> list[np.ndarray]:
    return [raw.t * time, raw.acc * acc, raw.gyr * gyr]


def is_the_same(raw: RawRecording, mag: bool = False) -> bool:
    np.testing.assert_allclose(raw.t - raw.t[0], TILTING.t, atol=1e-6)
    for name in ("acc", "gyr", *(["mag"] if mag else [])):
        np.testing.assert_allclose(getattr(raw, name), getattr(TILTING, name), atol=1e-6)
    return raw.provenance.format == "table"


DEGREE = 180 / np.pi
UNITS = ["Time [ms]", *axes("Acc {} [g]"), *axes("gyro_{} (deg/s)", letters="xyz")]
IN_UNITS = table_of(TILTING, 1e3, 1 / GRAVITY_M_S2, DEGREE)


def test_separators_one_at_the_end_decimal_commas_and_gzip(tmp_path: Path) -> None:
    path, nothing = tmp_path / "walk.csv", [""] * len(TILTING.t)
    for separator in (",", ";", "\t", "|", ", "):
        assert is_the_same(read_raw(write(path, UNITS, IN_UNITS, separator)))
        assert is_the_same(read_raw(write(path, [*UNITS, ""], [*IN_UNITS, nothing], separator)))
    assert is_the_same(read_raw(write(path, SHORT, table_of(gyr=DEGREE), "  ")))
    for separator in (";", "\t", " "):
        path.write_text(write(path, SHORT, table_of(), separator).read_text().replace(".", ","))
        assert is_the_same(read_raw(path))
    path.write_bytes(gzip.compress(write(path, UNITS, IN_UNITS).read_bytes()))
    assert is_the_same(read_raw(path))


def test_lines_above_a_row_of_units_and_comments(tmp_path: Path) -> None:
    path = write(tmp_path / "walk.csv", [*SHORT, "note"], [*IN_UNITS, TILTING.t])
    header, *rows = path.read_text().splitlines()
    top = ["Logger 3, of somebody", "started,yesterday", "", header, "ms,g,g,g,dps,dps,dps,"]
    path.write_text("\n".join([*top, *rows[:10], "# a comment", *rows[10:]]))
    raw = read_raw(path)
    assert is_the_same(raw)
    assert raw.row[[0, 9, 10]].tolist() == [6, 15, 17]
    np.savetxt(path, np.column_stack(table_of()), header=" ".join(SHORT))  # in a comment
    assert is_the_same(read_raw(path))


def test_header_of_two_rows(tmp_path: Path) -> None:
    path = write(tmp_path / "walk.csv", ["t", "acc", "acc", "acc", "gyr", "gyr", "gyr"], table_of())
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, ",x,y,z,x,y,z", *rows]))
    assert is_the_same(read_raw(path))
    path.write_text("\n".join(["t,acc,,,gyr,,", ",x,y,z,x,y,z", "s,g,g,g,rad/s,rad/s,rad/s", *rows]))
    with pytest.raises(RecordingError, match="acc measures"):
        read(path)

    # of both feet
    path = write(tmp_path / "feet.csv", SHORT + SHORT[1:], [*table_of(), 2.0 * TILTING.acc, TILTING.gyr])
    axis = ",".join(["time", *axes("acc_{}", "gyr_{}", "acc_{}", "gyr_{}", letters="xyz")])
    feet = ",".join(["sensor", *["left_foot"] * 6, *["right_foot"] * 6])
    path.write_text("\n".join([feet, axis, path.read_text().split("\n", 1)[1]]))
    with pytest.raises(FormatError, match=r"more than one acceleration .*'left_foot acc_x'.*--sensor"):
        read_raw(path)
    assert is_the_same(read_raw(path, sensor="left"))


@pytest.mark.parametrize("time", [1.0, 1e3, 1e4, 1e6, 1e9])
def test_units_that_the_samples_show(time: float, tmp_path: Path) -> None:
    for acc, unit in ((1.0, "m/s^2"), (1 / GRAVITY_M_S2, "g"), (1e3 / GRAVITY_M_S2, "mg")):
        for gyr, rate_unit in ((1.0, "rad/s"), (DEGREE, "deg/s")):
            raw = read_raw(write(tmp_path / "walk.csv", SHORT, table_of(TILTING, time, acc, gyr)))
            assert is_the_same(raw)
            notes = " ".join(raw.provenance.notes)
            assert f"acc is taken for {unit}" in notes
            assert f"gyr is taken for {rate_unit}" in notes
            assert ("the stamps 't' are taken for" in notes) == (time != 1.0)


def test_the_gyroscope_of_a_walking_foot_shows_its_unit(tmp_path: Path) -> None:
    walk = simulate("demo", 1).recording.slice(3000, 7000)
    for gyr, unit in ((1.0, "rad/s"), (DEGREE, "deg/s")):
        raw = read_raw(write(tmp_path / "walk.csv", SHORT, [walk.t, walk.acc, walk.gyr * gyr]))
        assert f"gyr is taken for {unit}, by its peak" in raw.provenance.notes[-1]
        np.testing.assert_allclose(raw.gyr, walk.gyr, atol=1e-6)


def test_counts_have_the_scale_of_a_data_sheet(tmp_path: Path) -> None:
    names = [f"c{k}" for k in range(7)]
    path = write(tmp_path / "walk.csv", names, table_of(TILTING, 1.0, 16384 / GRAVITY_M_S2, 16.4 * DEGREE))
    assert is_the_same(read_raw(path, columns="time=c0[s],acc=c1:c2:c3[1/16384 g],gyr=5:6:7[1/16.4 deg/s]"))


def test_a_table_without_a_header(tmp_path: Path) -> None:
    path = write(tmp_path / "walk.csv", SHORT, [TILTING.gyr, TILTING.acc, TILTING.t])
    path.write_text(path.read_text().split("\n", 1)[1])
    np.save(tmp_path / "walk.npy", np.column_stack([TILTING.gyr, TILTING.acc, TILTING.t]))
    for one in (path, tmp_path / "walk.npy"):
        raw = read_raw(one, columns="time=7[s],acc=4:5:6[m/s^2],gyr=1:2:3[rad/s]")
        assert is_the_same(raw)
    assert raw.row[0] == 1


def test_counters_and_no_clock_at_all(tmp_path: Path) -> None:
    kept = np.delete(np.arange(len(TILTING.t)), [7, 8])
    path = write(tmp_path / "walk.csv", ["sample", *SHORT[1:]], [kept + 40, TILTING.acc[kept], TILTING.gyr[kept]])
    with pytest.raises(FormatError, match=r"no stamps but 'sample', which counts samples: .*--rate"):
        read_raw(path)
    raw = read_raw(path, rate_hz=100.0)
    np.testing.assert_allclose(raw.t, TILTING.t[kept], atol=1e-9)
    assert "time is 'sample' at 100 Hz" in raw.provenance.notes
    path = write(tmp_path / "none.csv", SHORT[1:], table_of()[1:])
    assert is_the_same(read_raw(path, rate_hz=100.0))
    with pytest.raises(FormatError, match="has stamps, 't'"):
        read_raw(write(path, SHORT, table_of()), rate_hz=100.0)
    with pytest.raises(FormatError, match="rises by ones"):
        read_raw(write(path, SHORT, [np.arange(len(TILTING.t)), TILTING.acc, TILTING.gyr]))
    assert is_the_same(read_raw(path, columns="acc=ax:ay:az,gyr=gx:gy:gz", rate_hz=100.0))


def test_a_counter_that_begins_again_keeps_what_was_lost(tmp_path: Path) -> None:
    kept = np.delete(np.arange(len(TILTING.t)), 450)
    for bits in (8, 16):
        columns = [(kept + 2**bits - 50) % 2**bits, *(column[kept] for column in IN_UNITS[1:])]
        path = write(tmp_path / "walk.csv", ["packet_counter", *UNITS[1:]], columns)
        raw = read_raw(path, rate_hz=100.0)
        np.testing.assert_allclose(raw.t, TILTING.t[kept], atol=1e-9)
        assert raw.provenance.notes[0] == "time is 'packet_counter' at 100 Hz"
        assert raw.provenance.rate_sigma == 0.02


@pytest.mark.parametrize(
    ("form", "is_dated"),
    [
        *((form, True) for form in ("%Y-%m-%d %H:%M:%S.%f", "%Y/%m/%d %H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%fZ")),
        *((form, False) for form in ("%d/%m/%Y %H:%M:%S.%f", "%H:%M:%S.%f", "%m-%d-%Y %I:%M:%S.%f %p")),
        ("%Y-%m-%d %H:%M:%S:%f", False),
    ],
)
def test_stamps_that_are_dates_or_times_of_day(form: str, is_dated: bool, tmp_path: Path) -> None:
    """Over midnight; of a date in another form the time of day counts alone: which number is the month is open."""
    start = 1.6e9 - 1.6e9 % 86400 - 3.0
    stamps = pd.to_datetime(start + TILTING.t, unit="s").round("ms").strftime(form)
    path = write(tmp_path / "dated.csv", ["Time", *UNITS[1:]], [list(stamps), *IN_UNITS[1:]])
    raw = read_raw(path)
    assert is_the_same(raw)
    assert "stamps" not in " ".join(raw.provenance.notes)  # they need no unit
    assert not is_dated or raw.t[0] == pytest.approx(start, abs=1e-3)
    without = "acc=Acc X:Acc Y:Acc Z[g],gyr=gyro_x:gyro_y:gyro_z[deg/s]"
    assert is_the_same(read_raw(path, columns=without, rate_hz=100.0))


def test_magnetometers(tmp_path: Path) -> None:
    names, path = [*SHORT, "mx", "my", "mz"], tmp_path / "walk.csv"
    assert is_the_same(read_raw(write(path, names, [*table_of(), TILTING.mag])), mag=True)
    raw = read_raw(write(path, names, [*table_of(), TILTING.mag / 47.4]))
    assert raw.mag is None
    assert "the magnetometer names no unit" in raw.provenance.notes[-1]
    mapped = "time=t[s],acc=ax:ay:az,gyr=gx:gy:gz[rad/s],mag=mx:my:mz"
    assert read_raw(path, columns=f"{mapped}[a.u.]").mag is None
    assert is_the_same(read_raw(path, columns=f"{mapped}[47.4 uT]"), mag=True)


def test_arrays_without_names_of_axes_and_an_index_of_instants(tmp_path: Path) -> None:
    path = tmp_path / "walk.npz"
    np.savez(path, ts=TILTING.t, one=TILTING.acc, two=TILTING.gyr)
    with pytest.raises(FormatError, match=r"no column for acceleration among 'ts', 'one 1'"):
        read_raw(path)
    assert is_the_same(read_raw(path, columns="time=ts,acc=one 1:one 2:one 3[m/s^2],gyr=two 1:two 2:two 3[rad/s]"))
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow")
    frame, path = pd.DataFrame(np.column_stack(table_of()), columns=SHORT), tmp_path / "walk.parquet"
    frame.assign(t=pd.to_datetime(frame["t"], unit="s")).set_index("t").to_parquet(path)
    assert is_the_same(read_raw(path))
