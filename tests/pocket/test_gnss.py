"""Steps and fixes of a receiver: heading, step constant and path against a truth that is known."""

from dataclasses import replace

import numpy as np
import pytest
from pymap3d import enu2geodetic

from fg_nav.errors import EstimationError
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.pipeline import navigate
from fg_nav.pocket.dead_reckoning import fuse_fixes
from fg_nav.truth import Fix, FixColumns, Gnss, find_turn, select_fixes
from fg_nav.walk import OWN_GNSS, Options, Walk, read_walk
from tests.real_data import DATA, needs_data

TURN, SCALE = np.radians(25.0), 1.12
PLACE = (48.1, 11.5)
ORIGIN = np.array([30.0, -20.0])


def rotate(steps, clockwise):
    c, s = np.cos(clockwise), np.sin(clockwise)
    return steps @ np.array([[c, s], [-s, c]]).T


def walk_with_fixes(rng, sigma=3.0, outliers=0.0, every=2):
    """Times (S + 1,) and steps (S, 2) of a walk, true places (S + 1, 2), and fixes: the truth is turned and longer."""
    heading = np.cumsum(np.radians(4.0) * rng.standard_normal(600)) + np.repeat(np.arange(6) * np.pi / 3, 100)
    steps = 0.7 * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    t = 0.55 * np.arange(601)
    true = np.concatenate([[[0.0, 0.0]], np.cumsum(SCALE * rotate(steps, TURN), axis=0)]) + ORIGIN
    place = true + sigma * rng.standard_normal(true.shape)
    far = rng.random(len(t)) < outliers
    place[far] += 60.0
    fixes = [Fix(float(t[k]), np.array([*place[k], 0.0]), sigma) for k in range(0, len(t), every)]
    return t, steps, true, fixes


@pytest.mark.parametrize("heading_sigma", [np.radians(20.0), np.pi], ids=["compass", "unknown"])
@pytest.mark.parametrize("outliers", [0.0, 0.15])
def test_heading_and_scale_come_back(heading_sigma, outliers):
    t, steps, true, fixes = walk_with_fixes(np.random.default_rng(1), outliers=outliers)
    fixes[40] = replace(fixes[40], position=np.array([500.0, 0.0, 0.0]))
    fused = fuse_fixes(t, steps, fixes, heading_sigma, 0.1)
    assert np.degrees(np.mean(fused.turn)) == pytest.approx(25.0, abs=3.0)
    assert np.degrees(fused.turn[0]) == pytest.approx(25.0, abs=8.0)  # smoothed from what came later
    assert np.exp(np.mean(fused.log_scale)) == pytest.approx(SCALE, abs=0.03)
    assert np.linalg.norm(fused.position - true, axis=1).mean() < 2.0
    assert fused.weights[40] < 0.1 < 0.7 < np.median(fused.weights)


def test_its_sigmas_are_those_of_its_errors():
    nees = []
    for seed in range(12):
        t, steps, true, fixes = walk_with_fixes(np.random.default_rng(seed), sigma=4.0, every=20)  # 11 s: independent
        fused = fuse_fixes(t, steps, fixes, np.radians(30.0), 0.1)
        k = 300
        off = fused.position[k] - true[k]
        nees.append(off @ np.linalg.solve(fused.covariance[k, :2, :2], off))
    assert 0.3 < np.mean(nees) < 4.0  # of two; the walks of turn and scale are wider than this walk's, which has none


def test_fixes_that_share_an_error_count_as_one():
    fixes = [Fix(float(k), np.zeros(3), 5.0) for k in range(100)]
    assert select_fixes(fixes, 0.0, 99.0).sigma == pytest.approx(5.0 * 10.0**0.5)
    sparse = [replace(fix, time_s=30.0 * fix.time_s) for fix in fixes]
    assert select_fixes(sparse, 0.0, 3000.0).sigma == pytest.approx(5.0)


