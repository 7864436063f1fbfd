"""How a solution moves with numbers that its factors share, against dense linear algebra."""

from dataclasses import replace
from functools import cache
from itertools import product

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from scipy.stats import multivariate_normal

from fg_nav.arrays import Floats
from fg_nav.evaluation import evaluate
from fg_nav.factors.residual import ResidualBlock
from fg_nav.magnetic import average_footfall_field
from fg_nav.mechanisation import NavState, rotation_vector, strapdown
from fg_nav.online.estimates import CompassVerdict, estimate_stance
from fg_nav.online.strides import StanceNodes
from fg_nav.recording import Recording
from fg_nav.smoother import sensitivity, smooth, smooth_graph
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.problem import _cut, walk_problem
from fg_nav.smoother.solver import Solved, list_poses, list_positions
from fg_nav.solution import Solution
from tests.simulated import RIGID, corridor
from tests.smoother.test_field import earth
from tests.smoother.walks import DEFAULT, demo, dense_root, find_columns, heading_error_deg, in_field, noise_free, part


def test_shared_columns_and_the_covariance_of_footfalls_are_those_of_dense_matrices() -> None:
    walk, rng = part(demo(), 6), np.random.default_rng(0)
    problem = walk_problem(walk.recording, walk.stances, 0.0, DEFAULT)
    solved, columns = solve(problem), find_columns(problem)
    A, _, root = dense_root(problem, solved.linearized_at)
    # How the solution moves with numbers that its factors share.
    C, products = rng.standard_normal((len(A), 3)), np.zeros((solved.root.total, 3))
    products[np.concatenate([solved.root.find_columns([(key,)])[0] for key in columns])] = A.T @ C
    found = sensitivity.SharedColumns(solved.root, products)
    explained = root.T @ (A.T @ C)
    assert found.explained == pytest.approx(explained.T @ explained, rel=1e-6)
    moved, expected = solved.root.split(found.solve()), root @ explained
    for key, own in columns.items():
        np.testing.assert_allclose(moved[key], expected[own], rtol=1e-4, atol=1e-6 * np.abs(expected[own]).max())
    # Covariance of combinations of footfalls.
    shared = 1e-3 * rng.standard_normal((solved.root.total, 2))
    joint = sensitivity.FootfallCovariance.of(solved, problem.nodes, shared)
    T = np.zeros((len(joint.keys), 4, A.shape[1]))
    for of, key, nav_T_body in zip(T, joint.keys, joint.nav_T_body, strict=True):
        of[:, columns[key]] = nav_T_body
    C = T.reshape(-1, A.shape[1]) @ np.hstack([root, shared])
    weights = rng.standard_normal((len(T), 4, 3))
    covariance, cross = joint.combine(weights)
    flat, C = weights.reshape(-1, 3), C @ C.T
    assert covariance == pytest.approx(flat.T @ C @ flat, rel=1e-6)
    assert cross.reshape(-1, 3) == pytest.approx(C @ flat, rel=1e-5, abs=1e-6 * np.abs(C @ flat).max())
    # And of the moves from one to the next.
    moves = joint.measure_moves(problem.nodes)
    assert np.isnan(moves[0]).all()
    for k in range(1, len(T)):
        difference = np.eye(len(C))[4 * k : 4 * k + 4] - np.eye(len(C))[4 * k - 4 : 4 * k]
        expected = difference @ C @ difference.T
        assert moves[k] == pytest.approx(expected, rel=1e-5, abs=1e-6 * np.abs(expected).max())


def test_weights_of_a_path_are_the_derivatives_of_its_length() -> None:
    position = np.random.default_rng(1).uniform(-5, 5, (7, 3))
    for until, k, axis in product((3, 6), range(7), range(3)):
        step = np.zeros((7, 3))
        step[k, axis] = 1e-6
        ahead, behind = (np.diff((position + sign * step)[: until + 1], axis=0) for sign in (1.0, -1.0))
        longer = np.linalg.norm(ahead, axis=1).sum() - np.linalg.norm(behind, axis=1).sum()
        weights = sensitivity.weigh_path(position, until)
        assert not weights[:, 3].any()
        assert weights[k, axis] == pytest.approx(longer / 2e-6, abs=1e-8)
    assert not sensitivity.weigh_path(np.zeros((3, 3))).any()


def test_a_solution_has_the_sigma_of_its_distance() -> None:
    walk = part(demo(), 12)
    smoothed = smooth_graph(walk.recording, walk.stances)
    solution, joint = smoothed.solution, smoothed.joint
    place = solution.stances.position
    weights = np.zeros((len(place), 4, 1))
    weights[-1, :3, 0] = (place[-1] - place[0]) / np.linalg.norm(place[-1] - place[0])
    weights[0] = -weights[-1]
    # The first leg of the corridor is straight: what is not known of its end is what is not known of its length.
    assert solution.distance_sigma_m == pytest.approx(np.sqrt(joint.combine(weights)[0][0, 0]), rel=0.1)


