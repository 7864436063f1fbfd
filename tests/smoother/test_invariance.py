"""The velocities of stances show nothing of the heading: at the minimum or next to it, truly or linearized."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import S, V, X

from fg_nav.factors.residual import ResidualBlock
from fg_nav.factors.zero_velocity import StanceVelocity
from tests.linear import linear_factors

UP = np.array([0.0, 0.0, 1.0])


def some_stances(seed: int = 0, nodes: int = 5) -> tuple[ResidualBlock, gtsam.Values]:
    """Nodes in any attitude, with residuals of some sigmas, and a vertical sigma of its own."""
    rng, values = np.random.default_rng(seed), gtsam.Values()
    for k in range(2):
        values.insert(S(k), 0.002 * rng.standard_normal(1))
    for j in range(nodes):
        values.insert(X(j), gtsam.Pose3(gtsam.Rot3.RzRyRx(*rng.standard_normal(3)), rng.standard_normal(3)))
        values.insert(V(j), 0.1 * rng.standard_normal(3))
    settling, sigma = np.tile([0.0, 0.0, -0.005], (nodes, 1)), np.tile([0.02, 0.02, 0.05], (nodes, 1))
    velocity = StanceVelocity(0.1 * rng.standard_normal((nodes, 3)), settling, sigma, np.full(nodes, 3.0))
    return ResidualBlock(velocity, [(X(j), V(j), S(j % 2)) for j in range(nodes)]), values


def turned(values: gtsam.Values, nodes: int = 5) -> gtsam.VectorValues:
    """The step that turns everything by a radian about the vertical, to first order."""
    step = gtsam.VectorValues()
    for j in range(nodes):
        pose = values.atPose3(X(j))
        R = pose.rotation().matrix()
        step.insert(X(j), np.concatenate([R.T @ UP, R.T @ np.cross(UP, pose.translation())]))
        step.insert(V(j), np.cross(UP, values.atVector(V(j))))
    for k in range(2):
        step.insert(S(k), np.zeros(1))
    return step


def test_a_turn_of_everything_is_not_seen() -> None:
    velocities, values = some_stances()
    step = turned(values)
    for factor in linear_factors(velocities, values):
        A, _ = factor.jacobian()
        keys = list(factor.keys())
        seen = A @ np.concatenate([step.at(key) for key in keys])
        np.testing.assert_allclose(seen, 0.0, atol=1e-9)


def test_linearised_error_has_the_slope_of_the_error() -> None:
    velocities, values = some_stances(1)
    rng = np.random.default_rng(2)
    step = gtsam.VectorValues()
    for j in range(5):
        step.insert(X(j), rng.standard_normal(6))
        step.insert(V(j), rng.standard_normal(3))
    for k in range(2):
        step.insert(S(k), rng.standard_normal(1))

    def linear(scale: float) -> float:
        return sum(factor.error(step.scale(scale)) for factor in linear_factors(velocities, values))

    h = 1e-6
    slope = (velocities.error(values.retract(step.scale(h))) - velocities.error(values.retract(step.scale(-h)))) / (
        2 * h
    )
    assert (linear(h) - linear(-h)) / (2 * h) == pytest.approx(slope, rel=1e-5)
    assert linear(0.0) == pytest.approx(velocities.error(values), rel=1e-12)
