"""Floor heights: Jacobians, and what they do to a drifting climb."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X, Z
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.factors.residual import factor_of
from fg_nav.factors.walk_constraints import FloorHeight
from tests.factors.derivatives import residual

vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)
heights = st.floats(-50, 50)


def values_of(rotvec, position, floor):
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3(gtsam.Rot3(Rotation.from_rotvec(rotvec).as_matrix()), position))
    values.insert(Z(0), np.array([floor]))
    return values


@given(rotvec=vectors, position=vectors, floor=heights, across=vectors, up=heights)
@settings(max_examples=20, deadline=None)
def test_only_the_height_above_the_floor_counts(rotvec, position, floor, across, up):
    factor = factor_of(FloorHeight(1.0), [X(0), Z(0)])
    here = residual(factor, values_of(rotvec, position, floor))
    elsewhere = position + np.array([across[0], across[1], up])
    assert here == pytest.approx([position[2] - floor])
    assert residual(factor, values_of(-rotvec, elsewhere, floor + up)) == pytest.approx(here, abs=1e-9)


STOREY, RISER = 3.4, 0.34


def up_and_down(level=20):
    """Heights of footfalls: ground floor, stairs, first floor, stairs, ground floor; and the floors."""
    climb = np.arange(1, 10) * RISER
    height = np.concatenate([np.zeros(level), climb, np.full(level, STOREY), climb[::-1], np.zeros(level)])
    floor = np.repeat([0, -1, 1, -1, 0], [level, 9, level, 9, level])
    return height, floor


def climbed(rng, sigma, step_sigma, floors=True):
    """Heights found from noisy, biased steps, and true heights of the sensor; NEES of the last one."""
    height, floor = up_and_down()
    truth = height + np.where(floor >= 0, rng.normal(0, sigma, len(height)), 0.0)
    truth -= truth[0]
    seen = np.diff(truth) + rng.normal(0, step_sigma, len(truth) - 1)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    step_noise = gtsam.noiseModel.Isotropic.Sigma(6, step_sigma)
    graph.addPriorPose3(X(0), gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-6))
    at = np.append(0.0, np.cumsum(seen))
    for k, z in enumerate(at):
        values.insert(X(k), gtsam.Pose3(gtsam.Rot3(), np.array([0.0, 0.0, z])))
        if k > 0:
            step = gtsam.Pose3(gtsam.Rot3(), np.array([0.0, 0.0, seen[k - 1]]))
            graph.push_back(gtsam.BetweenFactorPose3(X(k - 1), X(k), step, step_noise))
    for k in np.flatnonzero(floor >= 0) if floors else []:
        graph.push_back(factor_of(FloorHeight(sigma), [X(k), Z(floor[k])]))
    for f in np.unique(floor[floor >= 0]) if floors else []:
        values.insert(Z(f), np.array([at[floor == f].mean()]))
    values = values.retract(graph.linearize(values).optimize())
    last = X(len(at) - 1)
    apart = values.atPose3(last).z() - truth[-1]
    return apart, apart**2 / gtsam.Marginals(graph, values).marginalCovariance(last)[5, 5]


def test_a_floor_visited_again_gets_its_height_back_within_the_sigma_that_is_reported():
    """Steps of 2 cm rms drift by 17 cm in the end; the floor holds it to the centimetres of a stance."""
    with_it = np.array([climbed(np.random.default_rng(seed), 0.01, 0.02) for seed in range(60)])
    without = np.array([climbed(np.random.default_rng(seed), 0.01, 0.02, floors=False)[0] for seed in range(60)])
    assert np.sqrt(np.mean(without**2)) > 0.12
    assert np.sqrt(np.mean(with_it[:, 0] ** 2)) < 0.03
    assert with_it[:, 1].mean() == pytest.approx(1.0, abs=3.5 * np.sqrt(2 / 60))
