"""The factors of the field: their sigmas, the processes of their states, their limits, and jumps of the potential."""

from dataclasses import replace
from functools import cache
from itertools import chain
from types import SimpleNamespace
from typing import cast

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import M, X
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from fg_nav.arrays import Floats
from fg_nav.factors.magnetic_field import DELTA, PHI, REGION, SIZE, TAIL_SIGMAS, FieldPrior
from fg_nav.factors.residual import Stack
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.lab.simulation.fields import Circuit, Sum, draw_environment
from fg_nav.lab.simulation.fields.field import Homogeneous
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother import field_factors, smooth
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
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.smoother.problem import walk_problem
from tests.factors.variables import pose, values_of
from tests.linear import linear_factors
from tests.smoother.walks import DEFAULT, demo, heading_error_deg, in_field, ordering_of, replace_field, track_of

P = FieldParameters()
COMPASS = replace(P, potential=False)
EARTH = np.array([3.0, 20.0, -43.0])
STRENGTH = float(np.hypot(3.0, 20.0))
RIGHT = np.array([EARTH[1], -EARTH[0]]) / STRENGTH  # Of the field, over ground.
ROUGH = FieldRoughness(
    field_factors.Roughness(4.0, 2.0), field_factors.Roughness(5.0, 1.5), field_factors.Roughness(2.0, 60.0), 3.0
)
FIRST = FieldPrior(
    np.array([0.0, 0.0, 0.0, 0.0, *EARTH[:2], 0.0, 0.0, 0.0]), np.array([4.0, 5.0, 2.0, 2.0, 1.0, 5.0, 0.3, 0.3, 15.0])
)
NEVER = 1e-4  # Sigma of what is as good as known.
UNIT = gtsam.noiseModel.Unit.Create(1)


def error_of(factors: FieldFactors, values: gtsam.Values) -> float:
    return sum(block.error(values) for block in factors.blocks)


class Walked:
    """Footfalls in the Earth's field, their factors, and the truth to linearize them at."""

    def __init__(
        self,
        count: int = 4,
        tilt: float = 0.3,
        rough: FieldRoughness = ROUGH,
        first: FieldPrior = FIRST,
        p: FieldParameters = P,
        used: Floats | bool = True,
    ) -> None:
        rng, self.count = np.random.default_rng(0), count
        yaw, heading = rng.uniform(-np.pi, np.pi, (2, count))
        tilted = Rotation.from_rotvec(tilt * rng.standard_normal((count, 3)) * [1.0, 1.0, 0.0]).as_matrix()
        R = self.nav_R_body = yaw_rotation(yaw) @ tilted
        steps = 1.3 * np.stack([np.sin(heading), np.cos(heading), 0.05 * rng.standard_normal(count)], axis=1)
        self.position, move = np.cumsum(steps, axis=0), steps[1:]
        self.path = field_factors.FieldPath(
            u=move[:, :2] @ EARTH[:2],
            level_path=rng.standard_normal((count - 1, 3)),
            by_up=np.zeros((count - 1, 3)),
            body_move=np.einsum("nji,nj->ni", R[:-1], move),
            nav_R_level=R[:-1],
            sigma_uT_m=np.full(count - 1, PATH_SIGMA_UT_M),
            distance_m=np.linalg.norm(move, axis=1),
            level_R_body=Rotation.random(rng=rng).as_matrix(),
            jumps=np.zeros(count - 1, dtype=np.bool_),
        )
        sigma = np.where(np.broadcast_to(used, count), field_factors.COMPASS_SIGMA_UT, np.inf)
        self.readings = field_factors.CompassReadings(2 * np.arange(count), np.swapaxes(R, 1, 2) @ EARTH, R, sigma)
        self.factors = FieldFactors(self.readings, self.path, first, rough, p)

    def values(self) -> gtsam.Values:
        states = zip(self.nav_R_body, self.position, strict=True)
        values = values_of({X(2 * k): pose(R, at) for k, (R, at) in enumerate(states)})
        self.factors.insert(values)
        return values

    def information(self) -> Floats:
        """Of all poses and then of all states, at the truth."""
        graph = gtsam.GaussianFactorGraph()
        for factor in chain.from_iterable(linear_factors(block, self.values()) for block in self.factors.blocks):
            graph.push_back(factor)
        poses, states = [X(2 * k) for k in range(self.count)], [M(k) for k in range(self.count)]
        for key in poses:  # a pose that no factor knows is there all the same
            graph.push_back(gtsam.JacobianFactor(key, np.zeros((1, 6)), np.zeros(1), UNIT))
        return graph.hessian(ordering_of([*poses, *states]))[0]

    def covariance_of_yaws(self) -> Floats:
        """(F, F) of the headings, once the states of the field are eliminated."""
        information, n = self.information(), 6 * self.count
        to_states, of_states = information[:n, n:], information[n:, n:]
        of_poses = information[:n, :n] - to_states @ np.linalg.solve(of_states, to_states.T)
        turn = block_diag(*(np.append(R[2], np.zeros(3))[:, None] for R in self.nav_R_body))  # about up, of each pose
        return np.linalg.inv(turn.T @ of_poses @ turn)


def tail(x: float) -> float:
    return 0.5 * TAIL_SIGMAS**2 * float(np.log1p((x / TAIL_SIGMAS) ** 2))


