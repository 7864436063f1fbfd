"""The two updates against finite differences, the textbook's matrix form, and each other."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.mechanisation import cross_matrix, right_jacobian
from fg_nav.pocket.belief import PocketState, belief_of, blank_chain
from fg_nav.pocket.difference import begin, lengthen, rebias
from fg_nav.pocket.euler import axes, inverse_axes, rotation_of
from fg_nav.pocket.parameters import PocketParameters
from fg_nav.pocket.prediction import predict
from fg_nav.pocket.updates import absolute_gravity, differential_field, expected_field

TRUTH = rotation_of(np.array([0.4, -0.6, 1.1]))
FORCE = 9.8 * TRUTH[2]
TILTED = Rotation.from_rotvec([0.001, -0.002, 0.3]).as_matrix() @ TRUTH
SAMPLES = PocketParameters(gravity_window_s=0.0)
P0 = np.diag([0.1, 0.1, 0.1, 0.01, 0.01, 0.01]) ** 2


def some_covariance(seed=0):
    root = np.random.default_rng(seed).normal(size=(6, 6))
    return 1e-4 * (root @ root.T + np.eye(6))


def gradient(residual, n=6, step=1e-6):
    return np.array([(residual(step * e) - residual(-step * e)) / (2 * step) for e in np.eye(n)]).T


def textbook(P, H, R, z):
    """State correction and covariance of z = H x + n."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return K @ z, (np.eye(6) - K @ H) @ P


@pytest.mark.parametrize("window", [0.0, 1.0])
def test_gravity_corrects_as_the_textbook_with_finite_differences(window):
    parameters = replace(SAMPLES, gravity_window_s=window, acc_sigma_m_s2=0.2)
    tilted, bias, P = TILTED, np.array([1e-3, 2e-3, -1e-3]), some_covariance()

    def horizontal(x):
        """What of the specific force is level, in the estimate's nav; a mean is half a window old."""
        body = Rotation.from_rotvec((bias + x[3:]) * window / 2).as_matrix() @ (FORCE / 9.8)
        return (Rotation.from_rotvec(x[:3]).as_matrix() @ tilted @ body)[:2]

    noise = (0.2 / 9.8) ** 2 * np.eye(2)
    x, after = textbook(P, gradient(horizontal), noise, horizontal(np.zeros(6)))
    state = PocketState(tilted.copy(), bias.copy(), P.copy())
    absolute_gravity(state, blank_chain(), FORCE, belief_of(parameters))
    assert np.allclose(state.P, after, atol=3e-3 * after.max())
    assert np.allclose(state.gyro_bias - bias, -x[3:], atol=2e-2 * np.abs(x[3:]).max())
    assert np.allclose(state.nav_R_body, Rotation.from_rotvec(-x[:3]).as_matrix() @ tilted, atol=2e-5)


def test_angles_and_rotations_are_the_same_filter_to_first_order():
    """Eq. 14 in angles with the accelerometer's noise through Eq. 12 and 13, against the level part in nav."""
    tilted = Rotation.from_rotvec([2e-4, -3e-4, 1e-4]).as_matrix() @ TRUTH
    P = some_covariance(1)
    E = np.eye(6)
    E[:3, :3] = inverse_axes(tilted)
    free = PocketState(tilted.copy(), np.zeros(3), P.copy())
    angles = PocketState(tilted.copy(), np.zeros(3), E @ P @ E.T)
    nis = [
        absolute_gravity(s, blank_chain(), FORCE, belief_of(replace(SAMPLES, euler_state=euler)))
        for s, euler in ((free, False), (angles, True))
    ]
    assert nis[0] == pytest.approx(nis[1], rel=1e-2)
    assert np.allclose(free.nav_R_body, angles.nav_R_body, atol=1e-6)
    assert np.allclose(free.gyro_bias, angles.gyro_bias, atol=1e-6)
    E[:3, :3] = axes(tilted)
    assert np.allclose(free.P, E @ angles.P @ E.T, rtol=1e-3, atol=1e-8)


