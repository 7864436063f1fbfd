"""The demonstration walk is physics: kinematics agree with each other and with how a foot moves."""

import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2, heading_of
from fg_nav.recording import TrajectoryTruth
from fg_nav.simulation import demo_walk
from fg_nav.simulation.demo import STANDING_S, demo_motion
from fg_nav.simulation.gait import FootMotion, Kinematics
from fg_nav.stances import runs

SEED = 7


@pytest.fixture(scope="module")
def walk() -> tuple[FootMotion, float]:
    return demo_motion(np.random.default_rng(SEED))


@pytest.fixture(scope="module")
def dense(walk: tuple[FootMotion, float]) -> tuple[np.ndarray, Kinematics]:
    motion, duration_s = walk
    t = np.arange(0.0, duration_s, 1e-3)
    return t, motion.at(t)


def integrate(motion: FootMotion, duration_s: float, rate_hz: float) -> tuple[float, float, float]:
    """Largest error of attitude (deg), velocity (m/s), position (m) with steps of constant rate and force."""
    dt = 1 / rate_hz
    t = np.arange(round(duration_s * rate_hz)) * dt
    rate, force = motion.sampled(t, dt)
    truth = motion.at(np.append(t, t[-1] + dt))
    turn = Rotation.from_rotvec(rate * dt).as_matrix()
    # first and second integral of the turned force over a step, by Gauss-Legendre: exact to 1e-12 here
    node, weight = np.polynomial.legendre.leggauss(4)
    tau, weight = (node + 1) / 2, weight / 2
    inner = np.stack([Rotation.from_rotvec(rate * dt * u).apply(force) for u in tau])
    push = np.einsum("q,qni->ni", weight, inner) * dt
    shift = np.einsum("q,qni->ni", weight * (1 - tau), inner) * dt**2
    nav_R_body = np.empty((len(t) + 1, 3, 3))
    nav_R_body[0] = truth.nav_R_body[0]
    for i, step in enumerate(turn):
        nav_R_body[i + 1] = nav_R_body[i] @ step
    gravity = np.array([0.0, 0.0, -GRAVITY_M_S2])
    dv = np.einsum("nij,nj->ni", nav_R_body[:-1], push) + gravity * dt
    velocity = truth.velocity[0] + np.vstack([np.zeros(3), np.cumsum(dv, axis=0)])
    dp = velocity[:-1] * dt + np.einsum("nij,nj->ni", nav_R_body[:-1], shift) + gravity * dt**2 / 2
    position = truth.position[0] + np.vstack([np.zeros(3), np.cumsum(dp, axis=0)])
    attitude_error = Rotation.from_matrix(np.einsum("nij,nkj->nik", nav_R_body, truth.nav_R_body)).magnitude()
    return (
        float(np.rad2deg(attitude_error.max())),
        float(np.linalg.norm(velocity - truth.velocity, axis=1).max()),
        float(np.linalg.norm(position - truth.position, axis=1).max()),
    )


def test_integration_reproduces_the_truth_to_second_order(walk: tuple[FootMotion, float]) -> None:
    motion, duration_s = walk
    errors = np.array([integrate(motion, duration_s, hz) for hz in (100.0, 200.0, 400.0)])
    ratio = errors[:-1] / errors[1:]
    assert np.all((ratio > 3.5) & (ratio < 4.5)), (errors, ratio)
    attitude_deg, velocity, _ = errors[-1]
    assert attitude_deg < 0.2
    assert velocity < 0.05  # in a minute, from samples without noise


def test_rate_and_force_are_the_derivatives_of_the_pose(walk: tuple[FootMotion, float]) -> None:
    motion, _ = walk
    t, h = np.random.default_rng(0).uniform(STANDING_S, 20.0, 500), 1e-4
    before, now, after = (motion.at(t + o) for o in (-h, 0.0, h))
    velocity = (after.position - before.position) / (2 * h)
    acceleration = (after.position - 2 * now.position + before.position) / h**2
    turn = Rotation.from_matrix(np.einsum("nji,njk->nik", before.nav_R_body, after.nav_R_body)).as_rotvec()
    force = np.einsum("nji,nj->ni", now.nav_R_body, acceleration + np.array([0, 0, GRAVITY_M_S2]))
    np.testing.assert_allclose(now.velocity, velocity, atol=1e-4)
    np.testing.assert_allclose(now.rate, turn / (2 * h), atol=1e-4)
    np.testing.assert_allclose(now.force, force, atol=2e-2)


def test_foot_moves_like_a_foot(dense: tuple[np.ndarray, Kinematics]) -> None:
    _, state = dense
    pitch_deg = np.rad2deg(np.arcsin(-state.nav_R_body[:, 2, 0]))
    assert -30 < pitch_deg.min() < -20
    assert 55 < pitch_deg.max() < 65
    assert 400 < np.rad2deg(np.abs(state.rate[:, 1]).max()) < 600
    assert 20 < np.linalg.norm(state.force, axis=1).max() < 80
    assert 4 < np.linalg.norm(state.velocity, axis=1).max() < 6.5
    rise = np.ptp(state.position[:, 2])
    assert 0.1 < rise < 0.25


@pytest.mark.parametrize("point", [(0.16, 0.0, 0.0), (-0.10, 0.0, 0.0)], ids=["toe", "heel"])
def test_toe_and_heel_stay_above_the_floor(
    walk: tuple[FootMotion, float], dense: tuple[np.ndarray, Kinematics], point: tuple[float, float, float]
) -> None:
    motion, (_, state) = walk[0], dense
    height = (state.position + state.nav_R_body @ (np.array(point) - motion.lever))[:, 2]
    assert height.min() > -0.006  # a sole gives way by that much
    assert height.max() > 0.05