@pytest.mark.parametrize("sigmas", [1e-2, 1.0, 9.0])
def test_residuals_are_in_units_of_their_sigmas_and_those_of_the_compass_have_a_tail(sigmas: float) -> None:
    """Each alone: potential, deviation across the field, and that of the region, which no stride begins in."""
    walked = Walked(count=2)
    true, d = walked.values(), walked.path.distance_m
    right = np.zeros(SIZE)
    right[REGION] = RIGHT
    parts = (
        (np.eye(SIZE)[PHI], PATH_SIGMA_UT_M, ROUGH.potential, 0.5 * sigmas**2),
        (np.eye(SIZE)[DELTA], field_factors.COMPASS_SIGMA_UT, ROUGH.across, tail(sigmas)),
        (right, field_factors.COMPASS_SIGMA_UT, ROUGH.regional, tail(sigmas)),
    )
    for one, sigma, rough, loss in parts:
        off, changed = sigmas * sigma, gtsam.Values(true)
        changed.update(M(1), true.atVector(M(1)) + off * one)
        new = rough.sigma * np.sqrt(1 - np.exp(-2 * d[0] / rough.length_m))
        assert error_of(walked.factors, changed) == pytest.approx(loss + 0.5 * (off / new) ** 2, rel=1e-2)


def test_states_are_processes_of_their_roughness() -> None:
    """Without a reading their covariance is that of stationary processes along the path; region: each axis its own."""
    walked = Walked(count=6, p=COMPASS, used=np.zeros(6, dtype=bool))
    states = np.linalg.inv(walked.information()[36:, 36:]).reshape(6, SIZE, 6, SIZE)
    way = np.append(0.0, np.cumsum(walked.path.distance_m))
    apart = np.abs(way[:, None] - way)
    of = {PHI: ROUGH.potential, DELTA: ROUGH.across, 2: ROUGH.regional, 3: ROUGH.regional}
    for part, rough in of.items():
        expected = rough.sigma**2 * np.exp(-apart / rough.length_m)
        np.testing.assert_allclose(states[:, part, :, part], expected, rtol=1e-6)
    np.testing.assert_allclose(states[:, 2, :, 3], 0.0, atol=1e-9)


KNOWN = FieldPrior(FIRST.mean, np.full(SIZE, NEVER))  # The Earth's field and no iron: nothing is asked.
NONE = field_factors.Roughness(NEVER, 1.0)


@pytest.fixture
def steady(monkeypatch: pytest.MonkeyPatch) -> None:
    """Field and iron do not wander, and of an endless deviation nothing is new."""
    for name, value in (("MEAN_WALK_UT", NEVER), ("HARD_IRON_WALK_UT", NEVER), ("MIN_INNOVATION", 0.0)):
        monkeypatch.setattr(field_factors, name, value)


@pytest.mark.usefixtures("steady")
@pytest.mark.parametrize(("count", "region_uT"), [(4, NEVER), (4, 2.0), (12, 2.0)])
def test_headings_are_known_to_the_noise_of_a_compass_and_all_of_them_to_the_region(count, region_uT) -> None:
    """However many footfalls; differences as if the region were not there."""
    first = replace(KNOWN, sigma=np.where(np.isin(np.arange(SIZE), [2, 3]), region_uT, NEVER))
    rough = FieldRoughness(NONE, NONE, field_factors.Roughness(region_uT, 1e12), 0.0)
    found = Walked(count=count, rough=rough, first=first, p=COMPASS).covariance_of_yaws()
    expected = region_uT**2 + field_factors.COMPASS_SIGMA_UT**2 * np.eye(count)
    np.testing.assert_allclose(found * STRENGTH**2, expected, rtol=1e-3, atol=1e-3 * field_factors.COMPASS_SIGMA_UT**2)


def test_a_compass_counts_by_its_variance_and_for_no_more_than_one_of_the_walk() -> None:
    sigma = field_factors.compass_sigma(np.array([0.0, 1.0, 4.0, np.inf]), ROUGH)
    np.testing.assert_allclose(
        sigma, np.hypot(field_factors.COMPASS_SIGMA_UT, ROUGH.white_uT * np.array([0.0, 1.0, 2.0, np.inf]))
    )
    np.testing.assert_allclose(field_factors.weigh_compass(sigma, ROUGH), [1.0, 1.0, (sigma[1] / sigma[2]) ** 2, 0.0])


# --- jumps of the potential: a corridor with circuits of current across it


OUTSIDE = Homogeneous(np.array([0.0, 20.0, -43.0]))
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
    building = draw_environment("indoor" if rough else "smooth", OUTSIDE, points, np.random.default_rng(seed))
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
        with_it = error_at_minimum(replace(found.problem, values=found.solved.values))
        fall = 2.0 * (with_it - error_at_minimum(without))
        assert fall == pytest.approx(statistic[row], rel=0.05, abs=0.02)


def statistic_of(found: FieldSolution) -> Floats:
    return compute_jump_statistic(found.problem.get(FieldFactors).potential, found.solved)


def error_at_minimum(problem: WalkProblem) -> float:
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
    recording = in_field(draw_environment("indoor", OUTSIDE, points, np.random.default_rng(seed)).at, seed)
    parameters, field = replace_field(gate="aiez", potential=False), average_footfall_field(recording, stances)
    found = smooth(recording, stances, parameters, None, field=field)
    error_deg = heading_error_deg(found, seed)[0]
    assert abs(error_deg) < 2.0 * np.degrees(found.stances.heading_sigma[0])
