"""One stride of a walk in progress, by the functions that the batch smoother turns a whole walk into strides with.

These take a recording and its stances. Here they are given a window: the samples of the footfall before and of the new
one, with some before for context. Nodes of the window are numbered from 0, those of the walk from its first;
`StrideWindow` has both. What a stride measures depends on its own samples alone, but for two things that a recording
shows as a whole: its sample period, and the range of its sensors (`fg_nav.samples.saturation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, S, V, X

from fg_nav.arrays import Floats
from fg_nav.detection import Rest, RestParameters, find_rests
from fg_nav.online.buffer import PartialWalk
from fg_nav.recording import MIN_SAMPLES, Recording
from fg_nav.smoother.graph import initial_values
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.preintegration import preintegrate
from fg_nav.smoother.strides import BIAS_SPACING_S, Nodes, Stride, measure_velocities, place_nodes, strides_of
from fg_nav.stances import Stances

CONTEXT_S = 10.0  # Before a window, in which sensors at the end of their range show themselves.
GAUSS_NEWTON_STEPS = 2  # Of a stride alone: from half a degree of dead reckoning the second step moves nothing.


@dataclass(frozen=True)
class Place:
    """A footfall in the graph.

    ============== =============================================================
    number         of the footfall
    first, stop    its first node, and the one after its last
    result         node at its stillest sample
    bias           number of its bias, begun at `bias_begun_s`
    sample, t      stillest sample, counted from the first of the walk; s
    samples        samples of its nodes, counted likewise
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
    samples: tuple[int, ...]


@dataclass(frozen=True)
class StrideWindow:
    """The samples from the footfall before to the new one, with nodes numbered within them; and what comes next.

    `first_sample` is the number of sample 0 in the walk; node 0 is the first of the footfall `before`, `place` the new
    one. Their biases are numbered from 0 too. `with_context` are the same samples and those of some seconds before.
    """

    recording: Recording
    stances: Stances
    nodes: Nodes
    first_sample: int
    before: Place
    place: Place
    with_context: Recording

    @property
    def known(self) -> int:
        """Last node of the footfall before, within the window."""
        return int(self.nodes.first[1]) - 1


def list_places(nodes: Nodes, t: Floats) -> list[Place]:
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
            samples=tuple(nodes.sample[nodes.first[k] : nodes.first[k + 1]].tolist()),
        )
        for k in range(len(nodes.result))
    ]


def cut_window(walk: PartialWalk, before: Place, t_first: float, p: SmootherParameters) -> StrideWindow:
    """Cut out the window of the newest stride of a walk: `before` the footfall before, the first was at `t_first`."""
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
    place = Place(
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
    return StrideWindow(recording, stances, nodes, begins, before, place, with_context)


def measure_stride(
    window: StrideWindow, gyro_bias: Floats, lever: Floats, rests: tuple[Rest, ...], p: SmootherParameters
) -> Stride:
    """Return the newest stride of a walk, in the walk's numbers.

    Parameters
    ----------
    gyro_bias, lever : (3,) rad/s, (3,) m, as in `measure_velocities`.
    rests : what the window shows of them that was not counted before.
    """
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), gyro_bias)
    new = preintegrate(window.recording, window.nodes.sample[window.known :], bias, p)
    in_graph = gtsam.PreintegratedImuMeasurementsG(gtsam.PreintegrationParams.MakeSharedU(p.gravity))
    measurements = chain(repeat(in_graph, window.known), new)
    velocities = measure_velocities(window.recording, window.stances, window.nodes, gyro_bias, lever, p)
    strides = strides_of(window.recording, window.nodes, measurements, velocities, ())
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


