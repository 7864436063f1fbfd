"""What is chosen by the evidence: swing noise, bias walk, bias prior, height of clipped peaks, refused stances."""

from dataclasses import replace
from functools import cache
from typing import cast

import gtsam
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.detection.rest import RollingLever
from fg_nav.detection.stance import Stances
from fg_nav.lab.simulation.motion import Style
from fg_nav.smoother import problem as problem_module
from fg_nav.smoother import smooth
from fg_nav.smoother.graph import Known, WalkProblem, solve
from fg_nav.smoother.problem import (
    LEVELS,
    MIN_STATISTIC,
    SIGMA_LEVELS,
    SIGMA_PRIOR,
    WALK_LEVELS_DEG_S,
    WALK_PRIOR,
    average_bias_walk,
    average_level,
    choose_swing_noise,
    compute_stance_statistics,
    match_mixture,
    measure_evidence,
    walk_problem,
    weaken_refused_stances,
)
from fg_nav.smoother.solver import CONVERGENCE
from fg_nav.smoother.strides import place_nodes, preintegrate
from fg_nav.solution import Solution
from tests.simulated import LEVER, SimulatedFoot, straight_walk
from tests.smoother.walks import DEFAULT, NO_REST, Walk, demo, dense_log_evidence, noise_free, part

# --- the noise of the swing


BIAS_SIGMA = np.radians(DEFAULT.gyro_bias_sigma_deg_s)
KNOWN = Known(np.zeros(3), np.zeros(3), BIAS_SIGMA, (), RollingLever(np.array(LEVER), np.zeros((3, 3)), 0))


def choose(level: float, seed: int = 0) -> float:
    """Choose the noise of a walk whose rate has white noise of the stance (0.01 deg/s/sqrt(Hz)) and that of a swing."""
    walk = noise_free()
    r, rng = walk.recording, np.random.default_rng(seed)
    density = np.hypot(np.radians(0.01), level * np.linalg.norm(r.gyr, axis=1))[:, None]
    gyr = r.gyr + density / np.sqrt(r.period_s) * rng.standard_normal(r.gyr.shape)
    acc = r.acc + DEFAULT.acc_density / 2 / np.sqrt(r.period_s) * rng.standard_normal(r.acc.shape)
    evidence = measure_evidence(replace(r, acc=acc, gyr=gyr), walk.stances, KNOWN, DEFAULT)
    return choose_swing_noise(*evidence, DEFAULT)[0]


@pytest.mark.parametrize("seed", range(2))
def test_the_swing_noise_follows_that_of_the_walk(seed: int) -> None:
    assert choose(4e-3, seed) == pytest.approx(4e-3, rel=0.3)
    assert choose(0.0, seed) == pytest.approx(LEVELS[-1], rel=0.1)


def test_a_piece_that_is_noisier_than_all_together_counts_and_a_walk_too_short_keeps_its_level() -> None:
    agreed = [90.0, 60.0, 30.0, 0.0]
    assert average_level(LEVELS, np.array([agreed, agreed])) == pytest.approx(LEVELS[-1])
    found = average_level(LEVELS, np.array([agreed, [90.0, 0.0, 10.0, 40.0], agreed]))
    assert found == pytest.approx(LEVELS[1], rel=1e-3)
    short = part(noise_free(), 4)
    level, note = choose_swing_noise(*measure_evidence(short.recording, short.stances, KNOWN, DEFAULT), DEFAULT)
    assert level == DEFAULT.gyr_relative_density
    assert "too few strides" in note


def test_the_evidence_of_a_level_is_that_of_the_gaussian_with_the_noise_integrated_with_it() -> None:
    """Against a dense linear model: E + 1/2 log|A^T A| + 1/2 log|S|, the differences between levels."""
    walk, levels, expected = part(noise_free(), 12), (1e-3, 1e-4), []
    piece = problem_module._Piece(walk.recording, walk.stances, KNOWN, DEFAULT)
    found, nodes = piece.measure_evidence(levels), place_nodes(walk.recording, walk.stances, DEFAULT)
    for level in levels:
        problem, p = piece._problem, replace(DEFAULT, gyr_relative_density=level)
        direct = preintegrate(walk.recording, nodes.sample, gtsam.imuBias.ConstantBias(), p)
        covariances = [measured.preintMeasCov() for measured in direct]
        for noise, of_level in zip(piece.covariances(level), covariances, strict=True):
            np.testing.assert_allclose(noise, of_level, rtol=1e-6, atol=1e-9 * of_level.max())
        for (i, factor), noise in zip(piece._inertial, covariances, strict=True):
            problem.graph.replace(i, factor.cloneWithNewNoiseModel(gtsam.noiseModel.Gaussian.Covariance(noise)))
        expected.append(dense_log_evidence(problem, problem.values) + 0.5 * np.linalg.slogdet(covariances)[1].sum())
    assert np.diff(found)[0] == pytest.approx(np.diff(expected)[0], abs=1e-3)
    assert abs(np.diff(expected)[0]) > 1.0


