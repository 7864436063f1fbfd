"""The magnetic field of a walk in progress: the batch's states and residuals, one footfall at a time.

`OnlineField`: roughness of the potential and drift of the line integral are those of the last re-solve (the rounds of
`smoother.field`); since then a stride whose potential jumps is left out. The other roughness follows from the last
`RECENT` footfalls, as does the statistic of the gate that weighs the compass of the newest. The gate judges a footfall
by it and those before, as in batch, with the attitudes known then. Unlike in batch, verdict and noise of a footfall
that is in the graph stay as they were.

`find_north_sigma`: where no heading was given, north is where the mean field of the walk points. At a foot the field
deviates across that of the Earth by delta (uT): from one footfall to the next by what lies in the floor, from one room
to the next by what stands in it. Both are taken for stationary processes along the path, of the correlation lengths L
and L_r. Over a path of s m the mean of such a process has the variance sigma^2 v(s / L),

    v(x) = 2 (x - 1 + exp(-x)) / x^2,    v(0) = 1,    v -> 2 / x,

and north, with H the horizontal field,

    sigma_north^2 = (sigma^2 v(s / L) + sigma_r^2 v(s / L_r)) / H^2
    sigma^2 = (n_0 sigma_0^2 + sum e_k^2) / (n_0 + n - 1),    sigma_r = c sigma,

e_k the deviation across the mean at the n footfalls so far. Few footfalls of one room agree and may all be wrong, so
sigma begins from that of a reinforced floor, sigma_0. A short walk cannot show what rooms do: that is a share c. Before
the field is in the graph the heading has the sigma of a uniform angle, pi / sqrt(3).

`extend_with_north`: a north that is off by theta turns the walk about its origin. A position p from there is off by
sin(theta) (up x p) - (1 - cos(theta)) p over the ground, with the second moments, theta normal,

    <theta^2> = s^2,    <theta sin> = s^2 exp(-s^2 / 2),
    <sin^2> = (1 - exp(-2 s^2)) / 2,    <(1 - cos)^2> = 3/2 - 2 exp(-s^2 / 2) + exp(-2 s^2) / 2.

`BiasLedger`: the differential field of a bias variable is summed over its stances until its ten seconds are over; then
its factor joins the graph. Noise, variogram, iron and the number of bias variables that share the limit are those of
the last re-solve. The information F(L0) that a re-solve has added before is subtracted:

    in the graph:  F(L0),    to add:  F(L) - F(L0),    F(L) = (L^-1 + s^2 I)^-1,

which is never negative, as F grows with L. So the graph has the same factor in the end as a batch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, X

from fg_nav.arrays import Floats
from fg_nav.detection import Rest
from fg_nav.detection.stance import Stances
from fg_nav.errors import MagneticError
from fg_nav.factors.differential_field import BiasInformation, FieldNoise
from fg_nav.factors.magnetic_field import E_H, SIZE, FieldPotential, MagneticHeading, across_field
from fg_nav.factors.residual import factor_of, linear_factor_of
from fg_nav.frames import UNKNOWN_RAD
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.footfall_field import UNKNOWN_IRON_UT
from fg_nav.magnetic.quasi_static import apply_gate, count_needed, weigh_statistic
from fg_nav.online.strides import StrideWindow
from fg_nav.recording import Recording
from fg_nav.smoother.differential import (
    DifferentialFactors,
    LevelBias,
    find_stretches,
    limit_information,
    measure_stretches,
    sum_stretches,
    turn_stretches,
)
from fg_nav.smoother.field import MIN_JUMP_UT_M, FieldSolution
from fg_nav.smoother.field_factors import (
    FieldFactors,
    FieldPath,
    FieldRoughness,
    compass_sigma,
    deviate_along,
    integrate_path,
    measure_roughness,
    rotate_field,
    split_potential,
    transition,
    weigh_compass,
)
from fg_nav.smoother.graph import Trajectory
from fg_nav.smoother.solver import list_attitudes

RECENT = 4000  # Footfalls: how regions differ, which are fifteen footfalls long, takes all. Most that a gate uses.
JUMP_SIGMAS = 6.0  # Of the potential: 40 A over a rough floor. The next re-solve checks the stride again.
ROUGH_EVERY = 10  # Footfalls after which the roughness is measured again.

# Columns of a remembered footfall: its field over the ground in nav and the mean field there, uT, length of the stride
# to it, m, statistic of the gate.
LEVEL, REFERENCE, DISTANCE, STATISTIC = slice(0, 2), slice(2, 4), 4, 5

FLOOR_UT = 7.0  # sigma_0: per axis, at the height of a foot over a reinforced floor.
FLOOR_WEIGHT = 5.0  # n_0: how many footfalls that is worth.
FLOOR_LENGTH_M = 1.5  # L: a quarter of the longest waves in such a floor, which are 1 to 6 m long.
ROOM_SHARE = 0.3  # c: by how much rooms turn the field, as a share of how it differs between footfalls.
ROOM_LENGTH_M = 20.0  # L_r.
SHORT = 1e-4  # Lengths below which v is its Taylor series: the closed form loses its digits there.


@dataclass(frozen=True)
class StrideField:
    """Field measured at a footfall and along the stride to it."""

    footfall: FootfallField  # At the one footfall, NaN where there was none.
    path: FieldPath | None  # Of the one stride; None where the field was not seen.
    distance_m: float


@dataclass(frozen=True)
class CompassVerdict:
    """Verdict on the field at a footfall: `word`, `reason` as in a stance table, compass weight (`weigh_compass`)."""

    word: str
    reason: str
    compass_weight: float = 0.0


class OnlineField:
    """The field of a walk so far, from the batch solution of a walk with the field `field` at its footfalls."""

    def __init__(self, found: FieldSolution, field: FootfallField) -> None:
        factors, values = found.problem.get(FieldFactors), found.solved.values
        self._p = replace(factors.parameters, potential=len(factors.potential) > 0)
        self._level_R_body = factors.path.level_R_body
        nav_R_body = list_attitudes(found.problem.nodes.result, values)
        nav, judged = rotate_field(field, nav_R_body), replace(field, nav_R_body=nav_R_body)
        distance, statistic = np.append(0.0, factors.path.distance_m), apply_gate(judged, self._p.gate).statistic
        self._recent = np.column_stack([nav[:, :2], found.states[:, E_H], distance, statistic])[-RECENT:]
        self._potential, self._with_lost = factors.telescoping, factors.rough.potential
        self._lost_share = factors.lost_share
        self._needed = min(count_needed(self._p.gate) or RECENT, RECENT)
        self._judged = judged.select(slice(-self._needed, None))
        self._rough, self._age = self._measure_roughness(), 0
        self._strength_uT = float(np.median(np.linalg.norm(found.states[:, E_H], axis=1)))
        self.up_uT = float(np.nanmedian(nav[:, 2]))

    def add(
        self,
        graph: gtsam.NonlinearFactorGraph,
        k: int,
        node: int,
        node_before: int,
        stride: StrideField,
        pose: gtsam.Pose3,
        before: Floats,
    ) -> tuple[Floats, CompassVerdict]:
        """Add footfall k and the stride to it; return the initial value (9,) of its field state, and the verdict.

        Parameters
        ----------
        graph, node, node_before : graph to extend; pose nodes of this footfall and of the one before.
        pose : estimate at the footfall without its field.
        before : (9,) state at the footfall before.
        """
        # The compass of the footfall.
        nav_R_body, body_field = pose.rotation().matrix(), stride.footfall.body_field[0]
        sigma_uT, verdict = self._judge_compass(stride, nav_R_body, before)
        if np.isfinite(sigma_uT):
            compass = MagneticHeading(body_field, self._level_R_body, nav_R_body, np.array(sigma_uT))
            graph.push_back(factor_of(compass, [X(node), M(k)]))
        # The line integral along its stride.
        path = stride.path
        if self._p.potential and path is not None and np.isfinite(path.sigma_uT_m[0]):
            _, drift_uT_m = split_potential(self._with_lost, self._lost_share, np.array(stride.distance_m))
            integral = FieldPotential(
                np.array(path.u[0]),
                self._level_R_body @ (path.level_path[0] @ path.level_R_body),
                path.by_up[0],
                path.body_move[0],
                path.nav_R_level[0],
                np.array(np.hypot(path.sigma_uT_m[0], drift_uT_m)),
            )
            # Left out where the potential jumps, as beside a conductor: there the field has no single-valued potential.
            nav_T_body = np.eye(4)
            nav_T_body[:3, :3] = integral.nav_R_level
            e, _ = integral.evaluate([nav_T_body, before, np.zeros(SIZE)], with_jacobians=False)
            bound = JUMP_SIGMAS * float(np.hypot(self._potential.sigma, integral.sigma_uT_m))
            if not abs(float(e[0] * integral.sigma_uT_m)) > max(bound, MIN_JUMP_UT_M):
                graph.push_back(factor_of(integral, [X(node_before), M(k - 1), M(k)]))
        # The change of the field's state since the footfall before.
        change = transition(np.array(stride.distance_m), self._rough)
        graph.push_back(linear_factor_of(change, [M(k - 1), M(k)]))
        self._age += 1
        if self._age % ROUGH_EVERY == 0:
            self._rough = self._measure_roughness()
        return change.keep * before, verdict

    @property
    def north_sigma(self) -> float:
        """Sigma, rad, of a north that only this field shows."""
        rows = self._recent[np.isfinite(self._recent[:, 0])]
        across = across_field(rows[:, LEVEL], rows[:, REFERENCE])
        return find_north_sigma(across, float(self._recent[:, DISTANCE].sum()), self._strength_uT)

    def _judge_compass(self, stride: StrideField, nav_R_body: Floats, before: Floats) -> tuple[float, CompassVerdict]:
        """Run the gate on the newest footfall; return sigma (uT) of its compass, infinite without, and verdict.

        `before` (9,) is the state of the field at the previous footfall.
        """
        newest = replace(stride.footfall, nav_R_body=nav_R_body[None])
        self._judged = self._judged.join(newest).select(slice(-self._needed, None))
        verdicts = apply_gate(self._judged, self._p.gate)
        level = rotate_field(newest, newest.nav_R_body)[0, :2]
        row = np.concatenate([level, before[E_H], [stride.distance_m, verdicts.statistic[-1]]])
        self._recent = np.vstack([self._recent, row])[-RECENT:]
        # a larger gate statistic than is usual on this walk gives a larger sigma
        of_walk = replace(verdicts, statistic=self._recent[:, STATISTIC])
        spread = compass_sigma(weigh_statistic(of_walk, self._p.gate)[-1], self._rough)
        sigma_uT = float(spread) if self._p.compass and np.isfinite(level[0]) else np.inf
        weight = float(weigh_compass(np.array(sigma_uT), self._rough))
        return sigma_uT, CompassVerdict(verdicts.words[-1], verdicts.reason[-1], weight)

    def _measure_roughness(self) -> FieldRoughness:
        """Return the roughness of the field over the last `RECENT` footfalls; that of the potential is the batch's."""
        rows = self._recent
        deviation = deviate_along(rows[:, LEVEL], rows[:, REFERENCE])
        measured = measure_roughness(deviation, np.isfinite(deviation), rows[1:, DISTANCE])
        return replace(measured, potential=self._potential)


