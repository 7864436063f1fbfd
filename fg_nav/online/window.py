"""The newest window of a walk: an anchor state and the strides since, in iSAM2.

    anchor state         -> marginal prior: what the whole walk before knows of its newest footfall
    samples, footfall    -> nodes, inertial measurements, factors (`strides`); the field on the stride (`field`)
    factors              -> iSAM2, solved with each stride: the estimate of the moment
    all of its factors   -> the minimum of the window, by the batch's Gauss-Newton: its past, and the next anchor state

Anchor state. The triangle R of the solved walk leaves of the variables x of its newest footfall, with Y = R^-T E, E
their columns, the covariance Y^T Y = T^T T by QR of Y, and

    1/2 |A d|^2,     A = T^-T,     d the step of x in its tangent space from the solution,

the square root of their information. As one factor, the marginal prior, it stands for the whole past in the graph of
the strides that follow (concurrent filtering and smoothing: Williams et al. 2014, IJRR 33, 1544). Nothing is lost but
the choice to linearize the past again. What makes iSAM2 quick and exact (table in docs/online.md):

* Relinearization by attitude, bias and field. Position and velocity enter linearly once they are in the body's axes; a
  heading that moved by a does not, and an old linearization costs a^2/2 of each stride. Variables are checked from the
  newest footfall backward until one is below its threshold.
* New variables start where the footfall before is linearized, not at its estimate (`initialize_stride`).
* The linearization point is held alive in Python: pybind then passes the same object to every factor written in Python,
  else each would get a copy of all values at each call.
* QR: the information of a bias over hours and of a node over milliseconds differ by more than Cholesky resolves.

Lever, swing noise, bias walk and the gyro bias to linearize at are those of the anchor state. Where the graph has no
solution with a stride it begins again at the last footfall, as it was reported, with that stride; where that has none
either, with the stride of a person who was not seen (`smoother.strides`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, P, S, V, X
from scipy.linalg import solve_triangular

from fg_nav.arrays import Floats
from fg_nav.factors.magnetic_field import SIZE
from fg_nav.factors.residual import LETTER_SHIFT, guarded_factor
from fg_nav.factors.walk_constraints import UnseenWalk, position_fix_noise
from fg_nav.frames import UNKNOWN_RAD
from fg_nav.magnetic.detectors import UNKNOWN
from fg_nav.online.buffer import PartialWalk, ReportedFootfall, SensorState
from fg_nav.online.estimates import (
    CompassVerdict,
    EstimateRow,
    Past,
    PathNodes,
    StanceEstimate,
    StrapdownPath,
    estimate_stance,
    list_estimates,
)
from fg_nav.online.field import OnlineField
from fg_nav.online.strides import (
    FloorTrack,
    RestLedger,
    StanceNodes,
    StrideWindow,
    agrees,
    cut_stride,
    find_stride_fixes,
    initialize_stride,
    list_variables,
    measure_stride,
    order_variables,
    result_keys,
)
from fg_nav.smoother.graph import POSITION_FIX, Known, Trajectory, count_graph, dense_trajectory
from fg_nav.smoother.heights import Barometer, average_pressures, stride_factors
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import UNSOLVED, Minimum, WalkSystem, dimension_of, find_minimum
from fg_nav.smoother.square_root import SquareRoot
from fg_nav.smoother.strides import (
    ACC_BIAS_SIGMA,
    CLIMBING_M_S,
    TILT_SIGMA_RAD,
    TURNING_RAD,
    WALKING_M_S,
    Stride,
    add_stride,
    stride_graph,
    walk_for,
)
from fg_nav.solution import Return
from fg_nav.truth import Fix

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

STANDS_ON = "the foot still stands: the field of a standing counts once"  # Reason of a verdict.
REASON = "the walk had no solution here, and goes on from the footfall before"
NODE_SPEED_M_S = 0.1  # Sigma of the velocity of a foot at the end of its stance,
SWINGING_M_S = 3.0  # and of one that was not seen.
WEAK_UT = 100.0  # Sigma of the state of the field where the graph begins again.


# --- the anchor state ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MarginalPrior:
    """Square-root information A (d, d) on the variables `keys`, at their `values`.

    The value of a pose is its matrix (4, 4), that of a bias (6,) accelerometer and gyroscope, others are vectors.
    """

    keys: tuple[int, ...]
    values: tuple[Floats, ...]
    A: Floats

    def factor(self) -> gtsam.CustomFactor:
        """Return the factor |A d|^2 / 2, d the step from the stored to the present values, in tangent space."""
        dims = [dimension_of(key) for key in self.keys]
        by_key = np.split(self.A, np.cumsum(dims)[:-1], axis=1)

        def evaluate(values: gtsam.Values, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
            # d is in the tangent space of the stored pose, the Jacobian in that of the present pose: chain rule.
            steps, jacobians = list[Floats](), list[Floats]()
            for key, value, A in zip(self.keys, self.values, by_key, strict=True):
                now = _value_of(values, key)
                if value.ndim == 2:
                    steps.append(gtsam.Pose3.Logmap(gtsam.Pose3(value).between(gtsam.Pose3(now))))
                    A = A @ gtsam.Pose3.LogmapDerivative(steps[-1])
                else:
                    steps.append(now - value)
                jacobians.append(np.ascontiguousarray(A))
            return self.A @ np.concatenate(steps), jacobians if with_jacobians else []

        return guarded_factor("anchor", self.keys, dims, gtsam.noiseModel.Unit.Create(len(self.A)), evaluate)

    def initial_values(self) -> gtsam.Values:
        """Return the stored values, as initial estimate of a graph."""
        values = gtsam.Values()
        for key, value in zip(self.keys, self.values, strict=True):
            if value.ndim == 2:
                values.insert(key, gtsam.Pose3(value))
            elif key >> LETTER_SHIFT == ord("b"):
                values.insert(key, gtsam.imuBias.ConstantBias(value[:3], value[3:]))
            else:
                values.insert(key, value)
        return values


def marginalize(root: SquareRoot, values: gtsam.Values, keep: Sequence[int]) -> MarginalPrior:
    """Return the marginal prior on the variables `keep`, from the triangle of a graph at its minimum `values`."""
    columns = np.concatenate([root.find_columns([[key]])[0] for key in keep])
    unit = np.zeros((root.total, len(columns)))
    unit[columns, np.arange(len(columns))] = 1.0
    T: Floats = np.asarray(np.linalg.qr(root.forward_substitute(unit), mode="r"))
    A: Floats = np.asarray(solve_triangular(T, np.eye(len(T)), trans="T"))
    return MarginalPrior(tuple(keep), tuple(_value_of(values, key) for key in keep), A)


def _value_of(values: gtsam.Values, key: int) -> Floats:
    letter = key >> LETTER_SHIFT
    if letter == ord("x"):
        return np.array(values.atPose3(key).matrix())
    return np.array(values.atConstantBias(key).vector() if letter == ord("b") else values.atVector(key))


@dataclass(frozen=True)
class AnchorState:
    """A walk up to its newest footfall: arrays and no graph."""

    stance: StanceNodes  # This and the verdict are of that footfall.
    verdict: CompassVerdict
    prior: MarginalPrior  # On its variables, by the whole walk.
    past: Past  # Of the footfalls before.
    first: int
    footfalls: tuple[ReportedFootfall, ...]  # From number `first` on, as in this solution.
    t_first: float  # Of the walk's first footfall, s.
    known: Known  # Sensor and
    parameters: SmootherParameters  # walk as they were estimated.
    field: OnlineField | None  # None where the field is not used.
    barometer: Barometer | None  # None where it is not used, or has not been observed.
    rests: RestLedger  # Which rests the graph has.
    sensor: SensorState
    counts: dict[str, int]  # Factors so far, by kind.
    fixes: tuple[Fix, ...]  # Of the walk, with those to come.
    floors: FloorTrack
    heading_known: bool  # Whether the heading at the start was given, or fixes show it.
    returns: tuple[Return, ...]  # Stretches walked before.
    notes: tuple[str, ...]  # For the user.
    tied: int | None = None  # Number of the joint solution with the other foot, in whose frame it is; None of one foot.

    def without_past(self) -> AnchorState:
        """Return it without past and with the newest footfall alone: all that later strides depend on."""
        newest = self.stance.number
        return replace(self, past=Past(newest), first=newest, footfalls=self.footfalls[newest - self.first :])


# --- the window ------------------------------------------------------------------------------------------------------


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


class Window:
    """The newest window of a walk, since the anchor state `initial`; `latest` is the estimate of its newest footfall.

    Raises `RuntimeError` where the anchor state determines no solution. Footfalls are added to the walk first.
    """

    def __init__(self, initial: AnchorState, walk: PartialWalk) -> None:
        self.initial, self._walk, self._p = initial, walk, initial.parameters
        self.field = deepcopy(initial.field)  # it changes with each stride
        self._rests, self._floors = initial.rests, initial.floors
        self._stances, self._verdicts = [initial.stance], [initial.verdict]
        self._left: list[EstimateRow] = []  # as reported, of footfalls that are in the graph no more
        self._further = Counter[str]()  # what `count_graph` does not see
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(initial.prior.factor())
        self._found(graph, initial.prior.initial_values())
        self.latest = self._estimate()
        self.reported = [self.latest.as_row()]  # its footfalls, the first that of the anchor state

    def extend(self, footfalls: Iterable[ReportedFootfall]) -> None:
        """Add footfalls to the walk and to the graph."""
        for footfall in footfalls:
            self._walk.add(footfall)
            self.add_newest()

    def add_newest(self) -> None:
        """Add the newest footfall of the walk; where the graph has no solution with it, begin again at the last one."""
        stride, n_before = cut_stride(self._walk, self._stances[-1], self.initial.t_first, self._p), len(self._stances)
        try:
            # Inertial measurements, stance velocities, rests and pressure, and the solution with them; its fixes.
            rests = self._add_motion(stride)
            if self.initial.fixes:
                self._add_fixes(stride)
            # The field needs the stride's path for its line integral: it is added after that solution.
            self._verdicts.append(self._add_field(stride))
            self._note_newest()
        except UNSOLVED:
            del self._stances[n_before:], self._verdicts[n_before:]
            self._begin_again(stride)
        else:
            self._rests = rests
        if not self._walk.footfall(self._stances[-1].number).continues:
            self._floors = self._floors.add(float(self._pose(X(self._stances[-1].result)).z()))
        self.latest = self._estimate()
        self.reported.append(self.latest.as_row())

    def solve(self) -> Past:
        """Return the present estimates of all its footfalls, the first that of the anchor state.

        Those without a solution are as they were reported.
        """
        first = self.initial.stance.number
        try:
            return self._list_past(self._minimize())
        except UNSOLVED:
            return Past(first, tuple(self.reported), PathNodes.from_rows(self.reported))

    def to_anchor(self) -> AnchorState:
        """Return the anchor state at the newest footfall; raises `UNSOLVED` where there is no solution."""
        found, newest, initial = self._minimize(), self._stances[-1], self.initial
        counts = Counter(initial.counts) + count_graph(self._graph) + self._further
        return replace(
            initial,
            stance=newest,
            verdict=self._verdicts[-1],
            prior=marginalize(found.root, found.values, list_variables(newest, found.values)),
            past=initial.past.join(self._list_past(found).before(newest)),
            footfalls=self._walk.footfalls_since(initial.first),
            field=deepcopy(self.field),
            rests=self._rests,
            sensor=self._walk.sensor,
            counts={**initial.counts, **counts},
            floors=self._floors,
        )

    def propagate(self, until: int) -> StrapdownPath:
        """Propagate the pose by strapdown from the last node of the last footfall to the sample before `until`."""
        recording, first = self._walk.cut_onward(self._stances[-1].samples[-1], until)
        pose, velocity, bias = self._node
        motion = pose.translation(), velocity, pose.rotation().matrix()
        node = PathNodes._make(np.array([part]) for part in (first, *motion, bias.gyroscope(), bias.accelerometer()))
        path = dense_trajectory(recording, *node, self._p.gravity)
        return StrapdownPath(recording.t[first:], *(part[first:] for part in path))

    # --- a footfall ---

    def _add_motion(self, stride: StrideWindow) -> RestLedger:
        """Add the motion of the newest stride, and solve; return the ledger with its rests."""
        # Factors: inertial measurements, stance velocities, rests.
        before, stance, known = stride.before, stride.stance, self.initial.known
        rests, ledger = self._rests.collect(stride, self._p.rest)
        graph = stride_graph(measure_stride(stride, known.gyro_bias, known.lever.lever, rests, self._p), self._p)
        # Initial values of its variables.
        values = initialize_stride(stride, graph, self._linearized, self._bias(before), self._p)
        # The pressure at the footfall, and a state of the barometer.
        if self.initial.barometer is not None:
            key, states = X(stance.result), (P(before.number), P(stance.number))
            pressure = average_pressures(stride.recording, stride.stances, stride.nodes)
            at = key, values.atPose3(key).z(), states, stance.t - before.t, self._linearized
            air, new = stride_factors(self.initial.barometer, pressure, *at)
            graph.push_back(air)
            values.insert(new)
        self._stances.append(stance)
        self._update(graph, values)
        return ledger

    def _add_fixes(self, stride: StrideWindow) -> None:
        """Add the fixes since the footfall before that agree with the graph."""
        before, stance = stride.before, stride.stance
        t_node = np.array([self._walk.buffer.stamp(sample) for sample in (*before.samples, *stance.samples)])
        nodes = (*range(before.first, before.stop), *range(stance.first, stance.stop))
        graph = gtsam.NonlinearFactorGraph()
        for node, fix in find_stride_fixes(self.initial.fixes, t_node, float(t_node[len(before.samples) - 1])):
            key = X(nodes[node])
            if agrees(self._pose(key), np.asarray(self._isam.marginalCovariance(key)), fix):
                noise = position_fix_noise(fix.horizontal_sigma_m, fix.vertical_sigma_m)
                graph.push_back(gtsam.GPSFactor(key, np.array(fix.position), noise))
        if graph.size():
            self._update(graph, gtsam.Values())
            self._further[POSITION_FIX] += graph.size()

    def _add_field(self, stride: StrideWindow) -> CompassVerdict:
        """Add the field at the newest footfall and along its stride, and solve; return the verdict on it."""
        if self.field is None:
            return self._verdicts[-1]
        k, nodes = stride.stance.number, (stride.before.result, stride.stance.result)
        continues = self._walk.footfall(k).continues
        track, attitude = self._trace_stride(stride), self._pose(X(nodes[1])).rotation().matrix()
        measured = self.field.measure(stride.recording, stride.stances, track, is_seen=not continues)
        before = np.asarray(self._isam.calculateEstimateVector(M(k - 1)))
        graph, state, verdict = self.field.add(k, nodes, measured, attitude, before)
        values = gtsam.Values()
        values.insert(M(k), state)
        self._update(graph, values)
        self._further["gated_out"] += (
            bool(np.isfinite(measured.footfall.body_field).all()) and not verdict.compass_weight
        )
        return CompassVerdict(UNKNOWN, STANDS_ON) if continues else verdict

    def _trace_stride(self, stride: StrideWindow) -> Trajectory:
        """Return the path of the newest stride at the samples of its window."""
        nodes = range(stride.before.first, stride.stance.stop)
        poses = [self._pose(X(j)) for j in nodes]
        bias = [
            self._isam.calculateEstimateConstantBias(B(one.bias)).vector() for one in (stride.before, stride.stance)
        ]
        both = np.array(bias)[stride.nodes.footfall - stride.nodes.footfall[0]]
        return dense_trajectory(
            stride.recording,
            stride.nodes.sample,
            np.array([pose.translation() for pose in poses]),
            np.array([self._isam.calculateEstimateVector(V(j)) for j in nodes]),
            np.array([pose.rotation().matrix() for pose in poses]),
            np.ascontiguousarray(both[:, 3:]),
            np.ascontiguousarray(both[:, :3]),
            self._p.gravity,
        )

    def _note_newest(self) -> None:
        """Note covariances and last node of the newest footfall; `RuntimeError` where they are none."""
        stance, isam = self._stances[-1], self._isam
        covariances = [np.asarray(isam.marginalCovariance(key)) for key in (X(stance.result), B(stance.bias))]
        velocity = np.asarray(isam.calculateEstimateVector(V(stance.stop - 1)))
        node = self._pose(X(stance.stop - 1)), velocity, self._bias(stance)
        known = [node[0].matrix().ravel(), velocity, node[2].vector(), *(one.ravel() for one in covariances)]
        if not np.isfinite(np.concatenate(known)).all() or not all(
            (np.diagonal(one) > 0.0).all() for one in covariances
        ):
            raise RuntimeError("the graph has a solution that is not finite")
        self._covariances, self._node = covariances, node
        self._state = None if self.field is None else np.asarray(isam.calculateEstimateVector(M(stance.number)))

    def _estimate(self) -> StanceEstimate:
        """Return the estimate of the newest footfall."""
        stance, shared = self._stances[-1], (self._p.moving_foot, self.initial.barometer is not None)
        velocity = np.asarray(self._isam.calculateEstimateVector(V(stance.result)))
        state = self._pose(X(stance.result)), velocity, self._node[2]
        of_pose, of_bias = self._covariances
        return estimate_stance(stance, *state, of_pose, of_bias, self._verdicts[-1], *shared, self._floors.number)

    def _pose(self, key: int) -> gtsam.Pose3:
        return self._isam.calculateEstimatePose3(key)

    def _bias(self, stance: StanceNodes) -> gtsam.imuBias.ConstantBias:
        return self._isam.calculateEstimateConstantBias(B(stance.bias))

    # --- the graph ---

    def _found(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        """Begin the graph with these factors; raises `RuntimeError` where they do not determine the values."""
        self._graph, self._isam = gtsam.NonlinearFactorGraph(), gtsam.ISAM2(isam_parameters())
        self._linearized = self._isam.getLinearizationPoint()  # held from before the first update on
        self._update(graph, values)
        self._note_newest()

    def _update(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        """Add factors and their new variables, and solve; again while the newest footfall turns, but not often."""
        self._graph.push_back(graph)
        # The newest variables come last in the order of elimination, by footfall.
        groups = gtsam.KeyGroupMap()
        for group, stance in enumerate(self._stances[-IN_ORDER:], start=1):
            for key in {key for known in (self._linearized, values) for key in list_variables(stance, known)}:
                groups.insert2(key, group)
        newest = X(self._stances[-1].result)
        for _ in range(MAX_UPDATES):
            self._isam.update(graph, values, constrainedKeys=groups)
            turn = self._linearized.atPose3(newest).rotation().between(self._pose(newest).rotation())
            if np.abs(gtsam.Rot3.Logmap(turn)).max() <= ATTITUDE_RAD:
                break
            graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()

    def _minimize(self) -> Minimum[gtsam.Values]:
        """Return the minimum of all factors, from the present estimates; raises `UNSOLVED`."""
        values = self._isam.calculateBestEstimate()
        order = np.array(order_variables(self._stances, values), dtype=np.uint64)
        return find_minimum(WalkSystem(self._graph, ()), values, order)

    def _list_past(self, found: Minimum[gtsam.Values]) -> Past:
        """Return the footfalls of the window as its minimum has them."""
        covariances = found.root.covariances(result_keys(self._stances))
        shared = self._p.moving_foot, self.initial.barometer is not None
        rows = list_estimates(self._stances, self._verdicts, found.values, covariances, *shared)
        nodes = PathNodes.from_rows(self._left).join(PathNodes.from_values(self._stances, found.values))
        return Past(self.initial.stance.number, (*self._left, *rows), nodes)

    def _begin_again(self, window: StrideWindow) -> None:
        """Begin the graph again at the last footfall, which is left out of it: with its stride, or one not seen."""
        last, p, before, stance = self.latest, self._p, window.before, window.stance
        # Priors on the last node of that footfall, by its estimate.
        pose, velocity, bias = self._node
        keys, held = (X(before.stop - 1), V(before.stop - 1), B(before.bias), S(before.bias)), gtsam.Values()
        held.insert(keys[0], pose)
        held.insert(keys[1], velocity)
        held.insert(keys[2], bias)
        held.insert(keys[3], np.zeros(1))
        sensor = np.concatenate([np.repeat(ACC_BIAS_SIGMA, 3), last.gyro_bias_sigma])
        priors = gtsam.NonlinearFactorGraph()
        priors.addPriorPose3(keys[0], pose, _pose_noise(pose, last.pose_cov, np.radians(p.tilt_sigma_deg)))
        priors.addPriorVector(keys[1], velocity, gtsam.noiseModel.Isotropic.Sigma(3, NODE_SPEED_M_S))
        priors.addPriorConstantBias(keys[2], bias, gtsam.noiseModel.Diagonal.Sigmas(sensor))
        priors.addPriorVector(keys[3], np.zeros(1), gtsam.noiseModel.Isotropic.Sigma(1, p.settling_sigma_m))
        if self._state is not None:
            weak = gtsam.noiseModel.Isotropic.Sigma(SIZE, WEAK_UT)
            priors.addPriorVector(M(stance.number), self._state, weak)
            held.insert(M(stance.number), self._state)
        self._left = list(self.reported)
        self._stances, self._verdicts = [stance], [CompassVerdict(str(UNKNOWN), REASON)]
        known = self.initial.known
        stride = measure_stride(window, known.gyro_bias, known.lever.lever, (), p)
        try:
            graph = stride_graph(stride, p)
            values = initialize_stride(window, graph, held, bias, p)
            values.insert(held)
            graph.push_back(priors)
            self._found(graph, values)
        except UNSOLVED:
            graph, values = _follow_unseen(window, stride, held, p, self._walk)
            graph.push_back(priors)
            self._found(graph, values)


def _follow_unseen(
    window: StrideWindow, stride: Stride, held: gtsam.Values, p: SmootherParameters, walk: PartialWalk
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Return factors and values of the newest footfall by what a person may do in the time of its stride."""
    before, stance, values = window.before, window.stance, gtsam.Values(held)
    t_node = np.array([walk.buffer.stamp(sample) for sample in (before.samples[-1], *stance.samples)])
    unseen = list[UnseenWalk]()
    for elapsed in np.diff(t_node):
        move = walk_for(elapsed) * np.array([WALKING_M_S, WALKING_M_S, CLIMBING_M_S])
        turned = np.array(min(TURNING_RAD * np.sqrt(elapsed), UNKNOWN_RAD))
        unseen.append(UnseenWalk(move, np.zeros(()), turned, np.array(TILT_SIGMA_RAD)))
    graph = gtsam.NonlinearFactorGraph()
    add_stride(graph, replace(stride, measurements=list(unseen)), p)
    for j in range(stance.first, stance.stop):
        graph.addPriorVector(V(j), np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, SWINGING_M_S))
        values.insert(X(j), held.atPose3(X(before.stop - 1)))
        values.insert(V(j), np.zeros(3))
    if stance.bias != before.bias:
        values.insert(B(stance.bias), held.atConstantBias(B(before.bias)))
        values.insert(S(stance.bias), np.zeros(1))
    return graph, values


def _pose_noise(pose: gtsam.Pose3, nav_cov: Floats, tilt_rad: float) -> gtsam.noiseModel.Gaussian:
    """Return the noise of a pose in its tangent space, from the covariance (4, 4) of position and yaw, and tilt."""
    covariance = np.diag([tilt_rad**2, tilt_rad**2, 0.0, 0.0, 0.0, 0.0])
    covariance[np.ix_([3, 4, 5, 2], [3, 4, 5, 2])] = nav_cov
    turn, body_R_nav = np.zeros((6, 6)), pose.rotation().matrix().T
    turn[:3, :3] = turn[3:, 3:] = body_R_nav
    return gtsam.noiseModel.Gaussian.Covariance(turn @ covariance @ turn.T)
