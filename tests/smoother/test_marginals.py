"""Marginals from the Bayes tree are those of GTSAM and those of a dense inverse."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V

from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import Stack
from fg_nav.recording import Recording
from fg_nav.smoother.square_root import LinearWalk, stack_factors
from tests.linear import marginal_covariances
from tests.smoother.walks import Walk, demo, list_keys, minimum, problem


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
