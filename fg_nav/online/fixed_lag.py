"""The graph of the last minutes of a walk, with what came before as a prior: a fixed lag, and a memory that is bounded.

All factors of the window are linearised and solved together with every footfall, as in batch: Gauss-Newton on a minute
of walking costs as much as what is saved by leaving parts of it as they are. A footfall that is older than the lag
leaves, and stays as a prior (`online_leaving`).
"""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, X

from fg_nav.arrays import Floats
from fg_nav.online.isam2 import ATTITUDE_RAD, MOST_UPDATES, weak_priors
from fg_nav.online.marginalise import frozen_of, keys_of, without
from fg_nav.online.strides import Frozen, Place, order_of
from fg_nav.smoother.covariances import marginal_covariances


class LaggedGraph:
    """The factors of the last `lag_s` seconds and where their variables are now."""

    def __init__(self, lag_s: float) -> None:
        self._lag_s = lag_s
        self._factors: list[gtsam.NonlinearFactor] = []
        self._values = gtsam.Values()
        self._places: list[Place] = []
        self._tree = gtsam.GaussianBayesTree()
        self._covariances: dict[int, Floats] = {}
        self._left: list[Frozen] = []

    def restart(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, places: list[Place]) -> None:
        """Begin again from a graph of these footfalls at its minimum; all stays as it was where that raises."""
        anew = LaggedGraph(self._lag_s)
        anew._factors = [graph.at(i) for i in range(graph.size())]
        anew._values = gtsam.Values(values)
        anew._places = list(places)
        anew._step()
        anew._leave()
        self.__dict__.update(anew.__dict__)

    def add(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, places: list[Place], more: bool = False
    ) -> None:
        """Add factors, and the variables that are new in them.

        Parameters
        ----------
        places : the last of them is the newest.
        more : whether another part of the same footfall follows, so that nothing needs to be solved yet.

        Raises
        ------
        RuntimeError
            Where there is no solution, with weak priors on all variables either: then `restart`.
        """
        self._factors += [graph.at(i) for i in range(graph.size())]
        self._values.insert(values)
        if places[-1].number != self._places[-1].number:
            self._places.append(places[-1])
        if more:
            return
        for _ in range(MOST_UPDATES):
            if self._step() <= ATTITUDE_RAD:
                break
        self._leave()

    def left(self) -> list[Frozen]:
        """Return the footfalls that left since this was last asked."""
        left, self._left = self._left, []
        return left

    def pose(self, key: int) -> gtsam.Pose3:
        """Return a pose as now known."""
        return self._values.atPose3(key)

    def vector(self, key: int) -> Floats:
        """Return a vector as now known."""
        return np.asarray(self._values.atVector(key))

    def bias(self, key: int) -> gtsam.imuBias.ConstantBias:
        """Return a bias as now known."""
        return self._values.atConstantBias(key)

    def covariance(self, key: int) -> Floats:
        """Return the marginal covariance of the pose of a footfall's result, or of a bias."""
        if not self._covariances:
            keys = {key for place in self._places for key in (X(place.result), B(place.bias))}
            self._covariances = marginal_covariances(self._tree, keys)
        return self._covariances[key]

    def begun_at(self) -> gtsam.Values:
        """Return where the variables are linearised; new ones begin from there, not to be copied."""
        return self._values

    def solution(self, places: list[Place]) -> tuple[gtsam.Values, dict[int, Floats]]:
        """Return the values of the window, and the covariances of poses and biases at its footfalls."""
        keys = {key for place in places for key in (X(place.result), B(place.bias))}
        return self._values, {key: self.covariance(key) for key in keys}

    def _step(self) -> float:
        """Take a Gauss-Newton step; the largest turn of a pose in it, rad."""
        graph = gtsam.NonlinearFactorGraph()
        for factor in self._factors:
            graph.push_back(factor)
        order = order_of(self._places, self._values)
        try:
            step = self._solve(graph, order)
        except RuntimeError:
            weak = weak_priors(self._values)
            self._factors += [weak.at(i) for i in range(weak.size())]
            graph.push_back(weak)
            step = self._solve(graph, order)
        self._values = self._values.retract(step)
        self._covariances = {}
        turns = [np.abs(step.at(X(place.result))[:3]).max() for place in self._places]
        return float(max(turns))

    def _solve(self, graph: gtsam.NonlinearFactorGraph, order: gtsam.Ordering) -> gtsam.VectorValues:
        self._tree = graph.linearize(self._values).eliminateMultifrontal(order, gtsam.EliminateQR)
        return self._tree.optimize()

    def _leave(self) -> None:
        """Let go of what is older than the lag."""
        oldest = self._places[-1].t - self._lag_s
        while len(self._places) > 2 and self._places[0].t < oldest:
            place, after = self._places[0], self._places[1]
            self.covariance(X(place.result))
            self._left.append(frozen_of(place, self._values, self._covariances))
            keys = keys_of(place, after, self._values)
            self._factors = without(self._factors, self._values, keys)
            for key in keys:
                self._values.erase(key)
            self._places.pop(0)
