"""The prior of the gyro bias by the evidence: against the marginal density, and on a walk, sensor not calibrated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fg_nav.arrays import Floats
from fg_nav.smoother import smooth
from fg_nav.smoother.bias_prior import LEVELS_DEG_S, choose_bias_prior
from fg_nav.solution import Solution
from tests.smoother.walks import DEFAULT, demo

ASSUMED = float(np.radians(0.15))


def combine(measured: Floats, noise: Floats, sigma: float) -> tuple[Floats, Floats]:
    """Mean and covariance of a bias measured with this noise covariance under a prior about zero."""
    covariance = np.linalg.inv(np.linalg.inv(noise) + np.eye(3) / sigma**2)
    return covariance @ np.linalg.solve(noise, measured), covariance


@pytest.mark.parametrize("seed", range(6))
def test_evidence_is_that_of_the_marginal_density(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = np.radians(rng.uniform(-0.1, 0.1, (3, 3))) + np.radians(0.02) * np.eye(3)
    noise, measured = root @ root.T, np.radians(rng.uniform(0.5, 1.0, 3))
    density = [
        multivariate_normal(np.zeros(3), noise + np.eye(3) * s**2).logpdf(measured)
        for s in (ASSUMED, *np.radians(LEVELS_DEG_S))
    ]
    found = choose_bias_prior(*combine(measured, noise, ASSUMED), ASSUMED)
    assert found is not None
    assert found.sigma_deg_s == LEVELS_DEG_S[int(np.argmax(density[1:]))]
    assert found.nats == pytest.approx(max(density[1:]) - density[0], abs=1e-6)


def test_axes_of_which_the_walk_shows_nothing_count_for_nothing() -> None:
    """A large bias is seen on one axis; the noise of the two others is 1e4 times the prior."""
    noise = np.diag([ASSUMED / 10, 1e4 * ASSUMED, 1e4 * ASSUMED]) ** 2
    found = choose_bias_prior(*combine(np.radians([0.6, 0.0, 0.0]), noise, ASSUMED), ASSUMED)
    alone = multivariate_normal(0.0, noise[0, 0] + np.radians(0.5) ** 2).logpdf(np.radians(0.6))
    assumed = multivariate_normal(0.0, noise[0, 0] + ASSUMED**2).logpdf(np.radians(0.6))
    assert found is not None
    assert found.nats == pytest.approx(alone - assumed, abs=1e-4)


def test_biases_of_the_prior_keep_it() -> None:
    rng = np.random.default_rng(1)
    noise = np.diag(np.radians([0.01, 0.01, 0.03])) ** 2
    kept = [
        choose_bias_prior(*combine(b, noise, ASSUMED), ASSUMED) is None for b in ASSUMED * rng.normal(size=(300, 3))
    ]
    assert np.mean(kept) > 0.98


def with_bias(added_deg_s: float) -> Solution:
    """The demo, of which no rest is known, with a gyroscope that is off on all axes by so much more."""
    recording, stances = demo().recording, demo().stances
    off = replace(recording, gyr=recording.gyr + np.radians(added_deg_s))
    no_rests = replace(DEFAULT, rest=replace(DEFAULT.rest, shortest_s=1e3, shortest_at_end_s=1e3))
    return smooth(off, stances, no_rests, 0.0)


def test_a_large_bias_is_found_and_said() -> None:
    small, large = with_bias(0.0), with_bias(1.0)
    assert not any("one sigma" in note for note in small.notes)
    assert any("gyro bias of up to" in note for note in large.notes)
    difference = np.degrees(large.stances.gyro_bias[0] - small.stances.gyro_bias[0])
    level = difference - large.stances.nav_R_body[0].T[:, 2] * (difference @ large.stances.nav_R_body[0].T[:, 2])
    expected = np.ones(3) - large.stances.nav_R_body[0].T[:, 2] * large.stances.nav_R_body[0].T[:, 2].sum()
    np.testing.assert_allclose(level, expected, atol=0.02)
