"""The anchor state: what a walk so far leaves to the strides that follow, of its newest footfall; arrays and no graph.

    batch solution of all footfalls         (`resolve`)  -> AnchorState
    an anchor state and the strides since   (`window`)   -> AnchorState

The linear graph of the walk is eliminated by QR but for the variables x of that footfall. What is left is

    1/2 |A d - b|^2,     d the step of x in its tangent space from the values where the graph was linearized:

the Schur complement of the information matrix, as a square root. As one linear factor, the marginal prior, it stands
for the whole past in the graph of the strides that follow (concurrent filtering and smoothing: Williams et al. 2014,
IJRR 33, 1544). Nothing is lost but the choice to linearize the past again. All that comes later follows from the anchor
state and the samples since, to the bit.

Floors: `FloorTrack` has that of the newest footfall, 0 where the walk began, +1 the next above, -1 the next below. A
walk that is solved as a whole shows level floors (`smoother.heights`) and their heights; footfalls since are followed
by their heights z, m, less a drift that all of them share and that those on a floor show:

    on a floor       while z changes by less than `STEP_M` from one footfall to the next, and is within `SAME_M` of it
    on none          otherwise: on stairs or a ramp, or in a lift
    on one again     once `FEWEST` footfalls are within `STEP_M`: on the nearest within `SAME_M`, else on a new one

Floors are numbered from the start outward, up and down: the next number begins `STOREY_M` above the lowest floor of the
one before, and a landing from `LANDING_M` on below that has none. So a kerb, and a floor that is met again at another
height, begin no new number; a storey that is passed without four footfalls on it is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X
from scipy.linalg import solve_triangular

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.factors.residual import guarded_factor
from fg_nav.online.buffer import ReportedFootfall, SensorState
from fg_nav.online.estimates import EstimateRow, split_rows
from fg_nav.online.field import BiasLedger, CompassVerdict, OnlineField
from fg_nav.online.strides import RestLedger, StanceNodes
from fg_nav.smoother.graph import Known
from fg_nav.smoother.heights import FEWEST, Barometer
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import dimension_of
from fg_nav.smoother.square_root import SquareRoot
from fg_nav.solution import Return
from fg_nav.truth import Fix

STEP_M = 0.08  # Between two footfalls on one floor: half a riser.
SAME_M = 0.5  # A floor is found again within this: by so much heights drift on a way over stairs.
DRIFT_SHARE = 0.1  # Of a footfall's height above its floor that is drift: a slope of 4 % is followed at `SAME_M`.
STOREY_M = 2.0  # From a storey to the next at least: a low cellar.
LANDING_M = 1.0  # From a storey to a landing at least: they are halfway.


@dataclass(frozen=True)
class MarginalPrior:
    """Square-root information A (r, d) and b (r,) on the variables `keys`, at their `values`.

    The value of a pose is its matrix (4, 4), that of a bias (6,) accelerometer and gyroscope, others are vectors.
    """

    keys: tuple[int, ...]
    values: tuple[Floats, ...]
    A: Floats
    b: Floats

    def factor(self) -> gtsam.CustomFactor:
        """Return the factor |A d - b|^2 / 2, d the step from the stored to the present values, in tangent space."""
        dims = [dimension_of(key) for key in self.keys]
        by_key = np.split(self.A, np.cumsum(dims)[:-1], axis=1)

        def evaluate(values: gtsam.Values, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
            steps = []  # in the tangent spaces of the stored values
            for key, value in zip(self.keys, self.values, strict=True):
                now = _value_of(values, key)
                is_pose = value.ndim == 2
                steps.append(
                    gtsam.Pose3.Logmap(gtsam.Pose3(value).between(gtsam.Pose3(now))) if is_pose else now - value
                )
            e = self.A @ np.concatenate(steps) - self.b
            if not with_jacobians:
                return e, []
            # d is in the tangent space of the stored pose, the Jacobian in that of the present pose: chain rule.
            jacobians = [
                np.ascontiguousarray(A @ gtsam.Pose3.LogmapDerivative(d) if _letter(key) == "x" else A)
                for A, key, d in zip(by_key, self.keys, steps, strict=True)
            ]
            return e, jacobians

        unit = gtsam.noiseModel.Unit.Create(len(self.b))
        return guarded_factor("anchor", self.keys, dims, unit, evaluate)

    def initial_values(self) -> gtsam.Values:
        """Return the stored values, as initial estimate of a graph."""
        values = gtsam.Values()
        for key, value in zip(self.keys, self.values, strict=True):
            letter = _letter(key)
            if letter == "x":
                values.insert(key, gtsam.Pose3(value))
            elif letter == "b":
                values.insert(key, gtsam.imuBias.ConstantBias(value[:3], value[3:]))
            else:
                values.insert(key, value)
        return values


def marginalize(
    linear: gtsam.GaussianFactorGraph, values: gtsam.Values, keep: Sequence[int], others: Iterable[int]
) -> MarginalPrior:
    """Return the marginal prior on the variables `keep` of a graph that is linearized at `values`.

    Raises `RuntimeError` where the factors do not determine the others.

    Parameters
    ----------
    others : the other variables, in elimination order.
    """
    order, kept = gtsam.Ordering(), gtsam.Ordering()
    for key in others:
        order.push_back(key)
    for key in keep:
        kept.push_back(key)
    remaining = linear.eliminatePartialMultifrontal(order, gtsam.EliminateQR)[1] if order.size() else linear
    A, b = remaining.jacobian(kept)
    root: Floats = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    return MarginalPrior(
        tuple(keep), tuple(_value_of(values, key) for key in keep), root[:, :-1].copy(), root[:, -1].copy()
    )


def marginalize_root(root: SquareRoot, values: gtsam.Values, keep: Sequence[int]) -> MarginalPrior:
    """Return the marginal prior on the variables `keep`, from the square root R of a graph at its minimum `values`.

    With Y = R^-T E, E the columns of these variables, their covariance is Y^T Y = T^T T by QR of Y, so A = T^-T.
    """
    columns = np.concatenate([root.find_columns([[key]])[0] for key in keep])
    unit = np.zeros((root.total, len(columns)))
    unit[columns, np.arange(len(columns))] = 1.0
    T: Floats = np.asarray(np.linalg.qr(root.forward_substitute(unit), mode="r"))
    A: Floats = np.asarray(solve_triangular(T, np.eye(len(T)), trans="T"))
    return MarginalPrior(tuple(keep), tuple(_value_of(values, key) for key in keep), A, np.zeros(len(A)))


def _letter(key: int) -> str:
    return chr(gtsam.Symbol(key).chr())


def _value_of(values: gtsam.Values, key: int) -> Floats:
    letter = _letter(key)
    if letter == "x":
        return np.array(values.atPose3(key).matrix())
    return np.array(values.atConstantBias(key).vector() if letter == "b" else values.atVector(key))


# --- the past --------------------------------------------------------------------------------------------------------


class PathNodes(NamedTuple):
    """Samples (M,) of the walk, and at each position (m), velocity (m/s), attitude, gyro (rad/s), force bias."""

    sample: Ints
    position: Floats
    velocity: Floats
    nav_R_body: Floats
    gyro_bias: Floats
    acc_bias: Floats

    @classmethod
    def from_rows(cls, rows: Sequence[EstimateRow]) -> PathNodes:
        """Return a node at the stillest sample of each footfall, its accelerometer bias zero."""
        known = split_rows(rows)
        unknown = np.zeros_like(known.gyro_bias)
        return cls(known.sample, known.position, known.velocity, known.nav_R_body, known.gyro_bias, unknown)

    @classmethod
    def from_values(cls, stances: Sequence[StanceNodes], values: gtsam.Values) -> PathNodes:
        """Return all nodes of these footfalls, from the values of a graph."""
        if not stances:
            return NO_NODES
        nodes = [j for stance in stances for j in range(stance.first, stance.stop)]
        poses = [values.atPose3(X(j)) for j in nodes]
        bias = [values.atConstantBias(B(stance.bias)).vector() for stance in stances for _ in stance.samples]
        acc_bias, gyro_bias = np.split(np.array(bias), 2, axis=1)
        return cls(
            np.array([sample for stance in stances for sample in stance.samples]),
            np.array([pose.translation() for pose in poses]),
            np.array([values.atVector(V(j)) for j in nodes]),
            np.array([pose.rotation().matrix() for pose in poses]),
            gyro_bias,
            acc_bias,
        )

    def cut(self, stop: int) -> PathNodes:
        """Return the first `stop` nodes."""
        return PathNodes._make(part[:stop] for part in self)

    def join(self, later: PathNodes) -> PathNodes:
        """Return these nodes and those that follow."""
        return PathNodes._make(np.concatenate(both) for both in zip(self, later, strict=True))


NO_NODES = PathNodes.from_rows(())


@dataclass(frozen=True)
class Past:
    """Estimates of the footfalls from number `first` on: one row each, and the nodes of the path through them."""

    first: int = 0
    rows: tuple[EstimateRow, ...] = ()
    nodes: PathNodes = NO_NODES

    def before(self, stance: StanceNodes) -> Past:
        """Return the estimates and nodes of the footfalls before this one."""
        stop = int(np.searchsorted(self.nodes.sample, stance.samples[0]))
        return Past(self.first, self.rows[: stance.number - self.first], self.nodes.cut(stop))

    def join(self, later: Past) -> Past:
        """Return this past up to footfall `later.first`, and `later` from there on."""
        rows = self.rows[: later.first - self.first] + later.rows
        begins = later.nodes.sample[0] if len(later.nodes.sample) else np.iinfo(np.int64).max
        stop = int(np.searchsorted(self.nodes.sample, begins))
        return Past(self.first, rows, self.nodes.cut(stop).join(later.nodes))


# --- floors ----------------------------------------------------------------------------------------------------------


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

    Parameters
    ----------
    heights : (F,) m of its footfalls.
    floor : (F,) number of the level floor of each, -1 on none; None where they were not looked for.
    is_piece : (F,) which footfalls are further pieces of a standing: they say nothing of the ground.
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


# --- the anchor state ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class AnchorState:
    """A walk up to its newest footfall."""

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
    rests: RestLedger  # These two: which information on the gyro bias the graph has.
    biases: BiasLedger | None
    sensor: SensorState
    counts: dict[str, int]  # Factors so far, by kind.
    fixes: tuple[Fix, ...]  # Of the walk, with those to come.
    floors: FloorTrack
    heading_known: bool  # Whether the heading at the start was given, or fixes show it.
    returns: tuple[Return, ...]  # Stretches walked before.
    notes: tuple[str, ...]  # For the user.

    def without_past(self) -> AnchorState:
        """Return it without past and with the newest footfall alone: all that later strides depend on."""
        newest = self.stance.number
        return replace(self, past=Past(newest), first=newest, footfalls=self.footfalls[newest - self.first :])


@dataclass(frozen=True)
class TiedAnchorState(AnchorState):
    """Anchor state of a foot solved jointly with the other, in their common frame; `number` of the joint solution."""

    number: int = 0


def window_anchors(
    earlier: Sequence[AnchorState],
    newest: AnchorState,
    footfalls: Sequence[ReportedFootfall],
    lag_s: float | None,
    window: int,
) -> list[AnchorState]:
    """Return the anchor states to keep: from the last that is a window of footfalls, or a lag, back, up to `newest`.

    Those behind a footfall that was retracted or inserted are invalid, and left out.
    """
    valid = []
    for one in earlier:
        at = footfalls[one.stance.number : one.stance.number + 1]
        if at and at[0].footfall.stillest == one.stance.sample:
            valid.append(one)
    anchors, stance = [*valid, newest.without_past()], newest.stance
    if lag_s is None:
        enough = sum(stance.number - one.stance.number >= window for one in anchors)
    else:
        enough = sum(stance.t - one.stance.t >= lag_s for one in anchors)
    return anchors[max(enough - 1, 0) :]
