"""How a solution moves with numbers that its factors share, against dense linear algebra."""

import numpy as np
import pytest

from fg_nav.smoother.graph import solve
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.sensitivity import SharedColumns
from fg_nav.smoother.solver import dimension_of
from tests.smoother.walks import DEFAULT, demo, part, time_order


def test_tree_gives_what_the_dense_matrix_does() -> None:
    walk = part(demo(), 6)
    problem = walk_problem(walk.recording, walk.stances, 0.0, DEFAULT)
    solved, ordering = solve(problem), time_order(problem.nodes)
    A, _ = problem.factors().linearize(solved.linearized_at).jacobian(ordering)
    keys = [ordering.at(i) for i in range(ordering.size())]
    C = np.random.default_rng(0).standard_normal((len(A), 3))
    ends = np.cumsum([dimension_of(key) for key in keys])[:-1]
    products = np.zeros((solved.root.total, 3))
    products[np.concatenate([solved.root.find_columns([(key,)])[0] for key in keys])] = A.T @ C
    found = SharedColumns(solved.root, products)
    # Columns of one size, as poses, velocities and biases are of many.
    size = np.linalg.norm(A, axis=0)
    Q, R = np.linalg.qr(A / size)
    X, moved = np.linalg.solve(R, Q.T @ C) / size[:, None], solved.root.split(found.solve())
    expected = dict(zip(keys, np.split(X, ends), strict=True))
    assert found.explained == pytest.approx(C.T @ Q @ Q.T @ C, rel=1e-7)
    for key in keys:
        np.testing.assert_allclose(moved[key], expected[key], rtol=1e-4, atol=1e-6 * np.abs(expected[key]).max())
