"""Two moments at one place: Jacobians, what the residual is, and that a turn about up leaves it alone."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.factors.residual import factor_of
from fg_nav.factors.same_place import SamePlace, weigh_place
from tests.factors.derivatives import residual

vectors = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)
headings = st.floats(-3, 3)


def pose(rotvec, position):
    return gtsam.Pose3(gtsam.Rot3(Rotation.from_rotvec(rotvec).as_matrix()), position)


def values_of(later, earlier):
    values = gtsam.Values()
    values.insert(X(1), later)
    values.insert(X(0), earlier)
    return values


def factor(later, earlier, heading):
    (weight,) = weigh_place(np.array([heading]), 0.3, 0.6, 0.2)
    return factor_of(SamePlace(later, earlier, weight), [X(1), X(0)])


@given(rotvec=vectors, other=vectors, position=vectors, later=vectors, earlier=vectors, turn=headings)
@settings(max_examples=20, deadline=None)
def test_a_walk_that_is_turned_about_up_closes_as_well(rotvec, other, position, later, earlier, turn):
    one, two = pose(rotvec, position), pose(other, -position)
    about_up = gtsam.Pose3(gtsam.Rot3.Yaw(turn), np.zeros(3))
    here = residual(factor(later, earlier, 0.3), values_of(one, two))
    turned = residual(factor(later, earlier, 0.3 + turn), values_of(about_up * one, about_up * two))
    np.testing.assert_allclose(turned, here, atol=1e-9)


def test_meters_over_the_sigmas_along_across_and_up():
    """A walk north: east is to its right, and north ahead."""
    seen = factor(np.zeros(3), np.zeros(3), np.pi / 2)
    off = values_of(pose(np.zeros(3), np.array([0.6, 0.3, 0.2])), pose(np.zeros(3), np.zeros(3)))
    assert residual(seen, off) == pytest.approx([1.0, -1.0, 1.0])


def test_points_that_are_one_place_leave_nothing():
    """A meter ahead of the one footfall is a meter behind the other, which looks the opposite way."""
    ahead = np.array([1.0, 0.0, 0.0])
    one, two = pose(np.zeros(3), np.zeros(3)), pose(np.array([0.0, 0.0, np.pi]), np.array([2.0, 0.0, 0.0]))
    assert residual(factor(ahead, ahead, 0.0), values_of(one, two)) == pytest.approx(np.zeros(3), abs=1e-12)
