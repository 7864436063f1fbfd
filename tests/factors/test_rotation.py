"""Rotation vectors: against scipy, and their derivatives by finite differences."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.factors.rotation import left_jacobian, relative_rotations, rotation_exp, turn_about_up, turn_from
from tests.factors.variables import vectors

scales = st.sampled_from([1e-9, 1e-4, 0.02, 0.03, 1.0])


@given(t=vectors, scale=scales)
@settings(max_examples=40, deadline=None)
def test_the_rotation_of_a_vector_is_that_of_scipy(t, scale):
    np.testing.assert_allclose(rotation_exp(scale * t), Rotation.from_rotvec(scale * t).as_matrix(), atol=1e-14)


@given(t=vectors, scale=scales, d=vectors)
@settings(max_examples=40, deadline=None)
def test_the_left_jacobian_is_the_derivative_from_the_left(t, scale, d):
    t, h = scale * t, 1e-5
    there, back = (Rotation.from_rotvec(t + s * h * d) for s in (1, -1))
    turn = (there * back.inv()).as_rotvec() / (2 * h)
    np.testing.assert_allclose(left_jacobian(t) @ d, turn, atol=1e-8)


BIAS = np.radians([0.1, -0.15, 0.25])
PERIOD = 0.01


def swinging(rng, samples=300, size=4.0):
    t = PERIOD * np.arange(samples)
    rates = np.zeros((samples, 3))
    for frequency in (0.6, 1.1, 1.9):
        rates += size * rng.normal(0.0, 0.3, 3) * np.sin(2 * np.pi * frequency * t[:, None] + rng.uniform(0, 6.3, 3))
    return rates


def integrated(rates):
    """Rotations to the first sample's frame, multiplied sample by sample."""
    out = [np.eye(3)]
    for turn in Rotation.from_rotvec(rates[:-1] * PERIOD).as_matrix():
        out.append(out[-1] @ turn)
    return np.array(out)


@given(seed=st.integers(0, 999), size=st.sampled_from([0.0, 1.0, 10.0]))
@settings(max_examples=10, deadline=None)
def test_rotations_are_integrated_sample_by_sample_and_their_bias_jacobians_are_derivatives(seed, size):
    """Of each stretch by itself."""
    rates, period, twice = swinging(np.random.default_rng(seed), 70, size), np.full(140, PERIOD), np.repeat([0, 1], 70)
    both = np.concatenate([rates, rates]) + BIAS
    R, J = relative_rotations(both, period, twice, BIAS)
    np.testing.assert_allclose(R, np.tile(integrated(rates), (2, 1, 1)), atol=1e-12)
    np.testing.assert_array_equal(J[[0, 70]], 0.0)
    h = 1e-4
    for k, d in enumerate(h * np.eye(3)):
        there, back = (relative_rotations(both, period, twice, BIAS + s * d)[0] for s in (1, -1))
        turn = Rotation.from_matrix(np.swapaxes(back, 1, 2) @ there).as_rotvec() / (2 * h)
        np.testing.assert_allclose(J[:, :, k], turn, atol=1e-7)


@given(level=vectors, turn=vectors)
@settings(max_examples=20, deadline=None)
def test_the_turn_from_a_held_attitude_and_its_derivative(level, turn):
    """Its angle is the twist about up; the derivative is the finite difference on the whole attitude."""
    R0 = rotation_exp(level)
    R = rotation_exp(0.4 * turn) @ R0
    c, s, by_turn = turn_from(R0, R)
    psi = lambda A: turn_about_up(A @ R0.T)  # noqa: E731
    np.testing.assert_allclose(np.arctan2(s, c), psi(R), atol=1e-12)
    h = 1e-6
    slopes = [(psi(R @ rotation_exp(h * e)) - psi(R @ rotation_exp(-h * e))) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(by_turn, slopes, atol=1e-7 / max(c, 0.05))
