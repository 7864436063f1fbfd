"""What leaves a graph stays in it as a prior.

A footfall that leaves takes its nodes and its state of the field with it, and the bias and the settling that it shares
with others only when the next footfall has another: what is still in use never leaves. Its variables are eliminated by
QR from the factors that touch them, and what this leaves on the variables that stay is kept as a linear factor at these
values. Nothing is lost but the choice to linearise it again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, S, V, X

from fg_nav.arrays import Floats
from fg_nav.online.strides import Frozen, Place


def keys_of(place: Place, after: Place, values: gtsam.Values) -> list[int]:
    """Variables that leave with a footfall when `after` is the next, in the order of time."""
    keys = [key for j in range(place.first, place.stop) for key in (X(j), V(j))]
    keys += [M(place.number)] if values.exists(M(place.number)) else []
    return keys + ([B(place.bias), S(place.bias)] if after.bias != place.bias else [])


def frozen_of(place: Place, values: gtsam.Values, covariances: Mapping[int, Floats]) -> Frozen:
    """Return a footfall as it leaves."""
    pose_key, bias_key = X(place.result), B(place.bias)
    return Frozen(
        place,
        values.atPose3(pose_key),
        np.asarray(values.atVector(V(place.result))),
        values.atConstantBias(bias_key),
        covariances[pose_key],
        covariances[bias_key],
    )


def without(
    factors: Iterable[gtsam.NonlinearFactor], values: gtsam.Values, keys: Sequence[int]
) -> list[gtsam.NonlinearFactor]:
    """Return factors that say the same of the other variables; raises `RuntimeError` where that cannot be told."""
    going, touching, others = set(keys), gtsam.NonlinearFactorGraph(), []
    for factor in factors:
        if going.isdisjoint(factor.keys()):
            others.append(factor)
        else:
            touching.push_back(factor)
    order = gtsam.Ordering()
    for key in keys:
        order.push_back(key)
    _, remaining = touching.linearize(values).eliminatePartialMultifrontal(order, gtsam.EliminateQR)
    left = (remaining.at(i) for i in range(remaining.size()))
    return others + [gtsam.LinearContainerFactor(part, _some(values, part.keys())) for part in left if part is not None]


def _some(values: gtsam.Values, keys: Iterable[int]) -> gtsam.Values:
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
