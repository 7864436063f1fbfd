"""A calibration: what it undoes, what it may not be, its file, and all calibrations of one recording."""

import json
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.calibration import (
    LEVEL_FIELD_UT,
    UPPER,
    MagnetometerCalibration,
    check_strength,
    differentiate_inverse,
    matrix_of,
)
from fg_nav.calibration.inertial import AccelerometerCalibration, GyroscopeCalibration
from fg_nav.calibration.of_recording import (
    METHODS,
    Calibration,
    calibrate,
    is_calibration,
    read_calibration,
    write_calibration,
)
from fg_nav.errors import CalibrationError, MagneticError
from fg_nav.lab.simulation import simulate
from fg_nav.recording import Recording
from fg_nav.text import MAX_BYTES

HARD = np.array([14.0, -8.0, 3.0])
C = np.array([[1.1, 0.02, -0.03], [0.02, 0.9, 0.05], [-0.03, 0.05, 1.0]])


def calibration(**changed):
    usual = {"hard_iron_uT": HARD, "correction": C, "covariance": np.diag(np.arange(1.0, 10.0) ** 2)}
    return MagnetometerCalibration("by hand", **(usual | changed), strength_uT=48.0, residual_uT=0.5, samples=100)


def test_a_recording_is_corrected_row_by_row_and_keeps_its_gaps():
    field = np.random.default_rng(0).standard_normal((30, 3))
    mag = field @ np.linalg.inv(C).T + HARD
    mag[2] = np.nan
    still = np.zeros((30, 3))
    recording = Recording(np.arange(30) / 100.0, still, still, mag)
    corrected = calibration().apply_to(recording)
    assert np.delete(corrected.mag, 2, axis=0) == pytest.approx(np.delete(field, 2, axis=0))
    assert np.isnan(corrected.mag[2]).all()
    assert corrected.acc is recording.acc
    assert recording.mag[0] == pytest.approx(mag[0])
    assert calibration().parameters == pytest.approx([14.0, -8.0, 3.0, 1.1, 0.02, -0.03, 0.9, 0.05, 1.0])
    assert calibration().sigma == pytest.approx(np.arange(1.0, 10.0))
    with pytest.raises(CalibrationError, match="no magnetometer"):
        calibration().apply_to(replace(recording, mag=None))


def test_what_cannot_be_is_refused_and_a_field_that_earth_has_passes():
    for changed, words in (
        ({"hard_iron_uT": np.zeros(2)}, "hard_iron_uT"),
        ({"correction": np.eye(2)}, "correction"),
        ({"covariance": np.eye(6)}, "covariance"),
        ({"hard_iron_uT": np.array([0.0, np.nan, 0.0])}, "finite"),
        ({"correction": np.triu(C)}, "symmetric"),
        ({"correction": np.diag([1.0, 1.0, -1.0])}, "turns a field round"),
        ({"correction": np.diag([1.0, 1.0, 0.0])}, "turns a field round"),
    ):
        with pytest.raises(CalibrationError, match=words):
            calibration(**changed)
    for strength in (22.0, 48.0, 67.0):
        check_strength(strength)
    check_strength(4.0, LEVEL_FIELD_UT)
    for strength in (0.3, 4.0, 48e-6, 48e3, np.nan):
        with pytest.raises(CalibrationError, match=r"uT strong, and .* readings in uT"):
            check_strength(strength)


def test_the_slope_of_an_inverse_is_its_change():
    assert matrix_of(C[UPPER]) == pytest.approx(C)
    step = 1e-6
    ahead, behind = (
        np.stack([np.linalg.inv(matrix_of(C[UPPER] + sign * step * one))[UPPER] for one in np.eye(6)], axis=1)
        for sign in (1, -1)
    )
    assert differentiate_inverse(C)[3:, 3:] == pytest.approx((ahead - behind) / (2 * step), abs=1e-8)
    assert (differentiate_inverse(C)[:3] == np.eye(9)[:3]).all()


# the file


def whole():
    rng = np.random.default_rng(5)
    root, skew = rng.normal(size=(9, 9)), 0.1 * rng.normal(size=(3, 3))
    parts = rng.normal(size=3) * 10, np.eye(3) + skew @ skew.T, root @ root.T, 48.0 + rng.random(), 1 / 3, 77
    magnetometer = MagnetometerCalibration("walk", *parts, ("it covers all headings", 'µT, "quoted"'))
    gyroscope = GyroscopeCalibration(rng.normal(size=3), rng.random(3), rng.random(), 2, 3, 12.5)
    unknown = np.zeros(3), np.full(3, np.inf), 9.81, 2, 4.0
    accelerometer = AccelerometerCalibration(1.0 + rng.random() / 100, np.inf, *unknown, separable=False)
    return Calibration("walk.csv", magnetometer, gyroscope, accelerometer)


def same(a, b):
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    return type(a) is type(b) and a == b


@pytest.mark.parametrize("missing", [None, "magnetometer", "gyroscope", "accelerometer", "recording"])
def test_every_number_comes_back(tmp_path, missing):
    path, parts = tmp_path / "cal.json", {f.name: getattr(whole(), f.name) for f in fields(Calibration)}
    parts.pop(missing, None)
    write_calibration(path, Calibration(**parts))
    assert same(read_calibration(path), Calibration(**parts))
    assert is_calibration(path)
    text = path.read_text(encoding="utf-8")
    assert json.loads(text, parse_constant=pytest.fail)["version"] == 2  # standard JSON, of which NaN is none


