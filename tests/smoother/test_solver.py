"""Gauss-Newton: few steps to the minimum, halved where it overshoots, and one sentence where there is none."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X

from fg_nav.errors import EstimationError
from fg_nav.factors import guarded_factor
from fg_nav.smoother.solver import CONVERGENCE, MAX_HALVINGS, Solved, WalkSystem, find_minimum
from tests.smoother.walks import demo, minimum, node_arrays, problem

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


def _after(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, steps: int) -> np.ndarray:
    """The vector after so many steps, taken one call at a time."""
    for _ in range(steps):
        values = run(graph, values, convergence=np.inf, largest_steps=1).values
    return values.atVector(V(0))


def test_a_step_that_overshoots_is_halved() -> None:
    """Full Gauss-Newton steps on atan(x) run away from |x| > 1.39; the first one is always taken in full."""
    graph, values = of_one_vector(lambda x: (np.arctan(x), 1 / (1 + x**2)), start=1.45)
    full = [1.45]
    while len(full) < 8:
        full.append(full[-1] - np.arctan(full[-1]) * (1 + full[-1] ** 2))
    assert abs(full[-1]) > 1e3
    assert _after(graph, values, 1)[0] == pytest.approx(full[1])
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


def test_no_minimum_in_the_steps_allowed_is_one_sentence() -> None:
    """On the cube root every full step doubles the distance, and a halved one halves it."""
    graph, values = of_one_vector(lambda x: (1e9 * np.cbrt(x), 1e9 / (3 * np.cbrt(x) ** 2)), start=1.0)
    with pytest.raises(EstimationError, match=r"did not converge in 25 steps: .*fg-nav inspect") as error:
        run(graph, values)
    assert "\n" not in str(error.value)


def test_no_unique_solution_is_one_sentence() -> None:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for j in range(2):
        values.insert(X(j), gtsam.Pose3(gtsam.Rot3(), np.array([float(j), 0.0, 0.0])))
    graph.push_back(gtsam.BetweenFactorPose3(X(0), X(1), gtsam.Pose3(), gtsam.noiseModel.Unit.Create(6)))
    with pytest.raises(EstimationError, match="no unique solution"):
        run(graph, values, (X(0), X(1)))


def test_what_is_not_finite_is_one_sentence() -> None:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(V(0), np.zeros(3))
    graph.push_back(gtsam.PriorFactorVector(V(0), np.array([np.nan, 0.0, 0.0]), UNIT))
    with pytest.raises(EstimationError, match="not finite"):
        run(graph, values)
