"""Calibrations of a recording: what they undo, their file, and the biases and scale of gyroscope and accelerometer."""

import json
from dataclasses import fields, is_dataclass, replace
from functools import cache
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
from fg_nav.calibration.inertial import (
    AccelerometerCalibration,
    GyroscopeCalibration,
    average_biases,
    average_out_error,
    calibrate_accelerometer,
    calibrate_gyroscope,
)
from fg_nav.calibration.of_recording import (
    METHODS,
    Calibration,
    Effect,
    calibrate,
    is_calibration,
    read_calibration,
    write_calibration,
)
from fg_nav.commands.calibrate import print_calibration
from fg_nav.detection import detect_stances, find_rests
from fg_nav.errors import CalibrationError, MagneticError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.recording import Recording
from fg_nav.text import MAX_BYTES
from tests.magnetic.turning_walks import HARD_IRON, tumble

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


ABSURD = np.eye(9) + 5.0 * (np.eye(9, k=1) + np.eye(9, k=-1))  # No covariance: it has a negative eigenvalue.
SPOILED = [
    ("", {"version": 3}, "version 3"),
    ("", {"format": "other"}, "no calibration"),
    ("", {"magnetometer": [1, 2]}, "'magnetometer'"),
    ("magnetometer", "correction", "'correction'"),
    ("magnetometer", {"hard_iron_uT": [1.0, 2.0]}, "hard_iron_uT"),
    ("magnetometer", {"hard_iron_uT": ["1", "2", "3"]}, "'magnetometer'"),
    ("magnetometer", {"hard_iron_uT": [1e6, 0.0, 0.0]}, "calibrate again"),
    ("magnetometer", {"correction": (50.0 * np.eye(3)).tolist()}, "calibrate again"),
    ("magnetometer", {"covariance": (np.eye(9) + np.eye(9, k=1)).tolist()}, "calibrate again"),
    ("magnetometer", {"covariance": ABSURD.tolist()}, "calibrate again"),
    ("magnetometer", {"covariance": (1e300 * np.eye(9)).tolist()}, "calibrate again"),
    ("gyroscope", {"bias": [0.1, 0.2, None]}, "'gyroscope'"),
    ("accelerometer", {"scale": 0.0}, "'accelerometer'"),
]


@pytest.mark.parametrize(("part", "change", "words"), SPOILED)
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
    for content, words in {
        b"": "damaged",
        b"\xff\xfe\x00": "damaged",
        b"[" * 5000: "damaged",
        b"null": "no calibration",
        b" " * (MAX_BYTES + 1): "more than 8 mib",
    }.items():
        path.write_bytes(content)
        assert not is_calibration(path)
        with pytest.raises(CalibrationError, match=words):
            read_calibration(path)
    for other, words in {tmp_path / "no.json": "does not exist", tmp_path: "is a directory"}.items():
        with pytest.raises(CalibrationError, match=words):
            read_calibration(other)


# all calibrations of one recording


def test_a_sensor_that_was_turned_over_gets_the_ellipsoid(capsys):
    recording = tumble()
    found = calibrate(recording)
    tame, magnetometer = found.effect, found.calibration.magnetometer
    assert magnetometer.method == "ellipsoid"
    for one in (magnetometer, calibrate(tumble(1000.0)).calibration.magnetometer):
        assert one.hard_iron_uT == pytest.approx(HARD_IRON, abs=0.2)
    assert tame.strength_after_uT == pytest.approx(0.3, rel=0.1)
    slow, mag = np.full_like(recording.mag, np.nan), recording.mag.copy()
    slow[::10] = recording.mag[::10]  # 10 Hz are enough
    assert calibrate(replace(recording, mag=slow)).calibration.magnetometer.samples > 190
    mag[700] += 1000.0  # one wild reading is in neither spread
    wild = calibrate(replace(recording, mag=mag)).effect
    assert wild.strength_before_uT == pytest.approx(tame.strength_before_uT, rel=0.01)
    assert wild.strength_after_uT == pytest.approx(tame.strength_after_uT, rel=0.01)
    for effect in (tame, Effect(9.29, 9.97, 8.28, 17.39)):  # the other one, of a straight walk, is harmful
        print_calibration(replace(found, effect=effect), Path("cal.json"))
        said = capsys.readouterr().out
        assert ("to use it" in said, "caution" in said) == ((True, False) if effect is tame else (False, True))


@cache
def loop():
    return simulate("calibration-loop", 1, Choices(rate_hz=200.0)).recording.slice(0, 8000)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["dead", "one axis missing", "nothing", "not turned"])
