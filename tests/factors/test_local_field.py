"""The local field: Jacobians, its two limits (a known field, and the differential field), and what goes with it."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import E, H, M, X
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_t

from fg_nav.factors.differential_field import differential_field_factor, differential_field_residual
from fg_nav.factors.local_field import (
    earth_field_prior,
    field_tie_coefficients,
    field_tie_factor,
    field_tie_residual,
    local_field_factor,
    local_field_residual,
    student_t_information,
    student_t_noise,
)
from fg_nav.factors.magnetic_heading import heading_sigma, magnetic_heading_factor
from tests.factors.attitudes import attitude, eliminated, fields, information, pose, values_of, vectors
from tests.factors.derivatives import assert_jacobians_are_derivatives, jacobians, residual

UNIT = gtsam.noiseModel.Unit.Create(3)
EARTH = np.array([1.0, 21.0, -43.0])
SIGMA = 0.7
NOISE = gtsam.noiseModel.Isotropic.Sigma(3, SIGMA)
UP = np.array([0.0, 0.0, 1.0])


@given(a=vectors, at=vectors, m=fields, h=fields, y=fields, with_iron=st.booleans())
@settings(max_examples=30, deadline=None)
def test_jacobians_are_the_derivatives_on_the_manifold(a, at, m, h, y, with_iron):
    variables = {X(0): pose(attitude(a), at), M(0): m} | ({H(0): h} if with_iron else {})
    factor = local_field_factor(X(0), M(0), y, UNIT, H(0) if with_iron else None)
    assert len(factor.keys()) == len(variables)
    assert_jacobians_are_derivatives(factor, values_of(variables), atol=1e-6)


@given(a=vectors, at=vectors, m=fields, h=fields)
@settings(max_examples=20, deadline=None)
def test_a_sensor_with_hard_iron_in_the_field_has_no_residual(a, at, m, h):
    measured = attitude(a).T @ m + h
    variables = {X(0): pose(attitude(a), at), M(0): m}
    known = local_field_factor(X(0), M(0), measured, UNIT, hard_iron=h)
    free = local_field_factor(X(0), M(0), measured, UNIT, hard_iron_key=H(0))
    np.testing.assert_allclose(residual(known, values_of(variables)), 0.0, atol=1e-12)
    np.testing.assert_allclose(residual(free, values_of({**variables, H(0): h})), 0.0, atol=1e-12)
    ignored = local_field_factor(X(0), M(0), measured, UNIT)
    np.testing.assert_allclose(residual(ignored, values_of(variables)), -h, atol=1e-12)


@given(a=vectors, turn=vectors, m=fields, y=fields)
@settings(max_examples=20, deadline=None)
def test_turning_body_and_field_together_changes_nothing(a, turn, m, y):
    Q, R = attitude(turn), attitude(a)
    e = local_field_residual(R, m, np.zeros(3), y)
    np.testing.assert_allclose(local_field_residual(Q @ R, Q @ m, np.zeros(3), y), e, atol=1e-10)


@given(a=vectors)
@settings(max_examples=20, deadline=None)
def test_with_a_tight_prior_it_is_the_factor_of_a_known_field(a):
    R = attitude(a)
    y = R.T @ EARTH
    ours, theirs = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph()
    ours.push_back(local_field_factor(X(0), M(0), y, NOISE))
    ours.push_back(gtsam.PriorFactorVector(M(0), EARTH, gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    strength, north = float(np.linalg.norm(EARTH)), EARTH / np.linalg.norm(EARTH)
    theirs.push_back(gtsam.MagPoseFactorPose3(X(0), y, strength, north, np.zeros(3), NOISE))
    variables = {X(0): pose(R), M(0): EARTH}
    known = eliminated(information(ours, variables, [X(0), M(0)]), 6)
    np.testing.assert_allclose(known, information(theirs, {X(0): pose(R)}, [X(0)]), atol=1e-4)


@given(a=vectors)
@settings(max_examples=20, deadline=None)
def test_with_a_tight_prior_it_says_as_much_of_yaw_as_a_heading_of_honest_sigma(a):
    R = attitude(a)
    graph, heading = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph()
    graph.push_back(local_field_factor(X(0), M(0), R.T @ EARTH, NOISE))
    graph.push_back(gtsam.PriorFactorVector(M(0), EARTH, gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    sigma = float(heading_sigma(np.hypot(*EARTH[:2]), SIGMA))
    declination = np.arctan2(EARTH[0], EARTH[1])
    noise = gtsam.noiseModel.Isotropic.Sigma(1, sigma)
    heading.push_back(magnetic_heading_factor(X(0), R.T @ EARTH, declination, noise))
    up = np.concatenate([R.T @ UP, np.zeros(3)])
    ours = up @ eliminated(information(graph, {X(0): pose(R), M(0): EARTH}, [X(0), M(0)]), 6) @ up
    theirs = up @ information(heading, {X(0): pose(R)}, [X(0)]) @ up
    assert ours == pytest.approx(theirs, rel=1e-6)
    assert ours == pytest.approx(1 / sigma**2, rel=1e-6)


def test_a_wide_prior_takes_its_sigma_from_the_heading():
    """Information on yaw falls with the deviations of the field, as sigma^2 = sensor^2 + deviation^2 says."""
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(local_field_factor(X(0), M(0), EARTH, NOISE))
    graph.push_back(gtsam.PriorFactorVector(M(0), EARTH, gtsam.noiseModel.Isotropic.Sigma(3, 9.0)))
    found = eliminated(information(graph, {X(0): pose(np.eye(3)), M(0): EARTH}, [X(0), M(0)]), 6)[2, 2]
    assert found == pytest.approx(heading_sigma(np.hypot(*EARTH[:2]), np.hypot(SIGMA, 9.0)) ** -2, rel=1e-9)


@given(a=vectors, b=vectors)
@settings(max_examples=20, deadline=None)
def test_with_a_loose_prior_two_poses_are_the_differential_field(a, b):
    i, j = attitude(a), attitude(b)
    y_i, y_j = i.T @ EARTH, j.T @ EARTH
    ours, theirs = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph()
    ours.push_back(local_field_factor(X(0), M(0), y_i, NOISE))
    ours.push_back(local_field_factor(X(1), M(0), y_j, NOISE))
    ours.push_back(gtsam.PriorFactorVector(M(0), np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, 1e6)))
    both = gtsam.noiseModel.Isotropic.Sigma(3, SIGMA * np.sqrt(2))
    theirs.push_back(differential_field_factor(X(0), X(1), y_i, y_j, both))
    variables = {X(0): pose(i), X(1): pose(j), M(0): EARTH}
    without = eliminated(information(ours, variables, [X(0), X(1), M(0)]), 12)
    expected = information(theirs, {X(0): pose(i), X(1): pose(j)}, [X(0), X(1)])
    np.testing.assert_allclose(without, expected, atol=1e-5)


@given(a=vectors, b=vectors, y_i=fields, y_j=fields)
@settings(max_examples=20, deadline=None)
def test_and_its_least_error_is_the_differential_one_for_any_measurement(a, b, y_i, y_j):
    i, j = attitude(a), attitude(b)
    best = (i @ y_i + j @ y_j) / 2
    ours = sum((local_field_residual(R, best, np.zeros(3), y) ** 2).sum() for R, y in ((i, y_i), (j, y_j)))
    theirs = (differential_field_residual(i, j, y_i, y_j) ** 2).sum() / 2
    assert ours == pytest.approx(theirs, abs=1e-8)


@given(m=fields, dof=st.floats(1.0, 8.0), scale=st.floats(1.0, 15.0))
@settings(max_examples=40, deadline=None)
def test_the_robust_prior_is_the_likelihood_of_a_student_t(m, dof, scale):
    prior = earth_field_prior(M(0), EARTH, scale, dof)
    student = multivariate_t(EARTH, scale**2 * np.eye(3), df=dof)
    assert prior.error(values_of({M(0): m})) == pytest.approx(student.logpdf(EARTH) - student.logpdf(m), abs=1e-9)


@given(deviation=fields, dof=st.floats(1.0, 8.0), scale=st.floats(1.0, 15.0))
@settings(max_examples=40, deadline=None)
def test_reweighting_by_hand_is_what_gtsam_does(deviation, dof, scale):
    prior = gtsam.PriorFactorVector(M(0), EARTH, student_t_noise(scale, dof))
    A = jacobians(prior, values_of({M(0): EARTH + deviation}))[M(0)]
    np.testing.assert_allclose(A.T @ A, student_t_information(deviation, scale, dof) * np.eye(3), atol=1e-12)


def test_a_magnet_moves_the_field_and_not_the_heading():
    """60 uT of deviation: with a robust prior the yaw hardly follows, with a Gaussian one of its scale it does."""
    beside_a_magnet = EARTH + np.array([60.0, 0.0, 0.0])
    followed = []
    for noise in (student_t_noise(4.0, 4.0), gtsam.noiseModel.Isotropic.Sigma(3, 4.0)):
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(local_field_factor(X(0), M(0), beside_a_magnet, NOISE))
        graph.push_back(gtsam.PriorFactorVector(M(0), EARTH, noise))
        graph.addPriorPose3(X(0), pose(np.eye(3)), gtsam.noiseModel.Isotropic.Sigma(6, 0.05))
        values = values_of({X(0): pose(np.eye(3)), M(0): beside_a_magnet})
        for _ in range(20):
            values = values.retract(graph.linearize(values).optimize())
        followed.append(np.linalg.norm(gtsam.Rot3.Logmap(values.atPose3(X(0)).rotation())))
    assert followed[0] < 0.15 * followed[1]
    assert np.degrees(followed[0]) < 2.0


def test_chained_by_the_tie_the_deviations_are_a_stationary_gauss_markov_process():
    distance, length, sigma = np.array([0.7, 1.3, 0.2, 4.0, 0.9]), 2.5, 6.0
    left, sigma_w = field_tie_coefficients(distance, length, sigma)
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(gtsam.PriorFactorVector(M(0), EARTH, gtsam.noiseModel.Isotropic.Sigma(3, sigma)))
    for k in range(5):
        graph.push_back(field_tie_factor(M(k), M(k + 1), left[k], sigma_w[k], earth_field=EARTH))
    variables = {M(k): np.array([5.0, 6.0, 7.0]) for k in range(6)}
    covariance = np.linalg.inv(information(graph, variables, [M(k) for k in range(6)]))
    s = np.concatenate([[0.0], np.cumsum(distance)])
    expected = sigma**2 * np.exp(-np.abs(s[:, None] - s) / length)
    np.testing.assert_allclose(covariance, np.kron(expected, np.eye(3)), rtol=1e-9, atol=1e-9)
    step = graph.linearize(values_of(variables)).optimize()
    for k in range(6):
        np.testing.assert_allclose(variables[M(k)] + step.at(M(k)), EARTH, atol=1e-9)


def test_the_coefficients_at_their_ends():
    left, sigma_w = field_tie_coefficients(np.array([0.0, 1e6]), 2.0, 6.0)
    assert 0.99 < left[0] < 1.0
    assert 0.0 < sigma_w[0] < 1.0  # on the spot: still a noise that can be divided by
    assert (left[1], sigma_w[1]) == (0.0, 6.0)


@given(m=fields, before=fields, earth=fields, left=st.floats(0.0, 1.0), sigma=st.floats(0.1, 9.0))
@settings(max_examples=30, deadline=None)
def test_the_native_tie_is_its_residual_with_the_earth_given_or_a_variable(m, before, earth, left, sigma):
    expected = field_tie_residual(m, before, earth, left) / sigma
    given_ = field_tie_factor(M(0), M(1), left, sigma, earth_field=earth)
    free = field_tie_factor(M(0), M(1), left, sigma, earth_key=E(0))
    variables = {M(0): before, M(1): m}
    for factor, there in ((given_, variables), (free, {**variables, E(0): earth})):
        np.testing.assert_allclose(residual(factor, values_of(there)), expected, atol=1e-9)
        assert factor.error(values_of(there)) == pytest.approx(0.5 * expected @ expected, abs=1e-7)
        assert_jacobians_are_derivatives(factor, values_of(there), atol=1e-4)


def test_a_tie_needs_one_earth():
    with pytest.raises(ValueError, match="either"):
        field_tie_factor(M(0), M(1), 0.5, 1.0)
    with pytest.raises(ValueError, match="either"):
        field_tie_factor(M(0), M(1), 0.5, 1.0, earth_field=EARTH, earth_key=E(0))


def test_drifting_hard_iron_is_found_while_the_body_turns():
    """Twelve headings, three local fields, hard iron on a random walk: each within a few of its sigmas, and small."""
    rng = np.random.default_rng(5)
    graph, start, truth = gtsam.NonlinearFactorGraph(), gtsam.Values(), []
    h, walk = np.array([8.0, -5.0, 3.0]), gtsam.noiseModel.Isotropic.Sigma(3, 0.3)
    local = EARTH + rng.normal(0.0, 3.0, (3, 3))
    for k in range(12):
        R = attitude([0.2 * np.sin(k), 0.2 * np.cos(2 * k), 0.0]) @ attitude([0.0, 0.0, 0.8 * k])
        y = R.T @ local[k % 3] + h + rng.normal(0.0, SIGMA, 3)
        graph.push_back(local_field_factor(X(k), M(k % 3), y, NOISE, hard_iron_key=H(k)))
        graph.addPriorPose3(X(k), pose(R), gtsam.noiseModel.Isotropic.Sigma(6, 0.01))
        if k > 0:
            graph.push_back(gtsam.BetweenFactorVector(H(k - 1), H(k), np.zeros(3), walk))
        start.insert(X(k), pose(R))
        start.insert(H(k), np.zeros(3))
        truth.append(h)
        h = h + rng.normal(0.0, 0.3, 3)
    graph.push_back(gtsam.PriorFactorVector(H(0), np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, 20.0)))
    for k in range(3):
        graph.push_back(earth_field_prior(M(k), EARTH, 3.0, 4.0))
        start.insert(M(k), EARTH)
    found = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    marginals = gtsam.Marginals(graph, found)
    for k in range(12):
        off, covariance = found.atVector(H(k)) - truth[k], marginals.marginalCovariance(H(k))
        assert off @ np.linalg.solve(covariance, off) < 16.3  # 99.9 % of chi-square with 3 degrees of freedom
        assert np.sqrt(np.trace(covariance)) < 2.0


def test_many_stances_at_once_are_each_by_itself():
    rng = np.random.default_rng(3)
    R, m, h, y = attitude(rng.normal(size=(5, 3))), *rng.normal(size=(3, 5, 3))
    each = [local_field_residual(*one) for one in zip(R, m, h, y, strict=True)]
    np.testing.assert_allclose(local_field_residual(R, m, h, y), each, atol=1e-14)
