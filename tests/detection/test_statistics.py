"""The four statistics against their formulas, sample by sample, and against the chi-square law they promise."""

import numpy as np
import pytest
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


@pytest.mark.parametrize("name", STATISTICS)
def test_each_window_has_the_value_of_the_formula_in_any_mounting(name):
    acc, gyr = shaken(60)
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5])
    for window in (1, 3, 10, 21):
        ours = STATISTICS[name](acc, gyr, window)
        padded = [np.pad(x, [(window // 2, window), (0, 0)], mode="edge") for x in (acc, gyr)]
        theirs = [windowed(name, *(x[i : i + window] for x in padded)) for i in range(len(acc))]
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(
            STATISTICS[name](turn.apply(acc), turn.apply(gyr), window), ours, rtol=1e-9, atol=1e-6
        )


@pytest.mark.parametrize("rate", [0.5, 0.05, 0.002])
@pytest.mark.parametrize("name", STATISTICS)
def test_a_threshold_is_a_false_alarm_rate(name, rate):
    """A fitted direction of gravity costs SHOE two of its 6 W degrees of freedom, a fitted mean MV three of its 3 W."""
    windows = 8000
    for window in (5, 10):
        acc, gyr = resting(windows * window, seed=window)
        apart = STATISTICS[name](acc, gyr, window)[window // 2 :: window]  # windows that share no sample
        alarms = np.count_nonzero(apart > threshold_at_rest(name, window, rate))
        low, high = binom.interval(1 - 1e-5, len(apart), rate)
        assert low <= alarms <= high


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


@pytest.mark.parametrize("name", STATISTICS)
def test_a_shock_leaves_no_trace_behind(name):
    """Sliding sums must not carry the rounding of a large value along."""
    acc, gyr = resting(3000)
    clean = STATISTICS[name](acc, gyr, 10)
    for shock in (2000.0, 1e9):
        acc[100] = gyr[100] = shock
        found = STATISTICS[name](acc, gyr, 10)
        assert (found >= 0.0).all()
        assert np.allclose(found[120:], clean[120:], rtol=1e-4, atol=1e-4) or shock > 1e6
