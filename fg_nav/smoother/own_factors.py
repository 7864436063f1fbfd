"""Factors that the caller adds to the graph of a walk: from the variables of its nodes to a graph of gtsam.

They join the walk where fixes do, on its first solution: what is found before that (noise of the swings, lever, random
walk of the bias) rests on the sensor alone, and all rounds after it, sigmas included, have them.

What they show of the heading at the start is what they say against a turn of the whole walk about the vertical at its
start. With A d the change of their residuals over their sigmas for a turn d of one radian, linearized at the walk,

    sigma^-2 = |A d|^2,     d = (R^T u, R^T (u x p)) of a pose, u x v of a velocity, 0 of a bias, u up,

which for fixes is the formula in `constraints`; where that is less than what is known, the heading is freed as there.
Without a heading that was given the walk is first turned to where the error is least, of `TURNS` directions.

A robust noise model is linearized by the weight that it has there (iteratively reweighted least squares): its loss is
not the half square of that, and the difference `excess` is told to the solver, which compares the two.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.frames import yaw_rotation
from fg_nav.smoother.solver import GtsamFactors
from fg_nav.smoother.strides import Nodes

REACH_S = 1.5  # Farther than a stride from any node there is nothing to tie a factor to.
TURNS = 24  # Directions of the start that are tried: 15 deg apart, from which Gauss-Newton finds the rest.

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class GraphNodes:
    """The variables of a walk that a factor can join: M nodes, where the foot stands, several in each stance.

    Attributes
    ----------
    t : (M,) s, in the recording's time.
    pose : M keys of `gtsam.Pose3`, nav_T_body: east, north, up in m from the first stance.
    velocity : M keys of vectors (3,), m/s, navigation frame.
    bias : M keys of `gtsam.imuBias.ConstantBias`, m/s^2 and rad/s, body frame; footfalls of ten seconds share one.
    footfall : (M,) number of the footfall that the node belongs to, from 0.
    stillest : (F,) node of each footfall at its stillest sample, where results are given.
    values : all variables of the walk without these factors, near its minimum: to place them. A copy.

    Examples
    --------
    >>> import gtsam
    >>> def at_the_door(nodes: fg_nav.GraphNodes) -> gtsam.NonlinearFactorGraph:
    ...     graph = gtsam.NonlinearFactorGraph()
    ...     sigmas = gtsam.noiseModel.Diagonal.Sigmas([0.1, 0.1, 10.0])
    ...     graph.add(gtsam.GPSFactor(nodes.pose[nodes.at(18.0)], [10.3, 7.7, 0.0], sigmas))
    ...     return graph
    >>> result = fg_nav.navigate("walk.csv", extra=at_the_door)
    >>> bool(result.stances.position_sigma[-1, 0] < 1.0)
    True
    """

    t: Floats
    pose: tuple[int, ...]
    velocity: tuple[int, ...]
    bias: tuple[int, ...]
    footfall: Ints
    stillest: Ints
    values: gtsam.Values

    @classmethod
    def of(cls, nodes: Nodes, t: Floats, values: gtsam.Values) -> GraphNodes:
        """Take those of a walk, `t` (N,) s the stamps of its recording."""
        count = range(len(nodes))
        bias = tuple(B(int(k)) for k in nodes.bias[nodes.footfall])
        pose, velocity = tuple(map(X, count)), tuple(map(V, count))
        return cls(t[nodes.sample], pose, velocity, bias, nodes.footfall, nodes.result, gtsam.Values(values))

    def at(self, time_s: float) -> int:
        """Return the number of the node nearest to an instant; `EstimationError` more than 1.5 s from any."""
        apart = np.abs(self.t - time_s)
        if not apart.min() <= REACH_S:
            raise EstimationError(
                f"there is no node within {REACH_S:g} s of {time_s:.2f} s: the walk lasts from {self.t[0]:.2f} s to "
                f"{self.t[-1]:.2f} s, and has nodes where the foot stands."
            )
        return int(apart.argmin())


ExtraFactors: TypeAlias = Callable[[GraphNodes], gtsam.NonlinearFactorGraph]
"""Makes the caller's own factors. It is called again whenever a walk is built again, with nodes that may differ."""


