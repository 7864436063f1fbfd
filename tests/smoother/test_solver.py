"""Gauss-Newton on a walk: its steps, its marginals, what it does not see, and that iSAM2 is given the same graph."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import S, V, X

from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError
from fg_nav.factors import guarded_factor
from fg_nav.factors.residual import ResidualBlock, Stack
from fg_nav.factors.zero_velocity import StanceVelocity
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother.field import integrate_field, solve_with_field
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solver import CONVERGENCE, MAX_HALVINGS, Solved, WalkSystem, find_minimum
from fg_nav.smoother.square_root import LinearWalk, stack_factors
from tests.linear import linear_factors, marginal_covariances
from tests.smoother.walks import (
    DEFAULT,
    Walk,
    demo,
    list_keys,
    minimum,
    node_arrays,
    part,
    problem,
    time_order,
    track_of,
    values_moved,
)

UNIT = gtsam.noiseModel.Unit.Create(3)


def of_one_vector(residual, start: float) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """A graph whose only factor is residual(x), d residual / d x of each component of one vector."""

    def factor(values: gtsam.Values, with_jacobians: bool):
        e, slope = residual(values.atVector(V(0)))
        return e, [np.diag(slope)] if with_jacobians else []

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.push_back(guarded_factor("test", [V(0)], [3], UNIT, factor))
    values.insert(V(0), np.full(3, start))
    return graph, values


def run(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    keys: tuple[int, ...] = (V(0),),
    convergence: float = CONVERGENCE,
    largest_steps: int = 25,
) -> Solved:
    """Solve a graph that is no walk."""
    return find_minimum(WalkSystem(graph, []), values, np.array(keys, dtype=np.uint64), convergence, largest_steps)


def test_a_walk_takes_few_steps_to_its_minimum() -> None:
    one = problem(demo())
    usual, exact = minimum(one), minimum(one, 1e-9)
    assert usual.steps <= 3
    position, exact_position = (node_arrays(one.nodes, found.values)[0] for found in (usual, exact))
    assert np.linalg.norm(position - exact_position, axis=1).max() < 0.005


def test_a_step_that_overshoots_is_halved() -> None:
    """Full Gauss-Newton steps on atan(x) run away from |x| > 1.39; the first one is always taken in full."""
    graph, values = of_one_vector(lambda x: (np.arctan(x), 1 / (1 + x**2)), start=1.45)
    full = [1.45]
    while len(full) < 8:
        full.append(full[-1] - np.arctan(full[-1]) * (1 + full[-1] ** 2))
    assert abs(full[-1]) > 1e3
    first = run(graph, values, convergence=np.inf, largest_steps=1).values
    assert first.atVector(V(0))[0] == pytest.approx(full[1])
    found = run(graph, values, convergence=1e-9)
    np.testing.assert_allclose(found.values.atVector(V(0)), 0.0, atol=1e-4)
    assert found.steps < 8


def test_a_step_uphill_is_not_taken() -> None:
    """A slope of the wrong sign: after the first step all lead uphill, and none is taken."""
    seen: list[float] = []

    def residual(x: np.ndarray):
        seen.append(float(x[0]))
        return np.exp(x), -np.exp(x)

    graph, values = of_one_vector(residual, start=1.0)
    with pytest.raises(EstimationError, match="did not converge"):
        run(graph, values, largest_steps=3)
    assert seen.count(2.0) >= 3  # where the first step led: linearized there, and there again
    assert min(x for x in seen[2:] if x != 2.0) == pytest.approx(2.0 + 0.5 ** (MAX_HALVINGS - 1))


def test_what_has_no_solution_is_one_sentence() -> None:
    """On the cube root every full step doubles the distance, and a halved one halves it."""
    cube_root = of_one_vector(lambda x: (1e9 * np.cbrt(x), 1e9 / (3 * np.cbrt(x) ** 2)), start=1.0)
    loose, poses, infinite = (gtsam.NonlinearFactorGraph(), gtsam.Values(), gtsam.NonlinearFactorGraph())
    for j in range(2):
        poses.insert(X(j), gtsam.Pose3(gtsam.Rot3(), np.array([float(j), 0.0, 0.0])))
    loose.push_back(gtsam.BetweenFactorPose3(X(0), X(1), gtsam.Pose3(), gtsam.noiseModel.Unit.Create(6)))
    infinite.push_back(gtsam.PriorFactorVector(V(0), np.array([np.nan, 0.0, 0.0]), UNIT))
    for graph, values, keys, words in (
        (*cube_root, (V(0),), r"did not converge in 25 steps: .*fg-nav inspect"),
        (loose, poses, (X(0), X(1)), "no unique solution"),
        (infinite, cube_root[1], (V(0),), "not finite"),
    ):
        with pytest.raises(EstimationError, match=words) as error:
            run(graph, values, keys)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(("shape", "split"), [("chain", 3), ("star", 5), ("forest", 4)])
def test_any_tree_will_do(shape: str, split: int) -> None:
    """Linear graphs of vectors, whose joint information is known in closed form: GTSAM's tree, and ours."""
    n, rng = 7, np.random.default_rng(1)
    pairs = {"chain": [(i, i + 1) for i in range(n - 1)], "star": [(0, i) for i in range(1, n)], "forest": [(0, 1)]}
    graph, order = gtsam.GaussianFactorGraph(), gtsam.Ordering()
    information = np.zeros((3 * n, 3 * n))
    for i in range(n):
        J = rng.standard_normal((3, 3)) + 2 * np.eye(3)
        graph.add(V(i), J, rng.standard_normal(3), gtsam.noiseModel.Unit.Create(3))
        information[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += J.T @ J
        order.push_back(V(n - 1 - i))
    for i, j in pairs[shape]:
        A, C = rng.standard_normal((2, 3, 3))
        graph.add(V(i), A, V(j), C, rng.standard_normal(3), gtsam.noiseModel.Unit.Create(3))
        both = np.zeros((3, 3 * n))
        both[:, 3 * i : 3 * i + 3], both[:, 3 * j : 3 * j + 3] = A, C
        information += both.T @ both
    tree = graph.eliminateMultifrontal(order, gtsam.EliminateQR)
    found, step = marginal_covariances(tree, {V(i) for i in range(n)}), tree.optimize()
    walk = LinearWalk.of(stack_factors(graph.at(i) for i in range(graph.size())), list_keys(order))
    root, left = walk.eliminate_before(split).eliminate()
    dense, ours, moved = (
        np.linalg.inv(information),
        walk.eliminate()[0].covariances(map(V, range(n))),
        root.split(root.step),
    )
    assert left.error == pytest.approx(graph.error(step), rel=1e-9)
    assert left.volume == pytest.approx(0.5 * np.linalg.slogdet(information)[1], rel=1e-9)
    for i in range(n):
        np.testing.assert_allclose(found[V(i)], dense[3 * i : 3 * i + 3, 3 * i : 3 * i + 3], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(ours[V(i)], found[V(i)], rtol=1e-9, atol=1e-12)
        if n - 1 - i >= split:
            np.testing.assert_allclose(moved[V(i)], step.at(V(i)), rtol=1e-9, atol=1e-12)


def test_what_is_not_determined_is_refused() -> None:
    """Two places tied to each other alone: rounding leaves some 1e-17 on the diagonal of the second."""
    A, order = np.random.default_rng(0).standard_normal((3, 6)), gtsam.Ordering()
    for key in (V(0), V(1)):
        order.push_back(key)
    tie = Stack(np.array([[V(0), V(1)]], dtype=np.uint64), np.column_stack([A[:, :3], -A[:, :3], A[:, 3]])[None])
    with pytest.raises(EstimationError, match="no unique solution"):
        LinearWalk.of([tie, tie], list_keys(order)).eliminate()


def test_a_long_walk_has_marginals_too() -> None:
    """Three times round the corridor: the position is known to half a metre, a step of it to a millimetre."""
    once = demo().recording
    again = [np.tile(getattr(once, name), (3, 1)) for name in ("acc", "gyr")]
    recording = Recording(np.arange(len(again[0])) * once.period_s, *again)
    found = minimum(problem(Walk(recording, detect_stances(recording))))
    covariance = found.root.covariances(found.values.keys())
    assert all(np.linalg.eigvalsh(c).min() > 0 for c in covariance.values())
    spread = [np.trace(c[3:, 3:]) for key, c in sorted(covariance.items()) if key >> 56 == ord("x")]
    assert 0.3 < np.sqrt(spread[-1]) < 3.0
    assert np.polyfit(np.arange(len(spread)), spread, 1)[0] > 0


UP = np.array([0.0, 0.0, 1.0])


def some_stances(seed: int = 0, nodes: int = 5) -> tuple[ResidualBlock, gtsam.Values]:
    """Nodes in any attitude, with residuals of some sigmas, and a vertical sigma of its own."""
    rng, values = np.random.default_rng(seed), gtsam.Values()
    for k in range(2):
        values.insert(S(k), 0.002 * rng.standard_normal(1))
    for j in range(nodes):
        values.insert(X(j), gtsam.Pose3(gtsam.Rot3.RzRyRx(*rng.standard_normal(3)), rng.standard_normal(3)))
        values.insert(V(j), 0.1 * rng.standard_normal(3))
    settling, sigma = np.tile([0.0, 0.0, -0.005], (nodes, 1)), np.tile([0.02, 0.02, 0.05], (nodes, 1))
    velocity = StanceVelocity(0.1 * rng.standard_normal((nodes, 3)), settling, sigma, np.full(nodes, 3.0))
    return ResidualBlock(velocity, [(X(j), V(j), S(j % 2)) for j in range(nodes)]), values


def turned(values: gtsam.Values, nodes: int = 5) -> gtsam.VectorValues:
    """The step that turns everything by a radian about the vertical, to first order."""
    step = gtsam.VectorValues()
    for j in range(nodes):
        pose = values.atPose3(X(j))
        R = pose.rotation().matrix()
        step.insert(X(j), np.concatenate([R.T @ UP, R.T @ np.cross(UP, pose.translation())]))
        step.insert(V(j), np.cross(UP, values.atVector(V(j))))
    for k in range(2):
        step.insert(S(k), np.zeros(1))
    return step


def test_a_turn_of_everything_is_not_seen() -> None:
    velocities, values = some_stances()
    step = turned(values)
    for factor in linear_factors(velocities, values):
        A, _ = factor.jacobian()
        keys = list(factor.keys())
        seen = A @ np.concatenate([step.at(key) for key in keys])
        np.testing.assert_allclose(seen, 0.0, atol=1e-9)


FOOTFALLS = 9


def solved_with_field(heading: float | None, p_field: dict[str, object]) -> WalkProblem:
    """A few footfalls of a walk in a field that is rough, at the minimum."""
    few, rng = part(demo(), FOOTFALLS), np.random.default_rng(0)
    truth = demo().recording.truth
    mag = np.einsum("nji,j->ni", truth.nav_R_body[: len(few.recording)], [3.0, 20.0, -43.0])
    recording = replace(few.recording, mag=mag + 0.1 * rng.standard_normal(mag.shape))
    p = replace(DEFAULT, magnetic=replace(DEFAULT.magnetic, **p_field))
    problem = walk_problem(recording, few.stances, heading, p)
    field = average_footfall_field(recording, few.stances)
    found = solve_with_field(problem, field, integrate_field(problem, field, track_of(problem)))
    return replace(found.problem, values=found.solved.values)


@pytest.mark.parametrize("heading", [0.0, None], ids=["given", "not given"])
@pytest.mark.parametrize("potential", [True, False], ids=["with potential", "compass alone"])
def test_batch_and_isam2_linearize_the_same_walk_to_the_same_information(
    heading: float | None, potential: bool
) -> None:
    problem = solved_with_field(heading, {"potential": potential})
    field = problem.get(FieldFactors)
    assert len(field.heading) >= FOOTFALLS - 3
    assert (len(field.potential) > 0) == potential
    # Also where the tilt is not the one that levels the field.
    values = values_moved(problem.values, 1e-2, 1)
    batch = problem.graph.linearize(values)
    for block in problem.system.blocks:
        for factor in linear_factors(block, values):
            batch.push_back(factor)
    graphs = batch, problem.factors().linearize(values)
    expected, found = (linear.hessian(time_order(problem.nodes, with_field=True)) for linear in graphs)
    scale = np.sqrt(np.diag(expected[0]))
    np.testing.assert_allclose((found[0] - expected[0]) / np.outer(scale, scale), 0.0, atol=1e-9)
    np.testing.assert_allclose((found[1] - expected[1]) / scale, 0.0, atol=1e-9 * np.abs(expected[1] / scale).max())
    assert problem.factors().error(values) == pytest.approx(
        problem.graph.error(values) + sum(block.error(values) for block in problem.system.blocks), rel=1e-9
    )
