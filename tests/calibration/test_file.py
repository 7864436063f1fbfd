"""A calibration file gives back every number, and says in one sentence what is wrong with it."""

import json
from collections.abc import Callable
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


def test_file_is_standard_json_and_tells_its_version(tmp_path: Path) -> None:
    write_calibration(tmp_path / "cal.json", whole())

    def refuse(constant: str) -> None:
        pytest.fail(f"{constant} is no JSON")

    content = json.loads((tmp_path / "cal.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert content["version"] == 2
    assert content["accelerometer"]["bias_sigma"] == [None, None, None]


def without(part: str, key: str) -> Callable[[dict[str, Any]], None]:
    return lambda content: content[part].pop(key)


def changed(part: str, key: str, value: object) -> Callable[[dict[str, Any]], None]:
    return lambda content: content[part].update({key: value})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda content: content.update(version=3), "version 3"),
        (lambda content: content.update(version="1"), "version 1"),
        (lambda content: content.update(format="other"), "no calibration"),
        (lambda content: content.update(magnetometer=[1, 2]), "'magnetometer'"),
        (lambda content: content.update(gyroscope="none"), "'gyroscope'"),
        (without("magnetometer", "correction"), "'correction'"),
        (without("gyroscope", "bias"), "'bias'"),
        (changed("magnetometer", "hard_iron_uT", [1.0, 2.0]), "hard_iron_uT"),
        (changed("magnetometer", "hard_iron_uT", [1.0, 2.0, None]), "hard_iron_uT"),
        (changed("magnetometer", "hard_iron_uT", ["1", "2", "3"]), "'magnetometer'"),
        (changed("magnetometer", "correction", [[1, 0, 0], [0, 1], [0, 0, 1]]), "'magnetometer'"),
        (changed("magnetometer", "correction", (-np.eye(3)).tolist()), "turns a field round"),
        (changed("magnetometer", "strength_uT", "48"), "'magnetometer'"),
        (changed("magnetometer", "notes", [1]), "'magnetometer'"),
        (changed("magnetometer", "samples", 1.5), "'magnetometer'"),
        (changed("gyroscope", "bias", [0.1, 0.2]), "'gyroscope'"),
        (changed("gyroscope", "bias", [0.1, 0.2, None]), "'gyroscope'"),
        (changed("accelerometer", "scale", 0.0), "'accelerometer'"),
        (changed("accelerometer", "bias", 0.0), "'accelerometer'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_one_sentence(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    path = tmp_path / "cal.json"
    write_calibration(path, whole())
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(CalibrationError, match=r"^cal\.json[^\n]*\.$") as refused:
        read_calibration(path)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "damaged"),
        (b"{", "damaged"),
        (b"\xff\xfe\x00", "damaged"),
        (b"[" * 5000, "damaged"),
        (b"[]", "no calibration"),
        (b"null", "no calibration"),
        (b'{"version": 1}', "no calibration"),
        (b" " * (MAX_BYTES + 1), "more than 8 mib"),
        (b"time_s,acc_x_m_s2\n0,1\n", "damaged"),
    ],
    ids=["empty", "cut off", "binary", "deep", "a list", "null", "foreign", "large", "a recording"],
)
def test_foreign_files_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "cal.json"
    path.write_bytes(content)
    with pytest.raises(CalibrationError, match=words):
        read_calibration(path)
    assert not is_calibration(path)


def test_no_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="does not exist"):
        read_calibration(tmp_path / "nothing.json")
    with pytest.raises(CalibrationError, match="more than 8 mib"):
        read_calibration(Path("/dev/zero"))
    with pytest.raises(CalibrationError, match="is a directory"):
        read_calibration(tmp_path)
