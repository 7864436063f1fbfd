"""Position fixes: the geometry of the lever, the plane, and the errors of simulated fixes."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.factors.position_fix import position_fix_factor, position_fix_noise
from tests.factors.derivatives import assert_jacobians_are_derivatives, residual

UNIT = gtsam.noiseModel.Unit.Create(3)
vectors = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)
levers = st.one_of(st.none(), vectors)


def values_of(rotvec, position):
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3(gtsam.Rot3(Rotation.from_rotvec(rotvec).as_matrix()), position))
    return values


@given(rotvec=vectors, position=vectors, lever=levers, off=vectors)
@settings(max_examples=20, deadline=None)
def test_the_residual_is_from_the_fix_to_the_point_at_the_lever(rotvec, position, lever, off):
    point = position + (0.0 if lever is None else Rotation.from_rotvec(rotvec).apply(lever))
    factor = position_fix_factor(X(0), point - off, UNIT, lever)
    np.testing.assert_allclose(residual(factor, values_of(rotvec, position)), off, atol=1e-12)


@given(rotvec=vectors, position=vectors, lever=levers)
@settings(max_examples=20, deadline=None)
def test_jacobians_are_the_derivatives_on_the_manifold(rotvec, position, lever):
    factor = position_fix_factor(X(0), np.array([1.0, 2.0, 3.0]), UNIT, lever)
    assert_jacobians_are_derivatives(factor, values_of(rotvec, position))


@given(rotvec=vectors, shift=vectors)
@settings(max_examples=20, deadline=None)
def test_shifting_the_world_changes_nothing(rotvec, shift):
    lever, fix, position = np.array([0.1, 0.2, 1.3]), np.array([3.0, 2.0, 1.0]), np.array([2.0, 2.0, 0.0])
    here = position_fix_factor(X(0), fix, UNIT, lever)
    there = position_fix_factor(X(0), fix + shift, UNIT, lever)
    before, after = (residual(f, values_of(rotvec, p)) for f, p in ((here, position), (there, position + shift)))
    np.testing.assert_allclose(before, after, atol=1e-12)


@given(rotvec=vectors, position=vectors, height=st.floats(-100, 100))
@settings(max_examples=20, deadline=None)
def test_a_planar_fix_says_nothing_of_the_height(rotvec, position, height):
    factor = position_fix_factor(X(0), np.array([1.0, 2.0, 3.0]), position_fix_noise(0.5))
    higher = position + np.array([0.0, 0.0, height])
    assert factor.error(values_of(rotvec, higher)) == pytest.approx(factor.error(values_of(rotvec, position)))
    information = factor.linearize(values_of(rotvec, position)).information()[3:, 3:]
    nav_R_body = Rotation.from_rotvec(rotvec).as_matrix()
    np.testing.assert_allclose(nav_R_body @ information @ nav_R_body.T, np.diag([4.0, 4.0, 0.0]), atol=1e-9)


def test_without_a_lever_attitude_gets_no_information_and_with_one_it_does():
    values = values_of(np.array([0.1, 0.2, 0.3]), np.zeros(3))
    plain, levered = (
        position_fix_factor(X(0), np.zeros(3), UNIT, lever) for lever in (None, np.array([0.0, 0.0, 1.0]))
    )
    np.testing.assert_array_equal(plain.linearize(values).information()[:3, :3], 0.0)
    assert np.linalg.matrix_rank(levered.linearize(values).information()[:3, :3], tol=1e-9) == 2


def test_many_fixes_are_averaged_to_within_the_sigma_that_is_reported():
    """A walk whose steps are known and whose yaw is not: fixes give both, over 60 seeds."""
    track = np.stack([np.linspace(0, 30, 8), 3 * np.sin(np.linspace(0, 3, 8)), np.zeros(8)], axis=1)
    nees = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        yaw, start, sigmas = rng.uniform(-1, 1), rng.normal(0, 5, 3), np.array([1.0, 1.0, 3.0])
        fixes = start + Rotation.from_euler("z", yaw).apply(track) + sigmas * rng.normal(size=track.shape)
        graph = gtsam.NonlinearFactorGraph()
        for lever, fix in zip(track, fixes, strict=True):  # the track is rigid: each point at its own lever
            graph.push_back(position_fix_factor(X(0), fix, position_fix_noise(1.0, 3.0), lever))
        level = gtsam.noiseModel.Diagonal.Precisions(np.array([1e8, 1e8, 0, 0, 0, 0]))
        graph.addPriorPose3(X(0), gtsam.Pose3(), level)
        truth = values_of([0, 0, yaw], start)
        values = truth
        for _ in range(5):
            values = values.retract(graph.linearize(values).optimize())
        covariance = gtsam.Marginals(graph, values).marginalCovariance(X(0))[2:, 2:]
        apart = values.atPose3(X(0)).localCoordinates(truth.atPose3(X(0)))[2:]
        nees.append(apart @ np.linalg.solve(covariance, apart))
    assert np.mean(nees) == pytest.approx(4.0, abs=3.5 * np.sqrt(8 / 60))


@pytest.mark.parametrize("sigmas", [(0.0, 1.0), (-1.0, 1.0), (1.0, float("nan"))])
def test_sigmas_must_be_above_zero(sigmas):
    with pytest.raises(ValueError, match="position fix: the sigmas"):
        position_fix_noise(*sigmas)