P = replace(DEFAULT, settling_m=0.0)
STRAIGHT = (4, 13)  # Footfalls in the corridor, before its first corner.


@cache
def solved_walk() -> tuple[WalkProblem, Solved]:
    walk = noise_free(RIGID)
    problem = walk_problem(walk.recording, walk.stances, 0.0, P)
    return problem, solve(problem)


def with_share(problem: WalkProblem, solved: Solved, share: Floats) -> Floats:
    """Positions (M, 3) of the nodes where the ties are of a foot that moves on by these shares (2,)."""
    number, moves = range(len(problem.nodes)), sensitivity.find_motion(problem, solved.values) @ share
    ties = problem.velocities.residuals
    in_body = np.einsum("kji,kj->ki", list_poses(number, solved.values)[:, :3, :3], moves)
    ties = replace(ties, body_velocity=ties.body_velocity + in_body)
    moved = replace(problem, velocities=ResidualBlock(ties, problem.velocities.keys), values=solved.values)
    return list_positions(number, solve(moved).values)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_walk_moves_with_its_foot_as_its_columns_say(axis: int) -> None:
    problem, solved = solved_walk()
    columns = solved.root.split(sensitivity.weigh_moving_foot(problem, solved)[0].spread(np.eye(2)))
    share = 1e-4 * np.eye(2)[axis]
    difference = (with_share(problem, solved, share) - with_share(problem, solved, -share)) / 2e-4
    pose = list_poses(range(len(problem.nodes)), solved.values)
    told = np.array([-one[:3, :3] @ columns[X(j)][3:, axis] for j, one in enumerate(pose)])
    np.testing.assert_allclose(told, difference, atol=0.03 * np.abs(difference).max())


def test_forward_it_is_a_scale_of_the_walk_and_sideways_a_turn() -> None:
    problem, solved = solved_walk()
    position = with_share(problem, solved, np.zeros(2))
    for axis, expected in ((0, position[:, :2]), (1, np.column_stack([-position[:, 1], position[:, 0]]))):
        moved = (with_share(problem, solved, 0.01 * np.eye(2)[axis]) - position)[:, :2] / 0.01
        # Stops at the corners, where the foot does not move on, and turns in place take some of it.
        assert np.linalg.norm(moved - expected, axis=1).max() < 0.25 * np.linalg.norm(position, axis=1).max()


def test_what_is_found_of_it_and_not_taken_off_is_in_the_spread() -> None:
    """Its error about zero: three sigmas of the prior either way."""
    columns, information, _ = sensitivity.weigh_moving_foot(*solved_walk())
    prior, moved = (
        np.diag([sensitivity.FORWARD_SIGMA**2, sensitivity.SIDEWAYS_SIGMA**2]),
        3.0 * np.array([sensitivity.FORWARD_SIGMA, -sensitivity.SIDEWAYS_SIGMA]),
    )
    covariance = np.linalg.inv(information + np.linalg.inv(prior))
    found = covariance @ information @ moved
    assert (np.abs(found) > np.sqrt(np.diag(covariance))).any()
    by_one, spread = columns.solve()[:60], columns.spread_untaken(information, information @ moved, prior)[:60]
    expected = by_one @ (covariance + np.outer(found, found)) @ by_one.T
    np.testing.assert_allclose(spread @ spread.T, expected, atol=1e-9 * np.abs(expected).max())


def carried_on(recording: Recording, share: float) -> Recording:
    """The same walk with all of its motion over ground faster by a share: so its stances move on at that share."""
    truth, h = recording.truth, recording.period_s
    velocity = np.gradient(truth.position, h, axis=0) * [1.0, 1.0, 0.0]
    window = np.hanning(2 * round(1.2 / h) + 1)
    mean = np.stack([np.convolve(axis, window / window.sum(), mode="same") for axis in velocity.T], axis=1)
    acceleration = np.gradient(share * mean, h, axis=0)
    path = truth.position + share * np.cumsum(mean, axis=0) * h
    acc = recording.acc + np.einsum("nji,nj->ni", truth.nav_R_body, acceleration)
    return replace(recording, acc=acc, truth=replace(truth, position=path))


