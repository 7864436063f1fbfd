"""What is solved in batch is what iSAM2 is given, and nothing stands in `fg_nav.factors` that no estimator uses."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.magnetic import average_footfall_field
from fg_nav.smoother.field import integrate_field, solve_with_field
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.problem import walk_problem
from tests.linear import linear_factors
from tests.smoother.walks import DEFAULT, demo, part, time_order, track_of

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


def information_of(linear: gtsam.GaussianFactorGraph, problem: WalkProblem) -> tuple[Floats, Floats]:
    return linear.hessian(time_order(problem.nodes, with_field=True))


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
    delta = gtsam.VectorValues()
    rng = np.random.default_rng(1)
    for key, size in problem.values.dims().items():
        delta.insert(key, 1e-2 * rng.standard_normal(size))
    values = problem.values.retract(delta)
    batch = problem.graph.linearize(values)
    for block in problem.system.blocks:
        for factor in linear_factors(block, values):
            batch.push_back(factor)
    expected, found = (information_of(linear, problem) for linear in (batch, problem.factors().linearize(values)))
    scale = np.sqrt(np.diag(expected[0]))
    np.testing.assert_allclose((found[0] - expected[0]) / np.outer(scale, scale), 0.0, atol=1e-9)
    np.testing.assert_allclose((found[1] - expected[1]) / scale, 0.0, atol=1e-9 * np.abs(expected[1] / scale).max())
    assert problem.factors().error(values) == pytest.approx(
        problem.graph.error(values) + sum(block.error(values) for block in problem.system.blocks), rel=1e-9
    )
