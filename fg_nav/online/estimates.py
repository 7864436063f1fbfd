"""What a walk in progress reports: estimates of its footfalls, revisions of its past, and both as lines of JSON.

The keys of the lines are in docs/online.md. Sigmas are one standard deviation; what is not finite is null.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any, Literal, NamedTuple, TypeAlias

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.feet import Side
from fg_nav.frames import UNKNOWN_RAD, compute_heading, turn_heading, yaw_rotation
from fg_nav.online.strides import StanceNodes
from fg_nav.smoother.heights import SCALE_SIGMA
from fg_nav.smoother.sensitivity import FORWARD_SIGMA, SIDEWAYS_SIGMA
from fg_nav.smoother.solver import in_nav
from fg_nav.solution import StanceTable
from fg_nav.text import to_json
from fg_nav.verdict.limits import Verdict

NOW, SMOOTHED, POLISHED = "now", "smoothed", "polished"  # Kinds of lines; at the end of the graph, and of the batch.
TURNED_RAD = float(np.radians(1.0))  # A smaller turn is one of many corrections of the past.
MAX_POINTS = 200  # Of a revised path.
DIGITS = 6  # After the point: a micrometre, a microdegree ...
PAST_DIGITS = 3  # ... and of a revision a millimetre, a millidegree.


@dataclass(frozen=True)
class CompassVerdict:
    """Verdict on the field at a footfall: `word`, `reason` as in a stance table, compass weight (`weigh_compass`)."""

    word: str
    reason: str
    compass_weight: float = 0.0


@dataclass(frozen=True)
class StanceEstimate:
    """Where the foot stands, as known when its footfall was complete; at the stillest sample of the footfall."""

    number: int  # Of the footfall, from 0.
    sample: int  # Counted from the first of the walk.
    t: float  # s
    position: Floats  # (3,) m, navigation frame
    nav_R_body: Floats  # (3, 3)
    heading: float  # Of the body's x axis, rad clockwise from north.
    velocity: Floats  # (3,) m/s
    gyro_bias: Floats  # (3,) rad/s
    pose_cov: Floats  # (4, 4) of east, north, up (m) and yaw about up (rad), in whose variance is the heading's.
    gyro_bias_sigma: Floats  # (3,) rad/s
    compass_weight: float  # Of the magnetic heading, in [0, 1] (`smoother.field.weigh_compass`).
    field: str  # Verdict on the field, as in a stance table,
    field_reason: str  # in words.
    floor: int | None = None  # Of the building, 0 where the walk began (`strides.FloorTrack`); None where not known.

    def widen(self, rate_sigma: float) -> StanceEstimate:
        """Return it with the scale error of a nominal rate, relative sigma `rate_sigma`, added to its covariance."""
        cov = self.pose_cov.copy()
        cov[:3, :3] += np.outer(self.position, self.position) * (2.0 * rate_sigma) ** 2
        return replace(self, pose_cov=cov)

    def turn(self, angle: float) -> StanceEstimate:
        """Return it with its attitude and heading turned by an angle, rad clockwise."""
        return replace(self, nav_R_body=yaw_rotation(-angle) @ self.nav_R_body, heading=self.heading + angle)

    def as_row(self, sample: int | None = None) -> EstimateRow:
        """Return it as a row of numbers (40,) and the words of its verdict; with another sample if that is given."""
        begin = [self.sample if sample is None else sample, self.t]
        of_motion = self.position, self.velocity, self.nav_R_body.ravel(), self.gyro_bias
        parts = *of_motion, self.pose_cov.ravel(), self.gyro_bias_sigma, [self.compass_weight]
        return EstimateRow(np.concatenate([begin, *parts]), self.field, self.field_reason)


def estimate_stance(
    stance: StanceNodes,
    pose: gtsam.Pose3,
    velocity: Floats,
    bias: gtsam.imuBias.ConstantBias,
    body_cov: Floats,
    bias_cov: Floats,
    verdict: CompassVerdict,
    moving_foot: bool,
    has_air: bool,
    floor: int | None = None,
) -> StanceEstimate:
    """Return the estimate of a footfall in navigation axes, from its variables and their covariances (6, 6).

    A `moving_foot` and a barometer (`has_air`) add what the graph does not have: how they scale the walk.
    """
    position, attitude = np.asarray(pose.translation()), pose.rotation().matrix()
    pose_cov = in_nav(attitude[None], body_cov[None])[0]
    # Heading is the azimuth of the body's x axis: where that axis is inclined, tilt errors turn it too.
    by_turn = turn_heading(attitude)
    pose_cov[3, 3] = max(pose_cov[3, 3], min(float(by_turn @ body_cov[:3, :3] @ by_turn), UNKNOWN_RAD**2))
    pose_cov[2, 2] += (SCALE_SIGMA * position[2]) ** 2 * has_air
    if moving_foot:
        # The prior on the moving foot scales the walk and turns it about its start.
        east, north = position[:2]
        moved = np.array([[east, -north], [north, east]]) * (FORWARD_SIGMA, SIDEWAYS_SIGMA)
        pose_cov[:2, :2] += moved @ moved.T
    return StanceEstimate(
        number=stance.number,
        sample=stance.sample,
        t=stance.t,
        position=position,
        nav_R_body=attitude,
        heading=float(compute_heading(attitude)),
        velocity=velocity,
        gyro_bias=np.asarray(bias.gyroscope()),
        pose_cov=pose_cov,
        gyro_bias_sigma=np.sqrt(np.diagonal(bias_cov)[3:]),
        compass_weight=verdict.compass_weight,
        field=verdict.word,
        field_reason=verdict.reason,
        floor=floor,
    )


def list_estimates(
    stances: Sequence[StanceNodes],
    verdicts: Sequence[CompassVerdict],
    values: gtsam.Values,
    covariances: Mapping[int, Floats],
    moving_foot: bool,
    has_air: bool,
) -> list[EstimateRow]:
    """Return a row for each footfall, from the values of a graph and its covariances (6, 6) by variable key."""
    rows = []
    for stance, verdict in zip(stances, verdicts, strict=True):
        pose, bias = X(stance.result), B(stance.bias)
        state = values.atPose3(pose), values.atVector(V(stance.result)), values.atConstantBias(bias)
        known = *state, covariances[pose], covariances[bias], verdict
        rows.append(estimate_stance(stance, *known, moving_foot, has_air).as_row())
    return rows


# --- rows and tables -------------------------------------------------------------------------------------------------


class EstimateRow(NamedTuple):
    """An estimate as one row of numbers (40,) and its words."""

    numbers: Floats
    field: str
    field_reason: str


class RowColumns(NamedTuple):
    """The numbers of K rows, as in `StanceEstimate`, each with a first axis (K,)."""

    sample: Ints
    t: Floats
    position: Floats
    velocity: Floats
    nav_R_body: Floats
    gyro_bias: Floats
    pose_cov: Floats
    gyro_bias_sigma: Floats
    compass_weight: Floats


_ENDS = (1, 2, 5, 8, 17, 20, 36, 39)  # Columns of a row after which another part of it begins.


def split_rows(rows: Sequence[EstimateRow]) -> RowColumns:
    """Return the numbers of K rows as named columns."""
    numbers = np.array([row.numbers for row in rows]).reshape(len(rows), _ENDS[-1] + 1)
    sample, t, position, velocity, attitude, bias, pose_cov, bias_sigma, weight = np.split(numbers, _ENDS, axis=1)
    matrices = attitude.reshape(-1, 3, 3), bias, pose_cov.reshape(-1, 4, 4), bias_sigma, weight[:, 0]
    return RowColumns(sample[:, 0].astype(np.int64), t[:, 0], position, velocity, *matrices)


def build_table(rows: Sequence[EstimateRow]) -> StanceTable:
    """Return the stance table of some estimates."""
    known = split_rows(rows)._asdict()
    del known["velocity"]
    return StanceTable(
        position_cov=known["pose_cov"][:, :3, :3],
        heading_sigma=np.sqrt(known["pose_cov"][:, 3, 3]),
        field=tuple(row.field for row in rows),
        field_reason=tuple(row.field_reason for row in rows),
        **known,
    )


def select_rows(table: StanceTable, keep: Bools) -> StanceTable:
    """Return the rows of a table where `keep` (K,) is true."""
    kept = dict[str, Any]()
    for name, column in vars(table).items():
        kept[name] = tuple(compress(column, keep)) if isinstance(column, tuple) else column
        kept[name] = column[keep] if isinstance(column, np.ndarray) else kept[name]
    return StanceTable(**kept)


class StrapdownPath(NamedTuple):
    """A path at the rate of the samples: `t` (n,), position (n, 3), velocity (n, 3), attitude (n, 3, 3)."""

    t: Floats
    position: Floats
    velocity: Floats
    nav_R_body: Floats


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

    def before(self, sample: int) -> PathNodes:
        """Return the nodes before a sample."""
        stop = int(np.searchsorted(self.sample, sample))
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
        return Past(self.first, self.rows[: stance.number - self.first], self.nodes.before(stance.samples[0]))

    def join(self, later: Past) -> Past:
        """Return this past up to footfall `later.first`, and `later` from there on."""
        rows = self.rows[: later.first - self.first] + later.rows
        begins = int(later.nodes.sample[0]) if len(later.nodes.sample) else np.iinfo(np.int64).max
        return Past(self.first, rows, self.nodes.before(begins).join(later.nodes))


# --- lines -----------------------------------------------------------------------------------------------------------


def format_estimate(
    estimate: StanceEstimate,
    continues: bool,
    sensor_time: Callable[[float], float] = lambda t: t,
    verdict: Verdict | None = None,
    kind: str = NOW,
) -> str:
    """Return the JSON line of an estimate; `sensor_time` as of `Intake`, `verdict` on the path up to it."""
    t, sensor_t = round(estimate.t, 9), round(sensor_time(estimate.t), 9)
    content: dict[str, object] = {
        "kind": kind,
        "stance": estimate.number,
        **({"continues": continues, "floor": estimate.floor} if kind == NOW else {}),
        "t": t,
        **({} if sensor_t == t else {"sensor_t": sensor_t}),
        **_describe_pose(estimate.position, estimate.heading, estimate.pose_cov),
        "gyro_bias_deg_s": np.round(np.degrees(estimate.gyro_bias), DIGITS),
        "gyro_bias_sigma_deg_s": np.round(np.degrees(estimate.gyro_bias_sigma), DIGITS),
        "compass_weight": round(float(estimate.compass_weight), DIGITS),
        "field": estimate.field,
        "field_reason": estimate.field_reason,
    }
    if verdict is not None:
        content |= {"verdict": verdict.word, "reasons": list(verdict.reasons)}
    return _dump(content)


def _describe_pose(position: Floats, heading: float | None, pose_cov: Floats) -> dict[str, object]:
    """Return the keys of a line for a pose (rad; None unknown) and its covariance (4, 4) of east, north, up, yaw."""
    sigma = np.sqrt(np.diagonal(pose_cov))
    return {
        "position_m": np.round(position, DIGITS),
        "heading_deg": None if heading is None else round(float(np.degrees(heading) % 360.0), DIGITS),
        "position_sigma_m": np.round(sigma[:3], DIGITS),
        "east_north_cov_m2": round(float(pose_cov[0, 1]), 2 * DIGITS),
        "heading_sigma_deg": round(float(np.degrees(sigma[3])), DIGITS),
    }


def parse_estimate(content: Mapping[str, Any]) -> StanceEstimate:
    """Return the estimate of a line, without sample, velocity and tilt; raises `KeyError`, `TypeError` for others."""

    def read(key: str) -> Floats:
        return np.array(content[key], dtype=np.float64)  # null is NaN

    heading, sigma = float(np.radians(read("heading_deg"))), read("position_sigma_m")
    pose_cov = np.diag(np.append(sigma, np.radians(read("heading_sigma_deg"))) ** 2)
    pose_cov[0, 1] = pose_cov[1, 0] = content["east_north_cov_m2"]
    return StanceEstimate(
        number=int(content["stance"]),
        sample=-1,
        t=float(content["t"]),
        position=read("position_m").reshape(3),
        nav_R_body=yaw_rotation(np.pi / 2 - heading),
        heading=heading,
        velocity=np.zeros(3),
        gyro_bias=np.radians(read("gyro_bias_deg_s")).reshape(3),
        pose_cov=pose_cov,
        gyro_bias_sigma=np.radians(read("gyro_bias_sigma_deg_s")).reshape(3),
        compass_weight=float(read("compass_weight")),
        field=str(content["field"]),
        field_reason=str(content["field_reason"]),
        floor=content["floor"],
    )


def format_table(
    table: StanceTable,
    sensor_time: Callable[[float], float] = lambda t: t,
    kind: str = SMOOTHED,
    heading: Floats | None = None,
    verdict: Verdict | None = None,
) -> Iterator[str]:
    """Yield the JSON lines of the final estimates; `heading` (K,) rad, None for that of the body's x axis."""
    heading = compute_heading(table.nav_R_body) if heading is None else heading
    same = "sample", "t", "position", "nav_R_body", "gyro_bias", "gyro_bias_sigma", "field", "field_reason"
    for k in range(len(table)):
        pose_cov = np.zeros((4, 4))
        pose_cov[:3, :3], pose_cov[3, 3] = table.position_cov[k], table.heading_sigma[k] ** 2
        estimate = StanceEstimate(
            number=k,
            heading=float(heading[k]),
            velocity=np.zeros(3),
            pose_cov=pose_cov,
            compass_weight=np.nan if table.compass_weight is None else float(table.compass_weight[k]),
            **{name: getattr(table, name)[k] for name in same},
        )
        yield format_estimate(estimate, False, sensor_time, verdict, kind)