def test_what_shows_no_iron_is_refused_in_one_sentence(method, kind):
    walk = loop()
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


RATE_HZ = 100.0
G = GRAVITY_M_S2
FACES = np.vstack([np.eye(3), -np.eye(3)])
GYR_BIAS, ACC_BIAS, SCALE = np.radians([0.3, -0.2, 0.5]), np.array([0.10, -0.15, 0.05]), 1.012


def lying(ups, seed, seconds=4.0, noise=1.0):
    """A sensor that lies with each of `ups` (n, 3) upward in turn, and is turned by hand in between."""
    lie, turn, rng = int(seconds * RATE_HZ), int(RATE_HZ), np.random.default_rng(seed)
    acc, gyr = [], []
    for up in np.asarray(ups, dtype=float):
        acc += [np.tile(up / np.linalg.norm(up) * G, (lie, 1)), np.tile(up * G, (turn, 1))]
        gyr += [np.zeros((lie, 3)), np.tile([1.5, 0.7, -0.8], (turn, 1)) * rng.normal(1, 0.2, (turn, 1))]
    acc, gyr = np.vstack(acc[:-1]), np.vstack(gyr[:-1])
    acc = SCALE * acc + ACC_BIAS + noise * 0.02 * rng.normal(size=acc.shape)
    gyr = gyr + GYR_BIAS + noise * np.radians(0.1) * rng.normal(size=gyr.shape)
    return Recording(np.arange(len(acc)) / RATE_HZ, acc, gyr)


def test_six_faces_show_scale_and_bias_and_corrected_readings_weigh_gravity_in_any_attitude():
    found = calibrate_accelerometer(lying(FACES, 0))
    assert (found.separable, found.attitudes) == (True, 6)
    assert abs(found.scale - SCALE) < 3e-4
    np.testing.assert_allclose(found.bias, ACC_BIAS, atol=0.01)
    assert found.seconds == pytest.approx(24.0, abs=1.5)
    other = lying(Rotation.random(5, random_state=2).as_matrix()[:, 0], 0, noise=0.0)
    still = np.linalg.norm(other.gyr - GYR_BIAS, axis=1) < 1e-9
    off, corrected = (np.abs(np.linalg.norm(r.acc[still], axis=1) - G).max() for r in (other, found.apply_to(other)))
    assert corrected < 0.02 < 0.1 < off


@pytest.mark.parametrize(
    "ups",
    [FACES[:1], FACES[:3], [[0, 0.1 * i, 1] for i in range(6)], [[0, np.cos(a), np.sin(a)] for a in range(6)]],
    ids=["one", "three", "a foot's", "all in a plane"],
)
def test_attitudes_that_cannot_tell_scale_from_bias_say_so(ups):
    found = calibrate_accelerometer(lying(ups, 3))
    assert not found.separable
    assert np.isinf([found.scale_sigma, *found.bias_sigma]).all()
    assert found.scale == pytest.approx(found.norm_m_s2 / G)
    with pytest.raises(CalibrationError, match="six faces"):
        found.apply_to(lying(FACES[:1], 3))


def test_errors_of_scale_and_bias_are_within_their_sigmas():
    """Axes of unequal scale (0.3 per cent) and not quite square, as sensors are; eight attitudes as they come."""
    errors = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        r = lying(Rotation.random(8, rng=rng).as_matrix()[:, 0], seed)
        distortion = np.eye(3) + rng.normal(0.0, 0.003, (3, 3))
        found = calibrate_accelerometer(Recording(r.t, r.acc @ distortion.T, r.gyr))
        if found.separable:
            errors.append((found.bias - distortion @ ACC_BIAS) / found.bias_sigma)
    assert len(errors) > 50
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.2


