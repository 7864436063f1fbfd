"""The four statistics against their formulas, sample by sample, and against the chi-square law they promise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from fg_nav.detection import stance
from fg_nav.detection.stance import STATISTICS, threshold_at_rest
from fg_nav.frames import GRAVITY_M_S2

S_A, S_W = stance.ACC_NOISE_M_S2, np.radians(stance.GYR_NOISE_DEG_S)


def windowed(name, acc, gyr):
    """The statistic of one window (W, 3) as Skog et al. print it (MV with the divisor W)."""
    W = len(acc)
    mean = sum(acc) / W
    total = 0.0
    for a, w in zip(acc, gyr, strict=True):
        if name in ("shoe", "are"):
            total += w @ w / S_W**2
        if name == "shoe":
            off = a - GRAVITY_M_S2 * mean / np.sqrt(mean @ mean)
            total += off @ off / S_A**2
        if name == "mv":
            total += (a - mean) @ (a - mean) / S_A**2
        if name == "mag":
            total += (np.sqrt(a @ a) - GRAVITY_M_S2) ** 2 / S_A**2
    return total / W


def shaken(n, seed=0):
    """Specific force and rate of a sensor that is moved about."""
    rng = np.random.default_rng(seed)
    return np.array([0.0, 0.0, GRAVITY_M_S2]) + 5 * rng.standard_normal((n, 3)), 3 * rng.standard_normal((n, 3))


def resting(n, seed=0, tilt=(0.3, -0.5, 1.0)):
    """White noise of the nominal strength about gravity, in any attitude."""
    rng = np.random.default_rng(seed)
    up = Rotation.from_rotvec(tilt).inv().apply([0.0, 0.0, GRAVITY_M_S2])
    return up + S_A * rng.standard_normal((n, 3)), S_W * rng.standard_normal((n, 3))


@pytest.mark.parametrize("window", [1, 3, 10, 21])
@pytest.mark.parametrize("name", STATISTICS)
def test_each_window_has_the_value_of_the_formula(name, window):
    acc, gyr = shaken(60)
    ours = STATISTICS[name](acc, gyr, window)
    padded = [np.pad(x, [(window // 2, window), (0, 0)], mode="edge") for x in (acc, gyr)]
    theirs = [windowed(name, *(x[i : i + window] for x in padded)) for i in range(len(acc))]
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("name", STATISTICS)
@given(rotvec=st.lists(st.floats(-3, 3), min_size=3, max_size=3), seed=st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_mounting_does_not_matter(name, rotvec, seed):
    acc, gyr = shaken(40, seed)
    turn = Rotation.from_rotvec(rotvec)
    turned = STATISTICS[name](turn.apply(acc), turn.apply(gyr), 7)
    np.testing.assert_allclose(turned, STATISTICS[name](acc, gyr, 7), rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("rate", [0.5, 0.05, 0.002])
@pytest.mark.parametrize("window", [5, 10])
@pytest.mark.parametrize("name", STATISTICS)
def test_a_threshold_is_a_false_alarm_rate(name, window, rate):
    windows = 8000
    acc, gyr = resting(windows * window, seed=window)
    apart = STATISTICS[name](acc, gyr, window)[window // 2 :: window]  # windows that share no sample
    alarms = np.count_nonzero(apart > threshold_at_rest(name, window, rate))
    low, high = binom.interval(1 - 1e-5, len(apart), rate)
    assert low <= alarms <= high


@pytest.mark.parametrize(("name", "freedom"), [("shoe", 28), ("are", 15), ("mv", 12), ("mag", 5)])
def test_degrees_of_freedom(name, freedom):
    """A fitted direction of gravity costs SHOE two of its 30, a fitted mean costs MV three of its 15."""
    window, windows = 5, 20000
    acc, gyr = resting(windows * window, seed=3)
    total = window * STATISTICS[name](acc, gyr, window)[window // 2 :: window]
    standard_error = np.sqrt(2 * freedom / windows)
    assert abs(total.mean() - freedom) < 4.5 * standard_error < 0.5
    assert total.var() == pytest.approx(2 * freedom, rel=0.1)


@pytest.mark.parametrize("scale", [1, 10, 100])
def test_the_law_of_the_fitted_direction_holds_far_beyond_sensor_noise(scale, monkeypatch):
    """It is asymptotic in noise over gravity: at a hundred times the noise, a fifth of gravity, still good."""
    window, windows = 5, 20000
    rng = np.random.default_rng(4)
    monkeypatch.setattr(stance, "ACC_NOISE_M_S2", scale * S_A)
    acc = np.array([0.0, 0.0, GRAVITY_M_S2]) + scale * S_A * rng.standard_normal((windows * window, 3))
    total = window * STATISTICS["shoe"](acc, np.zeros_like(acc), window)[window // 2 :: window]
    freedom = 3 * window - 2
    assert abs(total.mean() - freedom) < 4.5 * np.sqrt(2 * freedom / windows)


@pytest.mark.parametrize(("name", "ignored"), [("are", "acc"), ("mv", "gyr"), ("mag", "gyr")], ids=["are", "mv", "mag"])
def test_what_a_statistic_does_not_use_does_not_matter(name, ignored):
    acc, gyr = shaken(40)
    other_acc, other_gyr = shaken(40, seed=9)
    changed = (other_acc, gyr) if ignored == "acc" else (acc, other_gyr)
    np.testing.assert_array_equal(STATISTICS[name](*changed, 5), STATISTICS[name](acc, gyr, 5))


def test_the_moving_variance_does_not_see_a_steady_force_and_the_magnitude_does():
    acc, gyr = resting(200)
    pushed = acc + np.array([0.0, 0.0, 3.0])
    np.testing.assert_allclose(STATISTICS["mv"](pushed, gyr, 9), STATISTICS["mv"](acc, gyr, 9), rtol=1e-6)
    assert STATISTICS["mag"](pushed, gyr, 9).min() > 100 * STATISTICS["mag"](acc, gyr, 9).max()


@pytest.mark.parametrize("name", STATISTICS)
def test_a_shock_leaves_no_trace_behind(name):
    """Sliding sums must not carry the rounding of a large value along."""
    acc, gyr = resting(3000)
    clean = STATISTICS[name](acc, gyr, 10)
    acc[100], gyr[100] = 2000.0, 70.0
    np.testing.assert_allclose(STATISTICS[name](acc, gyr, 10)[120:], clean[120:], rtol=1e-4, atol=1e-4)


def test_a_smaller_false_alarm_rate_has_a_higher_threshold():
    for name in STATISTICS:
        thresholds = [threshold_at_rest(name, 10, rate) for rate in (0.1, 0.01, 1e-6)]
        assert thresholds == sorted(thresholds)
