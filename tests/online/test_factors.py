"""The factors of a walk in progress: the batch's ties, one by one."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import M, S, V, X

from fg_nav.online.field import (
    across_factor,
    along_factor,
    carried_factor,
    field_factors,
    first_factor,
    turned,
)
from fg_nav.online.ties import GraphTies, velocity_tie_factor
from fg_nav.smoother.field_state import E_H
from fg_nav.smoother.strides import VelocityTies
from tests.factors.attitudes import pose, values_of
from tests.factors.derivatives import assert_jacobians_are_derivatives
from tests.smoother.test_field_state import FIRST, Walked, attitudes

TIE = (np.array([0.02, -0.03, 0.01]), np.array([0.0, 0.0, -0.004]), np.array([0.01, 0.01, 0.02]))


def standing(seed: int) -> gtsam.Values:
    rng = np.random.default_rng(seed)
    return values_of(
        {
            X(3): pose(attitudes(rng, 1)[0], rng.standard_normal(3)),
            V(3): rng.standard_normal(3) / 30,
            S(1): np.array([2e-3]),
        }
    )


@pytest.mark.parametrize("seed", range(3))
def test_velocity_tie_has_the_derivatives_it_states(seed):
    assert_jacobians_are_derivatives(velocity_tie_factor(X(3), V(3), S(1), *TIE, 3.0), standing(seed), atol=1e-5)


def test_velocity_tie_says_what_the_batch_says():
    graph, values = gtsam.NonlinearFactorGraph(), standing(0)
    for ties in (GraphTies(graph), both := VelocityTies()):
        ties.add(3, *TIE, 1, 3.0)
    assert graph.error(values) == pytest.approx(both.error(values), rel=1e-12)
    mine, theirs = graph.linearize(values).at(0), next(both.linearize(values))
    order = gtsam.Ordering()
    for key in (X(3), V(3), S(1)):
        order.push_back(key)
    for one, other in zip(_dense(mine, order), _dense(theirs, order), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


def _dense(factor, order):
    graph = gtsam.GaussianFactorGraph()
    graph.push_back(factor)
    return graph.jacobian(order)


@pytest.mark.parametrize("seed", range(3))
def test_field_factors_have_the_derivatives_they_state(seed):
    walked = Walked(seed=seed, tilt=0.0)
    values, way = walked.values(off=0.3), walked.way
    across = across_factor(1, 2, walked.seen.body_field[1], way.level_R_body, 0.3)
    along = along_factor(1, 0, way.u[0], way.level_way[0], way.body_move[0], 0.1)
    level = values_of({key: values.atPose3(key) for key in ()})
    for k in range(walked.count):
        upright = pose(walked.nav_R_body[k], walked.position[k])
        level.insert(X(2 * k), upright)
        level.insert(M(k), values.atVector(M(k)))
    yaw_only = [across, along]
    for factor in yaw_only:
        _assert_turns_about_up(factor, level)
    assert_jacobians_are_derivatives(first_factor(FIRST), level, atol=1e-6)
    assert_jacobians_are_derivatives(carried_factor(1, np.full(8, 0.7), np.full(8, 0.2)), level, atol=1e-6)


def _assert_turns_about_up(factor, values):
    """Jacobians by the states, and by a turn about up; by tilt a field factor states none, on purpose."""
    from tests.factors.derivatives import differences, jacobians

    stated, found = jacobians(factor, values), differences(factor, values)
    for key, by in stated.items():
        if chr(gtsam.Symbol(key).chr()) == "m":
            np.testing.assert_allclose(by, found[key], atol=1e-5)
        else:
            up = values.atPose3(key).rotation().matrix()[2]
            np.testing.assert_allclose(by[:, :3] @ up, found[key][:, :3] @ up, atol=1e-4)


def test_field_of_a_walk_says_what_the_batch_says():
    disturbed = np.array([False, False, True, False])
    walked = Walked(seed=4, disturbed=disturbed)
    values, graph = walked.values(off=0.3), gtsam.NonlinearFactorGraph()
    field_factors(graph, walked.ties, FIRST)
    assert graph.error(values) == pytest.approx(walked.ties.error(values), rel=1e-9)
    theirs = gtsam.GaussianFactorGraph()
    for factor in walked.ties.linearize(values):
        theirs.push_back(factor)
    order = walked.order()
    mine = graph.linearize(values)
    (A, b), (C, d) = mine.jacobian(order), theirs.jacobian(order)
    np.testing.assert_allclose(A.T @ A, C.T @ C, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(A.T @ b, C.T @ d, rtol=1e-9, atol=1e-6)


def test_a_prior_turns_with_its_walk():
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(turned(FIRST, quarter).mean[E_H], [-FIRST.mean[4], FIRST.mean[3]])
