"""Errors of a walk as the papers name them, at the footfalls and at landmarks.

With p_k the estimated and q_k the true position of the sensor at footfall k, from the first, 0, to the last, K:

====================== ======= ======================================================================================
end_m                  m       final position error, over the ground: |R (p_K - p_0) - (q_K - q_0)|, the start laid on
                               the start. Where the walk ends where it began this is the closure (Ma 2018, Figure 10;
                               Zhang 2017, Table I)
end_height_m           m       the same upward
end_percent            %       of the total distance travelled, TTD (Zhang 2017, Table I)
heading_deg            deg     final heading error: that of the heading's change from first to last footfall, clockwise
                               (Ma 2018, section 5.2: "difference between the initial and final heading")
heading_laid_deg       deg     heading error at the last footfall, clockwise, as laid on the truth
heading_rmse_deg       deg     root mean square of the heading error, as laid, over all footfalls
mean_m, max_m, rmse_m  m       over the ground, of all footfalls (Ma 2018, Figure 12: "maximum trajectory error")
length_percent         %       excess length of the path from footfall to footfall: error of the strides, independent of
                               the heading
scale_percent          %       excess size of the path: the best similarity over the ground. On an open path this is the
                               error of scale; a closed loop hides it from the end error
====================== ======= ======================================================================================

R is the alignment (`fg_nav.evaluation.comparison`), and two are of use. Ma and Zhang do not specify theirs.

====== ==============================================================================================================
origin as started. The filter was given its position and heading at the start, as in use, and keeps its errors. Only
       fair where all filters were given the same heading: a compass finds its own later on, a gyroscope cannot
yaw    best yaw and shift over all footfalls: the shape of the walk, independent of its heading at the start. It favours
       methods without a compass, as the heading at the start is then fitted to the truth
====== ==============================================================================================================

The end error has the start on the start in both, turned by R; on a closed walk it does not depend on R. Headings as
laid are those of the attitude turned by R: laid as started, they include the error at the start. Of surveyed footprints
only those that were found count; the distance is then the estimate's. Without a truth a walk has a closure, which is an
error if it ended where it began.

Ma et al. (2018, Figures 15 and 16) passed 14 landmarks three times each, and count the error at each of the 42
crossings. With landmark l passed at t_l in q_l, and R and s the alignment of the footfalls, not one of the landmarks,

    e_l = | R p(t_l) + s - q_l |                                    over the ground
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fg_nav.arrays import Floats, interpolate_columns
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import Alignment, Comparison, compare_at_footfalls, fit_scale
from fg_nav.frames import wrap_angle
from fg_nav.solution import Solution
from fg_nav.truth import Truth

if TYPE_CHECKING:
    from fg_nav.lab.simulation import Passing

AS_STARTED, BEST_YAW = "origin", "yaw"  # The two alignments of use.
CLOSURE = "closure"  # In place of an alignment: there was no truth.


@dataclass(frozen=True)
class WalkErrors:
    """See the table above; None where the truth, or the lack of one, does not show it."""

    alignment: str
    distance_m: float
    end_m: float
    end_height_m: float | None = None
    heading_deg: float | None = None
    mean_m: float | None = None
    max_m: float | None = None
    rmse_m: float | None = None
    heading_laid_deg: float | None = None
    heading_rmse_deg: float | None = None
    length_percent: float | None = None
    scale_percent: float | None = None

    @property
    def end_percent(self) -> float:
        """End error in percent of the distance; NaN for a walk that went nowhere."""
        return 100.0 * self.end_m / self.distance_m if self.distance_m > 0.0 else float("nan")


def measure_walk(solution: Solution, truth: Truth | None = None, mode: str = AS_STARTED) -> WalkErrors:
    """Measure a walk at its footfalls, in the alignment `mode`; without a truth only distance and closure are known.

    Raises `EvaluationError` where solution and truth cannot be compared, or there is no footfall.
    """
    position = solution.stances.position
    if truth is not None:
        return measure_errors(compare_at_footfalls(solution, truth, mode), path_length_m(position))
    if len(position) == 0:
        raise EvaluationError("the solution has no stance, so it has no end: check the stance detection.")
    east, north, up = position[-1] - position[0]
    return WalkErrors(CLOSURE, path_length_m(position), float(np.hypot(east, north)), float(up))


def measure_errors(found: Comparison, walked_m: float) -> WalkErrors:
    """Errors of footfalls that were laid on the truth; `walked_m` is the distance where the truth does not show it."""
    over_ground, yaw_error = np.linalg.norm(found.error[:, :2], axis=1), found.yaw_error
    end = found.error[-1] - found.error[0]
    scale = fit_scale(found.estimate, found.truth)
    true_length = path_length_m(found.truth)
    length = path_length_m(found.estimate)
    excess = None if found.planar or not true_length > 0.0 else 100.0 * (length / true_length - 1.0)
    return WalkErrors(
        alignment=found.alignment.mode,
        distance_m=walked_m if found.planar else true_length,
        end_m=float(np.hypot(end[0], end[1])),
        end_height_m=None if found.planar else float(end[2]),
        heading_deg=None if yaw_error is None else float(np.rad2deg(wrap_angle(yaw_error[0] - yaw_error[-1]))),
        mean_m=float(over_ground.mean()),
        max_m=float(over_ground.max()),
        rmse_m=float(np.sqrt(np.mean(over_ground**2))),
        heading_laid_deg=None if yaw_error is None else -float(np.rad2deg(yaw_error[-1])),
        heading_rmse_deg=None if yaw_error is None else float(np.rad2deg(np.sqrt(np.mean(yaw_error**2)))),
        length_percent=excess,
        scale_percent=100.0 * (1.0 / scale - 1.0) if scale > 0.0 else None,
    )


def path_length_m(position: Floats) -> float:
    """Sum of the straight moves, in space, between places (K, 3) m."""
    return float(np.linalg.norm(np.diff(position, axis=0), axis=1).sum())


def measure_landmarks(solution: Solution, crossings: Sequence[Passing], alignment: Alignment) -> Floats:
    """Error (L,) m over the ground at each crossing of a landmark; the alignment lays the solution on the truth.

    Times are on the solution's clock. Raises `EvaluationError` without a crossing, or where one is not within the time
    of the solution.
    """
    if not crossings:
        raise EvaluationError("the walk crosses no landmark: there is no error to count at one.")
    time_s, position = (np.array([getattr(one, what) for one in crossings]) for what in ("time_s", "position"))
    outside = np.flatnonzero((time_s < solution.t[0]) | (time_s > solution.t[-1]))
    if len(outside):
        first = outside[0]
        raise EvaluationError(
            f"landmark {crossings[first].landmark} is crossed at {time_s[first]:.3f} s, and the solution goes from "
            f"{solution.t[0]:.3f} to {solution.t[-1]:.3f} s: check that their clocks have the same zero."
        )
    crossing = interpolate_columns(time_s, solution.t, solution.position)
    error = alignment.apply(crossing)[:, :2] - position[:, :2]
    return np.asarray(np.linalg.norm(error, axis=1))
