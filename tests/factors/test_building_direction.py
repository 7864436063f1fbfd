"""Directions of a building: geometry and Jacobians, the mixture's loss and weight, and that it is silent elsewhere."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import A, X
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from fg_nav.factors import BuildingDirection, factor_of
from fg_nav.factors.walk_constraints import (
    QUARTER,
    direction_loss,
    direction_probability,
    measure_course,
    odds_of_elsewhere,
    wrap_quarter,
)
from tests.factors.derivatives import differences, jacobians, residual

KEYS = [X(0), X(1), A(0)]
SIGMA = np.radians(2.0)
ALWAYS = BuildingDirection(SIGMA, 1e-300, np.array(1.0))  # A mixture without its other component.
vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)
angles = st.floats(-3.0, 3.0)
odds = st.floats(1e-6, 5.0)
seeds = st.integers(0, 10_000)


def values_at(start, displacement, alpha, seed=0, turn=0.0):
    """Values of a displacement, the whole walk turned about up."""
    values = gtsam.Values()
    turned = Rotation.from_euler("z", turn)
    attitudes = Rotation.random(2, rng=np.random.default_rng(seed))
    for key, point, R in zip(KEYS, (start, start + displacement), attitudes, strict=False):
        values.insert(key, gtsam.Pose3(gtsam.Rot3((turned * R).as_matrix()), turned.apply(point)))
    values.insert(KEYS[2], np.array([alpha]))
    return values


def along(course, length=7.0, climb=0.0):
    return length * np.array([np.cos(course), np.sin(course), climb])


@given(course=angles, off=st.floats(-0.2, 0.2), quarter=st.integers(-4, 4), start=vectors, climb=st.floats(-0.5, 0.5))
@settings(max_examples=30, deadline=None)
def test_the_residual_is_what_a_course_is_off_the_nearest_direction(course, off, quarter, start, climb):
    values = values_at(start, along(course, climb=climb), course - off + quarter * QUARTER)
    assert residual(factor_of(ALWAYS, KEYS), values) == pytest.approx([off / SIGMA, 0.0], abs=1e-6)


@given(course=angles, alpha=angles, quarter=st.integers(-3, 3), turn=angles, seed=seeds)
@settings(max_examples=30, deadline=None)
def test_neither_a_quarter_turn_of_the_walk_nor_one_with_the_building_matters(course, alpha, quarter, turn, seed):
    assume(abs(wrap_quarter(np.array(course - alpha))) < 0.7)
    factor = factor_of(BuildingDirection(SIGMA, 0.1, np.array(0.6)), KEYS)
    here = factor.error(values_at(np.zeros(3), along(course), alpha, seed))
    by_quarters = values_at(np.zeros(3), along(course), alpha, seed, quarter * QUARTER)
    together = values_at(np.zeros(3), along(course), alpha + turn, seed, turn)
    assert factor.error(by_quarters) == pytest.approx(here, abs=1e-9)
    assert factor.error(together) == pytest.approx(here, abs=1e-9)


@given(displacement=vectors, alpha=angles, seed=seeds)
@settings(max_examples=30, deadline=None)
def test_jacobians_are_the_derivatives_on_the_manifold(displacement, alpha, seed):
    """Where the weight does not change: of the first row."""
    assume(np.hypot(*displacement[:2]) > 0.5)
    off = float(wrap_quarter(measure_course(displacement) - alpha))
    assume(abs(off) < 0.7)
    factor = factor_of(BuildingDirection(1.0, 1e-300, np.array(0.5)), KEYS)
    values = values_at(np.zeros(3), displacement, alpha, seed)
    stated, numeric = jacobians(factor, values), differences(factor, values)
    for key in KEYS:
        np.testing.assert_allclose(stated[key][0], numeric[key][0], atol=1e-7)


@pytest.mark.parametrize("off_deg", [0.0, 2.0, 5.0, 9.0, 20.0, 44.0])
def test_with_the_weight_held_the_slope_is_that_of_the_loss(off_deg):
    """The gradient H^T e of the linear model is the derivative of h rho by each variable."""
    p = BuildingDirection(SIGMA, 0.1, np.array(0.3))
    factor = factor_of(p, KEYS)
    values = values_at(np.zeros(3), along(0.4 + np.radians(off_deg)), 0.4, 3)
    x = np.radians(off_deg) / SIGMA
    assert factor.error(values) == pytest.approx(0.3 * direction_loss(x, 0.1), abs=1e-12)
    H = jacobians(factor, values)[KEYS[2]]
    slope = float(H[:, 0] @ residual(factor, values))
    h = 1e-6
    there, back = (factor.error(values_at(np.zeros(3), along(0.4 + np.radians(off_deg)), 0.4 + d, 3)) for d in (h, -h))
    assert slope == pytest.approx((there - back) / (2 * h), rel=1e-5, abs=1e-6)


@given(x=st.floats(-12, 12), c=odds)
@settings(max_examples=100, deadline=None)
def test_the_weight_is_the_derivative_of_the_loss_over_the_residual(x, c):
    h = 1e-5
    slope = (direction_loss(x + h, c) - direction_loss(x - h, c)) / (2 * h)
    assert slope == pytest.approx(direction_probability(x, c) * x, abs=1e-7)


@given(off=st.floats(-np.pi / 4, np.pi / 4), sigma_deg=st.floats(0.5, 10), share=st.floats(0.05, 0.95))
@settings(max_examples=50, deadline=None)
def test_the_weight_is_the_posterior_and_the_loss_the_likelihood(off, sigma_deg, share):
    sigma = np.radians(sigma_deg)
    c, x = odds_of_elsewhere(sigma, share), off / sigma
    followed, elsewhere = share * norm.pdf(off, scale=sigma), (1 - share) * 2 / np.pi
    at_zero = share * norm.pdf(0.0, scale=sigma) + elsewhere
    assert direction_probability(x, c) == pytest.approx(followed / (followed + elsewhere), abs=1e-12)
    assert direction_loss(x, c) == pytest.approx(np.log(at_zero / (followed + elsewhere)), abs=1e-9)
