"""The velocity of a stance: its Jacobians by finite differences, its zero by the physics of a rolling body."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import S, V, X
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.factors import StanceVelocity, factor_of
from fg_nav.lab.simulation.motion import Ramps
from tests.factors.derivatives import residual
from tests.simulated import turning_foot

UNIT = gtsam.noiseModel.Unit.Create(3)
KEYS = [X(0), V(0), S(0)]


def stance(body_velocity, settling, sigma=np.ones(3), sinks_per_m=0.0):
    """The factor of one stance."""
    return factor_of(StanceVelocity(body_velocity, settling, sigma, np.array(sinks_per_m)), KEYS)


vectors = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)


def state(rotvec, position, velocity):
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3(gtsam.Rot3(Rotation.from_rotvec(rotvec).as_matrix()), position))
    values.insert(V(0), velocity)
    values.insert(S(0), np.zeros(1))
    return values


def test_a_softer_sole_sinks_faster_and_nothing_else():
    """One that settles 3 mm more in 0.3 s sinks by 10 mm/s more, in any attitude; that is the slope by it, too."""
    rng = np.random.default_rng(4)
    values = state(rng.standard_normal(3), rng.standard_normal(3), np.zeros(3))
    values.update(S(0), np.array([0.003]))
    u, settling = rng.standard_normal((2, 3))
    factor = stance(u, settling, sinks_per_m=1 / 0.3)
    R = values.atPose3(X(0)).rotation().matrix()
    values.update(V(0), R @ u + settling - np.array([0.0, 0.0, 0.010]))
    np.testing.assert_allclose(residual(factor, values), 0.0, atol=1e-12)
    here, (A, _) = residual(factor, values), factor.linearize(values).jacobian()
    values.update(S(0), values.atVector(S(0)) + 0.001)
    assert factor.keys()[2] == S(0)
    np.testing.assert_allclose(A[:, 9], (residual(factor, values) - here) / 0.001, atol=1e-9)


def rolling_foot(lever, sinking=0.0):
    """A foot that turns about a pivot, which sinks by so many metres meanwhile."""
    begin, width = np.array([0.0]), np.array([0.4])
    turns = [Ramps(begin, width, np.array([rise])) for rise in (0.1, 0.5, -0.2)]
    return turning_foot(lever, turns, up=Ramps(begin, width, np.array([-sinking])))


LEVER = np.array([-0.03, 0.02, 0.11])


@pytest.mark.parametrize("sinking", [0.0, 0.003])
def test_a_body_that_rolls_about_a_settling_pivot_has_no_residual(sinking):
    motion = rolling_foot(LEVER, sinking)
    t = np.linspace(0.02, 0.38, 7)
    now = motion.at(t)
    settling = rolling_foot(np.zeros(3), sinking).at(t).velocity  # of the pivot
    assert np.linalg.norm(now.velocity, axis=1).max() > 0.1
    for k in range(len(t)):
        factor = stance(np.cross(now.rate[k], LEVER), settling[k])
        rotvec = Rotation.from_matrix(now.nav_R_body[k]).as_rotvec()
        values = state(rotvec, now.position[k], now.velocity[k])
        np.testing.assert_allclose(residual(factor, values), 0.0, atol=1e-12)


@given(rotvec=vectors, position=vectors, velocity=vectors)
@settings(max_examples=10, deadline=None)
def test_without_a_lever_it_is_the_plain_zero_velocity_update(rotvec, position, velocity):
    sigma = np.array([0.01, 0.01, 0.01])
    values = state(rotvec, position, velocity)
    graphs = [gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph()]
    graphs[0].push_back(stance(np.zeros(3), np.zeros(3), sigma))
    graphs[1].push_back(gtsam.PriorFactorVector(V(0), np.zeros(3), gtsam.noiseModel.Diagonal.Sigmas(sigma)))
    for graph in graphs:  # the same variables in both
        graph.addPriorPose3(X(0), gtsam.Pose3(), gtsam.noiseModel.Unit.Create(6))
        graph.addPriorVector(V(0), np.zeros(3), UNIT)
        graph.addPriorVector(S(0), np.zeros(1), gtsam.noiseModel.Unit.Create(1))
    assert graphs[0].error(values) == pytest.approx(graphs[1].error(values), rel=1e-12)
    (H0, b0), (H1, b1) = (graph.linearize(values).hessian() for graph in graphs)
    of_velocity = slice(0, 4)  # keys in their order: S, V, X
    np.testing.assert_allclose(H0[of_velocity, of_velocity], H1[of_velocity, of_velocity], rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(b0, b1, rtol=1e-12, atol=1e-6)
