"""Covariance and corrections: the motion itself, dense algebra, the textbook, the one right sign, and Monte Carlo.

Monte Carlo: truth and estimate start apart by a draw from P, the biases walk, the samples have the densities of the
filter and the velocity in stance is measured with its noise. Then the errors are chi-square with as many degrees of
freedom as components, within the bounds of the number of runs (Bar-Shalom et al. 2001, 5.4).
"""

import numpy as np
import pytest
from numba import njit
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from fg_nav.ekf.covariance import VELOCITY, Densities, add_body_noise, propagate_columns, propagate_covariance
from fg_nav.ekf.update import inject_error, rotate_in_nav, update_component, update_row
from fg_nav.mechanisation import NavState, strapdown
from tests.ekf.motion import Walk, error_of, random_covariance, random_state, with_error

H = 0.005


def step(state, acc=np.zeros(3), gyr=np.zeros(3)):
    turn, push = np.empty((3, 3)), np.empty(3)
    strapdown(state, acc, gyr, H, 9.8, turn, push)
    return turn, push


def transition(turn, push):
    F = np.eye(15)
    propagate_columns(F, 15, turn, push, H)
    return F


@pytest.mark.parametrize("steps", [1, 60])
def test_transition_is_the_derivative_of_the_motion(steps):
    """Perturb each component of the truth, move both, and compare what comes out with F."""
    rng, truth = np.random.default_rng(steps), random_state(steps)
    acc, gyr = 10 * rng.standard_normal((steps, 3)), 4 * rng.standard_normal((steps, 3))
    F, moved = np.eye(15), NavState(*(part.copy() for part in truth))
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
    rng, P = np.random.default_rng(5), random_covariance(5)
    turn, push = step(random_state(5), 10 * rng.standard_normal(3), 4 * rng.standard_normal(3))
    F = transition(turn, push)
    expected = F @ P @ F.T + np.diag(np.repeat([0.0, 1.0, 2.0, 3.0, 4.0], 3)) * H
    propagate_covariance(P, turn, push, H, Densities(1.0, 2.0, 3.0, 4.0))
    np.testing.assert_allclose(P, expected, rtol=1e-12, atol=1e-12)
    assert np.array_equal(P, P.T)


def test_an_uncertain_axis_spreads_in_the_body_frame_only():
    state = random_state(8, gyro_bias=0.0)
    R, P = state.nav_R_body.copy(), np.zeros((15, 15))
    turn, _ = step(state)
    add_body_noise(P, 6, turn, np.array([0.0, 2.0, 0.0]))
    np.testing.assert_allclose(R.T @ P[6:9, 6:9] @ R, np.diag([0, (2.0 * H) ** 2, 0]), atol=1e-18)
    assert np.array_equal(P, P.T)
    assert np.count_nonzero(P) == np.count_nonzero(P[6:9, 6:9])


# corrections


def test_rows_in_turn_are_the_textbook_update_and_a_component_is_a_unit_row():
    rng, P, unit = np.random.default_rng(1), random_covariance(1), np.eye(15)
    x, H = rng.standard_normal(15), np.vstack([rng.standard_normal((4, 15)), unit[4]])
    z, r = rng.standard_normal(5), rng.uniform(0.1, 2.0, 5)
    S = H @ P @ H.T + np.diag(r)
    K = P @ H.T @ np.linalg.inv(S)
    innovation, joseph = z - H @ x, unit - K @ H
    P_book, x_book = joseph @ P @ joseph.T + K @ np.diag(r) @ K.T, x + K @ innovation
    nis = sum(update_row(P, x, H[k], z[k], r[k]) ** 2 for k in range(4))
    nis += update_component(P, x, 4, z[4], r[4]) ** 2
    np.testing.assert_allclose(P, P_book, atol=1e-10)
    np.testing.assert_allclose(x, x_book, atol=1e-10)
    assert nis == pytest.approx(innovation @ np.linalg.solve(S, innovation))
    assert np.array_equal(P, P.T)


def test_a_sharp_measurement_of_a_vague_state_leaves_a_positive_covariance():
    rng, P, x = np.random.default_rng(3), 1e8 * random_covariance(3), np.zeros(15)
    for _ in range(50):
        for k in range(3):
            update_component(P, x, 3 + k, rng.standard_normal(), 1e-8)
            update_row(P, x, rng.standard_normal(15), rng.standard_normal(), 1e-8)
    assert np.all(np.diag(P) > 0)
    assert np.linalg.eigvalsh(P).min() > -1e-9 * np.linalg.eigvalsh(P).max()