# --- the walk of the gyro bias


GIVEN = replace(DEFAULT, choose_swing_noise=False, gyr_relative_density=1e-4, gyr_density_deg_s=0.015)
"""Noise of the simulated gyroscope: with that of a shoe a minute shows no walk of the bias."""


def walking(walk: Walk, density: float) -> Walk:
    r = walk.recording
    steps = np.random.default_rng(0).standard_normal(r.gyr.shape) * np.sqrt(r.period_s)
    return Walk(replace(r, gyr=r.gyr + np.radians(density) * np.cumsum(steps, axis=0)), walk.stances)


def test_a_bias_that_walks_far_is_found_and_a_minute_without_a_walk_has_no_more_than_before_it() -> None:
    """The variance of the levels as often as they are expected; a walk that is there would have shown itself."""
    far, none = (
        walk_problem(walk.recording, walk.stances, 0.0, GIVEN)
        for walk in (walking(demo(), density) for density in (0.02, 0.0))
    )
    found = far.parameters.gyro_bias_walk_deg_s
    assert 0.8 * WALK_LEVELS_DEG_S[-2] < found < WALK_LEVELS_DEG_S[-1]
    note = f"gyro bias walk {found:.2g} deg/s/sqrt(s), the mean over the evidence of 6 changes"
    assert note in far.known.notes[-1]
    before = np.sqrt(np.array(WALK_PRIOR) @ np.square(WALK_LEVELS_DEG_S))
    assert WALK_LEVELS_DEG_S[0] < none.parameters.gyro_bias_walk_deg_s < before


def test_the_variance_of_the_bias_walk_is_the_mean_by_the_evidence_of_the_gaussian() -> None:
    """Against a dense linear model: E + 1/2 log|A^T A| + log of the sigmas of the changes, at each level."""
    walk, fixed = walking(part(demo(), 20), 0.02), replace(GIVEN, choose_bias_walk=False)
    one = walk_problem(walk.recording, walk.stances, 0.0, fixed)
    solved, evidence = solve(one, CONVERGENCE, with_stacks=True), []
    found = average_bias_walk(one, solved.stacks).parameters.gyro_bias_walk_deg_s
    for level in WALK_LEVELS_DEG_S:
        of = walk_problem(walk.recording, walk.stances, 0.0, replace(fixed, gyro_bias_walk_deg_s=level))
        changes = (
            f for f in map(of.graph.at, range(of.graph.size())) if isinstance(f, gtsam.BetweenFactorConstantBias)
        )
        sigmas = [cast(gtsam.noiseModel.Diagonal, change.noiseModel()).sigmas() for change in changes]
        evidence.append(dense_log_evidence(of, solved.linearized_at) + np.log(sigmas).sum())
    weight = np.array(WALK_PRIOR) * np.exp(np.min(evidence) - evidence)
    assert found == pytest.approx(np.sqrt(np.average(np.square(WALK_LEVELS_DEG_S), weights=weight)), rel=1e-4)
    assert np.ptp(evidence) > 0.05


# --- the prior of the gyro bias


ASSUMED = float(np.radians(0.15))
SIGMAS = ASSUMED * np.array(SIGMA_LEVELS)


