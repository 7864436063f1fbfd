"""A walk that was not seen: Jacobians, and what counts in it."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.factors.residual import factor_of
from fg_nav.factors.walk_constraints import UnseenWalk
from tests.factors.derivatives import assert_jacobians_are_derivatives, residual

vectors = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)
angles = st.floats(-3, 3)


def factor(turn=0.0):
    walk = UnseenWalk(np.array([2.0, 2.0, 0.5]), np.array(turn), np.array(0.7), np.array(0.3))
    return factor_of(walk, [X(0), X(1)])


def values_of(first, second):
    values = gtsam.Values()
    for k, (attitude, position) in enumerate((first, second)):
        values.insert(X(k), gtsam.Pose3(gtsam.Rot3(attitude.as_matrix()), position))
    return values


@given(tilts=vectors, yaw=angles, positions=vectors, turn=angles)
@settings(max_examples=30, deadline=None)
def test_jacobians_are_the_derivatives_on_the_manifold(tilts, yaw, positions, turn):
    first = Rotation.from_rotvec(tilts)
    second = Rotation.from_rotvec([0.0, 0.0, yaw]) * first * Rotation.from_rotvec(0.2 * tilts[::-1])
    values = values_of((first, positions), (second, 3 * positions[::-1]))
    assume(abs(residual(factor(turn), values)[3]) < 3.0 / 0.7)  # not half a turn off
    assert_jacobians_are_derivatives(factor(turn), values, 1e-6)


@given(tilts=vectors, yaw=angles, move=vectors, turn=angles)
@settings(max_examples=30, deadline=None)
def test_it_counts_how_far_a_person_came_and_turned_and_how_the_foot_was_put_down(tilts, yaw, move, turn):
    """From an attitude to one turned about up, of the same tilt; the displacement is that in the world."""
    first = Rotation.from_rotvec(tilts)
    second = Rotation.from_rotvec([0.0, 0.0, yaw]) * first
    e = residual(factor(turn), values_of((first, np.ones(3)), (second, np.ones(3) + move)))
    assert e[:3] == pytest.approx(move / [2.0, 2.0, 0.5], abs=1e-9)
    off = (yaw - turn + np.pi) % (2 * np.pi) - np.pi
    assert abs(e[3]) == pytest.approx(abs(off) / 0.7, abs=1e-9)
    assert e[4:] == pytest.approx(np.zeros(3), abs=1e-9)
    tipped = first * Rotation.from_rotvec([0.03, 0.0, 0.0])
    e = residual(factor(), values_of((first, np.zeros(3)), (tipped, np.zeros(3))))
    up = first.as_matrix()[2]
    assert np.linalg.norm(e[4:]) == pytest.approx(0.03 * np.linalg.norm(np.cross(up, [1, 0, 0])) / 0.3, rel=0.02)
