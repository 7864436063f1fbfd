"""The newest stretch of a walk: a handover and the strides since, in iSAM2.

    samples and footfall -> nodes, inertial measurements, factors (`online.strides`, which wraps `smoother.strides`)
    field on the stride  -> its factors (`field`)
    factors              -> the graph, solved again with each stride (`isam2`)

Lever, swing noise, bias walk and the gyro bias to linearize at are those of the handover; the roughness of the field
is measured again every `field.ROUGH_EVERY` footfalls. Where the graph has no solution with a stride, it begins again
at the last footfall (`recovery`).
"""

from __future__ import annotations

from collections import Counter
from copy import deepcopy
from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, P, V, X

from fg_nav.arrays import Bools
from fg_nav.magnetic.quasi_static import UNKNOWN
from fg_nav.mechanisation import NavState
from fg_nav.online.anchor import marginalize
from fg_nav.online.buffer import PartialWalk
from fg_nav.online.differential import BiasLedger
from fg_nav.online.estimates import (
    EstimateRow,
    StanceEstimate,
    Track,
    estimate_stance,
    list_estimates,
    propagate_strapdown,
)
from fg_nav.online.field import OnlineField, Verdict, measure_field
from fg_nav.online.fixes import agrees, find_stride_fixes, fix_factor
from fg_nav.online.graph_parts import list_variables, order_variables
from fg_nav.online.handover import Handover, Past
from fg_nav.online.isam2 import ISAM2Backend
from fg_nav.online.path import nodes_of_places, nodes_of_rows, trace_stride
from fg_nav.online.recovery import REASON, check_solution, recover
from fg_nav.online.strides import Place, RestLedger, StrideWindow, cut_window, initialize_stride, measure_stride
from fg_nav.smoother.barometer import average_pressures, stride_factors
from fg_nav.smoother.dense_path import Trajectory
from fg_nav.smoother.differential import LevelBias
from fg_nav.smoother.graph import POSITION_FIX, count_graph
from fg_nav.smoother.solver import UNSOLVED
from fg_nav.smoother.strides import stride_graph

STANDS_ON = "a further piece of a standing, whose field counts once"  # Reason of a verdict.