@pytest.fixture(scope="module")
def flat(walk: tuple[FootMotion, float], dense: tuple[np.ndarray, Kinematics]) -> tuple[np.ndarray, np.ndarray]:
    """Pivot (N, 3) m, and whether the foot is flat in a stance of the walk: its pivot neither swings nor lifts."""
    motion, (t, state) = walk[0], dense
    pivot = state.position - state.nav_R_body @ motion.lever
    velocity = np.gradient(pivot, t, axis=0)
    walking = (t > STANDING_S) & (t < t[-1] - STANDING_S)
    slow = (np.linalg.norm(velocity[:, :2], axis=1) < 1e-6) & (velocity[:, 2] < 0) & (velocity[:, 2] > -0.02)
    return pivot, walking & slow & (pivot[:, 2] < 0.01)


def test_in_stance_the_foot_rolls_slowly_about_a_pivot_that_sinks(
    walk: tuple[FootMotion, float], dense: tuple[np.ndarray, Kinematics], flat: tuple[np.ndarray, np.ndarray]
) -> None:
    motion, (t, state) = walk[0], dense
    pivot, stands = flat
    walking = (t > STANDING_S) & (t < t[-1] - STANDING_S)
    assert 0.33 < stands.sum() / walking.sum() < 0.45
    rolling = np.cross(state.rate, motion.lever)
    settling = np.gradient(pivot, t, axis=0)[stands]
    moving = np.einsum("nij,nj->ni", state.nav_R_body, rolling)[stands]
    np.testing.assert_allclose(state.velocity[stands] - moving, settling, atol=3e-4)
    assert np.all(settling[:, 2] < 0)
    assert 0.001 < np.sqrt(np.mean((moving**2).sum(axis=1))) < 0.015
    assert 1 < np.rad2deg(np.linalg.norm(state.rate, axis=1))[stands].mean() < 5


def test_sole_gives_way_under_load_and_springs_back(
    dense: tuple[np.ndarray, Kinematics], flat: tuple[np.ndarray, np.ndarray]
) -> None:
    (t, _), (pivot, stands) = dense, flat
    height = pivot[:, 2]
    start, stop = runs(stands)
    long = stop - start > 150
    start, stop = start[long], stop[long]
    assert len(start) == 61
    sunk = height[start] - height[stop - 1]
    assert 0.0013 < sunk.mean() < 0.0018
    assert 0.0003 < sunk.std() < 0.0007
    quarter = (stop - start) // 4
    speed = (height[start + quarter] - height[stop - quarter]) / (t[stop - quarter] - t[start + quarter])
    assert 0.004 < np.median(speed) < 0.008
    # what is lost in a stance comes back before the next one: no stride begins lower than it should
    np.testing.assert_allclose(height[start][1:], np.median(height[start]), atol=5e-4)


def test_a_foot_that_stands_on_stays_pressed(
    dense: tuple[np.ndarray, Kinematics], flat: tuple[np.ndarray, np.ndarray]
) -> None:
    (t, state), (pivot, _) = dense, flat
    for standing in (t < STANDING_S, t > t[-1] - STANDING_S + 0.1):
        assert np.ptp(state.position[standing], axis=0).max() < 1e-9
    assert pivot[-1, 2] == pytest.approx(pivot[0, 2], abs=1e-9)


def test_walk_is_a_closed_loop_with_corners() -> None:
    recording = demo_walk(np.random.default_rng(SEED))
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    assert 60 < recording.duration_s < 90
    np.testing.assert_allclose(truth.position[-1], truth.position[0], atol=1e-3)
    np.testing.assert_allclose(truth.nav_R_body[-1], truth.nav_R_body[0], atol=1e-3)
    assert 60 < np.linalg.norm(np.diff(truth.position[:, :2], axis=0), axis=1).sum() < 85
    heading_deg = np.rad2deg(np.unwrap(heading_of(truth.nav_R_body)))
    assert heading_deg[0] == pytest.approx(0.0, abs=1e-6)
    assert heading_deg[-1] == pytest.approx(360.0, abs=1e-6)


def test_standing_sensor_feels_gravity_its_biases_and_its_noise() -> None:
    recording = demo_walk(np.random.default_rng(SEED))
    standing = recording.t < STANDING_S - 0.1
    acc, gyr = recording.acc[standing], recording.gyr[standing]
    assert np.linalg.norm(acc.mean(axis=0)) == pytest.approx(GRAVITY_M_S2, abs=0.06)
    np.testing.assert_allclose(acc.std(axis=0), 0.03, rtol=0.2)
    np.testing.assert_allclose(np.rad2deg(gyr).std(axis=0), 0.1, rtol=0.2)
    assert 0.02 < np.rad2deg(np.linalg.norm(gyr.mean(axis=0))) < 0.4
    assert recording.mag is not None
    np.testing.assert_allclose(np.linalg.norm(recording.mag, axis=1), np.hypot(20, 44), atol=2.0)


def test_seed_decides_the_walk_and_it_is_quick() -> None:
    start = time.perf_counter()
    first = demo_walk(np.random.default_rng(SEED))
    assert time.perf_counter() - start < 1.0
    again, other = demo_walk(np.random.default_rng(SEED)), demo_walk(np.random.default_rng(SEED + 1))
    np.testing.assert_array_equal(first.acc, again.acc)
    assert len(other) != len(first) or not np.array_equal(other.acc, first.acc)
    assert demo_walk(np.random.default_rng(SEED), rate_hz=100.0).period_s == pytest.approx(0.01)
