"""Factors of the caller's own in the graph of a walk: what they do, and which are refused."""

from collections.abc import Callable, Sequence
from functools import cache

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.factors import guarded_factor
from fg_nav.smoother import ExtraFactors, GraphNodes, SmoothedWalk, smooth_graph
from fg_nav.solution import Solution
from fg_nav.truth import Fix
from tests.smoother.walks import DEFAULT, demo, part

SIGMA_M = 0.05
FOOTFALLS = 16


def smoothed(extra: ExtraFactors | None = None, heading: float | None = 0.0, fixes: Sequence[Fix] = ()) -> SmoothedWalk:
    walk = part(demo(), FOOTFALLS)
    return smooth_graph(walk.recording, walk.stances, DEFAULT, heading, fixes=fixes, extra=extra)


@cache
def free() -> Solution:
    return smoothed().solution


@cache
def fixed(heading: float | None) -> Solution:
    fix = Fix(float(free().stances.t[-1]), place(), SIGMA_M, SIGMA_M)
    return smoothed(heading=heading, fixes=[fix]).solution


def place() -> Floats:
    """Of the last footfall, to pin it to: a step to the side of where it is without."""
    return free().stances.position[-1] + np.array([0.3, -0.2, 0.1])


def joined(*factors: gtsam.NonlinearFactor) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.push_back(factor)
    return graph


def last_of(nodes: GraphNodes) -> int:
    return nodes.pose[nodes.stillest[-1]]


def at_place(nodes: GraphNodes) -> gtsam.NonlinearFactorGraph:
    return joined(gtsam.GPSFactor(last_of(nodes), place(), gtsam.noiseModel.Isotropic.Sigma(3, SIGMA_M)))


def at_place_in_python(nodes: GraphNodes) -> gtsam.NonlinearFactorGraph:
    key = last_of(nodes)

    def evaluate(values: gtsam.Values, _: bool) -> tuple[Floats, list[Floats]]:
        pose = values.atPose3(key)
        return pose.translation() - place(), [np.hstack([np.zeros((3, 3)), pose.rotation().matrix()])]

    noise = gtsam.noiseModel.Isotropic.Sigma(3, SIGMA_M)
    return joined(guarded_factor("a place", [key], [6], noise, evaluate))


@pytest.mark.parametrize("heading", [0.0, None], ids=["heading given", "heading not given"])
@pytest.mark.parametrize("extra", [at_place, at_place_in_python])
def test_a_position_is_worth_what_a_fix_there_is(extra: ExtraFactors, heading: float | None) -> None:
    own, table = smoothed(extra, heading).solution, fixed(heading).stances
    np.testing.assert_allclose(own.stances.position, table.position, atol=1e-3)
    np.testing.assert_allclose(own.stances.position_cov, table.position_cov, rtol=2e-2, atol=1e-7)
    np.testing.assert_allclose(own.stances.heading_sigma, table.heading_sigma, rtol=2e-2)
    assert own.graph["own"] == 1
    assert np.abs(own.stances.position[-1] - place()).max() < 2 * SIGMA_M


def test_a_start_that_is_known_elsewhere_turns_the_walk() -> None:
    """A walk without a heading is turned to its factors, however far."""
    table = free().stances
    turned = table.position[[8, -1]] @ np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])

    def along(nodes: GraphNodes) -> gtsam.NonlinearFactorGraph:
        noise = gtsam.noiseModel.Isotropic.Sigma(3, SIGMA_M)
        keys = [nodes.pose[nodes.at(float(t))] for t in table.t[[8, -1]]]
        return joined(*(gtsam.GPSFactor(key, at, noise) for key, at in zip(keys, turned, strict=True)))

    found = smoothed(along, heading=None).solution
    np.testing.assert_allclose(found.stances.position[[8, -1]], turned, atol=2 * SIGMA_M)


def test_the_graph_at_hand_is_the_one_that_was_solved() -> None:
    walk = smoothed(at_place)
    gradient = walk.graph.linearize(walk.values).gradientAtZero()
    curvature = walk.find_covariance(last_of(walk.nodes))
    step = np.sqrt(np.diag(curvature)) * np.abs(gradient.at(last_of(walk.nodes)))
    assert step.max() < 0.05  # sigmas from the minimum
    nav_R_body = walk.solution.stances.nav_R_body[-1]
    np.testing.assert_allclose(
        nav_R_body @ curvature[3:, 3:] @ nav_R_body.T, walk.solution.stances.position_cov[-1], rtol=1e-9
    )
    with pytest.raises(EstimationError, match="no variable l3"):
        walk.find_covariance(L(3))


UNIT, NOWHERE = gtsam.noiseModel.Unit.Create(3), np.full(3, np.nan)


REFUSED: dict[str, Callable[[GraphNodes], object]] = {
    "returned a list: return a gtsam.NonlinearFactorGraph": lambda nodes: [at_place(nodes).at(0)],
    "joins l7, which is no variable of this walk": lambda _: joined(gtsam.GPSFactor(L(7), np.zeros(3), UNIT)),
    "cannot be linearized": lambda nodes: joined(gtsam.GPSFactor(nodes.velocity[0], np.zeros(3), UNIT)),
    "error of extra factor 0 is nan": lambda nodes: joined(gtsam.GPSFactor(nodes.pose[0], NOWHERE, UNIT)),
    "extra factor 0 joins no variable": lambda _: joined(gtsam.CustomFactor(UNIT, [], lambda *_: np.zeros(3))),
    "no node within 1.5 s of 10000.00 s": lambda nodes: at_place(nodes) if nodes.at(1e4) else None,
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_join_is_refused(words: str) -> None:
    with pytest.raises(EstimationError, match=words):
        smoothed(REFUSED[words])  # type: ignore[arg-type]