def measure_field(recording: Recording, stances: Stances, track: Trajectory, up_uT: float) -> StrideField:
    """Return the mean field at the second of two footfalls and the line integral along the stride, as in batch.

    Parameters
    ----------
    recording, stances : of the two footfalls.
    track : path at the samples, without the field; its origin and heading make no difference.
    up_uT : vertical field of the walk.
    """
    sample = stances.stillest(recording.gyr)
    try:
        footfall = average_footfall_field(recording, stances, nav_R_body=track.nav_R_body).select(slice(1, 2))
    except MagneticError:  # none at the footfall
        at, unknown = sample[1:2], np.full(1, np.nan)
        footfall = FootfallField(
            at,
            recording.t[at],
            np.full((1, 3), np.nan),
            np.full((1, 3), np.nan),
            track.nav_R_body[at],
            np.zeros(1, dtype=np.int64),
            unknown,
            unknown,
            unknown,
            UNKNOWN_IRON_UT[None],
        )
    if recording.mag is None or not np.isfinite(recording.mag[:, 0]).any():
        return StrideField(footfall, None, float(np.linalg.norm(np.diff(track.position[sample], axis=0))))
    path = integrate_path(recording.t, recording.mag, track.position, track.nav_R_body, sample, up_uT)
    return StrideField(footfall, path, float(path.distance_m[0]))