class Stretch:
    """A stretch of a walk, which begins with what was handed over.

    Parameters
    ----------
    begun : of the footfall before its first stride.
    walk : the samples and footfalls since; whoever adds footfalls to it adds them here next.

    Raises
    ------
    RuntimeError
        Where the handover determines no solution.
    """

    def __init__(self, begun: Handover, walk: PartialWalk) -> None:
        self._begun, self._walk, self._p = begun, walk, begun.parameters
        self._field = deepcopy(begun.field)  # it changes with each stride
        self._rests, self._biases = begun.rests, begun.biases
        self._counts, self._floors = Counter(begun.counts), begun.floors
        self._places, self._verdicts = [begun.place], [begun.verdict]
        self._left: list[EstimateRow] = []
        self._backend = ISAM2Backend()
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(begun.anchor.factor())
        self._backend.reset(graph, begun.anchor.initial_values(), self._places)
        check_solution(self._backend, begun.place)
        self.latest = self._estimate()
        self._reported = [self.latest.as_row()]

    @property
    def begun(self) -> Handover:
        """What it began with."""
        return self._begun

    @property
    def field(self) -> OnlineField | None:
        """The field so far; None where it is not used."""
        return self._field

    @property
    def counts(self) -> dict[str, int]:
        """Factors since the walk began, by kind."""
        return dict(self._counts)

    @property
    def reported(self) -> tuple[EstimateRow, ...]:
        """Its footfalls as they were reported, the first that of the handover."""
        return tuple(self._reported)

    def add_newest(self) -> StanceEstimate:
        """Add the newest footfall of the walk; its estimate."""
        known = len(self._places)
        try:
            rests, biases = self._extend()
            check_solution(self._backend, self._places[-1])
        except UNSOLVED:
            del self._places[known:], self._verdicts[known:]
            self._recover()
        else:
            self._rests, self._biases = rests, biases  # the old ledgers are kept if the update failed
        if not self._walk.continues[-1]:
            self._floors = self._floors.add(float(self._backend.pose(X(self._places[-1].result)).z()))
        self.latest = self._estimate()
        self._reported.append(self.latest.as_row())
        return self.latest

    def solve(self) -> Past:
        """Return the present estimates of all its footfalls, the first that of the handover."""
        values, covariances = self._backend.solution(self._places)
        shared = self._p.moving_foot, self._begun.barometer is not None
        in_graph = list_estimates(self._places, self._verdicts, values, covariances, *shared)
        nodes = nodes_of_rows(self._left).join(nodes_of_places(self._places, values))
        return Past(self._begun.place.number, (*self._left, *in_graph), nodes)

    def hand_over(self) -> Handover:
        """Return what the walk leaves at the newest footfall; raises what `UNSOLVED` has where there is no solution."""
        found, newest = self.solve(), self._places[-1]
        values, linear = self._backend.linearize()
        keep = list_variables(newest, values)
        others = [key for key in order_variables(self._places, values) if key not in set(keep)]
        begun = self._begun
        return replace(
            begun,
            place=newest,
            verdict=self._verdicts[-1],
            anchor=marginalize(linear, values, keep, others),
            past=begun.past.join(found.before(newest)),
            first=begun.first,
            footfalls=self._walk.footfalls_since(begun.first),
            field=deepcopy(self._field),
            rests=self._rests,
            biases=self._biases,
            sensor=self._walk.sensor,
            counts=dict(self._counts),
            floors=self._floors,
        )

    def propagate(self, until: int, stands: Bools | None = None) -> Track:
        """Propagate the pose by strapdown from the last node of the last footfall.

        Parameters
        ----------
        until
            Samples of the buffer before this one are used.
        stands : (n,)
            Where the foot is seen to stand in the last n of them: it does not move there. None where not known.

        Returns
        -------
        Track
            At all samples from the last node on.
        """
        place = self._places[-1]
        recording, first = self._walk.cut_onward(place.samples[-1], until)
        still = np.zeros(len(recording), dtype=np.bool_)
        if stands is not None:
            still[len(recording) - len(stands) :] = stands
        pose, bias = self._backend.pose(X(place.stop - 1)), self._backend.bias(B(place.bias))
        state = NavState(
            np.array(pose.translation()),
            np.array(self._backend.vector(V(place.stop - 1))),
            np.ascontiguousarray(pose.rotation().matrix()),
            np.array(bias.gyroscope()),
            np.array(bias.accelerometer()),
        )
        return propagate_strapdown(recording, first, state, still, self._p.gravity)

    def _extend(self) -> tuple[RestLedger, BiasLedger | None]:
        """Add the newest stride to the graph, first its motion, then its field; return the ledgers with its rests."""
        # Factors of the stride: inertial measurements, stance velocities, rests.
        window, graph, ledger = self._measure_motion(self._places[-1])
        # The bias variable before is complete when another begins.
        biases = self._complete_bias(window, graph)
        # Initial values of its variables, and the solution with them.
        linearized, bias = self._backend.linearization_point(), self._backend.bias(B(window.before.bias))
        values = initialize_stride(window, graph, linearized, bias, self._p)
        self._add_air(window, graph, values, linearized)
        self._places.append(window.place)
        self._backend.add(graph, values, self._places)
        self._counts.update(count_graph(graph))
        # Fixes of the stride.
        self._add_fixes(window)
        # The field is compared along the path of the stride in that solution.
        track = trace_stride(self._backend, window, self._p.gravity)
        self._verdicts.append(self._add_field(window, track))
        if biases is not None:
            gyro_bias = self._backend.bias(B(window.place.bias)).gyroscope()
            biases = biases.add(window, track, gyro_bias, ledger.counted)
        return ledger, biases

    def _add_air(
        self, window: StrideWindow, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, known: gtsam.Values
    ) -> None:
        """Add the pressure at the newest footfall, and the state of the barometer where another begins."""
        barometer, before, place = self._begun.barometer, window.before, window.place
        if barometer is None:
            return
        key, elapsed_s = X(place.result), place.t - before.t
        states = P(before.number), P(place.number)
        seen = average_pressures(window.recording, window.stances, window.nodes)
        air, new = stride_factors(barometer, seen, key, values.atPose3(key).z(), states, elapsed_s, known)
        graph.push_back(air)
        values.insert(new)

    def _add_fixes(self, window: StrideWindow) -> None:
        """Add the fixes since the footfall before that agree with the graph."""
        before, place = window.before, window.place
        t_node = np.array([self._walk.buffer.stamp(sample) for sample in (*before.samples, *place.samples)])
        nodes = (*range(before.first, before.stop), *range(place.first, place.stop))
        graph = gtsam.NonlinearFactorGraph()
        for node, fix in find_stride_fixes(self._begun.fixes, t_node, float(t_node[len(before.samples) - 1])):
            key = X(nodes[node])
            if agrees(self._backend.pose(key), self._backend.covariance(key), fix):
                graph.push_back(fix_factor(key, fix))
        if graph.size():
            self._backend.add(graph, gtsam.Values(), self._places)
            self._counts[POSITION_FIX] += graph.size()

    def _measure_motion(self, before: Place) -> tuple[StrideWindow, gtsam.NonlinearFactorGraph, RestLedger]:
        known, p = self._begun.known, self._p
        window = cut_window(self._walk, before, self._begun.t_first, p)
        rests, ledger = self._rests.collect(window, p.rest)
        stride = measure_stride(window, known.gyro_bias, known.lever.lever, rests, p)
        return window, stride_graph(stride, p), ledger

    def _complete_bias(self, window: StrideWindow, graph: gtsam.NonlinearFactorGraph) -> BiasLedger | None:
        """Add what the stances of the bias variable before show, where another begins; return the ledger."""
        biases, before = self._biases, window.before
        if biases is None or window.place.bias == before.bias:
            return biases
        up = self._backend.pose(X(before.result)).rotation().matrix()[2]
        level = LevelBias(self._backend.bias(B(before.bias)).gyroscope(), up)
        graph.push_back(biases.complete(before.bias, level))
        return biases.begin()

    def _recover(self) -> None:
        """Go on from the last footfall, without the graph."""
        last, known, p = self.latest, self._begun.known, self._p
        window = cut_window(self._walk, self._places[-1], self._begun.t_first, p)
        stride = measure_stride(window, known.gyro_bias, known.lever.lever, (), p)
        recover(self._backend, last, last.pose_cov, window, stride, p, self._field is not None)
        self._left = list(self._reported)
        self._places, self._verdicts = [window.place], [Verdict(str(UNKNOWN), REASON)]
        self._biases = None if self._biases is None else self._biases.begin()

    def _add_field(self, window: StrideWindow, track: Trajectory) -> Verdict:
        """Add the field at the newest footfall and along its stride; the verdict on it."""
        field = self._field
        if field is None:
            return self._verdicts[-1]
        seen = measure_field(window.recording, window.stances, track, field.up_uT)
        continues = bool(self._walk.continues[-1])
        if continues:
            seen = replace(seen, footfall=seen.footfall.leave_out(np.ones(1, dtype=np.bool_)))
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        k, pose = window.place.number, self._backend.pose(X(window.place.result))
        nodes = window.place.result, window.before.result
        state, verdict = field.add(graph, k, *nodes, seen, pose, self._backend.vector(M(k - 1)))
        values.insert(M(k), state)
        self._backend.add(graph, values, self._places)
        self._counts.update(count_graph(graph))
        has_field = bool(np.isfinite(seen.footfall.body_field).all())
        self._counts["gated_out"] += has_field and verdict.compass_weight == 0.0
        return Verdict(UNKNOWN, STANDS_ON) if continues else verdict

    def _estimate(self) -> StanceEstimate:
        """Estimate of the newest footfall."""
        place, backend = self._places[-1], self._backend
        pose_key, bias_key = X(place.result), B(place.bias)
        return estimate_stance(
            place,
            backend.pose(pose_key),
            backend.vector(V(place.result)),
            backend.bias(bias_key),
            backend.covariance(pose_key),
            backend.covariance(bias_key),
            self._verdicts[-1],
            self._p.moving_foot,
            self._begun.barometer is not None,
            self._floors.number,
        )
