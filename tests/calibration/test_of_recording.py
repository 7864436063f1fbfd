"""All calibrations of one recording: hands that turn a sensor over, and what a wild reading does to the results."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.calibration.of_recording import METHODS, calibrate
from fg_nav.errors import CalibrationError, MagneticError
from fg_nav.lab.simulation import simulate
from fg_nav.recording import Recording

HARD = np.array([15.0, -8.0, 3.0])


def turned_over(rate_hz, seconds=20.0, seed=0):
    """A sensor that a hand turns all ways, at this rate."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(rate_hz * seconds)) / rate_hz
    rate = 2.0 * np.sin(t[:, None] * rng.uniform(0.3, 1.0, 3) + rng.uniform(0, 6, 3))
    turns = Rotation.from_rotvec(rate / rate_hz).as_matrix()
    nav_R_body = np.empty((len(t), 3, 3))
    nav_R_body[0] = np.eye(3)
    for k in range(1, len(t)):
        nav_R_body[k] = nav_R_body[k - 1] @ turns[k - 1]
    force, field = (np.einsum("nji,j->ni", nav_R_body, v) for v in ([0.0, 0.0, 9.81], [0.0, 21.0, -43.0]))
    return Recording(t, force, rate, field + HARD + 0.3 * rng.standard_normal(field.shape))


def test_a_sensor_that_was_turned_over_gets_the_ellipsoid():
    found = calibrate(turned_over(1000.0))
    assert found.calibration.magnetometer.hard_iron_uT == pytest.approx(HARD, abs=0.2)
    recording = turned_over(100.0)
    tame, magnetometer = calibrate(recording).effect, calibrate(recording).calibration.magnetometer
    assert magnetometer.method == "ellipsoid"
    assert magnetometer.hard_iron_uT == pytest.approx(HARD, abs=0.2)
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
