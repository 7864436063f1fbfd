"""Figures of merit of a walk: by itself, against a truth, and against another solution.

Compared points are the solution's samples inside a true trajectory, or the stances matched with footprints.
Consistency of the claimed sigmas: `fg_nav.lab.consistency`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import Alignment, Comparison, compare, compare_at_footfalls, fit_scale, yaw_between
from fg_nav.solution import Solution, StanceTable
from fg_nav.truth import FootprintTruth, Truth

OTHER_SIZE = 2.0  # Truth over path beyond which one of them is unusable: feet give 3.3, a working filter is within %.


@dataclass(frozen=True)
class Metrics:
    """Errors are after the alignment; None where the truth, or the lack of one, does not show it."""

    distance_m: float  # sum of the straight moves from stance to stance, in space: shorter than the flight of the foot
    closure_m: float  # from the first stance to the last; an error only where the walk ended where it began
    strides_detected: int  # stances less one
    closure_percent: float | None = None  # of the distance
    alignment: str | None = None
    points: int | None = None  # that are compared
    rmse_2d_m: float | None = None  # horizontal
    rmse_3d_m: float | None = None  # None for footprints, which have no height
    end_error_m: float | None = None  # at the last compared point; in space, or horizontal for footprints
    max_error_m: float | None = None  # likewise
    heading_rmse_deg: float | None = None  # of yaw, where the truth has attitude
    scale: float | None = None  # best-fit similarity of the horizontal path: above 1 the estimate is too short
    strides_true: int | None = None
    footprints_surveyed: int | None = None
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """Return all known figures, ready for JSON."""
        known = {f.name: getattr(self, f.name) for f in fields(self)}
        known["notes"] = list(self.notes)
        return {name: value for name, value in known.items() if value is not None}


def evaluate(
    solution: Solution, truth: Truth | None = None, alignment: str = "yaw", comparison: Comparison | None = None
) -> Metrics:
    """Measure a solution, against a truth where there is one.

    Without a truth only distance, closure and the stride count are known. `alignment` is "yaw", "none", "origin" or
    "se3" (`fg_nav.evaluation.comparison`); a ready `comparison` of the two is used in its place.

    Raises `EvaluationError` where solution and truth cannot be compared, or there is no stance.

    Examples
    --------
    >>> solution = fg_nav.navigate("walk.csv", "inertial")
    >>> fg_nav.evaluate(solution, fg_nav.read_truth("truth.tum")).rmse_2d_m < 0.5  # m
    True
    """
    # the path alone
    position = solution.stances.position
    if len(position) == 0:
        raise EvaluationError(
            "the solution has no stance, so it has no distance travelled: check the stance detection."
        )
    moves = np.linalg.norm(np.diff(position, axis=0), axis=1)
    distance, closure = float(moves.sum()), float(np.linalg.norm(position[-1] - position[0]))
    percent = 100 * closure / distance if distance > 0.0 else None
    path = Metrics(distance_m=distance, closure_m=closure, closure_percent=percent, strides_detected=len(moves))
    if truth is None:
        return path

    # errors
    found = comparison or compare(solution, truth, alignment)
    size = np.linalg.norm(found.error, axis=1)
    scale = fit_scale(found.estimate, found.truth)
    notes = found.notes
    if np.isfinite(scale) and not 1 / OTHER_SIZE <= scale <= OTHER_SIZE:
        notes += (f"the truth is {scale:.2g} times as large as the path: check its unit, and that it is of this walk",)
    surveyed = truth if isinstance(truth, FootprintTruth) else None
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
        strides_true=None if surveyed is None else surveyed.stride_count,
        footprints_surveyed=None if surveyed is None else len(surveyed.stride),
        notes=notes,
    )


@dataclass(frozen=True)
class MomentErrors:
    """Horizontal errors of an online method's estimates at each footfall's moment, m, as laid on the truth."""

    rmse_m: float
    end_m: float  # By how much the way from the first to the last is wrong.
    max_m: float


def measure_moment(solution: Solution, moment: StanceTable, truth: Truth, end: Alignment) -> MomentErrors:
    """Errors of an online method's estimates at the moment, laid on the truth as its path at the end is.

    Each is in the map of its moment, which a re-solve turns about its origin: a fit to all of them would mix frames.
    With the alignment `end`, a wrong north of the moment is an error of the moment. Footprints are matched by number,
    as there is no estimate of the moment between footfalls.

    Raises `EvaluationError` as `compare`.
    """
    truth = replace(truth, t=None) if isinstance(truth, FootprintTruth) else truth
    found = compare_at_footfalls(replace(solution, stances=moment), truth, end.mode)
    # the same points, laid on the truth by the alignment at the end
    own = found.alignment
    error = (end.apply((found.estimate - own.shift) @ own.truth_R_nav) - found.truth)[:, :2]
    over_ground, end_m = np.linalg.norm(error, axis=1), float(np.hypot(*(error[-1] - error[0])))
    return MomentErrors(_rms(over_ground), end_m, float(over_ground.max()))


@dataclass(frozen=True)
class Gap:
    """Distance between two solutions of a walk: rms and largest over all samples, m; rms of the heading, deg."""

    rms_m: float
    max_m: float
    heading_deg: float


def measure_gap(one: Solution, other: Solution) -> Gap:
    """Measure how far two solutions of the same samples are apart as they stand; the heading at the stances of one."""
    apart = np.linalg.norm(one.position - other.position, axis=1)
    sample = one.stances.sample
    turned = yaw_between(one.nav_R_body[sample], other.nav_R_body[sample])
    return Gap(_rms(apart), float(apart.max()), float(np.degrees(_rms(turned))))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
