"""Figures of merit of a walk.

==================== =========================================================================================
rmse_2d_m            root mean square horizontal error over all compared points after alignment
rmse_3d_m            the same in space (absent for footprints, which have no height)
end_error_m          error at the last compared point; in space, or horizontal for footprints
max_error_m          largest error, likewise
heading_rmse_deg     root mean square yaw error after alignment, where the truth has attitude
scale                best-fit similarity of the horizontal path: above 1 the estimate is too short
distance_m           sum of the straight moves from stance to stance, in space: less than the foot flew
closure_m            from the first stance to the last; an error only where the walk ended where it began
closure_percent      closure in percent of distance
strides_detected     stances less one
==================== =========================================================================================

Compared points are the solution's samples inside a true trajectory, or the stances matched with footprints.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import Comparison, compare, fit_scale
from fg_nav.recording import FootprintTruth, Truth
from fg_nav.solution import Solution


@dataclass(frozen=True)
class Metrics:
    """See the table above; None where the truth, or the lack of one, does not show it."""

    distance_m: float
    closure_m: float
    strides_detected: int
    closure_percent: float | None = None
    alignment: str | None = None
    points: int | None = None
    rmse_2d_m: float | None = None
    rmse_3d_m: float | None = None
    end_error_m: float | None = None
    max_error_m: float | None = None
    heading_rmse_deg: float | None = None
    scale: float | None = None
    strides_true: int | None = None
    footprints_surveyed: int | None = None
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """Return what is known, ready for JSON."""
        known = {f.name: getattr(self, f.name) for f in fields(self)}
        known["notes"] = list(self.notes)
        return {name: value for name, value in known.items() if value is not None}


def evaluate(
    solution: Solution, truth: Truth | None = None, alignment: str = "yaw", comparison: Comparison | None = None
) -> Metrics:
    """Measure a solution, against a truth where there is one.

    Without a truth only distance, closure and the stride count are known. `alignment` is "yaw", "none", "origin" or
    "se3" (`fg_nav.evaluation.comparison`); a `comparison` of the two that was made already is used in its place.

    Raises `EvaluationError` where solution and truth cannot be compared, or there is no stance.
    """
    path = _measure_path(solution.stances.position)
    if truth is None:
        return path
    measured = _add_errors(path, comparison or compare(solution, truth, alignment))
    if isinstance(truth, FootprintTruth):
        return replace(measured, strides_true=truth.stride_count, footprints_surveyed=len(truth.stride))
    return measured


def _measure_path(stance_position: Floats) -> Metrics:
    if len(stance_position) == 0:
        raise EvaluationError(
            "the solution has no stance, so it has no distance travelled: check the stance detection."
        )
    moves = np.linalg.norm(np.diff(stance_position, axis=0), axis=1)
    distance, closure = float(moves.sum()), float(np.linalg.norm(stance_position[-1] - stance_position[0]))
    percent = 100 * closure / distance if distance > 0.0 else None
    return Metrics(distance_m=distance, closure_m=closure, closure_percent=percent, strides_detected=len(moves))


def _add_errors(path: Metrics, found: Comparison) -> Metrics:
    size = np.linalg.norm(found.error, axis=1)
    scale = fit_scale(found.estimate, found.truth)
    return replace(
        path,
        alignment=found.alignment.mode,
        points=len(found.row),
        rmse_2d_m=_rms(np.linalg.norm(found.error[:, :2], axis=1)),
        rmse_3d_m=None if found.planar else _rms(size),
        end_error_m=float(size[-1]),
        max_error_m=float(size.max()),
        heading_rmse_deg=None if found.yaw_error is None else float(np.degrees(_rms(found.yaw_error))),
        scale=scale if np.isfinite(scale) else None,
        notes=found.notes,
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
