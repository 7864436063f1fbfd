"""Strides of a walk in progress, measured by the functions of the batch smoother (`smoother.strides`), one at a time.

A stride's window has the samples of the footfall before and of the new one, with some before for context. Its nodes are
numbered from 0, those of the walk from its first; `StrideWindow` has both.

Position fixes are added with the stride of their time, to the nearest node. The heading of a graph in progress is held
by all strides before, so that a fix off by more than its sigmas would bend the walk instead of turning it: it waits for
the next solution of the whole walk, which is turned to it (`smoother.constraints`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, P, S, V, X

from fg_nav.arrays import Floats
from fg_nav.detection import Rest, RestParameters, find_rests
from fg_nav.detection.stance import Stances
from fg_nav.online.buffer import PartialWalk
from fg_nav.recording import MIN_SAMPLES, Recording
from fg_nav.smoother.constraints import pin_to_times, select_reached_fixes
from fg_nav.smoother.graph import initial_values
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import in_nav
from fg_nav.smoother.square_root import DIMENSION
from fg_nav.smoother.strides import (
    BIAS_SPACING_S,
    Nodes,
    Stride,
    measure_velocities,
    place_nodes,
    preintegrate,
    strides_of,
)
from fg_nav.truth import Fix

CONTEXT_S = 10.0  # Before a window, in which sensors at the end of their range show themselves.
GAUSS_NEWTON_STEPS = 2  # Of a stride alone: from half a degree of dead reckoning the second step moves nothing.
MAX_FIX_SIGMAS = 4.0  # Of a fix from the walk so far: one in 3000 that is true is beyond, and comes later.


@dataclass(frozen=True)
class StanceNodes:
    """The nodes of a footfall in the graph."""

    number: int  # Of the footfall.
    first: int  # Its first node,
    stop: int  # and the one after its last.
    result: int  # Node at its stillest sample.
    bias: int  # Number of its bias variable,
    bias_begun_s: float  # the first footfall of which was then.
    sample: int  # Its stillest, counted from the first of the walk;
    t: float  # its stamp, s.
    samples: tuple[int, ...]  # Of its nodes, counted likewise.


# --- variables of footfalls ------------------------------------------------------------------------------------------


def result_keys(stances: Iterable[StanceNodes]) -> set[int]:
    """Return the keys of the poses and biases that are reported of footfalls."""
    return {key for stance in stances for key in (X(stance.result), B(stance.bias))}


def list_variables(stance: StanceNodes, values: gtsam.Values) -> list[int]:
    """Return the keys of a footfall's variables that have a value, shared bias and settling included."""
    keys = [key for j in range(stance.first, stance.stop) for key in (X(j), V(j))]
    others = (M(stance.number), P(stance.number), B(stance.bias), S(stance.bias))
    return [key for key in (*keys, *others) if values.exists(key)]


def order_variables(stances: Sequence[StanceNodes], values: gtsam.Values) -> list[int]:
    """Return the keys of the variables of consecutive footfalls in elimination order, as `solver.list_in_time`."""
    keys = {}
    for stance in reversed(stances):
        keys.update(dict.fromkeys(reversed(list_variables(stance, values))))
    return list(reversed(keys))


def weak_priors(values: gtsam.Values) -> gtsam.NonlinearFactorGraph:
    """Return priors so wide that they make the equations solvable and no more: a hundred metres, of anything."""
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
    """Return the sigmas (d,) of a weak prior on a variable, in its tangent space."""
    letter = gtsam.Symbol(key).chr()
    if letter == ord("x"):
        return np.repeat([3.0, 100.0], 3)
    return np.full(DIMENSION[letter], 1.0 if letter == ord("b") else 100.0)


# --- the newest stride -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StrideWindow:
    """The samples from the footfall `before` to the new one, `stance`, with nodes and biases numbered within them.

    `first_sample` is the number of sample 0 in the walk. `with_context` has the samples of some seconds before as well.
    """

    recording: Recording
    stances: Stances
    nodes: Nodes
    first_sample: int
    before: StanceNodes
    stance: StanceNodes
    with_context: Recording

    @property
    def last_before(self) -> int:
        """Last node of the footfall before, within the window."""
        return int(self.nodes.first[1]) - 1


def list_stances(nodes: Nodes, t: Floats) -> list[StanceNodes]:
    """Return the footfalls of a whole walk with samples at `t` (N,) s."""
    at = t[nodes.sample[nodes.result]]
    begun = at[np.searchsorted(nodes.bias, nodes.bias)]
    return [
        StanceNodes(
            number=k,
            first=int(nodes.first[k]),
            stop=int(nodes.first[k + 1]),
            result=int(nodes.result[k]),
            bias=int(nodes.bias[k]),
            bias_begun_s=float(begun[k]),
            sample=int(nodes.sample[nodes.result[k]]),
            t=float(at[k]),
            samples=tuple(nodes.sample[nodes.first[k] : nodes.first[k + 1]].tolist()),
        )
        for k in range(len(nodes.result))
    ]


