"""Straight walks and floors: the factors of the ground floor, what they do to a walk, and where they keep quiet."""

from dataclasses import replace
from itertools import pairwise

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X, Z
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats, Ints
from fg_nav.factors import guarded_factor
from fg_nav.factors.residual import ResidualBlock, factor_of
from fg_nav.factors.walk_constraints import (
    FloorHeight,
    StraightWalk,
    change_of_course,
    straight_probability,
    straight_triples,
)
from fg_nav.frames import yaw_rotation
from fg_nav.smoother import constraints, smooth
from fg_nav.smoother.constraints import (
    STRAIGHT_WITHIN_M,
    constrain_courses,
    constrain_heights,
    find_courses,
    off_line,
)
from fg_nav.smoother.floors import LEVEL_SIGMA_M
from fg_nav.smoother.parameters import WalkParameters
from fg_nav.smoother.solver import LinearizableBlock, Solved, marginal_covariances, minimize, time_order
from tests.factors.straight import straight_walk_factor, straight_walk_noise
from tests.smoother.walks import DEFAULT, FREE, demo, list_keys, problem

STRIDE_M = 1.3
STRAIGHT = StraightWalk()
STRAIGHT_ONLY = WalkParameters(straight=True, floors=False)
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
    return minimize(dead_reckoned(poses, sigma), [block], values, list_keys(order(len(poses), count)), 1e-6, 50)


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
    for factor in block.linearize(values):
        graph.push_back(factor)
    return graph


def positions(values: gtsam.Values, count: int) -> Floats:
    return np.array([values.atPose3(X(k)).translation() for k in range(count)])


def straight_at(values: gtsam.Values, count: int) -> tuple[ResidualBlock, gtsam.NonlinearFactorGraph]:
    """The courses of a walk, and the same as robust factors of gtsam."""
    triples = straight_triples(positions(values, count))
    graph = gtsam.NonlinearFactorGraph()
    for triple in triples:
        graph.push_back(straight_walk_factor([X(int(k)) for k in triple], straight_walk_noise()))
    assert graph.size() > 5
    return constrain_courses(np.arange(count), triples), graph


def test_courses_are_the_factors_with_their_mixture() -> None:
    values = anywhere(60)
    courses, graph = straight_at(values, 60)
    step = steps_of(values, 1, 0.01)
    assert len(courses) == graph.size()
    assert courses.error(values) == pytest.approx(graph.error(values), rel=1e-9)
    # each linearization of gtsam's lacks the constant by which the loss is above the weighted square
    nothing = steps_of(values, 1, 0.0)
    found, expected = linear(courses, values), graph.linearize(values)
    change = found.error(step) - found.error(nothing)
    assert change == pytest.approx(expected.error(step) - expected.error(nothing), rel=1e-9)


