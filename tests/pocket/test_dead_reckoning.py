"""Length of a step, dead reckoning by steps, and fixes of a receiver, on paths that are known; and their sigmas."""

from dataclasses import replace

import numpy as np
import pytest
from pymap3d import enu2geodetic
from scipy.spatial.transform import Rotation

from fg_nav.errors import EstimationError
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.pipeline import navigate
from fg_nav.pocket import dead_reckoning as reckoning
from fg_nav.pocket.steps import Steps, ThighSwing
from fg_nav.report.files import summarize
from fg_nav.truth import Fix, FixColumns, Gnss, find_turn, select_fixes
from fg_nav.walk import OWN_GNSS, Options, Walk, read_walk
from tests.pocket.leg import track_of
from tests.real_data import DATA, needs_data

OPENINGS = np.radians([0.0, 30.0, 45.0, 50.0, 60.0, 180.0])


def make_steps(opening, took_s=0.53, start=0, samples=50):
    """Steps of these openings (S,) rad, of one duration each."""
    number = np.arange(len(opening))
    begin, took = start + samples * number, np.broadcast_to(took_s, len(opening))
    return Steps(begin, begin + samples, np.asarray(opening), took, number % 2 == 0, np.zeros(len(number), int))


STEPS = make_steps(OPENINGS)


def test_a_length_is_the_mean_of_the_chord_of_two_straight_legs_and_the_walk_ratio():
    feet = np.stack([np.sin(OPENINGS / 2), -np.cos(OPENINGS / 2)], axis=1)
    apart = np.linalg.norm(feet - feet * [-1, 1], axis=1)
    np.testing.assert_allclose(reckoning.compute_chords(OPENINGS), apart, rtol=1e-12)
    unseen = make_steps(np.full(3, np.nan), np.array([0.4, 0.5, 0.6]))
    np.testing.assert_allclose(reckoning.StepLength().predict(unseen), 0.0062 * 60.0 / unseen.took, rtol=1e-12)
    by_cadence = reckoning.measure_steps(make_steps(np.full(len(OPENINGS), np.nan)))
    np.testing.assert_allclose(reckoning.measure_steps(STEPS), 0.5 * (apart + by_cadence), rtol=1e-12)
    assert reckoning.StepLength().predict(make_steps(np.radians([46.0])))[0] == pytest.approx(
        0.70, abs=0.02
    )  # a usual step


def test_a_known_distance_gives_back_the_constant_and_what_no_person_walks_is_refused():
    known = reckoning.StepLength(0.77).predict(STEPS).sum()
    law = reckoning.calibrate_step_length(STEPS, known)
    assert law.constant_m == pytest.approx(0.77)
    assert law.sigma < reckoning.StepLength().sigma
    assert law.predict(STEPS).sum() == pytest.approx(known)
    for distance in (0.0, -3.0, np.nan, np.inf, 1000.0):
        with pytest.raises(EstimationError, match="known distance"):
            reckoning.calibrate_step_length(STEPS, distance)
    with pytest.raises(EstimationError, match="no step"):
        reckoning.calibrate_step_length(make_steps(np.zeros(0)), 10.0)
    for constant in (0.1, 3.0, np.nan):
        with pytest.raises(EstimationError, match="no person's"):
            reckoning.use_step_constant(constant)


# the path

RATE_HZ = 20
STEP = 10  # Samples to a step.
LAW = reckoning.StepLength(0.9, sigma=0.05)


def given(headings, twist_deg=0.0, sigma=0.0):
    """Track, swing and steps of a walk with these headings (S,) rad of its steps, and a twist in each stride."""
    headings = np.asarray(headings, dtype=float)
    n = STEP * (len(headings) + 4)
    body_R_thigh = Rotation.from_rotvec((0.3, -0.8, 2.0)).as_matrix()
    yaw = np.pi / 2 - np.repeat(np.concatenate([[headings[0]] * 2, headings, [headings[-1]] * 2]), STEP)
    yaw += np.radians(twist_deg) * np.sin(2 * np.pi * np.arange(n) / (2 * STEP) + 0.7)
    R = Rotation.from_euler("z", yaw[:, None]).as_matrix().reshape(n, 3, 3) @ body_R_thigh.T
    left, up = body_R_thigh @ [0, 1, 0], body_R_thigh @ [0, 0, 1]
    swing = ThighSwing(left, up, np.tile(up, (n, 1)), np.zeros(n), 0.5, 0.0)
    opening = np.full(len(headings), np.radians(46.0))
    steps = make_steps(opening, STEP / RATE_HZ, start=2 * STEP, samples=STEP)
    return track_of(np.arange(n) / RATE_HZ, R, sigma), swing, steps


