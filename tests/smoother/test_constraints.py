"""Floors and courses: their linear models, what floors do to a walk, and the order of elimination."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import A, V, X, Z
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats, Ints
from fg_nav.frames import yaw_rotation
from fg_nav.smoother import smooth
from fg_nav.smoother.building import (
    DirectionFactors,
    Mixture,
    list_displacements,
    make_direction_factors,
)
from fg_nav.smoother.heights import LEVEL_SIGMA_M, constrain_heights
from fg_nav.smoother.solver import LinearizableBlock
from tests.linear import linear_factors
from tests.smoother.walks import DEFAULT, FREE, demo, problem, time_order

STRIDE_M = 1.3


def poses_of(position: Floats, course: Floats) -> list[gtsam.Pose3]:
    return [gtsam.Pose3(gtsam.Rot3(yaw_rotation(a)), p) for a, p in zip(course, position, strict=True)]


def values_of(poses: list[gtsam.Pose3]) -> gtsam.Values:
    values = gtsam.Values()
    for k, pose in enumerate(poses):
        values.insert(X(k), pose)
    return values


def walked(turn: Floats, climb: Floats) -> list[gtsam.Pose3]:
    """Poses of a foot that turns by `turn` (F-1,) rad and climbs `climb` (F-1,) m in its strides."""
    course = np.cumsum(np.concatenate([[0.0], turn]))
    move = STRIDE_M * np.stack([np.cos(course[1:]), np.sin(course[1:]), climb / STRIDE_M], axis=1)
    return poses_of(np.concatenate([np.zeros((1, 3)), np.cumsum(move, axis=0)]), course)


def anywhere(count: int, seed: int = 0) -> gtsam.Values:
    """Values of a walk onwards with noise in all that is known of it."""
    rng = np.random.default_rng(seed)
    position = np.cumsum(rng.normal([1.2, 0.0, 0.02], [0.1, 0.3, 0.1], (count, 3)), axis=0)
    attitude = Rotation.from_rotvec(0.5 * rng.standard_normal((count, 3))).as_matrix()
    return values_of([gtsam.Pose3(gtsam.Rot3(R), p) for R, p in zip(attitude, position, strict=True)])


def steps_of(values: gtsam.Values, seed: int, size: float) -> gtsam.VectorValues:
    rng, step = np.random.default_rng(seed), gtsam.VectorValues()
    for key, width in values.dims().items():
        step.insert(key, size * rng.standard_normal(width))
    return step


def linear(block: LinearizableBlock, values: gtsam.Values) -> gtsam.GaussianFactorGraph:
    graph = gtsam.GaussianFactorGraph()
    for factor in linear_factors(block, values):
        graph.push_back(factor)
    return graph


MIXTURE = Mixture(np.radians(2.0), 0.7)


def tie_courses(position: Floats, node: Ints) -> DirectionFactors:
    """The courses of a walk along directions from 0.1 rad on."""
    pairs = list_displacements(position)
    return make_direction_factors(
        node[pairs], np.zeros(len(pairs), dtype=np.intp), np.full(len(pairs), 0.5), np.array([0.1]), MIXTURE
    )


@pytest.mark.parametrize("kind", ["directions", "floors"])
def test_linear_model_has_the_error_at_hand_and_its_slope(kind: str) -> None:
    if kind == "directions":
        poses = walked(np.random.default_rng(3).normal(0.0, 0.02, 59), np.zeros(59))
        values = values_of(poses)
        values.insert(A(0), np.array([0.1]))
        part: LinearizableBlock = tie_courses(np.array([pose.translation() for pose in poses]), np.arange(60)).courses
    else:
        values = anywhere(60)
        values.insert(Z(0), np.array([0.3]))
        part = constrain_heights(np.arange(60), np.zeros(60, dtype=np.intp), LEVEL_SIGMA_M)
    assert len(list(part.factors())) > 5
    model = linear(part, values)
    assert model.error(steps_of(values, 2, 0.0)) == pytest.approx(part.error(values), rel=1e-9)
    for seed in range(5):
        there, back = (steps_of(values, seed, size) for size in (1e-6, -1e-6))
        slope = part.error(values.retract(there)) - part.error(values.retract(back))
        assert slope == pytest.approx(model.error(there) - model.error(back), rel=1e-3, abs=1e-9)


def test_a_floor_is_eliminated_when_it_is_left_for_good() -> None:
    one = problem(demo())
    floor = np.full(len(one.nodes.result), -1)
    floor[[2, 3, 9]], floor[[5, 6]] = 0, 1
    ordering = time_order(one.nodes, floor=floor)
    keys = [ordering.at(i) for i in range(ordering.size())]
    for number, last in ((0, 9), (1, 6)):
        at = int(one.nodes.result[last])
        assert keys.index(V(at)) + 1 == keys.index(Z(number)) < keys.index(X(at + 1))
    plain = time_order(one.nodes)
    directed = time_order(one.nodes, floor=floor, directions=1)
    assert [directed.at(i) for i in range(directed.size())] == [*keys, A(0)]
    assert [key for key in keys if key not in (Z(0), Z(1))] == [plain.at(i) for i in range(plain.size())]


def test_floors_can_be_switched_off() -> None:
    assert DEFAULT.walk.floors
    walk = demo()
    free = smooth(walk.recording, walk.stances, FREE)
    flat = smooth(walk.recording, walk.stances, DEFAULT)
    assert not any("level floor" in note for note in free.notes)
    assert any("1 level floor" in note for note in flat.notes)
    assert np.ptp(flat.stances.position[:, 2]) < min(0.02, 0.1 * np.ptp(free.stances.position[:, 2]))
    assert np.linalg.norm((flat.position - free.position)[:, :2], axis=1).max() < 0.1
    assert flat.stances.position_cov[-1, 2, 2] < 0.2 * free.stances.position_cov[-1, 2, 2]
