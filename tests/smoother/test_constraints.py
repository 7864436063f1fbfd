"""Floors and courses: their linear models, what floors do to a walk, and the order of elimination."""

from itertools import pairwise

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import A, V, X, Z
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats, Ints
from fg_nav.factors.residual import factor_of
from fg_nav.factors.walk_constraints import FloorHeight
from fg_nav.frames import yaw_rotation
from fg_nav.smoother import smooth
from fg_nav.smoother.building import (
    DirectionFactors,
    Mixture,
    list_displacements,
    make_direction_factors,
)
from fg_nav.smoother.heights import LEVEL_SIGMA_M, constrain_heights
from fg_nav.smoother.solver import LinearizableBlock, Solved, WalkSystem, find_minimum
from tests.linear import linear_factors, marginal_covariances
from tests.smoother.walks import DEFAULT, FREE, demo, list_keys, problem, time_order

STRIDE_M = 1.3
FIRM = np.array([1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3])
STOREY, RISER = 3.4, 0.34


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


def dead_reckoned(poses: list[gtsam.Pose3], sigma: Floats) -> gtsam.NonlinearFactorGraph:
    """What a foot measures of its strides, from a start that is known."""
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(gtsam.PriorFactorPose3(X(0), poses[0], gtsam.noiseModel.Diagonal.Sigmas(FIRM)))
    noise = gtsam.noiseModel.Diagonal.Sigmas(sigma)
    for k in range(1, len(poses)):
        graph.push_back(gtsam.BetweenFactorPose3(X(k - 1), X(k), poses[k - 1].between(poses[k]), noise))
    return graph


def order(count: int, floors: int = 0) -> gtsam.Ordering:
    ordering = gtsam.Ordering()
    for key in [*(X(k) for k in range(count)), *(Z(k) for k in range(floors))]:
        ordering.push_back(key)
    return ordering


def on_floors(poses: list[gtsam.Pose3], floor: Ints, sigma: Floats) -> Solved:
    """A dead-reckoned walk with its floors."""
    values, count = values_of(poses), int(floor.max()) + 1
    for k in range(count):
        values.insert(Z(k), np.zeros(1))
    block = constrain_heights(np.arange(len(poses)), floor, LEVEL_SIGMA_M)
    system = WalkSystem(dead_reckoned(poses, sigma), [block])
    return find_minimum(system, values, list_keys(order(len(poses), count)), 1e-6, 50)


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


def positions(values: gtsam.Values, count: int) -> Floats:
    return np.array([values.atPose3(X(k)).translation() for k in range(count)])


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
        part: LinearizableBlock = tie_courses(positions(values, 60), np.arange(60)).courses
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


SIGMA = np.array([1e-4, 1e-4, np.radians(0.05), 0.01, 0.01, 0.005])  # Of a stride: rotation rad, translation m.


def storeys(level: int = 60, visits: tuple[int, ...] = (0, 1, 0, 2, 1, 0)) -> tuple[Floats, Ints]:
    """True heights of footfalls on floors with stairs between them; and the floors, -1 on stairs, as they are met."""
    height, floor = [np.zeros(level)], [np.full(level, visits[0])]
    for a, b in pairwise(visits):
        climb = STOREY * (a + np.sign(b - a) * np.arange(1, 10 * abs(b - a)) / 10)
        height += [climb, np.full(level, STOREY * b)]
        floor += [np.full(len(climb), -1), np.full(level, b)]
    return np.concatenate(height), np.concatenate(floor)


def test_heights_are_the_factors() -> None:
    values, rng = anywhere(30), np.random.default_rng(3)
    label = rng.integers(-1, 3, 30)
    block = constrain_heights(np.arange(30), label, 0.02)
    for floor in range(3):
        values.insert(Z(floor), rng.normal(0.0, 0.1, 1))
    graph = gtsam.NonlinearFactorGraph()
    for k in np.flatnonzero(label >= 0):
        graph.push_back(factor_of(FloorHeight(0.02), [X(int(k)), Z(int(label[k]))]))
    step = steps_of(values, 4, 0.01)
    assert len(block) == (label >= 0).sum()
    assert block.error(values) == pytest.approx(graph.error(values), rel=1e-9)
    assert linear(block, values).error(step) == pytest.approx(graph.linearize(values).error(step), rel=1e-9)


CLIMBING = np.array([1e-4, 1e-4, 1e-4, 0.01, 0.01, 0.015])


def test_a_floor_that_is_visited_again_gets_its_height_back() -> None:
    height, floor = storeys()
    seen = np.diff(height) + 0.01 * np.random.default_rng(1).standard_normal(len(height) - 1)
    solved = on_floors(walked(np.zeros(len(seen)), seen), floor, CLIMBING)
    found = positions(solved.values, len(height))[:, 2]
    for k in range(3):
        assert np.ptp(found[floor == k]) < 0.05
    floors = np.array([found[floor == k].mean() for k in range(3)])
    np.testing.assert_allclose(floors - floors[0], STOREY * np.arange(3), atol=0.1)


def test_a_walk_on_no_floor_is_left_alone() -> None:
    block = constrain_heights(np.arange(21), np.full(21, -1), LEVEL_SIGMA_M)
    assert block.stack(gtsam.Values()) == []


def test_marginals_are_those_of_the_information_matrix() -> None:
    """With courses across five strides, floors and a direction at the end of the order, down the tree as on a chain."""
    height, floor = storeys(level=12, visits=(0, 1, 0))
    rng = np.random.default_rng(5)
    poses = walked(rng.normal(0, 0.01, len(height) - 1), np.diff(height))
    values = values_of(poses)
    node = np.arange(len(poses))
    directions = tie_courses(positions(values, len(poses)), node)
    blocks = *directions.blocks, constrain_heights(node, floor, LEVEL_SIGMA_M)
    for k in range(2):
        values.insert(Z(k), np.zeros(1))
    values.insert(A(0), np.array([0.1]))
    ordering = order(len(poses), 2)
    ordering.push_back(A(0))
    graph = dead_reckoned(poses, SIGMA).linearize(values)
    for block in blocks:
        for factor in linear_factors(block, values):
            graph.push_back(factor)
    full = np.linalg.inv(graph.hessian(ordering)[0])
    keys = [*(X(k) for k in range(len(poses))), Z(0), Z(1), A(0)]
    found = marginal_covariances(graph.eliminateMultifrontal(ordering, gtsam.EliminateQR), set(keys))
    first = 0
    for key in keys:
        last = first + len(found[key])
        np.testing.assert_allclose(found[key], full[first:last, first:last], rtol=1e-5, atol=1e-12)
        first = last
    assert first == len(full)


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
