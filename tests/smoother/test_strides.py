"""Strides become factors in one place, and what they say of a stance is what a foot does in it."""

import ast
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, S, V, X

import fg_nav.smoother
from fg_nav.arrays import Floats
from fg_nav.detection.stance import Stances
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from fg_nav.smoother.parameters import PLAIN
from fg_nav.smoother.strides import VELOCITY_SIGMA, place_nodes
from tests.linear import linear_factors
from tests.real_data import needs_data
from tests.simulated import LEVER, RIGID
from tests.smoother.walks import (
    DEFAULT,
    Problem,
    Walk,
    degrees_between,
    demo,
    gdin,
    minimum,
    node_arrays,
    noise_free,
    part,
    problem,
    with_exact_factors,
)

KNOWN = replace(DEFAULT, known_lever=LEVER)
SOFT = replace(KNOWN, settling_m=0.0015)  # On a sole that is expected to give way by 1.5 mm.


def converged(one: Problem, steps: int = 12) -> gtsam.Values:
    """Gauss-Newton without any criterion: as many full steps as told."""
    values = one.initial
    for _ in range(steps):
        tree = one.graph.linearize(values).eliminateMultifrontal(one.ordering, gtsam.EliminateQR)
        values = values.retract(tree.optimize())
    return values


def differences(one: Problem, a: gtsam.Values, b: gtsam.Values) -> tuple[float, float]:
    """Largest difference of the nodes in position, m, and attitude, deg."""
    p, _, R, *_ = node_arrays(one.nodes, a)
    q, _, Q, *_ = node_arrays(one.nodes, b)
    return float(np.linalg.norm(p - q, axis=1).max()), float(degrees_between(R, Q).max())


@pytest.mark.parametrize("walk", [demo, pytest.param(lambda: gdin(18), marks=needs_data)], ids=["demo", "gdin 18"])
def test_solution_is_that_of_the_exact_factors(walk) -> None:
    one = with_exact_factors(walk())
    metres, degrees = differences(one, minimum(problem(walk()), 1e-10).values, converged(one))
    assert metres < 1e-4
    assert degrees < 0.01


def test_linearized_velocities_have_error_and_slope_of_the_factors() -> None:
    """At any point. Their curvature differs: the velocities are written in the body's axes (`test_invariance`)."""
    walk, exact = problem(part(demo(), 4)), with_exact_factors(part(demo(), 4))
    rng = np.random.default_rng(0)
    values, none = gtsam.Values(), gtsam.VectorValues()
    for j in range(len(walk.nodes)):
        values.insert(X(j), gtsam.Pose3(gtsam.Rot3.RzRyRx(*rng.standard_normal(3)), rng.standard_normal(3)))
        values.insert(V(j), 0.01 * rng.standard_normal(3))
        none.insert(X(j), np.zeros(6))
        none.insert(V(j), np.zeros(3))
    for k in range(walk.nodes.bias[-1] + 1):
        values.insert(S(k), 0.01 * rng.standard_normal(1))
        none.insert(S(k), np.zeros(1))
    custom = [f for f in map(exact.graph.at, range(exact.graph.size())) if isinstance(f, gtsam.CustomFactor)]
    factors = [f for f in custom if f.size() == 3]  # and not those of rests
    assert len(factors) == len(walk.nodes)
    assert walk.velocities.error(values) == pytest.approx(sum(f.error(values) for f in factors), rel=1e-9)
    by_tie, by_factor = gtsam.GaussianFactorGraph(), gtsam.GaussianFactorGraph()
    for tie, factor in zip(linear_factors(walk.velocities, values), factors, strict=True):
        by_tie.push_back(tie)
        by_factor.push_back(factor.linearize(values))
    assert by_tie.error(none) == pytest.approx(by_factor.error(none), rel=1e-9)
    slope, expected = by_tie.gradientAtZero(), by_factor.gradientAtZero()
    for j in range(len(walk.nodes)):
        for key in (X(j), V(j)):
            np.testing.assert_allclose(slope.at(key), expected.at(key), rtol=1e-9, atol=1e-9)
    for k in range(walk.nodes.bias[-1] + 1):
        np.testing.assert_allclose(slope.at(S(k)), expected.at(S(k)), rtol=1e-9, atol=1e-9)


def stance_truth(walk: Walk) -> tuple[Floats, Floats]:
    """True velocity (N, 3) and attitude (N, 3, 3) of the sensor at all samples."""
    truth = walk.recording.truth
    return np.gradient(truth.position, truth.t, axis=0, edge_order=2), truth.nav_R_body


