"""The joint covariance of footfalls, against dense linear algebra and finite differences."""

from functools import cache

import numpy as np
import pytest

from fg_nav.smoother.batch import smooth_graph
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.sensitivity import FootfallCovariance, weigh_path
from fg_nav.smoother.solver import Solved, dimension_of
from tests.smoother.walks import DEFAULT, demo, part, time_order


@cache
def solved_walk() -> tuple[WalkProblem, Solved]:
    walk = part(demo(), 6)
    problem = walk_problem(walk.recording, walk.stances, 0.0, DEFAULT)
    return problem, solve(problem)


def test_tree_gives_what_the_dense_covariance_does() -> None:
    problem, solved = solved_walk()
    ordering = time_order(problem.nodes)
    keys = [ordering.at(i) for i in range(ordering.size())]
    first = dict(zip(keys, np.cumsum([0, *(dimension_of(key) for key in keys)]), strict=False))
    rng = np.random.default_rng(0)
    shared = 1e-3 * rng.standard_normal((solved.root.total, 2))
    joint = FootfallCovariance.of(solved, problem.nodes, shared)
    rows = [slice(first[key], first[key] + 6) for key in joint.keys]
    # Columns of one size, as poses, velocities and biases are of many.
    A, _ = problem.factors().linearize(solved.linearized_at).jacobian(ordering)
    size = np.linalg.norm(A, axis=0)
    root = np.linalg.inv(np.linalg.qr(A / size)[1]) / size[:, None]
    T = np.zeros((len(rows), 4, A.shape[1]))
    for k, some in enumerate(rows):
        T[k][:, some] = joint.nav_T_body[k]
    C = T.reshape(-1, A.shape[1]) @ np.hstack([root, shared])
    C = C @ C.T
    weights = rng.standard_normal((len(rows), 4, 3))
    covariance, cross = joint.combine(weights)
    flat = weights.reshape(-1, 3)
    assert covariance == pytest.approx(flat.T @ C @ flat, rel=1e-6)
    assert cross.reshape(-1, 3) == pytest.approx(C @ flat, rel=1e-5, abs=1e-6 * np.abs(C @ flat).max())


def test_weights_of_a_path_are_the_derivatives_of_its_length() -> None:
    position = np.random.default_rng(1).uniform(-5, 5, (7, 3))

    def length(until: int) -> float:
        return float(np.linalg.norm(np.diff(position[: until + 1], axis=0), axis=1).sum())

    for until in (3, 6):
        weights = weigh_path(position, until)
        assert not weights[:, 3].any()
        for k, axis in np.ndindex(7, 3):
            kept = position[k, axis]
            ends = []
            for step in (-1e-6, 1e-6):
                position[k, axis] = kept + step
                ends.append(length(until))
            position[k, axis] = kept
            assert weights[k, axis] == pytest.approx((ends[1] - ends[0]) / 2e-6, abs=1e-8)
    assert not weigh_path(np.zeros((3, 3))).any()


def test_a_solution_has_the_sigma_of_its_distance() -> None:
    walk = part(demo(), 12)
    smoothed = smooth_graph(walk.recording, walk.stances)
    solution, joint = smoothed.solution, smoothed.joint
    place = solution.stances.position
    weights = np.zeros((len(place), 4, 1))
    weights[-1, :3, 0] = (place[-1] - place[0]) / np.linalg.norm(place[-1] - place[0])
    weights[0] = -weights[-1]
    # The first leg of the corridor is straight: what is not known of its end is what is not known of its length.
    assert solution.distance_sigma_m == pytest.approx(np.sqrt(joint.combine(weights)[0][0, 0]), rel=0.1)
