"""The factors between two feet, against finite differences and invariances."""

import gtsam
import numpy as np
import pytest

from fg_nav.factors.same_place import BesideEachOther, WithinReach
from fg_nav.frames import yaw_rotation


def draw_pose(rng: np.random.Generator) -> np.ndarray:
    return gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(size=3)), rng.normal(size=3)).matrix()


def draw_beside(rng: np.random.Generator) -> BesideEachOther:
    return BesideEachOther(rng.normal(size=3), rng.normal(size=3), rng.normal(size=3), rng.normal(size=(3, 3)))


def move(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    return gtsam.Pose3(pose).retract(step).matrix()


def differentiate(residual, variables, i: int, size: int) -> np.ndarray:
    columns = []
    for k in range(size):
        step = np.zeros(size)
        step[k] = 1e-6
        ends = []
        for sign in (1.0, -1.0):
            moved = list(variables)
            moved[i] = move(moved[i], sign * step) if size == 6 else moved[i] + sign * step
            ends.append(residual.evaluate(moved, False)[0])
        columns.append((ends[0] - ends[1]) / 2e-6)
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("seed", range(3))
def test_jacobians_of_feet_beside_each_other_are_those_of_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    residual, variables = draw_beside(rng), [draw_pose(rng), draw_pose(rng), rng.normal(size=1)]
    H = residual.evaluate(variables, True)[1]
    for i, size in enumerate(residual.dims):
        np.testing.assert_allclose(H[i], differentiate(residual, variables, i, size), atol=1e-6)


@pytest.mark.parametrize("apart", [0.3, 1.5])
def test_jacobians_of_reach_are_those_of_differences_on_both_sides_of_it(apart: float) -> None:
    rng = np.random.default_rng(4)
    one, other = draw_pose(rng), draw_pose(rng)
    d = rng.normal(size=3)
    other[:3, 3] = one[:3, 3] + apart * d / np.linalg.norm(d)
    residual = WithinReach(np.array(1.2), np.array(0.1))
    e, H = residual.evaluate([one, other], True)
    assert e == pytest.approx(max(apart - 1.2, 0.0) / 0.1)
    for i in range(2):
        np.testing.assert_allclose(H[i], differentiate(residual, [one, other], i, 6), atol=1e-6)


def test_feet_that_walk_beside_each_other_leave_no_residual_wherever_they_walk() -> None:
    """A person is turned about up and moved: the width stays."""
    width, forward = 0.17, 0.4
    left, right = np.eye(4), np.eye(4)
    right[:3, 3] = [forward, -width, 0.0]  # walking east, the right foot is to the south
    at_foot, ahead = np.zeros(3), np.array([forward, 0.0, 0.0])
    for angle in (0.0, 1.0, -2.5):
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = yaw_rotation(angle), [5.0, -3.0, 1.0]
        residual = BesideEachOther(at_foot, ahead, np.array([0.0, 1.0, 0.0]), np.eye(3))
        e = residual.evaluate([frame @ right, frame @ left, np.array([width])], False)[0]
        np.testing.assert_allclose(e, 0.0, atol=1e-12)
        # Swapped feet are beside each other by the opposite width.
        swapped = BesideEachOther(ahead, at_foot, np.array([0.0, 1.0, 0.0]), np.eye(3))
        e = swapped.evaluate([frame @ left, frame @ right, np.array([-width])], False)[0]
        np.testing.assert_allclose(e, 0.0, atol=1e-12)