class OwnFactors(GtsamFactors):
    """The caller's factors in the graph of a walk."""

    def __init__(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        super().__init__(*(graph.at(i) for i in range(graph.size())))
        self.heading_sigma = _find_heading_sigma(self._graph, values)
        """Sigma that they leave of the heading at the start, rad; infinite where they show nothing of it."""

    def __len__(self) -> int:
        return int(self._graph.size())

    def excess(self, values: gtsam.Values) -> float:
        """By how much their loss is more than half the square of the linearized residuals."""
        linear = self._graph.linearize(values)
        return self.error(values) - linear.error(_move(self._graph, values, 0.0))

    def best_turn(self, values: gtsam.Values) -> float:
        """Turn about up and the start, rad counter-clockwise, of `TURNS`, that fits a walk best to them."""
        turns = np.linspace(0.0, 2 * np.pi, TURNS, endpoint=False)
        errors = [self.error(_turned(self._graph, values, turn)) for turn in yaw_rotation(turns)]
        return float(turns[int(np.nanargmin(errors))])


def make_own_factors(extra: ExtraFactors, nodes: GraphNodes) -> OwnFactors:
    """Ask for the caller's factors, and check them.

    Raises
    ------
    EstimationError
        If they are no graph, join what is no variable of the walk, or cannot be evaluated at its values.
    """
    graph = extra(nodes)
    if not isinstance(graph, gtsam.NonlinearFactorGraph):
        raise EstimationError(f"extra returned a {type(graph).__name__}: return a gtsam.NonlinearFactorGraph.")
    known = {*nodes.pose, *nodes.velocity, *nodes.bias}
    for i in range(graph.size()):
        _check_factor(i, graph.at(i), known, nodes.values)
    return OwnFactors(graph, nodes.values)


def _check_factor(i: int, factor: gtsam.NonlinearFactor | None, known: set[int], values: gtsam.Values) -> None:
    if factor is None:
        raise EstimationError(f"extra factor {i} is none: add no empty places to the graph.")
    joins = factor.keys()
    if not joins:
        raise EstimationError(f"extra factor {i} joins no variable: leave it out.")
    for key in joins:
        if key not in known:
            raise EstimationError(
                f"extra factor {i} joins {gtsam.DefaultKeyFormatter(key)}, which is no variable of this walk: use the "
                "keys in pose, velocity and bias of the nodes."
            )
    try:
        error = factor.error(values)
        linear = factor.linearize(values)
        if linear is not None:  # one that is not active there
            gtsam.JacobianFactor(linear)
    except Exception as reason:
        words = " ".join(str(reason).split())
        raise EstimationError(f"extra factor {i} cannot be linearized ({words}): correct it.") from reason
    if not np.isfinite(error):
        raise EstimationError(
            f"the error of extra factor {i} is {error}: give finite measurements and sigmas above zero."
        )


def _find_heading_sigma(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> float:
    linear = graph.linearize(values)
    forth, here, back = (linear.error(_move(graph, values, turn)) for turn in (1.0, 0.0, -1.0))
    information = float(forth - 2.0 * here + back)
    return information**-0.5 if information > 0.0 else float("inf")


def _move(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, turn: float) -> gtsam.VectorValues:
    """Move the variables of a graph, in their tangent spaces, by a small turn of the walk about its start."""
    moved = gtsam.VectorValues()
    for key in _keys(graph):
        letter = gtsam.Symbol(key).chr()
        step = np.zeros(6)
        if letter == ord("x"):
            pose = values.atPose3(key)
            R = pose.rotation().matrix()
            step = np.concatenate([R.T @ UP, R.T @ np.cross(UP, pose.translation())])
        elif letter == ord("v"):
            step = np.cross(UP, values.atVector(key))
        moved.insert(key, turn * step)
    return moved


def _turned(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, turn: Floats) -> gtsam.Values:
    """Values of the variables of a graph where the walk is turned about its start by a rotation (3, 3)."""
    turned, about = gtsam.Values(), gtsam.Pose3(gtsam.Rot3(turn), np.zeros(3))
    for key in _keys(graph):
        letter = gtsam.Symbol(key).chr()
        if letter == ord("x"):
            turned.insert(key, about.compose(values.atPose3(key)))
        elif letter == ord("v"):
            turned.insert(key, turn @ values.atVector(key))
        else:
            turned.insert(key, values.atConstantBias(key))
    return turned


def _keys(graph: gtsam.NonlinearFactorGraph) -> list[int]:
    return list(graph.keyVector())
