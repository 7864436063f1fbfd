"""What the field of the stances shows of the gyro bias of a whole walk: a minute round a corridor without a rest."""

import math
from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.factors.differential_field import BiasInformation
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother import differential, smooth
from fg_nav.smoother.differential import (
    DifferentialFactors,
    LevelBias,
    add_differential_field,
    find_stretches,
    fit_variogram,
    measure_noise,
    turn_stretches,
)
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.strides import place_nodes
from fg_nav.solution import Solution
from tests.smoother.walks import DEFAULT, NOT_RESTED, demo, in_field, replace_field, smoothed, track_of

EARTH = np.array([1.0, 20.0, -43.0])
UNRESTED = replace_field(NOT_RESTED, compass=False, potential=False)
"""The differential field alone: no rest shows the bias, and no heading."""
UP_BIAS_DEG_S = 0.4


def waves(position: Floats) -> Floats:
    """A field (N, 3) uT without divergence that changes by some 3 uT over a metre: shear waves in many directions."""
    rng = np.random.default_rng(7)
    total = np.zeros_like(position)
    for _ in range(12):
        k = rng.normal(size=3)
        k *= 2.0 * np.pi / (2.5 * np.linalg.norm(k))
        across = np.cross(k, rng.normal(size=3))
        phase = position @ k + rng.uniform(0.0, 2.0 * np.pi)
        total += 1.2 * across / np.linalg.norm(across) * np.sin(phase)[:, None]
    return total


@cache
def recorded(rough: bool) -> Recording:
    """The demonstration with a magnetometer of 0.2 uT, and a gyroscope with a bias about up."""
    recording = in_field(lambda x: EARTH + waves(x) * rough, bias_deg_s=UP_BIAS_DEG_S)
    return replace(recording, mag=recording.mag + np.random.default_rng(0).normal(0.0, 0.2, recording.mag.shape))


def solved_walk(recording: Recording, p: SmootherParameters) -> tuple[WalkProblem, gtsam.Values]:
    problem = walk_problem(recording, demo().stances, 0.0, p)
    return problem, solve(problem).values


@cache
def with_factors(rough: bool) -> tuple[WalkProblem, gtsam.Values]:
    problem, values = solved_walk(recorded(rough), UNRESTED)
    return add_differential_field(problem, values, track_of(problem, values)), values


def factors_of(problem: WalkProblem) -> DifferentialFactors:
    return problem.get(DifferentialFactors)


def up_bias_deg_s(found: Solution) -> Floats:
    """Component about up of the gyro bias at the footfalls, deg/s."""
    up = demo().recording.truth.nav_R_body[found.stances.sample, 2]
    return np.degrees((found.stances.gyro_bias * up).sum(axis=1))


@pytest.mark.parametrize("rough", [False, True], ids=["homogeneous", "rough"])
def test_without_a_rest_the_bias_is_found_better(rough: bool) -> None:
    recording, stances = recorded(rough), demo().stances
    field = average_footfall_field(recording, stances)
    with_it = up_bias_deg_s(smooth(recording, stances, UNRESTED, field=field))
    without = up_bias_deg_s(smooth(recording, stances, UNRESTED))
    own = up_bias_deg_s(smoothed())  # of the sensor, from its rests
    true = own.mean() + UP_BIAS_DEG_S
    # Against a prior of 0.15 deg/s, and an error of 0.2 that the stances of a walk have in common.
    assert abs(with_it[-1] - true) < 0.85 * abs(without[-1] - true)


def test_the_noise_of_the_magnetometer_is_found() -> None:
    recording = recorded(True)
    stretches = find_stretches(recording, place_nodes(recording, demo().stances, DEFAULT), ())
    bias = np.zeros((len(stretches.start), 3))
    turned = turn_stretches(recording, stretches, recording.truth.position, bias)
    assert measure_noise(turned) == pytest.approx(0.2, rel=0.1)


def test_the_variogram_of_the_swings_is_that_of_the_field() -> None:
    recording = recorded(True)
    truth = recording.truth
    nodes = place_nodes(recording, demo().stances, DEFAULT)
    found = fit_variogram(recording.mag, truth.position, truth.nav_R_body, nodes, 0.2)
    assert found is not None
    rng = np.random.default_rng(3)
    place, direction = truth.position[rng.integers(0, len(truth.position), 4000)], rng.normal(size=(4000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    for r in (0.1, 0.3):
        true = np.mean((waves(place + r * direction) - waves(place)) ** 2) / 2.0
        gamma = found.sigma_uT**2 - float(found.covariance(np.array(r**2)))
        assert 0.4 < gamma / true < 2.5


def test_a_field_that_is_not_of_the_model_is_left_out() -> None:
    recording = recorded(False)
    stretches = find_stretches(recording, place_nodes(recording, demo().stances, DEFAULT), ())
    third = int(stretches.start[3] + stretches.stop[3]) // 2
    jump = recording.mag.copy()
    jump[third:] += 30.0  # something that moves in the middle of a stance
    problem, values = solved_walk(replace(recording, mag=jump), UNRESTED)
    before = factors_of(with_factors(False)[0])
    after = factors_of(add_differential_field(problem, values, track_of(problem, values)))
    counts = [one.stances.count.sum() + one.standings.count.sum() for one in (after, before)]
    assert counts[0] < counts[1]


def test_what_contradicts_gravity_is_weakened_about_all_axes_and_nothing_else() -> None:
    """Sigma of 0.1 deg/s each: what is off about up may be right, what is as much off about a level axis is not."""
    up, sigma = np.array([0.0, 0.6, 0.8]), math.radians(0.1)
    off = np.array([np.zeros(3), 10 * sigma * up, 10 * sigma * np.array([1.0, 0.0, 0.0])])
    shown = BiasInformation(np.tile(np.eye(3) / sigma**2, (3, 1, 1)), off / sigma**2)
    weaker = LevelBias(np.zeros((3, 3)), up).weaken(shown)
    of_gravity = math.radians(differential.LEVEL_SIGMA_DEG_S)
    ratio = 0.5 * (10 * sigma) ** 2 / (sigma**2 + of_gravity**2)
    weight = np.array([1.0, 1.0, differential.MAX_LEVEL_RATIO / ratio])
    np.testing.assert_allclose(weaker.matrix, shown.matrix * weight[:, None, None], rtol=1e-5)
    np.testing.assert_allclose(weaker.vector, shown.vector * weight[:, None], rtol=1e-5, atol=1e-9)
