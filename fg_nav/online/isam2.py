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
the newest variables. Where that has none either, `recover` restarts at the last footfall: its estimate, with its
sigmas, becomes a prior on its last node, and the newest stride is added to it. If the stride has no solution either,
the newest footfall begins alone where dead reckoning has it, or else where the last one was, with sigmas for all that a
person may have walked and turned in the meantime; the field begins again from its last value, with weak priors.
"""

from __future__ import annotations

from contextlib import suppress

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, S, V, X

from fg_nav.arrays import Floats
from fg_nav.factors.magnetic_field import E_H, SIZE
from fg_nav.online.anchor import MarginalPrior, marginalize
from fg_nav.online.estimates import StanceEstimate
from fg_nav.online.strides import (
    StanceNodes,
    StrideWindow,
    initialize_stride,
    list_variables,
    order_variables,
    result_keys,
    weak_priors,
    weak_sigmas,
)
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import UNSOLVED, marginal_covariances
from fg_nav.smoother.strides import ACC_BIAS_SIGMA, Stride, stride_graph

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

REASON = "the walk had no solution here, and goes on from the footfall before"  # In place of a verdict on the field.
NODE_SPEED_M_S = 0.1  # Sigma of the velocity of a foot at the end of its stance.
WALKING_M_S = 1.5  # Sigma of the mean velocity of a person who was not observed,
TURNED_RAD = 1.0  # of the heading after a stride that makes no sense,
SWINGING_M_S = 3.0  # and of the velocity of the foot.
NORTH_UT = (0.0, 20.0)  # East and north part of a field that was not observed.


def isam_parameters() -> gtsam.ISAM2Params:
    """Return the parameters of iSAM2: QR, wildfire threshold, relinearization by kind of variable."""
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
        """Rebuild the tree from a graph of these footfalls at its minimum `values`; unchanged where that raises."""
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
        """Return the estimate of the pose `X(j)` with this key."""
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
        """Return the estimates of all variables; their linearization point, if the tree cannot be solved."""
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
    """Return elimination groups, oldest first, of the variables of the `last` footfalls that have a `known` value."""
    group_of: dict[int, int] = {}
    for group, stance in enumerate(stances[-last:], start=1):
        group_of.update({key: group for values in known for key in list_variables(stance, values)})
    groups = gtsam.KeyGroupMap()
    for key, group in group_of.items():
        groups.insert2(key, group)
    return groups


# --- restart at the last footfall ------------------------------------------------------------------------------------


def check_solution(backend: ISAM2Backend, stance: StanceNodes) -> None:
    """Raise `RuntimeError` if the estimate of a footfall is not finite, or its variances are not positive."""
    known = [
        backend.pose(X(stance.result)).matrix(),
        backend.vector(V(stance.result)),
        backend.bias(B(stance.bias)).vector(),
    ]
    covariances = [backend.covariance(X(stance.result)), backend.covariance(B(stance.bias))]
    finite = all(np.isfinite(part).all() for part in (*known, *covariances))
    if not finite or not all((np.diagonal(one) > 0.0).all() for one in covariances):
        raise RuntimeError("the graph has a solution that is not finite")


def recover(
    backend: ISAM2Backend,
    last: StanceEstimate,
    graph_cov: Floats,
    window: StrideWindow,
    stride: Stride,
    p: SmootherParameters,
    with_field: bool,
) -> None:
    """Restart a backend from its last footfall.

    Parameters
    ----------
    last : estimate of that footfall, as it was reported.
    graph_cov : (4, 4) covariance of its position and yaw in the graph: without the uncertainty about north, which is of
        the walk as a whole and added to all that is reported.
    window, stride : the newest stride, its samples and its measurements.
    with_field : whether the footfall needs a state of the field.
    """
    held = _last_values(backend, last, window.before)
    field, values = gtsam.Values(), _predict_stride(window, stride, held, p)
    if with_field:
        # The field's state at the last footfall: its estimate, or linearization point, or a field that points north.
        state = np.zeros(SIZE)
        state[E_H] = NORTH_UT
        for known in (backend.linearization_point.atVector, backend.vector):
            with suppress(*UNSOLVED):
                found = np.asarray(known(M(window.before.number)))
                state = found if np.isfinite(found).all() else state
        field.insert(M(window.stance.number), state)
    try:
        anchor = _marginalize_last(last, graph_cov, window, stride, held, values, p)
        factors = gtsam.NonlinearFactorGraph()
        factors.push_back(anchor.factor())
        _reset(backend, factors, anchor.initial_values(), field, window.stance)
    except UNSOLVED:
        factors = _build_wide_priors(last, graph_cov, values, window.stance, p)
        _reset(backend, factors, values, field, window.stance)


def _reset(
    backend: ISAM2Backend,
    factors: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    field: gtsam.Values,
    stance: StanceNodes,
) -> None:
    """Reset the backend to one footfall, with weak priors on its `field` state; `RuntimeError` if not solvable."""
    factors.push_back(weak_priors(field))
    values.insert(field)
    backend.reset(factors, values, [stance])
    check_solution(backend, stance)


def _last_values(backend: ISAM2Backend, last: StanceEstimate, before: StanceNodes) -> gtsam.Values:
    """Return the variables at the last node before: the graph's estimates where it has any, else those reported."""
    reported = gtsam.Pose3(gtsam.Rot3(last.nav_R_body), last.position)
    pose, velocity, bias = reported, np.zeros(3), gtsam.imuBias.ConstantBias(np.zeros(3), last.gyro_bias)
    try:
        known = backend.pose(X(before.stop - 1)), backend.vector(V(before.stop - 1)), backend.bias(B(before.bias))
        near = np.linalg.norm(known[0].translation() - last.position) < 1.0
        if near and np.isfinite(np.concatenate([known[0].matrix().ravel(), known[1], known[2].vector()])).all():
            pose, velocity, bias = known
    except UNSOLVED:
        pass
    held = gtsam.Values()
    held.insert(X(before.stop - 1), pose)
    held.insert(V(before.stop - 1), velocity)
    held.insert(B(before.bias), bias)
    held.insert(S(before.bias), np.zeros(1))
    return held