@pytest.mark.parametrize("euler", [False, True])
def test_gravity_levels_and_leaves_the_heading_alone(euler):
    parameters = replace(SAMPLES, euler_state=euler, acc_sigma_m_s2=1e-3)
    tilted = Rotation.from_rotvec([0.02, -0.03, 0.0]).as_matrix() @ TRUTH
    P = P0.copy()
    if euler:
        E = inverse_axes(tilted)
        P[:3, :3] = E @ P[:3, :3] @ E.T
    state = PocketState(tilted.copy(), np.zeros(3), P)
    absolute_gravity(state, blank_chain(), FORCE, belief_of(parameters))
    assert np.allclose(state.nav_R_body[2], TRUTH[2], atol=2e-3)
    left = Rotation.from_matrix(state.nav_R_body @ TRUTH.T).as_rotvec()
    assert abs(left[2]) < 2e-3


def test_the_field_corrects_as_the_textbook_in_three_rows():
    """The two rows are the three of Eq. 16, with all the noise that is in them."""
    parameters = PocketParameters(gyr_density_deg=2.0)
    state, chain, P = PocketState(TRUTH.copy(), np.zeros(3), P0.copy()), blank_chain(), some_covariance(2)
    begin(chain, np.array([12.0, -20.0, -40.0]))
    theta, h = np.array([0.03, -0.05, 0.02]), 0.01
    predict(state, chain, theta / h, h, belief_of(parameters))
    state.P[:] = P
    field = Rotation.from_rotvec(-theta).as_matrix() @ chain.field + np.array([0.02, 0.01, -0.03])
    expected, per_bias = expected_field(chain, False)
    cross = cross_matrix(expected)
    H = np.hstack([np.zeros((3, 3)), cross @ per_bias])
    R = 2 * 0.015**2 * np.eye(3) + np.radians(2.0) ** 2 * h * cross @ cross.T
    x, after = textbook(P, H, R, expected - field)
    differential_field(state, chain, field, belief_of(parameters))
    assert np.allclose(per_bias, -h * right_jacobian(theta), atol=1e-15)
    assert np.allclose(state.P, after, rtol=1e-9, atol=1e-15)
    assert np.allclose(state.gyro_bias, -x[3:], rtol=1e-9)


def test_the_printed_difference_turns_the_field_the_wrong_way():
    chain, theta = blank_chain(), np.array([0.0, 0.05, 0.0])
    begin(chain, TRUTH.T @ [0.0, 21.0, -43.0])
    lengthen(chain, theta, -0.01 * right_jacobian(theta), 0.01)
    now = (TRUTH @ Rotation.from_rotvec(theta).as_matrix()).T @ [0.0, 21.0, -43.0]
    assert np.allclose(expected_field(chain, False)[0], now, atol=1e-12)
    assert np.linalg.norm(expected_field(chain, True)[0] - now) > 3.0  # uT: twice the turn


def test_a_bias_that_moves_takes_the_chain_along():
    rates, h = np.random.default_rng(5).normal(0, 2, (5, 3)), 0.01

    def chain_at(bias):
        chain = blank_chain()
        begin(chain, np.array([20.0, 5.0, -40.0]))
        for rate in rates:
            theta = (rate - bias) * h
            lengthen(chain, theta, -h * right_jacobian(theta), h)
        return chain

    change = np.array([1e-3, -2e-3, 3e-3])
    moved, right = chain_at(np.zeros(3)), chain_at(change)
    assert not np.allclose(moved.turn, right.turn, atol=1e-6)
    rebias(moved, change)
    assert np.allclose(moved.turn, right.turn, atol=1e-8)


def test_gravity_between_two_fields_takes_the_chain_along_too():
    """A slower magnetometer: the update moves the bias while the field is still waited for."""
    chain, P = blank_chain(), some_covariance(3)
    begin(chain, np.array([20.0, 5.0, -40.0]))
    theta = np.array([0.2, -0.1, 0.3])
    lengthen(chain, theta, -0.1 * right_jacobian(theta), 0.1)
    state = PocketState(TILTED.copy(), np.zeros(3), P)
    absolute_gravity(state, chain, FORCE, belief_of(replace(SAMPLES, acc_sigma_m_s2=1e-3)))
    less = theta - 0.1 * state.gyro_bias
    assert np.linalg.norm(state.gyro_bias) > 1e-4
    assert np.allclose(chain.turn, Rotation.from_rotvec(less).as_matrix(), atol=1e-3 * np.linalg.norm(state.gyro_bias))
