"""The newest window of a walk: an anchor state and the strides since, in iSAM2.

    samples and footfall -> nodes, inertial measurements, factors (`online.strides`, by `smoother.strides`)
    field on the stride  -> its factors (`field`)
    factors              -> the graph, solved again with each stride (`isam2`)

Lever, swing noise, bias walk and the gyro bias to linearize at are those of the anchor state; the roughness of the
field is measured again every `field.ROUGH_EVERY` footfalls. Where the graph has no solution with a stride, it begins
again at the last footfall (`isam2.recover`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from copy import deepcopy
from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, P, V, X

from fg_nav.factors.walk_constraints import position_fix_factor, position_fix_noise
from fg_nav.magnetic.quasi_static import UNKNOWN
from fg_nav.online.anchor import AnchorState, Past, PathNodes, marginalize
from fg_nav.online.buffer import PartialWalk, ReportedFootfall
from fg_nav.online.estimates import (
    EstimateRow,
    StanceEstimate,
    StrapdownPath,
    estimate_stance,
    list_estimates,
)
from fg_nav.online.field import BiasLedger, CompassVerdict, measure_field
from fg_nav.online.isam2 import REASON, ISAM2Backend, check_solution, recover
from fg_nav.online.strides import (
    RestLedger,
    StrideWindow,
    agrees,
    cut_stride,
    find_stride_fixes,
    initialize_stride,
    list_variables,
    measure_stride,
    order_variables,
)
from fg_nav.smoother.differential import LevelBias
from fg_nav.smoother.graph import POSITION_FIX, Trajectory, count_graph, dense_trajectory
from fg_nav.smoother.heights import average_pressures, stride_factors
from fg_nav.smoother.solver import UNSOLVED
from fg_nav.smoother.strides import stride_graph

STANDS_ON = "a further piece of a standing, whose field counts once"  # Reason of a verdict.


class Window:
    """The newest window of a walk, since the anchor state `initial`; `latest` is the estimate of its newest footfall.

    Raises `RuntimeError` where the anchor state determines no solution. Footfalls are added to the walk first.
    """

    def __init__(self, initial: AnchorState, walk: PartialWalk) -> None:
        self.initial, self._walk, self._p = initial, walk, initial.parameters
        self.field = deepcopy(initial.field)  # it changes with each stride
        self._rests, self._biases = initial.rests, initial.biases
        self.counts, self._floors = Counter(initial.counts), initial.floors
        self._stances, self._verdicts = [initial.stance], [initial.verdict]
        self._left: list[EstimateRow] = []  # as reported, of footfalls that are in the graph no more
        self._backend = ISAM2Backend()
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(initial.prior.factor())
        self._backend.reset(graph, initial.prior.initial_values(), self._stances)
        check_solution(self._backend, initial.stance)
        self.latest = self._estimate()
        self.reported = [self.latest.as_row()]  # its footfalls, the first that of the anchor state

    def extend(self, footfalls: Iterable[ReportedFootfall]) -> None:
        """Add footfalls to the walk and to the graph."""
        for footfall in footfalls:
            self._walk.add(footfall)
            self.add_newest()

    def add_newest(self) -> None:
        """Add the newest footfall of the walk; restart from the one before where the graph has no solution."""
        n_before = len(self._stances)
        try:
            rests, biases = self._extend()
            check_solution(self._backend, self._stances[-1])
        except UNSOLVED:
            del self._stances[n_before:], self._verdicts[n_before:]
            self._recover()
        else:
            self._rests, self._biases = rests, biases  # the old ledgers are kept if the update failed
        if not self._walk.continues[-1]:
            self._floors = self._floors.add(float(self._backend.pose(X(self._stances[-1].result)).z()))
        self.latest = self._estimate()
        self.reported.append(self.latest.as_row())

    def solve(self) -> Past:
        """Return the present estimates of all its footfalls, the first that of the anchor state."""
        values, covariances = self._backend.solution(self._stances)
        shared = self._p.moving_foot, self.initial.barometer is not None
        in_graph = list_estimates(self._stances, self._verdicts, values, covariances, *shared)
        nodes = PathNodes.from_rows(self._left).join(PathNodes.from_values(self._stances, values))
        return Past(self.initial.stance.number, (*self._left, *in_graph), nodes)

    def to_anchor(self) -> AnchorState:
        """Return the anchor state at the newest footfall; raises `UNSOLVED` where there is no solution."""
        found, newest, initial = self.solve(), self._stances[-1], self.initial
        values, linear = self._backend.linearize()
        keep = list_variables(newest, values)
        others = [key for key in order_variables(self._stances, values) if key not in set(keep)]
        return replace(
            initial,
            stance=newest,
            verdict=self._verdicts[-1],
            prior=marginalize(linear, values, keep, others),
            past=initial.past.join(found.before(newest)),
            footfalls=self._walk.footfalls_since(initial.first),
            field=deepcopy(self.field),
            rests=self._rests,
            biases=self._biases,
            sensor=self._walk.sensor,
            counts=dict(self.counts),
            floors=self._floors,
        )

    def propagate(self, until: int) -> StrapdownPath:
        """Propagate the pose by strapdown from the last node of the last footfall to the sample before `until`."""
        stance = self._stances[-1]
        recording, first = self._walk.cut_onward(stance.samples[-1], until)
        pose, bias = self._backend.pose(X(stance.stop - 1)), self._backend.bias(B(stance.bias))
        motion = pose.translation(), self._backend.vector(V(stance.stop - 1)), pose.rotation().matrix()
        node = PathNodes._make(np.array([part]) for part in (first, *motion, bias.gyroscope(), bias.accelerometer()))
        path = dense_trajectory(recording, *node, self._p.gravity)
        return StrapdownPath(recording.t[first:], *(part[first:] for part in path))

    def _extend(self) -> tuple[RestLedger, BiasLedger | None]:
        """Add the newest stride to the graph, first its motion, then its field; return the ledgers with its rests."""
        # Factors of the stride: inertial measurements, stance velocities, rests.
        backend, known, p = self._backend, self.initial.known, self._p
        window = cut_stride(self._walk, self._stances[-1], self.initial.t_first, p)
        before, stance = window.before, window.stance
        rests, ledger = self._rests.collect(window, p.rest)
        graph = stride_graph(measure_stride(window, known.gyro_bias, known.lever.lever, rests, p), p)
        # The bias variable before is complete when another begins: what its stances show joins the graph.
        biases = self._biases
        if biases is not None and stance.bias != before.bias:
            up = backend.pose(X(before.result)).rotation().matrix()[2]
            level = LevelBias(backend.bias(B(before.bias)).gyroscope(), up)
            graph.push_back(biases.complete(before.bias, level))
            biases = biases.begin()
        # Initial values of its variables.
        linearized, bias = backend.linearization_point, backend.bias(B(before.bias))
        values = initialize_stride(window, graph, linearized, bias, p)
        # The pressure at the footfall, and a state of the barometer.
        if self.initial.barometer is not None:
            key, states = X(stance.result), (P(before.number), P(stance.number))
            pressure = average_pressures(window.recording, window.stances, window.nodes)
            height, elapsed_s = values.atPose3(key).z(), stance.t - before.t
            air, new = stride_factors(self.initial.barometer, pressure, key, height, states, elapsed_s, linearized)
            graph.push_back(air)
            values.insert(new)
        # The solution with them, and with the fixes of the stride.
        self._stances.append(stance)
        backend.add(graph, values, self._stances)
        self.counts.update(count_graph(graph))
        self._add_fixes(window)
        # The field needs the stride's path for its line integral: it is added after that solution.
        track = self._trace_stride(window)
        self._verdicts.append(self._add_field(window, track))
        if biases is not None:
            biases = biases.add(window, track, backend.bias(B(stance.bias)).gyroscope(), ledger.counted)
        return ledger, biases

    def _add_fixes(self, window: StrideWindow) -> None:
        """Add the fixes since the footfall before that agree with the graph."""
        before, stance = window.before, window.stance
        t_node = np.array([self._walk.buffer.stamp(sample) for sample in (*before.samples, *stance.samples)])
        nodes = (*range(before.first, before.stop), *range(stance.first, stance.stop))
        graph = gtsam.NonlinearFactorGraph()
        for node, fix in find_stride_fixes(self.initial.fixes, t_node, float(t_node[len(before.samples) - 1])):
            key = X(nodes[node])
            if agrees(self._backend.pose(key), self._backend.covariance(key), fix):
                noise = position_fix_noise(fix.horizontal_sigma_m, fix.vertical_sigma_m)
                graph.push_back(position_fix_factor(key, fix.position, noise))
        if graph.size():
            self._backend.add(graph, gtsam.Values(), self._stances)
            self.counts[POSITION_FIX] += graph.size()

    def _trace_stride(self, window: StrideWindow) -> Trajectory:
        """Return the path of the newest stride at the samples of its window."""
        nodes = range(window.before.first, window.stance.stop)
        poses = [self._backend.pose(X(j)) for j in nodes]
        bias = [self._backend.bias(B(stance.bias)).vector() for stance in (window.before, window.stance)]
        both = np.array(bias)[window.nodes.footfall - window.nodes.footfall[0]]
        return dense_trajectory(
            window.recording,
            window.nodes.sample,
            np.array([pose.translation() for pose in poses]),
            np.array([self._backend.vector(V(j)) for j in nodes]),
            np.array([pose.rotation().matrix() for pose in poses]),
            np.ascontiguousarray(both[:, 3:]),
            np.ascontiguousarray(both[:, :3]),
            self._p.gravity,
        )

    def _add_field(self, window: StrideWindow, track: Trajectory) -> CompassVerdict:
        """Add the field at the newest footfall and along its stride; return the verdict on it."""
        field = self.field
        if field is None:
            return self._verdicts[-1]
        measured = measure_field(window.recording, window.stances, track, field.up_uT)
        continues = bool(self._walk.continues[-1])
        if continues:
            measured = replace(measured, footfall=measured.footfall.leave_out(np.ones(1, dtype=np.bool_)))
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        k, pose = window.stance.number, self._backend.pose(X(window.stance.result))
        nodes = window.stance.result, window.before.result
        state, verdict = field.add(graph, k, *nodes, measured, pose, self._backend.vector(M(k - 1)))
        values.insert(M(k), state)
        self._backend.add(graph, values, self._stances)
        self.counts.update(count_graph(graph))
        has_field = bool(np.isfinite(measured.footfall.body_field).all())
        self.counts["gated_out"] += has_field and verdict.compass_weight == 0.0
        return CompassVerdict(UNKNOWN, STANDS_ON) if continues else verdict

    def _recover(self) -> None:
        """Restart from the last footfall, without the graph."""
        last, known, p = self.latest, self.initial.known, self._p
        window = cut_stride(self._walk, self._stances[-1], self.initial.t_first, p)
        stride = measure_stride(window, known.gyro_bias, known.lever.lever, (), p)
        recover(self._backend, last, last.pose_cov, window, stride, p, self.field is not None)
        self._left = list(self.reported)
        self._stances, self._verdicts = [window.stance], [CompassVerdict(str(UNKNOWN), REASON)]
        self._biases = None if self._biases is None else self._biases.begin()

    def _estimate(self) -> StanceEstimate:
        """Return the estimate of the newest footfall."""
        stance, backend = self._stances[-1], self._backend
        pose_key, bias_key = X(stance.result), B(stance.bias)
        return estimate_stance(
            stance,
            backend.pose(pose_key),
            backend.vector(V(stance.result)),
            backend.bias(bias_key),
            backend.covariance(pose_key),
            backend.covariance(bias_key),
            self._verdicts[-1],
            self._p.moving_foot,
            self.initial.barometer is not None,
            self._floors.number,
        )
