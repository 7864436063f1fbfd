"""Place and heading over their claim: walks drawn from known covariances, and claims wrong by known factors."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import Alignment, Comparison
from fg_nav.lab.consistency import PARTS, estimate_freedom_of_mean, nees_band, share_in_band, whiten_errors
from tests.evaluation.walks import solution

K = 81
MIX = np.array([[0.5, 0.0, 0.0, 0.0], [-0.2, 0.7, 0.0, 0.0], [0.1, 0.05, 0.2, 0.0], [0.02, -0.03, 0.0, 0.01]])
"""One step of errors in place (m) and heading (rad) is this times four standard normal numbers."""


def drawn(rng, claimed=1.0, joint=True):
    """A walk whose errors are a random walk with steps of `MIX`, and a claim wrong by a factor on the sigmas."""
    z = rng.standard_normal((K, 4))
    z[0] = 0.0
    error = np.cumsum(z @ MIX.T, axis=0)
    truth = np.column_stack([np.arange(K), np.zeros(K), np.zeros(K)]) * 1.0
    rows = np.arange(K)
    found = Comparison(
        Alignment("origin", np.eye(3), np.zeros(3)), rows, 1.0 * rows, truth + error[:, :3], truth, False, error[:, 3]
    )
    pose_cov = claimed**2 * np.arange(K)[:, None, None] * (MIX @ MIX.T) + 1e-12 * np.eye(4)
    table = solution(np.arange(float(K)), truth).stances
    table = replace(table, position_cov=pose_cov[:, :3, :3], heading_sigma=np.sqrt(pose_cov[:, 3, 3]))
    if joint:
        table = replace(table, pose_cov=pose_cov)
    return found, table


def seeds(count, **how):
    rng = np.random.default_rng(3)
    each = [whiten_errors(*drawn(rng, **how)) for _ in range(count)]
    return {part: np.array([one[part] for one in each]) for part in each[0]}


def test_an_honest_claim_makes_every_part_standard_normal():
    for part, z in seeds(2000).items():
        assert z.shape == (2000, 4, PARTS[part])
        last = z[:, -1]
        np.testing.assert_allclose(last.T @ last / len(z), np.eye(PARTS[part]), atol=0.12)
        assert share_in_band((last**2).sum(axis=1), PARTS[part], PARTS[part]) == pytest.approx(0.95, abs=0.02)


def test_without_the_cross_terms_there_is_no_figure_of_the_pose():
    found = seeds(3, joint=False)
    assert set(found) == set(PARTS) - {"pose", "ground"}


def test_sigmas_wrong_by_a_factor_show_as_that_factor_and_leave_the_band():
    for factor in (0.4, 2.5):
        z = seeds(500, claimed=factor)["heading"][:, -1]
        assert np.sqrt(np.mean(z**2)) == pytest.approx(1 / factor, rel=0.1)
    pose = (seeds(500, claimed=0.4)["pose"][:, -1] ** 2).sum(axis=1)
    assert share_in_band(pose, 4, 4) < 0.5


def test_the_band_of_the_mean_holds_the_share_it_says_although_footfalls_repeat_each_other():
    z = seeds(3000)["position"]
    mean = (z**2).sum(axis=2).mean(axis=1)
    freedom = estimate_freedom_of_mean(z)
    # A random walk at 1/4, 1/2, 3/4 and 1 has correlations min(k, l) / sqrt(k l).
    k = np.arange(1, 5)
    known = 3 * 16 / np.sum(np.minimum.outer(k, k) ** 2 / np.outer(k, k))
    assert freedom == pytest.approx(known, rel=0.05)
    assert 0.94 < share_in_band(mean, freedom, 3) < 0.975
    assert share_in_band(mean, 12, 3) < 0.85  # as if they were independent
    assert share_in_band(mean, 3, 3) > share_in_band(mean, freedom, 3) + 0.005  # as if they were one


def test_independent_and_equal_footfalls_are_the_two_ends():
    rng = np.random.default_rng(5)
    independent = rng.standard_normal((4000, 4, 2))
    assert estimate_freedom_of_mean(independent) == pytest.approx(8.0, rel=0.03)
    assert estimate_freedom_of_mean(np.repeat(independent[:, :1], 4, axis=1)) == pytest.approx(2.0, rel=0.01)


def test_band_is_that_of_the_tables():
    assert nees_band(4, 4) == pytest.approx((0.484, 11.143), abs=1e-3)
    assert nees_band(8, 4) == pytest.approx((2.180 / 2, 17.535 / 2), abs=1e-3)


def test_a_truth_without_attitude_and_a_claim_that_is_none_are_errors_in_words():
    found, table = drawn(np.random.default_rng(1))
    with pytest.raises(EvaluationError, match="no attitude"):
        whiten_errors(replace(found, yaw_error=None), table)
    with pytest.raises(EvaluationError, match="not positive definite"):
        whiten_errors(found, replace(table, pose_cov=-table.pose_cov))
