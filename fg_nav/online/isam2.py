"""The graph of the newest window of a walk in iSAM2, solved again with every footfall.

Four choices make that quick and exact (measured in docs/online.md):

* Relinearization by attitude, bias and field. Position and velocity enter linearly once they are in the body's axes; a
  heading that moved by a does not, and an old linearization costs a^2/2 of each stride. Variables are checked from the
  newest footfall backward until one is below its threshold.
* New variables start where the footfall before is linearized, not at its estimate (`initialize_stride`).
* The linearization point is held alive in Python: pybind then passes the same object to every factor written in Python,
  else each would get a copy of all values at each call.
* QR: the information of a bias over hours and of a node over milliseconds differ by more than Cholesky resolves.

An update after which the newest footfall has turned from its linearization point is repeated, but not often, so that
the time of a footfall is bounded. Where the equations have no unique solution the graph is rebuilt with weak priors on
the newest variables; where that has none either, the walk goes on without its past (`recovery`).
"""

from __future__ import annotations

from contextlib import suppress

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats
from fg_nav.online.strides import StanceNodes, list_variables, order_variables, result_keys, weak_priors, weak_sigmas
from fg_nav.smoother.solver import UNSOLVED, marginal_covariances

# Thresholds of relinearization: of attitude, bias and field, and of what enters linearly.
ATTITUDE_RAD = 0.005  # 0.3 deg: half its square is 12 millionths of a stride's length.
BIAS = (0.1, 2e-3)  # m/s^2, rad/s: over a stride 0.1 deg, of which inertial measurements know the first derivative.
FIELD = (20.0, 1.0, 0.2, 0.2, 0.2, 0.2, 1.0, 1.0, 1.0)  # uT m, uT: 0.2 uT of the mean field or region are 0.6 deg.
ANYTHING = 1e6

WILDFIRE = 0.05  # Steps (m, rad, uT) below which no change propagates into the past; at 0.01 all of the field moved.
MAX_UPDATES = 3

# Last footfalls whose variables are eliminated in the order of time; ccolamd needs more variables than groups. On its
# own the ordering may reverse a part of the walk, newest first, which is eliminated again at each footfall then.
IN_ORDER = 3


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


