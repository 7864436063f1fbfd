"""The axes of the magnetometer against the gyroscope: wrong ones are named, right ones never."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import MagneticError
from fg_nav.factors.rotation import rotation_exp
from fg_nav.io import read
from fg_nav.magnetic.axes import (
    MagAxes,
    MagnetometerDelay,
    align_magnetometer,
    estimate_delay,
    field_points_up,
    find_wrong_axes,
    holds_readings,
    remove_delay,
)
from fg_nav.recording import Recording
from tests.magnetic.turning_walks import make_early, minute
from tests.real_data import DATA, needs_data

TEN = ("y,x,-z", "-x,-y,z", "x,-y,-z", "-x,y,-z", "y,z,x", "x,y,-z", "-x,y,z", "y,x,z", "-z,y,x", "x,-z,-y")
"""Five rotations, five mirrors; half turns about the axis about which a foot turns most among them."""


@pytest.mark.parametrize("words", TEN)
@pytest.mark.parametrize(("seed", "field", "lag_s"), [(5, "indoor", 0.022), (6, "smooth", 0.0)])
def test_permutations_and_mirrors_are_named(words, seed, field, lag_s):
    right, axes = minute(seed, lag_s, field), MagAxes.parse(words)
    turned = MagAxes(axes.P.T).apply_to(right)  # what a chip soldered on like this reads
    found = find_wrong_axes(turned)
    assert str(found) == words
    assert ("mirrored" in found.warning) == (np.linalg.det(axes.P) < 0)
    np.testing.assert_array_equal(found.apply_to(turned).mag, right.mag)


def test_right_axes_are_not_accused():
    for field in ("homogeneous", "smooth", "indoor"):
        for lag_s in (0.0, 0.022, 0.08):
            for seed in (1, 5):
                assert find_wrong_axes(minute(seed, lag_s, field)) is None


def test_all_axes_reversed_cannot_be_told_by_turning_but_by_the_vertical_and_too_little_turning_accuses_none():
    recording = minute(5, 0.022)
    reversed_ = MagAxes(-np.eye(3)).apply_to(recording)
    assert find_wrong_axes(reversed_) is None
    assert field_points_up(reversed_)
    up = recording.truth.nav_R_body[:, 2]  # and near the equator the field is level, which is not clearly up
    level = recording.mag - (recording.mag * up).sum(axis=1).mean() * up
    for mag in (recording.mag, level):
        assert not field_points_up(replace(recording, mag=mag))
    wrong = MagAxes.parse("y,x,-z").apply_to(recording)
    assert find_wrong_axes(wrong) is not None
    assert find_wrong_axes(wrong.slice(0, 1500)) is None


def test_axes_are_read_as_they_are_written_and_what_names_none_is_refused():
    assert [str(MagAxes.parse(words)) for words in TEN] == list(TEN)
    assert str(MagAxes.parse("+x, -y, z")) == "x,-y,z"
    for words in ("x,y", "x,y,y", "x,y,w", "", "x,y,--z", "x y z", "x,y,z,x"):
        with pytest.raises(MagneticError, match="names no axes"):
            MagAxes.parse(words)


@needs_data
@pytest.mark.parametrize(
    "name",
    [
        "gdin/own/SensorConnectData_36.csv",
        "gdin/own_obsolete/SensorConnectData_22.csv",
        "openshoe/data_inert1.txt",
        "broad/01_undisturbed_slow_rotation_A.mat",
    ],
)
def test_real_magnetometers_are_not_accused_and_named_where_they_are_turned(name):
    recording = read(DATA / name)
    assert align_magnetometer(recording).wrong_axes is None
    for words in TEN[:4]:
        turned = MagAxes(MagAxes.parse(words).P.T).apply_to(recording)
        assert str(find_wrong_axes(turned)) == words


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 400.0])
def test_a_late_magnetometer_is_found_through_iron_and_building(rate_hz):
    for lag_s in (0.003, 0.022, 0.08):
        found = estimate_delay(minute(5, lag_s, rate_hz=rate_hz))
        assert found.taken_off
        assert found.tau_s == pytest.approx(lag_s, abs=0.001)
        assert found.sigma_s < 0.0005


def test_an_early_magnetometer_is_found_and_without_a_delay_nothing_is_changed():
    for field in ("homogeneous", "smooth", "indoor"):
        found = estimate_delay(make_early(minute(6, 0.0, field), 2))
        assert found.tau_s == pytest.approx(-0.01, abs=0.001)
        assert "early" in str(found)
    recording = minute(7)
    found = estimate_delay(recording)
    assert abs(found.tau_s) < 0.001
    assert not found.taken_off
    assert remove_delay(recording, found) is recording


def test_the_sigma_is_true():
    lags = [0.0, 0.004, 0.012, 0.02] * 2
    error = []
    for seed, lag_s in enumerate(lags):
        found = estimate_delay(minute(seed + 10, lag_s))
        error.append((found.tau_s - lag_s) / found.sigma_s)
    assert 0.4 < np.sqrt(np.mean(np.square(error))) < 1.7


@pytest.mark.parametrize("held", [False, True])
def test_a_slow_magnetometer_is_given_where_it_was_measured_or_between(held):
    """Held readings are up to a period old: what is taken off is that as well."""
    recording, slow = minute(3, 0.0, "smooth"), minute(3, 0.012, "smooth", chip_hz=50.0, held=held)
    assert holds_readings(slow) == held
    found = estimate_delay(slow)
    assert found.tau_s == pytest.approx(0.012, abs=0.002)
    field = remove_delay(slow, found).mag
    known = np.isfinite(field).all(axis=1)
    assert known.mean() == pytest.approx(1.0 if held else 0.25, abs=0.01)
    error, before = (mag[known] - recording.mag[known] for mag in (field, slow.mag))
    assert np.sqrt(np.mean(error**2)) < 0.6  # white noise of both
    assert np.sqrt(np.mean(before**2)) > 1.2


def test_before_the_first_and_after_the_last_reading_and_in_a_gap_nothing_is_invented():
    recording = minute(5, 0.022)
    gap = recording.mag.copy()
    gap[3000:3020] = np.nan
    late, early = (
        remove_delay(replace(recording, mag=gap), MagnetometerDelay(tau, 0.001)).mag for tau in (0.022, -0.022)
    )
    rows = np.arange(len(gap))
    for field, end in ((late, rows[-5:]), (early, rows[:5])):
        missing = np.flatnonzero(~np.isfinite(field).all(axis=1))
        np.testing.assert_array_equal(np.setdiff1d(missing, rows[2900:3100]), end)
    assert np.isnan(late[2996:3020]).all()
    assert np.isfinite(late[2900:2994]).all()


def test_the_field_is_turned_to_the_stamp_exactly_in_a_homogeneous_field():
    t = np.arange(200) / 100.0
    rate = np.array([3.0, -8.0, 5.0])
    attitude = rotation_exp(np.outer(t, rate))
    late = rotation_exp(np.outer(t - 0.013, rate))
    field = np.array([5.0, 20.0, -43.0])
    recording = Recording(
        t, np.tile([0.0, 0.0, 9.8], (200, 1)), np.tile(rate, (200, 1)), np.swapaxes(late, 1, 2) @ field
    )
    given = remove_delay(recording, MagnetometerDelay(0.013, 0.001)).mag
    np.testing.assert_allclose(given[:198], (np.swapaxes(attitude, 1, 2) @ field)[:198], atol=1e-9)


def test_a_sensor_that_hardly_turns_shows_no_delay():
    recording = minute(5, 0.022)
    assert estimate_delay(recording.slice(0, 1500)) is None
    assert estimate_delay(replace(recording, gyr=0.01 * recording.gyr)) is None
    assert estimate_delay(replace(recording, mag=None)) is None


@needs_data
@pytest.mark.parametrize(
    ("name", "low", "high"), [("gdin/own/SensorConnectData_40.csv", 19, 23), ("openshoe/data_inert7.txt", -8, -6)]
)
def test_real_sensors_are_as_late_as_was_measured_otherwise(name, low, high):
    recording = read(DATA / name)
    found = estimate_delay(recording)
    assert low < 1e3 * found.tau_s < high
    left = estimate_delay(remove_delay(recording, found))
    assert abs(left.tau_s) < 0.001
