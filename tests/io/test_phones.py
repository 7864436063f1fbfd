"""Recordings of phones' apps: read equal within their digits, or refused with what to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read_raw
from fg_nav.recording import RawRecording, Recording
from tests.io.foreign_phones import (
    PHONES,
    START_NS,
    Files,
    androsensor,
    expected_force,
    gnss_logger,
    hyperimu,
    phyphox,
    physics_toolbox,
    sensor_logger,
    sensorlog,
    write_files,
    zip_files,
)
from tests.io.samples import tilting
from tests.real_data import DATA, needs_data

RAW = tilting(np.random.default_rng(3), duration_s=3.0, rate_hz=100.0, still_s=1.0)


def read_files(files: Files, path: Path) -> RawRecording:
    return read_raw(write_files(files, path))


@pytest.mark.parametrize("kind", PHONES)
def test_a_zip_is_as_good_as_its_files(kind: str, tmp_path: Path) -> None:
    files = PHONES[kind].files(RAW)
    raw = read_files(files, tmp_path / "walk.csv")
    packed = read_raw(zip_files(files, tmp_path / "walk.zip"))
    np.testing.assert_array_equal(packed.acc, raw.acc)


def test_a_zip_of_a_folder_with_what_macos_adds(tmp_path: Path) -> None:
    files = {f"2022-09-16/{place}": text for place, text in sensor_logger(RAW).items()}
    files |= {f"__MACOSX/2022-09-16/._{place}": "\0\5" for place in sensor_logger(RAW)}
    assert read_raw(zip_files(files, tmp_path / "walk.zip")).provenance.format == "sensor-logger"


def test_phyphox_says_what_it_did(tmp_path: Path) -> None:
    notes = read_files(phyphox(RAW), tmp_path / "walk").provenance.notes
    assert notes[0] == "recorded by phyphox 1.1.16 on P1"
    assert "accelerometer 100.0 Hz, gyroscope 100.0 Hz, magnetometer 50.0 Hz, begun 2 ms apart" in notes[-1]


def test_phyphox_puts_pauses_back(tmp_path: Path) -> None:
    files = dict(phyphox(RAW))
    head, start, _ = files["meta/time.csv"].splitlines()
    pause = '"PAUSE",1.2,101.2\n"START",1.2,131.7\n"PAUSE",3.0,133.5'
    raw = read_files({**files, "meta/time.csv": f"{head}\n{start}\n{pause}\n"}, tmp_path / "walk")
    assert "paused for 30.5 s at 1.2 s: a gap" in raw.provenance.notes
    assert raw.t[-1] == pytest.approx(RAW.t[-2] + 30.5)
    assert np.diff(raw.t).max() == pytest.approx(30.51, abs=0.02)


def test_phyphox_files_of_several_experiments_are_refused(tmp_path: Path) -> None:
    files = dict(phyphox(RAW))
    time = files["meta/time.csv"].replace(f"{RAW.t[-1]:.15E}", "1.5")
    with pytest.raises(FormatError, match=r"lasts 3.0 s, but meta/time.csv says 1.5 s: give the files of one"):
        read_files({**files, "meta/time.csv": time}, tmp_path / "walk")
    with pytest.raises(
        FormatError, match=r"holds two tables of a sensor .*gyroscope: Gyroscope.csv.* gyroscope: data.csv"
    ):
        read_files({**phyphox(RAW), "data.csv": files["Gyroscope.csv"]}, tmp_path / "other")


WITHOUT_GRAVITY = "no accelerometer.*record the accelerometer, with gravity in it"


@pytest.mark.parametrize("short", [False, True])
def test_phyphox_without_what_is_needed_is_refused(short: bool, tmp_path: Path) -> None:
    files = dict(phyphox(RAW, short=short))
    files["Linear Accelerometer.csv"] += files["Accelerometer.csv"].split("\n", 1)[1]
    with pytest.raises(FormatError, match="has no accelerometer, only gyroscope: give the folder"):
        read_files({"": files["Gyroscope.csv"]}, tmp_path / "Gyroscope.csv")
    with pytest.raises(FormatError, match=WITHOUT_GRAVITY):
        read_files({"": files["Linear Accelerometer.csv"]}, tmp_path / "Linear Accelerometer.csv")
    del files["Accelerometer.csv"]
    with pytest.raises(FormatError, match=WITHOUT_GRAVITY):
        read_files(files, tmp_path / "walk")
    with pytest.raises(FormatError, match="has no accelerometer, only magnetometer"):
        read_files({"Magnetometer.csv": files["Magnetometer.csv"], "note.txt": "of today"}, tmp_path / "mag")


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("ios", "specific force is -(Accelerometer + Gravity), as an iPhone has the sign turned"),
        ("android", "specific force is TotalAcceleration"),
        ("standardised", "specific force is (Accelerometer + Gravity)"),
        ("raw", "specific force is -9.80665 * AccelerometerUncalibrated, as an iPhone has the sign turned"),
        ("bare", "specific force is (Accelerometer + Gravity)"),
    ],
)
def test_sensor_logger_says_what_force_is(kind: str, words: str, tmp_path: Path) -> None:
    raw = read_files(sensor_logger(RAW, kind), tmp_path / "walk")
    notes = raw.provenance.notes
    assert words in notes
    assert f"time 0 is 2022-09-16 11:15:47.{START_NS // 10**6 % 1000} UTC" in notes
    assert kind != "raw" or "the gyroscope is uncalibrated: its bias is still in it" in notes


def test_sensor_logger_finds_the_sign_without_metadata(tmp_path: Path) -> None:
    """By the uncalibrated accelerometer, where it is there; nothing else can tell."""
    files = dict(sensor_logger(RAW, "ios"))
    raw = dict(sensor_logger(RAW, "raw"))
    del files["Metadata.csv"]
    with pytest.raises(FormatError, match=r"whether it is of an iPhone or of an Android phone.* Metadata.csv"):
        read_files(files, tmp_path / "unknown")
    files["AccelerometerUncalibrated.csv"] = raw["AccelerometerUncalibrated.csv"]
    known = read_files(files, tmp_path / "known")
    np.testing.assert_allclose(known.acc, expected_force(RAW, known.t), atol=1e-6)


def test_sensor_logger_without_what_is_needed_is_refused(tmp_path: Path) -> None:
    files = dict(sensor_logger(RAW))
    with pytest.raises(FormatError, match="is one sensor of Sensor Logger: give the folder or zip"):
        read_files({"": files["Gyroscope.csv"]}, tmp_path / "Gyroscope.csv")
    del files["Gravity.csv"]
    with pytest.raises(FormatError, match=WITHOUT_GRAVITY):
        read_files(files, tmp_path / "walk")


def test_a_field_that_is_mostly_the_phones_is_left_out(tmp_path: Path) -> None:
    files = dict(sensor_logger(RAW))
    mag = files.pop("Magnetometer.csv").splitlines()
    large = [mag[0], *(",".join([*line.split(",")[:2], "-580.0", line.split(",")[3], "200.0"]) for line in mag[1:])]
    raw = read_files({**files, "MagnetometerUncalibrated.csv": "\n".join(large)}, tmp_path / "walk")
    assert raw.mag is None
    assert any(note.startswith("the magnetometer reads 61") for note in raw.provenance.notes)


def test_apps_that_removed_gravity_are_refused(tmp_path: Path) -> None:
    texts = [
        sensorlog(RAW)[""].replace("accelerometerAcceleration", "motionUserAcceleration"),
        physics_toolbox(RAW)[""].replace("gF", "lost"),
        androsensor(RAW)[""].replace("ACCELEROMETER", "OTHER"),
        hyperimu(RAW)[""].replace("MPL_Accelerometer", "MPL_Linear_Acceleration"),
    ]
    for text in texts:
        with pytest.raises(FormatError, match=WITHOUT_GRAVITY):
            read_files({"": text}, tmp_path / "walk.csv")


def test_slow_apps_are_refused(tmp_path: Path) -> None:
    slow = RawRecording(t=RAW.t * 50.0, acc=RAW.acc, gyr=RAW.gyr, mag=RAW.mag, row=RAW.row)
    for files in (androsensor(slow), gnss_logger(slow), hyperimu(slow)):
        with pytest.raises(FormatError, match=r"has 2 samples a second, too few to follow a walk"):
            read_files(files, tmp_path / "walk.csv")


def test_hyperimu_without_a_clock_takes_the_nominal_rate_or_that_given(tmp_path: Path) -> None:
    raw = read_files(hyperimu(RAW, clock=False), tmp_path / "walk.csv")
    assert np.diff(raw.t) == pytest.approx(0.01)
    assert any("time is the row number at the nominal 10 ms" in note for note in raw.provenance.notes)
    assert np.diff(read_raw(tmp_path / "walk.csv", rate_hz=80.0).t) == pytest.approx(0.0125)


def test_sensorlog_takes_what_is_there(tmp_path: Path) -> None:
    text = sensorlog(RAW, ";")[""].replace("motionRotationRate", "gyroRotation").replace("motionTime", "gyroTime")
    raw = read_files({"": text}, tmp_path / "walk.csv")
    assert "the gyroscope is as measured: its bias is still in it" in raw.provenance.notes
    assert raw.mag is None
    np.testing.assert_allclose(np.linalg.norm(raw.acc[:50], axis=1), GRAVITY_M_S2, atol=0.1)


def test_a_sensor_that_the_phone_does_not_have(tmp_path: Path) -> None:
    """Apps write a header alone, an empty file, or one sample."""
    for files in (dict(phyphox(RAW)), dict(sensor_logger(RAW))):
        lines = files["Magnetometer.csv"].splitlines(keepends=True)
        for k, text in enumerate(("", lines[0], "".join(lines[:2]))):
            raw = read_files({**files, "Magnetometer.csv": text}, tmp_path / f"{len(files)}{k}")
            assert raw.mag is None
            assert len(raw.t) == len(RAW.t) - 2
        with pytest.raises(FormatError, match="has no gyroscope, only accelerometer and magnetometer"):
            read_files({**files, "Gyroscope.csv": files["Gyroscope.csv"].split("\n")[0]}, tmp_path / f"{len(files)}")


def test_a_log_that_was_cut_off(tmp_path: Path) -> None:
    """The last line ends within its stamp."""
    files = dict(sensor_logger(RAW))
    whole = read_files(files, tmp_path / "whole")
    files["Gyroscope.csv"] += "16633269472"
    raw = read_files(files, tmp_path / "cut")
    np.testing.assert_array_equal(raw.t, whole.t)


@needs_data
@pytest.mark.parametrize(
    ("place", "rate_hz", "rest", "field_uT"),
    [
        ("phyphox/test_case4", 52.4, 9.9, 54.6),
        ("phyphox-derived/semicolon-decimal-comma", 10.0, 9.8, 48.0),
        ("phyphox-derived/tab-decimal-comma", 10.0, 9.8, 48.0),
        ("sensor-logger-ios/2022-09-16_11-15-46.zip", 100.4, 9.8, None),
        ("sensor-logger-ios-uncal", 99.9, 9.6, None),
        ("sensor-logger-android", 101.5, 9.9, 36.4),
        ("physics-toolbox/INPUT_N.csv", 14.7, 9.9, None),
        ("hyperimu/short_y_impulse.csv", 43.5, 9.9, None),
    ],
)
def test_real_recordings(place: str, rate_hz: float, rest: float, field_uT: float | None) -> None:
    raw = read_raw(DATA / "formats" / place)
    assert 1.0 / np.median(np.diff(raw.t)) == pytest.approx(rate_hz, abs=0.1)
    assert np.nanmedian(np.linalg.norm(raw.acc, axis=1)) == pytest.approx(rest, abs=0.8)
    assert (raw.mag is None) == (field_uT is None)
    if raw.mag is not None:
        assert np.nanmedian(np.linalg.norm(raw.mag, axis=1)) == pytest.approx(field_uT, abs=0.1)
    Recording.from_raw(raw)


@needs_data
@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("sensor-logger-ios-mag", WITHOUT_GRAVITY),
        ("sensor-logger-ios/2022-09-09_13-14-55", "no gyroscope"),
        ("phyphox-semicolon", "give the files of one experiment"),
        ("androsensor/Upstairs1.csv", "2 samples a second"),
        ("gnss-logger/pixel6.txt", "0.0177 samples a second, too few"),
    ],
)
def test_real_recordings_that_are_refused(place: str, message: str) -> None:
    with pytest.raises(FormatError, match=message):
        read_raw(DATA / "formats" / place)
