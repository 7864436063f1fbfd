"""The two updates against finite differences, the textbook's matrix form, and each other."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.lab.reproduce.munoz_diaz2017.as_printed import rotation_of_angles, swap_turn
from fg_nav.mechanisation import cross_matrix, right_jacobian
from fg_nav.pocket.filter import (
    PocketParameters,
    PocketState,
    build_model,
    create_reference,
    predict_field,
    predict_state,
    propagate_reference,
    set_reference,
    update_field,
    update_gravity,
)

TRUTH = rotation_of_angles(np.array([0.4, -0.6, 1.1]))
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
    update_gravity(state, create_reference(), FORCE, build_model(parameters))
    assert np.allclose(state.P, after, atol=3e-3 * after.max())
    assert np.allclose(state.gyro_bias - bias, -x[3:], atol=2e-2 * np.abs(x[3:]).max())
    assert np.allclose(state.nav_R_body, Rotation.from_rotvec(-x[:3]).as_matrix() @ tilted, atol=2e-5)


def test_the_field_corrects_as_the_textbook_in_three_rows():
    """The two rows are the three of MD (16), with all the noise that is in them."""
    model = build_model(PocketParameters())._replace(gyr_density=np.radians(2.0) ** 2)
    state, reference, P = PocketState(TRUTH.copy(), np.zeros(3), P0.copy()), create_reference(), some_covariance(2)
    set_reference(reference, np.array([12.0, -20.0, -40.0]))
    theta, h = np.array([0.03, -0.05, 0.02]), 0.01
    predict_state(state, reference, theta / h, h, model)
    state.P[:] = P
    field = Rotation.from_rotvec(-theta).as_matrix() @ reference.field + np.array([0.02, 0.01, -0.03])
    expected, per_bias = predict_field(reference), reference.per_bias
    cross = cross_matrix(expected)
    H = np.hstack([np.zeros((3, 3)), cross @ per_bias])
    R = 2 * 0.015**2 * np.eye(3) + np.radians(2.0) ** 2 * h * cross @ cross.T
    x, after = textbook(P, H, R, expected - field)
    update_field(state, reference, field, model)
    assert np.allclose(per_bias, -h * right_jacobian(theta), atol=1e-15)
    assert np.allclose(state.P, after, rtol=1e-9, atol=1e-15)
    assert np.allclose(state.gyro_bias, -x[3:], rtol=1e-9)


def test_the_printed_difference_turns_the_field_the_wrong_way():
    reference, theta = create_reference(), np.array([0.0, 0.05, 0.0])
    set_reference(reference, TRUTH.T @ [0.0, 21.0, -43.0])
    propagate_reference(reference, theta, -0.01 * right_jacobian(theta), 0.01)
    now = (TRUTH @ Rotation.from_rotvec(theta).as_matrix()).T @ [0.0, 21.0, -43.0]
    assert np.allclose(predict_field(reference), now, atol=1e-12)
    assert np.linalg.norm(predict_field(swap_turn(reference)) - now) > 3.0  # uT: twice the turn


def test_a_bias_that_moves_between_two_fields_takes_the_chain_along():
    """A slower magnetometer: gravity moves the bias while the field is still waited for."""
    rates, h = np.random.default_rng(5).normal(0, 2, (5, 3)), 0.01

    def reference_at(bias):
        reference = create_reference()
        set_reference(reference, np.array([20.0, 5.0, -40.0]))
        for rate in rates:
            theta = (rate - bias) * h
            propagate_reference(reference, theta, -h * right_jacobian(theta), h)
        return reference

    moved, state = reference_at(np.zeros(3)), PocketState(TILTED.copy(), np.zeros(3), some_covariance(3))
    update_gravity(state, moved, FORCE, build_model(replace(SAMPLES, acc_sigma_m_s2=1e-3)))
    size = np.linalg.norm(state.gyro_bias)
    assert size > 1e-4
    assert np.allclose(moved.turn, reference_at(state.gyro_bias).turn, atol=1e-4 * size)
