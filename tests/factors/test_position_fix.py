"""Position fixes: the plane, and the errors of simulated fixes."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.factors.walk_constraints import position_fix_noise

vectors = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)


def values_of(rotvec, position):
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3(gtsam.Rot3(Rotation.from_rotvec(rotvec).as_matrix()), position))
    return values


@given(rotvec=vectors, position=vectors, height=st.floats(-100, 100))
@settings(max_examples=20, deadline=None)
def test_a_planar_fix_says_nothing_of_the_height(rotvec, position, height):
    factor = gtsam.GPSFactor(X(0), np.array([1.0, 2.0, 3.0]), position_fix_noise(0.5))
    higher = position + np.array([0.0, 0.0, height])
    assert factor.error(values_of(rotvec, higher)) == pytest.approx(factor.error(values_of(rotvec, position)))
    information = factor.linearize(values_of(rotvec, position)).information()[3:, 3:]
    nav_R_body = Rotation.from_rotvec(rotvec).as_matrix()
    np.testing.assert_allclose(nav_R_body @ information @ nav_R_body.T, np.diag([4.0, 4.0, 0.0]), atol=1e-9)


@pytest.mark.parametrize("sigmas", [(0.0, 1.0), (-1.0, 1.0), (1.0, float("nan"))])
def test_sigmas_must_be_above_zero(sigmas):
    with pytest.raises(ValueError, match="position fix: the sigmas"):
        position_fix_noise(*sigmas)
