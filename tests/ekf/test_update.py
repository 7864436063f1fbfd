"""Corrections against the textbook, and the one sign that shrinks an error."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.ekf.update import inject_error, rotate_in_nav, update_component, update_row
from tests.ekf.errors import error_of, random_covariance, random_state, with_error


def textbook(P, x, H, z, R):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    innovation = z - H @ x
    joseph = np.eye(len(x)) - K @ H
    P_new = joseph @ P @ joseph.T + K @ R @ K.T
    return P_new, x + K @ innovation, innovation @ np.linalg.solve(S, innovation)


def test_rows_in_turn_are_the_textbook_update():
    rng = np.random.default_rng(1)
    P, x = random_covariance(rng), rng.standard_normal(15)
    H, z, r = rng.standard_normal((4, 15)), rng.standard_normal(4), rng.uniform(0.1, 2.0, 4)
    P_book, x_book, nis_book = textbook(P, x, H, z, np.diag(r))
    nis = sum(update_row(P, x, H[k], z[k], r[k]) ** 2 for k in range(4))
    np.testing.assert_allclose(P, P_book, atol=1e-10)
    np.testing.assert_allclose(x, x_book, atol=1e-10)
    assert nis == pytest.approx(nis_book)
    assert np.array_equal(P, P.T)


def test_a_component_is_a_unit_row():
    rng = np.random.default_rng(2)
    P, x = random_covariance(rng), rng.standard_normal(15)
    P2, x2 = P.copy(), x.copy()
    nu = update_row(P, x, np.eye(15)[4], 0.7, 0.3)
    assert update_component(P2, x2, 4, 0.7, 0.3) == pytest.approx(nu)
    np.testing.assert_allclose(P2, P, atol=1e-12)
    np.testing.assert_allclose(x2, x, atol=1e-12)


def test_a_sharp_measurement_of_a_vague_state_leaves_a_positive_covariance():
    rng = np.random.default_rng(3)
    P, x = 1e8 * random_covariance(rng), np.zeros(15)
    for _ in range(50):
        for k in range(3):
            update_component(P, x, 3 + k, rng.standard_normal(), 1e-8)
            update_row(P, x, rng.standard_normal(15), rng.standard_normal(), 1e-8)
    assert np.all(np.diag(P) > 0)
    assert np.linalg.eigvalsh(P).min() > -1e-9 * np.linalg.eigvalsh(P).max()


def test_taking_off_the_error_gives_the_truth():
    rng = np.random.default_rng(5)
    truth = random_state(rng)
    error = 0.3 * rng.standard_normal(15)
    estimate, x = with_error(truth, error), error.copy()
    inject_error(estimate, x)
    for ours, theirs in zip(estimate, truth, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-14)
    assert not x.any()


def test_the_other_sign_of_the_attitude_doubles_the_error():
    """C <- (I - [dphi]) C for errors as estimate minus truth; the (I + [dphi]) C of one paper is wrong."""
    truth = random_state(np.random.default_rng(6))
    error = np.zeros(15)
    error[6:9] = [0.003, -0.002, 0.001]
    size = np.linalg.norm(error)
    estimate = with_error(truth, error)
    printed = with_error(truth, error)
    inject_error(estimate, error.copy())
    inject_error(printed, -error)
    assert np.linalg.norm(error_of(estimate, truth)) < 1e-12
    assert np.linalg.norm(error_of(printed, truth)) == pytest.approx(2 * size)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.05, 0.0999, 0.1001, 2.0])
def test_turning_is_the_exact_rotation(angle):
    R = random_state(np.random.default_rng(7)).nav_R_body
    axis = np.array([0.6, -0.64, 0.48])
    expected = Rotation.from_rotvec(angle * axis).as_matrix() @ R
    rotate_in_nav(R, *(angle * axis))
    np.testing.assert_allclose(R, expected, atol=1e-14)