@pytest.mark.parametrize("kind", ["straight", "floors"])
def test_linear_model_has_the_error_at_hand_and_its_slope(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    values = anywhere(60)
    monkeypatch.setattr(constraints, "STRAIGHT_WITHIN_M", np.inf)
    if kind == "straight":
        part = find_courses(np.arange(60), positions(values, 60))
    else:
        values.insert(Z(0), np.array([0.3]))
        part = constrain_heights(np.arange(60), np.zeros(60, dtype=np.intp), LEVEL_SIGMA_M)
    assert len(part) > 5
    model = linear(part, values)
    assert model.error(steps_of(values, 2, 0.0)) == pytest.approx(part.error(values), rel=1e-9)
    for seed in range(5):
        there, back = (steps_of(values, seed, size) for size in (1e-6, -1e-6))
        slope = part.error(values.retract(there)) - part.error(values.retract(back))
        assert slope == pytest.approx(model.error(there) - model.error(back), rel=1e-3, abs=1e-9)


def test_linear_model_is_never_below_the_loss() -> None:
    """Along moves of the middle footfall across the walk, for which the course is all but linear."""
    position = np.stack([STRIDE_M * np.arange(11), np.zeros(11), np.zeros(11)], axis=1)
    for bend_m in (0.0, 0.1, 0.3, 0.8):
        position[5, 1] = bend_m
        values = values_of(poses_of(position, np.zeros(11)))
        block = constrain_courses(np.arange(11), straight_triples(position))
        model = linear(block, values)
        for across_m in np.linspace(-1.0, 1.0, 21):
            step = gtsam.VectorValues()
            for k in (0, 5, 10):
                step.insert(X(k), np.array([0.0, 0.0, 0.0, 0.0, across_m if k == 5 else 0.0, 0.0]))
            assert model.error(step) >= 0.9 * block.error(values.retract(step)) - 0.05


def test_nothing_is_assumed_in_a_curve() -> None:
    """Round a circle of 8 m, 47 deg each five strides: no information, on whatever."""
    poses = walked(np.full(59, STRIDE_M / 8.0), np.zeros(59))
    values = values_of(poses)
    block = constrain_courses(np.arange(60), straight_triples(positions(values, 60)))
    assert len(block) == 10
    assert np.abs(linear(block, values).hessian(order(60))[0]).max() < 1e-20


DRIFT = np.radians(0.3)
"""Of the course, rad a stride: a gyro bias that is not known."""
SIGMA = np.array([1e-4, 1e-4, np.radians(0.05), 0.01, 0.01, 0.005])
"""Of a stride: rotation rad, translation m."""
BIAS = Z(99)


def drifting(turn: Floats, drift: float) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """A foot that turns by `turn` (F-1,) and measures `drift` more, rad, which the graph has as a variable."""
    seen = walked(turn + drift, np.zeros(len(turn)))
    graph, values = gtsam.NonlinearFactorGraph(), values_of(seen)
    values.insert(BIAS, np.zeros(1))
    graph.push_back(gtsam.PriorFactorPose3(X(0), seen[0], gtsam.noiseModel.Diagonal.Sigmas(FIRM)))
    graph.push_back(gtsam.PriorFactorVector(BIAS, np.zeros(1), gtsam.noiseModel.Isotropic.Sigma(1, DRIFT)))
    noise = gtsam.noiseModel.Diagonal.Sigmas(SIGMA)
    for k in range(1, len(seen)):
        graph.push_back(_drifting_stride(k, seen[k - 1].between(seen[k]), noise))
    return graph, values


def _drifting_stride(k: int, seen: gtsam.Pose3, noise: gtsam.noiseModel.Base) -> gtsam.CustomFactor:
    """The foot turns at the beginning of a stride: e = log((exp(-b) seen)^-1 (before^-1 after))."""

    def factor(values: gtsam.Values, with_jacobians: bool):
        before, after, b = values.atPose3(X(k - 1)), values.atPose3(X(k)), float(values.atVector(BIAS)[0])
        expected = gtsam.Pose3(gtsam.Rot3(yaw_rotation(-b)), np.zeros(3)).compose(seen)
        e = gtsam.Pose3.Logmap(expected.between(before.between(after)))
        by_bias = expected.inverse().AdjointMap()[:, 2:3]
        H = [-after.between(before).AdjointMap(), np.eye(6), by_bias]
        return e, H if with_jacobians else []

    return guarded_factor("drifting stride", [X(k - 1), X(k), BIAS], [6, 6, 1], noise, factor)


def course_after(turn: Floats, drift: float) -> float:
    """Course at the end, rad, of a walk that drifts and is tied to be straight."""
    graph, values = drifting(turn, drift)
    count = len(turn) + 1
    blocks = [find_courses(np.arange(count), positions(values, count))]
    ordering = order(count)
    ordering.push_back(BIAS)
    solved = minimize(graph, blocks, values, list_keys(ordering), 1e-6, 50)
    return float(solved.values.atPose3(X(count - 1)).rotation().yaw())


@pytest.mark.parametrize("corners_deg", [(), (90.0,), (90.0, -90.0, 35.0)], ids=["none", "one", "three"])
def test_drift_on_straight_legs_is_taken_out_and_corners_stay(corners_deg: tuple[float, ...]) -> None:
    turn = np.zeros(60 * (len(corners_deg) + 1))
    turn[60:-1:60] = np.radians(corners_deg)
    error = np.angle(np.exp(1j * (course_after(turn, DRIFT) - turn.sum())))
    assert abs(error) < 0.2 * DRIFT * len(turn)
    assert abs(course_after(turn, 0.0) - turn.sum()) < np.radians(0.5)


def test_a_slow_bend_is_mistaken_for_drift() -> None:
    """Why it is off: a bend of 0.3 deg a stride, walked and measured without any drift, is straightened."""
    assert course_after(np.full(60, DRIFT), 0.0) < 0.25 * 60 * DRIFT


def test_a_corner_that_is_grazed_does_not_pass_for_drift() -> None:
    """Corners of 90 deg to the right, wherever they fall among the strides, are worth nothing on the mean."""
    turn = np.zeros(3000)
    corner = np.arange(30, 2990, 31)
    for share, stride in ((0.25, 0), (0.5, 1), (0.25, 2)):
        turn[corner + stride] = -share * np.pi / 2
    position = positions(values_of(walked(turn, np.zeros(3000))), 3001)
    triples = straight_triples(position)
    kept = triples[off_line(position, triples) <= STRAIGHT_WITHIN_M]

    def believed(some: Ints) -> float:
        change = change_of_course(*np.moveaxis(position[some], 1, 0))
        weight = straight_probability(change / STRAIGHT.sigma, STRAIGHT.odds_of_curve)
        return float(np.degrees((weight * change).sum() / weight.sum()))

    assert believed(triples) < -0.1
    assert abs(believed(kept)) < 0.1 * abs(believed(triples))
    assert len(kept) > 100


def test_off_the_line_is_measured_over_ground_from_the_ends() -> None:
    position = np.stack([np.arange(11.0), np.zeros(11), 3.0 * np.arange(11) ** 2], axis=1) @ yaw_rotation(0.7).T
    triples = np.array([[0, 5, 10]])
    assert off_line(position, triples)[0] == pytest.approx(0.0, abs=1e-12)
    position[7] += yaw_rotation(0.7) @ [0.3, -0.2, 1.0]
    assert off_line(position, triples)[0] == pytest.approx(0.2)
    assert off_line(position, triples[:0]).shape == (0,)


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
    assert list(block.linearize(gtsam.Values())) == []


def test_marginals_are_those_of_the_information_matrix() -> None:
    """With block across ten footfalls and floors at the end of the order, down the tree as if on a chain."""
    height, floor = storeys(level=12, visits=(0, 1, 0))
    rng = np.random.default_rng(5)
    poses = walked(rng.normal(0, 0.01, len(height) - 1), np.diff(height))
    values = values_of(poses)
    node = np.arange(len(poses))
    blocks = find_courses(node, positions(values, len(poses))), constrain_heights(node, floor, LEVEL_SIGMA_M)
    for k in range(2):
        values.insert(Z(k), np.zeros(1))
    ordering = order(len(poses), 2)
    graph = dead_reckoned(poses, SIGMA).linearize(values)
    for block in blocks:
        for factor in block.linearize(values):
            graph.push_back(factor)
    full = np.linalg.inv(graph.hessian(ordering)[0])
    keys = [*(X(k) for k in range(len(poses))), Z(0), Z(1)]
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
    assert [key for key in keys if key not in (Z(0), Z(1))] == [plain.at(i) for i in range(plain.size())]


def test_straight_legs_are_off_unless_asked_for_and_floors_can_be_switched_off() -> None:
    assert (DEFAULT.walk.straight, DEFAULT.walk.floors) == (False, True)
    walk = demo()
    free = smooth(walk.recording, walk.stances, FREE)
    flat = smooth(walk.recording, walk.stances, DEFAULT)
    assert not any("level floor" in note for note in free.notes)
    assert any("1 level floor" in note for note in flat.notes)
    assert np.ptp(flat.stances.position[:, 2]) < min(0.02, 0.1 * np.ptp(free.stances.position[:, 2]))
    assert np.linalg.norm((flat.position - free.position)[:, :2], axis=1).max() < 0.1
    assert flat.stances.position_cov[-1, 2, 2] < 0.2 * free.stances.position_cov[-1, 2, 2]


def test_a_smoothed_walk_with_straight_legs_keeps_its_corners() -> None:
    walk = demo()
    free = smooth(walk.recording, walk.stances, FREE)
    held = smooth(walk.recording, walk.stances, replace(DEFAULT, walk=STRAIGHT_ONLY))
    assert np.linalg.norm((held.position - free.position)[:, :2], axis=1).max() < 0.3
    assert held.stances.heading_sigma[-1] < free.stances.heading_sigma[-1]
