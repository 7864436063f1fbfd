"""The online smoother: footfalls in, the estimate of each out.

    samples and footfall -> nodes, inertial measurements, factors (`online.strides`, which wraps `smoother.strides`)
    field on the stride  -> its factors (`field`)
    factors              -> the graph of the whole walk (`isam2`), or of its last minutes (`fixed_lag`)
    solution             -> where the foot is now, and the estimates of all footfalls so far

At a few early footfalls (`resolve.RESOLVE_AT`) the walk so far is solved again in batch, with lever, swing noise, gyro
bias, its random walk, the height of clipped peaks and the roughness of the field estimated on it, and the stances that
it refuses trusted less. After the last re-solve all these and the gyro bias to linearize at stay fixed, and between
two of them no new stance is refused, so the optimum differs slightly from the batch's. The roughness of the field is
measured again every `field.ROUGH_EVERY` footfalls.
"""

from __future__ import annotations

from collections import Counter
from copy import copy
from dataclasses import dataclass, field, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, V, X

from fg_nav.arrays import Bools
from fg_nav.detection.causal import Footfall
from fg_nav.errors import EstimationError
from fg_nav.magnetic.axes import MagAxes
from fg_nav.magnetic.quasi_static import QUASI_STATIC, UNKNOWN
from fg_nav.mechanisation import NavState
from fg_nav.online.backend import Backend
from fg_nav.online.buffer import SampleBuffer, WalkSoFar
from fg_nav.online.differential import BiasLedger
from fg_nav.online.estimates import (
    EstimateRow,
    StanceEstimate,
    Track,
    build_table,
    estimate_stance,
    propagate_strapdown,
)
from fg_nav.online.field import Verdict, measure_field
from fg_nav.online.fixed_lag import FixedLagBackend
from fg_nav.online.isam2 import ISAM2Backend
from fg_nav.online.path import PathNodes, collect_nodes, trace_stride
from fg_nav.online.recovery import REASON, check_solution, recover
from fg_nav.online.resolve import LAST_WITH_LAG, RESOLVE_AT, WalkSolution, solve_so_far
from fg_nav.online.strides import (
    CONTEXT_S,
    Place,
    RestLedger,
    StrideWindow,
    cut_window,
    initialize_stride,
    list_places,
    measure_stride,
)
from fg_nav.recording import MIN_SAMPLES, Recording
from fg_nav.smoother.count import count_factors, count_graph
from fg_nav.smoother.differential_factors import LevelBias
from fg_nav.smoother.graph import Trajectory
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import UNSOLVED
from fg_nav.smoother.strides import stride_graph
from fg_nav.solution import StanceTable

STANDS_ON = "a further piece of a standing, whose field counts once"
"""Reason of a verdict."""


@dataclass(frozen=True)
class OnlineOptions:
    """What a user can choose.

    Attributes
    ----------
    heading_rad : of the body's x axis at the first stance, clockwise from north; None where it is not known: then
        zero, or with the field so that the mean field points north (found at footfall 4 and better each time the walk
        is solved again).
    use_field : whether the magnetometer is used. Samples without one are then allowed.
    lag_s : how far back the past is still corrected, s; None for the whole walk (full mode).
    parameters : of the smoother.
    axes_given : whether the magnetometer is used whatever its axes look like.
    """

    heading_rad: float | None = 0.0
    use_field: bool = True
    lag_s: float | None = None
    parameters: SmootherParameters = field(default_factory=SmootherParameters)
    axes_given: bool = False


