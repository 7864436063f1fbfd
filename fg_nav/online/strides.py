"""One stride of a walk in progress, by the functions that the batch smoother turns a whole walk into strides with.

These take a recording and its stances. Here they are given a window: the samples of the footfall before and of the new
one, with some before for context. Nodes of the window are numbered from 0, those of the walk from its first;
`StrideWindow` has both. What a stride measures depends on its own samples alone, but for two things that a recording
tells as a whole: its sample period, and the range of its sensors (`fg_nav.samples.saturation`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain, repeat
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, S, V, X

from fg_nav.arrays import Floats
from fg_nav.detection import Rest
from fg_nav.online.walk import WalkSoFar
from fg_nav.recording import Recording
from fg_nav.smoother.initial import initial_values
from fg_nav.smoother.nodes import Nodes, place_nodes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.preintegration import preintegrate
from fg_nav.smoother.strides import Stride, strides_of
from fg_nav.stances import Stances

CONTEXT_S = 10.0
"""Before a window, in which sensors at the end of their range show themselves."""


@dataclass(frozen=True)
class Place:
    """A footfall in the graph.

    ============== =============================================================
    number         of the footfall
    first, stop    its first node, and the one after its last
    result         node at its stillest sample
    bias           number of its bias, begun at `bias_begun_s`
    sample, t      stillest sample, counted from the first of the walk; s
    last_sample    sample of its last node
    ============== =============================================================
    """

    number: int
    first: int
    stop: int
    result: int
    bias: int
    bias_begun_s: float
    sample: int
    t: float
    last_sample: int


class Frozen(NamedTuple):
    """A footfall as it left: pose, velocity, bias, and the covariances of pose and bias."""

    place: Place
    pose: gtsam.Pose3
    velocity: Floats
    bias: gtsam.imuBias.ConstantBias
    pose_cov: Floats
    bias_cov: Floats


@dataclass(frozen=True)
class StrideWindow:
    """The samples from the footfall before to the new one, with nodes numbered within them; and what comes next.

    `first_sample` is the number of sample 0 in the walk; node 0 is the first of the footfall `before`, `place` the new
    one. Their biases are numbered from 0 too.
    """

    recording: Recording
    stances: Stances
    nodes: Nodes
    first_sample: int
    before: Place
    place: Place

    @property
    def known(self) -> int:
        """Last node of the footfall before, within the window."""
        return int(self.nodes.first[1]) - 1


def places_of(nodes: Nodes, t: Floats) -> list[Place]:
    """Places of the footfalls of a whole walk with samples at `t` (N,) s."""
    at = t[nodes.sample[nodes.result]]
    begun = at[np.searchsorted(nodes.bias, nodes.bias)]
    return [
        Place(
            number=k,
            first=int(nodes.first[k]),
            stop=int(nodes.first[k + 1]),
            result=int(nodes.result[k]),
            bias=int(nodes.bias[k]),
            bias_begun_s=float(begun[k]),
            sample=int(nodes.sample[nodes.result[k]]),
            t=float(at[k]),
            last_sample=int(nodes.sample[nodes.first[k + 1] - 1]),
        )
        for k in range(len(nodes.result))
    ]


def order_of(places: list[Place], values: gtsam.Values) -> gtsam.Ordering:
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


def window_of(walk: WalkSoFar, before: Place, t_first: float, p: SmootherParameters) -> StrideWindow:
    """Cut out the window of the newest stride of a walk: `before` the footfall before, the first was at `t_first`."""
    begins = int(walk.footfall(before.number).start[0])
    context = int(np.searchsorted(walk.t, walk.t[begins - walk.first] - CONTEXT_S)) + walk.first
    recording = walk.recording(context)
    stances = walk.stances(before.number, context)
    nodes = place_nodes(recording, stances, p)
    result = int(nodes.result[1])
    t = float(recording.t[nodes.sample[result]])
    interval, interval_before = (int(np.floor((at - t_first) / p.bias_spacing_s)) for at in (t, before.t))
    another = interval > interval_before
    place = Place(
        number=before.number + 1,
        first=before.stop,
        stop=before.first + len(nodes),
        result=before.first + result,
        bias=before.bias + int(another),
        bias_begun_s=t if another else before.bias_begun_s,
        sample=context + int(nodes.sample[result]),
        t=t,
        last_sample=context + int(nodes.sample[-1]),
    )
    nodes = replace(nodes, bias=np.array([0, int(another)]))
    return StrideWindow(recording, stances, nodes, context, before, place)


def stride_of(
    window: StrideWindow, gyro_bias: Floats, lever: Floats, rests: tuple[Rest, ...], p: SmootherParameters
) -> Stride:
    """Return the newest stride of a walk, in the walk's numbers.

    Parameters
    ----------
    gyro_bias, lever : (3,) rad/s, (3,) m, as in `strides_of`.
    rests : what the window shows of them that was not counted before.
    """
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), gyro_bias)
    new = preintegrate(window.recording, window.nodes.sample[window.known :], bias, p)
    in_graph = gtsam.PreintegratedImuMeasurementsG(gtsam.PreintegrationParams.MakeSharedU(p.gravity))
    measurements = chain(repeat(in_graph, window.known), new)
    strides = strides_of(window.recording, window.stances, window.nodes, measurements, gyro_bias, lever, (), p)
    *_, stride = strides
    return replace(
        stride,
        first=window.place.first,
        last=window.place.stop,
        bias=window.place.bias,
        bias_before=window.before.bias,
        bias_age_s=window.place.t - window.before.bias_begun_s,
        rests=list(rests),
    )


def first_values(
    window: StrideWindow,
    graph: gtsam.NonlinearFactorGraph,
    begun: gtsam.Values,
    bias: gtsam.imuBias.ConstantBias,
    p: SmootherParameters,
) -> gtsam.Values:
    """Where the new variables begin: the solution of the stride alone, with what came before held.

    It is held where it is linearised (`begun`), not where it is now known. So a walk that has turned by a little turns
    as one piece, and what the square of that turn is wrong by comes once, not with every stride. Dead reckoning alone
    would leave a tilt whose square is a turn, the same with every stride.

    Parameters
    ----------
    graph : of the stride.
    begun : values of all variables before.
    bias : to begin the dead reckoning with.
    """
    held = gtsam.Values()
    last = window.before.stop - 1
    held.insert(X(last), begun.atPose3(X(last)))
    held.insert(V(last), begun.atVector(V(last)))
    held.insert(B(window.before.bias), begun.atConstantBias(B(window.before.bias)))
    held.insert(S(window.before.bias), begun.atVector(S(window.before.bias)))
    values = _reckoned(window, held, bias, p)
    alone = gtsam.NonlinearFactorGraph(graph)
    alone.addPriorPose3(X(last), held.atPose3(X(last)), _held(6))
    alone.addPriorVector(V(last), held.atVector(V(last)), _held(3))
    alone.addPriorConstantBias(B(window.before.bias), held.atConstantBias(B(window.before.bias)), _held(6))
    alone.addPriorVector(S(window.before.bias), held.atVector(S(window.before.bias)), _held(1))
    solved = gtsam.Values(held)
    solved.insert(values)
    order = gtsam.Ordering.ColamdNonlinearFactorGraph(alone)
    try:
        for _ in range(GAUSS_NEWTON_STEPS):
            solved = solved.retract(alone.linearize(solved).eliminateMultifrontal(order, gtsam.EliminateQR).optimize())
    except RuntimeError:
        return values
    for key in list(held.keys()):
        solved.erase(key)
    return solved


GAUSS_NEWTON_STEPS = 2
"""Of a stride alone: from half a degree of dead reckoning the second step moves nothing."""


def _held(size: int) -> gtsam.noiseModel.Isotropic:
    return gtsam.noiseModel.Isotropic.Sigma(size, 1e-6)


def _reckoned(
    window: StrideWindow, held: gtsam.Values, bias: gtsam.imuBias.ConstantBias, p: SmootherParameters
) -> gtsam.Values:
    """Dead reckoning from the last node before; zero velocity, a new bias like that before."""
    pose = held.atPose3(X(window.before.stop - 1))
    sample = window.nodes.sample[window.known :]
    of_one = np.zeros(len(sample), dtype=np.int64)
    ends = np.array([0, len(sample)])
    alone = Nodes(sample, of_one, of_one, ends, of_one[:1], of_one[:1])
    attitude = pose.rotation().matrix()
    reckoned = initial_values(window.recording, window.stances, alone, attitude, bias.gyroscope(), p.gravity)
    from_there = gtsam.Pose3(gtsam.Rot3(), pose.translation())
    values = gtsam.Values()
    for i, j in enumerate(range(window.place.first, window.place.stop), start=1):
        values.insert(X(j), from_there.compose(reckoned.atPose3(X(i))))
        values.insert(V(j), np.zeros(3))
    if window.place.bias != window.before.bias:
        values.insert(B(window.place.bias), held.atConstantBias(B(window.before.bias)))
        values.insert(S(window.place.bias), held.atVector(S(window.before.bias)))
    return values