def test_the_turn_is_found_whatever_it_is():
    rng = np.random.default_rng(0)
    walked = np.cumsum(rng.standard_normal((60, 2)), axis=0) * 5.0
    for turn in np.radians([-170.0, -60.0, 0.0, 95.0]):
        place = rotate(walked, -turn) + np.array([100.0, 7.0])
        place[::9] += 80.0
        found, shift = find_turn(walked, FixColumns(np.arange(60.0), place, np.full(60, 3.0)))
        assert abs(np.angle(np.exp(1j * (found - turn)))) <= np.radians(2.6)  # 72 directions
        assert np.linalg.norm(shift - [100.0, 7.0]) < 3.0


@pytest.fixture(scope="module")
def thigh():
    return simulate("calibration-loop", 102, Choices(worn="pocket")).recording


def fixes_of(recording, sigma, rng, every_s=1.0):
    """Fixes about the true path, in axes with another origin."""
    at = np.arange(recording.t[0], recording.t[-1], every_s)
    true = np.stack([np.interp(at, recording.truth.t, axis) for axis in recording.truth.position.T], axis=1)
    place = true[:, :2] + sigma * rng.standard_normal((len(at), 2)) + [120.0, -45.0]
    return Gnss(tuple(Fix(float(t), np.array([*xy, 0.0]), sigma) for t, xy in zip(at, place, strict=True)), *PLACE)


@pytest.mark.parametrize("mount", ["pocket", "foot"])
def test_a_simulated_walk_finds_north_and_its_place(thigh, mount):
    recording = thigh if mount == "pocket" else simulate("calibration-loop", 102).recording
    gnss = fixes_of(recording, 1.5, np.random.default_rng(4))
    walk = replace(Walk.of(replace(recording, mag=None), Options(mount=mount, alignment="origin")), gnss=gnss)
    found = navigate(walk, "pocket" if mount == "pocket" else "smoother")
    start = found.parameters["gnss_start"]
    assert isinstance(start, dict)
    assert found.metrics.rmse_2d_m < 1.5  # laid on the truth by its start alone: north is the true one
    assert found.metrics.scale == pytest.approx(1.0, abs=0.05)
    origin = recording.truth.position[0, :2] + [120.0, -45.0]
    expected = enu2geodetic(*origin, 0.0, *PLACE, 0.0)
    assert start["latitude_deg"] == pytest.approx(expected[0], abs=3e-5)
    assert start["longitude_deg"] == pytest.approx(expected[1], abs=4e-5)
    assert "of GNSS" in " ".join(found.notes)


def test_what_cannot_be_is_refused_in_a_sentence(thigh):
    t, steps, _, fixes = walk_with_fixes(np.random.default_rng(3))
    late = [replace(fix, time_s=fix.time_s + 1e4) for fix in fixes]
    for given, words in ((fixes[:2], "2 of 2 fixes are within the walk"), (late, "recording's own time")):
        with pytest.raises(EstimationError, match=words):
            fuse_fixes(t, steps, given, 0.1, 0.1)
    gnss = fixes_of(thigh, 2.0, np.random.default_rng(0))
    walk = replace(Walk.of(thigh, Options(mount="pocket")), gnss=gnss, fixes=(gnss.fixes[3],))
    with pytest.raises(EstimationError, match="not combined"):
        navigate(walk, "pocket")


@needs_data
def test_a_real_pocket_runs_with_and_without_its_fixes():
    assert DATA is not None
    path = DATA / "pocket_gnss" / "pocket_walk_09_001.zip"
    alone = navigate(read_walk(path, Options(mount="pocket")), "pocket")
    assert not any("too low" in words for words in alone.verdict.reasons)
    laid = navigate(read_walk(path, Options(mount="pocket", gnss_path=OWN_GNSS)), "pocket")
    assert laid.metrics.distance_m == pytest.approx(248.0, rel=0.1)
    moved = alone.stances.position[-1, :2] @ [1, 1j], laid.stances.position[-1, :2] @ [1, 1j]
    assert abs(np.degrees(np.angle(moved[0] / moved[1]))) < 25.0  # compass and GNSS: 6 deg of declination among them