def initialize_stride(
    window: StrideWindow,
    graph: gtsam.NonlinearFactorGraph,
    linearized: gtsam.Values,
    bias: gtsam.imuBias.ConstantBias,
    p: SmootherParameters,
) -> gtsam.Values:
    """Return initial values of the new variables: the solution of the stride alone, what came before held fixed.

    It is fixed where it is linearized, not at its estimate. So a walk that has turned by a little turns as one piece,
    and the second-order error of that turn comes once, not with every stride. Dead reckoning alone would leave a tilt
    whose square is a turn, the same with every stride.

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
    alone = gtsam.NonlinearFactorGraph(graph)
    alone.addPriorPose3(pose_key, fixed.atPose3(pose_key), _tight(6))
    alone.addPriorVector(velocity_key, fixed.atVector(velocity_key), _tight(3))
    alone.addPriorConstantBias(bias_key, fixed.atConstantBias(bias_key), _tight(6))
    alone.addPriorVector(sole_key, fixed.atVector(sole_key), _tight(1))
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


def _tight(size: int) -> gtsam.noiseModel.Isotropic:
    return gtsam.noiseModel.Isotropic.Sigma(size, 1e-6)


def _dead_reckon(
    window: StrideWindow, fixed: gtsam.Values, bias: gtsam.imuBias.ConstantBias, p: SmootherParameters
) -> gtsam.Values:
    """Dead reckoning from the last node before; zero velocity, a new bias like that before."""
    pose = fixed.atPose3(X(window.before.stop - 1))
    sample = window.nodes.sample[window.known :]
    of_one = np.zeros(len(sample), dtype=np.int64)
    ends = np.array([0, len(sample)])
    alone = Nodes(sample, of_one, of_one, ends, of_one[:1], of_one[:1])
    attitude = pose.rotation().matrix()
    path = initial_values(window.recording, window.stances, alone, attitude, bias.gyroscope(), p.gravity)
    from_there = gtsam.Pose3(gtsam.Rot3(), pose.translation())
    values = gtsam.Values()
    for i, j in enumerate(range(window.place.first, window.place.stop), start=1):
        values.insert(X(j), from_there.compose(path.atPose3(X(i))))
        values.insert(V(j), np.zeros(3))
    if window.place.bias != window.before.bias:
        values.insert(B(window.place.bias), fixed.atConstantBias(B(window.before.bias)))
        values.insert(S(window.place.bias), fixed.atVector(S(window.before.bias)))
    return values


@dataclass(frozen=True)
class RestLedger:
    """Which rests of a walk in progress its graph has: each shows the gyroscope's bias once.

    `longest` is the longest rest of the walk, with which others must agree; `counted` the last that is in the graph, in
    samples of the walk.
    """

    longest: Rest | None = None
    counted: Rest | None = None

    @classmethod
    def from_rests(cls, rests: Sequence[Rest]) -> RestLedger:
        """Return the ledger of a walk with these rests, all of them in its graph."""
        longest = max(rests, key=lambda rest: rest.stop - rest.start, default=None)
        return cls(longest, rests[-1] if rests else None)

    def collect(self, window: StrideWindow, p: RestParameters) -> tuple[tuple[Rest, ...], RestLedger]:
        """Return what the rests of a window show that was not counted yet, and the ledger once that is in the graph."""
        earlier = len(window.with_context) - len(window.recording)
        ledger, begins = self, window.nodes.sample[window.known + 1] + earlier
        new: list[Rest] = []
        for rest in find_rests(window.with_context, p):
            # A rest that only the end of the window made one may be the beginning of a swing.
            if rest.stop <= begins or not rest.lasts(window.with_context, p.shortest_s):
                continue
            if ledger.longest is None or rest.stop - rest.start > ledger.longest.stop - ledger.longest.start:
                ledger = replace(ledger, longest=rest)
            assert ledger.longest is not None
            if rest.agrees_with(ledger.longest):
                further, ledger = ledger._count(rest, window.first_sample - earlier)
                new += [] if further is None else [further]
        return tuple(new), ledger

    def _count(self, rest: Rest, first_sample: int) -> tuple[Rest | None, RestLedger]:
        """What a rest shows beyond what was counted of it: a long one is seen again and again as it goes on."""
        start, stop = rest.start + first_sample, rest.stop + first_sample
        in_walk = replace(self, counted=replace(rest, start=start, stop=stop))
        if self.counted is None or start >= self.counted.stop:
            return rest, in_walk
        further = rest.beyond(self.counted)
        if further is None:
            return None, replace(self, counted=replace(self.counted, stop=stop))
        return further, in_walk
