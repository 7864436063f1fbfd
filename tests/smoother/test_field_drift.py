"""A heading that drifted over hours is bent back by the field before the walk is solved with it."""

from functools import cache

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X
from scipy.signal import lfilter

from fg_nav.arrays import Floats
from fg_nav.frames import yaw_rotation
from fg_nav.smoother.field import MAX_WINDOW, measure_drift, remove_drift
from fg_nav.smoother.graph import WalkProblem, turn_walk
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solver import list_poses
from tests.smoother.walks import DEFAULT, demo, part

RNG = np.random.default_rng(3)


@cache
def short_problem() -> WalkProblem:
    walk = part(demo(), 24)
    return walk_problem(walk.recording, walk.stances, 0.0, DEFAULT)


STRIDE_S = 1.1


def field_of(drift: Floats, noise_uT: float = 8.0, alike_uT: float = 0.0, rng: np.random.Generator = RNG) -> Floats:
    """The field at footfalls of a building with iron, as a heading that drifted by so much has it; some without."""
    keep = np.exp(-1.3 / 3.0)
    new = alike_uT * np.sqrt(1.0 - keep**2) * rng.standard_normal((len(drift), 3))
    field = np.array([0.0, 21.0, -43.0]) + noise_uT * rng.standard_normal((len(drift), 3))
    field += lfilter([1.0], [1.0, -keep], new, axis=0)
    field[rng.random(len(drift)) < 0.1] = np.nan
    return np.einsum("kij,kj->ki", yaw_rotation(drift), field)


def times(count: int) -> Floats:
    return STRIDE_S * np.arange(count) + 5.0


@pytest.mark.parametrize("most", [0.0, 1.0, -4.0])
def test_the_drift_of_hours_is_measured(most: float) -> None:
    drift = most * np.sin(np.linspace(0.0, 1.5, 8 * MAX_WINDOW))
    found = measure_drift(field_of(drift), times(len(drift)))
    # The first window has the drift of its middle.
    half = MAX_WINDOW // 2
    np.testing.assert_allclose((found - found[half])[half:-half], (drift - drift[half])[half:-half], atol=0.08)


@pytest.mark.parametrize("rate_deg_s", [1.0, -1.0, 0.3])
def test_a_constant_bias_is_measured_over_a_rough_floor(rate_deg_s: float) -> None:
    """At 1 deg/s 240 footfalls are more than half a turn, of which none is lost."""
    drift = np.radians(rate_deg_s) * (times(240) - 5.0)
    fields = [field_of(drift, 5.0, 4.0, np.random.default_rng(seed)) for seed in range(20)]
    off = np.array([measure_drift(field, times(240)) - drift for field in fields])
    assert np.sqrt(np.mean(off**2)) < 0.3
    assert np.abs(off).max() < 1.0


def test_a_walk_that_was_bent_is_bent_back_and_one_that_was_not_is_left_as_it_is(monkeypatch) -> None:
    for bound in ("MIN_WINDOW", "MAX_WINDOW"):
        monkeypatch.setattr(f"fg_nav.smoother.field.{bound}", 4)
    problem = short_problem()
    nodes, count = problem.nodes, len(problem.nodes)
    footfalls = len(nodes.result)
    drift = np.interp(np.arange(footfalls), [2, footfalls - 2], [0.0, 1.2])
    field = field_of(drift, 0.0)
    field[np.isnan(field)] = 0.0
    bent = gtsam.Values(problem.values)
    turn_walk(bent, nodes, np.interp(np.arange(count), nodes.result, drift))
    t = times(footfalls)
    straight, moved, found = (
        list_poses(range(count), values) for values in (problem.values, bent, remove_drift(bent, nodes, field, t))
    )
    off, left = (np.linalg.norm(one[:, :3, 3] - straight[:, :3, 3], axis=1).max() for one in (moved, found))
    assert left < 0.1 * off
    same = field_of(np.full(footfalls, 0.5), 0.0)
    assert remove_drift(bent, nodes, same, t) is bent


def test_a_walk_is_turned_as_a_whole_by_one_angle_and_move_by_move_by_many() -> None:
    problem = short_problem()
    count = len(problem.nodes)
    before = list_poses(range(count), problem.values)
    turned = gtsam.Values(problem.values)
    turn_walk(turned, problem.nodes, 0.7)
    for j in (0, count // 2, count - 1):
        pose = gtsam.Pose3(gtsam.Rot3(yaw_rotation(0.7)), np.zeros(3)).compose(problem.values.atPose3(X(j)))
        assert turned.atPose3(X(j)).equals(pose, 1e-9)
        np.testing.assert_allclose(turned.atVector(V(j)), yaw_rotation(0.7) @ problem.values.atVector(V(j)), atol=1e-12)
    angle = np.linspace(0.0, 2.0, count)
    turn_walk(turned, problem.nodes, angle - 0.7)
    after = list_poses(range(count), turned)
    moves = np.einsum("kij,kj->ki", yaw_rotation(angle[1:]), np.diff(before[:, :3, 3], axis=0))
    np.testing.assert_allclose(np.diff(after[:, :3, 3], axis=0), moves, atol=1e-9)
    np.testing.assert_allclose(after[:, :3, :3], yaw_rotation(angle) @ before[:, :3, :3], atol=1e-9)
