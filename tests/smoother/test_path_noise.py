"""How much of the line integral telescopes, by the evidence of walks over floors that are known."""

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
from fg_nav.lab.simulation.fields import draw_environment
from fg_nav.magnetic import average_footfall_field
from fg_nav.smoother import smooth
from fg_nav.smoother.field import (
    SHARES,
    SHARES_PRIOR,
    PathNoise,
    average_path_noise,
    set_field,
)
from fg_nav.smoother.field_factors import MIN_TELESCOPING, PATH_SIGMA_UT_M, FieldFactors, FieldRoughness
from fg_nav.smoother.graph import WalkProblem
from tests.smoother.test_field import heading_error_deg, in_field, replace_field, truth_of
from tests.smoother.test_field_factors import KNOWN, NEVER, NONE, ROUGH, Walked, steady  # noqa: F401
from tests.smoother.test_potential import EARTH, solved_in
from tests.smoother.walks import demo


def with_integrals(field: FieldFactors, added: Floats) -> FieldFactors:
    """Factors of the field with so much added to the line integrals, all of whose changes telescope."""
    path = replace(field.path, u=field.path.u + added)
    return FieldFactors(field.readings, path, field.prior, field.rough, field.parameters, 0.0)


@cache
def noise_of(seed: int, drift_uT_m: float) -> PathNoise:
    """Of the demonstration over a rough floor, its integrals with so much white noise a stride."""
    found, _ = solved_in(seed)
    problem = found.problem
    bold = problem.get(FieldFactors).assume_lost_share(0.0)
    noise = drift_uT_m * np.random.default_rng(seed).standard_normal(len(bold.path.u))
    noisy = with_integrals(bold, noise)
    return average_path_noise(set_field(problem, noisy), found.solved.values)


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


@pytest.mark.usefixtures("steady")
def test_the_mean_share_over_walks_is_that_of_the_walks() -> None:
    """As often as before the walk: on short walks all are near the mean, on long ones each near its own."""
    for count, apart in ((8, 0.0), (150, 0.8)):
        walked = in_known_building(count)
        found = [
            [find_share(walked, added) for added in potentials(share, walked).rvs(30, random_state=1)]
            for share in SHARES
        ]
        mean = np.average(np.mean(found, axis=1), weights=SHARES_PRIOR)
        assert mean == pytest.approx(np.average(SHARES, weights=SHARES_PRIOR), abs=0.1)
        assert np.mean(found[-2]) - np.mean(found[0]) > apart


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_integrals_that_do_not_telescope_are_not_taken_for_those_that_do(seed: int) -> None:
    """Of 3 uT m a stride in a field of 20 uT."""
    assert noise_of(seed, 3.0).drift_m > 3.0 / 20.0


@pytest.mark.parametrize("seed", [0, 1])
def test_headings_that_a_gate_chose_because_they_agree_claim_no_more_than_all_of_them(seed: int) -> None:
    """Those like the first footfalls pass `aiez`, wherever the field there points."""
    points, stances = truth_of(demo(seed).recording).position[::100] * [1.0, 1.0, 0.0], demo(seed).stances
    recording = in_field(draw_environment("indoor", EARTH, points, np.random.default_rng(seed)).at, seed)
    parameters, field = replace_field(gate="aiez", potential=False), average_footfall_field(recording, stances)
    found = smooth(recording, stances, parameters, None, field=field)
    error_deg = heading_error_deg(found, seed)[0]
    assert abs(error_deg) < 2.0 * np.degrees(found.stances.heading_sigma[0])
