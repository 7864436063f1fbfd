"""Errors of a walk at the landmarks that it passes, as in Ma et al.

Ma et al. (2018, Figures 15 and 16) passed 14 landmarks three times each, and count the error at each of the 42
crossings. With landmark l passed at t_l in q_l, and R and s the alignment of the footfalls, not one of the landmarks,

    e_l = | R p(t_l) + s - q_l |                                    over the ground
    reduction = 100 (1 - mean e / mean e of the reference)          percent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, interpolate_columns
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import Alignment
from fg_nav.solution import Solution


@dataclass(frozen=True)
class LandmarkErrors:
    """Error (L,) m over the ground at each crossing, in the order of the walk, and the landmark crossed."""

    landmark: tuple[str, ...]
    error_m: Floats


def measure_landmarks(
    solution: Solution, landmark: Sequence[str], time_s: Floats, position: Floats, alignment: Alignment
) -> LandmarkErrors:
    """Measure a solution where it crosses landmarks.

    Parameters
    ----------
    solution : Solution
    landmark : names of the L landmarks, one a crossing.
    time_s : (L,) when they are crossed, on the solution's clock.
    position : (L, 3) m, or (L, 2), where the sensor then truly is.
    alignment : that lays the solution on the truth.

    Raises `EvaluationError` without a crossing, or where one is not within the time of the solution.
    """
    if len(landmark) == 0:
        raise EvaluationError("the walk crosses no landmark: there is no error to count at one.")
    outside = np.flatnonzero((time_s < solution.t[0]) | (time_s > solution.t[-1]))
    if len(outside):
        first = outside[0]
        raise EvaluationError(
            f"landmark {landmark[first]} is crossed at {time_s[first]:.3f} s, and the solution goes from "
            f"{solution.t[0]:.3f} to {solution.t[-1]:.3f} s: check that their clocks have the same zero."
        )
    crossing = interpolate_columns(time_s, solution.t, solution.position)
    error = alignment.apply(crossing)[:, :2] - position[:, :2]
    return LandmarkErrors(tuple(landmark), np.asarray(np.linalg.norm(error, axis=1)))


def error_reduction_percent(error_m: float, reference_m: float) -> float:
    """Positioning error reduction, percent of the reference's error; negative where the error is larger."""
    if not reference_m > 0.0:
        raise EvaluationError(f"a reference with an error of {reference_m} m cannot be improved on: take another.")
    return 100.0 * (1.0 - error_m / reference_m)
