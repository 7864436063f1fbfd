"""The differential field: Jacobians, what it cannot see, its noise, and what a chain of it loses."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from hypothesis import given, settings

from fg_nav.factors.differential_field import (
    differential_field_covariance,
    differential_field_factor,
    differential_field_jacobians,
    differential_field_residual,
)
from fg_nav.factors.local_field import local_field_jacobians
from fg_nav.frames import yaw_rotation
from tests.factors.attitudes import attitude, eliminated, fields, pose, values_of, vectors
from tests.factors.derivatives import assert_jacobians_are_derivatives, residual

UNIT = gtsam.noiseModel.Unit.Create(3)
NAV_FIELD = np.array([4.0, 21.0, -43.0])


@given(a=vectors, b=vectors, at=vectors, y_i=fields, y_j=fields)
@settings(max_examples=30, deadline=None)
def test_jacobians_are_the_derivatives_on_the_manifold(a, b, at, y_i, y_j):
    factor = differential_field_factor(X(0), X(1), y_i, y_j, UNIT)
    values = values_of({X(0): pose(attitude(a), at), X(1): pose(attitude(b), -at)})
    assert_jacobians_are_derivatives(factor, values, atol=1e-6)


@given(a=vectors, b=vectors, nav_field=fields)
@settings(max_examples=30, deadline=None)
def test_two_poses_in_one_field_have_no_residual_whatever_the_field(a, b, nav_field):
    i, j = attitude(a), attitude(b)
    factor = differential_field_factor(X(0), X(1), i.T @ nav_field, j.T @ nav_field, UNIT)
    np.testing.assert_allclose(residual(factor, values_of({X(0): pose(i), X(1): pose(j)})), 0.0, atol=1e-12)


@given(a=vectors, b=vectors, y_i=fields, y_j=fields)
@settings(max_examples=30, deadline=None)
def test_turning_both_poses_about_up_changes_nothing(a, b, y_i, y_j):
    i, j, turn = attitude(a), attitude(b), yaw_rotation(1.2)
    e = differential_field_residual(i, j, y_i, y_j)
    np.testing.assert_allclose(differential_field_residual(turn @ i, turn @ j, y_i, y_j), turn @ e, atol=1e-10)


def test_a_turn_about_the_field_between_the_poses_is_not_seen():
    i, j = attitude([0.1, 0.5, -1.0]), attitude([0.3, 0.2, 2.0])
    by_i, by_j = differential_field_jacobians(i, j, i.T @ NAV_FIELD, j.T @ NAV_FIELD)
    np.testing.assert_allclose(by_i @ i.T @ NAV_FIELD, 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(np.hstack([by_i, by_j]), tol=1e-9) == 2


def test_the_covariance_is_the_scatter_of_the_residual():
    rng, n = np.random.default_rng(7), 40000
    i, j = attitude([0.1, 0.5, -1.0]), attitude([0.3, 0.2, 2.0])
    s_i, s_j = np.array([0.5, 1.0, 2.0]), np.array([1.5, 0.3, 0.6])
    y_i, y_j = i.T @ NAV_FIELD + s_i * rng.normal(size=(n, 3)), j.T @ NAV_FIELD + s_j * rng.normal(size=(n, 3))
    expected = differential_field_covariance(i, j, np.diag(s_i**2), np.diag(s_j**2))
    np.testing.assert_allclose(np.cov(differential_field_residual(i, j, y_i, y_j).T), expected, atol=0.08)


N, BIAS_STEP_S, SIGMA = 60, 1.0, 0.5


def chain_and_latent():
    """Attitudes of a stretch, and the rows by which a constant gyro bias moves differences and local fields."""
    rng = np.random.default_rng(21)
    R = attitude(np.cumsum(rng.normal(0.0, 0.15, (N, 3)), axis=0))
    y = np.swapaxes(R, 1, 2) @ NAV_FIELD
    turned = -np.swapaxes(R, 1, 2) @ np.cumsum(BIAS_STEP_S * R, axis=0)  # body-frame turn of each pose per bias
    by_i, by_j = differential_field_jacobians(R[:-1], R[1:], y[:-1], y[1:])
    chain = by_i @ turned[:-1] + by_j @ turned[1:]
    by_rotation, by_field = local_field_jacobians(R, NAV_FIELD)
    return R, y, chain.reshape(-1, 3), np.concatenate([by_rotation @ turned, by_field], axis=2).reshape(-1, 6)


def test_a_chain_taken_as_white_loses_what_a_local_field_keeps():
    R, y, chain, latent = chain_and_latent()
    rng = np.random.default_rng(22)
    by_chain, by_latent = np.linalg.pinv(chain), np.linalg.pinv(latent)[:3]
    found = np.zeros((2, 400, 3))
    for k in range(400):
        noisy = y + rng.normal(0.0, SIGMA, y.shape)
        found[0, k] = by_chain @ differential_field_residual(R[:-1], R[1:], noisy[:-1], noisy[1:]).ravel()
        found[1, k] = by_latent @ (noisy - y).ravel()
    scatter = (found**2).mean(axis=1).sum(axis=1)
    promised = SIGMA**2 * np.trace(np.linalg.inv(eliminated(latent.T @ latent, 3)))
    assert scatter[1] == pytest.approx(promised, rel=0.15)  # the local field's own figure is right
    assert scatter[0] > 4.0 * scatter[1]


def test_a_chain_with_its_true_correlation_loses_nothing():
    _, _, chain, latent = chain_and_latent()
    R, *_ = chain_and_latent()
    step = np.zeros((N - 1, 3, N, 3))
    for k in range(N - 1):
        step[k, :, k], step[k, :, k + 1] = R[k], -R[k + 1]
    D = step.reshape(3 * (N - 1), 3 * N)
    honest = chain.T @ np.linalg.solve(D @ D.T, chain)
    np.testing.assert_allclose(honest, eliminated(latent.T @ latent, 3), rtol=1e-6, atol=1e-3)
    correlation = (D @ D.T)[:3, 3:6] / 2.0
    np.testing.assert_allclose(correlation, -0.5 * np.eye(3), atol=1e-12)