def test_taking_off_the_error_gives_the_truth_and_the_other_sign_doubles_it():
    """C <- (I - [dphi]) C for errors as estimate minus truth; the (I + [dphi]) C of one paper is wrong."""
    truth, error = random_state(5), 0.3 * np.random.default_rng(5).standard_normal(15)
    estimate, other, x = with_error(truth, error), with_error(truth, error), error.copy()
    inject_error(estimate, x)
    for ours, theirs in zip(estimate, truth, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-14)
    assert not x.any()
    inject_error(other, -error)
    np.testing.assert_allclose(error_of(other, truth), 2 * error)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.05, 0.0999, 0.1001, 2.0])
def test_turning_is_the_exact_rotation(angle):
    R, axis = random_state(7).nav_R_body, np.array([0.6, -0.64, 0.48])
    expected = Rotation.from_rotvec(angle * axis).as_matrix() @ R
    rotate_in_nav(R, *(angle * axis))
    np.testing.assert_allclose(R, expected, atol=1e-14)


# Monte Carlo

RUNS = 200
RATE = 100.0
DENSITY = Densities(0.02**2, np.radians(0.05) ** 2, np.radians(0.01) ** 2, 0.003**2)
STANCE_VARIANCE = 0.01**2
PRIOR = np.repeat([1e-3, 0.02, 0.01, np.radians(0.2), 0.03], 3)
SURE = 0.999  # Two-sided probability of the bounds: one seed is fixed, so this is how lucky the seed may be.


@njit
def navigate(truth, estimate, P, acc, gyr, stands, h, noise, density, variance):
    """Move truth and estimate over the same walk; returns the NIS of each correction."""
    x, turn, push = np.zeros(15), np.empty((3, 3)), np.empty(3)
    nis = np.full(len(acc), np.nan)
    for i in range(len(acc)):
        if stands[i]:
            nis[i] = 0.0
            for k in range(3):
                measured = truth.velocity[k] + np.sqrt(variance) * noise[i, k]
                nis[i] += update_component(P, x, VELOCITY + k, estimate.velocity[k] - measured, variance) ** 2
            inject_error(estimate, x)
        # the sensor reads what moves the truth, its biases, and white noise
        force, rate = acc[i] + truth.acc_bias, gyr[i] + truth.gyro_bias
        strapdown(truth, force, rate, h, 9.80665, turn, push)
        force = force + np.sqrt(density.acc / h) * noise[i, 3:6]
        rate = rate + np.sqrt(density.gyr / h) * noise[i, 6:9]
        strapdown(estimate, force, rate, h, 9.80665, turn, push)
        propagate_covariance(P, turn, push, h, density)
        truth.gyro_bias[:] += np.sqrt(density.gyro_bias * h) * noise[i, 9:12]
        truth.acc_bias[:] += np.sqrt(density.acc_bias * h) * noise[i, 12:15]
    return nis


def bounds(dof, draws):
    """Of the mean of `draws` independent chi-square numbers."""
    return chi2.ppf([(1 - SURE) / 2, (1 + SURE) / 2], dof * draws) / draws


def test_errors_are_as_large_as_the_filter_claims():
    walk, rng = Walk(strides=8, rest_s=1.0), np.random.default_rng(11)
    recording, stances = walk.recording(RATE)
    parts = [slice(k, k + 3) for k in range(0, 15, 3)] + [slice(0, 15)]
    nees, nis = [], []
    for _ in range(RUNS):
        estimate = NavState(np.zeros(3), np.zeros(3), walk.attitude(np.zeros(1))[0].copy(), *np.zeros((2, 3)))
        truth = with_error(estimate, -PRIOR * rng.standard_normal(15))
        P, noise = np.diag(PRIOR**2), rng.standard_normal((len(recording), 15))
        samples = recording.acc, recording.gyr, stances.mask
        scores = navigate(truth, estimate, P, *samples, 1 / RATE, noise, DENSITY, STANCE_VARIANCE)
        nis.append(np.nanmean(scores))
        e = error_of(estimate, truth)
        nees.append([e[p] @ np.linalg.solve(P[p, p], e[p]) for p in parts])
    for part, mean in zip(parts, np.mean(nees, axis=0), strict=True):
        low, high = bounds(part.stop - part.start, RUNS)
        assert low < mean < high
    low, high = bounds(3, RUNS * int(np.count_nonzero(stances.mask)))
    assert low < np.mean(nis) < high
