"""Filters in the sensor, found by what a walk must show: heel strikes, and gravity that turns with the gyroscope."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from fg_nav.detection import detect_stances
from fg_nav.detection.sensor_processing import measure_high_pass, measure_smoothing, refuse_high_pass
from fg_nav.errors import RecordingError
from fg_nav.lab.simulation import simulate
from fg_nav.recording import Recording


@cache
def walk() -> Recording:
    return replace(simulate("demo", 4).recording, mag=None)


@pytest.mark.parametrize(("cutoff_hz", "is_smoothed"), [(5.0, True), (20.0, False)])
def test_a_low_pass_below_the_heel_strikes_shows(cutoff_hz: float, is_smoothed: bool) -> None:
    sos = butter(2, cutoff_hz, fs=1.0 / walk().period_s, output="sos")
    acc = sosfilt(sos, sosfilt(sos, walk().acc, axis=0), axis=0)
    assert (measure_smoothing(replace(walk(), acc=acc)) > 100.0) == is_smoothed


def test_samples_too_slow_or_too_few_say_nothing_of_heel_strikes() -> None:
    assert np.isnan(measure_smoothing(walk().slice(0, 300)))


@pytest.mark.parametrize("k", [0.03, 0.3])
@pytest.mark.parametrize("bias_deg_s", [0.0, 5.0])
def test_a_high_pass_is_found_with_its_time_constant(k: float, bias_deg_s: float) -> None:
    """y' = w' - k y, stepped exactly; a bias of the sensor goes with it."""
    h, gyr = walk().period_s, walk().gyr + np.radians(bias_deg_s)
    y = np.zeros_like(gyr)
    for i in range(1, len(gyr)):
        y[i] = np.exp(-k * h) * y[i - 1] + gyr[i] - gyr[i - 1]
    passed = replace(walk(), gyr=y)
    found = measure_high_pass(passed, detect_stances(passed))
    assert found.evidence > 14.0
    assert found.rate == pytest.approx(k, rel=0.35)


@pytest.mark.parametrize("bias_deg_s", [0.0, 5.0])
def test_a_gyroscope_without_one_shows_none(bias_deg_s: float) -> None:
    biased = replace(walk(), gyr=walk().gyr + np.radians(bias_deg_s))
    assert measure_high_pass(biased, detect_stances(biased)).evidence < 3.0


def test_a_high_pass_is_refused_with_the_reason() -> None:
    gyr = walk().gyr - np.cumsum(walk().gyr * walk().period_s, axis=0) * 0.03  # to first order
    passed = replace(walk(), gyr=gyr)
    with pytest.raises(RecordingError, match=r"high-pass on its gyroscope: .* switch it off"):
        refuse_high_pass(passed, detect_stances(passed))
    refuse_high_pass(walk(), detect_stances(walk()))
