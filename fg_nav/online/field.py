"""The magnetic field of a walk in progress: the batch's states and factors, one footfall at a time.

Roughness of the potential and drift of the line integral are those of the last solution of the walk (the rounds of
`smoother.field`), the other roughness that of the last `RECENT` footfalls, as is the statistic of the gate.

`find_north_sigma`: where no heading was given, north is where the mean field of the walk points. It deviates across
that of the Earth from one footfall to the next by what lies in the floor, from one room to the next by what stands in
it: two stationary processes along the path, of the correlation lengths L and L_r. Over a path of s m the mean of such a
process has the variance sigma^2 v(s / L),

    v(x) = 2 (x - 1 + exp(-x)) / x^2,    v(0) = 1,    v -> 2 / x,

and north, with H the horizontal field,

    sigma_north^2 = (sigma^2 v(s / L) + sigma_r^2 v(s / L_r)) / H^2
    sigma^2 = (n_0 sigma_0^2 + sum e_k^2) / (n_0 + n - 1),    sigma_r = c sigma,

e_k the deviation across the mean at the n footfalls so far. Few footfalls of one room agree and may all be wrong, so
sigma begins from that of a reinforced floor, sigma_0. A short walk cannot show what rooms do: that is a share c.

`extend_with_north`: a north that is off by theta turns the walk about its origin. A position p from there is off by
sin(theta) (up x p) - (1 - cos(theta)) p over the ground, with the second moments, theta normal,

    <theta^2> = s^2,    <theta sin> = s^2 exp(-s^2 / 2),
    <sin^2> = (1 - exp(-2 s^2)) / 2,    <(1 - cos)^2> = 3/2 - 2 exp(-s^2 / 2) + exp(-2 s^2) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.stance import Stances
from fg_nav.errors import MagneticError
from fg_nav.factors.magnetic_field import E_H, SIZE, across_field
from fg_nav.frames import UNKNOWN_RAD
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.detectors import apply_gate, count_needed, weigh_statistic
from fg_nav.online.estimates import CompassVerdict
from fg_nav.recording import Recording
from fg_nav.smoother.field import MIN_JUMP_UT_M, FieldSolution
from fg_nav.smoother.field_factors import (
    CompassReadings,
    FieldFactors,
    FieldPath,
    FieldRoughness,
    compass_sigma,
    deviate_along,
    integrate_path,
    measure_roughness,
    weigh_compass,
)
from fg_nav.smoother.graph import Trajectory
from fg_nav.smoother.solver import list_attitudes

RECENT = 4000  # Footfalls: how regions differ, which are fifteen footfalls long, takes all. Most that a gate uses.
JUMP_SIGMAS = 6.0  # Of the potential: 40 A over a rough floor. The next solution of the walk checks the stride again.
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
    """Field measured at a footfall, NaN where there was none, and along the one stride to it."""

    footfall: FootfallField
    path: FieldPath


class OnlineField:
    """The field of a walk so far, from the batch solution of a walk with the field `field` at its footfalls."""

    def __init__(self, found: FieldSolution, field: FootfallField) -> None:
        factors, values = found.problem.get(FieldFactors), found.solved.values
        self._p = replace(factors.parameters, potential=len(factors.potential) > 0)
        self._level_R_body, self._prior, self._lost_share = factors.path.level_R_body, factors.prior, factors.lost_share
        judged = replace(field, nav_R_body=list_attitudes(found.problem.nodes.result, values))
        distance, statistic = np.append(0.0, factors.path.distance_m), apply_gate(judged, self._p.gate).statistic
        self._recent = np.column_stack([judged.nav_field[:, :2], found.states[:, E_H], distance, statistic])[-RECENT:]
        self._potential = factors.rough.potential
        self._needed = min(count_needed(self._p.gate) or RECENT, RECENT)
        self._judged = judged.select(slice(-self._needed, None))
        self._rough, self._age = self._measure_roughness(), 0
        self._strength_uT = float(np.median(np.linalg.norm(found.states[:, E_H], axis=1)))
        self._up_uT = float(np.nanmedian(judged.nav_field[:, 2]))

    def measure(self, recording: Recording, stances: Stances, track: Trajectory, is_seen: bool) -> StrideField:
        """Return the mean field at the second of two footfalls and the line integral along the stride, as in batch.

        Of the path at the samples, `track`, origin and heading make no difference. At a further piece of a standing
        the field is not seen.
        """
        sample = stances.stillest(recording.gyr)
        try:
            footfall = average_footfall_field(recording, stances, nav_R_body=track.nav_R_body).select(slice(1, 2))
        except MagneticError:  # none at either footfall
            at, is_seen = sample[1:2], False
            known = self._judged.select(slice(-1, None))
            footfall = replace(known, sample=at, t=recording.t[at], nav_R_body=track.nav_R_body[at])
        footfall = footfall if is_seen else footfall.leave_out(np.ones(1, dtype=np.bool_))
        if recording.mag is not None and np.isfinite(recording.mag[:, 0]).any():
            path = integrate_path(recording.t, recording.mag, track.position, track.nav_R_body, sample, self._up_uT)
            # In the axes of the walk's stances, not of these two.
            level_path = path.level_path @ path.level_R_body @ self._level_R_body.T
            return StrideField(footfall, replace(path, level_path=level_path, level_R_body=self._level_R_body))
        distance, nothing = np.linalg.norm(np.diff(track.position[sample], axis=0), axis=1), np.zeros((1, 3))
        frames = np.eye(3)[None], np.full(1, np.inf), distance, self._level_R_body, np.zeros(1, dtype=np.bool_)
        return StrideField(footfall, FieldPath(np.zeros(1), nothing, nothing, nothing, *frames))

    def add(
        self, number: int, nodes: tuple[int, int], stride: StrideField, nav_R_body: Floats, before: Floats
    ) -> tuple[gtsam.NonlinearFactorGraph, Floats, CompassVerdict]:
        """Return the factors of a footfall and the stride to it, the initial value (9,) of its state, and the verdict.

        `nodes` are the pose nodes of the footfall before and of this one, `nav_R_body` (3, 3) is the attitude at this
        one without its field, `before` (9,) the state at the one before.
        """
        # The compass of the footfall, the line integral along its stride, and the change of the state, as in batch.
        sigma_uT, verdict = self._judge_compass(stride, nav_R_body, before)
        both = np.repeat(stride.footfall.body_field, 2, axis=0), np.stack([nav_R_body, nav_R_body])
        readings = CompassReadings(np.array(nodes), *both, np.array([np.inf, sigma_uT]))
        walk = self._prior, self._rough, self._p, self._lost_share, number - 1
        factors = FieldFactors(readings, stride.path, *walk)
        # Left out where the potential jumps, as beside a conductor: there the field has no single-valued potential.
        if len(factors.potential):
            nav_T_body = np.eye(4)[None]
            nav_T_body[0, :3, :3] = stride.path.nav_R_level[0]
            integral, noise = factors.potential.residuals, float(factors.integral_sigma[0])
            e, _ = integral.evaluate([nav_T_body, before[None], np.zeros((1, SIZE))], with_jacobians=False)
            bound = JUMP_SIGMAS * float(np.hypot(factors.telescoping.sigma, noise))
            if abs(float(e[0, 0]) * noise) > max(bound, MIN_JUMP_UT_M):
                factors = factors.mark_jumps(np.zeros(1, dtype=np.int64), True)
        graph = gtsam.NonlinearFactorGraph()
        for block in (factors.heading, factors.potential, factors.transition):
            for factor in block.factors():
                graph.push_back(factor)
        self._age += 1
        if self._age % ROUGH_EVERY == 0:
            self._rough = self._measure_roughness()
        return graph, factors.keep[0] * before, verdict

    @property
    def north_sigma(self) -> float:
        """Sigma, rad, of a north that only this field shows."""
        rows = self._recent[np.isfinite(self._recent[:, 0])]
        across = across_field(rows[:, LEVEL], rows[:, REFERENCE])
        return find_north_sigma(across, float(self._recent[:, DISTANCE].sum()), self._strength_uT)

    def _judge_compass(self, stride: StrideField, nav_R_body: Floats, before: Floats) -> tuple[float, CompassVerdict]:
        """Run the gate on the newest footfall; return sigma (uT) of its compass, infinite without, and verdict."""
        newest = replace(stride.footfall, nav_R_body=nav_R_body[None])
        self._judged = self._judged.join(newest).select(slice(-self._needed, None))
        verdicts = apply_gate(self._judged, self._p.gate)
        level = newest.nav_field[0, :2]
        row = np.concatenate([level, before[E_H], [stride.path.distance_m[0], verdicts.statistic[-1]]])
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


def find_north_sigma(across_uT: Floats, walked_m: float, strength_uT: float) -> float:
    """Return the sigma (rad) of a north that is found by the mean field, `UNKNOWN_RAD` at most.

    `across_uT` (n,) are the field's deviations across its mean, `strength_uT` is the walk's horizontal field.
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
    """Return `pose_cov` (4, 4) plus the error of north, `sigma` rad, for the part of its variance that it lacks."""
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
