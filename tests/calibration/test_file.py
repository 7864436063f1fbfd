"""A calibration file gives back every number, and says in one sentence what is wrong with it."""

import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fg_nav.calibration import MagnetometerCalibration
from fg_nav.calibration.inertial import AccelerometerCalibration, GyroscopeCalibration
from fg_nav.calibration.of_recording import (
    Calibration,
    is_calibration,
    read_calibration,
    write_calibration,
)
from fg_nav.errors import CalibrationError
from fg_nav.text import MAX_BYTES


def magnetometer(rng: np.random.Generator) -> MagnetometerCalibration:
    root = rng.normal(size=(9, 9))
    skew = 0.1 * rng.normal(size=(3, 3))
    return MagnetometerCalibration(
        "walk", rng.normal(size=3) * 10, np.eye(3) + skew @ skew.T, root @ root.T, 48.0 + rng.random(), 1 / 3, 77,
        ("it covers all headings", "µT, \"quoted\""),
    )  # fmt: skip


def whole() -> Calibration:
    rng = np.random.default_rng(5)
    gyroscope = GyroscopeCalibration(rng.normal(size=3), rng.random(3), rng.random(), 2, 3, 12.5)
    accelerometer = AccelerometerCalibration(
        1.0 + rng.random() / 100, np.inf, np.zeros(3), np.full(3, np.inf), 9.81, 2, 4.0, separable=False
    )
    return Calibration("walk.csv", magnetometer(rng), gyroscope, accelerometer)


def same(a: Any, b: Any) -> bool:
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    return type(a) is type(b) and a == b


@pytest.mark.parametrize("missing", [None, "magnetometer", "gyroscope", "accelerometer", "recording"])
def test_every_number_comes_back(tmp_path: Path, missing: str | None) -> None:
    parts = {f.name: getattr(whole(), f.name) for f in fields(Calibration) if f.name != missing}
    written = Calibration(**parts)
    write_calibration(tmp_path / "cal.json", written)
    assert same(read_calibration(tmp_path / "cal.json"), written)
    assert is_calibration(tmp_path / "cal.json")
    text = (tmp_path / "cal.json").read_text(encoding="utf-8")
    assert json.loads(text, parse_constant=pytest.fail)["version"] == 2  # standard JSON, of which NaN is none


ABSURD = np.eye(9) + 5.0 * (np.eye(9, k=1) + np.eye(9, k=-1))


@pytest.mark.parametrize(
    ("part", "change", "words"),
    [
        (None, {"version": 3}, "version 3"),
        (None, {"version": "1"}, "version 1"),
        (None, {"format": "other"}, "no calibration"),
        (None, {"magnetometer": [1, 2]}, "'magnetometer'"),
        (None, {"gyroscope": "none"}, "'gyroscope'"),
        ("magnetometer", "correction", "'correction'"),
        ("gyroscope", "bias", "'bias'"),
        ("magnetometer", {"hard_iron_uT": [1.0, 2.0]}, "hard_iron_uT"),
        ("magnetometer", {"hard_iron_uT": [1.0, 2.0, None]}, "hard_iron_uT"),
        ("magnetometer", {"hard_iron_uT": ["1", "2", "3"]}, "'magnetometer'"),
        ("magnetometer", {"hard_iron_uT": [1e6, 0.0, 0.0]}, "calibrate again"),
        ("magnetometer", {"hard_iron_uT": [1e300, 0.0, 0.0]}, "calibrate again"),
        ("magnetometer", {"correction": [[1, 0, 0], [0, 1], [0, 0, 1]]}, "'magnetometer'"),
        ("magnetometer", {"correction": (-np.eye(3)).tolist()}, "turns a field round"),
        ("magnetometer", {"correction": (50.0 * np.eye(3)).tolist()}, "calibrate again"),
        ("magnetometer", {"covariance": (-np.eye(9)).tolist()}, "calibrate again"),
        ("magnetometer", {"covariance": (np.eye(9) + np.eye(9, k=1)).tolist()}, "calibrate again"),
        ("magnetometer", {"covariance": ABSURD.tolist()}, "calibrate again"),
        ("magnetometer", {"covariance": (1e300 * np.eye(9)).tolist()}, "calibrate again"),
        ("magnetometer", {"strength_uT": "48"}, "'magnetometer'"),
        ("magnetometer", {"notes": [1]}, "'magnetometer'"),
        ("magnetometer", {"samples": 1.5}, "'magnetometer'"),
        ("gyroscope", {"bias": [0.1, 0.2, None]}, "'gyroscope'"),
        ("accelerometer", {"scale": 0.0}, "'accelerometer'"),
        ("accelerometer", {"bias": 0.0}, "'accelerometer'"),
    ],
    ids=str,
)
def test_what_is_wrong_is_said_in_one_sentence(tmp_path, part, change, words):
    """A key alone is left out."""
    path = tmp_path / "cal.json"
    write_calibration(path, whole())
    content = json.loads(path.read_text(encoding="utf-8"))
    changed = content[part] if part else content
    if isinstance(change, str):
        changed.pop(change)
    else:
        changed.update(change)
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(CalibrationError, match=r"^cal\.json[^\n]*\.$") as refused:
        read_calibration(path)
    assert words in str(refused.value)


def test_foreign_files_no_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "cal.json"
    for content, words in (
        (b"", "damaged"),
        (b"\xff\xfe\x00", "damaged"),
        (b"[" * 5000, "damaged"),
        (b"null", "no calibration"),
        (b'{"version": 1}', "no calibration"),
        (b" " * (MAX_BYTES + 1), "more than 8 mib"),
        (b"time_s,acc_x_m_s2\n0,1\n", "damaged"),
    ):
        path.write_bytes(content)
        assert not is_calibration(path)
        with pytest.raises(CalibrationError, match=words):
            read_calibration(path)
    for other, words in (
        (tmp_path / "nothing.json", "does not exist"),
        (Path("/dev/zero"), "more than 8 mib"),
        (tmp_path, "is a directory"),
    ):
        with pytest.raises(CalibrationError, match=words):
            read_calibration(other)
