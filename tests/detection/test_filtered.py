"""Filters in the sensor, found by what a walk must show: heel strikes, and gravity that turns with the gyroscope."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from fg_nav.detection import detect_stances
from fg_nav.detection.sensor_processing import (
    estimate_gyro_delay,
    measure_high_pass,
    measure_smoothing,
    read_rate_at,
    refuse_high_pass,
    remove_gyro_delay,
)
from fg_nav.errors import RecordingError
from fg_nav.lab.simulation import simulate
from fg_nav.recording import Recording


@cache
def walk() -> Recording:
    return replace(simulate("demo", 4).recording, mag=None)


@pytest.mark.parametrize(("cutoff_hz", "is_smoothed"), [(5.0, True), (20.0, False)])
def test_a_low_pass_below_the_heel_strikes_shows(cutoff_hz, is_smoothed):
    sos = butter(2, cutoff_hz, fs=1.0 / walk().period_s, output="sos")
    acc = sosfilt(sos, sosfilt(sos, walk().acc, axis=0), axis=0)
    assert (measure_smoothing(replace(walk(), acc=acc)) > 100.0) == is_smoothed
    assert np.isnan(measure_smoothing(walk().slice(0, 300)))


@pytest.mark.parametrize("bias_deg_s", [0.0, 5.0])
def test_a_high_pass_is_found_with_its_time_constant_and_refused(bias_deg_s):
    """y' = w' - k y, stepped exactly; a bias of the sensor goes with it."""
    h, gyr = walk().period_s, walk().gyr + np.radians(bias_deg_s)
    for k in (0.03, 0.3):
        y = np.zeros_like(gyr)
        for i in range(1, len(gyr)):
            y[i] = np.exp(-k * h) * y[i - 1] + gyr[i] - gyr[i - 1]
        passed = replace(walk(), gyr=y)
        stances = detect_stances(passed)
        found = measure_high_pass(passed, stances)
        assert found.evidence > 14.0
        assert found.rate == pytest.approx(k, rel=0.35)
        with pytest.raises(RecordingError, match=r"high-pass on its gyroscope: .* switch it off"):
            refuse_high_pass(passed, stances)
    plain = replace(walk(), gyr=gyr)
    assert measure_high_pass(plain, detect_stances(plain)).evidence < 3.0
    refuse_high_pass(plain, detect_stances(plain))


def test_a_late_or_early_gyroscope_is_found_and_taken_off():
    for delay_s in (0.025, -0.03):
        late = replace(walk(), gyr=read_rate_at(walk().t, walk().gyr, -delay_s))
        found = estimate_gyro_delay(late)
        assert found.tau_s == pytest.approx(delay_s, abs=4.0 * found.sigma_s)  # of 16 walks the worst is 3.6 off
        assert found.sigma_s < 0.005
        assert found.is_clear
        assert "taken off" in remove_gyro_delay(late).provenance.notes[-1]
    assert remove_gyro_delay(walk()) is walk()
