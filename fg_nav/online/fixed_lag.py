"""The graph of the last minutes of a walk: a fixed-lag smoother, whose memory is bounded.

All factors of the window are linearized and solved together with every footfall, as in batch: Gauss-Newton on a minute
of walking costs as much as incremental updates of it would save. A footfall that is older than the lag is marginalized
(`backend`).
"""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats
from fg_nav.online.backend import (
    Marginalized,
    join_factors,
    leaving_keys,
    list_factors,
    marginalize,
    order_variables,
    record_footfall,
    result_keys,
    weak_priors,
)
from fg_nav.online.isam2 import ATTITUDE_RAD, MOST_UPDATES
from fg_nav.online.strides import Place
from fg_nav.smoother.solver import marginal_covariances


class FixedLagBackend:
    """The factors of the last `lag_s` seconds and their solution; methods as in `Backend`."""

    def __init__(self, lag_s: float) -> None:
        self._lag_s = lag_s
        self._factors: list[gtsam.NonlinearFactor] = []
        self._values = gtsam.Values()
        self._places: list[Place] = []
        self._tree = gtsam.GaussianBayesTree()
        self._covariances: dict[int, Floats] = {}
        self._marginalized: list[Marginalized] = []

    def reset(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, places: list[Place]) -> None:
        """Begin again from a graph of these footfalls at its minimum."""
        fresh = FixedLagBackend(self._lag_s)
        fresh._factors = list_factors(graph)
        fresh._values = gtsam.Values(values)
        fresh._places = list(places)
        fresh._step()
        fresh._marginalize_oldest()
        self.__dict__.update(fresh.__dict__)

    def add(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, places: list[Place], more: bool = False
    ) -> None:
        """Add factors and their new variables, and solve unless more of the same footfall follows."""
        self._factors += list_factors(graph)
        self._values.insert(values)
        if places[-1].number != self._places[-1].number:
            self._places.append(places[-1])
        if more:
            return
        # Iterate until the poses stay at their linearization point.
        for _ in range(MOST_UPDATES):
            if self._step() <= ATTITUDE_RAD:
                break
        self._marginalize_oldest()

    def take_marginalized(self) -> list[Marginalized]:
        """Return the footfalls that left since the last call."""
        marginalized, self._marginalized = self._marginalized, []
        return marginalized

    def pose(self, key: int) -> gtsam.Pose3:
        """Return the estimate of a pose."""
        return self._values.atPose3(key)

    def vector(self, key: int) -> Floats:
        """Return the estimate of a vector."""
        return np.asarray(self._values.atVector(key))

    def bias(self, key: int) -> gtsam.imuBias.ConstantBias:
        """Return the estimate of a bias."""
        return self._values.atConstantBias(key)

    def covariance(self, key: int) -> Floats:
        """Return the marginal covariance of the pose of a footfall's result, or of a bias."""
        if not self._covariances:
            self._covariances = marginal_covariances(self._tree, result_keys(self._places))
        return self._covariances[key]

    def linearization_point(self) -> gtsam.Values:
        """Return the values at which the variables are linearized."""
        return self._values

    def solution(self, places: list[Place]) -> tuple[gtsam.Values, dict[int, Floats]]:
        """Return the values of the window, and the covariances of poses and biases at its footfalls."""
        return self._values, {key: self.covariance(key) for key in result_keys(places)}

    def _step(self) -> float:
        """Take a Gauss-Newton step; the largest turn of a pose in it, rad."""
        graph, order = join_factors(self._factors), order_variables(self._places, self._values)
        try:
            step = self._solve(graph, order)
        except RuntimeError:
            weak = weak_priors(self._values)
            self._factors += list_factors(weak)
            graph.push_back(weak)
            step = self._solve(graph, order)
        self._values = self._values.retract(step)
        self._covariances = {}
        turns = [np.abs(step.at(X(place.result))[:3]).max() for place in self._places]
        return float(max(turns))

    def _solve(self, graph: gtsam.NonlinearFactorGraph, order: gtsam.Ordering) -> gtsam.VectorValues:
        self._tree = graph.linearize(self._values).eliminateMultifrontal(order, gtsam.EliminateQR)
        return self._tree.optimize()

    def _marginalize_oldest(self) -> None:
        """Marginalize the footfalls that are older than the lag."""
        oldest = self._places[-1].t - self._lag_s
        while len(self._places) > 2 and self._places[0].t < oldest:
            place, after = self._places[0], self._places[1]
            self.covariance(X(place.result))
            self._marginalized.append(record_footfall(place, self._values, self._covariances))
            keys = leaving_keys(place, after, self._values)
            self._factors = marginalize(self._factors, self._values, keys)
            for key in keys:
                self._values.erase(key)
            self._places.pop(0)
