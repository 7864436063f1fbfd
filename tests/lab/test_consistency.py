"""Claims against errors that are drawn from them, with and without honesty: place, and place and heading."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import Alignment, Comparison
from fg_nav.frames import yaw_rotation
from fg_nav.lab.consistency import PARTS, compute_stance_nees, whiten_errors
from fg_nav.truth import TrajectoryTruth
from tests.evaluation.walks import solution, stance_table, winding_path

STANCES, STEP_SIGMA, HEADING_STEP = 60, np.array([0.02, 0.01, 0.015]), 0.002


def drawn_walk(rng):
    """Truth, an estimate with white steps and a heading random walk, and the covariance of exactly that."""
    truth = 4.5 * winding_path(rng, STANCES)
    drift, step = np.cumsum(HEADING_STEP * rng.standard_normal(STANCES - 1)), np.diff(truth, axis=0)
    turned = step + drift[:, None] * np.cross([0.0, 0.0, 1.0], step)
    estimate = truth.copy()
    estimate[1:] = truth[0] + np.cumsum(turned + STEP_SIGMA * rng.standard_normal(step.shape), axis=0)
    covariance = np.zeros((STANCES, 3, 3))
    for k in range(1, STANCES):
        lever = np.cross([0.0, 0.0, 1.0], truth[k] - truth[:k])  # what each heading step has done by now
        covariance[k] = k * np.diag(STEP_SIGMA**2) + HEADING_STEP**2 * lever.T @ lever
    return truth, estimate, covariance


def ratios(claim_factor, walks=60):
    rng, found = np.random.default_rng(20), []
    for _ in range(walks):
        truth, estimate, covariance = drawn_walk(rng)
        table = stance_table(estimate, position_cov=claim_factor**2 * covariance)
        moved = TrajectoryTruth(table.t, truth @ yaw_rotation(2.0).T + [5.0, 6.0, 7.0])
        found.append(compute_stance_nees(table, moved, truth_sigma_m=1e-6).median_ratio)
    return np.median(found)


def test_a_claim_scores_the_square_of_its_exaggeration_and_an_honest_one_about_one():
    honest = ratios(1.0)
    assert 0.6 < honest < 1.25
    for factor in (0.25, 4.0):
        assert ratios(factor) == pytest.approx(honest / factor**2, rel=0.01)


def test_the_gauge_does_not_matter_and_the_truth_has_a_sigma():
    truth, estimate, covariance = drawn_walk(np.random.default_rng(4))
    table, scores = stance_table(estimate, position_cov=covariance), []
    for yaw, shift in ((0.0, 0.0), (-2.5, 30.0)):
        scores.append(compute_stance_nees(table, TrajectoryTruth(table.t, truth @ yaw_rotation(yaw).T + shift)).nees)
    np.testing.assert_allclose(scores[0], scores[1], rtol=1e-9)
    blunt = compute_stance_nees(table, TrajectoryTruth(table.t, truth), truth_sigma_m=0.1)
    assert blunt.mean_ratio < 0.5 * np.mean(scores[0]) / 3
    exact = stance_table(truth, position_cov=1e-12 * np.broadcast_to(np.eye(3), covariance.shape))
    rng = np.random.default_rng(6)
    drawn = [TrajectoryTruth(table.t, truth + 0.05 * rng.standard_normal(truth.shape)) for _ in range(100)]
    found = [compute_stance_nees(exact, one, truth_sigma_m=0.05).mean_ratio for one in drawn]
    assert np.mean(found) == pytest.approx(1.0, abs=0.2)  # both ends of a move have it


def test_what_cannot_be_judged_is_said():
    truth, estimate, covariance = drawn_walk(np.random.default_rng(4))
    table = stance_table(estimate, position_cov=covariance)
    with pytest.raises(EvaluationError, match="covers 1 stances"):
        compute_stance_nees(table, TrajectoryTruth(np.array([0.0, 0.9]), truth[:2]))
    with pytest.raises(EvaluationError, match="not positive definite"):
        compute_stance_nees(stance_table(estimate, position_cov=-covariance), TrajectoryTruth(table.t, truth))


# --- place and heading -----------------------------------------------------------------------------------------------

K = 81
MIX = np.array([[0.5, 0.0, 0.0, 0.0], [-0.2, 0.7, 0.0, 0.0], [0.1, 0.05, 0.2, 0.0], [0.02, -0.03, 0.0, 0.01]])
"""One step of errors in place (m) and heading (rad) is this times four standard normal numbers."""


def drawn(rng, claimed=1.0):
    """A walk whose errors are a random walk with steps of `MIX`, and a claim wrong by a factor on the sigmas."""
    z = rng.standard_normal((K, 4))
    z[0] = 0.0
    error, rows = np.cumsum(z @ MIX.T, axis=0), np.arange(K)
    truth = np.column_stack([rows, np.zeros(K), np.zeros(K)]) * 1.0
    unmoved = Alignment("origin", np.eye(3), np.zeros(3))
    found = Comparison(unmoved, rows, 1.0 * rows, truth + error[:, :3], truth, False, error[:, 3])
    pose_cov = claimed**2 * rows[:, None, None] * (MIX @ MIX.T) + 1e-12 * np.eye(4)
    table = solution(1.0 * rows, truth).stances
    table = replace(table, position_cov=pose_cov[:, :3, :3], heading_sigma=np.sqrt(pose_cov[:, 3, 3]))
    return found, replace(table, pose_cov=pose_cov)


def seeds(count, **how):
    rng = np.random.default_rng(3)
    each = [whiten_errors(*drawn(rng, **how)) for _ in range(count)]
    return {part: np.array([one[part] for one in each]) for part in each[0]}


def test_an_honest_claim_makes_every_part_standard_normal_and_a_wrong_one_shows_its_factor():
    for part, z in seeds(2000).items():
        assert z.shape == (2000, 4, len(PARTS[part]))
        for place in (0, -1):
            np.testing.assert_allclose(z[:, place].T @ z[:, place] / len(z), np.eye(len(PARTS[part])), atol=0.12)
    for factor in (0.4, 2.5):
        for z in seeds(500, claimed=factor).values():
            assert np.sqrt(np.mean(z[:, -1] ** 2)) == pytest.approx(1 / factor, rel=0.1)


def test_a_truth_without_attitude_and_a_claim_that_is_none_are_errors_in_words():
    found, table = drawn(np.random.default_rng(1))
    with pytest.raises(EvaluationError, match="no attitude"):
        whiten_errors(replace(found, yaw_error=None), table)
    with pytest.raises(EvaluationError, match="not positive definite"):
        whiten_errors(found, replace(table, pose_cov=-table.pose_cov))