class OnlineSmoother:
    """A walk in progress. The same calls give the same answers to the bit: a walk is resumed by replaying its calls.

    Parameters
    ----------
    options : chosen by the user.
    buffer : of the samples, filled by whoever adds footfalls; with a lag its beginning is discarded here.
    """

    def __init__(self, options: OnlineOptions, buffer: SampleBuffer) -> None:
        self._options = options
        self._walk = WalkSoFar(buffer, options.use_field, options.axes_given)
        self._backend: Backend
        self._backend = ISAM2Backend() if options.lag_s is None else FixedLagBackend(options.lag_s)
        self._places: list[Place] = []
        self._verdicts: list[Verdict] = []
        self._frozen: list[EstimateRow] = []
        self._causal: list[EstimateRow] = []
        self._latest: StanceEstimate | None = None
        self._batch: WalkSolution | None = None
        self._rests = RestLedger()
        self._counts: Counter[str] = Counter()
        self._biases: BiasLedger | None = None

    def add_footfall(self, footfall: Footfall, until: int) -> StanceEstimate:
        """Add a complete footfall.

        Parameters
        ----------
        footfall
            After the one before it.
        until
            Samples of the buffer before this one are used; they reach to the end of the footfall or beyond. Rests are
            found in them.

        Raises
        ------
        EstimationError
            With samples or footfalls out of order or not finite, or if the first footfall has no up. Valid input
            never raises, however the person moved.
        """
        self._walk.add(footfall, until)
        # At some early footfalls the walk so far is solved again in batch; else the newest stride extends the graph.
        is_scheduled = self._walk.n_steps in self._schedule and not footfall.continues
        if not is_scheduled or not self._solve_again():
            self._extend_or_recover()
        self._latest = self._estimate()
        self._causal.append(self._latest.as_row())
        # Footfalls that left the graph keep their last estimate; samples that nothing needs any more are discarded.
        self._freeze()
        if self._options.lag_s is not None and self._walk.n_steps >= self._schedule[-1]:
            self._discard()
        return self._latest

    @property
    def n_footfalls(self) -> int:
        """Number of footfalls so far."""
        return self._walk.n_footfalls

    @property
    def latest(self) -> StanceEstimate | None:
        """What the last call returned; None before the first."""
        return self._latest

    @property
    def parameters(self) -> SmootherParameters:
        """Those in effect: with the swing noise that was chosen."""
        return self._options.parameters if self._batch is None else self._batch.parameters

    @property
    def peak_height(self) -> float:
        """How high clipped peaks of the rate are above the range, in what their flanks say."""
        return self._walk.peak_height

    @property
    def counts(self) -> dict[str, int]:
        """Factors that were added since the walk began, by kind."""
        return dict(self._counts)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user."""
        if self._batch is None:
            return ()
        found = self._walk.magnetometer
        return (*self._batch.known.notes, *self._batch.verdict.notes, *(() if found is None else found.notes))

    @property
    def wrong_axes(self) -> MagAxes | None:
        """Axes of the magnetometer where they are not the gyroscope's."""
        return None if self._walk.magnetometer is None else self._walk.magnetometer.wrong_axes

    def causal(self) -> StanceTable:
        """Return one row a footfall: what `add_footfall` returned at the time."""
        return build_table(self._causal)

    def smoothed(self) -> StanceTable:
        """Return one row a footfall: the present estimates. Those that left the graph are as they were then."""
        return self.solution()[0]

    def solution(self) -> tuple[StanceTable, PathNodes]:
        """Return the present estimates: one row a footfall, and the nodes of the path."""
        values, covariances = self._backend.solution(self._places)
        rows, moving_foot = [], self.parameters.moving_foot
        for place, verdict in zip(self._places, self._verdicts, strict=True):
            pose, bias = X(place.result), B(place.bias)
            state = values.atPose3(pose), values.atVector(V(place.result)), values.atConstantBias(bias)
            rows.append(estimate_stance(place, *state, covariances[pose], covariances[bias], verdict, moving_foot))
        table = build_table([*self._frozen, *(row.as_row() for row in rows)])
        return table, collect_nodes(self._frozen, self._places, values)

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

        Raises
        ------
        EstimationError
            Before the first footfall.
        """
        if not self._places:
            raise EstimationError("there is no footfall yet to carry a pose on from: add one first.")
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
        return propagate_strapdown(recording, first, state, still, self._options.parameters.gravity)

    @property
    def _schedule(self) -> tuple[int, ...]:
        """Footfalls at which the walk so far is solved again."""
        if self._options.lag_s is None:
            return RESOLVE_AT
        return tuple(step for step in RESOLVE_AT if step <= LAST_WITH_LAG)

    def _solve_again(self) -> bool:
        """Solve the walk so far in batch and go on from there; False where that finds no solution."""
        options, before = self._options, copy(self._backend)
        try:
            self._walk.align_magnetometer()
            recording, stances = self._walk.cut_whole(), self._walk.cut_stances(0, 0)
            given = (options.heading_rad, options.use_field, options.parameters, self._walk.continues)
            batch = solve_so_far(recording, stances, *given)
            places = list_places(batch.nodes, recording.t)
            self._backend.reset(batch.problem.factors(), batch.values, places)
            check_solution(self._backend, places[-1])
        except UNSOLVED as error:
            if self._batch is None:
                raise EstimationError(
                    f"the walk has no beginning at footfall {self.n_footfalls - 1}: leave out the samples before it."
                ) from error
            self._backend = before
            return False
        self._batch, self._places, self._frozen = batch, places, []
        self._walk.peak_height = batch.known.peak_height
        self._t_first = places[0].t
        self._verdicts = [Verdict(*both) for both in zip(batch.verdict.words, batch.verdict.reason, strict=True)]
        self._rests = RestLedger.from_rests(batch.known.rests)
        self._counts = count_factors(batch.problem)
        self._biases = BiasLedger.from_factors(batch.problem.differential)
        return True

    def _extend_or_recover(self) -> None:
        """Add the newest stride; where the graph has no solution with it, go on from the last footfall.

        In the first minutes the walk is solved again in batch, and goes on from there only where that does not help.
        """
        if self._batch is None:
            self._solve_again()
            return
        known = len(self._places)
        try:
            rests, biases = self._extend()
            check_solution(self._backend, self._places[-1])
        except UNSOLVED:
            del self._places[known:], self._verdicts[known:]
            if self._walk.n_steps >= self._schedule[-1] or not self._solve_again():
                self._recover()
        else:
            self._rests, self._biases = rests, biases  # the old ledgers are kept if the update failed

    def _extend(self) -> tuple[RestLedger, BiasLedger | None]:
        """Add the newest stride to the graph, first its motion, then its field; return the ledgers with its rests."""
        assert self._batch is not None
        known, p = self._batch.known, self._batch.parameters
        before = self._places[-1]
        # Factors of the stride: inertial measurements, stance velocities, rests.
        window = cut_window(self._walk, before, self._t_first, p)
        rests, ledger = self._rests.collect(window, self._options.parameters.rest)
        stride = measure_stride(window, known.gyro_bias, known.lever.lever, rests, p)
        graph = stride_graph(stride, p)
        # The bias variable before is complete when another begins.
        biases = self._biases
        if biases is not None and window.place.bias != before.bias:
            up = self._backend.pose(X(before.result)).rotation().matrix()[2]
            level = LevelBias(self._backend.bias(B(before.bias)).gyroscope(), up)
            graph.push_back(biases.complete(before.bias, level))
            biases = biases.begin()
            self._counts["differential_field"] += 1
        # Initial values of its variables, and the solution with them.
        linearized, bias = self._backend.linearization_point(), self._backend.bias(B(before.bias))
        values = initialize_stride(window, graph, linearized, bias, p)
        self._places.append(window.place)
        self._backend.add(graph, values, self._places, more=self._batch.field is not None)
        self._counts.update(count_graph(graph))
        # The field is compared along the path of the stride in that solution.
        stride_path = self._cut_stride(window)
        self._verdicts.append(self._add_field(window, *stride_path))
        if biases is not None:
            gyro_bias = self._backend.bias(B(window.place.bias)).gyroscope()
            biases = biases.add(window, *stride_path, gyro_bias, ledger.counted)
        return ledger, biases

    def _recover(self) -> None:
        """Go on from the last footfall, without the graph."""
        assert self._batch is not None
        assert self._latest is not None
        last, batch, p = self._latest, self._batch, self._batch.parameters
        window = cut_window(self._walk, self._places[-1], self._t_first, p)
        stride = measure_stride(window, batch.known.gyro_bias, batch.known.lever.lever, (), p)
        recover(self._backend, last, last.pose_cov, window, stride, p, batch.field is not None)
        self._backend.take_marginalized()
        self._frozen += self._causal[len(self._frozen) :]
        self._places, self._verdicts = [window.place], [Verdict(str(UNKNOWN), REASON)]
        self._biases = None if self._biases is None else self._biases.begin()

    def _cut_stride(self, window: StrideWindow) -> tuple[Recording, int, Trajectory]:
        """Samples of the stride, the first of them in the window, and the path through the estimates of its nodes."""
        begins = max(0, min(int(window.stances.start[0]), len(window.recording) - MIN_SAMPLES))
        recording = window.recording.slice(begins, len(window.recording))
        return (
            recording,
            begins,
            trace_stride(self._backend, recording, window, begins, self._options.parameters.gravity),
        )

    def _add_field(self, window: StrideWindow, recording: Recording, begins: int, track: Trajectory) -> Verdict:
        """Add the field at the newest footfall and along its stride; the verdict on it."""
        assert self._batch is not None
        field = self._batch.field
        if field is None:
            return self._verdicts[-1]
        stances = self._walk.cut_stances(window.before.number, window.first_sample + begins)
        seen = measure_field(recording, stances, track, field.up_uT)
        continues = bool(self._walk.continues[-1])
        if continues:
            seen = replace(seen, footfall=seen.footfall.leave_out(np.ones(1, dtype=np.bool_)))
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        k, pose = window.place.number, self._backend.pose(X(window.place.result))
        state, verdict = field.add(
            graph, k, window.place.result, window.before.result, seen, pose, self._backend.vector(M(k - 1))
        )
        values.insert(M(k), state)
        self._backend.add(graph, values, self._places)
        self._counts.update(count_graph(graph))
        has_field = bool(np.isfinite(seen.footfall.body_field).all())
        self._counts["gated_out"] += has_field and verdict.word != QUASI_STATIC
        return Verdict(UNKNOWN, STANDS_ON) if continues else verdict

    def _freeze(self) -> None:
        """Take the footfalls that left the graph out of the lists, each with its own verdict."""
        for marginalized in self._backend.take_marginalized():
            place = self._places.pop(0)
            assert place.number == marginalized.place.number
            self._frozen.append(
                estimate_stance(*marginalized, self._verdicts.pop(0), self.parameters.moving_foot).as_row()
            )

    def _discard(self) -> None:
        """Discard footfalls before the newest, and samples that no window reaches any more."""
        newest = self.n_footfalls - 1
        starts = self._walk.buffer.stamp(int(self._walk.footfall(newest).start[0]))
        self._walk.discard(newest, self._walk.buffer.find_since(starts - 2 * CONTEXT_S, self._walk.stop))

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
            self.parameters.moving_foot,
        )
