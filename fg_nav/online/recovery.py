"""Restart from the last footfall, where the graph of a walk has no solution.

The estimate of that footfall, with its sigmas, becomes a prior on its last node, and the newest stride is added to it
with its own factors. Estimates before stay as they are. If the stride has no solution either, the newest footfall
begins alone where dead reckoning has it, or else where the last one was, with sigmas for all that a person may have
walked and turned in the meantime. The state of the field begins again from its last value, with weak priors.
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
from fg_nav.online.isam2 import ISAM2Backend
from fg_nav.online.strides import StanceNodes, StrideWindow, initialize_stride, list_variables, weak_priors
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import UNSOLVED
from fg_nav.smoother.strides import ACC_BIAS_SIGMA, Stride, stride_graph

REASON = "the walk had no solution here, and goes on from the footfall before"  # In place of a verdict on the field.
NODE_SPEED_M_S = 0.1  # Sigma of the velocity of a foot at the end of its stance.
WALKING_M_S = 1.5  # Sigma of the mean velocity of a person who was not observed,
TURNED_RAD = 1.0  # of the heading after a stride that makes no sense,
SWINGING_M_S = 3.0  # and of the velocity of the foot.
NORTH_UT = (0.0, 20.0)  # East and north part of a field that was not observed.


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
    window, stride : the newest.
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
    """Begin with a footfall and its state of the field, if it has one."""
    factors.push_back(weak_priors(field))
    values.insert(field)
    backend.reset(factors, values, [stance])
    check_solution(backend, stance)


def _last_values(backend: ISAM2Backend, last: StanceEstimate, before: StanceNodes) -> gtsam.Values:
    """Variables at the end of the last footfall: estimates of the graph where it has any, else those reported."""
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
    """Marginal prior on the newest footfall, of its stride and the estimate of the footfall before."""
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
    """Values of the newest footfall by its stride alone; those of the last one, if they are not finite."""
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
    """Priors on the newest footfall, as wide as a person may have moved since the last; missing `values` are added."""
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
    """Priors on bias and settling."""
    sigma = np.concatenate([np.repeat(ACC_BIAS_SIGMA, 3), last.gyro_bias_sigma])
    graph.addPriorConstantBias(B(number), bias, gtsam.noiseModel.Diagonal.Sigmas(sigma))
    graph.addPriorVector(S(number), np.zeros(1), gtsam.noiseModel.Isotropic.Sigma(1, p.settling_sigma_m))


def _pose_noise(pose: gtsam.Pose3, nav_cov: Floats, tilt_rad: float) -> gtsam.noiseModel.Gaussian:
    """Noise of a pose in its tangent space, from position and yaw (4, 4) and tilt in navigation axes."""
    covariance = np.diag([tilt_rad**2, tilt_rad**2, 0.0, 0.0, 0.0, 0.0])
    covariance[np.ix_([3, 4, 5, 2], [3, 4, 5, 2])] = nav_cov
    turn, body_R_nav = np.zeros((6, 6)), pose.rotation().matrix().T
    turn[:3, :3] = turn[3:, 3:] = body_R_nav
    return gtsam.noiseModel.Gaussian.Covariance(turn @ covariance @ turn.T)
