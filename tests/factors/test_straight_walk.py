"""Straight walk: geometry and Jacobians, the mixture's loss and weight, and that it is silent in a curve."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from fg_nav.factors.walk_constraints import (
    StraightWalk,
    change_of_course,
    change_of_course_slopes,
    has_course,
    odds_of_curve,
    straight_probability,
    straight_triples,
    straight_walk_loss,
)
from tests.factors.derivatives import assert_jacobians_are_derivatives, residual
from tests.factors.straight import straight_walk_factor, straight_walk_noise

UNIT = gtsam.noiseModel.Unit.Create(1)
POSES = [X(0), X(1), X(2)]
DEFAULT = StraightWalk()
vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)
angles = st.floats(-3.0, 3.0)
odds = st.floats(1e-6, 0.5)
seeds = st.integers(0, 10_000)


def points(course, turn, stride=1.4, origin=np.zeros(3), climb=0.0):
    """Three footfalls: a course, and after the second another."""
    steps = [stride * np.array([np.cos(a), np.sin(a), climb]) for a in (course, course + turn)]
    return origin, origin + steps[0], origin + steps[0] + steps[1]


def values_at(footfalls, seed=0):
    values = gtsam.Values()
    for key, point, R in zip(POSES, footfalls, Rotation.random(3, rng=np.random.default_rng(seed)), strict=True):
        values.insert(key, gtsam.Pose3(gtsam.Rot3(R.as_matrix()), point))
    return values


@given(course=angles, turn=angles, origin=vectors, stride=st.floats(0.5, 20), climb=st.floats(-0.5, 0.5), seed=seeds)
@settings(max_examples=30, deadline=None)
def test_the_residual_is_the_turn(course, turn, origin, stride, climb, seed):
    footfalls = points(course, turn, stride, origin, climb)
    assert change_of_course(*footfalls) == pytest.approx(turn, abs=1e-9)
    assert residual(straight_walk_factor(POSES, UNIT), values_at(footfalls, seed)) == pytest.approx([turn], abs=1e-9)


@given(footfalls=st.tuples(vectors, vectors, vectors), yaw=angles, shift=vectors)
@settings(max_examples=30, deadline=None)
def test_neither_where_nor_whereto_matters_and_the_way_back_turns_the_other_way(footfalls, yaw, shift):
    assume(has_course(*footfalls, 0.3))
    turn = change_of_course(*footfalls)
    assume(abs(turn) < 3.1)
    moved = [Rotation.from_euler("z", yaw).apply(p) + shift for p in footfalls]
    assert change_of_course(*moved) == pytest.approx(turn, abs=1e-9)
    assert change_of_course(*footfalls[::-1]) == pytest.approx(-turn, abs=1e-9)


@given(footfalls=st.tuples(vectors, vectors, vectors), seed=seeds)
@settings(max_examples=30, deadline=None)
def test_jacobians_are_the_derivatives_on_the_manifold(footfalls, seed):
    assume(has_course(*footfalls, 0.3))
    assume(abs(change_of_course(*footfalls)) < 3.1)
    assert_jacobians_are_derivatives(straight_walk_factor(POSES, UNIT), values_at(footfalls, seed))


def test_many_are_as_each_alone():
    before, here, after = np.random.default_rng(2).normal(size=(3, 4, 2, 3))
    turns, jacobians = change_of_course(before, here, after), change_of_course_slopes(before, here, after)
    assert turns.shape == (4, 2)
    for i in np.ndindex(4, 2):
        assert turns[i] == change_of_course(before[i], here[i], after[i])
        for H, alone in zip(jacobians, change_of_course_slopes(before[i], here[i], after[i]), strict=True):
            np.testing.assert_array_equal(H[i], alone)


def test_a_step_on_the_spot_has_no_course():
    here = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    ahead = here + np.array([0.1, 0.1, 1.0])  # up a ladder
    np.testing.assert_array_equal(has_course(here - np.array([1.4, 0, 0]), here, ahead, 0.4), [False, False])
    np.testing.assert_array_equal(
        has_course(here - np.array([1.4, 0, 0]), here, here + np.array([0, 1.4, 0]), 0.4), [True, True]
    )


@given(x=st.floats(-12, 12), c=odds)
@settings(max_examples=100, deadline=None)
def test_the_weight_is_the_derivative_of_the_loss_over_the_residual(x, c):
    h = 1e-5
    slope = (straight_walk_loss(x + h, c) - straight_walk_loss(x - h, c)) / (2 * h)
    assert slope == pytest.approx(straight_probability(x, c) * x, abs=1e-7)


@given(turn=st.floats(-np.pi, np.pi), sigma_deg=st.floats(0.5, 10), share=st.floats(0.05, 0.95))
@settings(max_examples=50, deadline=None)
def test_the_weight_is_the_posterior_and_the_loss_the_likelihood(turn, sigma_deg, share):
    sigma = np.radians(sigma_deg)
    p = StraightWalk(sigma, odds_of_curve(sigma, share))
    straight, curve = share * norm.pdf(turn, scale=p.sigma), (1 - share) / (2 * np.pi)
    at_zero = share * norm.pdf(0.0, scale=p.sigma) + curve
    x = turn / p.sigma
    assert straight_probability(x, p.odds_of_curve) == pytest.approx(straight / (straight + curve), abs=1e-12)
    assert straight_walk_loss(x, p.odds_of_curve) == pytest.approx(np.log(at_zero / (straight + curve)), abs=1e-9)


@given(x=st.floats(-12, 12), to=st.floats(-12, 12), c=odds)
@settings(max_examples=100, deadline=None)
def test_reweighting_never_raises_the_loss(x, to, c):
    """The reweighted square through the loss at x lies above it everywhere: each round descends."""
    square = straight_walk_loss(x, c) + 0.5 * straight_probability(x, c) * (to**2 - x**2)
    assert square >= straight_walk_loss(to, c) - 1e-12


def test_far_out_the_loss_is_flat_and_finite():
    far = straight_walk_loss(np.array([50.0, 1e4]), DEFAULT.odds_of_curve)
    np.testing.assert_allclose(far, np.log1p(1 / DEFAULT.odds_of_curve))
    np.testing.assert_array_equal(straight_probability(np.array([50.0, 1e4]), DEFAULT.odds_of_curve), 0.0)


@pytest.mark.parametrize("turn_deg", [0.0, 2.0, 5.0, 6.5, 15.0, 60.0])
def test_gtsam_takes_loss_and_weight_as_they_are(turn_deg):
    factor = straight_walk_factor(POSES, straight_walk_noise())
    values = values_at(points(0.4, np.radians(turn_deg)))
    x, c = np.radians(turn_deg) / DEFAULT.sigma, DEFAULT.odds_of_curve
    assert factor.error(values) == pytest.approx(straight_walk_loss(x, c), abs=1e-12)
    plain = straight_walk_factor(POSES, gtsam.noiseModel.Isotropic.Sigma(1, DEFAULT.sigma)).linearize(values)
    weighted = factor.linearize(values).information()
    np.testing.assert_allclose(weighted, straight_probability(x, c) * plain.information(), rtol=1e-9, atol=1e-12)


def walked(rng, turns):
    """Footfalls of a path with these turns at them: feet set down 2 cm beside it, the path itself weaving by 5 cm."""
    course = np.cumsum(turns)
    path = np.vstack([np.zeros(3), np.cumsum(1.4 * np.stack([np.cos(course), np.sin(course), 0 * course], 1), axis=0)])
    along = 2 * np.pi * np.arange(len(path)) / rng.uniform(6, 20) + rng.uniform(0, 6)
    aside = 0.05 * np.sqrt(2) * np.sin(along) + rng.normal(0, 0.02, len(path))
    across = np.append(course, course[-1]) + np.pi / 2
    return path + aside[:, None] * np.stack([np.cos(across), np.sin(across), 0 * across], axis=1)


def reckoned(footfalls, drift):
    """The footfalls when the heading drifts by so much a stride, and their derivative by the drift."""
    strides = np.diff(footfalls, axis=0)
    k = np.arange(len(strides))[:, None]
    drifted = Rotation.from_rotvec(drift * k * [0.0, 0.0, 1.0]).apply(strides)
    turned = k * np.cross([0.0, 0.0, 1.0], drifted)
    return (np.vstack([np.zeros(3), np.cumsum(a, axis=0)]) for a in (drifted, turned))


PRIOR = np.radians(0.5)


def drift_found(footfalls, drift, rounds=30):
    """Drift per stride that a prior and straight walking find, and its sigma; the first guess is zero."""
    p, guess = DEFAULT, 0.0
    for _ in range(rounds):
        position, by_drift = reckoned(footfalls, drift - guess)
        triples = straight_triples(position)
        there = np.moveaxis(position[triples], 1, 0)
        x = change_of_course(*there) / p.sigma
        by_point = np.stack(change_of_course_slopes(*there), axis=1)
        H = -(by_point * by_drift[triples]).sum(axis=(1, 2)) / p.sigma
        weight = straight_probability(x, p.odds_of_curve)
        information = (weight * H**2).sum() + PRIOR**-2
        guess -= ((weight * x * H).sum() + guess * PRIOR**-2) / information
    return guess, information**-0.5


def test_a_corridor_with_corners_shows_the_drift_within_its_sigma():
    """Right-angled corners between straight lines of 20 to 40 strides; the drift is drawn from its prior."""
    drifts, off, sigmas = [], [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        turns = np.zeros(120)
        turns[np.cumsum(rng.integers(20, 40, 3))] = np.pi / 2 * rng.choice([-1, 1], 3)
        drift = rng.normal(0, 0.3 * PRIOR)
        found, sigma = drift_found(walked(rng, turns), drift)
        drifts.append(drift)
        off.append(found - drift)
        sigmas.append(sigma)
    assert np.median(sigmas) < 0.25 * PRIOR
    assert np.median(np.abs(off)) < 0.3 * np.median(np.abs(drifts))
    assert (np.abs(off) < 3 * np.array(sigmas)).mean() > 0.9


@pytest.mark.parametrize("turn_deg", [3.0, 8.0, 20.0])
def test_in_a_curve_it_is_silent(turn_deg):
    """No drift is found in the curve, and the sigma of the prior is left as it was."""
    footfalls = walked(np.random.default_rng(1), np.full(100, np.radians(turn_deg)))
    found, sigma = drift_found(footfalls, 0.0)
    assert abs(found) < 0.01 * PRIOR
    assert sigma == pytest.approx(PRIOR, rel=1e-3)


def test_triples_are_as_many_strides_apart_as_asked_for_and_leave_standing_out():
    line = np.arange(21)[:, None] * np.array([1.4, 0.0, 0.0])
    np.testing.assert_array_equal(straight_triples(line), [[0, 5, 10], [5, 10, 15], [10, 15, 20]])
    standing = np.vstack([line[:11], np.repeat(line[10:11], 10, axis=0)])
    np.testing.assert_array_equal(straight_triples(standing), [[0, 5, 10]])
    assert straight_triples(line[:5]).shape == (0, 3)
