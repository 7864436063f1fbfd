"""Directions of a building: which displacements count, how they are tracked, and what they do to a walk."""

from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import A

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.factors.walk_constraints import measure_course, wrap_quarter
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.lab.simulation.path import Path, arc, polyline
from fg_nav.lab.simulation.plan import Walk
from fg_nav.recording import Recording
from fg_nav.smoother import smooth, smooth_graph
from fg_nav.smoother.building import (
    MIN_EVIDENCE,
    NONE_FOUND,
    STRAIGHT_WITHIN_M,
    STRIDES,
    DirectionFactors,
    list_displacements,
    split_drift,
    track_directions,
)
from fg_nav.smoother.graph import order_variables
from fg_nav.smoother.parameters import WalkParameters
from tests.simulated import FIRM, INDUSTRIAL, QUIET, simulated
from tests.smoother.walks import DEFAULT

STRIDE_M = 1.4
WITH = replace(DEFAULT, walk=WalkParameters(directions=True))


def path_of(turn: Floats, weave_m: float = 0.0, seed: int = 0) -> Floats:
    """Footfalls (F, 3) of a foot that turns by `turn` (F-1,) rad before its strides."""
    course = np.cumsum(turn)
    steps = STRIDE_M * np.stack([np.cos(course), np.sin(course), 0 * course], axis=1)
    place = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    place[:, :2] += weave_m * np.random.default_rng(seed).standard_normal((len(place), 2))
    return place


def rounds(legs: int, strides: int, drift_deg: float = 0.0) -> Floats:
    """Turns of a foot on legs at right angles, which drifts at each stride."""
    turn = np.full(legs * strides, np.radians(drift_deg))
    turn[strides::strides] += np.pi / 2
    return turn


def track(position: Floats, drift_deg: float = 5.0):
    pairs = list_displacements(position)
    course = measure_course(position[pairs[:, 1]] - position[pairs[:, 0]])
    at = pairs.mean(axis=1) / len(position)
    return course, track_directions(course, np.ones(len(course)), at, float(np.radians(drift_deg)))


def test_displacements_share_no_stride_and_lie_within_straight_stretches() -> None:
    position = path_of(rounds(4, 13), 0.02)
    pairs = list_displacements(position)
    assert (np.diff(pairs, axis=1) == STRIDES).all()
    assert (pairs[1:, 0] >= pairs[:-1, 1]).all()
    assert len(pairs) == 8
    for first, last in pairs:
        along = position[last, :2] - position[first, :2]
        apart = position[first : last + 1, :2] - position[first, :2]
        off = np.abs(apart[:, 0] * along[1] - apart[:, 1] * along[0]) / np.linalg.norm(along)
        assert off.max() <= STRAIGHT_WITHIN_M


@pytest.mark.parametrize("alpha_deg", [0.0, 30.0, 44.9, 70.0])
def test_directions_are_found_wherever_they_lie(alpha_deg: float) -> None:
    position = path_of(rounds(8, 20), 0.05) @ yaw_rotation(np.radians(alpha_deg)).T
    _, found = track(position)
    assert np.degrees(np.abs(wrap_quarter(found.phi - np.radians(alpha_deg))).max()) < 1.5
    assert found.evidence > 2 * MIN_EVIDENCE
    assert found.mixture.share > 0.9
    assert np.degrees(found.mixture.sigma) == pytest.approx(1.5, abs=0.5)


def test_a_drift_beyond_half_a_quarter_turn_is_tracked() -> None:
    """By 0.4 deg a stride to 64 deg, where the nearest direction is the wrong one."""
    position = path_of(rounds(8, 20, 0.4), 0.05)
    _, found = track(position, 40.0)
    middle = list_displacements(position).mean(axis=1)
    drift = np.degrees(found.phi - found.phi[0])
    np.testing.assert_allclose(drift, 0.4 * (middle - middle[0]), atol=3.0)
    assert drift[-1] > 55.0


@pytest.mark.parametrize("drift_deg", [3.0, 80.0])
@pytest.mark.parametrize("seed", range(20))
def test_courses_that_are_anything_show_none(seed: int, drift_deg: float) -> None:
    course = np.random.default_rng(seed).uniform(-np.pi, np.pi, 40)
    found = track_directions(course, np.ones(40), np.linspace(0.0, 1.0, 40), float(np.radians(drift_deg)))
    assert found.evidence < MIN_EVIDENCE