# --- north ------------------------------------------------------------------------------------------------------------


def find_north_sigma(across_uT: Floats, walked_m: float, strength_uT: float) -> float:
    """Return the sigma (rad) of a north that is found by the mean field, `UNKNOWN_RAD` at most.

    Parameters
    ----------
    across_uT : (n,) deviations of the field across its mean, at the footfalls where it was seen.
    walked_m : length of the path.
    strength_uT : horizontal field of the walk.
    """
    freedom = FLOOR_WEIGHT + max(len(across_uT) - 1, 0)
    variance = (FLOOR_WEIGHT * FLOOR_UT**2 + float(np.sum(across_uT**2))) / freedom
    left = average_along(walked_m / FLOOR_LENGTH_M) + ROOM_SHARE**2 * average_along(walked_m / ROOM_LENGTH_M)
    across = float(np.sqrt(variance * left))
    return UNKNOWN_RAD if across >= UNKNOWN_RAD * strength_uT else across / strength_uT


def average_along(lengths: float) -> float:
    """Return v, the variance of the mean of a unit-variance process over this many correlation lengths."""
    if lengths < SHORT:
        return 1.0 - lengths / 3.0
    return float(2.0 * (lengths - 1.0 + np.exp(-lengths)) / lengths**2)


def extend_with_north(pose_cov: Floats, position: Floats, sigma: float) -> Floats:
    """Return `pose_cov` (4, 4) plus the error of north, for the part of its variance that the heading lacks.

    Parameters
    ----------
    pose_cov : of east, north, up and yaw, as in `StanceEstimate`.
    position : (3,) m from the origin of the walk.
    sigma : of north, rad.
    """
    s2 = max(sigma**2 - float(pose_cov[3, 3]), 0.0)
    east, north = position[:2]
    across, along = np.array([-north, east, 0.0, 0.0]), np.array([-east, -north, 0.0, 0.0])
    turn = np.array([0.0, 0.0, 0.0, 1.0])
    by_sin, by_cos = np.exp(-s2 / 2.0), np.exp(-2.0 * s2)
    both = s2 * by_sin * np.outer(turn, across)
    return np.asarray(
        pose_cov
        + s2 * np.outer(turn, turn)
        + both
        + both.T
        + 0.5 * (1.0 - by_cos) * np.outer(across, across)
        + (1.5 - 2.0 * by_sin + 0.5 * by_cos) * np.outer(along, along)
    )


