"""Strides of a walk in progress, measured by the functions of the batch (`smoother.strides`), one at a time; floors.

The heading of a graph in progress is held by all strides before, so that a position fix off by more than its sigmas
would bend the walk instead of turning it: it waits for the next solution of the whole walk (`smoother.constraints`).

Floors: a walk that is solved as a whole shows level floors (`smoother.heights`) and their heights; footfalls since are
followed by their heights z, m, less a drift that all of them share and that those on a floor show:

    on a floor       while z changes by less than `STEP_M` from one footfall to the next, and is within `SAME_M` of it
    on none          otherwise: on stairs or a ramp, or in a lift
    on one again     once `FEWEST` footfalls are within `STEP_M`: on the nearest within `SAME_M`, else on a new one

Floors are numbered from the start outward, up and down: the next number begins `STOREY_M` above the lowest floor of the
one before, and a landing from `LANDING_M` on below that has none.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, P, S, V, X

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import Rest, RestParameters, find_rests
from fg_nav.detection.stance import Stances
from fg_nav.online.buffer import PartialWalk
from fg_nav.recording import MIN_SAMPLES, Recording
from fg_nav.smoother.constraints import pin_to_times, select_reached_fixes
from fg_nav.smoother.graph import initial_values
from fg_nav.smoother.heights import FEWEST
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import in_nav
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

STEP_M = 0.08  # Between two footfalls on one floor: half a riser.
SAME_M = 0.5  # A floor is found again within this: by so much heights drift on a way over stairs.
DRIFT_SHARE = 0.1  # Of a footfall's height above its floor that is drift: a slope of 4 % is followed at `SAME_M`.
STOREY_M = 2.0  # From a storey to the next at least: a low cellar.
LANDING_M = 1.0  # From a storey to a landing at least: they are halfway.


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
    """Return the keys of all values in elimination order, as `solver.list_in_time`; those of no footfall come first."""
    keys, known = dict[int, None](), list(values.keys())
    for stance in reversed(stances):
        keys.update(dict.fromkeys(reversed(list_variables(stance, values))))
    return [*(key for key in known if key not in keys), *reversed(keys)]


# --- the newest stride -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StrideWindow:
    """The samples from the footfall `before` to the new one, `stance`, with nodes and biases numbered within them."""

    recording: Recording
    stances: Stances
    nodes: Nodes
    first_sample: int  # Number of sample 0 in the walk.
    before: StanceNodes
    stance: StanceNodes
    with_context: Recording  # The samples of some seconds before as well.

    @property
    def last_before(self) -> int:
        """Last node of the footfall before, within the window."""
        return int(self.nodes.first[1]) - 1


def list_stances(nodes: Nodes, t: Floats) -> list[StanceNodes]:
    """Return the footfalls of a whole walk with samples at `t` (N,) s."""
    sample = nodes.sample[nodes.result]
    begun = t[sample][np.searchsorted(nodes.bias, nodes.bias)]
    numbers = nodes.first[:-1], nodes.first[1:], nodes.result, nodes.bias, begun, sample, t[sample]
    return [
        StanceNodes(k, first, stop, result, bias, since, at, t_at, tuple(nodes.sample[first:stop].tolist()))
        for k, (first, stop, result, bias, since, at, t_at) in enumerate(
            zip(*(one.tolist() for one in numbers), strict=True)
        )
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
    """Return the newest stride: preintegrated IMU, stance velocities and new rests, nodes numbered as in the walk."""
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
    leave a tilt whose square is a turn, the same with every stride; it starts at this `bias`.
    """
    at, of_bias = window.before.stop - 1, window.before.bias
    pose, velocity = linearized.atPose3(X(at)), linearized.atVector(V(at))
    held, sole = linearized.atConstantBias(B(of_bias)), linearized.atVector(S(of_bias))
    # A prior of a millionth on each holds them.
    tight = {size: gtsam.noiseModel.Isotropic.Sigma(size, 1e-6) for size in (1, 3, 6)}
    fixed, alone = gtsam.Values(), gtsam.NonlinearFactorGraph(graph)
    for key, value in ((X(at), pose), (V(at), velocity), (B(of_bias), held), (S(of_bias), sole)):
        fixed.insert(key, value)
    alone.addPriorPose3(X(at), pose, tight[6])
    alone.addPriorVector(V(at), velocity, tight[3])
    alone.addPriorConstantBias(B(of_bias), held, tight[6])
    alone.addPriorVector(S(of_bias), sole, tight[1])
    values = _dead_reckon(window, fixed, bias, p)
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
    """Return the fixes of a stride after `before_s`, each with its node of those at `t_node`, and its sigma there."""
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


@dataclass(frozen=True)
class FloorTrack:
    """Heights m of the floors so far, the first that of the start; on which of them the newest footfall is.

    `on` is None on no floor; `drift` m is that of heights since; `recent` are those of the newest `FEWEST` footfalls.
    """

    floors: tuple[float, ...] = (0.0,)
    on: int | None = 0
    drift: float = 0.0
    recent: tuple[float, ...] = (0.0,) * FEWEST

    def add(self, height: float) -> FloorTrack:
        """Return it with the next footfall, at a height in m."""
        recent = (*self.recent[1:], height)
        if self.on is not None and abs(height - self.recent[-1]) < STEP_M:
            above = height - self.drift - self.floors[self.on]
            if abs(above) < SAME_M:
                return replace(self, drift=self.drift + DRIFT_SHARE * above, recent=recent)
        if max(recent) - min(recent) > STEP_M:
            return replace(self, on=None, recent=recent)
        # On a floor again: the nearest, or a new one.
        level = float(np.mean(recent)) - self.drift
        nearest = min(range(len(self.floors)), key=lambda k: abs(self.floors[k] - level))
        if abs(self.floors[nearest] - level) < SAME_M:
            return replace(self, on=nearest, recent=recent)
        return FloorTrack((*self.floors, level), len(self.floors), self.drift, recent)

    @property
    def number(self) -> int | None:
        """Number of the floor of the newest footfall; None where it is on none."""
        return None if self.on is None else number_floors(self.floors)[self.on]


def track_floors(heights: Floats, floor: Ints | None, is_piece: Sequence[bool] | Bools) -> FloorTrack:
    """Return the floor track of a walk solved as a whole, at its newest footfall.

    `heights` (F,) m and `floor` (F,) level floor of its footfalls, -1 on none, None where floors were not searched;
    those that are further pieces of a standing, `is_piece` (F,), say nothing of the ground.
    """
    floor = np.full(len(heights), -1) if floor is None else floor
    levels = tuple(float(heights[floor == k].mean()) for k in range(floor.max(initial=-1) + 1))
    track = FloorTrack((0.0, *levels))
    for height, label, piece in zip(heights.tolist(), floor.tolist(), is_piece, strict=True):
        track = track if piece else track.add(height)
        track = track if label < 0 else replace(track, on=label + 1, drift=0.0)
    return track


def number_floors(heights: Sequence[float]) -> list[int | None]:
    """Return the number of each floor at these heights, m above the start; None for a landing between storeys."""
    z = np.array(heights)
    number: list[int | None] = [0] * len(z)
    for way in (1, -1):
        lowest, count = 0.0, 0
        for k in np.argsort(way * z).tolist():
            above = way * z[k] - lowest
            if above >= STOREY_M:
                lowest, count, above = way * z[k], count + way, 0.0
            if way * z[k] > 0.0:
                number[k] = None if above > LANDING_M else count
    return number