def combine(measured: Floats, noise: Floats, mean: Floats, prior: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance of a bias measured with this noise covariance, under a Gaussian prior."""
    covariance = np.linalg.inv(np.linalg.inv(noise) + np.linalg.inv(prior))
    return covariance @ (np.linalg.solve(noise, measured) + np.linalg.solve(prior, mean)), covariance


def estimate(measured: Floats, noise: Floats, mu: Floats) -> tuple[Floats, Floats]:
    """The same under the prior that is matched to the mixture."""
    prior_mean, prior, *_ = match_mixture(*combine(measured, noise, mu, ASSUMED**2 * np.eye(3)), mu, ASSUMED)
    return combine(measured, noise, prior_mean, prior)


@pytest.mark.parametrize("mu", [np.zeros(3), np.radians([0.3, -0.2, 2.0])])
@pytest.mark.parametrize("seed", range(4))
def test_the_posterior_of_the_bias_is_that_of_the_mixture(seed: int, mu: Floats) -> None:
    """Its first two moments, by the marginal densities of what was measured."""
    rng = np.random.default_rng(seed)
    root = np.radians(rng.uniform(-0.1, 0.1, (3, 3))) + np.radians(0.02) * np.eye(3)
    noise, measured = root @ root.T, mu + np.radians(rng.uniform(0.1, 0.5, 3))
    levels = [s**2 * np.eye(3) for s in SIGMAS]
    weight = np.array(SIGMA_PRIOR) * [multivariate_normal(mu, noise + one).pdf(measured) for one in levels]
    weight /= weight.sum()
    means, spread = zip(*(combine(measured, noise, mu, one) for one in levels), strict=True)
    centre = weight @ np.array(means)
    outer = [np.outer(m - centre, m - centre) for m in means]
    expected = np.diagonal(np.tensordot(weight, np.array(spread) + outer, axes=1))
    found, covariance = estimate(measured, noise, mu)
    np.testing.assert_allclose(found, centre, rtol=1e-6, atol=1e-3 * np.sqrt(expected).min())
    # A prior takes nothing off what is shown, so two modes may be further apart than it leaves room for.
    np.testing.assert_allclose(np.diagonal(covariance), expected, rtol=0.35)


def test_errors_over_sigmas_are_one_for_sensors_of_all_kinds() -> None:
    rng, z = np.random.default_rng(1), []
    noise = np.diag(np.radians([0.02, 0.05, 0.2])) ** 2
    for s in rng.choice(SIGMAS, 800, p=SIGMA_PRIOR):
        true = s * rng.normal(size=3)
        measured = true + np.sqrt(np.diagonal(noise)) * rng.normal(size=3)
        mean, covariance = estimate(measured, noise, np.zeros(3))
        z.append((mean - true) / np.sqrt(np.diagonal(covariance)))
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(z), axis=0)), 1.0, atol=0.1)


@cache
def with_bias(added_deg_s: tuple[float, float, float], expected: bool = False) -> Solution:
    """The demo with a gyroscope that is off by so much more, without a rest; and maybe expected to be."""
    recording, p = (
        demo().recording,
        replace(DEFAULT, rest=NO_REST, gyro_bias_deg_s=added_deg_s if expected else (0.0, 0.0, 0.0)),
    )
    return smooth(replace(recording, gyr=recording.gyr + np.radians(added_deg_s)), demo().stances, p, 0.0)


def test_a_large_bias_is_found_and_noted_and_one_that_is_expected_changes_nothing_but_the_bias() -> None:
    plain, large = with_bias((0.0, 0.0, 0.0)), with_bias((1.0, 1.0, 1.0))
    assert any("gyro bias of 1" in note or "gyro bias of 2" in note for note in large.notes)
    up = large.stances.nav_R_body[0].T[:, 2]
    level = np.eye(3) - np.outer(up, up)
    difference = np.degrees(large.stances.gyro_bias[0] - plain.stances.gyro_bias[0])
    np.testing.assert_allclose(level @ difference, level @ np.ones(3), atol=0.02)
    mean = (0.3, -0.2, 0.5)
    known = with_bias(mean, True)
    np.testing.assert_allclose(known.position, plain.position, atol=5e-3)
    np.testing.assert_allclose(known.stances.position_sigma, plain.stances.position_sigma, rtol=0.02, atol=1e-3)
    found = np.degrees(known.stances.gyro_bias - plain.stances.gyro_bias)
    np.testing.assert_allclose(found, np.tile(mean, (len(found), 1)), atol=2e-3)
    assert "gyro bias of (0.300, -0.200, 0.500) deg/s within 0.15 before the walk, from the calibration" in known.notes


# --- clipped peaks


def test_the_height_of_a_clipped_run_is_nearer_to_the_truth_than_its_flanks_show_and_nothing_else_is_changed() -> None:
    """These feet turn by half as much again above the range as a parabola on the flanks does."""
    run = straight_walk(style=Style.RUN, strides=20, seed=1).recording
    clipped = replace(run, gyr=np.clip(run.gyr, -8.9, 8.9))
    stances, found = detect_stances(clipped), {}
    for name, recording, p in (
        ("clipped", clipped, DEFAULT),
        ("whole", run, DEFAULT),
        ("given", clipped, replace(DEFAULT, choose_swing_noise=False)),
    ):
        found[name] = walk_problem(recording, stances, 0.0, p)
        is_noted = any(note.startswith("clipped peaks of the rate") for note in found[name].known.notes)
        assert is_noted == (found[name].recording is not recording) == (name == "clipped")
    hidden = np.abs(run.gyr - clipped.gyr).sum()
    recordings = clipped, found["clipped"].recording
    by_flanks, by_walk = (np.abs(some.peaks[1].whole - clipped.gyr).sum() for some in recordings)
    assert abs(by_walk - hidden) < 0.3 * abs(by_flanks - hidden)


# --- stances in which the foot moves


FIXED = replace(DEFAULT, choose_swing_noise=False, choose_bias_walk=False)


@pytest.fixture(scope="module")
def walk() -> SimulatedFoot:
    return straight_walk(strides=14, seed=2)


@pytest.fixture(scope="module")
def stances(walk) -> Stances:
    return detect_stances(walk.recording)


@pytest.fixture(scope="module")
def problem(walk, stances) -> WalkProblem:
    return walk_problem(walk.recording, stances, 0.0, FIXED)


def with_false(walk: SimulatedFoot, stances: Stances, swings: list[int]) -> Stances:
    """The same with 50 ms in the middle of these swings, where the foot moves at meters a second."""
    mask = stances.mask.copy()
    for middle in np.searchsorted(walk.recording.t, walk.swing[swings].mean(axis=1)):
        mask[middle - 5 : middle + 5] = True
    return Stances.from_mask(mask)


def shift(problem: WalkProblem, footfall: int, velocity: Floats) -> WalkProblem:
    """Ties that say that the foot moves with a velocity (3,) m/s more at one footfall."""
    block, moves = problem.velocities, np.outer(problem.nodes.footfall == footfall, velocity)
    ties = replace(block.residuals, settling=block.residuals.settling + moves)
    return replace(problem, velocities=type(block)(ties, block.keys))


@pytest.mark.parametrize("speed", [0.0, 0.1])
def test_the_statistic_is_by_how_much_the_error_falls_where_the_velocity_is_free(problem, speed):
    """All ties of a footfall moved along by the d that was found, and by others: none makes the error lower."""
    footfall = 6
    moved = shift(problem, footfall, np.array([speed, 0.0, 0.0]))
    solved = solve(moved, 1e-9)
    found = compute_stance_statistics(moved, solved)
    before = moved.system.error(solved.values)

    def fall(velocity: Floats) -> float:
        free = shift(moved, footfall, velocity)
        return 2 * (before - free.system.error(solve(free, 1e-9).values))

    d, statistic = found.velocity[footfall], found.statistic[footfall]
    assert fall(d) == pytest.approx(statistic, rel=0.02, abs=1e-4)
    for step in 0.005 * np.vstack([np.eye(3), -np.eye(3)]):
        assert fall(d + step) < fall(d)
    assert d[0] == pytest.approx(-speed, abs=0.03)


def test_a_walk_keeps_all_its_stances(problem):
    solved = solve(problem)
    assert compute_stance_statistics(problem, solved).statistic.max() < 0.15 * MIN_STATISTIC
    assert weaken_refused_stances(problem, solved)[0].velocities is problem.velocities


@pytest.mark.parametrize("swings", [[5], [3, 9], [4, 5, 6]], ids=["one", "two", "three in a row"])
def test_mid_swings_that_are_called_stances_are_refused_and_no_other(walk, stances, swings):
    refused = walk_problem(walk.recording, with_false(walk, stances, swings), 0.0, FIXED)
    wrong = [swing + k + 1 for k, swing in enumerate(swings)]  # each comes behind those inserted before it
    sigma = refused.velocities.residuals.sigma[refused.nodes.result, 0]
    assert set(np.flatnonzero(sigma > 0.15)) == set(wrong)
    assert (sigma[wrong] > 1.0).all()
    assert f"{len(swings)} stance" in refused.known.notes[-1]


def test_the_path_and_its_sigmas_are_those_of_the_walk_without_refused_stances(walk, stances):
    honest, spoiled = (smooth(walk.recording, some) for some in (stances, with_false(walk, stances, [3, 7, 10])))
    assert np.linalg.norm(honest.position - spoiled.position, axis=1).max() < 0.03
    last = [solution.stances.position_cov[-1] for solution in (honest, spoiled)]
    ratio = np.sqrt(np.diag(last[1]) / np.diag(last[0]))
    assert (ratio > 0.9).all()
    assert (ratio < 1.6).all()  # the noise of the swings is chosen before, with the wrong ties
