"""The field of a walk in progress: the batch's states and residuals, one footfall at a time.

How rough the field is, what disturbs it, and the stance's axes follow from the walk so far: at each re-solve from the
batch's own rounds (`smoother.field`), in between from the last `RECENT` footfalls, each as it was seen at its time.
Unlike in batch a verdict stays as it was given, and so does the noise of a footfall that is in the graph already.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import M, X

from fg_nav.arrays import Floats
from fg_nav.errors import MagneticError
from fg_nav.factors.magnetic_field import E_H, PHI, SIZE, FieldPotential, MagneticHeading
from fg_nav.factors.residual import factor_of, linear_factor_of
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother.field import COMPASS_SIGMA_UT, FieldSolution, judge_footfall
from fg_nav.smoother.field_factors import (
    FieldRoughness,
    field_deviation,
    integrate_path,
    measure_roughness,
    over_threshold,
    transition,
    usual_deviation,
)
from fg_nav.smoother.graph import Trajectory
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.stances import Stances

RECENT = 4000
"""Footfalls whose deviations show what is usual. A robust sigma needs a tenth of them; how regions differ, which are
fifteen footfalls long, all."""

ROUGH_EVERY = 10
"""Footfalls after which the roughness is measured again."""


@dataclass(frozen=True)
class StrideField:
    """What a stride showed of the field.

    `body_field` (3,) uT at its footfall, NaN where there was none; of the stride to it, as in `FieldPath`: `u` uT m,
    `body_path` (3,) m in the body's axes, `body_move` (3,) m, `sigma_uT_m`, `distance_m`.
    """

    body_field: Floats
    u: float
    body_path: Floats
    body_move: Floats
    sigma_uT_m: float
    distance_m: float


@dataclass(frozen=True)
class Verdict:
    """On the field at a footfall, as in a stance table."""

    word: str
    reason: str


class OnlineField:
    """The field so far, begun from what the batch found on a walk with the field `field` at its footfalls."""

    def __init__(self, found: FieldSolution, field: FootfallField) -> None:
        factors, values = found.problem.field, found.solved.values
        assert factors is not None
        self._p = replace(found.problem.parameters.magnetic, potential=len(factors.potential) > 0)
        self._level_R_body = factors.path.level_R_body
        nodes = found.problem.nodes.result.tolist()
        nav_R_body = np.array([values.atPose3(X(j)).rotation().matrix() for j in nodes])
        nav = np.einsum("kij,kj->ki", nav_R_body, field.body_field)
        raw = field_deviation(nav, found.states[:, E_H])
        distance = np.append(0.0, factors.path.distance_m)
        self._recent = deque(np.column_stack([raw, found.states[:, PHI], distance]), maxlen=RECENT)
        self._disturbed = bool(factors.readings.disturbed[-1])
        self._rough, self._age = self._measure_roughness(), 0
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
        before : (8,) state at the footfall before.

        Returns
        -------
        tuple
            The state (8,) to begin from, and the verdict.
        """
        nav = pose.rotation().matrix() @ seen.body_field
        raw = field_deviation(nav[None], before[None, E_H])[0]
        statistic, verdict = self._judge(raw)
        disturbed = statistic >= 1.0
        about = np.array(disturbed or self._disturbed)
        change = transition(np.array(seen.distance_m), about, self._rough, self._p)
        if statistic < 1.0 and self._p.compass:
            sigma = np.array(COMPASS_SIGMA_UT)
            compass = MagneticHeading(seen.body_field, self._level_R_body, sigma)
            graph.push_back(factor_of(compass, [X(node), M(k)]))
        if self._p.potential and np.isfinite(seen.sigma_uT_m):
            u, sigma = np.array(seen.u), np.array(seen.sigma_uT_m)
            integral = FieldPotential(u, self._level_R_body @ seen.body_path, seen.body_move, sigma)
            graph.push_back(factor_of(integral, [X(node_before), M(k - 1), M(k)]))
        graph.push_back(linear_factor_of(change, [M(k - 1), M(k)]))
        state = change.keep * before
        self._recent.append(np.append(raw, [state[PHI], seen.distance_m]))
        self._disturbed = bool(disturbed)
        self._age += 1
        if self._age % ROUGH_EVERY == 0:
            self._rough = self._measure_roughness()
        return state, verdict

    def _judge(self, raw: Floats) -> tuple[float, Verdict]:
        """Deviation over its threshold, NaN where it was not seen, and the verdict."""
        known = np.array(self._recent)[:, :3]
        known = known[np.isfinite(known[:, 0])]
        usual = usual_deviation(known)
        statistic = float(over_threshold((raw - usual)[None], known - usual, self._p)[0])
        return statistic, Verdict(*judge_footfall(raw - usual, statistic))

    def _measure_roughness(self) -> FieldRoughness:
        """Roughness of the field at the footfalls that are remembered."""
        rows = np.array(self._recent)
        seen = np.isfinite(rows[:, 0])
        deviation = rows[:, :3] - usual_deviation(rows[seen, :3])
        states = np.zeros((len(rows), SIZE))
        states[:, PHI] = rows[:, 3]
        return measure_roughness(deviation, states, seen, rows[1:, 4], self._p)


def measure_field(
    recording: Recording, stances: Stances, track: Trajectory, up_uT: float, p: FieldParameters
) -> StrideField:
    """Return what the second of two footfalls and the stride to it show of the field, as the batch measures it.

    Parameters
    ----------
    recording, stances : of the two footfalls.
    track : at its samples, known without the field: where it is and which way it heads makes no difference.
    up_uT : vertical field of the walk.
    """
    sample = stances.stillest(recording.gyr)
    move = track.position[sample[1]] - track.position[sample[0]]
    body_move, distance = track.nav_R_body[sample[0]].T @ move, float(np.linalg.norm(move))
    nothing = StrideField(np.full(3, np.nan), 0.0, np.zeros(3), body_move, np.inf, distance)
    if recording.mag is None or not np.isfinite(recording.mag[:, 0]).any():
        return nothing
    path = integrate_path(recording.t, recording.mag, track.position, track.nav_R_body, sample, up_uT, p)
    body_path = path.level_path[0] @ path.level_R_body
    body_field = _measure_at_footfall(recording, stances, track)
    return StrideField(body_field, float(path.u[0]), body_path, path.body_move[0], float(path.sigma_uT_m[0]), distance)


def _measure_at_footfall(recording: Recording, stances: Stances, track: Trajectory) -> Floats:
    try:
        return np.asarray(average_footfall_field(recording, stances, nav_R_body=track.nav_R_body).body_field[1])
    except MagneticError:
        return np.full(3, np.nan)
