"""What both backends of a walk in progress have in common: `Backend`, and how variables leave a graph.

A footfall that leaves takes its nodes and its state of the field with it, and the bias and the settling that it shares
with others only when the next footfall has another: what is still in use never leaves. Its variables are marginalized:
QR eliminates them from the factors on them, and the remaining Gaussian on the other variables (the Schur complement of
the information matrix) is kept as a linear factor at these values. Nothing is lost but the choice to relinearize it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, Protocol

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, S, V, X

from fg_nav.arrays import Floats
from fg_nav.online.strides import Place
from fg_nav.smoother.solver import DIMENSION


class Marginalized(NamedTuple):
    """A footfall as it left: pose, velocity, bias, and the covariances of pose and bias."""

    place: Place
    pose: gtsam.Pose3
    velocity: Floats
    bias: gtsam.imuBias.ConstantBias
    pose_cov: Floats
    bias_cov: Floats


class Backend(Protocol):
    """A graph of footfalls that is solved again with each of them: `ISAM2Backend`, `FixedLagBackend`."""

    def reset(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, places: list[Place]) -> None:
        """Begin again from a graph of these footfalls at its minimum; all stays as it was where that raises."""

    def add(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, places: list[Place], more: bool = False
    ) -> None:
        """Add factors, and the variables that are new in them.

        Parameters
        ----------
        places : of the walk so far; the last of them is the newest.
        more : whether another part of the same footfall follows, so that none leaves yet.

        Raises
        ------
        RuntimeError
            Where there is no solution, with weak priors either.
        """

    def pose(self, key: int) -> gtsam.Pose3:
        """Return the estimate of a pose."""

    def vector(self, key: int) -> Floats:
        """Return the estimate of a vector."""

    def bias(self, key: int) -> gtsam.imuBias.ConstantBias:
        """Return the estimate of a bias."""

    def covariance(self, key: int) -> Floats:
        """Return the marginal covariance of the pose of a footfall's result, or of a bias, in its tangent space."""

    def linearization_point(self) -> gtsam.Values:
        """Return the values at which the variables are linearized; new ones start from there. Not to be copied."""

    def solution(self, places: list[Place]) -> tuple[gtsam.Values, dict[int, Floats]]:
        """Return the estimates of all variables, and the covariances of poses and biases at the footfalls."""

    def take_marginalized(self) -> list[Marginalized]:
        """Return the footfalls that left since the last call."""


def result_keys(places: Iterable[Place]) -> set[int]:
    """Keys of the poses and biases that are reported of footfalls."""
    return {key for place in places for key in (X(place.result), B(place.bias))}


def order_variables(places: list[Place], values: gtsam.Values) -> gtsam.Ordering:
    """Order in which the variables of some footfalls in a row are eliminated, as `solver.time_order`.

    With the states of the field where there are any among the values.
    """
    ordering = gtsam.Ordering()
    for k, place in enumerate(places):
        for j in range(place.first, place.stop):
            ordering.push_back(X(j))
            ordering.push_back(V(j))
            if j == place.result and values.exists(M(place.number)):
                ordering.push_back(M(place.number))
        if k + 1 == len(places) or places[k + 1].bias != place.bias:
            ordering.push_back(B(place.bias))
            ordering.push_back(S(place.bias))
    return ordering


def leaving_keys(place: Place, after: Place, values: gtsam.Values) -> list[int]:
    """Variables that leave with a footfall when `after` is the next, in the order of time."""
    keys = [key for j in range(place.first, place.stop) for key in (X(j), V(j))]
    keys += [M(place.number)] if values.exists(M(place.number)) else []
    return keys + ([B(place.bias), S(place.bias)] if after.bias != place.bias else [])


def record_footfall(place: Place, values: gtsam.Values, covariances: Mapping[int, Floats]) -> Marginalized:
    """Return a footfall as it leaves."""
    pose_key, bias_key = X(place.result), B(place.bias)
    return Marginalized(
        place,
        values.atPose3(pose_key),
        np.asarray(values.atVector(V(place.result))),
        values.atConstantBias(bias_key),
        covariances[pose_key],
        covariances[bias_key],
    )


def marginalize(
    factors: Iterable[gtsam.NonlinearFactor], values: gtsam.Values, keys: Sequence[int]
) -> list[gtsam.NonlinearFactor]:
    """Return factors without these variables, with the same information on the others.

    Raises
    ------
    RuntimeError
        Where the factors do not determine the variables.
    """
    leaving, touching, others = set(keys), gtsam.NonlinearFactorGraph(), []
    for factor in factors:
        if leaving.isdisjoint(factor.keys()):
            others.append(factor)
        else:
            touching.push_back(factor)
    order = gtsam.Ordering()
    for key in keys:
        order.push_back(key)
    _, remaining = touching.linearize(values).eliminatePartialMultifrontal(order, gtsam.EliminateQR)
    parts = (remaining.at(i) for i in range(remaining.size()))
    return others + [
        gtsam.LinearContainerFactor(part, _select_values(values, part.keys())) for part in parts if part is not None
    ]


def _select_values(values: gtsam.Values, keys: Iterable[int]) -> gtsam.Values:
    """Values of some variables alone."""
    some = gtsam.Values()
    for key in keys:
        letter = chr(gtsam.Symbol(key).chr())
        if letter == "x":
            some.insert(key, values.atPose3(key))
        elif letter == "b":
            some.insert(key, values.atConstantBias(key))
        else:
            some.insert(key, values.atVector(key))
    return some


def weak_priors(values: gtsam.Values) -> gtsam.NonlinearFactorGraph:
    """Priors so wide that they make the equations solvable and no more: a hundred metres, of anything."""
    graph = gtsam.NonlinearFactorGraph()
    for key in list(values.keys()):
        letter = chr(gtsam.Symbol(key).chr())
        wide = gtsam.noiseModel.Diagonal.Sigmas(weak_sigmas(key))
        if letter == "x":
            graph.addPriorPose3(key, values.atPose3(key), wide)
        elif letter == "b":
            graph.addPriorConstantBias(key, values.atConstantBias(key), wide)
        else:
            graph.addPriorVector(key, values.atVector(key), wide)
    return graph


def weak_sigmas(key: int) -> Floats:
    """Sigmas of a weak prior on a variable, in its tangent space."""
    letter = gtsam.Symbol(key).chr()
    if letter == ord("x"):
        return np.repeat([3.0, 100.0], 3)
    return np.full(DIMENSION[letter], 1.0 if letter == ord("b") else 100.0)


def list_factors(graph: gtsam.NonlinearFactorGraph) -> list[gtsam.NonlinearFactor]:
    """Factors of a graph."""
    return [graph.at(i) for i in range(graph.size())]


def join_factors(factors: Iterable[gtsam.NonlinearFactor]) -> gtsam.NonlinearFactorGraph:
    """Graph of factors."""
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.push_back(factor)
    return graph