@pytest.mark.parametrize("share", [-0.03, 0.03])
def test_the_length_is_off_by_what_its_sigma_says(share: float) -> None:
    walk = noise_free(RIGID)
    recording = carried_on(walk.recording, share)
    found = smooth(recording, walk.stances, P)
    length = np.linalg.norm(np.diff(found.stances.position, axis=0), axis=1).sum()
    off = evaluate(found, recording.truth).scale - 1.0
    assert abs(off) > 0.3 * abs(share)
    assert abs(off) < 2.5 * found.distance_sigma_m / length
    without = smooth(recording, walk.stances, replace(P, moving_foot=False))
    assert abs(off) > 3.0 * without.distance_sigma_m / length
    assert found.distance_sigma_m < np.hypot(without.distance_sigma_m, 1.1 * sensitivity.FORWARD_SIGMA * length)


def test_a_straight_even_walk_does_not_show_it() -> None:
    """Galilei: nearly all of the prior is left, and on a walk with turns and stops less."""
    walk = noise_free(RIGID)
    problem = walk_problem(*_cut(walk.recording, walk.stances, *STRAIGHT), 0.0, P)
    prior = np.diag([sensitivity.FORWARD_SIGMA**-2, sensitivity.SIDEWAYS_SIGMA**-2])
    straight, turning = (
        np.linalg.inv(sensitivity.weigh_moving_foot(*one)[1] + prior)[0, 0]
        for one in ((problem, solve(problem)), solved_walk())
    )
    assert straight > (0.95 * sensitivity.FORWARD_SIGMA) ** 2
    assert turning < 0.9 * straight


def test_a_walk_in_progress_has_a_scale_and_a_turn_about_its_start() -> None:
    stance = StanceNodes(7, 7, 8, 7, 0, 0.0, 700, 7.0, (700,))
    state = gtsam.Pose3(gtsam.Rot3(), [30.0, 40.0, 5.0]), np.zeros(3), gtsam.imuBias.ConstantBias()
    known = stance, *state, 0.01 * np.eye(6), np.eye(6), CompassVerdict("", "")
    still, moving = (estimate_stance(*known, moves, False).pose_cov for moves in (False, True))
    more = moving - still
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    assert along @ more[:2, :2] @ along == pytest.approx((50.0 * sensitivity.FORWARD_SIGMA) ** 2)
    assert across @ more[:2, :2] @ across == pytest.approx((50.0 * sensitivity.SIDEWAYS_SIGMA) ** 2)
    assert not more[2:].any()


SCALE = (0.02, -0.02, 0.02)


def integrate(t: Floats, force: Floats, rate: Floats) -> NavState:
    """Free motion from rest."""
    state = NavState(np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))
    turn, push = np.empty((3, 3)), np.empty(3)
    for i in range(len(t) - 1):
        strapdown(state, force[i], rate[i], t[i + 1] - t[i], 0.0, turn, push)
    return state


@pytest.mark.parametrize("axis", range(3))
def test_sensitivity_is_that_of_integrated_samples(axis: int) -> None:
    """A swing of 0.4 s at up to 8 rad/s and 25 m/s^2, 400 Hz."""
    t = np.arange(161) / 400.0
    phase = np.pi * t[:, None] / t[-1]
    rate = np.sin(phase * [1.0, 2.0, 1.5]) * [3.0, -8.0, 4.0]
    force = np.cos(phase * [2.0, 1.0, 3.0]) * [25.0, 10.0, 20.0] + [0.0, 0.0, 9.8]
    bias, d = np.array([0.01, -0.02, 0.03]), 1e-4
    s = d * np.eye(3)[axis]
    low, high = (integrate(t, force, (rate - bias) / (1.0 + sign * s)) for sign in (-1.0, 1.0))
    end_R_start = integrate(t, force, rate - bias).nav_R_body.T
    expected = [
        rotation_vector(low.nav_R_body.T @ high.nav_R_body),
        end_R_start @ (high.position - low.position),
        end_R_start @ (high.velocity - low.velocity),
    ]
    found = sensitivity.sense_rate_error(t, force, rate, np.array([0, len(t) - 1]), bias[None], rate - bias)[0]
    for rows, e in zip(np.split(found[:, axis], 3), expected, strict=True):
        np.testing.assert_allclose(rows, e / (2 * d), atol=2e-3 * np.linalg.norm(e) / (2 * d))


