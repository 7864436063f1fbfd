"""The disturbance detector, sample by sample, on strengths made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtr

from fg_nav.errors import MagneticError
from fg_nav.lab.sample_field import (
    MATTERS_UT,
    SIGMA_UT,
    WINDOW_S,
    find_sample_threshold,
    judge_samples,
)
from fg_nav.magnetic.detectors import FALSE_ALARM_RATE
from fg_nav.recording import Recording
from tests.magnetic.fields import EARTH

RATE_HZ = 100.0


def recording(strength_uT, rate_hz=RATE_HZ, noise_uT=0.0, seed=1):
    """A sensor that tumbles in a field of this strength (N,)."""
    n = len(strength_uT)
    rng = np.random.default_rng(seed)
    axis = rng.standard_normal((n, 3))
    mag = strength_uT[:, None] * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    mag = mag * (1.0 + noise_uT * rng.standard_normal((n, 1)) / strength_uT[:, None])
    return Recording(np.arange(n) / rate_hz, np.tile([0.0, 0.0, 9.81], (n, 1)), np.zeros((n, 3)), mag)


def strength(n):
    return np.full(n, np.linalg.norm(EARTH))


def test_a_sensor_that_tumbles_in_a_still_field_passes():
    found = judge_samples(recording(strength(1000)))
    assert found.judged[2:].all()
    assert found.quasi_static[2:].all()


@pytest.mark.parametrize("bump_uT", [-5.0, 2.0])
def test_all_of_a_bump_is_rejected_its_top_included(bump_uT):
    """Two seconds past a lamp: at the top the rate of the strength is nothing."""
    t = np.arange(1000) / RATE_HZ
    found = judge_samples(recording(strength(1000) + bump_uT * np.exp(-(((t - 5.0) / 0.6) ** 2))))
    within = np.abs(t - 5.0) < 0.6
    assert not found.quasi_static[within].any()
    assert found.quasi_static[(t > 0.1) & (t < 3.0)].all()
    assert found.quasi_static[t > 8.0].all()


def test_no_sample_is_judged_by_later_ones():
    walk = recording(strength(500), noise_uT=0.2)
    np.testing.assert_allclose(judge_samples(walk.slice(0, 300)).statistic, judge_samples(walk).statistic[:300])


@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_as_many_still_fields_and_least_changes_pass_as_are_said_to(rate_hz):
    """Windows that lie apart, of white readings; the change goes evenly through each."""
    count = round(WINDOW_S * rate_hz)
    n = 2000 * count
    still = recording(strength(n), rate_hz, SIGMA_UT)
    ramp = np.tile(np.linspace(0.0, MATTERS_UT, count), 2000)
    changing = recording(strength(n) + ramp, rate_hz, SIGMA_UT, seed=2)
    passed = [judge_samples(walk).quasi_static[count - 1 :: count].mean() for walk in (still, changing)]
    assert passed[0] == pytest.approx(chdtr(count - 1, find_sample_threshold(count)), abs=0.03)
    assert passed[1] == pytest.approx(FALSE_ALARM_RATE, abs=0.02)


def test_what_a_slow_magnetometer_did_not_measure_is_not_counted():
    """Held readings would count five times over, NaN rows do not: the verdicts are those of the slow recording."""
    n, every = 1000, 5
    fast = recording(strength(n) + 3.0 * (np.arange(n) > 500), noise_uT=0.15)
    fresh = np.arange(n) % every == 0
    holed = replace(fast, mag=np.where(fresh[:, None], fast.mag, np.nan))
    slow = Recording(fast.t[fresh], fast.acc[fresh], fast.gyr[fresh], fast.mag[fresh])
    np.testing.assert_allclose(judge_samples(holed).statistic[fresh], judge_samples(slow).statistic, rtol=1e-6)
    assert judge_samples(holed).judged[20:].all()


def test_a_gap_of_the_magnetometer_is_not_judged():
    walk = recording(strength(1000))
    mag = walk.mag.copy()
    mag[300:600] = np.nan
    found = judge_samples(replace(walk, mag=mag))
    assert not found.judged[400:600].any()
    assert not found.quasi_static[400:600].any()
    assert found.judged[610:].all()


def test_a_turn_of_the_field_that_keeps_its_strength_is_not_seen():
    """As the docstring says: the strength is all that it looks at."""
    angle = np.linspace(0.0, np.pi, 500)
    mag = 48.0 * np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    assert judge_samples(replace(recording(strength(500)), mag=mag)).quasi_static[2:].all()


def test_what_cannot_be_judged_is_said():
    walk = recording(strength(500))
    with pytest.raises(MagneticError, match="no magnetometer"):
        judge_samples(replace(walk, mag=None))
    with pytest.raises(MagneticError, match="record it faster"):
        judge_samples(recording(strength(20), 2.0))
    with pytest.raises(MagneticError, match="record it faster"):
        judge_samples(replace(walk, mag=np.full_like(walk.mag, np.nan)))


def test_the_window_is_as_long_as_said():
    """One odd sample, at 64 Hz and so at exact times: it counts for 64 samples."""
    odd = strength(500) + 20.0 * (np.arange(500) == 200)
    failed = np.flatnonzero(judge_samples(recording(odd, 64.0)).statistic > 1.0)
    np.testing.assert_array_equal(failed, np.arange(200, 264))