def _marginalize_last(
    last: StanceEstimate,
    graph_cov: Floats,
    window: StrideWindow,
    stride: Stride,
    held: gtsam.Values,
    values: gtsam.Values,
    p: SmootherParameters,
) -> MarginalPrior:
    """Return the marginal prior on the newest footfall, from its stride and the estimate of the footfall before."""
    before, stance = window.before, window.stance
    pose_key, velocity_key = X(before.stop - 1), V(before.stop - 1)
    graph, pose = gtsam.NonlinearFactorGraph(), held.atPose3(pose_key)
    graph.addPriorPose3(pose_key, pose, _pose_noise(pose, graph_cov, np.radians(p.tilt_sigma_deg)))
    slow = gtsam.noiseModel.Isotropic.Sigma(3, NODE_SPEED_M_S)
    graph.addPriorVector(velocity_key, held.atVector(velocity_key), slow)
    _add_sensor_priors(graph, last, held.atConstantBias(B(before.bias)), before.bias, p)
    graph.push_back(stride_graph(stride, p))
    both = gtsam.Values(held)
    both.insert(values)
    leaving = [pose_key, velocity_key]
    leaving += [B(before.bias), S(before.bias)] if stance.bias != before.bias else []
    return marginalize(graph.linearize(both), both, list_variables(stance, both), leaving)


def _predict_stride(window: StrideWindow, stride: Stride, held: gtsam.Values, p: SmootherParameters) -> gtsam.Values:
    """Return values of the newest footfall by its stride alone; those of the last one where they are not finite."""
    stance, bias = window.stance, held.atConstantBias(B(window.before.bias))
    nodes = range(stance.first, stance.stop)
    try:
        values = initialize_stride(window, stride_graph(stride, p), held, bias, p)
        parts = [part for j in nodes for part in (values.atPose3(X(j)).matrix().ravel(), values.atVector(V(j)))]
        if np.isfinite(np.concatenate(parts)).all():
            return values
    except UNSOLVED:
        pass
    values = gtsam.Values()
    for j in nodes:
        values.insert(X(j), held.atPose3(X(window.before.stop - 1)))
        values.insert(V(j), np.zeros(3))
    if stance.bias != window.before.bias:
        values.insert(B(stance.bias), bias)
        values.insert(S(stance.bias), np.zeros(1))
    return values


def _build_wide_priors(
    last: StanceEstimate, graph_cov: Floats, values: gtsam.Values, stance: StanceNodes, p: SmootherParameters
) -> gtsam.NonlinearFactorGraph:
    """Return priors on the newest footfall, as wide as a person may have moved since; add missing `values`."""
    elapsed = max(stance.t - last.t, 0.0)
    wide = graph_cov + np.diag([(WALKING_M_S * elapsed) ** 2] * 3 + [TURNED_RAD**2])
    graph = gtsam.NonlinearFactorGraph()
    for j in range(stance.first, stance.stop):
        pose = values.atPose3(X(j))
        graph.addPriorPose3(X(j), pose, _pose_noise(pose, wide, TURNED_RAD))
        graph.addPriorVector(V(j), np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, SWINGING_M_S))
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), last.gyro_bias)
    if not values.exists(B(stance.bias)):
        values.insert(B(stance.bias), bias)
        values.insert(S(stance.bias), np.zeros(1))
    _add_sensor_priors(graph, last, bias, stance.bias, p)
    return graph


def _add_sensor_priors(
    graph: gtsam.NonlinearFactorGraph,
    last: StanceEstimate,
    bias: gtsam.imuBias.ConstantBias,
    number: int,
    p: SmootherParameters,
) -> None:
    """Add priors on bias `number`, with the gyro sigmas of the last estimate, and on its settling variable."""
    sigma = np.concatenate([np.repeat(ACC_BIAS_SIGMA, 3), last.gyro_bias_sigma])
    graph.addPriorConstantBias(B(number), bias, gtsam.noiseModel.Diagonal.Sigmas(sigma))
    graph.addPriorVector(S(number), np.zeros(1), gtsam.noiseModel.Isotropic.Sigma(1, p.settling_sigma_m))


def _pose_noise(pose: gtsam.Pose3, nav_cov: Floats, tilt_rad: float) -> gtsam.noiseModel.Gaussian:
    """Return the noise of a pose in its tangent space, from the covariance (4, 4) of position and yaw, and tilt."""
    covariance = np.diag([tilt_rad**2, tilt_rad**2, 0.0, 0.0, 0.0, 0.0])
    covariance[np.ix_([3, 4, 5, 2], [3, 4, 5, 2])] = nav_cov
    turn, body_R_nav = np.zeros((6, 6)), pose.rotation().matrix().T
    turn[:3, :3] = turn[3:, 3:] = body_R_nav
    return gtsam.noiseModel.Gaussian.Covariance(turn @ covariance @ turn.T)
