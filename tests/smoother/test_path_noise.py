"""How much of the line integral telescopes, by the evidence of walks over floors that are known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fg_nav.lab.simulation.fields import draw_environment
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.evidence import MOST_NATS
from fg_nav.smoother.field_rounds import look_along, solve_with_field
from fg_nav.smoother.linear import LinearWalk
from fg_nav.smoother.path_noise import (
    REFUTED_NATS,
    SHARES,
    PathNoise,
    _eliminate_between,
    _minus_log_evidence,
    choose_path_noise,
    choose_share,
)
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solver import list_in_time, stack_walk
from fg_nav.stances import Stances
from tests.smoother.test_field import heading_error_deg, in_field, replace_field, truth_of
from tests.smoother.test_potential import ALWAYS, EARTH, solved_in
from tests.smoother.walks import demo, track_of


@cache
def noise_of(seed: int, drift_uT_m: float) -> PathNoise:
    """Of the demonstration over a rough floor, its integrals with so much white noise a stride."""
    found, _ = solved_in(seed)
    problem = found.problem
    assert problem.field is not None
    bold = problem.field.assume_lost_share(0.0)
    noise = drift_uT_m * np.random.default_rng(seed).standard_normal(len(bold.path.u))
    noisy = bold._with(replace(bold.path, u=bold.path.u + noise), 0.0)
    return choose_path_noise(replace(problem, field=noisy), found.solved.values)


def test_the_largest_share_not_refuted_and_the_smallest_near_the_best_are_taken() -> None:
    evidence = np.full(len(SHARES), 2.0 * REFUTED_NATS)
    evidence[1:3] = 0.0, MOST_NATS - 0.1
    assert choose_share(evidence) == (SHARES[1], SHARES[2])


def test_flat_evidence_leaves_the_worst_open() -> None:
    assert choose_share(np.zeros(len(SHARES))) == (SHARES[0], SHARES[-1])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_walk_of_a_minute_over_a_rough_floor_leaves_much_drift_open(seed: int) -> None:
    assert noise_of(seed, 0.0).drift_m > 0.05


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_integrals_that_do_not_telescope_are_not_taken_for_those_that_do(seed: int) -> None:
    assert noise_of(seed, 10.0).drift_m > 0.2


def test_nodes_eliminated_first_change_no_difference_of_evidence() -> None:
    found, _ = solved_in(0)
    values, field = found.solved.values, found.problem.field
    assert field is not None
    rest = _eliminate_between(found.problem, values)
    levels = [field.assume_lost_share(share) for share in (1.0, 0.1)]
    short = np.diff([_minus_log_evidence(rest, one, values) for one in levels])
    blocks = [block for block in found.problem.blocks if block is not found.problem.field]
    order = list_in_time(found.problem.nodes, with_field=True)
    walk = LinearWalk.of(stack_walk(found.problem.graph, blocks, values), order)
    whole = np.diff([_minus_log_evidence(walk, one, values) for one in levels])
    np.testing.assert_allclose(short, whole, atol=1e-6)


def over_rough_floor(seed: int) -> Recording:
    """The demonstration."""
    points = truth_of(demo(seed).recording).position[::100] * [1.0, 1.0, 0.0]
    return in_field(draw_environment("indoor", EARTH, points, np.random.default_rng(seed)).at, seed)


def noise_on(recording: Recording, stances: Stances) -> PathNoise:
    """Of a walk solved with its integrals."""
    problem = walk_problem(recording, stances, None, ALWAYS)
    found = solve_with_field(look_along(problem, average_footfall_field(recording, stances), track_of(problem)))
    return choose_path_noise(found.problem, found.solved.values)


def test_a_standing_in_pieces_shows_no_more_of_it_than_a_standing() -> None:
    """As a walk in progress has it, which cuts a long standing."""
    recording, stances = over_rough_floor(0), demo().stances
    cuts = np.linspace(stances.start[-1], stances.stop[-1], 6).astype(int)
    pieces = replace(
        stances,
        start=np.append(stances.start[:-1], cuts[:-1]),
        stop=np.append(stances.stop[:-1], cuts[1:]),
        footfall=np.append(stances.footfall[:-1], stances.footfall[-1] + np.arange(5)),
    )
    whole, in_pieces = (noise_on(recording, one) for one in (stances, pieces))
    assert in_pieces.strides == whole.strides + 4
    assert in_pieces.drift_m == pytest.approx(whole.drift_m, rel=0.3)


@pytest.mark.parametrize("seed", [0, 1])
def test_headings_that_a_gate_chose_because_they_agree_claim_no_more_than_all_of_them(seed: int) -> None:
    """Those like the first footfalls pass `aiez`, wherever the field there points."""
    recording, stances = over_rough_floor(seed), demo(seed).stances
    parameters, field = replace_field(gate="aiez", potential=False), average_footfall_field(recording, stances)
    found = smooth(recording, stances, parameters, None, field=field)
    error_deg = heading_error_deg(found, seed)[0]
    assert abs(error_deg) < 2.0 * np.degrees(found.stances.heading_sigma[0])