@cache
def smoothed(scale: tuple[float, float, float] | None, corrected: bool = True, half: bool = False) -> Solution:
    """In a homogeneous field, the rate of a wrong scale, and maybe in the later half alone."""
    recording, stances = in_field(earth()), demo().stances
    where = np.arange(len(recording))[:, None] >= (len(recording) // 2 if half else 0)
    wrong = replace(recording, gyr=recording.gyr * (1.0 + np.array(scale or (0.0, 0.0, 0.0)) * where))
    field = average_footfall_field(wrong, stances)
    return smooth(wrong, stances, replace(DEFAULT, gyro_scale=corrected), 0.0, field=field)


def test_a_wrong_scale_is_taken_off_where_the_field_shows_it_and_nothing_else_is_changed() -> None:
    """A scale of one half alone is none, and stays in the sigmas."""
    wrong, right, half = smoothed(SCALE), smoothed(None), smoothed(SCALE, half=True)
    assert [any("scale errors" in note for note in one.notes) for one in (wrong, right, half)] == [True, False, False]
    without, with_it = (np.sqrt((heading_error_deg(one) ** 2).mean()) for one in (smoothed(SCALE, False), wrong))
    assert with_it < 0.6 * without
    np.testing.assert_array_equal(right.position, smoothed(None, False).position)
    assert half.stances.heading_sigma[-1] > 1.15 * right.stances.heading_sigma[-1]


def priors() -> list[Floats]:
    """Covariances of the errors of both halves: nothing but what is alike, one scale, one in each half."""
    same, own = np.kron(np.ones((2, 2)), np.eye(3)), np.eye(6)
    alike = sensitivity.ALIKE_SIGMA**2 * (same + sensitivity.MIN_OWN * own)
    return [alike, alike + sensitivity.SCALE_SIGMA**2 * same, alike + sensitivity.SCALE_SIGMA**2 * own]


NOISE = np.kron([[1.0, 0.2], [0.2, 2.0]], [[4.0, 1.0, 0.0], [1.0, 9.0, -1.0], [0.0, -1.0, 2.0]]) * 1e-6
"""Covariance (6, 6) of what a walk shows of the errors of its halves."""


@pytest.mark.parametrize("seed", range(5))
def test_evidence_of_the_three_models_is_that_of_multivariate_normals(seed: int) -> None:
    """So are the mean and the second moment, by the gains of normal variables."""
    rng = np.random.default_rng(seed)
    shown = rng.multivariate_normal(np.zeros(6), priors()[seed % 3] + NOISE)
    weight = np.array([multivariate_normal(cov=prior + NOISE).pdf(shown) for prior in priors()])
    weight /= weight.sum()
    half = np.kron([[0.5, 0.5]], np.eye(3))
    gains = [prior @ np.linalg.inv(prior + NOISE) for prior in priors()]
    means = np.array([half @ gain @ shown for gain in gains])
    left = [half @ (prior - gain @ prior) @ half.T for gain, prior in zip(gains, priors(), strict=True)]
    information = np.linalg.inv(NOISE)
    found = sensitivity.average_models(information, information @ shown)
    assert found.probability == pytest.approx(weight[1], rel=1e-6)
    np.testing.assert_allclose(found.scale, weight[1] * means[1], atol=1e-9)
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(left[1])), rtol=1e-6)
    off = means - found.scale * found.matters
    expected = sum(w * (P + np.outer(m, m)) for w, P, m in zip(weight, left, off, strict=True))
    np.testing.assert_allclose(found.second_moment, expected, atol=1e-11)


def test_what_rebuilt_peaks_have_in_common_is_in_the_heading_sigma() -> None:
    """The pitch rate of a foot, cut at 60 % and rebuilt: two sides of one axis, and their error in the sigma."""
    walk, given = part(demo(), 40), replace(DEFAULT, choose_swing_noise=False)
    axis = int(np.abs(walk.recording.gyr).max(axis=0).argmax())
    level = 0.6 * np.abs(walk.recording.gyr[:, axis]).max()
    clipped = replace(walk.recording, gyr=np.clip(walk.recording.gyr, -level, level))
    assert clipped.peaks[1].run[:, axis].any()
    found = smooth_graph(clipped, walk.stances, given)
    assert 1 <= sensitivity.spread_clipped_peaks(found.walk.problem, found.walk.solved).shape[1] <= 4
    assert sensitivity.spread_clipped_peaks(*solved_walk()).shape[1] == 0
    error = np.abs(heading_error_deg(found.solution)[-1])
    assert error < 3.0 * np.degrees(found.solution.stances.heading_sigma[-1])


def test_sigmas_hold_what_is_left_of_a_scale_that_was_taken_off() -> None:
    """1 % on each axis, three seeds: squares of heading and bias errors over their variances are of order 1."""
    headings, biases = [], []
    for seed in range(3):
        recording, stances = in_field(earth(), seed), demo(seed).stances
        wrong = replace(recording, gyr=recording.gyr * 1.01)
        found = smooth(wrong, stances, DEFAULT, 0.0, field=average_footfall_field(wrong, stances))
        headings.append(np.mean(np.radians(heading_error_deg(found, seed)) ** 2 / found.stances.heading_sigma**2))
        error = found.stances.gyro_bias[:, 2] - corridor(seed=seed).gyro_bias[2]
        biases.append(np.mean((error / found.stances.gyro_bias_sigma[:, 2]) ** 2))
    assert np.mean(headings) < 3.0
    assert np.mean(biases) < 3.0
