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
from fg_nav.smoother.bias_prior import LEAST_CHANGE, LEVELS_DEG_S, PRIOR, average_bias_prior, average_sigma
from fg_nav.smoother.graph import solve
from fg_nav.smoother.problem import walk_problem
from fg_nav.solution import Solution
from tests.smoother.walks import DEFAULT, demo, part

ASSUMED = float(np.radians(0.15))


def combine(measured: Floats, noise: Floats, sigma: float) -> tuple[Floats, Floats]:
    """Mean and covariance of a bias measured with this noise covariance under a prior about zero."""
    covariance = np.linalg.inv(np.linalg.inv(noise) + np.eye(3) / sigma**2)
    return covariance @ np.linalg.solve(noise, measured), covariance


def expect_sigma(measured: Floats, noise: Floats) -> float:
    """Sigma of the mixture, by the marginal densities of what was measured."""
    levels = np.array([ASSUMED, *np.radians(LEVELS_DEG_S)])
    size = np.eye(len(measured))
    density = [multivariate_normal(cov=noise + s**2 * size).pdf(measured) for s in levels]
    return float(np.sqrt(np.average(levels**2, weights=np.array(PRIOR) * density)))


@pytest.mark.parametrize("seed", range(6))
def test_sigma_is_that_of_the_mixture_by_the_marginal_densities(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = np.radians(rng.uniform(-0.1, 0.1, (3, 3))) + np.radians(0.02) * np.eye(3)
    noise, measured = root @ root.T, np.radians(rng.uniform(0.1, 0.5, 3))
    found = average_sigma(*combine(measured, noise, ASSUMED), ASSUMED)
    assert found == pytest.approx(expect_sigma(measured, noise), rel=1e-6)


def test_axes_of_which_the_walk_shows_nothing_count_for_nothing() -> None:
    """A large bias is seen on one axis; the noise of the two others is 1e4 times the prior."""
    noise, measured = np.diag([ASSUMED / 10, 1e4 * ASSUMED, 1e4 * ASSUMED]) ** 2, np.radians([0.4, 0.0, 0.0])
    found = average_sigma(*combine(measured, noise, ASSUMED), ASSUMED)
    assert found == pytest.approx(expect_sigma(measured[:1], noise[:1, :1]), rel=1e-5)


def test_a_walk_that_shows_nothing_has_the_variance_of_the_levels_before_it() -> None:
    found = average_sigma(np.zeros(3), ASSUMED**2 * np.eye(3), ASSUMED)
    expected = np.sqrt(np.array(PRIOR) @ np.square([ASSUMED, *np.radians(LEVELS_DEG_S)]))
    assert found == pytest.approx(expected)


def test_a_prior_wider_than_a_level_stays() -> None:
    wide = float(np.radians(2.0))
    assert average_sigma(np.zeros(3), (0.01 * wide) ** 2 * np.eye(3), wide) == pytest.approx(wide)


def test_its_variance_over_walks_is_that_of_their_biases() -> None:
    """Of biases drawn from the levels as often as these are expected, the mean over the evidence is the true one."""
    rng = np.random.default_rng(1)
    noise, levels = np.diag(np.radians([0.01, 0.01, 0.03])) ** 2, np.array([ASSUMED, *np.radians(LEVELS_DEG_S)])
    sigma = rng.choice(levels, 4000, p=PRIOR)
    found = np.array([average_sigma(*combine(s * rng.normal(size=3), noise, ASSUMED), ASSUMED) for s in sigma])
    assert np.mean(found**2) == pytest.approx(np.mean(sigma**2), rel=0.05)
    kept, widest = found[sigma == levels[0]], found[sigma == levels[2]]
    assert np.median(kept) < LEAST_CHANGE * ASSUMED
    assert np.mean(kept > 2.0 * ASSUMED) < 0.05
    assert np.median(widest) > 0.8 * levels[2]


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
    old, new = (one.graph.at(changed[0]).noiseModel().sigmas() for one in (before, after))
    np.testing.assert_allclose(new[GYRO], after.known.gyro_bias_sigma)
    np.testing.assert_allclose(old[GYRO], before.known.gyro_bias_sigma)
    np.testing.assert_array_equal(new[:3], old[:3])
    assert after.values.equals(solved.values, 0.0)


def test_a_walk_with_a_rest_keeps_its_prior() -> None:
    walk = walk_problem(turned(1.0), demo().stances, 0.0, DEFAULT)
    assert walk.known.rests
    assert average_bias_prior(walk, solve(walk)) is None


def test_a_large_bias_is_found_and_said() -> None:
    small, large = with_bias(0.0), with_bias(1.0)
    assert not any("one sigma" in note for note in small.notes)
    assert any("gyro bias of up to" in note for note in large.notes)
    difference = np.degrees(large.stances.gyro_bias[0] - small.stances.gyro_bias[0])
    level = difference - large.stances.nav_R_body[0].T[:, 2] * (difference @ large.stances.nav_R_body[0].T[:, 2])
    expected = np.ones(3) - large.stances.nav_R_body[0].T[:, 2] * large.stances.nav_R_body[0].T[:, 2].sum()
    np.testing.assert_allclose(level, expected, atol=0.02)