def _dump(content: Mapping[str, object]) -> str:
    return json.dumps(to_json(content), allow_nan=False)


# --- revisions -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Revision:
    """Changes of the reported past by a re-solve."""

    t: float  # Of the newest footfall that was solved again, s.
    turn: float  # Of the map about its origin, rad clockwise; 0 where it did not turn.
    retracted: tuple[tuple[int, float], ...]  # Numbers and stamps of the lines whose footfalls were none.
    path: Floats  # (K, 4) t (s), east, north, up (m) at footfalls of the walk so far, `MAX_POINTS` at most.


def compare_pasts(
    before: Sequence[EstimateRow], after: Sequence[EstimateRow], first: int, retracted: Sequence[tuple[int, float]]
) -> Revision:
    """Return the revision from the rows `before`, of the footfalls from number `first` on, to `after`, from 0 on."""
    old, new = split_rows(before), split_rows(after[first:])
    _, i, j = np.intersect1d(old.sample, new.sample, return_indices=True)
    turns = compute_heading(new.nav_R_body[j]) - compute_heading(old.nav_R_body[i])
    turn = float(np.angle(np.exp(1j * turns).sum())) if len(turns) else 0.0
    path = split_rows([after[k] for k in thin_rows(len(after))])
    return Revision(
        t=float(path.t[-1]),
        turn=turn if abs(turn) > TURNED_RAD else 0.0,
        retracted=tuple(retracted),
        path=np.column_stack([path.t, path.position]),
    )


