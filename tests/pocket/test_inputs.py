"""What the filter is given: forces at the stamps, flags of force and field, noise of the magnetometer, the start."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2, compute_heading
from fg_nav.pocket import compass_start, level_start
from fg_nav.pocket import filter as pocket_filter
from fg_nav.pocket.filter import (
    average_force,
    detect_gravity,
    detect_steady_field,
    estimate_field_noise_uT,
    interpolate_force,
    thin_flags,
)
from tests.pocket.leg import Leg, resting, walking

LEG = walking(10.0)
GRAVITY = GRAVITY_M_S2 * LEG.attitude[:-1, 2]
T = np.arange(3000) / 100.0
SIGMA_UT = 0.015


def test_a_force_is_gravity_at_its_stamp_and_a_mean_is_that_at_its_end_whatever_velocity_comes_back():
    recording = LEG.recording(bias=np.zeros(3))
    assert np.abs(interpolate_force(recording.acc) - GRAVITY)[1:].max() < 0.02
    assert np.abs(recording.acc - GRAVITY).max() > 0.15  # half a period late
    force = average_force(recording, 100)
    assert np.isnan(force[:100]).all()
    assert np.abs(force - GRAVITY)[100:].max() < 0.005
    # accelerations at the cadence, of 5 m/s^2, over a window of two strides
    push = 5.0 * np.sin(2 * np.pi * recording.t)[:, None] * np.array([1.0, 0.5, 0.3])
    recording.acc[:] += np.einsum("nji,nj->ni", LEG.attitude[:-1], push)
    assert np.abs(average_force(recording, 200) - GRAVITY)[200:].max() < 0.1
    assert np.abs(interpolate_force(recording.acc) - GRAVITY).max() > 4.0


def test_a_bias_turns_the_mean_by_half_its_window():
    bias = np.array([0.02, -0.01, 0.02])
    pitched = Leg(np.tile(LEG.attitude[200], (1001, 1, 1)), 0.01)
    force, up = average_force(pitched.recording(bias=bias), 100)[-1], GRAVITY_M_S2 * LEG.attitude[200, 2]
    assert np.allclose(force, up - 0.5 * np.cross(bias, up), atol=2e-3)
    assert np.abs(force - up).max() > 0.01


def test_gravity_counts_once_it_has_lasted_and_flags_are_thinned_to_a_period():
    acc = np.tile([0.0, 0.0, 9.81], (len(T), 1))
    acc[100:200] *= 1.1
    acc[300] *= 1.1
    acc[400:450] = np.nan
    found = detect_gravity(T, acc)
    for first, last in ((0, 100), (200, 300), (301, 400), (450, 3000)):
        assert not found[first : first + 4].any()
        assert found[first + 4 : last].all()  # the fifth sample of 10 ms
    assert not found[[*range(100, 200), *range(400, 450)]].any()
    flags = np.ones(100, dtype=bool)
    flags[15:17] = False
    assert np.array_equal(np.flatnonzero(thin_flags(0.1 * np.arange(100), flags, 0.5))[:5], [0, 5, 10, 17, 22])
    assert thin_flags(T[:100], flags, 0.0).sum() == 98


def test_noise_alone_fails_as_often_as_said(monkeypatch):
    rng = np.random.default_rng(1)
    monkeypatch.setattr(pocket_filter, "FIELD_DRIFT_UT_S", 0.0)
    monkeypatch.setattr(pocket_filter, "FIELD_FALSE_ALARM", 0.05)
    t = np.arange(200_000) / 100.0
    steady = detect_steady_field(t, [20.0, 0.0, -43.0] + SIGMA_UT * rng.standard_normal((len(t), 3)), SIGMA_UT)
    assert 1.0 - steady[49:].mean() == pytest.approx(0.05, abs=0.01)


def test_a_field_may_change_so_fast_and_no_faster_and_only_a_strength_that_changes_is_seen_and_forgotten():
    for drift, passes in ((0.45, True), (0.6, False)):
        steady = detect_steady_field(T, np.stack([0 * T, 0 * T, -40.0 - drift * T], axis=1), 1e-6)[49:]
        assert steady.all() == steady.any() == passes
    mag = 48.0 * np.stack([np.sin(T), np.cos(T), 0 * T], axis=1)  # a field that turns is steady
    mag *= 1.0 + 0.1 * np.exp(-(((T[:, None] - 15.0) / 0.5) ** 2))  # a passing object
    mag[1::2] = np.nan  # rows without one are left out
    steady = detect_steady_field(T, mag, SIGMA_UT)
    assert not steady[[*range(1, 3000, 2), *range(48), *range(1450, 1550)]].any()
    assert steady[60:1300:2].all()
    assert steady[1800::2].all()


def test_the_noise_of_the_magnetometer_is_estimated_at_rest_and_while_the_leg_swings():
    for seed, leg in enumerate((resting(30.0), walking(30.0))):
        for sigma_uT in (0.05, 0.5):
            recording = leg.recording(sigma=(0.0, 0.0, sigma_uT), seed=seed)
            assert 0.85 * sigma_uT < estimate_field_noise_uT(recording) < 1.3 * np.hypot(sigma_uT, 0.1)
    exact = resting(5.0).recording()  # of which the sigma has a floor
    assert estimate_field_noise_uT(exact) == estimate_field_noise_uT(replace(exact, mag=None)) == 0.015


@pytest.mark.parametrize("angles", [(0.3, 0.1, -0.2), (2.0, -1.2, 3.0), (-1.0, -np.pi / 2, 0.0)])
def test_a_sensor_at_rest_is_levelled_and_the_compass_finds_north(angles):
    leg = resting(5.0, angles=angles)
    start = compass_start(leg.recording())
    assert np.allclose(start.nav_R_body, leg.attitude[0], atol=1e-6)
    assert start.heading_sigma == pytest.approx(np.radians(10.0))  # a compass near houses


def test_heading_given_declination_and_tilt_of_the_start_and_what_has_none():
    rest, moving = resting(5.0).recording(), walking(10.0, still_s=0.0).recording()
    there, here = (compute_heading(compass_start(rest, declination=d).nav_R_body) for d in (0.1, 0.0))
    assert there - here == pytest.approx(0.1)
    level = level_start(rest, heading=1.2)
    assert compute_heading(level.nav_R_body) == pytest.approx(1.2)
    assert level_start(moving).tilt_sigma > 5 * level.tilt_sigma
    with pytest.raises(EstimationError, match="no magnetometer in the first 1 s to begin with: give the heading"):
        compass_start(replace(rest, mag=None))
    with pytest.raises(EstimationError, match=r"is 0.10 m/s\^2, so there is no up"):
        level_start(replace(rest, acc=0.01 * rest.acc))
