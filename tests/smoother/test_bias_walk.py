"""The random walk of the gyro bias by the evidence: it follows the one that is there, and its evidence is right."""

from dataclasses import replace
from functools import cache
from typing import cast

import gtsam
import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.problem import WALK_LEVELS_DEG_S, WALK_PRIOR, average_bias_walk, walk_problem
from fg_nav.smoother.solver import CONVERGENCE
from tests.smoother.walks import DEFAULT, Walk, demo, part, time_order

GIVEN = replace(DEFAULT, choose_swing_noise=False, gyr_relative_density=1e-4, gyr_density_deg_s=0.015)
"""Noise of the simulated gyroscope: with that of a shoe a minute shows no walk of the bias."""


def walking(walk: Walk, density: float, seed: int = 0) -> Walk:
    """The walk with a gyro bias that walks besides, deg/s/sqrt(s)."""
    r = walk.recording
    steps = np.random.default_rng(seed).standard_normal(r.gyr.shape) * np.sqrt(r.period_s)
    return Walk(replace(r, gyr=r.gyr + np.radians(density) * np.cumsum(steps, axis=0)), walk.stances)


@cache
def problem(density: float) -> WalkProblem:
    walk = walking(demo(), density)
    return walk_problem(walk.recording, walk.stances, 0.0, GIVEN)


def sigmas(of: WalkProblem) -> list[Floats]:
    """Of the changes of the biases."""
    factors = map(of.graph.at, range(of.graph.size()))
    models = [f.noiseModel() for f in factors if isinstance(f, gtsam.BetweenFactorConstantBias)]
    return [cast(gtsam.noiseModel.Diagonal, model).sigmas() for model in models]


def said(of: WalkProblem) -> str:
    """Its note on the walk of the bias."""
    return of.known.notes[-1]


def test_a_bias_that_walks_far_is_found() -> None:
    found = problem(0.02).parameters.gyro_bias_walk_deg_s
    assert 0.8 * WALK_LEVELS_DEG_S[-2] < found < WALK_LEVELS_DEG_S[-1]
    assert f"gyro bias walk {found:.2g} deg/s/sqrt(s), the mean over the evidence of 6 changes" in said(problem(0.02))


def test_a_minute_without_a_walk_has_no_more_than_before_it() -> None:
    """The variance of the levels as often as they are expected; a walk that is there would have shown itself."""
    before = np.sqrt(np.array(WALK_PRIOR) @ np.square(WALK_LEVELS_DEG_S))
    assert WALK_LEVELS_DEG_S[0] < problem(0.0).parameters.gyro_bias_walk_deg_s < before


def test_its_variance_is_the_mean_by_the_evidence_of_the_gaussian() -> None:
    """Against a dense linear model: E + 1/2 log|A^T A| + log of the sigmas, at each level."""
    walk = walking(part(demo(), 20), 0.02)
    one = walk_problem(walk.recording, walk.stances, 0.0, replace(GIVEN, choose_bias_walk=False))
    solved = solve(one, CONVERGENCE, with_stacks=True)
    found = average_bias_walk(one, solved.stacks).parameters.gyro_bias_walk_deg_s
    evidence = np.array([dense_evidence(walk, solved.linearized_at, level) for level in WALK_LEVELS_DEG_S])
    weight = np.array(WALK_PRIOR) * np.exp(evidence.min() - evidence)
    assert found == pytest.approx(np.sqrt(np.average(np.square(WALK_LEVELS_DEG_S), weights=weight)), rel=1e-4)
    assert np.ptp(evidence) > 0.05


def dense_evidence(walk: Walk, values: gtsam.Values, level: float) -> float:
    p = replace(GIVEN, choose_bias_walk=False, gyro_bias_walk_deg_s=level)
    of = walk_problem(walk.recording, walk.stances, 0.0, p)
    A, b = of.factors().linearize(values).jacobian(time_order(of.nodes))
    scale = np.linalg.norm(A, axis=0)
    left, singular, _ = np.linalg.svd(A / scale, full_matrices=False)
    error = 0.5 * (b @ b - ((left.T @ b) ** 2).sum())
    noise = sum(np.log(one).sum() for one in sigmas(of))
    return float(error + np.log(singular).sum() + np.log(scale).sum() + noise)