BIAS_DEG_S = 0.2  # About up where the foot stands: 13 deg over the walk.


@cache
def walked(kind: str) -> Recording:
    """A foot that walks round without a rest that would show the bias of its gyroscope."""
    rectangle = polyline([[0, 0], [28, 0], [28, 19], [0, 19], [0, 0]], 1.0)
    path: Path = {"rectangle": rectangle, "circle": arc(9.0, 4 * np.pi)}[kind]
    recording = simulated([Walk(path)], QUIET, FIRM, INDUSTRIAL.at_rate(100.0), 0).recording
    return replace(recording, gyr=recording.gyr + np.radians([0.0, 0.0, BIAS_DEG_S]))


def error_of(recording: Recording, position: Floats) -> float:
    """Largest error over ground, m, the headings at the start the same."""
    truth = recording.truth
    return float(np.linalg.norm((position - (truth.position - truth.position[0]))[:, :2], axis=1).max())


def test_a_rectangle_with_a_drifting_heading_is_made_right() -> None:
    recording = walked("rectangle")
    stances, heading = detect_stances(recording), float(compute_heading(recording.truth.nav_R_body[0]))
    free, held = (smooth(recording, stances, p, heading) for p in (DEFAULT, WITH))
    assert error_of(recording, free.position) > 2.0
    assert error_of(recording, held.position) < 0.4 * error_of(recording, free.position)
    assert held.stances.heading_sigma[-1] < free.stances.heading_sigma[-1]
    assert held.graph["direction"] > 6
    assert "direction" not in free.graph
    assert any("follow the directions of a building" in note for note in held.notes)


def test_a_circle_is_the_same_walk_with_directions() -> None:
    recording = walked("circle")
    stances = detect_stances(recording)
    free, held = (smooth(recording, stances, p) for p in (DEFAULT, WITH))
    np.testing.assert_array_equal(held.position, free.position)
    np.testing.assert_array_equal(held.stances.heading_sigma, free.stances.heading_sigma)
    assert NONE_FOUND in held.notes
    assert NONE_FOUND not in free.notes


def test_the_direction_is_a_variable_that_is_eliminated_last() -> None:
    recording = walked("rectangle")
    walk = smooth_graph(recording, detect_stances(recording), WITH)
    problem = walk.walk.problem
    share = problem.get(DirectionFactors).courses.residuals.share
    # Four legs of four and two displacements, which count as three courses at most.
    np.testing.assert_allclose(share, np.tile(np.repeat([0.75, 1.0], [4, 2]), 2))
    keys = order_variables(problem)
    assert int(keys[-1]) == A(0)
    assert (keys != A(0)).sum() == len(keys) - 1
    # a leg's course is 1.5 deg at least, and alpha that of a few
    assert 0.2 < np.degrees(np.sqrt(walk.find_covariance(A(0))[0, 0])) < 5.0
    assert isinstance(walk.graph, gtsam.NonlinearFactorGraph)
    assert walk.graph.error(walk.values) == pytest.approx(walk.walk.solved.error, rel=1e-6)


def test_a_walk_is_split_where_its_heading_is_lost() -> None:
    sigma = np.radians([0.0, 1, 2, 3, 3, 50, 60, 60.1])
    drift = split_drift(sigma**2)
    np.testing.assert_array_equal(drift.piece, [0, 0, 0, 0, 0, 1, 2, 2])
    assert drift.sigma < np.radians(5.0)
    assert split_drift(np.radians(np.linspace(0.0, 80.0, 240)) ** 2).piece[-1] == 0


def test_nothing_is_carried_over_a_lost_turn() -> None:
    """By half a right angle: both halves find their own directions."""
    position = path_of(rounds(8, 20), 0.05)
    turned = np.vstack([position[:81], position[81:] @ yaw_rotation(np.pi / 4).T])
    pairs = list_displacements(position)
    course = measure_course(turned[pairs[:, 1]] - turned[pairs[:, 0]])
    at, is_lost = pairs.mean(axis=1) / len(position), np.diff(pairs[:, 0] > 80) > 0
    found = track_directions(course, np.ones(len(course)), at, np.radians(3.0), is_lost)
    off = np.where(pairs[:, 0] > 80, np.pi / 4, 0.0)
    assert np.degrees(np.abs(wrap_quarter(found.phi - off)).max()) < 2.0
    assert found.mixture.share > 0.9
