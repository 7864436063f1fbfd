"""Parts of the graph of a walk in progress: its variables in the order of time, and priors that make it solvable."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, P, S, V, X

from fg_nav.arrays import Floats
from fg_nav.online.strides import Place
from fg_nav.smoother.gauss_newton import DIMENSION


def result_keys(places: Iterable[Place]) -> set[int]:
    """Keys of the poses and biases that are reported of footfalls."""
    return {key for place in places for key in (X(place.result), B(place.bias))}


def list_variables(place: Place, values: gtsam.Values) -> list[int]:
    """Variables of a footfall, with the bias and the settling that it shares with others; those with a value."""
    keys = [key for j in range(place.first, place.stop) for key in (X(j), V(j))]
    others = (M(place.number), P(place.number), B(place.bias), S(place.bias))
    return [key for key in (*keys, *others) if values.exists(key)]


def order_variables(places: Sequence[Place], values: gtsam.Values) -> list[int]:
    """Variables of some footfalls in a row in the order in which they are eliminated, as `solver.list_in_time`."""
    keys = {}
    for place in reversed(places):
        keys.update(dict.fromkeys(reversed(list_variables(place, values))))
    return list(reversed(keys))


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