def cut_stride(walk: PartialWalk, before: StanceNodes, t_first: float, p: SmootherParameters) -> StrideWindow:
    """Cut out the newest stride of a walk whose first footfall was at `t_first` s; `before` the footfall before."""
    begins = int(walk.footfall(before.number).start[0])
    context = walk.buffer.find_since(walk.buffer.stamp(begins) - CONTEXT_S, walk.stop)
    begins = max(context, min(begins, walk.stop - MIN_SAMPLES))
    with_context = walk.cut_recording(context, begins)
    recording = with_context.slice(begins - context, len(with_context))
    stances = walk.cut_stances(before.number, begins)
    nodes = place_nodes(recording, stances, p)
    result = int(nodes.result[1])
    t = float(recording.t[nodes.sample[result]])
    interval, interval_before = (int(np.floor((at - t_first) / BIAS_SPACING_S)) for at in (t, before.t))
    another = interval > interval_before
    stance = StanceNodes(
        number=before.number + 1,
        first=before.stop,
        stop=before.first + len(nodes),
        result=before.first + result,
        bias=before.bias + int(another),
        bias_begun_s=t if another else before.bias_begun_s,
        sample=begins + int(nodes.sample[result]),
        t=t,
        samples=tuple((begins + nodes.sample[nodes.first[1] :]).tolist()),
    )
    nodes = replace(nodes, bias=np.array([0, int(another)]))
    return StrideWindow(recording, stances, nodes, begins, before, stance, with_context)


def measure_stride(
    window: StrideWindow, gyro_bias: Floats, lever: Floats, rests: tuple[Rest, ...], p: SmootherParameters
) -> Stride:
    """Return the newest stride: preintegrated IMU, stance velocities and rests, nodes numbered as in the walk.

    Parameters
    ----------
    gyro_bias, lever : (3,) rad/s, (3,) m, as in `measure_velocities`.
    rests : those in the window, as far as they were not counted before.
    """
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), gyro_bias)
    new = preintegrate(window.recording, window.nodes.sample[window.last_before :], bias, p)
    in_graph = gtsam.PreintegratedImuMeasurementsG(gtsam.PreintegrationParams.MakeSharedU(p.gravity))
    measurements = chain(repeat(in_graph, window.last_before), new)
    velocities = measure_velocities(window.recording, window.stances, window.nodes, gyro_bias, lever, p)
    strides = strides_of(window.recording, window.nodes, measurements, velocities, ())
    *_, stride = strides
    return replace(
        stride,
        first=window.stance.first,
        last=window.stance.stop,
        bias=window.stance.bias,
        bias_before=window.before.bias,
        bias_age_s=window.stance.t - window.before.bias_begun_s,
        rests=list(rests),
    )


def initialize_stride(
    window: StrideWindow,
    graph: gtsam.NonlinearFactorGraph,
    linearized: gtsam.Values,
    bias: gtsam.imuBias.ConstantBias,
    p: SmootherParameters,
) -> gtsam.Values:
    """Return initial values of the new variables: the solution of the stride alone, variables before held fixed.

    They are fixed at their linearization point, not at their estimate. So a walk that has turned by a little turns as
    one piece, and the second-order error of that turn comes once, not with every stride. Dead reckoning alone would
    leave a tilt whose square is a turn, the same with every stride.

    Parameters
    ----------
    graph : of the stride.
    linearized : linearization point of all variables before.
    bias : at which the dead reckoning starts.
    """
    pose_key, velocity_key = X(window.before.stop - 1), V(window.before.stop - 1)
    bias_key, sole_key = B(window.before.bias), S(window.before.bias)
    fixed = gtsam.Values()
    fixed.insert(pose_key, linearized.atPose3(pose_key))
    fixed.insert(velocity_key, linearized.atVector(velocity_key))
    fixed.insert(bias_key, linearized.atConstantBias(bias_key))
    fixed.insert(sole_key, linearized.atVector(sole_key))
    values = _dead_reckon(window, fixed, bias, p)
    # A prior of a millionth on each holds them.
    tight = {size: gtsam.noiseModel.Isotropic.Sigma(size, 1e-6) for size in (1, 3, 6)}
    alone = gtsam.NonlinearFactorGraph(graph)
    alone.addPriorPose3(pose_key, fixed.atPose3(pose_key), tight[6])
    alone.addPriorVector(velocity_key, fixed.atVector(velocity_key), tight[3])
    alone.addPriorConstantBias(bias_key, fixed.atConstantBias(bias_key), tight[6])
    alone.addPriorVector(sole_key, fixed.atVector(sole_key), tight[1])
    solved = gtsam.Values(fixed)
    solved.insert(values)
    order = gtsam.Ordering.ColamdNonlinearFactorGraph(alone)
    try:
        for _ in range(GAUSS_NEWTON_STEPS):
            solved = solved.retract(alone.linearize(solved).eliminateMultifrontal(order, gtsam.EliminateQR).optimize())
    except RuntimeError:
        return values
    for key in list(fixed.keys()):
        solved.erase(key)
    return solved


