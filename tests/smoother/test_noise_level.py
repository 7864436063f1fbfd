"""The swing noise chosen from a walk: it follows the noise that is there, and its evidence is a probability."""

from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest

from fg_nav.detection.rest import RollingLever
from fg_nav.smoother import problem as problem_module
from fg_nav.smoother.graph import Known
from fg_nav.smoother.problem import LEVELS, average_level, choose_swing_noise, measure_evidence
from fg_nav.smoother.strides import place_nodes, preintegrate
from tests.simulated import LEVER
from tests.smoother.walks import DEFAULT, Walk, noise_free, part, time_order

BIAS_SIGMA = np.radians(DEFAULT.gyro_bias_sigma_deg_s)
KNOWN = Known(np.zeros(3), np.zeros(3), BIAS_SIGMA, (), RollingLever(np.array(LEVER), np.zeros((3, 3)), 0))


def noisy(level: float, seed: int = 0, share: float = 0.0, white: float = 0.01) -> Walk:
    """A walk whose rate has white noise of the stance (deg/s/sqrt(Hz)), and after this share of it that of a swing."""
    walk = noise_free()
    r, rng = walk.recording, np.random.default_rng(seed)
    swing = level * np.linalg.norm(r.gyr, axis=1) * (np.arange(len(r)) >= share * len(r))
    density = np.hypot(np.radians(white), swing)[:, None]
    gyr = r.gyr + density / np.sqrt(r.period_s) * rng.standard_normal(r.gyr.shape)
    acc = r.acc + DEFAULT.acc_density / 2 / np.sqrt(r.period_s) * rng.standard_normal(r.acc.shape)
    return Walk(replace(r, acc=acc, gyr=gyr), walk.stances)


def chosen(walk: Walk) -> float:
    return choose_swing_noise(*measure_evidence(walk.recording, walk.stances, KNOWN, DEFAULT), DEFAULT)[0]


@cache
def whole_piece() -> problem_module._Piece:
    walk = part(noise_free(), 12)
    return problem_module._Piece(walk.recording, walk.stances, KNOWN, DEFAULT)


@pytest.mark.parametrize("seed", range(2))
def test_follows_the_noise_of_the_swing(seed: int) -> None:
    assert chosen(noisy(4e-3, seed)) == pytest.approx(4e-3, rel=0.3)
    assert chosen(noisy(0.0, seed)) == pytest.approx(LEVELS[-1], rel=0.1)


def test_a_piece_that_is_noisier_than_all_together_counts() -> None:
    agreed = [0.0, 30.0, 60.0, 90.0]
    assert average_level(LEVELS, np.array([agreed[::-1], agreed[::-1]])) == pytest.approx(LEVELS[-1])
    found = average_level(LEVELS, np.array([agreed[::-1], [90.0, 0.0, 10.0, 40.0], agreed[::-1]]))
    assert found == pytest.approx(LEVELS[1], rel=1e-3)


def test_evidence_is_that_of_the_gaussian() -> None:
    """Against a dense linear model: E + 1/2 log|A^T A| + 1/2 log|S|, the differences between levels."""
    piece, levels = whole_piece(), (1e-3, 1e-4)
    found, expected = piece.measure_evidence(levels), []
    for level in levels:
        problem, covariances = piece._problem, piece.covariances(level)
        for (i, factor), noise in zip(piece._inertial, covariances, strict=True):
            problem.graph.replace(i, factor.cloneWithNewNoiseModel(gtsam.noiseModel.Gaussian.Covariance(noise)))
        A, b = problem.factors().linearize(problem.values).jacobian(time_order(problem.nodes))
        scale = np.linalg.norm(A, axis=0)
        left, singular, _ = np.linalg.svd(A / scale, full_matrices=False)
        error = 0.5 * (b @ b - ((left.T @ b) ** 2).sum())
        noise = np.linalg.slogdet(covariances)[1].sum()
        expected.append(error + np.log(singular).sum() + np.log(scale).sum() + 0.5 * noise)
    assert np.diff(found)[0] == pytest.approx(np.diff(expected)[0], abs=1e-3)
    assert abs(np.diff(expected)[0]) > 1.0


def test_noise_of_a_level_is_that_integrated_with_it() -> None:
    walk, piece = part(noise_free(), 12), whole_piece()
    nodes = place_nodes(walk.recording, walk.stances, DEFAULT)
    bias = gtsam.imuBias.ConstantBias()
    p = replace(DEFAULT, gyr_relative_density=3e-4)
    direct = [measured.preintMeasCov() for measured in preintegrate(walk.recording, nodes.sample, bias, p)]
    for found, expected in zip(piece.covariances(3e-4), direct, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * expected.max())


def test_a_walk_too_short_keeps_its_level_and_says_so() -> None:
    walk = part(noise_free(), 4)
    level, note = choose_swing_noise(*measure_evidence(walk.recording, walk.stances, KNOWN, DEFAULT), DEFAULT)
    assert level == DEFAULT.gyr_relative_density
    assert "too few strides" in note