def at_nodes(one: Problem, name: str) -> Floats:
    return np.concatenate([getattr(stride.velocity, name) for stride in one.strides])


def inner_nodes(one: Problem) -> np.ndarray:
    """(M,) Whether a node stands inside a stance of the walk, neither at its ends nor in the rests."""
    interval = one.nodes.interval
    same = np.diff(interval) == 0
    inside = np.append(same, False) & np.insert(same, 0, False)
    return inside & (interval > 0) & (interval < interval[-1])


def test_lever_says_how_a_rolling_foot_moves() -> None:
    walk = noise_free(RIGID)
    one = problem(walk, replace(KNOWN, node_spacing_s=0.05))
    velocity, attitude = stance_truth(walk)
    inner = inner_nodes(one)
    sample = one.nodes.sample[inner]
    said = np.einsum("nij,nj->ni", attitude[sample], at_nodes(one, "body_velocity")[inner])
    assert inner.sum() > 50
    assert np.linalg.norm(said, axis=1).max() > 0.03
    # a node's rate is the mean about it, and changes in a landing and a lifting foot
    np.testing.assert_allclose(said, velocity[sample], atol=1.5e-3)
    assert np.sqrt(np.mean((said - velocity[sample]) ** 2)) < 4e-4


def test_sole_sinks_in_a_stance_of_the_walk_and_not_in_a_rest() -> None:
    walk = noise_free()
    one = problem(walk, SOFT)
    velocity, attitude = stance_truth(walk)
    inner = inner_nodes(one)
    sample, settling = one.nodes.sample[inner], at_nodes(one, "settling")
    rolling = np.einsum("nij,nj->ni", attitude[sample], at_nodes(one, "body_velocity")[inner])
    sinking = (velocity[sample] - rolling)[:, 2].mean()
    rest = np.isin(one.nodes.interval, [0, one.nodes.interval[-1]])
    assert np.all(settling[~rest, 2] < 0)
    assert not settling[rest].any()
    assert not settling[:, :2].any()
    assert 0.5 < settling[inner, 2].mean() / sinking < 2.0


def test_a_standing_in_pieces_sinks_no_more_than_in_one() -> None:
    walk = demo()
    s = walk.stances
    k = int(np.argmax((s.stop - s.start > 20) & (s.footfall > 0)))  # a stance of the walk, cut in two that touch
    middle = int(s.start[k] + s.stop[k]) // 2
    cut = replace(
        s,
        start=np.insert(s.start, k + 1, middle),
        stop=np.insert(s.stop, k, middle),
        footfall=np.append(s.footfall[: k + 1], s.footfall[k:] + 1),
    )
    strides = problem(Walk(walk.recording, cut), SOFT).strides
    first, second = (strides[s.footfall[k] + i] for i in (0, 1))
    assert first.velocity.settling.any()
    assert not second.velocity.settling.any()
    assert not second.velocity.sinks_per_m.any()


def test_a_sole_settles_once_in_a_footfall_though_its_stance_is_in_pieces() -> None:
    walk = demo()
    s = walk.stances
    k = int(np.argmax((s.stop - s.start > 60) & (s.footfall > 0)))  # a stance of the walk, torn in its middle
    middle = int(s.start[k] + s.stop[k]) // 2
    torn = replace(
        s,
        start=np.insert(s.start, k + 1, middle + 10),
        stop=np.insert(s.stop, k, middle - 10),
        footfall=np.insert(s.footfall, k, s.footfall[k]),
    )
    whole, pieces = (problem(Walk(walk.recording, stances), SOFT).strides for stances in (s, torn))
    footfall = int(s.footfall[k])
    per_m = whole[footfall].velocity.sinks_per_m[0]
    np.testing.assert_allclose(pieces[footfall].velocity.sinks_per_m, per_m)
    np.testing.assert_allclose(pieces[footfall].velocity.settling[:, 2], -SOFT.settling_m * per_m)


