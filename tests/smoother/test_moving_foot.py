"""A foot that moves on at its stillest instant: how the walk moves with it, and what its sigmas say of that."""

from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats
from fg_nav.evaluation import evaluate
from fg_nav.factors.residual import ResidualBlock
from fg_nav.online.estimates import CompassVerdict, estimate_stance
from fg_nav.online.strides import StanceNodes
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.problem import _cut, walk_problem
from fg_nav.smoother.sensitivity import FORWARD_SIGMA, SIDEWAYS_SIGMA, find_motion, weigh_moving_foot
from fg_nav.smoother.solver import Solved
from tests.simulated import RIGID
from tests.smoother.walks import DEFAULT, noise_free

P = replace(DEFAULT, settling_m=0.0)
STRAIGHT = (4, 13)  # Footfalls in the corridor, before its first corner.


@cache
def solved_walk() -> tuple[WalkProblem, Solved]:
    walk = noise_free(RIGID)
    problem = walk_problem(walk.recording, walk.stances, 0.0, P)
    return problem, solve(problem)


def with_share(problem: WalkProblem, solved: Solved, share: Floats) -> Floats:
    """Positions (M, 3) of the nodes where the ties are of a foot that moves on by these shares (2,)."""
    nodes = range(len(problem.nodes))
    attitude = np.array([solved.values.atPose3(X(j)).rotation().matrix() for j in nodes])
    moves = find_motion(problem, solved.values) @ share
    ties = problem.velocities.residuals
    ties = replace(ties, body_velocity=ties.body_velocity + np.einsum("kji,kj->ki", attitude, moves))
    moved = replace(problem, velocities=ResidualBlock(ties, problem.velocities.keys), values=solved.values)
    values = solve(moved).values
    return np.array([values.atPose3(X(j)).translation() for j in nodes])


@pytest.mark.parametrize("axis", [0, 1])
def test_a_walk_moves_with_its_foot_as_its_columns_say(axis: int) -> None:
    problem, solved = solved_walk()
    columns = solved.root.split(weigh_moving_foot(problem, solved)[0].spread(np.eye(2)))
    share = 1e-4 * np.eye(2)[axis]
    difference = (with_share(problem, solved, share) - with_share(problem, solved, -share)) / 2e-4
    pose = [solved.values.atPose3(X(j)) for j in range(len(problem.nodes))]
    told = np.array([-one.rotation().matrix() @ columns[X(j)][3:, axis] for j, one in enumerate(pose)])
    np.testing.assert_allclose(told, difference, atol=0.03 * np.abs(difference).max())


def test_forward_it_is_a_scale_of_the_walk_and_sideways_a_turn() -> None:
    problem, solved = solved_walk()
    position = with_share(problem, solved, np.zeros(2))
    for axis, expected in ((0, position[:, :2]), (1, np.column_stack([-position[:, 1], position[:, 0]]))):
        moved = (with_share(problem, solved, 0.01 * np.eye(2)[axis]) - position)[:, :2] / 0.01
        # Stops at the corners, where the foot does not move on, and turns in place take some of it.
        assert np.linalg.norm(moved - expected, axis=1).max() < 0.25 * np.linalg.norm(position, axis=1).max()


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
    assert found.distance_sigma_m < np.hypot(without.distance_sigma_m, 1.1 * FORWARD_SIGMA * length)


def test_a_straight_even_walk_does_not_show_it() -> None:
    """Galilei: nearly all of the prior is left, and on a walk with turns and stops less."""
    walk = noise_free(RIGID)
    problem = walk_problem(*_cut(walk.recording, walk.stances, *STRAIGHT), 0.0, P)
    prior = np.diag([FORWARD_SIGMA**-2, SIDEWAYS_SIGMA**-2])
    straight, turning = (
        np.linalg.inv(weigh_moving_foot(*one)[1] + prior)[0, 0] for one in ((problem, solve(problem)), solved_walk())
    )
    assert straight > (0.95 * FORWARD_SIGMA) ** 2
    assert turning < 0.9 * straight


def test_a_walk_in_progress_has_a_scale_and_a_turn_about_its_start() -> None:
    stance = StanceNodes(7, 7, 8, 7, 0, 0.0, 700, 7.0, (700,))
    state = gtsam.Pose3(gtsam.Rot3(), [30.0, 40.0, 5.0]), np.zeros(3), gtsam.imuBias.ConstantBias()
    known = stance, *state, 0.01 * np.eye(6), np.eye(6), CompassVerdict("", "")
    still, moving = (estimate_stance(*known, moves, False).pose_cov for moves in (False, True))
    more = moving - still
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    assert along @ more[:2, :2] @ along == pytest.approx((50.0 * FORWARD_SIGMA) ** 2)
    assert across @ more[:2, :2] @ across == pytest.approx((50.0 * SIDEWAYS_SIGMA) ** 2)
    assert not more[2:].any()
