"""The graph of a walk, solved again with every footfall: iSAM2.

What a new footfall changes is eliminated anew, and what does not change stays. Four things make that quick and true:

* Relinearisation by attitude. Position and velocity enter the equations linearly once they are written in the body's
  axes; a heading that moved by a does not, and to leave it costs a^2/2 of each stride. Thresholds are for attitude,
  bias and field; positions may move by any amount. They are looked for from the newest footfall backward, as far as
  they are passed, so that what is relinearised is one stretch, and looking costs nothing.
* New variables begin where the footfall before is linearised, not where it is now known (`first_values`). Otherwise
  each new one would be linearised at another heading than those before it, and none would ever pass a threshold.
* The linearisation point is held alive in Python. pybind then hands the same object to every factor written in Python;
  else each of them would be given a copy of all values at each call.
* QR: the information of a bias over hours and of a node over milliseconds differ by more than Cholesky bears.

An update after which the newest footfall has turned from where it is linearised is repeated, but not often, so that the
time that a footfall takes is bounded. Where the equations have no unique solution the graph is built anew with weak
priors on what was added last; where that has none either, the walk goes on without its past (`online_restart`).

The cost of an update grows with the variables there are, and the tree of a chain of hours is so deep that to let go of
it overflows the stack. So when there are `MOST_FOOTFALLS` the older half leaves (`online_leaving`): what is told of it
stays as it is then, until the walk is solved in batch at its end.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import pairwise

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, S, V, X

from fg_nav.arrays import Floats
from fg_nav.online.marginalise import frozen_of, keys_of, without
from fg_nav.online.strides import Frozen, Place, order_of
from fg_nav.smoother.covariances import DIMENSION, marginal_covariances
from fg_nav.smoother.solver import UNSOLVED

ATTITUDE_RAD = 0.005
"""0.3 deg: half its square is 12 millionths of a stride's length."""

BIAS = (0.1, 2e-3)
"""m/s^2 and rad/s: over a stride 0.1 deg, of which the inertial measurements know the first derivative."""

FIELD = (20.0, 20.0, 20.0, 0.2, 0.2, 1.0, 1.0, 1.0)
"""uT m and uT: only the mean field, in the middle, multiplies something large; 0.2 uT of it are 0.6 deg."""

ANYTHING = 1e6
"""For what enters linearly."""

WILDFIRE = 0.05
"""Steps (m, rad, uT) below which a change is not carried on into the past, while nobody asks. The newest footfalls
are at the root, where it makes no difference; at 0.01 each footfall moved all states of the field behind it."""

MOST_FOOTFALLS = 2000
"""In the graph: forty minutes of walking, of which the last twenty at least are corrected."""

MOST_UPDATES = 3

IN_ORDER = 3
"""Last footfalls whose variables are eliminated in the order of time; ccolamd wants more variables than groups. Left to
itself the ordering may turn a stretch of the walk about, newest first: then all of it lies between the newest footfall
and the root, and is eliminated anew at each.
"""


def isam_parameters() -> gtsam.ISAM2Params:
    """Return the parameters of iSAM2."""
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR")
    parameters.setOptimizationParams(gtsam.ISAM2GaussNewtonParams(WILDFIRE))
    parameters.relinearizeSkip = 1
    parameters.enablePartialRelinearizationCheck = True
    thresholds = gtsam.ISAM2ThresholdMap()
    for letter, threshold in (
        ("x", [ATTITUDE_RAD] * 3 + [ANYTHING] * 3),
        ("v", [ANYTHING] * 3),
        ("b", np.repeat(BIAS, 3)),
        ("s", [ANYTHING]),
        ("m", FIELD),
    ):
        thresholds.insert((letter, np.array(threshold, dtype=np.float64)))
    parameters.setRelinearizeThreshold(thresholds)
    return parameters


