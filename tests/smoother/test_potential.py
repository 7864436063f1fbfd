"""Jumps of the field's potential: a corridor with circuits of current across it, and the statistic that finds them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.frames import compute_heading
from fg_nav.lab.simulation.fields import Circuit, Sum, draw_environment
from fg_nav.lab.simulation.fields.field import Homogeneous
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother.field import (
    MIN_JUMP_STATISTIC,
    UT_M_PER_AMPERE,
    FieldSolution,
    compute_jump_statistic,
    describe_jumps,
    integrate_field,
    list_jumps,
    set_field,
    solve_with_field,
)
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.problem import walk_problem
from tests.smoother.test_field import in_field, truth_of
from tests.smoother.walks import DEFAULT, demo, track_of

EARTH = Homogeneous(np.array([0.0, 20.0, -43.0]))
CURRENT_A = 150.0


def frame_across(recording: Recording, share: float, current_A: float) -> tuple[Circuit, int]:
    """An upright frame of cable across the path, 2.4 m by 2.8 m, and the sample at which it is passed."""
    position = truth_of(recording).position
    path_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1)))
    before, at, after = np.searchsorted(path_m, share * path_m[-1] + np.array([-1.0, 0.0, 1.0]))
    forward = (position[after] - position[before]) * [1.0, 1.0, 0.0]
    right = 1.2 * np.array([forward[1], -forward[0], 0.0]) / np.linalg.norm(forward)
    foot = position[at] * [1.0, 1.0, 0.0] - [0.0, 0.0, 0.3]
    up = np.array([0.0, 0.0, 2.8])
    return Circuit(np.stack([foot - right, foot + right, foot + right + up, foot - right + up]), current_A), int(at)


@cache
def solved_in(seed: int, *currents: tuple[float, float], rough: bool = True) -> tuple[FieldSolution, list[int]]:
    """The demonstration over a rough floor with frames (share of the path, current), and where they are passed."""
    recording, stances = demo(seed).recording, demo(seed).stances
    points = truth_of(recording).position[::100] * [1.0, 1.0, 0.0]
    building = draw_environment("indoor" if rough else "smooth", EARTH, points, np.random.default_rng(seed))
    frames = [frame_across(recording, *one) for one in currents]
    recording = in_field(Sum((building, *(frame for frame, _ in frames))).at, seed)
    heading = float(compute_heading(truth_of(recording).nav_R_body[:1])[0])
    problem = walk_problem(recording, stances, heading, DEFAULT)
    field = average_footfall_field(recording, stances)
    found = solve_with_field(problem, field, integrate_field(problem, field, track_of(problem)))
    sample = found.problem.nodes.sample[found.problem.nodes.result]
    return found, [int(np.searchsorted(sample, passed)) - 1 for _, passed in frames]


def integrate_frame(seed: int, first: int, last: int, found: FieldSolution) -> float:
    """Integral of the frame's own field along the path from one footfall to another, uT m."""
    recording = demo(seed).recording
    frame, _ = frame_across(recording, 0.4, CURRENT_A)
    sample = found.problem.nodes.sample[found.problem.nodes.result]
    path = truth_of(recording).position[sample[first] : sample[last] + 1]
    field = frame.at(path)
    return float((0.5 * (field[1:] + field[:-1]) * np.diff(path, axis=0)).sum())


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_circuit_is_found_where_it_is_passed_with_what_its_current_adds_there(seed: int) -> None:
    """Over three strides: four fifths of mu_0 I. What the frame does further off is within the potential's bounds."""
    found, strides = solved_in(seed, (0.4, CURRENT_A))
    (jump,) = list_jumps(found.problem, found.solved)
    assert jump.first <= strides[0] < jump.last
    added = integrate_frame(seed, jump.first, jump.last, found)
    assert 0.75 * UT_M_PER_AMPERE * CURRENT_A < abs(added) < UT_M_PER_AMPERE * CURRENT_A
    assert jump.size_uT_m == pytest.approx(added, rel=0.3)
    (note,) = describe_jumps(found.problem, found.solved)
    assert f"circuit of {abs(jump.size_uT_m) / UT_M_PER_AMPERE:.0f} A" in note


@pytest.mark.parametrize("rough", [True, False], ids=["rough", "smooth"])
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_no_jump_is_found_over_a_clean_floor(seed: int, rough: bool) -> None:
    found, _ = solved_in(seed, rough=rough)
    assert not list_jumps(found.problem, found.solved)
    statistic = statistic_of(found)
    assert statistic.max() < 1.5 * MIN_JUMP_STATISTIC
    assert 0.1 < statistic.mean() < 2.0


def test_the_statistic_is_by_how_much_twice_the_error_falls_without_the_row() -> None:
    found, _ = solved_in(1)
    statistic = statistic_of(found)
    for row in (int(statistic.argmax()), len(statistic) // 2):
        stride = found.problem.get(FieldFactors).strides[row]
        freed = found.problem.get(FieldFactors).mark_jumps(np.array([stride]), True)
        without = replace(set_field(found.problem, freed), values=found.solved.values)
        with_it = error_of(replace(found.problem, values=found.solved.values))
        fall = 2.0 * (with_it - error_of(without))
        assert fall == pytest.approx(statistic[row], rel=0.05, abs=0.02)


def statistic_of(found: FieldSolution) -> Floats:
    return compute_jump_statistic(found.problem.get(FieldFactors).potential, found.solved)


def error_of(problem: WalkProblem) -> float:
    values = solve(problem, 1e-7).values
    return float(problem.graph.error(values) + sum(block.error(values) for block in problem.blocks))
