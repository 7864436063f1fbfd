"""Gravity in stance: levels to the truth over simulated stances within its sigma, and says nothing of yaw."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.factors.gravity import STANDARD_GRAVITY, gravity_factor, gravity_sigma
from tests.factors.derivatives import assert_jacobians_are_derivatives, residual

vectors = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)
UP = np.array([0.0, 0.0, 1.0])


def values_of(nav_R_body, position=(0.0, 0.0, 0.0)):
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3(gtsam.Rot3(nav_R_body), np.array(position)))
    return values


@given(rotvec=vectors, yaw=st.floats(-np.pi, np.pi), size=st.floats(1.0, 20.0))
@settings(max_examples=20, deadline=None)
def test_a_level_truth_has_no_residual_whatever_its_yaw(rotvec, yaw, size):
    attitude = Rotation.from_rotvec(rotvec)
    factor = gravity_factor(X(0), size * attitude.inv().apply(UP), 1.0)
    turned = Rotation.from_euler("z", yaw) * attitude
    np.testing.assert_allclose(residual(factor, values_of(turned.as_matrix(), (5.0, 6.0, 7.0))), 0.0, atol=1e-12)


@given(rotvec=vectors, tilt=st.floats(1e-3, 0.1), about=st.floats(-np.pi, np.pi))
@settings(max_examples=20, deadline=None)
def test_a_small_tilt_is_the_residual_over_sigma(rotvec, tilt, about):
    attitude = Rotation.from_rotvec(rotvec)
    factor = gravity_factor(X(0), attitude.inv().apply(UP), 0.01)
    tilted = Rotation.from_rotvec(tilt * np.array([np.cos(about), np.sin(about), 0.0])) * attitude
    assert np.linalg.norm(residual(factor, values_of(tilted.as_matrix()))) == pytest.approx(np.sin(tilt) / 0.01)


@given(rotvec=vectors, force=vectors)
@settings(max_examples=20, deadline=None)
def test_jacobians_are_the_derivatives_on_the_manifold(rotvec, force):
    attitude = Rotation.from_rotvec(rotvec).as_matrix()
    factor = gravity_factor(X(0), force + 9.0 * UP, 1.0)
    assert_jacobians_are_derivatives(factor, values_of(attitude))


@given(rotvec=vectors)
@settings(max_examples=20, deadline=None)
def test_yaw_and_position_get_no_information(rotvec):
    attitude = Rotation.from_rotvec(rotvec)
    body_up = attitude.inv().apply(UP)
    factor = gravity_factor(X(0), body_up, 0.01)
    information = factor.linearize(values_of(attitude.as_matrix())).information()
    np.testing.assert_allclose(information[:3, :3], 1e4 * (np.eye(3) - np.outer(body_up, body_up)), atol=1e-6)
    np.testing.assert_array_equal(information[3:], 0.0)
    np.testing.assert_array_equal(information[:, 3:], 0.0)


def test_upside_down_it_is_zero_too_as_the_page_says():
    factor = gravity_factor(X(0), UP, 0.01)
    np.testing.assert_allclose(residual(factor, values_of(np.diag([1.0, -1.0, -1.0]))), 0.0, atol=1e-12)


def levelled(attitude, force, sigma):
    """Attitude that minimises the factor's error and a prior's on yaw and position, from the truth on."""
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(gravity_factor(X(0), force, sigma))
    values = values_of(attitude.as_matrix())
    graph.addPriorPose3(X(0), values.atPose3(X(0)), gtsam.noiseModel.Diagonal.Sigmas(np.full(6, 1e3 * sigma)))
    for _ in range(3):
        values = values.retract(graph.linearize(values).optimize())
    return Rotation.from_matrix(values.atPose3(X(0)).rotation().matrix())


@pytest.mark.parametrize(
    ("duration", "velocity_sigma", "density", "bias_sigma"),
    [(0.3, 0.01, 2e-3, 0.0), (0.3, 0.0, 2e-2, 0.0), (1.0, 1e-3, 2e-3, 0.05)],
)
def test_the_tilt_of_simulated_stances_is_within_the_sigma(duration, velocity_sigma, density, bias_sigma):
    """A stance whose velocity at the ends is not quite zero, noise sample by sample, a bias: 200 of each."""
    sigma = float(gravity_sigma(duration, velocity_sigma, density, bias_sigma))
    n, tilts = 60, []
    h = duration / n
    for seed in range(200):
        rng = np.random.default_rng(seed)
        attitude = Rotation.from_rotvec(rng.normal(0, 1, 3))
        ends = rng.normal(0, velocity_sigma, (2, 3))
        velocity = ends[0] + (ends[1] - ends[0]) * np.linspace(0, 1, n + 1)[:, None] ** 2
        nav_force = np.diff(velocity, axis=0) / h + STANDARD_GRAVITY * UP
        noise = density / np.sqrt(h) * rng.normal(size=(n, 3)) + rng.normal(0, bias_sigma, 3)
        found = levelled(attitude, (attitude.inv().apply(nav_force) + noise).mean(axis=0), sigma)
        tilts.append((found * attitude.inv()).as_rotvec()[:2])
    chi_square = (np.square(tilts) / sigma**2).sum()  # of 400 degrees of freedom
    assert chi_square == pytest.approx(400, abs=4 * np.sqrt(800))


def test_no_force_has_no_direction():
    for force in (np.zeros(3), np.full(3, np.nan)):
        with pytest.raises(ValueError, match="gravity: the mean specific force"):
            gravity_factor(X(0), force, 0.01)