class WholeGraph:
    """All factors of a walk and where its variables are now."""

    def __init__(self) -> None:
        self._graph = gtsam.NonlinearFactorGraph()
        self._left: list[Frozen] = []
        self._covariances: dict[int, Floats] = {}
        self._begin_empty()

    def restart(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, places: list[Place]) -> None:
        """Begin again from a graph of these footfalls at its minimum; all stays as it was where that raises."""
        isam = gtsam.ISAM2(isam_parameters())
        theta = isam.getLinearizationPoint()
        isam.update(graph, values, constrainedKeys=_in_time(places, len(places), values))
        self._graph = gtsam.NonlinearFactorGraph(graph)
        self._begin(isam, theta)

    def add(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, places: list[Place], more: bool = False
    ) -> None:
        """Add factors, and the variables that are new in them.

        Parameters
        ----------
        places : of the walk so far.
        more : whether another part of the same footfall follows, so that none leaves yet.

        Raises
        ------
        RuntimeError
            Where there is no solution, with weak priors on what is new either.
        """
        self._graph.push_back(graph)
        self._covariances = {}
        try:
            order = _in_time(places, IN_ORDER, self._theta, values)
            self._isam.update(graph, values, constrainedKeys=order)
            for _ in range(MOST_UPDATES - 1):
                if self._settled(X(places[-1].result)):
                    break
                self._isam.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), constrainedKeys=order)
        except RuntimeError:
            self._repair(values)
        if not more and len(places) >= MOST_FOOTFALLS:
            self._leave(places, MOST_FOOTFALLS // 2)

    def pose(self, key: int) -> gtsam.Pose3:
        """Return a pose as now known."""
        return self._isam.calculateEstimatePose3(key)

    def vector(self, key: int) -> Floats:
        """Return a vector as now known."""
        return np.asarray(self._isam.calculateEstimateVector(key))

    def bias(self, key: int) -> gtsam.imuBias.ConstantBias:
        """Return a bias as now known."""
        return self._isam.calculateEstimateConstantBias(key)

    def left(self) -> list[Frozen]:
        """Return the footfalls that left since this was last asked."""
        left, self._left = self._left, []
        return left

    def begun_at(self) -> gtsam.Values:
        """Return where the variables are linearised; new ones begin from there, not to be copied."""
        return self._theta

    def covariance(self, key: int) -> Floats:
        """Return the marginal covariance of a variable in its tangent space; raises `RuntimeError` if it has none."""
        if key not in self._covariances:
            try:
                self._covariances[key] = np.asarray(self._isam.marginalCovariance(key))
            except UNSOLVED:
                linear = self._graph.linearize(self._best())
                tree = linear.eliminateMultifrontal(gtsam.Ordering.ColamdGaussianFactorGraph(linear), gtsam.EliminateQR)
                self._covariances[key] = marginal_covariances(tree, {key})[key]
        return self._covariances[key]

    def solution(self, places: list[Place]) -> tuple[gtsam.Values, dict[int, Floats]]:
        """Return all values as now known, and the covariances of poses and biases at the footfalls.

        The covariances need all factors linearised anew at the values; the Gauss-Newton step that comes with it is
        taken. Where these have no solution they are solved with weak priors on all variables; and where that has none,
        the values are returned as they are, and what these priors say.
        """
        values = self._best()
        keys = {key for place in places for key in (X(place.result), B(place.bias))}
        weak = weak_priors(values)
        for more in (gtsam.NonlinearFactorGraph(), weak):
            graph = gtsam.NonlinearFactorGraph(self._graph)
            graph.push_back(more)
            with suppress(*UNSOLVED):
                tree = graph.linearize(values).eliminateMultifrontal(order_of(places, values), gtsam.EliminateQR)
                step, covariances = tree.optimize(), marginal_covariances(tree, keys)
                if np.isfinite(step.norm()) and all(np.isfinite(one).all() for one in covariances.values()):
                    return values.retract(step), covariances
        return values, {key: np.diag(_weak_sigmas(key) ** 2) for key in keys}

    def _best(self) -> gtsam.Values:
        """All values as now known; where they are linearised, if the tree cannot be solved."""
        try:
            return self._isam.calculateBestEstimate()
        except UNSOLVED:
            return gtsam.Values(self._theta)

    def _leave(self, places: list[Place], count: int) -> None:
        """Let go of the first footfalls, and go on from where all are now known."""
        values, covariances = self.solution(places)
        self._left += [frozen_of(place, values, covariances) for place in places[:count]]
        keys = [key for place, after in pairwise(places[: count + 1]) for key in keys_of(place, after, values)]
        factors = without((self._graph.at(i) for i in range(self._graph.size())), values, keys)
        for key in keys:
            values.erase(key)
        graph = gtsam.NonlinearFactorGraph()
        for factor in factors:
            graph.push_back(factor)
        self.restart(graph, values, places[count:])

    def _begin(self, isam: gtsam.ISAM2, theta: gtsam.Values) -> None:
        """Go on with a tree and its linearisation point, which is held from before the tree's first update on."""
        self._isam, self._theta = isam, theta
        self._covariances = {}

    def _begin_empty(self) -> None:
        isam = gtsam.ISAM2(isam_parameters())
        self._begin(isam, isam.getLinearizationPoint())

    def _settled(self, key: int) -> bool:
        """Whether a pose is near where it is linearised."""
        turn = self._theta.atPose3(key).rotation().between(self.pose(key).rotation())
        return bool(np.abs(gtsam.Rot3.Logmap(turn)).max() <= ATTITUDE_RAD)

    def _repair(self, newest: gtsam.Values) -> None:
        """Build the graph anew, from where it was linearised, with weak priors on the newest variables."""
        values, missing = gtsam.Values(self._theta), gtsam.Values(newest)
        for key in list(newest.keys()):
            if values.exists(key):
                missing.erase(key)
        values.insert(missing)
        weak = weak_priors(newest)
        self._graph.push_back(weak)
        self._begin_empty()
        self._isam.update(self._graph, values)


def _in_time(places: list[Place], last: int, *known: gtsam.Values) -> gtsam.KeyGroupMap:
    """Groups of the variables of the last few footfalls, eliminated one after the other; of those that are known."""
    group_of: dict[int, int] = {}
    for group, place in enumerate(places[-last:], start=1):
        keys = [key for j in range(place.first, place.stop) for key in (X(j), V(j))]
        for key in (*keys, M(place.number), B(place.bias), S(place.bias)):
            if any(values.exists(key) for values in known):
                group_of[key] = group
    groups = gtsam.KeyGroupMap()
    for key, group in group_of.items():
        groups.insert2(key, group)
    return groups


def weak_priors(values: gtsam.Values) -> gtsam.NonlinearFactorGraph:
    """Priors so wide that they tell nothing but that there is a solution: a hundred metres, of anything."""
    graph = gtsam.NonlinearFactorGraph()
    for key in list(values.keys()):
        letter = chr(gtsam.Symbol(key).chr())
        wide = gtsam.noiseModel.Diagonal.Sigmas(_weak_sigmas(key))
        if letter == "x":
            graph.addPriorPose3(key, values.atPose3(key), wide)
        elif letter == "b":
            graph.addPriorConstantBias(key, values.atConstantBias(key), wide)
        else:
            graph.addPriorVector(key, values.atVector(key), wide)
    return graph


def _weak_sigmas(key: int) -> Floats:
    """Sigmas that tell nothing of a variable, in its tangent space."""
    letter = gtsam.Symbol(key).chr()
    if letter == ord("x"):
        return np.repeat([3.0, 100.0], 3)
    return np.full(DIMENSION[letter], 1.0 if letter == ord("b") else 100.0)
