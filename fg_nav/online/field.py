"""The field of a walk in progress: the batch's states and residuals, one footfall at a time.

How far the potential reaches, where it jumps and how much of the line integral drifts is that of the last re-solve, of
the batch's own rounds (`smoother.field`). Since then a stride that takes the potential out of its bounds is left out.
The other roughness of the field follows from the last `RECENT` footfalls, each as it was seen at its time, and so does
the usual statistic of the gate, by which that of the newest footfall weighs its compass. The gate judges a footfall by
it and those before it, as in batch, with the attitudes known then. Unlike in batch a verdict stays as it was given, and
so does the noise of a footfall that is in the graph already.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import M, X

from fg_nav.arrays import Floats
from fg_nav.errors import MagneticError
from fg_nav.factors.magnetic_field import E_H, SIZE, FieldPotential, MagneticHeading, across_field
from fg_nav.factors.residual import factor_of, linear_factor_of
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.footfall_field import UNKNOWN_IRON_UT
from fg_nav.magnetic.quasi_static import apply_gate, count_needed, weigh_statistic
from fg_nav.online.north import find_north_sigma
from fg_nav.recording import Recording
from fg_nav.smoother.dense_path import Trajectory
from fg_nav.smoother.field import FieldSolution, compass_sigma, rotate_field, weigh_compass
from fg_nav.smoother.field_factors import (
    FieldRoughness,
    deviate_along,
    integrate_path,
    measure_roughness,
    split_potential,
    transition,
)
from fg_nav.smoother.potential import MIN_JUMP_UT_M
from fg_nav.smoother.solver import list_attitudes
from fg_nav.stances import Stances

RECENT = 4000
"""Footfalls whose deviations show how rough the field is. A robust sigma needs a tenth of them; how regions differ,
which are fifteen footfalls long, all. And the most that a gate judges a footfall by."""

JUMP_SIGMAS = 6.0
"""Of the potential, beyond which a stride's line integral is not used: 40 A over a rough floor. The next re-solve looks
again, with the strides that follow."""

ROUGH_EVERY = 10  # Footfalls after which the roughness is measured again.

LEVEL, REFERENCE, DISTANCE, STATISTIC = slice(0, 2), slice(2, 4), 4, 5
"""Columns of what is remembered of a footfall: its field over the ground in nav and the mean field there, uT, length of
the stride to it, m, statistic of the gate."""


@dataclass(frozen=True)
class StrideField:
    """What a stride showed of the field.

    `footfall` is the field at its one footfall, NaN where there was none; of the stride to it, as in `FieldPath`: `u`
    uT m, `body_path` (3,) m in the body's axes, `by_up` (3,) uT m, `body_move` (3,) m, `nav_R_level` (3, 3),
    `sigma_uT_m`, `distance_m`.
    """

    footfall: FootfallField
    u: float
    body_path: Floats
    by_up: Floats
    body_move: Floats
    nav_R_level: Floats
    sigma_uT_m: float
    distance_m: float


@dataclass(frozen=True)
class Verdict:
    """On the field at a footfall: `word` and `reason` as in a stance table, weight of its compass (`weigh_compass`)."""

    word: str
    reason: str
    compass_weight: float = 0.0


class OnlineField:
    """The field so far, begun from what the batch found on a walk with the field `field` at its footfalls."""

    def __init__(self, found: FieldSolution, field: FootfallField) -> None:
        factors, values = found.problem.field, found.solved.values
        assert factors is not None
        self._p = replace(factors.parameters, potential=len(factors.potential) > 0)
        self._level_R_body = factors.path.level_R_body
        nav_R_body = list_attitudes(found.problem.nodes.result, values)
        nav, judged = rotate_field(field, nav_R_body), replace(field, nav_R_body=nav_R_body)
        distance, statistic = np.append(0.0, factors.path.distance_m), apply_gate(judged, self._p.gate).statistic
        self._recent = np.column_stack([nav[:, :2], found.states[:, E_H], distance, statistic])[-RECENT:]
        self._potential, self._with_lost, self._lost_share = (
            factors.telescoping,
            factors.rough.potential,
            factors.lost_share,
        )
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
        seen: StrideField,
        pose: gtsam.Pose3,
        before: Floats,
    ) -> tuple[Floats, Verdict]:
        """Add footfall k at `node` with the stride to it.

        Parameters
        ----------
        graph : takes its factors.
        pose : at the footfall, as it is known without its field.
        before : (9,) state at the footfall before.

        Returns
        -------
        tuple
            The state (9,) to begin from, and the verdict.
        """
        nav_R_body, body_field = pose.rotation().matrix(), seen.footfall.body_field[0]
        sigma_uT, verdict = self._judge(seen, nav_R_body, before)
        change = transition(np.array(seen.distance_m), self._rough)
        if np.isfinite(sigma_uT):
            compass = MagneticHeading(body_field, self._level_R_body, nav_R_body, np.array(sigma_uT))
            graph.push_back(factor_of(compass, [X(node), M(k)]))
        integral = self._integrate_field(seen)
        if self._p.potential and np.isfinite(seen.sigma_uT_m) and not self._jumps(integral, before):
            graph.push_back(factor_of(integral, [X(node_before), M(k - 1), M(k)]))
        graph.push_back(linear_factor_of(change, [M(k - 1), M(k)]))
        self._age += 1
        if self._age % ROUGH_EVERY == 0:
            self._rough = self._measure_roughness()
        return change.keep * before, verdict

    @property
    def north_sigma(self) -> float:
        """Sigma, rad, of a north that only this field shows."""
        seen = self._recent[np.isfinite(self._recent[:, 0])]
        across = across_field(seen[:, LEVEL], seen[:, REFERENCE])
        return find_north_sigma(across, float(self._recent[:, DISTANCE].sum()), self._strength_uT)

    def _integrate_field(self, seen: StrideField) -> FieldPotential:
        _, drift_uT_m = split_potential(self._with_lost, self._lost_share, np.array(seen.distance_m))
        level_path, sigma = self._level_R_body @ seen.body_path, np.hypot(seen.sigma_uT_m, drift_uT_m)
        u = np.array(seen.u)
        return FieldPotential(u, level_path, seen.by_up, seen.body_move, seen.nav_R_level, np.array(sigma))

    def _jumps(self, integral: FieldPotential, before: Floats) -> bool:
        """Whether the stride takes the potential out of its bounds, as a circuit of current does."""
        nav_T_body = np.eye(4)
        nav_T_body[:3, :3] = integral.nav_R_level
        e, _ = integral.evaluate([nav_T_body, before, np.zeros(SIZE)], with_jacobians=False)
        potential_after = float(e[0] * integral.sigma_uT_m)
        sigma = float(np.hypot(self._potential.sigma, integral.sigma_uT_m))
        return bool(abs(potential_after) > max(JUMP_SIGMAS * sigma, MIN_JUMP_UT_M))

    def _judge(self, seen: StrideField, nav_R_body: Floats, before: Floats) -> tuple[float, Verdict]:
        """Note the newest footfall; the sigma of its compass, infinite without a reading, and the verdict."""
        newest = replace(seen.footfall, nav_R_body=nav_R_body[None])
        self._judged = self._judged.join(newest).select(slice(-self._needed, None))
        verdicts = apply_gate(self._judged, self._p.gate)
        level = rotate_field(newest, newest.nav_R_body)[0, :2]
        row = np.concatenate([level, before[E_H], [seen.distance_m, verdicts.statistic[-1]]])
        self._recent = np.vstack([self._recent, row])[-RECENT:]
        # Its statistic is weighed by those of the walk.
        of_walk = replace(verdicts, statistic=self._recent[:, STATISTIC])
        spread = compass_sigma(weigh_statistic(of_walk, self._p.gate)[-1], self._rough)
        sigma_uT = float(spread) if self._p.compass and np.isfinite(level[0]) else np.inf
        weight = float(weigh_compass(np.array(sigma_uT), self._rough))
        return sigma_uT, Verdict(verdicts.words[-1], verdicts.reason[-1], weight)

    def _measure_roughness(self) -> FieldRoughness:
        """Roughness of the field at the footfalls that are remembered, the potential's as in batch."""
        rows = self._recent
        deviation = deviate_along(rows[:, LEVEL], rows[:, REFERENCE])
        measured = measure_roughness(deviation, np.isfinite(deviation), rows[1:, DISTANCE])
        return replace(measured, potential=self._potential)


