"""A stance in which the foot moves: the walk says so, and the tie of its velocity is trusted less."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.smoother import smooth
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.problem import (
    MIN_STATISTIC,
    compute_stance_statistics,
    walk_problem,
    weaken_refused_stances,
)
from tests.simulated import SimulatedFoot, straight_walk

FIXED = SmootherParameters(choose_swing_noise=False, choose_bias_walk=False)


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


def sigma_of_footfall(problem: WalkProblem) -> Floats:
    return problem.velocities.residuals.sigma[problem.nodes.result, 0]


# --- T, d and the covariances they are made of -----------------------------------------------------------------------


@pytest.mark.parametrize("speed", [0.0, 0.1])
def test_the_statistic_is_by_how_much_the_error_falls_where_the_velocity_is_free(problem, speed):
    """All ties of a footfall moved along by the d that was found, and by others: none makes the error lower."""
    footfall = 6
    ties = problem.velocities.residuals
    moves = np.where(problem.nodes.footfall == footfall, speed, 0.0)[:, None] * [1.0, 0.0, 0.0]
    moved = shift(problem, moves)
    solved = solve(moved, 1e-9)
    found = compute_stance_statistics(moved, solved)
    before = moved.system.error(solved.values)

    def fall(velocity: Floats) -> float:
        free = shift(moved, np.where(problem.nodes.footfall == footfall, 1.0, 0.0)[:, None] * velocity)
        return 2 * (before - free.system.error(solve(free, 1e-9).values))

    d, statistic = found.velocity[footfall], found.statistic[footfall]
    assert fall(d) == pytest.approx(statistic, rel=0.02, abs=1e-4)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            assert fall(d + 0.005 * sign * np.eye(3)[axis]) < fall(d)
    assert d[0] == pytest.approx(-speed, abs=0.03)
    assert ties is problem.velocities.residuals


def shift(problem: WalkProblem, velocity: Floats) -> WalkProblem:
    """Ties that say that the foot moves with a velocity (M, 3) m/s more."""
    block = problem.velocities
    ties = replace(block.residuals, settling=block.residuals.settling + velocity)
    return replace(problem, velocities=type(block)(ties, block.keys))


# --- what becomes of them --------------------------------------------------------------------------------------------


def test_a_walk_keeps_all_its_stances(problem):
    solved = solve(problem)
    assert compute_stance_statistics(problem, solved).statistic.max() < 0.15 * MIN_STATISTIC
    assert weaken_refused_stances(problem, solved)[0].velocities is problem.velocities


@pytest.mark.parametrize("swings", [[5], [3, 9], [4, 5, 6]], ids=["one", "two", "three in a row"])
def test_mid_swings_that_are_called_stances_are_refused_and_no_other(walk, stances, swings):
    false = with_false(walk, stances, swings)
    refused = walk_problem(walk.recording, false, 0.0, FIXED)
    wrong = [swing + k + 1 for k, swing in enumerate(swings)]  # each comes behind those inserted before it
    sigma = sigma_of_footfall(refused)
    assert set(np.flatnonzero(sigma > 0.15)) == set(wrong)
    assert (sigma[wrong] > 1.0).all()
    assert f"{len(swings)} stance" in refused.known.notes[-1]


def test_the_path_and_its_sigmas_are_those_of_the_walk_without_them(walk, stances):
    honest, spoiled = (smooth(walk.recording, some) for some in (stances, with_false(walk, stances, [3, 7, 10])))
    apart = np.linalg.norm(honest.position - spoiled.position, axis=1)
    assert apart.max() < 0.03
    last = [solution.stances.position_cov[-1] for solution in (honest, spoiled)]
    ratio = np.sqrt(np.diag(last[1]) / np.diag(last[0]))
    assert (ratio > 0.9).all()
    assert (ratio < 1.6).all()  # the noise of the swings is chosen before, with the wrong ties
