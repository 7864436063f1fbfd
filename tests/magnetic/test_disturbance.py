"""The disturbance detector, sample by sample, on strengths made by hand."""

import numpy as np
import pytest
from scipy.special import chdtr

from fg_nav.lab.field_survey import (
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


def test_a_sensor_that_tumbles_in_a_still_field_passes_and_all_of_a_bump_is_rejected_its_top_included():
    """Two seconds past a lamp: at the top the rate of the strength is nothing."""
    found = judge_samples(recording(strength(1000)))
    assert found.judged[2:].all()
    assert found.quasi_static[2:].all()
    t = np.arange(1000) / RATE_HZ
    for bump_uT in (-5.0, 2.0):
        found = judge_samples(recording(strength(1000) + bump_uT * np.exp(-(((t - 5.0) / 0.6) ** 2))))
        assert not found.quasi_static[np.abs(t - 5.0) < 0.6].any()
        assert found.quasi_static[(t > 0.1) & (t < 3.0)].all()
        assert found.quasi_static[t > 8.0].all()


def test_the_window_is_as_long_as_said_and_no_sample_is_judged_by_later_ones():
    """One odd sample, at 64 Hz and so at exact times: it counts for 64 samples."""
    odd = strength(500) + 20.0 * (np.arange(500) == 200)
    failed = np.flatnonzero(judge_samples(recording(odd, 64.0)).statistic > 1.0)
    np.testing.assert_array_equal(failed, np.arange(200, 264))


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