def thin_rows(count: int) -> list[int]:
    """Return at most `MAX_POINTS` evenly spaced indices below `count`, the first and the last included."""
    return sorted(set(np.linspace(0, count - 1, min(count, MAX_POINTS)).round().astype(int).tolist()))


def format_revision(revision: Revision) -> Iterator[str]:
    """Yield the JSON lines of a revision: turned, retracted, revised."""
    t = round(revision.t, 9)
    if revision.turn:
        yield _dump({"kind": "turned", "t": t, "angle_deg": round(float(np.degrees(revision.turn)), PAST_DIGITS)})
    for number, stamp in revision.retracted:
        yield _dump({"kind": "retracted", "stance": number, "t": t, "stance_t": round(stamp, 9)})
    yield _dump({"kind": "revised", "t": t, "path": np.round(revision.path, PAST_DIGITS)})


# --- two feet --------------------------------------------------------------------------------------------------------

Who: TypeAlias = Literal["left", "right", "person"]
State: TypeAlias = Literal["silent", "back", "refused", "parted"]


@dataclass(frozen=True)
class PersonEstimate:
    """The middle of both feet when both stood, halfway in time between two footfalls."""

    number: int  # Of the step, from 0.
    t: float  # s
    position: Floats  # (3,) m
    heading: float | None  # Of the motion, rad clockwise from north; None before that.
    pose_cov: Floats  # (4, 4) of east, north, up (m) and yaw (rad): the mean of both feet's, an upper bound.