def test_a_path_north_and_then_east_whatever_the_twist_of_the_pelvis():
    track, swing, steps = given([0.0] * 30 + [np.pi / 2] * 20)
    path = reckoning.reckon_path(track, swing, steps, LAW)
    length = LAW.predict(steps)[0]
    np.testing.assert_allclose(path.length, length)
    np.testing.assert_allclose(path.position[59], [0.0, 30 * length, 0.0], atol=0.5 * length)
    np.testing.assert_allclose(path.position[-1], [20 * length, 30 * length, 0.0], atol=length)
    np.testing.assert_allclose(path.heading[[0, 20, 40]], [0.0, 0.0, np.pi / 2], atol=1e-9)
    assert (path.sample[1::2] == steps.stop).all()
    assert np.sqrt(path.covariance[-1, 2, 2]) == pytest.approx(reckoning.SLOPE_SIGMA * 50 * length)
    assert np.trace(path.covariance[0]) == 0.0
    plain, twisted = (reckoning.reckon_path(*given([0.4] * 40, twist_deg=twist), LAW) for twist in (0.0, 12.0))
    assert np.degrees(np.abs(twisted.heading - plain.heading)).max() < 0.5


def test_turned_about_up_it_is_the_same_path_turned():
    headings = np.linspace(0.0, 3.0, 40)
    one, other = reckoning.reckon_path(*given(headings), LAW), reckoning.reckon_path(*given(headings + 1.1), LAW)
    turn = Rotation.from_euler("z", -1.1).as_matrix()
    np.testing.assert_allclose(other.position, one.position @ turn.T, atol=1e-9)
    np.testing.assert_allclose(other.covariance, turn @ one.covariance @ turn.T, atol=1e-9)


COURSES = {
    "straight": np.zeros(60),
    "to and fro": np.repeat([0.0, np.pi], 30),
    "round": np.linspace(0.0, 2 * np.pi, 60),
}