def test_the_gyroscopes_bias_is_that_of_the_rests():
    errors = []
    for seed in range(40):
        found = calibrate_gyroscope(lying(FACES[:3], seed))
        errors.append((found.bias - GYR_BIAS) / found.sigma)
    assert found.rests == 3
    assert np.sqrt(np.mean(np.square(errors))) < 1.0
    # rests that differ by more than their sigmas, as those of a bias that moves, widen that of their mean
    one, off = lying(FACES[:3], 1), np.radians(0.05)
    moved = calibrate_gyroscope(replace(one, gyr=one.gyr + off * (one.t > 9.5)[:, None]))
    assert moved.sigma.mean() == pytest.approx(off / 3.0, rel=0.05)  # standard error of the mean of 0, 0 and 1
    assert np.degrees(found.sigma).max() < 0.05
    (rest,) = find_rests(lying(FACES[:1], 0))
    np.testing.assert_allclose(calibrate_gyroscope(lying(FACES[:1], 0)).sigma, rest.sigma)
    exact = calibrate_gyroscope(lying(FACES[:1], 2, seconds=60.0))
    assert np.degrees(exact.sigma).max() < 0.03
    assert 0.06 < np.degrees(exact.next_sigma) < 0.15  # as far as biases usually change
    assert exact.prior["gyro_bias_deg_s"] == pytest.approx(np.degrees(GYR_BIAS), abs=0.03)
    rng = np.random.default_rng(0)
    shaken = Recording(np.arange(1000) / RATE_HZ, rng.normal(0, 5, (1000, 3)), rng.normal(0, 2, (1000, 3)))
    assert calibrate_gyroscope(shaken) is calibrate_accelerometer(shaken) is None


def test_the_bias_of_a_walk_is_that_of_the_simulated_sensor():
    walk = simulate("demo", 3)
    found = calibrate_gyroscope(walk.recording)
    at_rest = np.array(walk.drawn["sensor"]["g_sensitivity"]) @ walk.recording.acc[:500].mean(axis=0)
    assert np.abs(found.bias - walk.biases.gyr.mean(axis=0) - at_rest).max() < 3 * found.sigma.max()
    rested = found.apply_to(walk.recording)
    assert np.abs(rested.gyr[100:500].mean(axis=0)).max() < 3 * found.sigma.max()


def test_mean_of_a_sensor_and_its_next_bias_are_within_their_sigmas():
    for change in (0.02, 0.06, 0.2):
        rng, mu, z = np.random.default_rng(8), np.radians([0.3, -1.0, 0.1]), []
        for _ in range(200):
            sigmas = np.radians(rng.uniform(0.01, 0.1, (8, 3)))
            true = mu + np.radians(change) * rng.normal(size=(9, 3))
            mean, sigma, next_sigma = average_biases(true[:8] + sigmas * rng.normal(size=(8, 3)), sigmas)
            z.append([*((mean - mu) / sigma), *((true[8] - mean) / next_sigma)])
        rms = np.sqrt(np.mean(np.square(z), axis=0))
        assert 0.6 < rms.min() < rms.max() < 1.3
    biases, sigmas = np.radians(0.3 + 0.03 * rng.normal(size=(9, 3))), np.radians(np.full((9, 3), 0.02))
    before = average_biases(biases, sigmas)
    biases[4] += np.radians(3.0)  # a recording far off hardly moves it
    after = average_biases(biases, sigmas)
    np.testing.assert_allclose(after[0], before[0], atol=np.radians(0.03))
    assert before[2] <= 1.01 * after[2] < np.radians(0.1)


# a large error on a walk


@cache
def walked():
    return replace(simulate("demo", 4).recording, mag=None)


def corrected(walk, bias, scale=1.0):
    spoiled = replace(walk, acc=scale * walk.acc + np.asarray(bias))
    return spoiled, average_out_error(spoiled, detect_stances(spoiled))


def test_a_calibrated_accelerometer_is_left_as_it_is_and_a_large_bias_is_taken_off_a_walk_and_said():
    """Along the force; what a foot never turns to the vertical is neither seen nor of use."""
    for bias, scale in (((0.0, 0.0, 0.0), 1.0), ((0.03, -0.02, 0.02), 1.002)):
        spoiled, found = corrected(walked(), bias, scale)
        assert found is spoiled
    force = walked().acc[:200].mean(axis=0)
    up = force / np.linalg.norm(force)
    for size in (0.7, -0.5):
        _, found = corrected(walked(), size * up)
        left = found.acc[:200].mean(axis=0) - force
        assert abs(left @ up) < 0.03
        assert np.linalg.norm(left) < 0.5 * abs(size)
        assert "an accelerometer bias of" in found.provenance.notes[-1]


def test_strides_show_the_bias_where_there_is_no_rest():
    stances = detect_stances(walked())
    moving = walked().slice(int(stances.start[3]), int(stances.stop[-3]))
    spoiled, found = corrected(moving, [0.0, 0.0, 0.7])
    assert np.abs((spoiled.acc - moving.acc)[:, 2]).max() > 0.6
    assert np.abs((found.acc - moving.acc).mean(axis=0)[2]) < 0.2
