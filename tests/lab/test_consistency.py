"""The NEES of walks whose errors are drawn from the claim itself, with and without honesty."""

import numpy as np
import pytest

from fg_nav.errors import EvaluationError
from fg_nav.frames import yaw_rotation
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.truth import TrajectoryTruth
from tests.evaluation.walks import stance_table, winding_path

STANCES = 60
STEP_SIGMA = np.array([0.02, 0.01, 0.015])
HEADING_STEP = 0.002


def drawn_walk(rng):
    """Truth, an estimate with white steps and a heading random walk, and the covariance of exactly that."""
    truth = 4.5 * winding_path(rng, STANCES)
    drift = np.cumsum(HEADING_STEP * rng.standard_normal(STANCES - 1))
    step = np.diff(truth, axis=0)
    turned = step + drift[:, None] * np.cross([0.0, 0.0, 1.0], step)
    estimate = truth.copy()
    estimate[1:] = truth[0] + np.cumsum(turned + STEP_SIGMA * rng.standard_normal(step.shape), axis=0)
    return truth, estimate, claimed_covariance(truth)


def claimed_covariance(truth):
    covariance = np.zeros((STANCES, 3, 3))
    for k in range(1, STANCES):
        lever = np.cross([0.0, 0.0, 1.0], truth[k] - truth[:k])  # what each heading step has done by now
        covariance[k] = k * np.diag(STEP_SIGMA**2) + HEADING_STEP**2 * lever.T @ lever
    return covariance


def ratios(claim_factor, walks=60):
    rng = np.random.default_rng(20)
    found = []
    for _ in range(walks):
        truth, estimate, covariance = drawn_walk(rng)
        table = stance_table(estimate, position_cov=claim_factor**2 * covariance)
        moved = TrajectoryTruth(table.t, truth @ yaw_rotation(2.0).T + [5.0, 6.0, 7.0])
        found.append(compute_stance_nees(table, moved, truth_sigma_m=1e-6).median_ratio)
    return np.median(found)


def test_an_honest_claim_scores_about_one():
    assert 0.6 < ratios(1.0) < 1.25


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_a_dishonest_claim_scores_the_square_of_its_exaggeration(factor):
    assert ratios(factor) == pytest.approx(ratios(1.0) / factor**2, rel=0.01)


def test_the_gauge_does_not_matter():
    truth, estimate, covariance = drawn_walk(np.random.default_rng(4))
    scores = []
    for yaw, shift in ((0.0, 0.0), (-2.5, 30.0)):
        table = stance_table(estimate, position_cov=covariance)
        found = compute_stance_nees(table, TrajectoryTruth(table.t, truth @ yaw_rotation(yaw).T + shift))
        scores.append(found.nees)
    np.testing.assert_allclose(scores[0], scores[1], rtol=1e-9)


def test_what_cannot_be_judged_is_said():
    truth, estimate, covariance = drawn_walk(np.random.default_rng(4))
    table = stance_table(estimate, position_cov=covariance)
    with pytest.raises(EvaluationError, match="covers 1 stances"):
        compute_stance_nees(table, TrajectoryTruth(np.array([0.0, 0.9]), truth[:2]))
    with pytest.raises(EvaluationError, match="not positive definite"):
        compute_stance_nees(stance_table(estimate, position_cov=-covariance), TrajectoryTruth(table.t, truth))