@pytest.mark.parametrize("course", COURSES)
def test_the_covariance_is_that_of_the_draws(course):
    """Each source of error drawn as the model has it; heading loses more and more, from 3 to 8 deg."""
    track, swing, steps = given(COURSES[course], sigma=np.radians(np.linspace(3.0, 8.0, 640)))
    path, rng, size = reckoning.reckon_path(track, swing, steps, LAW), np.random.default_rng(3), (4000, 60)
    growth = np.sqrt(np.diff(track.sigma[(steps.start + steps.stop) // 2, 2] ** 2, prepend=0.0))
    drift = np.cumsum(growth * rng.standard_normal(size), axis=1)
    drift += np.radians(reckoning.MOUNTING_SIGMA_DEG) * rng.standard_normal((4000, 1))
    drift += np.radians(reckoning.STEP_HEADING_SIGMA_DEG) * rng.standard_normal(size)
    length = path.length * (
        1 + LAW.sigma * rng.standard_normal((4000, 1)) + reckoning.STEP_SIGMA * rng.standard_normal(size)
    )
    forward = np.stack([np.sin(path.heading), np.cos(path.heading)], axis=1)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    ends = length @ forward + (path.length * drift) @ left
    ratio = np.linalg.eigvals(np.linalg.solve(path.covariance[-1, :2, :2], np.cov(ends.T))).real
    assert 0.85 < ratio.min() < ratio.max() < 1.15


def test_a_sigma_of_heading_that_falls_does_not_take_back_what_was_lost():
    track, swing, steps = given(np.zeros(40), sigma=np.radians(5.0))
    falling = track._replace(sigma=track.sigma * np.linspace(1.0, 0.1, len(track.t))[:, None])
    one, other = (reckoning.reckon_path(one, swing, steps, LAW).covariance[-1] for one in (track, falling))
    np.testing.assert_allclose(other, one, rtol=0.3)


# fixes

TURN, SCALE = np.radians(25.0), 1.12
PLACE = (48.1, 11.5)


def rotate(steps, clockwise):
    c, s = np.cos(clockwise), np.sin(clockwise)
    return np.stack([steps[:, 0] * c + steps[:, 1] * s, steps[:, 1] * c - steps[:, 0] * s], axis=1)


def walk_with_fixes(seed, sigma=3.0, outliers=0.0, every=2, spread=0.0):
    """Times (S + 1,) and steps (S, 2) of a walk, true places (S + 1, 2), turns and log scales (S,), and fixes.

    The truth is turned and longer; both walk, and each step has its own errors, by `spread` times what is assumed.
    """
    rng, n, h = np.random.default_rng(seed), 600, 0.55
    heading = np.cumsum(np.radians(4.0) * rng.standard_normal(n)) + np.repeat(np.arange(6) * np.pi / 3, 100)
    steps = 0.7 * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    sigmas = np.array([np.radians(reckoning.TURN_WALK_DEG) * h**0.5, reckoning.SCALE_WALK * h**0.5])
    turn, scale = np.array([[TURN], [np.log(SCALE)]]) + np.cumsum(
        spread * sigmas[:, None] * rng.standard_normal((2, n)), 1
    )
    own, bent = (
        spread
        * np.array([[reckoning.STEP_SIGMA], [np.radians(reckoning.STEP_HEADING_SIGMA_DEG)]])
        * rng.standard_normal((2, n))
    )
    moved = (np.exp(scale) * (1 + own))[:, None] * rotate(steps, turn + bent)
    true = np.pad(np.cumsum(moved, axis=0), ((1, 0), (0, 0))) + np.array([30.0, -20.0])
    place = true + sigma * rng.standard_normal(true.shape)
    place[rng.random(n + 1) < outliers] += 60.0
    fixes = [Fix(h * k, np.array([*place[k], 0.0]), sigma) for k in range(0, n + 1, every)]
    return h * np.arange(n + 1), steps, np.column_stack([true[:-1], turn, scale]), fixes


@pytest.mark.parametrize("heading_sigma", [np.radians(20.0), np.pi], ids=["compass", "unknown"])
@pytest.mark.parametrize("outliers", [0.0, 0.15])
def test_heading_and_scale_come_back(heading_sigma, outliers):
    t, steps, true, fixes = walk_with_fixes(1, outliers=outliers)
    fixes[40] = replace(fixes[40], position=np.array([500.0, 0.0, 0.0]))
    fused = reckoning.fuse_fixes(t, steps, fixes, heading_sigma, 0.1)
    assert np.degrees(np.mean(fused.turn)) == pytest.approx(25.0, abs=3.0)
    assert np.degrees(fused.turn[0]) == pytest.approx(25.0, abs=8.0)  # smoothed from what came later
    assert np.exp(np.mean(fused.log_scale)) == pytest.approx(SCALE, abs=0.03)
    assert np.linalg.norm((fused.position[:-1] - true[:, :2]), axis=1).mean() < 2.0
    assert fused.weights[40] < 0.1 < 0.7 < np.median(fused.weights)


def test_its_sigmas_are_those_of_its_errors_and_fixes_that_share_an_error_count_as_one(monkeypatch):
    """All errors drawn as modelled, the steps' own large enough to matter."""
    monkeypatch.setattr(reckoning, "STEP_SIGMA", 0.5)
    nees = []
    for seed in range(12):
        t, steps, true, fixes = walk_with_fixes(seed, sigma=0.3, every=20, spread=1.0)  # 11 s apart: independent
        fused = reckoning.fuse_fixes(t, steps, fixes, np.radians(30.0), 0.1)
        off = np.column_stack([fused.position, fused.turn, fused.log_scale])[:-1] - true
        for part in (slice(0, 2), slice(2, 3), slice(3, 4)):
            inverse = np.linalg.inv(fused.covariance[:-1, part, part])
            nees.append(np.einsum("ni,nij,nj->n", off[:, part], inverse, off[:, part])[50::50].mean())
    mean = np.mean(np.reshape(nees, (-1, 3)), axis=0)
    assert 1.5 < mean[0] < 2.5
    assert 0.7 < mean[1:].min() < mean[1:].max() < 1.4
    for apart_s, sigma in ((1.0, 5.0 * 10.0**0.5), (30.0, 5.0)):
        fixes = [Fix(apart_s * k, np.zeros(3), 5.0) for k in range(100)]
        assert select_fixes(fixes, 0.0, 3000.0).sigma == pytest.approx(sigma)


def test_the_turn_is_found_whatever_it_is():
    walked = np.cumsum(np.random.default_rng(0).standard_normal((60, 2)), axis=0) * 5.0
    for turn in np.radians([-170.0, -60.0, 0.0, 95.0]):
        place = rotate(walked, -turn) + np.array([100.0, 7.0])
        place[::9] += 80.0
        found, shift = find_turn(walked, FixColumns(np.arange(60.0), place, np.full(60, 3.0)))
        assert abs(np.angle(np.exp(1j * (found - turn)))) <= np.radians(2.6)  # 72 directions
        assert np.linalg.norm(shift - [100.0, 7.0]) < 3.0


def fixes_of(recording, sigma, seed):
    """Fixes about the true path, one a second, in axes with another origin."""
    at, rng = np.arange(recording.t[0], recording.t[-1]), np.random.default_rng(seed)
    true = np.stack([np.interp(at, recording.truth.t, axis) for axis in recording.truth.position.T], axis=1)
    place = true[:, :2] + sigma * rng.standard_normal((len(at), 2)) + [120.0, -45.0]
    return Gnss(tuple(Fix(float(t), np.array([*xy, 0.0]), sigma) for t, xy in zip(at, place, strict=True)), *PLACE)


@pytest.mark.parametrize("mount", ["pocket", "foot"])
def test_a_simulated_walk_finds_north_and_its_place(mount):
    recording = simulate("calibration-loop", 102, Choices(worn="pocket" if mount == "pocket" else None)).recording
    gnss = fixes_of(recording, 1.5, 4)
    walk = replace(Walk.of(replace(recording, mag=None), Options(mount=mount, alignment="origin")), gnss=gnss)
    found = navigate(walk, "pocket" if mount == "pocket" else "smoother")
    start = found.parameters["gnss_start"]
    assert found.metrics.rmse_2d_m < 1.5  # laid on the truth by its start alone: north is the true one
    assert found.metrics.scale == pytest.approx(1.0, abs=0.05)
    expected = enu2geodetic(*recording.truth.position[0, :2] + [120.0, -45.0], 0.0, *PLACE, 0.0)
    assert [start["latitude_deg"], start["longitude_deg"]] == pytest.approx(expected[:2], abs=4e-5)
    assert "of GNSS" in " ".join(found.notes)
    assert summarize(found.walk, found.outcome)["origin"] == [start["latitude_deg"], start["longitude_deg"], None]


def test_what_cannot_be_is_refused_in_a_sentence():
    t, steps, _, fixes = walk_with_fixes(3)
    late = [replace(fix, time_s=fix.time_s + 1e4) for fix in fixes]
    for few, words in ((fixes[:2], "2 of 2 fixes are within the walk"), (late, "recording's own time")):
        with pytest.raises(EstimationError, match=words):
            reckoning.fuse_fixes(t, steps, few, 0.1, 0.1)
    thigh = simulate("demo", 101, Choices(worn="pocket")).recording
    gnss = fixes_of(thigh, 2.0, 0)
    with pytest.raises(EstimationError, match="not combined"):
        navigate(replace(Walk.of(thigh, Options(mount="pocket")), gnss=gnss, fixes=(gnss.fixes[3],)), "pocket")


@needs_data
def test_a_real_pocket_runs_with_and_without_its_fixes():
    path = DATA / "pocket_gnss" / "pocket_walk_09_001.zip"
    alone = navigate(read_walk(path, Options(mount="pocket")), "pocket")
    assert not any("too low" in words for words in alone.verdict.reasons)
    laid = navigate(read_walk(path, Options(mount="pocket", gnss_path=OWN_GNSS)), "pocket")
    assert laid.metrics.distance_m == pytest.approx(248.0, rel=0.1)
    moved = alone.stances.position[-1, :2] @ [1, 1j], laid.stances.position[-1, :2] @ [1, 1j]
    assert abs(np.degrees(np.angle(moved[0] / moved[1]))) < 25.0  # compass and GNSS: 6 deg of declination among them
