"""The strapdown step against physics: constant motion, and a foot's motion through its exact means."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import (
    SERIES_BELOW,
    NavState,
    nudge_tilt,
    rotate_in_body,
    rotation_about,
    rotation_series,
    strapdown,
)
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
    # biases are taken off, and a step back undoes a step
    gyro_bias, acc_bias = rng.standard_normal((2, 3))
    biased = NavState(np.zeros(3), velocity.copy(), R0.copy(), gyro_bias, acc_bias)
    advance(biased, acc + acc_bias, gyr + gyro_bias, h)
    advance(state, acc, gyr, -h)
    for now, then in zip(state[:3], (np.zeros(3), velocity, R0), strict=True):
        np.testing.assert_allclose(now, then, atol=1e-12)
    np.testing.assert_allclose(biased.position, fallen, atol=1e-12)
    np.testing.assert_allclose(biased.nav_R_body, R0 @ Rotation.from_rotvec(h * gyr).as_matrix(), atol=1e-13)


def test_series_and_closed_form_agree_where_they_meet():
    below, above = rotation_series(SERIES_BELOW * (1 - 1e-9)), rotation_series(SERIES_BELOW)
    np.testing.assert_allclose(below, above, rtol=1e-10)
    np.testing.assert_allclose(rotation_series(0.0), (1 / 2, 1 / 6, 1 / 24))


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


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.05, 0.1, 0.11, 1.0, 3.1, 20.0])
def test_a_rotation_in_the_body_frame(angle):
    rng = np.random.default_rng(5)
    R0 = Rotation.random(rng=rng).as_matrix()
    axis = rng.standard_normal(3)
    rotvec = angle * axis / np.linalg.norm(axis)
    R = R0.copy()
    rotate_in_body(R, *rotvec)
    np.testing.assert_allclose(R, R0 @ Rotation.from_rotvec(rotvec).as_matrix(), atol=1e-13)
    np.testing.assert_allclose(rotation_about(rotvec), Rotation.from_rotvec(rotvec).as_matrix(), atol=1e-13)


def tilted(tilt, heading=0.4):
    """An attitude, and the specific force at rest if its true attitude has this rotation vector more."""
    R = Rotation.from_euler("ZYX", [heading, 0.3, -0.2]).as_matrix()
    true = Rotation.from_rotvec([*tilt, 0.0]).as_matrix() @ R
    return R, true, true.T @ [0.0, 0.0, GRAVITY_M_S2]


def tilt_error(R, force):
    """Angle between the force in the navigation frame and the vertical."""
    up = R @ force / np.linalg.norm(force)
    return np.arctan2(np.linalg.norm(up[:2]), up[2])


@pytest.mark.parametrize("gain", [0.02, 0.3, 1.0])
@pytest.mark.parametrize("tilt", [(0.05, 0.0), (-0.02, 0.04)])
def test_a_nudge_takes_off_its_share_of_the_tilt_about_a_level_axis(tilt, gain):
    """So the heading stays, but for what tilt and heading have to do with each other: of second order."""
    R, _, force = tilted(tilt)
    start, before = R.copy(), tilt_error(R, force)
    assert before == pytest.approx(np.hypot(*tilt))
    nudge_tilt(R, force, gain)
    assert tilt_error(R, force) == pytest.approx((1 - gain) * before, abs=1e-3 * before + before**3)
    turned = Rotation.from_matrix(R @ start.T).as_rotvec()
    assert np.linalg.norm(turned[:2]) == pytest.approx(gain * before, rel=0.01)
    assert abs(turned[2]) < before**2


def test_many_nudges_level_from_any_tilt_and_a_level_attitude_and_free_fall_are_left_alone():
    R, true, force = tilted((1.8, -1.4))
    level, falling = true.copy(), R.copy()
    nudge_tilt(level, force, 0.5)
    nudge_tilt(falling, np.zeros(3), 0.5)
    np.testing.assert_allclose(level, true, atol=1e-15)
    np.testing.assert_allclose(falling, R, atol=1e-15)
    R += 1e-4 * np.random.default_rng(6).standard_normal((3, 3))  # and from a matrix that drifted
    assert tilt_error(R, force) > 2.0
    for _ in range(600):
        nudge_tilt(R, 3.0 * force, 0.02)  # however strong the force is
    assert tilt_error(R, force) < 1e-3
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
