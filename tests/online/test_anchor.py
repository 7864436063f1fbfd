"""What a walk so far hands over: an anchor that says all of its past, and the past itself."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, M, V, X

from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import EstimateRow, Past, PathNodes
from fg_nav.online.resolve import solve_so_far
from fg_nav.online.strides import StanceNodes, list_stances, list_variables
from fg_nav.online.window import MarginalPrior, Window, marginalize
from fg_nav.smoother.square_root import LinearWalk, stack_factors
from tests.linear import marginal_covariances
from tests.online.walks import add, fed, in_field
from tests.smoother.walks import FREE, demo, part, time_order

KEYS = X(3), V(3), M(2), B(1)
DIMS = 6, 3, 9, 6


def moved(values: gtsam.Values, step: np.ndarray) -> gtsam.Values:
    delta = gtsam.VectorValues()
    for key, one in zip(KEYS, np.split(step, np.cumsum(DIMS)[:-1]), strict=True):
        delta.insert(key, one)
    return values.retract(delta)


@pytest.mark.parametrize("far", [0.0, 0.4])
def test_the_jacobian_of_an_anchor_is_the_derivative_of_its_error(far: float) -> None:
    def error_at(values: gtsam.Values) -> np.ndarray:
        return -np.asarray(factor.linearize(values).jacobian()[1])

    rng = np.random.default_rng(3)
    pose = gtsam.Pose3(gtsam.Rot3.RzRyRx(*rng.normal(size=3)), rng.normal(size=3))
    values = (np.array(pose.matrix()), *(rng.normal(size=d) for d in DIMS[1:]))
    anchor = MarginalPrior(KEYS, values, rng.normal(size=(sum(DIMS), sum(DIMS))))
    factor, there = anchor.factor(), moved(anchor.initial_values(), far * rng.normal(size=sum(DIMS)))
    analytic, h = np.asarray(factor.linearize(there).jacobian()[0]), 1e-5
    steps = h * np.eye(sum(DIMS))
    numeric = [(error_at(moved(there, d)) - error_at(moved(there, -d))) / (2 * h) for d in steps]
    np.testing.assert_allclose(analytic, np.transpose(numeric), atol=1e-6)
    A, b = factor.linearize(anchor.initial_values()).jacobian()  # what was eliminated
    np.testing.assert_allclose(A, anchor.A, atol=1e-12)
    np.testing.assert_allclose(b, 0.0, atol=1e-12)


def test_an_anchor_and_the_strides_behind_it_say_what_the_whole_graph_says() -> None:
    """Of the newest footfall, to the precision of the arithmetic: where it is linearized nothing is lost."""
    walk, at = part(demo(), 16), 9
    found = solve_so_far(walk.recording, walk.stances, OnlineOptions(use_field=False, parameters=FREE)).walk
    stances, values = list_stances(found.problem.nodes, walk.recording.t), found.solved.values
    linear = found.problem.factors().linearize(values)
    past = {key for stance in stances[: at + 1] for key in list_variables(stance, values)}
    before, behind = [], gtsam.GaussianFactorGraph()
    for factor in (linear.at(i) for i in range(linear.size())):
        if set(factor.keys()) <= past:
            before.append(factor)
        else:
            behind.push_back(factor)
    order = time_order(found.problem.nodes, False, found.problem.floor)
    keys, keep = [order.at(i) for i in range(order.size())], list_variables(stances[at], values)
    of_past = np.array([key for key in keys if key in past], dtype=np.uint64)
    root, _ = LinearWalk.of(stack_factors(before), of_past).eliminate()
    behind.push_back(marginalize(root, values, keep).factor().linearize(values))
    later = gtsam.Ordering()
    for key in keys:
        if key not in past or key in keep:
            later.push_back(key)
    tree, newest = behind.eliminateMultifrontal(later, gtsam.EliminateQR), X(stances[-1].result)
    whole = linear.eliminateMultifrontal(order, gtsam.EliminateQR)
    expected = marginal_covariances(whole, {newest})[newest]
    np.testing.assert_allclose(marginal_covariances(tree, {newest})[newest], expected, rtol=1e-6, atol=1e-12)
    assert np.abs(tree.optimize().at(newest)).max() < 1e-3  # the minimum of the whole is that of both parts


def test_an_anchor_state_is_the_newest_estimate_of_the_walk_that_it_leaves() -> None:
    online = fed(demo(), footfalls=20)
    anchor = online.window.to_anchor()
    again = Window(anchor, online.walk).latest
    np.testing.assert_allclose(again.position, online.latest.position, atol=2e-3)
    sigma = np.sqrt(np.diagonal(online.latest.pose_cov))
    assert (np.abs(again.pose_cov - online.latest.pose_cov) < 0.005 * np.outer(sigma, sigma)).all()
    assert len(anchor.past.rows) == anchor.stance.number - anchor.past.first
    short = anchor.without_past()
    assert short.past.rows == ()
    assert short.footfalls == anchor.footfalls[-1:]
    np.testing.assert_array_equal(Window(short, online.walk).latest.position, again.position)


def past(first: int, names: str, *sample: int) -> Past:
    n = len(sample)
    zero = np.zeros((n, 3))
    nodes = PathNodes(np.array(sample, dtype=np.int64), zero, zero, np.zeros((n, 3, 3)), zero, zero)
    return Past(first, tuple(EstimateRow(np.zeros(1), name, "") for name in names), nodes)


def test_a_later_past_takes_the_place_of_what_it_knows_again() -> None:
    known, later = past(0, "abcd", 0, 9, 10, 19, 20, 29, 30, 39), past(2, "CDE", 21, 28, 30, 39, 40, 49)
    joined = known.join(later)
    assert "".join(row.field for row in joined.rows) == "abCDE"
    assert joined.nodes.sample.tolist() == [0, 9, 10, 19, 20, 21, 28, 30, 39, 40, 49]
    assert known.join(Past(3)).rows == known.rows[:3]
    assert Past().join(known).rows == known.rows
    before = later.before(StanceNodes(3, 8, 10, 8, 0, 0.0, 34, 3.4, (30, 39)))
    assert ([row.field for row in before.rows], before.nodes.sample.tolist()) == (["C"], [21, 28])


def test_a_window_is_not_changed_by_its_anchor_state() -> None:
    one, other = (fed(in_field(), footfalls=12) for _ in range(2))
    one.window.to_anchor()
    for k in range(12, 15):
        add(one, in_field(), k)
        add(other, in_field(), k)
    np.testing.assert_array_equal(one.smoothed().position, other.smoothed().position)
