"""The heading by the compass over all of a walk: tracks that are turned and drift, in a field that is known."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.frames import yaw_rotation
from fg_nav.pocket.track import COMPASS_SIGMA_DEG, measure_turn, smooth_angles
from tests.pocket.leg import MUNICH, moved_field, track_of, walking


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
