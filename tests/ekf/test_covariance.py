"""The propagation of the covariance against the motion itself and against dense algebra."""

import numpy as np
import pytest

from fg_nav.ekf.covariance import Densities, add_body_noise, propagate_columns, propagate_covariance
from fg_nav.mechanisation import NavState, strapdown
from tests.ekf.errors import error_of, random_covariance, random_state, with_error

H = 0.005


def step(state, acc, gyr, h=H):
    turn, push = np.empty((3, 3)), np.empty(3)
    strapdown(state, acc, gyr, h, 9.8, turn, push)
    return turn, push


def copy(state):
    return NavState(*(part.copy() for part in state))


def transition(turn, push, h=H):
    F = np.eye(15)
    propagate_columns(F, 15, turn, push, h)
    return F


def motion(rng, steps):
    return 10 * rng.standard_normal((steps, 3)), 4 * rng.standard_normal((steps, 3))


@pytest.mark.parametrize("steps", [1, 60])
def test_transition_is_the_derivative_of_the_motion(steps):
    """Perturb each component of the truth, move both, and compare what comes out with F."""
    rng = np.random.default_rng(steps)
    truth = random_state(rng)
    acc, gyr = motion(rng, steps)
    F, moved = np.eye(15), copy(truth)
    for f, w in zip(acc, gyr, strict=True):
        F = transition(*step(moved, f, w)) @ F
    numerical = np.empty((15, 15))
    for k in range(15):
        column = []
        for sign in (1, -1):
            other = with_error(truth, sign * 1e-5 * np.eye(15)[k])
            for f, w in zip(acc, gyr, strict=True):
                step(other, f, w)
            column.append(error_of(other, moved))
        numerical[:, k] = (column[0] - column[1]) / 2e-5
    # the mean of an integrand's ends for its integral: good to the square of the period
    scale = np.abs(numerical).max(axis=1, keepdims=True)
    np.testing.assert_allclose(F / scale, numerical / scale, atol=3e-3)
    np.testing.assert_allclose(F[6:9, 9:12], numerical[6:9, 9:12], atol=1e-8)
    np.testing.assert_allclose(F[3:6, 12:], numerical[3:6, 12:], atol=1e-8)


def test_propagation_is_the_dense_product():
    rng = np.random.default_rng(5)
    P = random_covariance(rng)
    density = Densities(1.0, 2.0, 3.0, 4.0)
    turn, push = step(random_state(rng), *(m[0] for m in motion(rng, 1)))
    F = transition(turn, push)
    Q = np.diag(np.repeat([0.0, 1.0, 2.0, 3.0, 4.0], 3)) * H
    expected = F @ P @ F.T + Q
    propagate_covariance(P, turn, push, H, density)
    np.testing.assert_allclose(P, expected, rtol=1e-12, atol=1e-12)
    assert np.array_equal(P, P.T)


def test_an_uncertain_axis_spreads_in_the_body_frame_only():
    rng = np.random.default_rng(8)
    state = random_state(rng)
    state.gyro_bias[:] = 0.0
    R = state.nav_R_body.copy()
    turn, _ = step(state, np.zeros(3), np.zeros(3))
    P = np.zeros((15, 15))
    add_body_noise(P, 6, turn, np.array([0.0, 2.0, 0.0]))
    np.testing.assert_allclose(R.T @ P[6:9, 6:9] @ R, np.diag([0, (2.0 * H) ** 2, 0]), atol=1e-18)
    assert np.array_equal(P, P.T)
    assert np.count_nonzero(P) == np.count_nonzero(P[6:9, 6:9])
