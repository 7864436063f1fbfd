"""Jumps of the field's potential: a corridor with circuits of current across it, and the statistic that finds them."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from gtsam.symbol_shorthand import M, X
from scipy.stats import multivariate_normal

from fg_nav.arrays import Floats
from fg_nav.factors.magnetic_field import PHI, SIZE
from fg_nav.factors.residual import Stack
from fg_nav.frames import compute_heading
from fg_nav.lab.simulation.fields import Circuit, Sum, draw_environment
from fg_nav.lab.simulation.fields.field import Homogeneous
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.field import (
    MIN_JUMP_STATISTIC,
    SHARES,
    SHARES_PRIOR,
    UT_M_PER_AMPERE,
    FieldSolution,
    average_path_noise,
    compute_jump_statistic,
    describe_jumps,
    integrate_field,
    list_jumps,
    set_field,
    solve_with_field,
)
from fg_nav.smoother.field_factors import MIN_TELESCOPING, PATH_SIGMA_UT_M, FieldFactors, FieldRoughness
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.problem import walk_problem
from tests.smoother.test_field_factors import KNOWN, NEVER, NONE, ROUGH, Walked, steady  # noqa: F401
from tests.smoother.walks import DEFAULT, demo, heading_error_deg, in_field, replace_field, track_of

EARTH = Homogeneous(np.array([0.0, 20.0, -43.0]))
CURRENT_A = 150.0


def frame_across(recording: Recording, share: float, current_A: float) -> tuple[Circuit, int]:
    """An upright frame of cable across the path, 2.4 m by 2.8 m, and the sample at which it is passed."""
    position = recording.truth.position
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
    points = recording.truth.position[::100] * [1.0, 1.0, 0.0]
    building = draw_environment("indoor" if rough else "smooth", EARTH, points, np.random.default_rng(seed))
    frames = [frame_across(recording, *one) for one in currents]
    recording = in_field(Sum((building, *(frame for frame, _ in frames))).at, seed)
    heading = float(compute_heading(recording.truth.nav_R_body[:1])[0])
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
    path = recording.truth.position[sample[first] : sample[last] + 1]
    field = frame.at(path)
    return float((0.5 * (field[1:] + field[:-1]) * np.diff(path, axis=0)).sum())


@pytest.mark.parametrize("seed", [0, 1])
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
@pytest.mark.parametrize("seed", [0, 1, 2])
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


def with_integrals(field: FieldFactors, added: Floats) -> FieldFactors:
    """Factors of the field with so much added to the line integrals, all of whose changes telescope."""
    path = replace(field.path, u=field.path.u + added)
    return FieldFactors(field.readings, path, field.prior, field.rough, field.parameters, 0.0)


def potentials(share: float, walked: Walked) -> multivariate_normal:
    """Density of what the integrals of the strides deviate by from those of the building's field, poses known."""
    rough, way = ROUGH.potential, np.append(0.0, np.cumsum(walked.path.distance_m))
    telescoping = max(1.0 - share, MIN_TELESCOPING) * rough.sigma**2
    covariance = telescoping * np.exp(-np.abs(way[:, None] - way) / rough.length_m)
    own = share * 2.0 * rough.sigma**2 * (1.0 - np.exp(-walked.path.distance_m / rough.length_m))
    change = np.diff(np.eye(len(way)), axis=0)
    return multivariate_normal(cov=change @ covariance @ change.T + np.diag(PATH_SIGMA_UT_M**2 + own))


class NoNodesBetween(list[int]):
    """Nodes of a walk all of which are footfalls."""

    result = ()


def find_share(walked: Walked, added: Floats) -> float:
    """Find the lost share of integrals that are off by so much, poses and building known."""
    field, count = with_integrals(walked.factors, added), walked.count
    poses = np.array([[X(2 * k)] for k in range(count)], dtype=np.uint64)
    known = Stack(poses, np.tile(np.hstack([np.eye(6) / NEVER**2, np.zeros((6, 1))]), (count, 1, 1)))
    keys = np.array([key for k in range(count) for key in (X(2 * k), M(k))], dtype=np.uint64)
    rest = SimpleNamespace(system=SimpleNamespace(stack=lambda _: [known]))
    whole = SimpleNamespace(get=lambda _: field, without=lambda _: rest, nodes=NoNodesBetween(), time_order=keys)
    return average_path_noise(cast(WalkProblem, whole), walked.values()).lost_share


def in_known_building(count: int) -> Walked:
    """Nothing but the potential is asked."""
    first = replace(KNOWN, sigma=np.where(np.arange(SIZE) == PHI, ROUGH.potential.sigma, NEVER))
    rough = FieldRoughness(ROUGH.potential, NONE, NONE, 0.0)
    return Walked(count=count, tilt=0.0, rough=rough, first=first, used=np.zeros(count, dtype=bool))


@pytest.mark.usefixtures("steady")
@pytest.mark.parametrize("true", [SHARES[0], 0.1, SHARES[-1]])
def test_evidence_is_that_of_the_density_of_the_integrals(true: float) -> None:
    walked = in_known_building(40)
    added = potentials(true, walked).rvs(random_state=0)
    log_density = np.array([potentials(share, walked).logpdf(added) for share in SHARES])
    weights = SHARES_PRIOR * np.exp(log_density - log_density.max())
    assert find_share(walked, added) == pytest.approx(np.average(SHARES, weights=weights), rel=1e-3)


@pytest.mark.parametrize("seed", [0, 1])
def test_integrals_that_do_not_telescope_are_not_taken_for_those_that_do(seed: int) -> None:
    """White noise of 3 uT m a stride over a rough floor, in a field of 20 uT."""
    problem = solved_in(seed)[0].problem
    bold, values = problem.get(FieldFactors).assume_lost_share(0.0), solved_in(seed)[0].solved.values
    noisy = with_integrals(bold, 3.0 * np.random.default_rng(seed).standard_normal(len(bold.path.u)))
    assert average_path_noise(set_field(problem, noisy), values).drift_m > 3.0 / 20.0


@pytest.mark.parametrize("seed", [0, 1])
def test_headings_that_a_gate_chose_because_they_agree_claim_no_more_than_all_of_them(seed: int) -> None:
    """Those like the first footfalls pass `aiez`, wherever the field there points."""
    points, stances = demo(seed).recording.truth.position[::100] * [1.0, 1.0, 0.0], demo(seed).stances
    recording = in_field(draw_environment("indoor", EARTH, points, np.random.default_rng(seed)).at, seed)
    parameters, field = replace_field(gate="aiez", potential=False), average_footfall_field(recording, stances)
    found = smooth(recording, stances, parameters, None, field=field)
    error_deg = heading_error_deg(found, seed)[0]
    assert abs(error_deg) < 2.0 * np.degrees(found.stances.heading_sigma[0])
