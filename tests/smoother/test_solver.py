"""Gauss-Newton on a walk: its steps, its marginals, what it does not see, and that iSAM2 is given the same graph."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X

from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError
from fg_nav.factors import guarded_factor
from fg_nav.factors.residual import Stack
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother.field import integrate_field, solve_with_field
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.graph import WalkProblem, initial_values, solve
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solver import CONVERGENCE, MAX_HALVINGS, Solved, WalkSystem, find_minimum, list_positions
from fg_nav.smoother.square_root import LinearWalk, stack_factors
from tests.linear import linear_factors
from tests.smoother.walks import DEFAULT, demo, ordering_of, part, track_of

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
    return find_minimum(WalkSystem(graph, []), values, np.array(keys, dtype=np.uint64), convergence, largest_steps)


def test_a_walk_takes_few_steps_from_dead_reckoning_to_its_minimum() -> None:
    solved, walk = walk_problem(demo().recording, demo().stances, 0.0, DEFAULT), demo()
    start = solved.nodes, solved.start.nav_R_body, solved.known.gyro_bias, DEFAULT.gravity
    one = replace(solved, values=initial_values(walk.recording, walk.stances, *start))
    usual, exact = solve(one), solve(one, 1e-9)
    assert 1 < usual.steps <= 3
    places = [list_positions(range(len(one.nodes)), found.values) for found in (usual, exact)]
    assert np.linalg.norm(places[0] - places[1], axis=1).max() < 0.005


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
def test_a_triangle_is_that_of_the_dense_information_whatever_the_tree(shape: str, split: int) -> None:
    """Covariances of the whole; error, volume and step where the first are eliminated before the others."""
    n, rng = 7, np.random.default_rng(1)
    pairs = {"chain": [(i, i + 1) for i in range(n - 1)], "star": [(0, i) for i in range(1, n)], "forest": [(0, 1)]}
    graph, keys = gtsam.GaussianFactorGraph(), np.array([V(i) for i in reversed(range(n))], dtype=np.uint64)
    for i in range(n):
        graph.add(V(i), rng.standard_normal((3, 3)) + 2 * np.eye(3), rng.standard_normal(3), UNIT)
    for i, j in pairs[shape]:
        A, C = rng.standard_normal((2, 3, 3))
        graph.add(V(i), A, V(j), C, rng.standard_normal(3), UNIT)
    information, vector = graph.hessian(ordering_of(keys))
    covariance, step = np.linalg.inv(information), np.linalg.solve(information, vector)
    walk = LinearWalk.of(stack_factors(graph.at(i) for i in range(graph.size())), keys)
    root, left = walk.eliminate_before(split).eliminate()
    found, moved = walk.eliminate()[0].covariances(keys.tolist()), root.split(root.step)
    assert left.error == pytest.approx(graph.error(graph.optimize()), rel=1e-9)
    assert left.volume == pytest.approx(0.5 * np.linalg.slogdet(information)[1], rel=1e-9)
    for k, key in enumerate(keys.tolist()):
        own = slice(3 * k, 3 * k + 3)
        np.testing.assert_allclose(found[key], covariance[own, own], rtol=1e-9, atol=1e-12)
        if k >= split:
            np.testing.assert_allclose(moved[key], step[own], rtol=1e-9, atol=1e-12)


def test_what_is_not_determined_is_refused() -> None:
    """Two places tied to each other alone: rounding leaves some 1e-17 on the diagonal of the second."""
    A, keys = np.random.default_rng(0).standard_normal((3, 6)), np.array([V(0), V(1)], dtype=np.uint64)
    tie = Stack(keys[None], np.column_stack([A[:, :3], -A[:, :3], A[:, 3]])[None])
    with pytest.raises(EstimationError, match="no unique solution"):
        LinearWalk.of([tie, tie], keys).eliminate()


def test_a_long_walk_has_marginals_too() -> None:
    """Three times round the corridor: the position is known to half a metre, a step of it to a millimetre."""
    once = demo().recording
    again = [np.tile(getattr(once, name), (3, 1)) for name in ("acc", "gyr")]
    recording = Recording(np.arange(len(again[0])) * once.period_s, *again)
    found = solve(walk_problem(recording, detect_stances(recording), 0.0, DEFAULT))
    covariance = found.root.covariances(found.values.keys())
    assert all(np.linalg.eigvalsh(c).min() > 0 for c in covariance.values())
    spread = [np.trace(c[3:, 3:]) for key, c in sorted(covariance.items()) if key >> 56 == ord("x")]
    assert 0.3 < np.sqrt(spread[-1]) < 3.0
    assert np.polyfit(np.arange(len(spread)), spread, 1)[0] > 0


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
    rng, step = np.random.default_rng(1), gtsam.VectorValues()
    for key, width in problem.values.dims().items():
        step.insert(key, 1e-2 * rng.standard_normal(width))
    values = problem.values.retract(step)
    batch = problem.graph.linearize(values)
    for block in problem.system.blocks:
        for factor in linear_factors(block, values):
            batch.push_back(factor)
    graphs = batch, problem.factors().linearize(values)
    expected, found = (linear.hessian(ordering_of(problem.time_order)) for linear in graphs)
    scale = np.sqrt(np.diag(expected[0]))
    np.testing.assert_allclose((found[0] - expected[0]) / np.outer(scale, scale), 0.0, atol=1e-9)
    np.testing.assert_allclose((found[1] - expected[1]) / scale, 0.0, atol=1e-9 * np.abs(expected[1] / scale).max())
    assert problem.factors().error(values) == pytest.approx(
        problem.graph.error(values) + sum(block.error(values) for block in problem.system.blocks), rel=1e-9
    )