def _dead_reckon(
    window: StrideWindow, fixed: gtsam.Values, bias: gtsam.imuBias.ConstantBias, p: SmootherParameters
) -> gtsam.Values:
    """Return values of the new nodes by dead reckoning from the last one before; zero velocity, bias carried on."""
    pose = fixed.atPose3(X(window.before.stop - 1))
    sample = window.nodes.sample[window.last_before :]
    of_one = np.zeros(len(sample), dtype=np.int64)
    ends = np.array([0, len(sample)])
    alone = Nodes(sample, of_one, of_one, ends, of_one[:1], of_one[:1])
    attitude = pose.rotation().matrix()
    path = initial_values(window.recording, window.stances, alone, attitude, bias.gyroscope(), p.gravity)
    from_there = gtsam.Pose3(gtsam.Rot3(), pose.translation())
    values = gtsam.Values()
    for i, j in enumerate(range(window.stance.first, window.stance.stop), start=1):
        values.insert(X(j), from_there.compose(path.atPose3(X(i))))
        values.insert(V(j), np.zeros(3))
    if window.stance.bias != window.before.bias:
        values.insert(B(window.stance.bias), fixed.atConstantBias(B(window.before.bias)))
        values.insert(S(window.stance.bias), fixed.atVector(S(window.before.bias)))
    return values


# --- rests and fixes of a stride -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RestLedger:
    """Which rests of a walk in progress its graph has: each shows the gyroscope's bias once."""

    longest: Rest | None = None  # Of the walk, with which others must agree.
    counted: Rest | None = None  # The last that is in the graph, in samples of the walk.

    def collect(self, window: StrideWindow, p: RestParameters) -> tuple[tuple[Rest, ...], RestLedger]:
        """Return the parts of rests in a window that were not counted yet, and the ledger with them in the graph."""
        earlier = len(window.with_context) - len(window.recording)
        ledger, begins = self, window.nodes.sample[window.last_before + 1] + earlier
        new: list[Rest] = []
        for rest in find_rests(window.with_context, p):
            # A rest that only the end of the window made one may be the beginning of a swing.
            if rest.stop <= begins or not rest.lasts(window.with_context, p.shortest_s):
                continue
            if ledger.longest is None or rest.stop - rest.start > ledger.longest.stop - ledger.longest.start:
                ledger = replace(ledger, longest=rest)
            assert ledger.longest is not None
            if not rest.agrees_with(ledger.longest):
                continue
            # Only samples not counted yet, so that none is in the graph twice: each piece finds a long rest again.
            shift, counted = window.first_sample - earlier, ledger.counted
            start, stop = rest.start + shift, rest.stop + shift
            further = rest if counted is None or start >= counted.stop else rest.beyond(counted)
            if further is not None:
                new.append(further)
            counted = rest if further is not None or counted is None else counted
            first = start if further is not None else counted.start
            ledger = replace(ledger, counted=replace(counted, start=first, stop=stop))
        return tuple(new), ledger


def find_stride_fixes(fixes: Sequence[Fix], t_node: Floats, before_s: float) -> list[tuple[int, Fix]]:
    """Return the fixes of a stride, each with the number of its node and with the sigma that it has there.

    Parameters
    ----------
    t_node : (n,) s, of the nodes of the footfall before and of the new one.
    before_s : of the last node of the footfall before.
    """
    reached = select_reached_fixes(fixes, t_node, before_s)
    pinned = pin_to_times(reached, t_node)
    return [
        (int(node), replace(fix, horizontal_sigma_m=float(sigma)))
        for node, fix, sigma in zip(pinned.node, reached, pinned.horizontal, strict=True)
    ]


def agrees(pose: gtsam.Pose3, body_cov: Floats, fix: Fix) -> bool:
    """Return whether a fix is within `MAX_FIX_SIGMAS` (Mahalanobis, horizontal) of a pose, `body_cov` (6, 6)."""
    offset = fix.position[:2] - pose.translation()[:2]
    covariance = in_nav(pose.rotation().matrix()[None], body_cov[None])[0, :2, :2]
    total = covariance + fix.horizontal_sigma_m**2 * np.eye(2)
    return bool(offset @ np.linalg.solve(total, offset) <= MAX_FIX_SIGMAS**2)