# --- the differential field -------------------------------------------------------------------------------------------

NOTHING = BiasInformation(np.zeros((6, 6)), np.zeros(6))
NOTHING_OF_BIAS = BiasInformation(np.zeros((3, 3)), np.zeros(3))


@dataclass(frozen=True)
class BiasLedger:
    """Differential-field information on the newest bias: of its stances and standings, and already in the graph."""

    noise: FieldNoise
    variables: int
    stances: BiasInformation = NOTHING
    standings: BiasInformation = NOTHING
    in_graph: BiasInformation = NOTHING_OF_BIAS

    @classmethod
    def from_factors(cls, factors: DifferentialFactors | None) -> BiasLedger | None:
        """Return the ledger of a walk with these factors, all of them in its graph; None without."""
        if factors is None:
            return None
        stances, standings, limited = (
            BiasInformation(one.matrix[-1], one.vector[-1])
            for one in (factors.stances.information, factors.standings.information, factors.information)
        )
        return cls(factors.noise, len(factors.stances.count), stances, standings, limited)

    def begin(self) -> BiasLedger:
        """Return the ledger of a new variable, or of one whose graph begins again."""
        return BiasLedger(self.noise, self.variables)

    def complete(self, variable: int, known: LevelBias) -> gtsam.NonlinearFactor:
        """Return the factor with the information on bias `variable` that the graph lacks, at its estimate `known`."""
        limited = limit_information(self.stances, self.standings, self.noise.iron, self.variables)
        further = known.weaken(limited - self.in_graph)
        return linear_factor_of(further.residual(), [B(variable)])

    def add(self, window: StrideWindow, track: Trajectory, gyro_bias: Floats, counted: Rest | None) -> BiasLedger:
        """Return the ledger with the differential-field information of the newest footfall.

        Parameters
        ----------
        window, track : of its stride, and the path at its samples.
        gyro_bias : (3,) rad/s, to linearize at.
        counted : the last rest of the walk, in samples of the walk.
        """
        recording, nodes, first = window.recording, window.nodes, window.first_sample
        if recording.mag is None:
            return self
        rests = () if counted is None else (replace(counted, start=counted.start - first, stop=counted.stop - first),)
        stretches = find_stretches(recording, nodes, rests)
        stretches = stretches.keep(stretches.stop > nodes.sample[nodes.first[1]])
        if len(stretches.start) == 0:
            return self
        bias = np.tile(gyro_bias, (len(stretches.start), 1))
        information, used = measure_stretches(turn_stretches(recording, stretches, track.position, bias), self.noise)
        stances, standings = (
            sum_stretches(information, np.zeros_like(stretches.bias), used & those, 1).information
            for those in (~stretches.is_standing, stretches.is_standing)
        )
        return replace(
            self,
            stances=self.stances + BiasInformation(stances.matrix[0], stances.vector[0]),
            standings=self.standings + BiasInformation(standings.matrix[0], standings.vector[0]),
        )
