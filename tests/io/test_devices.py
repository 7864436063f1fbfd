"""Recordings of phones' apps and of sensor makers' tools: what they leave to choose, and what only some hold."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read, read_raw
from fg_nav.recording import RawRecording
from tests.io import foreign_sensors as files
from tests.io.every_format import write_changed
from tests.io.foreign_phones import Files, expected_force, hyperimu, phyphox, sensor_logger, sensorlog, write_files
from tests.io.samples import RAW, tilting


def read_files(files: Files, path: Path) -> RawRecording:
    return read_raw(write_files(files, path))


def test_phyphox_puts_pauses_back(tmp_path: Path) -> None:
    files = dict(phyphox(RAW))
    head, start, _ = files["meta/time.csv"].splitlines()
    pause = '"PAUSE",1.2,101.2\n"START",1.2,131.7\n"PAUSE",4.0,134.5'
    raw = read_files({**files, "meta/time.csv": f"{head}\n{start}\n{pause}\n"}, tmp_path / "walk")
    assert "paused for 30.5 s at 1.2 s: a gap" in raw.provenance.notes
    assert raw.t[-1] == pytest.approx(RAW.t[-2] + 30.5)
    assert np.diff(raw.t).max() == pytest.approx(30.51, abs=0.02)


WITHOUT_GRAVITY = "no accelerometer.*record the accelerometer, with gravity in it"


def test_one_file_of_several_or_two_of_a_sensor_are_refused(tmp_path: Path) -> None:
    files, logged = phyphox(RAW), sensor_logger(RAW)
    linear = files["Linear Accelerometer.csv"] + files["Accelerometer.csv"].split("\n", 1)[1]
    mag = {"Magnetometer.csv": files["Magnetometer.csv"], "note.txt": "of today"}
    for k, (given, words) in enumerate(
        (
            ({"": files["Gyroscope.csv"]}, "has no accelerometer, only gyroscope: give the folder"),
            ({"": linear}, WITHOUT_GRAVITY),
            ({"": logged["Gyroscope.csv"]}, "is one sensor of Sensor Logger: give the folder or zip"),
            (mag, "no accelerometer, only magnetometer"),
            ({**files, "data.csv": files["Gyroscope.csv"]}, "two tables of a sensor .*gyroscope: Gyroscope.csv.*data"),
        )
    ):
        (tmp_path / str(k)).mkdir()
        with pytest.raises(FormatError, match=words):
            read_files(given, tmp_path / str(k) / "Gyroscope.csv")


def test_sensor_logger_finds_the_sign_without_metadata_and_takes_calibrated_samples_first(tmp_path: Path) -> None:
    files = dict(sensor_logger(RAW, "ios"))
    del files["Metadata.csv"]
    files["AccelerometerUncalibrated.csv"] = sensor_logger(RAW, "raw")["AccelerometerUncalibrated.csv"]
    bare = dict(sensor_logger(RAW, "bare"))
    alone = {name: text for name, text in bare.items() if name not in ("Accelerometer.csv", "Gravity.csv")}
    off = sensor_logger(replace(RAW, gyr=RAW.gyr + 1.0, mag=2.0 * RAW.mag))
    for name in ("Gyroscope", "Magnetometer"):
        bare[f"{name}Uncalibrated.csv"] = off[f"{name}.csv"]
    for k, one in enumerate((files, bare, alone)):
        known = read_files(one, tmp_path / str(k))
        np.testing.assert_allclose(known.acc, expected_force(RAW, known.t), atol=1e-6)
        np.testing.assert_allclose(known.gyr, RAW.gyr[1:-1], atol=1e-6)
        np.testing.assert_allclose(known.mag[1::2], RAW.mag[2:-1:2], atol=1e-6)


def test_a_field_that_is_mostly_the_phones_is_left_out(tmp_path: Path) -> None:
    files = dict(sensor_logger(RAW))
    mag = files.pop("Magnetometer.csv").splitlines()
    large = [mag[0], *(",".join([*line.split(",")[:2], "-580.0", line.split(",")[3], "200.0"]) for line in mag[1:])]
    raw = read_files({**files, "MagnetometerUncalibrated.csv": "\n".join(large)}, tmp_path / "walk")
    assert raw.mag is None
    assert any(note.startswith("the magnetometer reads 61") for note in raw.provenance.notes)


def test_hyperimu_without_a_clock_takes_the_nominal_rate_or_that_given(tmp_path: Path) -> None:
    raw = read_files(hyperimu(RAW, clock=False), tmp_path / "walk.csv")
    np.testing.assert_allclose(raw.t, RAW.t[1:], atol=1e-9)  # the first row is zero
    assert any("time is the row number at the nominal 10 ms" in note for note in raw.provenance.notes)
    assert np.diff(read_raw(tmp_path / "walk.csv", rate_hz=80.0).t) == pytest.approx(0.0125)


def test_sensorlog_takes_what_is_there(tmp_path: Path) -> None:
    text = sensorlog(RAW, ";")[""].replace("motionRotationRate", "gyroRotation").replace("motionTime", "gyroTime")
    raw = read_files({"": text}, tmp_path / "walk.csv")
    assert "the gyroscope is as measured: its bias is still in it" in raw.provenance.notes
    assert raw.mag is None
    np.testing.assert_allclose(np.linalg.norm(raw.acc[:50], axis=1), GRAVITY_M_S2, atol=0.1)


@pytest.mark.parametrize("app", [phyphox, sensor_logger])
def test_a_sensor_that_the_phone_does_not_have(app, tmp_path: Path) -> None:
    files = app(RAW)
    lines = files["Magnetometer.csv"].splitlines(keepends=True)
    for k, text in enumerate(("", lines[0], "".join(lines[:2]))):
        raw = read_files({**files, "Magnetometer.csv": text}, tmp_path / str(k))
        assert raw.mag is None
        assert len(raw.t) == len(RAW.t) - 2


needs_ros = pytest.mark.skipif(find_spec("rosbags") is None, reason="the extra `ros` is not installed")


def test_time_of_xsens_is_its_clock_the_counter_or_a_rate(tmp_path: Path) -> None:
    path, kept = tmp_path / "walk.txt", np.arange(len(RAW.t)) != 7
    files.write_xsens_mt(RAW, path)
    raw = read_raw(path)
    np.testing.assert_allclose(raw.t, RAW.t[kept], atol=1e-9)
    assert raw.row[0] == 8
    files.write_xsens_mt(RAW, path, ",", fine=True)
    raw = read_raw(path)
    np.testing.assert_allclose(raw.t - raw.t[0], RAW.t[kept], atol=1e-4)
    path.write_text("\n".join(path.read_text().splitlines()[6:]).replace("SampleTimeFine", "Other"))
    raw = read_raw(path, rate_hz=50.0)
    assert raw.provenance.format == "xsens"
    np.testing.assert_allclose(np.diff(raw.t[:7]), 0.02)


def test_dot_at_rest_shows_no_unit(tmp_path: Path) -> None:
    path, still = tmp_path / "walk.csv", tilting(np.random.default_rng(4), 4.0, 100.0, still_s=9.0)
    files.write_dot_sdk(still, path)
    with pytest.raises(FormatError, match=r"deg/s or rad/s.*--columns '.*Gyr_X:Gyr_Y:Gyr_Z\[deg/s\]' --rate 100`"):
        read(path)
    mapped = "acc=Acc_X:Acc_Y:Acc_Z[m/s^2],gyr=Gyr_X:Gyr_Y:Gyr_Z[deg/s]"
    np.testing.assert_allclose(read(path, columns=mapped, rate_hz=100.0).gyr, still.gyr, atol=1e-4)


def test_shimmer_takes_the_clock_since_1970_before_its_own_and_numbers_before_text(tmp_path: Path) -> None:
    path, start_s = tmp_path / "walk.csv", 1e-3 * files.EPOCH_MS
    unix, text, own = "Timestamp_Unix", "Timestamp_FormattedUnix", "Timestamp"
    for clocks, first_s, step_s in (
        ((own, text, unix), start_s, 0.01),
        ((unix, text, own), start_s, 0.01),
        ((text, own), 1.0, 0.02),
        ((own,), 1.0, 0.02),
        ((text,), start_s, 0.01),
    ):
        files.write_shimmer(RAW, path, clocks=clocks)
        t = read_raw(path).t
        assert t[0] == pytest.approx(first_s), clocks
        np.testing.assert_allclose(np.diff(t), step_s, atol=1e-6)
    # a time that is none
    path.write_bytes(path.read_bytes().replace(b"2020/07/28 10:56:50.044", b"yesterday"))
    assert np.isnan(read_raw(path).t[1])
    assert "left out 1 missing sample, the first in row 5" in read(path).provenance.notes
    # the clock of another device counts where there is none of its own
    files.write_shimmer(RAW, path, clocks=(own,))
    path.write_bytes(path.read_bytes().replace(b"Shimmer_40AC_Timestamp", b"Shimmer_7_Timestamp"))
    np.testing.assert_allclose(np.diff(read_raw(path).t), 0.02, atol=1e-6)
    files.write_shimmer(RAW, path)
    sep, names, units, *rows = path.read_text().splitlines()
    other = [f"Shimmer_7_Timestamp_Unix_CAL;{names}", f"ms;{units}", *(f"1;{row}" for row in rows)]
    path.write_text("\n".join([sep, *other]))
    np.testing.assert_allclose(np.diff(read_raw(path).t), 0.01, atol=1e-6)


def test_metawear_leaves_out_rows_whose_clocks_are_damaged(tmp_path: Path) -> None:
    files.write_metawear(RAW, tmp_path)
    path = next(tmp_path.glob("*_Gyroscope*"))
    lines = path.read_text().splitlines()
    for row, (column, value) in enumerate([(2, "9.5e9"), (0, "9.5e12"), (2, "-1e12")], start=3):
        cells = lines[row].split(",")
        cells[column] = value
        lines[row] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    np.testing.assert_allclose(read_raw(tmp_path).gyr, np.delete(RAW.gyr, [2, 3, 4], axis=0), atol=1e-9)


def test_metawear_asks_for_the_other_file_and_for_the_session(tmp_path: Path) -> None:
    files.write_metawear(RAW, tmp_path)
    with pytest.raises(FormatError, match="has no gyroscope, only accelerometer: give the folder or zip"):
        read(next(tmp_path.glob("*_Accelerometer*")))
    files.write_metawear(RAW, tmp_path, "Right_MetaWear_2019-01-11T16.10.08.270_C5")
    with pytest.raises(FormatError, match=r"2 sessions \(Left_MetaWear.*, Right_MetaWear.*\): name one"):
        read(tmp_path)
    assert "the session is 'Right" in read_raw(tmp_path, sensor="right").provenance.notes[0]


def test_ximu3_folder_with_a_magnetometer_in_a_unit_and_movesense_without_one(tmp_path: Path) -> None:
    files.write_ximu3(RAW, tmp_path / "walk", "uT")
    raw = read_raw(tmp_path / "walk")
    np.testing.assert_allclose(raw.mag[::5], RAW.mag[::5], rtol=1e-9)
    assert np.isnan(raw.mag[1::5]).all()
    np.testing.assert_allclose(read_raw(tmp_path / "walk" / "Inertial.csv").acc, RAW.acc, atol=1e-9)
    assert read(write_changed("movesense", RAW, tmp_path, ("walk.dat", "ArrayMagn", "ArrayTemp"))).mag is None


# ROS bags, each storage of which is in `test_every_format`


@needs_ros
def test_one_of_several_topics_must_be_named_and_a_bag_alone_in_its_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "walk.mcap"
    files.write_bag(RAW, path, ("/left/imu", "/right/imu"), normalized=True)
    with pytest.raises(FormatError, match=r"2 topics .*\(/left/imu, /right/imu\): .*--sensor /left/imu"):
        read(path)
    raw = read_raw(path, sensor="right")
    assert raw.mag is None
    assert raw.provenance.notes[1].startswith("/a/mag is normalized (its strength is always 5e-05)")
    files.write_bag(RAW, path := tmp_path / "none.mcap", ())
    with pytest.raises(FormatError, match=r"no topic of sensor_msgs/Imu \(/a/mag, /left/mag\): record one"):
        read(path)
    for name in ("one.bag", "one.mcap", "one"):
        files.write_bag(RAW, path := tmp_path / name)
        inside = [file for file in path.rglob("*") if file.suffix in (".mcap", ".db3")] or [path]
        raw = read_raw(inside[0].rename(tmp_path / "renamed.dat"))
        np.testing.assert_array_equal(np.hstack([raw.acc, raw.gyr]), np.hstack([RAW.acc, RAW.gyr]))


def test_without_the_extra_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "walk.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(FormatError, match=r"which rosbags reads: pip install 'rosbags>=[\d.]+'\.$"):
        read(tmp_path / "walk.bag")
