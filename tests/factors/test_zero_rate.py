"""Zero rate: what it sees of a bias, and what it leaves free."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.factors import zero_rate_factor
from fg_nav.factors.zero_velocity import REST_TAIL_SIGMAS

vectors = st.lists(st.floats(-10, 10), min_size=3, max_size=3).map(np.array)

sigmas = st.lists(st.floats(1e-4, 10), min_size=3, max_size=3).map(np.array)


def bias_values(acc, gyro):
    values = gtsam.Values()
    values.insert(B(0), gtsam.imuBias.ConstantBias(acc, gyro))
    return values


@given(acc=vectors, gyro=vectors, rate=vectors, sigma=sigmas)
@settings(max_examples=20, deadline=None)
def test_the_prior_is_on_the_gyroscope_alone(acc, gyro, rate, sigma):
    factor = zero_rate_factor(B(0), rate, np.diag(sigma**2))
    chi_square = (((gyro - rate) / sigma) ** 2).sum()
    loss = REST_TAIL_SIGMAS**2 * np.log1p(chi_square / REST_TAIL_SIGMAS**2)
    assert 2.0 * factor.error(bias_values(acc, gyro)) == pytest.approx(loss, rel=1e-9, abs=1e-9)
    weight = 1.0 / (1.0 + chi_square / REST_TAIL_SIGMAS**2)
    expected = weight * np.diag(np.concatenate([np.zeros(3), sigma**-2]))
    np.testing.assert_allclose(factor.linearize(bias_values(acc, gyro)).information(), expected, rtol=1e-9)


def test_rests_are_averaged_with_their_weights_and_solved_next_to_another_accelerometer_prior():
    graph = gtsam.NonlinearFactorGraph()
    rates = np.array([[0.01, 0.02, 0.03], [0.03, 0.02, 0.01]])
    sigmas = np.array([[0.01, 0.02, 0.04], [0.02, 0.02, 0.01]])
    for rate, sigma in zip(rates, sigmas, strict=True):
        graph.push_back(zero_rate_factor(B(0), rate, np.diag(sigma**2)))
    acc = gtsam.imuBias.ConstantBias(np.full(3, 0.5), np.zeros(3))
    graph.push_back(
        gtsam.PriorFactorConstantBias(B(0), acc, gtsam.noiseModel.Diagonal.Sigmas(np.repeat([1.0, 1e6], 3)))
    )
    expected = np.average(rates, axis=0, weights=sigmas**-2.0)
    found = expected + graph.linearize(bias_values(np.zeros(3), expected)).optimize().at(B(0))[3:]
    # Both are within their sigmas, where the loss is next to a square.
    np.testing.assert_allclose(found, expected, atol=5e-4)


def test_a_false_rest_is_outvoted():
    """Ten that agree to 0.02 deg/s, and one that is 1 deg/s off at a sigma of 0.1."""
    graph, values = gtsam.NonlinearFactorGraph(), bias_values(np.zeros(3), np.full(3, 0.01))
    for rate, sigma in [*((0.0, 3e-4),) * 10, (0.017, 1.7e-3)]:
        graph.push_back(zero_rate_factor(B(0), np.full(3, rate), sigma**2 * np.eye(3)))
    graph.push_back(gtsam.PriorFactorConstantBias(B(0), gtsam.imuBias.ConstantBias(), gtsam.noiseModel.Unit.Create(6)))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atConstantBias(B(0)).gyroscope()
    np.testing.assert_allclose(found, 0.0, atol=1e-5)
