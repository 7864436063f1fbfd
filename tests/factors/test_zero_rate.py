"""Zero rate: what it sees of a bias, and what it leaves free."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.factors import zero_rate_factor

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
    assert 2.0 * factor.error(bias_values(acc, gyro)) == pytest.approx(chi_square, rel=1e-9, abs=1e-9)
    expected = np.diag(np.concatenate([np.zeros(3), sigma**-2]))
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
    found = graph.linearize(bias_values(np.zeros(3), np.zeros(3))).optimize().at(B(0))
    np.testing.assert_allclose(found[:3], 0.5)
    np.testing.assert_allclose(found[3:], np.average(rates, axis=0, weights=sigmas**-2.0), rtol=1e-9)
