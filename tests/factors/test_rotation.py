"""Rotation vectors: against scipy, and the left Jacobian by finite differences."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.factors.rotation import left_jacobian, rotation_exp, skew
from tests.factors.attitudes import vectors

scales = st.sampled_from([1e-9, 1e-4, 0.02, 0.03, 1.0])


@given(a=vectors, b=vectors)
@settings(max_examples=20, deadline=None)
def test_the_cross_product_as_a_matrix(a, b):
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-14)


@given(t=vectors, scale=scales)
@settings(max_examples=40, deadline=None)
def test_the_rotation_of_a_vector_is_that_of_scipy(t, scale):
    np.testing.assert_allclose(rotation_exp(scale * t), Rotation.from_rotvec(scale * t).as_matrix(), atol=1e-14)


@given(t=vectors, scale=scales, d=vectors)
@settings(max_examples=40, deadline=None)
def test_the_left_jacobian_is_the_derivative_from_the_left(t, scale, d):
    t, h = scale * t, 1e-5
    there, back = (Rotation.from_rotvec(t + s * h * d) for s in (1, -1))
    turn = (there * back.inv()).as_rotvec() / (2 * h)
    np.testing.assert_allclose(left_jacobian(t) @ d, turn, atol=1e-8)


def test_many_at_once_are_each_by_itself():
    t = np.random.default_rng(5).normal(size=(2, 4, 3))
    for i, j in np.ndindex(2, 4):
        np.testing.assert_array_equal(rotation_exp(t)[i, j], rotation_exp(t[i, j]))
        np.testing.assert_array_equal(left_jacobian(t)[i, j], left_jacobian(t[i, j]))