def test_velocities_are_firm_where_the_foot_is_still() -> None:
    """Three stances between swings: still, turning at 0.5 rad/s, pushed at 0.5 m/s^2 off gravity."""
    n, stances = 500, Stances.from_mask(np.isin(np.arange(500) // 100, [0, 2, 4]))
    acc, gyr = np.tile([0.0, 0.0, GRAVITY_M_S2], (n, 1)), np.zeros((n, 3))
    gyr[100:200, 1] = gyr[300:400, 1] = 4.0
    gyr[200:300, 1] = 0.5
    acc[400:, 2] += 0.5
    recording = Recording(t=np.arange(n) / 200.0, acc=acc, gyr=gyr)
    one = problem(Walk(recording, stances), KNOWN)
    sigma, p = at_nodes(one, "sigma"), DEFAULT
    expected = np.hypot(VELOCITY_SIGMA, np.array([0.0, 0.5 * p.roll_sigma_m, 0.5 * p.unsteady_s]))
    np.testing.assert_allclose(sigma[:, :2], np.repeat(expected[one.nodes.interval][:, None], 2, axis=1), rtol=1e-9)
    assert np.all(sigma[:, 2] > sigma[:, 0])  # how deep a sole sinks is not known


def test_velocity_in_stance_is_within_its_sigma() -> None:
    walk = noise_free()
    one = problem(walk)
    velocity, attitude = stance_truth(walk)
    sample = one.nodes.sample
    said = np.einsum("nij,nj->ni", attitude[sample], at_nodes(one, "body_velocity")) + at_nodes(one, "settling")
    z = (velocity[sample] - said) / at_nodes(one, "sigma")
    assert np.all(np.sqrt(np.mean(z**2, axis=0)) < 1.2)


def test_plain_zero_velocity_is_zero_and_equally_firm() -> None:
    one = problem(demo(), PLAIN)
    assert not at_nodes(one, "body_velocity").any()
    assert not at_nodes(one, "settling").any()
    np.testing.assert_allclose(at_nodes(one, "sigma"), VELOCITY_SIGMA, rtol=1e-6)


def test_every_node_is_reached_and_every_rest_is_told_once() -> None:
    one = problem(demo())
    assert sum(len(stride.measurements) for stride in one.strides) == len(one.nodes) - 1
    assert [stride.first for stride in one.strides] == list(one.nodes.first[:-1])
    rests = [rest for stride in one.strides for rest in stride.rests]
    assert len(rests) == 2
    assert len(one.strides[0].rests) == 1
    assert len(one.strides[-1].rests) == 1


def test_bias_walks_from_variable_to_variable() -> None:
    walk = demo()
    nodes = place_nodes(walk.recording, walk.stances, DEFAULT)
    one = problem(walk)
    keys = [key for key in one.initial.keys() if key >> 56 == ord("b")]  # noqa: SIM118 (gtsam.Values is no dict)
    assert keys == [B(k) for k in range(nodes.bias[-1] + 1)]
    graph = one.graph
    between = [f for f in map(graph.at, range(graph.size())) if isinstance(f, gtsam.BetweenFactorConstantBias)]
    assert len(between) == len(keys) - 1
    variance = sum(f.noiseModel().sigmas()[3] ** 2 for f in between)
    t = walk.recording.t[nodes.sample[nodes.result]]
    last = t[np.flatnonzero(np.diff(nodes.bias))[-1] + 1]
    assert np.sqrt(variance) == pytest.approx(np.radians(DEFAULT.gyro_bias_walk_deg_s) * np.sqrt(last - t[0]), rel=1e-6)


def test_inertial_factors_chain_the_nodes_each_with_the_bias_of_its_start() -> None:
    one = problem(demo())
    keys = [f.keys() for f in map(one.graph.at, range(one.graph.size())) if isinstance(f, gtsam.GalileanImuFactor)]
    bias = one.nodes.bias[one.nodes.footfall]
    assert keys == [[X(j), V(j), X(j + 1), V(j + 1), B(int(bias[j]))] for j in range(len(one.nodes) - 1)]


def functions_that_mention(name: str) -> Iterator[str]:
    """Names of the functions in the smoother that mention an attribute or call of this name."""
    for path in sorted(Path(fg_nav.smoother.__file__).parent.glob("*.py")):
        for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(function, ast.FunctionDef) and any(
                isinstance(node, ast.Attribute) and node.attr == name for node in ast.walk(function)
            ):
                yield function.name


def test_one_function_turns_a_stride_into_factors() -> None:
    assert list(functions_that_mention("GalileanImuFactor")) == ["_add_inertial"]
    assert list(functions_that_mention("BetweenFactorConstantBias")) == ["_add_sensor"]
    source = Path(fg_nav.smoother.__file__).parent
    calls = [path.name for path in source.glob("*.py") if "StanceVelocity(" in path.read_text(encoding="utf-8")]
    assert calls == ["strides.py"]
    assert not list(functions_that_mention("body_velocity"))


def test_a_walk_is_its_strides_one_after_the_other() -> None:
    """The graph of the first strides is the beginning of the graph of more: what a smoother online adds."""
    few, more = problem(part(demo(), 4)), problem(part(demo(), 6))
    assert few.graph.size() < more.graph.size()
    for i in range(few.graph.size()):
        assert few.graph.at(i).keys() == more.graph.at(i).keys()
