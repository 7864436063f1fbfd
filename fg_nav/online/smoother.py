"""The online smoother: a walk in progress, footfall by footfall.

    samples and footfall -> nodes, inertial measurements, factors (`online_strides`): the batch's own functions
    field on the stride  -> its factors (`online_field`)
    factors              -> the graph of the whole walk (`online_graph`), or of its last minutes (`online_lag`)
    solution             -> where the foot is now, and what is now known of the past

At a few early footfalls (`online_warm.WARM_UPS`) the walk so far is solved anew, with lever, swing noise and roughness
of the field estimated on it; from the last of these on they are held. So the minimum is near the batch's, not on it:
`finish` solves the whole walk in batch.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import asdict, dataclass, field, replace
from time import perf_counter

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, V, X

from fg_nav.arrays import Bools, Floats
from fg_nav.detection import Rest, find_rests
from fg_nav.errors import EstimationError
from fg_nav.frames import heading_of
from fg_nav.magnetic.verdicts import UNKNOWN
from fg_nav.mechanisation import NavState
from fg_nav.online.estimates import Packed, StanceEstimate, packed, table_of
from fg_nav.online.field import Verdict
from fg_nav.online.field_seen import seen_on
from fg_nav.online.fixed_lag import LaggedGraph
from fg_nav.online.isam2 import WholeGraph
from fg_nav.online.propagate import Track, carried_on
from fg_nav.online.recovery import REASON, check, go_on
from fg_nav.online.resolve import LAST_WITH_LAG, WARM_UPS, Warm, field_seen, solve_so_far
from fg_nav.online.strides import (
    CONTEXT_S,
    Place,
    StrideWindow,
    first_values,
    places_of,
    stride_of,
    window_of,
)
from fg_nav.online.ties import GraphTies
from fg_nav.online.walk import Footfall, Samples, WalkSoFar
from fg_nav.recording import MIN_SAMPLES, Recording
from fg_nav.smoother.batch import smooth
from fg_nav.smoother.covariances import in_nav, turned_about_start
from fg_nav.smoother.dense import Trajectory, dense_trajectory
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import UNSOLVED
from fg_nav.smoother.strides import add_stride
from fg_nav.solution import Solution, StanceTable


@dataclass(frozen=True)
class OnlineOptions:
    """What a user can choose.

    Attributes
    ----------
    heading_rad : of the body's x axis at the first stance, clockwise from north; None where it is not known: then
        zero, or with the field so that the mean field points north (found at footfall 4 and better at each warm-up).
    use_field : whether the magnetometer is used. Samples without one are then allowed.
    lag_s : how far back the past is still corrected, s; None for the whole walk (full mode).
    parameters : of the smoother.
    """

    heading_rad: float | None = 0.0
    use_field: bool = True
    lag_s: float | None = None
    parameters: SmootherParameters = field(default_factory=SmootherParameters)


class OnlineSmoother:
    """A walk in progress. The same calls give the same answers to the last bit: to resume, repeat them."""

    def __init__(self, options: OnlineOptions = OnlineOptions()) -> None:
        self._options = options
        self._walk = WalkSoFar()
        self._graph: WholeGraph | LaggedGraph
        self._graph = WholeGraph() if options.lag_s is None else LaggedGraph(options.lag_s)
        self._places: list[Place] = []
        self._verdicts: list[Verdict] = []
        self._frozen: list[Packed] = []
        self._causal: list[Packed] = []
        self._latest: StanceEstimate | None = None
        self._warm: Warm | None = None
        self._longest: Rest | None = None
        self._counted: Rest | None = None
        self._runtime_s = 0.0

    def add_footfall(self, samples: Samples, footfall: Footfall) -> StanceEstimate:
        """Add a complete footfall.

        Parameters
        ----------
        samples
            All samples of the walk after those of the call before, each once; at the first call from the very first.
            They reach to the end of the footfall, and may reach beyond it as far as one likes:
            what lies behind is kept for the next call. Rests are found here.
        footfall
            After the one before it.

        Raises
        ------
        EstimationError
            With samples or footfalls out of order or not finite, or if the first footfall has no up. Never for what
            the walk is like.
        """
        began = perf_counter()
        self._walk.add(samples, footfall)
        warm_up = self._walk.n_steps in self._warm_ups and not footfall.continues
        if not warm_up or not self._begin_anew():
            self._extend_or_begin_anew()
        latest = self._latest = self._estimate()
        self._causal.append(packed(latest))
        self._freeze()
        self._runtime_s += perf_counter() - began
        return latest

    @property
    def n_footfalls(self) -> int:
        """Number of footfalls so far."""
        return self._walk.n_footfalls

    @property
    def latest(self) -> StanceEstimate | None:
        """What the last call returned; None before the first."""
        return self._latest

    def causal(self) -> StanceTable:
        """Return one row a footfall: what `add_footfall` returned at the time."""
        return table_of(self._causal)

    def smoothed(self) -> StanceTable:
        """Return one row a footfall, as now known. Those that left the graph are as they were then."""
        values, found = self._graph.solution(self._places)
        rows = []
        for place, verdict in zip(self._places, self._verdicts, strict=True):
            pose, bias = values.atPose3(X(place.result)), values.atConstantBias(B(place.bias))
            velocity = values.atVector(V(place.result))
            covariances = found[X(place.result)], found[B(place.bias)]
            rows.append(self._row(place, pose, velocity, bias, *covariances, verdict))
        return table_of([*self._frozen, *(packed(row) for row in rows)])

    def propagate(self, samples: Samples, stands: Bools | None = None) -> Track:
        """Carry the pose on by strapdown from the last node of the last footfall.

        Parameters
        ----------
        samples
            Those after the ones that were handed to `add_footfall`: not kept, hand all of them in each time.
        stands : (n,)
            Where the foot is seen to stand already: it does not move there. None where this is not known.

        Returns
        -------
        Track
            At all samples from the last node on: those already handed in, and these.

        Raises
        ------
        EstimationError
            Before the first footfall.
        """
        if not self._places:
            raise EstimationError("there is no footfall yet to carry a pose on from: add one first.")
        place, p = self._places[-1], self._options.parameters
        recording, known = self._walk.with_more(samples, place.last_sample)
        still = np.zeros(len(recording), dtype=np.bool_)
        if stands is not None:
            still[len(recording) - len(stands) :] = stands
        pose, bias = self._graph.pose(X(place.stop - 1)), self._graph.bias(B(place.bias))
        state = NavState(
            np.array(pose.translation()),
            np.array(self._graph.vector(V(place.stop - 1))),
            np.ascontiguousarray(pose.rotation().matrix()),
            np.array(bias.gyroscope()),
            np.array(bias.accelerometer()),
        )
        return carried_on(recording, known, state, still, p.gravity)

    def finish(self, progress: Callable[[float], None] | None = None) -> Solution:
        """Solve the whole walk once more, in batch, with the stances as they were given: the final polish.

        With a lag the samples are gone: then the solution has one row a footfall, of `smoothed`.
        """
        if self._options.lag_s is not None:
            return self._footfalls_only()
        recording, stances = self._walk.whole(), self._walk.stances(0, 0)
        options = self._options
        field, _ = field_seen(recording, stances, options.heading_rad, options.use_field)
        return smooth(recording, stances, options.parameters, options.heading_rad, progress, field)

    def _footfalls_only(self) -> Solution:
        table = self.smoothed()
        lag = f"the past was corrected for {self._options.lag_s:g} s, and is told at footfalls only"
        return Solution(
            method="online",
            t=table.t,
            position=table.position,
            velocity=np.zeros_like(table.position),
            nav_R_body=table.nav_R_body,
            stances=table,
            runtime_s=self._runtime_s,
            parameters=asdict(self._options.parameters),
            notes=(*self.notes, lag),
        )

    @property
    def _warm_ups(self) -> tuple[int, ...]:
        """Footfalls at which the walk so far is solved anew."""
        if self._options.lag_s is None:
            return WARM_UPS
        return tuple(step for step in WARM_UPS if step <= LAST_WITH_LAG)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user."""
        return () if self._warm is None else (*self._warm.known.notes, *self._warm.verdict.notes)

    def _begin_anew(self) -> bool:
        """Solve the walk so far in batch and go on from there; False where that finds no solution."""
        options, before = self._options, copy(self._graph)
        try:
            recording, stances = self._walk.whole(), self._walk.stances(0, 0)
            warm = solve_so_far(recording, stances, options.heading_rad, options.use_field, options.parameters)
            places = places_of(warm.nodes, recording.t)
            self._graph.restart(warm.graph, warm.values, places)
            check(self._graph, places[-1])
        except UNSOLVED as error:
            if self._warm is None:
                raise EstimationError(
                    f"the walk has no beginning at footfall {self.n_footfalls - 1}: leave out the samples before it."
                ) from error
            self._graph = before
            return False
        self._warm = warm
        self._places = places
        self._frozen = []
        self._t_first = self._places[0].t
        self._verdicts = [Verdict(*both) for both in zip(warm.verdict.words, warm.verdict.reason, strict=True)]
        self._longest = max(warm.known.rests, key=lambda rest: rest.stop - rest.start, default=None)
        self._counted = warm.known.rests[-1] if warm.known.rests else None
        return True

    def _freeze(self) -> None:
        """Put aside the footfalls that left the graph, and forget their samples once no warm-up needs them."""
        for frozen in self._graph.left():
            place = self._places.pop(0)
            assert place.number == frozen.place.number
            self._frozen.append(packed(self._row(*frozen, self._verdicts.pop(0))))
        if self._options.lag_s is not None and self._walk.n_steps >= self._warm_ups[-1]:
            newest = self.n_footfalls - 1
            starts = self._walk.t[int(self._walk.footfall(newest).start[0]) - self._walk.first]
            first = self._walk.first + int(np.searchsorted(self._walk.t, starts - 2 * CONTEXT_S))
            self._walk.forget(newest, first)

    def _extend_or_begin_anew(self) -> None:
        """Add the newest stride; where the graph has no solution with it, go on from the last footfall.

        In the first minutes the walk is solved anew in batch, and only goes on so where that does not help.
        """
        if self._warm is None or self._latest is None:
            self._begin_anew()
            return
        known, rests = len(self._places), (self._longest, self._counted)
        try:
            self._extend()
            check(self._graph, self._places[-1])
        except UNSOLVED:
            self._longest, self._counted = rests
            del self._places[known:], self._verdicts[known:]
            if self._walk.n_steps < self._warm_ups[-1] and self._begin_anew():
                return
            last, warm, p = self._latest, self._warm, self._warm.parameters
            window = window_of(self._walk, self._places[-1], self._t_first, p)
            stride = stride_of(window, warm.known.gyro_bias, warm.known.lever.lever, (), p)
            turned = turned_about_start(last.position[None], warm.verdict.north_sigma)[0]
            go_on(self._graph, last, last.pose_cov - turned, window, stride, p, warm.field is not None)
            self._graph.left()
            self._frozen += self._causal[len(self._frozen) :]
            self._places, self._verdicts = [window.place], [Verdict(str(UNKNOWN), REASON)]

    def _extend(self) -> None:
        """Add the newest stride to the graph: first its motion, then its field."""
        assert self._warm is not None
        known, p = self._warm.known, self._warm.parameters
        before = self._places[-1]
        window = window_of(self._walk, before, self._t_first, p)
        stride = stride_of(window, known.gyro_bias, known.lever.lever, self._rests(window), p)
        graph = gtsam.NonlinearFactorGraph()
        add_stride(graph, GraphTies(graph), stride, p)
        begun = self._graph.begun_at()
        values = first_values(window, graph, begun, self._graph.bias(B(before.bias)), p)
        self._places.append(window.place)
        self._graph.add(graph, values, self._places, more=self._warm.field is not None)
        self._verdicts.append(self._field(window))

    def _field(self, window: StrideWindow) -> Verdict:
        assert self._warm is not None
        field, p = self._warm.field, self._warm.parameters
        if field is None:
            return self._verdicts[-1]
        begins = max(0, min(int(window.stances.start[0]), len(window.recording) - MIN_SAMPLES))
        recording = window.recording.slice(begins, len(window.recording))
        stances = self._walk.stances(window.before.number, window.first_sample + begins)
        track = self._track(recording, window, begins, p.gravity)
        seen = seen_on(recording, stances, track, field.up_uT, p.magnetic)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        k, pose = window.place.number, self._graph.pose(X(window.place.result))
        state, verdict = field.add(
            graph, k, window.place.result, window.before.result, seen, pose, self._graph.vector(M(k - 1))
        )
        values.insert(M(k), state)
        self._graph.add(graph, values, self._places)
        return verdict

    def _track(self, recording: Recording, window: StrideWindow, begins: int, gravity: float) -> Trajectory:
        """Path of the stride on its samples, through its nodes as now known."""
        nodes = range(window.before.first, window.place.stop)
        poses = [self._graph.pose(X(j)) for j in nodes]
        bias = [self._graph.bias(B(place.bias)).vector() for place in (window.before, window.place)]
        both = np.array(bias)[window.nodes.footfall - window.nodes.footfall[0]]
        return Trajectory(
            *dense_trajectory(
                recording,
                window.nodes.sample - begins,
                np.array([pose.translation() for pose in poses]),
                np.array([self._graph.vector(V(j)) for j in nodes]),
                np.array([pose.rotation().matrix() for pose in poses]),
                np.ascontiguousarray(both[:, 3:]),
                np.ascontiguousarray(both[:, :3]),
                gravity,
            )
        )

    def _rests(self, window: StrideWindow) -> tuple[Rest, ...]:
        """What the rests of the window show that was not counted yet, if they agree with the longest of the walk."""
        p, begins = self._options.parameters.rest, window.nodes.sample[window.known + 1]
        new = []
        for rest in find_rests(window.recording, p):
            if rest.stop <= begins or not rest.lasts(window.recording.period_s, p.shortest_s):
                continue
            if self._longest is None or rest.stop - rest.start > self._longest.stop - self._longest.start:
                self._longest = rest
            if rest.agrees_with(self._longest, p):
                new.append(self._not_counted(rest, window.first_sample))
        return tuple(rest for rest in new if rest is not None)

    def _not_counted(self, rest: Rest, first_sample: int) -> Rest | None:
        """What a rest shows beyond what was counted of it; a long one is seen again and again as it goes on."""
        start, stop = rest.start + first_sample, rest.stop + first_sample
        before, self._counted = self._counted, replace(rest, start=start, stop=stop)
        if before is None or start >= before.stop:
            return rest
        further = rest.beyond(before)
        if further is None:
            self._counted = replace(before, stop=stop)
        return further

    def _estimate(self) -> StanceEstimate:
        place = self._places[-1]
        graph, pose_key, bias_key = self._graph, X(place.result), B(place.bias)
        return self._row(
            place,
            graph.pose(pose_key),
            graph.vector(V(place.result)),
            graph.bias(bias_key),
            graph.covariance(pose_key),
            graph.covariance(bias_key),
            self._verdicts[-1],
        )

    def _row(
        self,
        place: Place,
        pose: gtsam.Pose3,
        velocity: Floats,
        bias: gtsam.imuBias.ConstantBias,
        body_cov: Floats,
        bias_cov: Floats,
        verdict: Verdict,
    ) -> StanceEstimate:
        assert self._warm is not None
        position, attitude = np.asarray(pose.translation()), pose.rotation().matrix()
        turned = turned_about_start(position[None], self._warm.verdict.north_sigma)[0]
        return StanceEstimate(
            number=place.number,
            sample=place.sample,
            t=place.t,
            position=position,
            nav_R_body=attitude,
            heading=float(heading_of(attitude)),
            velocity=velocity,
            gyro_bias=np.asarray(bias.gyroscope()),
            pose_cov=in_nav(attitude[None], body_cov[None])[0] + turned,
            gyro_bias_sigma=np.sqrt(np.diagonal(bias_cov)[3:]),
            field=verdict.word,
            field_reason=verdict.reason,
        )
