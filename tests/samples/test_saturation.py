"""Saturated samples: simulated tops, rounded, cut, cut and mixed; and the real sensors that clip."""

from itertools import product

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from fg_nav.io import read
from fg_nav.samples.readings import find_clipping_levels, find_saturated, find_saturation_level
from tests.real_data import DATA, needs_data

RATE = 200.0


def _motion(rng: np.random.Generator, duration_s: float = 60.0, bandwidth_hz: float = 8.0) -> np.ndarray:
    """Smooth random motion of 3 axes, standard deviation 3."""
    sos = butter(4, 2 * bandwidth_hz / RATE, output="sos")
    smooth = sosfiltfilt(sos, rng.normal(size=(int(duration_s * RATE), 3)), axis=0)
    return np.asarray(3.0 * smooth / smooth.std())


def test_rounded_peaks_and_random_motion_are_not_flagged() -> None:
    rng = np.random.default_rng(2)
    for frequency_hz, noise, rate_hz in product(
        (0.3, 1.0, 2.0, 5.0, 10.0, 20.0), (0.0, 1e-3, 5e-3, 2e-2), (50.0, 100.0, 200.0, 400.0, 1000.0)
    ):
        t = np.arange(0, 30, 1 / rate_hz)
        phases = 2 * np.pi * frequency_hz * t[:, None] + np.arange(3)
        samples = 8.0 * np.sin(phases) + noise * rng.normal(size=(len(t), 3))
        assert not find_saturated(samples).any(), (frequency_hz, noise, rate_hz)
    for bandwidth_hz in (2.0, 5.0, 10.0, 20.0, 40.0):
        assert not find_saturated(_motion(rng, 300.0, bandwidth_hz)).any()


@pytest.mark.parametrize(("mixing", "noise"), [*product((0.0, 0.01), (0.0, 5e-3))])
def test_cut_peaks_are_flagged(mixing: float, noise: float) -> None:
    """A clipped axis, seen through a calibration that mixes the others in."""
    rng = np.random.default_rng(3)
    motion = _motion(rng)
    limit = np.quantile(np.abs(motion[:, 1]), 0.99)
    clipped = motion.copy()
    clipped[:, 1] = np.clip(motion[:, 1], -limit, limit)
    cut = np.abs(motion[:, 1]) >= limit
    calibration = np.eye(3) + mixing * rng.uniform(-1, 1, (3, 3))
    flags = find_saturated(clipped @ calibration.T + noise * rng.normal(size=motion.shape))
    assert flags[cut, 1].mean() > 0.9
    assert cut[flags[:, 1]].mean() > 0.9
    assert not flags[:, [0, 2]].any()


def test_a_part_is_clipped_where_the_whole_is() -> None:
    """Few of the cut tops of a long recording are flat for long enough to show a range by themselves."""
    motion = _motion(np.random.default_rng(5), 120.0)
    limit = np.quantile(np.abs(motion[:, 1]), 0.995)
    clipped = motion.copy()
    clipped[:, 1] = np.clip(motion[:, 1], -limit, limit)
    levels, whole = find_clipping_levels(clipped), find_saturated(clipped)
    alone, told = (
        np.concatenate([find_saturated(part, of) for part in np.split(clipped, 60)]) for of in (None, levels)
    )
    np.testing.assert_array_equal(told, whole)
    assert alone[whole].mean() < 0.9


def test_one_end_only_and_nothing_to_tell() -> None:
    motion = _motion(np.random.default_rng(4))[:, 0]
    limit = np.quantile(motion, 0.99)
    clipped = np.minimum(motion, limit)
    assert find_saturation_level(clipped) == pytest.approx(limit, rel=5e-3)
    steps = np.round(np.random.default_rng(5).normal(size=1000))  # of a sensor that sees these only
    for signal in (-clipped, np.zeros(1000), np.full(1000, 5.0), steps, np.arange(4.0), np.empty(0), -np.ones(100)):
        assert find_saturation_level(signal) == np.inf


@needs_data
def test_real_gyroscopes_known_to_clip_and_sensors_far_from_their_range() -> None:
    """The 3DM-GX5's range is 500 deg/s = 8.73 rad/s before calibration."""
    for name, ends, range_rad_s in (
        ("vicon/2017-11-22-11-44-47.mat", [(1, -1)], (8.9, 9.2)),
        ("vicon/2017-11-27-11-18-11.mat", [(1, -1)], (8.8, 9.2)),
        ("gdin/own/SensorConnectData_35.csv", [(1, 1), (1, -1)], (8.5, 8.9)),
        ("gdin/own/SensorConnectData_43.csv", [(0, -1), (1, -1)], (8.5, 8.9)),
        ("gdin/own_obsolete/SensorConnectData_15.csv", [(1, 1)], (8.5, 8.9)),
    ):
        gyr = read(DATA / name).gyr
        for axis, sign in ends:
            assert range_rad_s[0] < find_saturation_level(sign * gyr[:, axis]) < range_rad_s[1], (name, axis, sign)
    for path in (path for pattern in ("xio/*.csv", "openshoe/*1.txt", "broad/0*.mat") for path in DATA.glob(pattern)):
        recording = read(path)
        assert not find_saturated(recording.gyr).any()
        assert not find_saturated(recording.acc).any()
