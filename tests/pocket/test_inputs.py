"""What the filter is given: forces at the stamps, flags, noise, the start; and the heading by the compass."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2, compute_heading, yaw_rotation
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
from fg_nav.pocket.track import COMPASS_SIGMA_DEG, measure_turn, smooth_angles
from tests.pocket.leg import MUNICH, Leg, moved_field, resting, track_of, walking

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


# --- the heading by the compass over all of a walk: tracks that are turned and drift


def turned_track(drift_deg_s=0.0, deviation=0.0, seed=0):
    """Recording and true attitudes of a leg, its track turned clockwise by 40 deg and more; places have own fields."""
    leg = walking(240.0, rate_hz=50.0)
    R, rng = leg.attitude[:-1], np.random.default_rng(seed)
    local = deviation * np.repeat(rng.standard_normal((25, 3)), 500, axis=0)[: len(R)]
    recording = moved_field(leg.recording(field=MUNICH), leg, local)
    clockwise = np.radians(40.0 + drift_deg_s * recording.t)
    return recording, track_of(recording.t, yaw_rotation(-clockwise) @ R), R


def errors_deg(track, attitude):
    off = track.nav_R_body @ np.swapaxes(attitude, 1, 2)
    return np.degrees(np.arctan2(off[:, 1, 0], off[:, 0, 0]))


@pytest.mark.parametrize("drift_deg_s", [0.0, 0.05, 1.2, -1.5], ids=["none", "slow", "lost", "lost the other way"])
def test_a_turned_track_comes_back_to_north(drift_deg_s):
    recording, track, attitude = turned_track(drift_deg_s)
    turn = measure_turn(recording, track)
    found = turn.apply(track)
    assert np.abs(errors_deg(found, attitude)[500:-500]).max() < 1.5  # at the ends a drift is half a block off
    assert min(turn.sigma_at_start, *found.sigma[:, 2]) >= np.radians(COMPASS_SIGMA_DEG)
    np.testing.assert_allclose(found.sigma[0, 2], turn.sigma_at_start)


def test_iron_at_single_places_bends_a_good_track_little():
    bent = []
    for seed in range(5):
        recording, track, attitude = turned_track(deviation=6.0, seed=seed)
        turn = measure_turn(recording, track)
        off = errors_deg(turn.apply(track), attitude)
        assert abs(off.mean()) < 3.0 * np.degrees(turn.sigma).mean() + 1.0
        bent.append(np.abs(off - off.mean()).max())
    assert np.median(bent) < 2.0  # a place alone turns the field by 16
    assert np.max(bent) < 12.0


def test_turned_about_up_it_is_the_same_track_and_without_a_level_field_there_is_none():
    recording, track, _ = turned_track(0.02, deviation=3.0)
    turned = track.rotate(2.0)
    one, other = measure_turn(recording, track), measure_turn(recording, turned)
    np.testing.assert_allclose(one.apply(track).nav_R_body, other.apply(turned).nav_R_body, atol=1e-6)
    for mag in (None, np.nan * recording.mag):
        assert measure_turn(replace(recording, mag=mag), track) is None


def test_the_sigmas_of_a_walk_are_those_of_its_errors():
    rng, miss = np.random.default_rng(0), []
    t = 10.0 * np.arange(40)
    for _ in range(60):
        true = np.cumsum(np.radians(0.3) * 10**0.5 * rng.standard_normal(40))
        seen = true + np.radians(5.0) * rng.standard_normal(40)
        mean, sigma = smooth_angles(t, seen, np.full(40, np.radians(5.0) ** 2))
        miss.append((mean - true) / sigma)
    assert 0.7 < np.sqrt(np.mean(np.square(miss))) < 1.5  # how fast it walks is not known before
