"""The field of a walk in progress: the batch's states and ties, one footfall at a time.

The states and residuals are those of `field_state`, split into factors that a graph takes one by one:

    across     (X_k, M_k)              compass, where the footfall is not disturbed
    along      (X_k-1, M_k-1, M_k)     line integral of the stride
    carried    (M_k-1, M_k)            linear, so exact wherever it is linearised
    first      (M_0)                   prior by direction and strength

How rough the field is, what disturbs it, and the stance's axes follow from the walk so far: at each warm-up from the
batch's own rounds (`field_rounds`), in between from the last `RECENT` footfalls, each as it was seen at its time.
Unlike in batch a verdict stays as it was given, and so does the noise of a footfall that is in the graph already.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import M, X

from fg_nav.arrays import Floats
from fg_nav.factors import guarded_factor
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.quasi_static import DISTURBED, NO_FIELD, QUASI_STATIC, UNKNOWN
from fg_nav.smoother.field_noise import FieldRoughness, robust_sigma
from fg_nav.smoother.field_parameters import FieldParameters
from fg_nav.smoother.field_rounds import LEAST_SIGMA_UT, reason_of, roughness_of
from fg_nav.smoother.field_state import (
    DELTA,
    DISTURBED_FACTOR,
    E_H,
    IRON,
    PHI,
    RHO,
    SIZE,
    FieldPrior,
    FieldTies,
    across_field,
)

RECENT = 4000
"""Footfalls whose deviations tell what is usual. A robust sigma needs a tenth of them; how regions differ, which are
fifteen footfalls long, all."""

ROUGH_EVERY = 10
"""Footfalls after which the roughness is measured anew."""


@dataclass(frozen=True)
class Seen:
    """What a stride showed of the field.

    `body_field` (3,) uT at its footfall, NaN where there was none; of the stride to it, as in `FieldWay`: `u` uT m,
    `body_way` (3,) m in the body's axes, `body_move` (3,) m, `sigma_uT_m`, `distance_m`.
    """

    body_field: Floats
    u: float
    body_way: Floats
    body_move: Floats
    sigma_uT_m: float
    distance_m: float


@dataclass(frozen=True)
class Verdict:
    """On the field at a footfall, as in a stance table."""

    word: str
    reason: str


class OnlineField:
    """The field so far, begun from what the batch found on a walk.

    Parameters
    ----------
    ties : of its last round.
    states : (F, 8) it found.
    field : at its footfalls, and `nav_R_body` (F, 3, 3) as smoothed.
    p : of the field; with the line integral where the batch used it.
    """

    def __init__(
        self, ties: FieldTies, states: Floats, field: FootfallField, nav_R_body: Floats, p: FieldParameters
    ) -> None:
        self._p = replace(p, potential=bool(ties.along.any()))
        self._way = ties.way
        nav = np.einsum("kij,kj->ki", nav_R_body, field.body_field)
        raw = _deviations(nav, states[:, E_H])
        distance = np.append(0.0, self._way.distance_m)
        rows = np.column_stack([raw, states[:, PHI], distance])
        self._recent = deque(rows, maxlen=RECENT)
        self._disturbed = bool(ties.seen.disturbed[-1])
        self._rough, self._age = self._measured(), 0
        self.up_uT = float(np.nanmedian(nav[:, 2]))

    def add(
        self,
        graph: gtsam.NonlinearFactorGraph,
        k: int,
        node: int,
        node_before: int,
        seen: Seen,
        pose: gtsam.Pose3,
        before: Floats,
    ) -> tuple[Floats, Verdict]:
        """Add footfall k at `node` with the stride to it.

        Parameters
        ----------
        graph : takes its factors.
        pose : at the footfall, as it is known without its field.
        before : (8,) state at the footfall before.

        Returns
        -------
        tuple
            The state (8,) to begin from, and the verdict.
        """
        nav = pose.rotation().matrix() @ seen.body_field
        raw = _deviations(nav[None], before[None, E_H])[0]
        verdict, disturbed = self._judged(raw)
        keep, new = self._transition(seen.distance_m, disturbed)
        level = self._way.level_R_body
        if disturbed is not None and not disturbed and self._p.compass:
            graph.push_back(across_factor(k, node, seen.body_field, level, self._p.compass_sigma_uT))
        if self._p.potential and np.isfinite(seen.sigma_uT_m):
            level_way = level @ seen.body_way
            graph.push_back(along_factor(k, node_before, seen.u, level_way, seen.body_move, seen.sigma_uT_m))
        graph.push_back(carried_factor(k, keep, new))
        state = keep * before
        self._recent.append(np.append(raw, [state[PHI], seen.distance_m]))
        self._disturbed = bool(disturbed)
        self._age += 1
        if self._age % ROUGH_EVERY == 0:
            self._rough = self._measured()
        return state, verdict

    def _judged(self, raw: Floats) -> tuple[Verdict, bool | None]:
        """Verdict, and whether the footfall is disturbed; None where it was not seen."""
        if not np.isfinite(raw).all():
            return Verdict(UNKNOWN, NO_FIELD), None
        known = np.array(self._recent)[:, :3]
        known = known[np.isfinite(known[:, 0])]
        centre = np.median(known, axis=0)
        centre[0] = 0.0
        spread = np.array([max(robust_sigma(column), LEAST_SIGMA_UT) for column in (known - centre).T])
        deviation = raw - centre
        statistic = float(np.abs(deviation / (self._p.outlier_sigmas * spread)).max())
        word = QUASI_STATIC if statistic < 1.0 else DISTURBED
        return Verdict(str(word), reason_of(deviation, statistic)), statistic >= 1.0

    def _measured(self) -> FieldRoughness:
        """Roughness of the field at the footfalls that are remembered."""
        rows = np.array(self._recent)
        seen = np.isfinite(rows[:, 0])
        deviation = rows[:, :3] - np.nanmedian(rows[:, :3], axis=0) * [0.0, 1.0, 1.0]
        states = np.zeros((len(rows), SIZE))
        states[:, PHI] = rows[:, 3]
        return roughness_of(deviation, states, seen, replace(self._way, distance_m=rows[1:, 4]), self._p)

    def _transition(self, distance_m: float, disturbed: bool | None) -> tuple[Floats, Floats]:
        """Share (8,) of the state that is left a stride later, and sigma of what is new."""
        rough = self._rough
        keep, new = np.ones(SIZE), np.empty(SIZE)
        new[E_H], new[IRON] = self._p.mean_walk_uT, self._p.hard_iron_walk_uT
        d = np.array(distance_m)
        for column, one in ((PHI, rough.potential), (DELTA, rough.across), (RHO, rough.regional)):
            keep[column], new[column] = one.left(d), one.innovation(d)
        if disturbed or self._disturbed:
            new[[PHI, DELTA]] *= DISTURBED_FACTOR
        return keep, new


def field_factors(graph: gtsam.NonlinearFactorGraph, ties: FieldTies, prior: FieldPrior) -> None:
    """Add all ties of a walk to a graph, one by one; `prior` in place of theirs."""
    seen, way = ties.seen, ties.way
    graph.push_back(first_factor(prior))
    for k, node in enumerate(seen.node.tolist()):
        if ties.compass[k] > 0.0:
            sigma = float(1.0 / ties.compass[k])
            graph.push_back(across_factor(k, node, seen.body_field[k], way.level_R_body, sigma))
        if k > 0:
            graph.push_back(carried_factor(k, ties.keep[k - 1], ties.innovation[k - 1]))
            if ties.along[k - 1] > 0.0:
                before, of_stride = int(seen.node[k - 1]), (way.u[k - 1], way.level_way[k - 1], way.body_move[k - 1])
                graph.push_back(along_factor(k, before, *of_stride, float(1.0 / ties.along[k - 1])))


def across_factor(k: int, node: int, body_field: Floats, level_R_body: Floats, sigma_uT: float) -> gtsam.CustomFactor:
    """Tie of the pose at footfall k, its node, to its state of the field by the compass."""
    pose_key, state_key, y = X(node), M(k), body_field.copy()

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
        nav_R_body, m = values.atPose3(pose_key).rotation().matrix(), values.atVector(state_key)
        e_E, e_N = m[3], m[4]
        strength = np.sqrt(e_E * e_E + e_N * e_N)
        n = nav_R_body[:2] @ (y - m[IRON] @ level_R_body)
        right = np.array([e_N, -e_E]) / strength
        e = np.array([(n @ right - m[DELTA] - m[RHO]) / sigma_uT])
        if not with_jacobians:
            return e, []
        along = (n[0] * e_E + n[1] * e_N) / strength
        by_pose, by_state = np.zeros((1, 6)), np.zeros((1, SIZE))
        by_pose[0, :3] = (-along / sigma_uT) * nav_R_body[2]
        by_state[0, DELTA] = by_state[0, RHO] = -1.0 / sigma_uT
        by_state[0, E_H] = (-along / (strength * sigma_uT)) * right
        by_state[0, IRON] = level_R_body @ (right @ nav_R_body[:2]) / -sigma_uT
        return e, [by_pose, by_state]

    unit = gtsam.noiseModel.Unit.Create(1)
    return guarded_factor("field across", [pose_key, state_key], [6, SIZE], unit, residual)


def along_factor(
    k: int, node_before: int, u: float, level_way: Floats, body_move: Floats, sigma_uT_m: float
) -> gtsam.CustomFactor:
    """Tie of the pose at the footfall before k, and the states of both, by the line integral of the stride."""
    keys = [X(node_before), M(k - 1), M(k)]
    d, s, u = body_move.copy(), level_way / sigma_uT_m, float(u)
    by_next = np.zeros((1, SIZE))
    by_next[0, PHI] = -1.0 / sigma_uT_m

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
        nav_R_body, before = values.atPose3(keys[0]).rotation().matrix(), values.atVector(keys[1])
        n = nav_R_body[:2] @ d
        e_E, e_N = before[3], before[4]
        potential = before[PHI] - values.atVector(keys[2])[PHI]
        e = np.array([(e_E * n[0] + e_N * n[1] + potential - u) / sigma_uT_m + s @ before[IRON]])
        if not with_jacobians:
            return e, []
        by_pose, by_before = np.zeros((1, 6)), np.zeros((1, SIZE))
        by_pose[0, :3] = ((n[0] * e_N - n[1] * e_E) / sigma_uT_m) * nav_R_body[2]
        by_before[0, PHI] = 1.0 / sigma_uT_m
        by_before[0, E_H] = n / sigma_uT_m
        by_before[0, IRON] = s
        return e, [by_pose, by_before, by_next]

    unit = gtsam.noiseModel.Unit.Create(1)
    return guarded_factor("field along the way", keys, [6, SIZE, SIZE], unit, residual)


def carried_factor(k: int, keep: Floats, innovation: Floats) -> gtsam.LinearContainerFactor:
    """Tie of the state at footfall k to that before."""
    unit, zero = gtsam.noiseModel.Unit.Create(SIZE), gtsam.Values()
    for key in (M(k - 1), M(k)):
        zero.insert(key, np.zeros(SIZE))
    before, after = np.diag(-keep / innovation), np.diag(1.0 / innovation)
    return gtsam.LinearContainerFactor(gtsam.JacobianFactor(M(k - 1), before, M(k), after, np.zeros(SIZE), unit), zero)


def first_factor(prior: FieldPrior) -> gtsam.CustomFactor:
    """Prior on the first state."""
    ties = _prior_alone(prior)

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
        m = values.atVector(M(0))
        return ties.first(m), [ties.by_first(m)] if with_jacobians else []

    return guarded_factor("first state of the field", [M(0)], [SIZE], gtsam.noiseModel.Unit.Create(SIZE), residual)


def turned(prior: FieldPrior, nav_R_nav: Floats) -> FieldPrior:
    """Prior of a walk that was turned about up."""
    mean = prior.mean.copy()
    mean[E_H] = nav_R_nav[:2, :2] @ mean[E_H]
    return replace(prior, mean=mean)


def _prior_alone(prior: FieldPrior) -> FieldTies:
    ties = FieldTies.__new__(FieldTies)
    ties.prior = prior
    return ties


def _deviations(nav_field: Floats, reference: Floats) -> Floats:
    """(F, 3) uT of fields (F, 3) across a horizontal one (F, 2), along it, and up."""
    along = (nav_field[:, :2] * reference).sum(axis=1) / np.linalg.norm(reference, axis=1)
    return np.stack([across_field(nav_field, reference), along, nav_field[:, 2]], axis=1)
