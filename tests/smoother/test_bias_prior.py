"""The prior of the gyro bias by the evidence: against the marginal density, and on a walk, sensor not calibrated."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fg_nav.arrays import Floats
from fg_nav.factors.differential_field import GYRO
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.graph import solve
from fg_nav.smoother.problem import SIGMA_LEVELS, SIGMA_PRIOR, average_bias_prior, match_mixture, walk_problem
from fg_nav.smoother.strides import ACC_BIAS_SIGMA
from fg_nav.solution import Solution
from tests.smoother.walks import DEFAULT, demo, part

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


def test_a_walk_that_shows_nothing_has_the_variance_of_the_levels_before_it() -> None:
    mean, prior, *_ = match_mixture(np.zeros(3), ASSUMED**2 * np.eye(3), np.zeros(3), ASSUMED)
    np.testing.assert_allclose(mean, 0.0, atol=1e-12)
    np.testing.assert_allclose(prior, np.array(SIGMA_PRIOR) @ SIGMAS**2 * np.eye(3), rtol=1e-6, atol=1e-12)


def test_a_bias_that_the_walk_shows_well_stays() -> None:
    noise, measured = np.diag(np.radians([0.001, 0.001, 0.001])) ** 2, np.radians([0.05, -0.1, 0.02])
    assumed = combine(measured, noise, np.zeros(3), ASSUMED**2 * np.eye(3))
    assert match_mixture(*assumed, np.zeros(3), ASSUMED)[2] < 1.0


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


def test_only_the_prior_of_the_bias_changes() -> None:
    few = part(demo(), 12)
    off = replace(few.recording, gyr=turned(1.0).gyr[: len(few.recording)])
    before = walk_problem(off, few.stances, 0.0, NO_RESTS)
    solved = solve(before)
    after = average_bias_prior(before, solved)
    assert after is not None
    changed = [i for i in range(before.graph.size()) if not before.graph.at(i).equals(after.graph.at(i), 1e-9)]
    assert after.graph.size() == before.graph.size()
    assert [type(before.graph.at(i)) for i in changed] == [gtsam.PriorFactorConstantBias]
    sigmas = np.sqrt(np.diagonal(after.graph.at(changed[0]).noiseModel().covariance()))
    assert (sigmas[GYRO] > 2.0 * before.known.gyro_bias_sigma).all()
    np.testing.assert_allclose(sigmas[:3], ACC_BIAS_SIGMA)
    assert after.values.equals(solved.values, 0.0)


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


def test_a_sensor_that_has_changed_since_is_still_found() -> None:
    calibrated = replace(NO_RESTS, gyro_bias_deg_s=(0.3, -0.2, 0.5), gyro_bias_sigma_deg_s=0.06)
    changed, plain = smooth(turned(1.0), demo().stances, calibrated, 0.0), with_bias(1.0)
    apart = (changed.stances.gyro_bias[0] - plain.stances.gyro_bias[0]) / plain.stances.gyro_bias_sigma[0]
    assert np.abs(apart).max() < 1.0
    end = np.linalg.norm(changed.position[-1, :2] - demo().recording.truth.position[-1, :2])
    assert end < 3.0 * np.linalg.norm(changed.stances.position_sigma[-1, :2])
