"""Two sensors that send at once, a sensor that is worn elsewhere, and filters in the sensor, are seen."""

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
from fg_nav.detection.source import AxesCheck, SourceCheck
from fg_nav.errors import EstimationError, RecordingError, StreamError
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online.buffer import rows_of


@pytest.fixture(scope="module")
def feet():
    """Rows of a foot and of the thigh of another walk, 100 Hz."""
    walks = [simulate("demo", seed, Choices(worn=worn, rate_hz=100.0)) for seed, worn in ((104, None), (105, "pocket"))]
    return [rows_of(walk.recording)[:3000] for walk in walks]


def check(rows, mount="foot"):
    """Look at rows in blocks; the remarks."""
    remarks = []
    looks = SourceCheck(mount, remarks.append)
    for start in range(0, len(rows), 61):
        looks.push(rows[start : start + 61])
    return remarks


def alternate(one, other, length):
    """Rows of two, so many of each in turn."""
    return np.concatenate([piece[k : k + length] for k in range(0, len(one), length) for piece in (one, other)])


def test_one_sensor_passes_where_it_is_said_to_be_worn_and_nowhere_else(feet):
    foot, thigh = feet
    assert check(foot) == check(thigh, "pocket") == []
    for rows, mount, words in ((thigh, "foot", "add --mount pocket"), (foot, "pocket", "leave --mount pocket out")):
        with pytest.raises(EstimationError, match=words):
            check(rows, mount)


@pytest.mark.parametrize("length", [1, 10])
@pytest.mark.parametrize("offset", [0.0, 0.0031, 412.7])
@pytest.mark.parametrize("begin", [0, 1200])
def test_two_sensors_are_refused(feet, length, offset, begin):
    """Standing or walking, row by row or in datagrams, with one clock or two."""
    one, other = (rows[begin:].copy() for rows in feet)
    other[:, 0] += offset
    with pytest.raises(StreamError, match=r"^[^\n]*two sensors[^\n]*$"):
        check(alternate(one, other, length))


def test_two_sensors_late_in_a_walk_are_remarked(feet):
    before, later = np.concatenate([feet[0]] * 3), alternate(*feet, 1)
    before[:, 0] = np.arange(len(before)) / 100.0
    later[:, 0] += before[-1, 0]
    (remark,) = check(np.concatenate([before, later]))
    assert "two sensors" in remark


def test_rows_that_a_network_delays_or_sends_twice_and_a_clock_that_restarts_are_of_one_sensor(feet):
    rng, rows = np.random.default_rng(2), feet[0]
    late = rows[:, 0] + rng.choice([0.0, 0.05], len(rows), p=[0.9, 0.1])
    again, absurd = rows.copy(), rows.copy()
    again[1000:, 0] -= 9.0
    absurd[::7, 1:7] = [1e200, -1e308, 1e38, 1e300, np.inf, -1e200]  # no samples
    with np.errstate(all="raise"):
        for one in (rows[np.argsort(late, kind="stable")], np.repeat(rows, 2, axis=0), again, absurd):
            assert check(one) == []


def test_of_a_clock_that_hardly_goes_nothing_is_kept(feet):
    slow = np.tile(feet[0][:200], (1600, 1))
    for t in (np.arange(len(slow)) * 1e-5, np.full(len(slow), 3.0)):
        looks = SourceCheck("foot", print)
        looks.push(np.column_stack([t, slow[:, 1:]]))
        assert looks._seen == []


# filters, found by what a walk must show: heel strikes, and gravity that turns with the gyroscope


@cache
def walk():
    return replace(simulate("demo", 4).recording, mag=None)


def test_a_low_pass_below_the_heel_strikes_shows():
    for cutoff_hz, is_smoothed in ((5.0, True), (20.0, False)):
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


@pytest.mark.timeout(30)
def test_stamps_among_which_seconds_are_lost_in_rounding_are_passed_over() -> None:
    check = AxesCheck(pytest.fail)
    check.push(np.column_stack([np.full(30, 1e18), np.ones((30, 6))]))  # no block of theirs ever ended
    assert check.evidence.strides == 0