@dataclass(frozen=True)
class FootState:
    """A foot that is lost, or back, at a time, s."""

    t: float
    state: State
    reason: str


@dataclass(frozen=True)
class FeetLine:
    """What is reported of a foot or of the person, and the frame in which it is."""

    foot: Who
    frame: Side
    content: StanceEstimate | Revision | PersonEstimate | FootState


def format_feet_line(line: FeetLine) -> Iterator[str]:
    """Yield the lines of JSON on the person, or on the state of a foot."""
    match line.content:
        case Revision() as revision:
            lines = list(format_revision(revision))
        case PersonEstimate() as person:
            begin = {"kind": NOW, "stance": person.number, "continues": False, "t": round(person.t, 9)}
            lines = [_dump(begin | _describe_pose(person.position, person.heading, person.pose_cov))]
        case FootState() as state:
            lines = [_dump({"kind": "foot", "t": round(state.t, 9), "state": state.state, "reason": state.reason})]
        case StanceEstimate():
            raise AssertionError  # of one foot, whose walk formats it
    yield from (tag_line(one, line.foot, line.frame) for one in lines)


def tag_line(line: str, foot: Who, frame: Side) -> str:
    """Return a line of JSON with the keys `foot` and `frame` added."""
    content = json.loads(line)
    return _dump({"kind": content.pop("kind"), "foot": foot, "frame": frame, **content})