class ISAM2Backend:
    """Factors of a window of a walk and their iSAM2 tree.

    `linearization_point` is that of its variables; new ones start from there. Not to be copied.
    """

    def __init__(self) -> None:
        self._graph = gtsam.NonlinearFactorGraph()
        self._covariances: dict[int, Floats] = {}
        self._isam = gtsam.ISAM2(isam_parameters())
        self.linearization_point = self._isam.getLinearizationPoint()  # held from before the first update on

    def reset(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, stances: list[StanceNodes]) -> None:
        """Begin again from a graph of these footfalls at its minimum; all stays as it was where that raises."""
        isam = gtsam.ISAM2(isam_parameters())
        theta = isam.getLinearizationPoint()
        isam.update(graph, values, constrainedKeys=_group_by_time(stances, len(stances), values))
        self._graph, self._covariances = gtsam.NonlinearFactorGraph(graph), {}
        self._isam, self.linearization_point = isam, theta

    def add(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, stances: list[StanceNodes]) -> None:
        """Add factors and their new variables, and solve; the last of the stances is the newest.

        Raises `RuntimeError` where there is no solution, with weak priors either.
        """
        self._graph.push_back(graph)
        self._covariances = {}
        try:
            order = _group_by_time(stances, IN_ORDER, self.linearization_point, values)
            self._isam.update(graph, values, constrainedKeys=order)
            # Repeat the update while the newest footfall turns away from its linearization point.
            for _ in range(MAX_UPDATES - 1):
                newest = X(stances[-1].result)
                turn = self.linearization_point.atPose3(newest).rotation().between(self.pose(newest).rotation())
                if np.abs(gtsam.Rot3.Logmap(turn)).max() <= ATTITUDE_RAD:
                    break
                self._isam.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), constrainedKeys=order)
        except RuntimeError:
            self._rebuild(values)

    def pose(self, key: int) -> gtsam.Pose3:
        """Return the estimate of a pose."""
        return self._isam.calculateEstimatePose3(key)

    def vector(self, key: int) -> Floats:
        """Return the estimate of a vector."""
        return np.asarray(self._isam.calculateEstimateVector(key))

    def bias(self, key: int) -> gtsam.imuBias.ConstantBias:
        """Return the estimate of a bias."""
        return self._isam.calculateEstimateConstantBias(key)

    def covariance(self, key: int) -> Floats:
        """Return the marginal covariance (d, d) of a variable, from all factors where iSAM2 finds none."""
        if key not in self._covariances:
            try:
                self._covariances[key] = np.asarray(self._isam.marginalCovariance(key))
            except UNSOLVED:
                linear = self._graph.linearize(self._estimates())
                tree = linear.eliminateMultifrontal(gtsam.Ordering.ColamdGaussianFactorGraph(linear), gtsam.EliminateQR)
                self._covariances[key] = marginal_covariances(tree, {key})[key]
        return self._covariances[key]

    def solution(self, stances: list[StanceNodes]) -> tuple[gtsam.Values, dict[int, Floats]]:
        """Return the estimates of all variables, and the covariances of poses and biases at the footfalls.

        All factors are linearized at the estimates for the covariances, and the Gauss-Newton step of that is taken.
        Without a solution they are solved with weak priors on all variables; without one again, the estimates are
        returned as they are, with the sigmas of the weak priors.
        """
        values = self._estimates()
        keys = result_keys(stances)
        for more in (gtsam.NonlinearFactorGraph(), weak_priors(values)):
            graph = gtsam.NonlinearFactorGraph(self._graph)
            graph.push_back(more)
            with suppress(*UNSOLVED):
                order = gtsam.Ordering()
                for key in order_variables(stances, values):
                    order.push_back(key)
                tree = graph.linearize(values).eliminateMultifrontal(order, gtsam.EliminateQR)
                step, covariances = tree.optimize(), marginal_covariances(tree, keys)
                if np.isfinite(step.norm()) and all(np.isfinite(one).all() for one in covariances.values()):
                    return values.retract(step), covariances
        return values, {key: np.diag(weak_sigmas(key) ** 2) for key in keys}

    def linearize(self) -> tuple[gtsam.Values, gtsam.GaussianFactorGraph]:
        """Return the estimates of all variables, and all factors linearized there."""
        values = self._estimates()
        return values, self._graph.linearize(values)

    def _estimates(self) -> gtsam.Values:
        """Estimates of all variables; their linearization point, if the tree cannot be solved."""
        try:
            return self._isam.calculateBestEstimate()
        except UNSOLVED:
            return gtsam.Values(self.linearization_point)

    def _rebuild(self, newest: gtsam.Values) -> None:
        """Build the tree again, from its linearization point, with weak priors on the newest variables."""
        values, missing = gtsam.Values(self.linearization_point), gtsam.Values(newest)
        for key in list(newest.keys()):
            if values.exists(key):
                missing.erase(key)
        values.insert(missing)
        weak = weak_priors(newest)
        self._graph.push_back(weak)
        self._isam = gtsam.ISAM2(isam_parameters())
        self.linearization_point = self._isam.getLinearizationPoint()
        self._isam.update(self._graph, values)


def _group_by_time(stances: list[StanceNodes], last: int, *known: gtsam.Values) -> gtsam.KeyGroupMap:
    """Groups of the variables of the last few footfalls, eliminated one after the other; those with a value."""
    group_of: dict[int, int] = {}
    for group, stance in enumerate(stances[-last:], start=1):
        group_of.update({key: group for values in known for key in list_variables(stance, values)})
    groups = gtsam.KeyGroupMap()
    for key, group in group_of.items():
        groups.insert2(key, group)
    return groups
