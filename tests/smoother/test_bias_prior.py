"""The prior of the gyro bias by the evidence: against the marginal density, and on a walk, sensor not calibrated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fg_nav.arrays import Floats
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.problem import SIGMA_LEVELS, SIGMA_PRIOR, match_mixture
from fg_nav.solution import Solution
from tests.smoother.walks import DEFAULT, demo

ASSUMED = float(np.radians(0.15))
SIGMAS = ASSUMED * np.array(SIGMA_LEVELS)


def combine(measured: Floats, noise: Floats, mean: Floats, prior: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance of a bias measured with this noise covariance, under a Gaussian prior."""
    covariance = np.linalg.inv(np.linalg.inv(noise) + np.linalg.inv(prior))
    return covariance @ (np.linalg.solve(noise, measured) + np.linalg.solve(prior, mean)), covariance


def mix(measured: Floats, noise: Floats, mu: Floats) -> tuple[Floats, Floats]:
    """First two moments of the posterior under the mixture, by the marginal densities of what was measured."""
    levels = [s**2 * np.eye(3) for s in SIGMAS]
    weight = np.array(SIGMA_PRIOR) * [multivariate_normal(mu, noise + one).pdf(measured) for one in levels]
    weight /= weight.sum()
    means, spread = zip(*(combine(measured, noise, mu, one) for one in levels), strict=True)
    centre = weight @ np.array(means)
    outer = [np.outer(m - centre, m - centre) for m in means]
    return centre, np.tensordot(weight, np.array(spread) + outer, axes=1)


@pytest.mark.parametrize("mu", [np.zeros(3), np.radians([0.3, -0.2, 2.0])])
@pytest.mark.parametrize("seed", range(4))
def test_posterior_is_that_of_the_mixture(seed: int, mu: Floats) -> None:
    rng = np.random.default_rng(seed)
    root = np.radians(rng.uniform(-0.1, 0.1, (3, 3))) + np.radians(0.02) * np.eye(3)
    noise, measured = root @ root.T, mu + np.radians(rng.uniform(0.1, 0.5, 3))
    assumed = combine(measured, noise, mu, ASSUMED**2 * np.eye(3))
    prior_mean, prior, *_ = match_mixture(*assumed, mu, ASSUMED)
    found, expected = combine(measured, noise, prior_mean, prior), mix(measured, noise, mu)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-6, atol=1e-3 * np.sqrt(np.diagonal(expected[1])).min())
    # A prior takes nothing off what is shown, so two modes may be further apart than it leaves room for.
    np.testing.assert_allclose(np.diagonal(found[1]), np.diagonal(expected[1]), rtol=0.35)


def test_errors_over_sigmas_are_one_for_sensors_of_all_kinds() -> None:
    rng, z = np.random.default_rng(1), []
    noise = np.diag(np.radians([0.02, 0.05, 0.2])) ** 2
    for s in rng.choice(SIGMAS, 800, p=SIGMA_PRIOR):
        true = s * rng.normal(size=3)
        measured = true + np.sqrt(np.diagonal(noise)) * rng.normal(size=3)
        prior_mean, prior, *_ = match_mixture(
            *combine(measured, noise, np.zeros(3), ASSUMED**2 * np.eye(3)), np.zeros(3), ASSUMED
        )
        mean, covariance = combine(measured, noise, prior_mean, prior)
        z.append((mean - true) / np.sqrt(np.diagonal(covariance)))
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(z), axis=0)), 1.0, atol=0.1)


NO_RESTS = replace(DEFAULT, rest=replace(DEFAULT.rest, shortest_s=1e3, shortest_at_end_s=1e3))


def turned(added_deg_s: float) -> Recording:
    """The demo with a gyroscope that is off on all axes by so much more."""
    recording = demo().recording
    return replace(recording, gyr=recording.gyr + np.radians(added_deg_s))


def with_bias(added_deg_s: float) -> Solution:
    """The same, of which no rest is known, smoothed."""
    return smooth(turned(added_deg_s), demo().stances, NO_RESTS, 0.0)


def test_a_large_bias_is_found_and_said() -> None:
    small, large = with_bias(0.0), with_bias(1.0)
    assert any("gyro bias of 1" in note or "gyro bias of 2" in note for note in large.notes)
    difference = np.degrees(large.stances.gyro_bias[0] - small.stances.gyro_bias[0])
    level = difference - large.stances.nav_R_body[0].T[:, 2] * (difference @ large.stances.nav_R_body[0].T[:, 2])
    expected = np.ones(3) - large.stances.nav_R_body[0].T[:, 2] * large.stances.nav_R_body[0].T[:, 2].sum()
    np.testing.assert_allclose(level, expected, atol=0.02)


def test_a_bias_that_is_expected_changes_nothing_but_the_bias() -> None:
    walk, mean = demo(), (0.3, -0.2, 0.5)
    off = replace(walk.recording, gyr=walk.recording.gyr + np.radians(mean))
    known = smooth(off, walk.stances, replace(NO_RESTS, gyro_bias_deg_s=mean), 0.0)
    plain = with_bias(0.0)
    np.testing.assert_allclose(known.position, plain.position, atol=5e-3)
    np.testing.assert_allclose(known.stances.position_sigma, plain.stances.position_sigma, rtol=0.02, atol=1e-3)
    found = np.degrees(known.stances.gyro_bias - plain.stances.gyro_bias)
    np.testing.assert_allclose(found, np.tile(mean, (len(found), 1)), atol=2e-3)
    assert "gyro bias of (0.300, -0.200, 0.500) deg/s within 0.15 before the walk, from the calibration" in known.notes
