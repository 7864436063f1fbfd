"""Zero rate: its sigma over simulated rests, its Jacobians by finite differences, what it leaves free."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, G
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.factors.zero_rate import (
    zero_rate_factor,
    zero_rate_jacobian,
    zero_rate_residual,
    zero_rate_sigma,
    zero_rate_with_g_factor,
)
from tests.factors.derivatives import assert_jacobians_are_derivatives, residual

UNIT = gtsam.noiseModel.Unit.Create(3)
vectors = st.lists(st.floats(-10, 10), min_size=3, max_size=3).map(np.array)
seeds = st.integers(0, 10_000)


def bias_values(acc, gyro):
    values = gtsam.Values()
    values.insert(B(0), gtsam.imuBias.ConstantBias(acc, gyro))
    return values


@pytest.mark.parametrize(("duration", "turned"), [(0.5, np.radians(0.5)), (2.0, np.radians(0.02)), (60.0, 0.0)])
def test_the_sigma_is_the_spread_of_the_mean_rate_of_simulated_rests(duration, turned):
    """White noise sample by sample, and a lean that is smooth in time: only its ends matter to the mean."""
    rng, n, trials, density = np.random.default_rng(7), 200, 2000, 3e-4
    h = duration / n
    lean = rng.normal(0, turned, trials)[:, None] * (1 - np.cos(np.pi * np.linspace(0, 1, n + 1))) / 2
    rate = np.diff(lean, axis=1) / h + density / np.sqrt(h) * rng.normal(size=(trials, n))
    spread = rate.mean(axis=1).std()
    assert spread == pytest.approx(zero_rate_sigma(duration, density, turned), rel=0.06)


def test_a_lean_rules_short_rests_and_noise_long_ones():
    short, long = zero_rate_sigma(np.array([0.3, 1e4]), 1e-4, np.radians(0.1))
    assert short == pytest.approx(np.radians(0.1) / 0.3, rel=0.01)
    assert long == pytest.approx(1e-4 / 1e2, rel=0.02)


@given(acc=vectors, gyro=vectors, rate=vectors, sigma=st.floats(1e-4, 10))
@settings(max_examples=20, deadline=None)
def test_the_prior_is_on_the_gyroscope_alone(acc, gyro, rate, sigma):
    factor = zero_rate_factor(B(0), rate, sigma)
    chi_square = (((gyro - rate) / sigma) ** 2).sum()
    assert 2.0 * factor.error(bias_values(acc, gyro)) == pytest.approx(chi_square, rel=1e-9, abs=1e-9)
    np.testing.assert_allclose(
        factor.linearize(bias_values(acc, gyro)).information(), np.diag(np.repeat([0.0, sigma**-2], 3)), rtol=1e-9
    )


def test_rests_are_averaged_with_their_weights_and_solved_beside_another_accelerometer_prior():
    graph = gtsam.NonlinearFactorGraph()
    rates, sigmas = np.array([[0.01, 0.02, 0.03], [0.03, 0.02, 0.01]]), np.array([0.01, 0.02])
    for rate, sigma in zip(rates, sigmas, strict=True):
        graph.push_back(zero_rate_factor(B(0), rate, sigma))
    acc = gtsam.imuBias.ConstantBias(np.full(3, 0.5), np.zeros(3))
    graph.push_back(
        gtsam.PriorFactorConstantBias(B(0), acc, gtsam.noiseModel.Diagonal.Sigmas(np.repeat([1.0, 1e6], 3)))
    )
    found = graph.linearize(bias_values(np.zeros(3), np.zeros(3))).optimize().at(B(0))
    np.testing.assert_allclose(found[:3], 0.5)
    np.testing.assert_allclose(found[3:], np.average(rates, axis=0, weights=sigmas**-2), rtol=1e-9)


@given(acc=vectors, gyro=vectors, rate=vectors, force=vectors, seed=seeds)
@settings(max_examples=20, deadline=None)
def test_jacobians_are_the_derivatives(acc, gyro, rate, force, seed):
    values = bias_values(acc, gyro)
    values.insert(G(0), np.random.default_rng(seed).normal(size=9))
    assert_jacobians_are_derivatives(zero_rate_with_g_factor(B(0), G(0), rate, force, UNIT), values)


@given(gyro=vectors, force=vectors, seed=seeds)
@settings(max_examples=20, deadline=None)
def test_what_the_sensor_would_show_has_no_residual(gyro, force, seed):
    g_sensitivity = np.random.default_rng(seed).normal(size=(3, 3))
    shown = gyro + np.array([g_sensitivity[i] @ force for i in range(3)])
    values = bias_values(np.zeros(3), gyro)
    values.insert(G(0), g_sensitivity.ravel())
    factor = zero_rate_with_g_factor(B(0), G(0), shown, force, UNIT)
    np.testing.assert_allclose(residual(factor, values), 0.0, atol=1e-12)


def test_many_rests_are_as_each_alone():
    rng = np.random.default_rng(0)
    bias, rate, force = rng.normal(size=(3, 5, 2, 3))
    g = rng.normal(size=(5, 2, 3, 3))
    together, by_g = zero_rate_residual(bias, g, rate, force), zero_rate_jacobian(force)
    assert together.shape == (5, 2, 3)
    assert by_g.shape == (5, 2, 3, 9)
    for i in np.ndindex(5, 2):
        np.testing.assert_allclose(together[i], zero_rate_residual(bias[i], g[i], rate[i], force[i]), atol=1e-14)
        np.testing.assert_allclose(by_g[i] @ g[i].ravel(), g[i] @ force[i], atol=1e-14)


def test_one_attitude_sees_the_sum_and_several_see_both():
    """From rests on all sides bias and g-sensitivity are told apart; from rests on one side they are not."""

    def least_information(forces):
        graph = gtsam.GaussianFactorGraph()
        values = bias_values(np.zeros(3), np.zeros(3))
        values.insert(G(0), np.zeros(9))
        for force in forces:
            graph.push_back(zero_rate_with_g_factor(B(0), G(0), np.zeros(3), force, UNIT).linearize(values))
        information, _ = graph.hessian()
        gyro_and_g = information[3:, 3:]  # keys in their order: B, then G
        return np.linalg.eigvalsh(gyro_and_g)[0]

    sides = 9.81 * np.vstack([np.eye(3), -np.eye(3)])
    assert least_information(sides) > 1.0
    assert least_information(sides[[2, 2, 2, 2]]) < 1e-9
