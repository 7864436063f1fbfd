"""Recordings of phones' apps: pauses, signs and what a phone lacks (each app's sample is in `test_every_format`)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read_raw
from fg_nav.recording import RawRecording
from tests.io.foreign_phones import Files, expected_force, hyperimu, phyphox, sensor_logger, sensorlog, write_files
from tests.io.samples import tilting

RAW = tilting(np.random.default_rng(3), duration_s=3.0, rate_hz=100.0, still_s=1.0)


def read_files(files: Files, path: Path) -> RawRecording:
    return read_raw(write_files(files, path))


def test_phyphox_puts_pauses_back(tmp_path: Path) -> None:
    files = dict(phyphox(RAW))
    head, start, _ = files["meta/time.csv"].splitlines()
    pause = '"PAUSE",1.2,101.2\n"START",1.2,131.7\n"PAUSE",3.0,133.5'
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
