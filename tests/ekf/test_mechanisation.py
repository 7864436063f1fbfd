"""The strapdown step against physics: constant motion, and a foot's motion through its exact means."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import SERIES_BELOW, NavState, rotation_series, strapdown
from tests.ekf.motion import Walk


def state_at(position, velocity, nav_R_body):
    return NavState(np.array(position), np.array(velocity), np.array(nav_R_body), np.zeros(3), np.zeros(3))


def advance(state, acc, gyr, h, gravity=GRAVITY_M_S2):
    turn, push = np.empty((3, 3)), np.empty(3)
    strapdown(state, np.asarray(acc, float), np.asarray(gyr, float), h, gravity, turn, push)
    return turn, push


@pytest.mark.parametrize("h", [0.005, 0.05, 0.7])
def test_constant_rate_and_force_are_exact_in_one_step(h):
    rng = np.random.default_rng(1)
    gyr, acc, velocity = 3 * rng.standard_normal(3), 10 * rng.standard_normal(3), rng.standard_normal(3)
    R0 = Rotation.from_rotvec(rng.standard_normal(3)).as_matrix()
    state = state_at(np.zeros(3), velocity, R0)
    turn, push = advance(state, acc, gyr, h)
    # reference: Gauss-Legendre quadrature of the exactly turning specific force
    node, weight = np.polynomial.legendre.leggauss(40)
    s, weight = h * (node + 1) / 2, h * weight / 2
    turning = R0 @ Rotation.from_rotvec(s[:, None] * gyr).as_matrix()
    g = np.array([0, 0, -GRAVITY_M_S2])
    np.testing.assert_allclose(state.nav_R_body, R0 @ Rotation.from_rotvec(h * gyr).as_matrix(), atol=1e-13)
    np.testing.assert_allclose(turn, np.einsum("k,kij", weight, turning), atol=1e-13)
    np.testing.assert_allclose(push, np.einsum("k,kij,j", weight, turning, acc), atol=1e-12)
    np.testing.assert_allclose(state.velocity, velocity + g * h + push, atol=1e-12)
    fallen = velocity * h + g * h**2 / 2 + np.einsum("k,kij,j", weight * (h - s), turning, acc)
    np.testing.assert_allclose(state.position, fallen, atol=1e-12)


def test_series_and_closed_form_agree_where_they_meet():
    below, above = rotation_series(SERIES_BELOW * (1 - 1e-9)), rotation_series(SERIES_BELOW)
    np.testing.assert_allclose(below, above, rtol=1e-10)
    np.testing.assert_allclose(rotation_series(0.0), (1 / 2, 1 / 6, 1 / 24))


def test_biases_are_taken_off():
    rng = np.random.default_rng(2)
    acc, gyr, gyro_bias, acc_bias = rng.standard_normal((4, 3))
    clean = state_at(np.zeros(3), np.zeros(3), np.eye(3))
    biased = NavState(np.zeros(3), np.zeros(3), np.eye(3), gyro_bias, acc_bias)
    advance(clean, acc, gyr, 0.01)
    advance(biased, acc + acc_bias, gyr + gyro_bias, 0.01)
    for ours, theirs in zip(clean[:3], biased[:3], strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-15)


def test_a_step_back_undoes_a_step():
    rng = np.random.default_rng(3)
    before = (rng.standard_normal(3), rng.standard_normal(3), Rotation.random(rng=rng).as_matrix())
    state = state_at(*before)
    acc, gyr = 10 * rng.standard_normal(3), 5 * rng.standard_normal(3)
    advance(state, acc, gyr, 0.02)
    assert np.abs(state.velocity - before[1]).max() > 0.05
    advance(state, acc, gyr, -0.02)
    for now, then in zip(state[:3], before, strict=True):
        np.testing.assert_allclose(now, then, atol=1e-14)


def test_a_resting_sensor_rests():
    tilted = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    state = state_at(np.zeros(3), np.zeros(3), tilted)
    for _ in range(1000):
        advance(state, tilted.T @ [0, 0, GRAVITY_M_S2], np.zeros(3), 0.005)
    assert np.abs(state.position).max() < 1e-11
    np.testing.assert_allclose(state.nav_R_body, tilted, atol=1e-15)


def test_attitude_stays_a_rotation():
    state, rng = state_at(np.zeros(3), np.zeros(3), np.eye(3)), np.random.default_rng(4)
    for gyr in 8 * rng.standard_normal((20000, 3)):
        advance(state, np.zeros(3), gyr, 0.005)
    np.testing.assert_allclose(state.nav_R_body @ state.nav_R_body.T, np.eye(3), atol=1e-12)


WALK = Walk(strides=3, rest_s=0.2)


def errors_at_the_end(rate_hz):
    """Position, velocity and attitude error after a walk without any correction, from exact means."""
    recording, _ = WALK.recording(rate_hz)
    end = recording.t[-1:] + 1 / rate_hz
    state = state_at(WALK.position(np.zeros(1))[0], np.zeros(3), WALK.attitude(np.zeros(1))[0])
    for acc, gyr in zip(recording.acc, recording.gyr, strict=True):
        advance(state, acc, gyr, 1 / rate_hz)
    off = Rotation.from_matrix(state.nav_R_body @ WALK.attitude(end)[0].T).magnitude()
    return np.array(
        [
            np.linalg.norm(state.position - WALK.position(end)[0]),
            np.linalg.norm(state.velocity - WALK.velocity(end)[0]),
            off,
        ]
    )


def test_a_walk_is_followed_to_second_order_in_the_period():
    coarse, fine = errors_at_the_end(100.0), errors_at_the_end(200.0)
    assert fine[0] < 0.02
    order = np.log2(coarse / fine)
    assert np.all(order > 1.9)