def measure_field(recording: Recording, stances: Stances, track: Trajectory, up_uT: float) -> StrideField:
    """Return what the second of two footfalls and the stride to it show of the field, as the batch measures it.

    Parameters
    ----------
    recording, stances : of the two footfalls.
    track : at its samples, known without the field: where it is and which way it heads makes no difference.
    up_uT : vertical field of the walk.
    """
    sample = stances.stillest(recording.gyr)
    move, nav_R_level = track.position[sample[1]] - track.position[sample[0]], track.nav_R_body[sample[0]]
    distance = float(np.linalg.norm(move))
    footfall = _measure_at_footfall(recording, stances, track, int(sample[1]))
    if recording.mag is None or not np.isfinite(recording.mag[:, 0]).any():
        none = np.zeros(3)
        return StrideField(footfall, 0.0, none, none, nav_R_level.T @ move, nav_R_level, np.inf, distance)
    path = integrate_path(recording.t, recording.mag, track.position, track.nav_R_body, sample, up_uT)
    body_path = path.level_path[0] @ path.level_R_body
    u, sigma = float(path.u[0]), float(path.sigma_uT_m[0])
    distance = float(path.distance_m[0])
    return StrideField(footfall, u, body_path, path.by_up[0], path.body_move[0], nav_R_level, sigma, distance)


def _measure_at_footfall(recording: Recording, stances: Stances, track: Trajectory, sample: int) -> FootfallField:
    """Field at the second of two footfalls; NaN where there was none."""
    try:
        return average_footfall_field(recording, stances, nav_R_body=track.nav_R_body).select(slice(1, 2))
    except MagneticError:
        unknown, nowhere = np.full(1, np.nan), np.full((1, 3), np.nan)
        none = np.zeros(1, dtype=np.int64)
        at, attitude = np.array([sample]), track.nav_R_body[[sample]]
        t = recording.t[at]
        iron = UNKNOWN_IRON_UT[None]
        return FootfallField(at, t, nowhere, nowhere, attitude, none, unknown, unknown, unknown, iron)