ABSURD = np.eye(9) + 5.0 * (np.eye(9, k=1) + np.eye(9, k=-1))
SPOILED = {
    "": [
        ({"version": 3}, "version 3"),
        ({"version": "1"}, "version 1"),
        ({"format": "other"}, "no calibration"),
        ({"magnetometer": [1, 2]}, "'magnetometer'"),
        ({"gyroscope": "none"}, "'gyroscope'"),
    ],
    "magnetometer": [
        ("correction", "'correction'"),
        ({"hard_iron_uT": [1.0, 2.0]}, "hard_iron_uT"),
        ({"hard_iron_uT": [1.0, 2.0, None]}, "hard_iron_uT"),
        ({"hard_iron_uT": ["1", "2", "3"]}, "'magnetometer'"),
        ({"hard_iron_uT": [1e6, 0.0, 0.0]}, "calibrate again"),
        ({"hard_iron_uT": [1e300, 0.0, 0.0]}, "calibrate again"),
        ({"correction": [[1, 0, 0], [0, 1], [0, 0, 1]]}, "'magnetometer'"),
        ({"correction": (-np.eye(3)).tolist()}, "turns a field round"),
        ({"correction": (50.0 * np.eye(3)).tolist()}, "calibrate again"),
        ({"covariance": (-np.eye(9)).tolist()}, "calibrate again"),
        ({"covariance": (np.eye(9) + np.eye(9, k=1)).tolist()}, "calibrate again"),
        ({"covariance": ABSURD.tolist()}, "calibrate again"),
        ({"covariance": (1e300 * np.eye(9)).tolist()}, "calibrate again"),
        ({"strength_uT": "48"}, "'magnetometer'"),
        ({"notes": [1]}, "'magnetometer'"),
        ({"samples": 1.5}, "'magnetometer'"),
    ],
    "gyroscope": [("bias", "'bias'"), ({"bias": [0.1, 0.2, None]}, "'gyroscope'")],
    "accelerometer": [({"scale": 0.0}, "'accelerometer'"), ({"bias": 0.0}, "'accelerometer'")],
}


@pytest.mark.parametrize(("part", "change", "words"), [(p, *one) for p, many in SPOILED.items() for one in many])
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


def test_foreign_files_no_file_and_a_folder_are_refused(tmp_path):
    path = tmp_path / "cal.json"
    foreign = {b"": "damaged", b"\xff\xfe\x00": "damaged", b"[" * 5000: "damaged", b"null": "no calibration"}
    foreign |= {
        b'{"version": 1}': "no calibration",
        b" " * (MAX_BYTES + 1): "more than 8 mib",
        b"t,x\n0,1\n": "damaged",
    }
    for content, words in foreign.items():
        path.write_bytes(content)
        assert not is_calibration(path)
        with pytest.raises(CalibrationError, match=words):
            read_calibration(path)
    others = {tmp_path / "no.json": "does not exist", Path("/dev/zero"): "more than 8 mib", tmp_path: "is a directory"}
    for other, words in others.items():
        with pytest.raises(CalibrationError, match=words):
            read_calibration(other)


# all calibrations of one recording


def turned_over(rate_hz):
    """A sensor that a hand turns all ways, at this rate, for 20 s."""
    rng = np.random.default_rng(0)
    t = np.arange(int(rate_hz * 20.0)) / rate_hz
    rate = 2.0 * np.sin(t[:, None] * rng.uniform(0.3, 1.0, 3) + rng.uniform(0, 6, 3))
    R = [np.eye(3)]
    for turn in Rotation.from_rotvec(rate[:-1] / rate_hz).as_matrix():
        R.append(R[-1] @ turn)
    force, field = (np.einsum("nji,j->ni", R, v) for v in ([0.0, 0.0, 9.81], [0.0, 21.0, -43.0]))
    return Recording(t, force, rate, field + HARD + 0.3 * rng.standard_normal(field.shape))


def test_a_sensor_that_was_turned_over_gets_the_ellipsoid():
    recording = turned_over(100.0)
    found = calibrate(recording)
    tame, magnetometer = found.effect, found.calibration.magnetometer
    assert magnetometer.method == "ellipsoid"
    for one in (magnetometer, calibrate(turned_over(1000.0)).calibration.magnetometer):
        assert one.hard_iron_uT == pytest.approx(HARD, abs=0.2)
    assert tame.strength_after_uT == pytest.approx(0.3, rel=0.1)
    slow, mag = np.full_like(recording.mag, np.nan), recording.mag.copy()
    slow[::10] = recording.mag[::10]  # 10 Hz are enough
    assert calibrate(replace(recording, mag=slow)).calibration.magnetometer.samples > 190
    mag[700] += 1000.0  # one wild reading is in neither spread
    wild = calibrate(replace(recording, mag=mag)).effect
    assert wild.strength_before_uT == pytest.approx(tame.strength_before_uT, rel=0.01)
    assert wild.strength_after_uT == pytest.approx(tame.strength_after_uT, rel=0.01)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["dead", "one axis missing", "nothing", "not turned"])
def test_what_shows_no_iron_is_refused_in_one_sentence(method, kind):
    walk = simulate("calibration-loop", 1).recording.slice(0, 16_000)
    rng, read = np.random.default_rng(1), np.isfinite(walk.mag)
    mag = {
        "dead": np.where(read, [20.0, 3.0, -40.0], np.nan),
        "one axis missing": np.where(read, walk.mag, np.nan) * [1.0, np.nan, 1.0],
        "nothing": np.full_like(walk.mag, np.nan),
        "not turned": np.where(read, [20.0, 3.0, -40.0] + 0.3 * rng.standard_normal(read.shape), np.nan),
    }[kind]
    with pytest.raises((CalibrationError, MagneticError)) as refusal:
        calibrate(replace(walk, mag=mag), method)
    assert "\n" not in str(refusal.value)
    assert "ellipsoid: turn the sensor" not in str(refusal.value) or method in ("ellipsoid", "sphere")
