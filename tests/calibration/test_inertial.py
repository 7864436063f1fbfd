"""Gyroscope and accelerometer: biases and scale by lying still, and a large error of the accelerometer on a walk."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.calibration.inertial import (
    average_biases,
    average_out_error,
    calibrate_accelerometer,
    calibrate_gyroscope,
)
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import simulate
from fg_nav.recording import Recording

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
