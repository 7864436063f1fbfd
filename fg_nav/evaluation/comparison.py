"""Estimated and true positions, point by point, in the truth's frame, and the rigid motion into it.

A true trajectory is interpolated at the solution's stamps (attitude by slerp), not before its first stamp, after its
last, or inside a gap. Footprints are compared in the horizontal plane.

Footprints carry a stride number n and no time; stance k = n + offset. Where as many stances were detected as the walk
has, offset is 0 throughout. Where D more (or fewer) were, the offset goes from 0 to D somewhere: an extra stance shifts
all later numbers up, a missed one shifts them down. The D single shifts are placed one after the other where the rigid
fit is best without losing a footprint needlessly; `notes` report it. A footprint without a stance (missed, or beyond
the last stance) is counted, not scored.

Where an instant within each stance is known, nothing is matched: the footprint is compared with the sensor's position
at that instant. A missed stance then counts as well, and two solutions are compared at the same places.

Position and heading at the start of an inertial walk are a gauge, which is removed first. With estimate p_i and truth
q_i (same instants), the modes minimize sum |R p_i + s - q_i|^2 over

======== ============================================== =====================================
mode     R                                              s
======== ============================================== =====================================
none     identity                                       zero
origin   identity                                       first points coincide (not a fit)
yaw      rotation about up (the gauge of an IMU)        free: the default
se3      any rotation (Kabsch 1976)                     free; forgives tilt errors as well
======== ============================================== =====================================

The yaw solution is closed: with both paths centred, tan(psi) = sum (p x q)_z / sum (p . q)_horizontal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np

from fg_nav.arrays import Bools, Brief, Floats, Ints, interpolate_columns
from fg_nav.errors import EvaluationError
from fg_nav.frames import yaw_rotation
from fg_nav.solution import Solution
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth, check_truth

AlignmentMode: TypeAlias = Literal["yaw", "none", "origin", "se3"]

MODES: tuple[str, ...] = get_args(AlignmentMode)  # Accepted by `align`.
MIN_SHARED = 3  # Samples common to truth and solution: fewer fit anything.
HOLE_S = 0.1  # A gap of the truth longer than this, and than `HOLE_PERIODS` of its periods, is not interpolated.
HOLE_PERIODS = 3.0

MIN_FOOTPRINTS = 3  # Two can nearly always be fitted by a rotation and a shift: only their distance is tested.
MAX_SHIFTS = 10  # Stances too many or too few, or half of the walk's: beyond, the places of the shifts are a guess.
MISSED = -1  # Stance index of a footprint without a stance.


@dataclass(frozen=True)
class Alignment:
    """Rigid motion from the solution's frame to the truth's: q = truth_R_nav p + shift."""

    mode: str
    truth_R_nav: Floats
    shift: Floats

    def apply(self, position: Floats) -> Floats:
        """Positions (N, 3) m of the solution in the truth's frame."""
        return position @ self.truth_R_nav.T + self.shift

    def rotate(self, nav_R_body: Floats) -> Floats:
        """Attitudes (N, 3, 3) of the solution in the truth's frame."""
        return self.truth_R_nav @ nav_R_body


def align(estimate: Floats, truth: Floats, mode: str = "yaw") -> Alignment:
    """Find the rigid motion of `mode` that lays `estimate` (N, 3) m on `truth` (N, 3) m, point by point.

    Raises `EvaluationError` on an unknown mode, on shapes that differ, and where there is no point or one that is not
    finite.
    """
    if estimate.shape != truth.shape or estimate.ndim != 2 or estimate.shape[1] != 3 or len(estimate) == 0:
        raise EvaluationError(
            f"an estimate of shape {estimate.shape} cannot be aligned with a truth of shape {truth.shape}: "
            "both must be (N, 3) with at least one point."
        )
    for name, points in (("estimate", estimate), ("truth", truth)):
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            raise EvaluationError(
                f"the {name} is not finite at point {bad[0]} ({len(bad)} in all): remove such points first."
            )
    if mode == "none":
        return Alignment(mode, np.eye(3), np.zeros(3))
    if mode == "origin":
        return Alignment(mode, np.eye(3), truth[0] - estimate[0])
    if mode == "yaw":
        truth_R_nav = yaw_rotation(float(np.angle(np.sum(np.conj(_center_plane(estimate)) * _center_plane(truth)))))
    elif mode == "se3":
        # Kabsch; of straight paths one of the best rotations
        left, _, right = np.linalg.svd((truth - truth.mean(0)).T @ (estimate - estimate.mean(0)))
        truth_R_nav = np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)
    else:
        raise EvaluationError(f"alignment '{mode}' is unknown: choose one of {', '.join(MODES)}.")
    return Alignment(mode, truth_R_nav, truth.mean(0) - truth_R_nav @ estimate.mean(0))


def fit_scale(estimate: Floats, truth: Floats) -> float:
    """Best scale of the horizontal `estimate` (N, 2 or 3) onto `truth`, after yaw and shift.

    Above 1 the estimate is too short. A closed loop hides a scale error from every other figure. As a least squares
    scale of the estimate it is biased low by the estimate's random errors. NaN where the estimate does not move.
    """
    p, q = _center_plane(estimate), _center_plane(truth)
    spread = np.sum(np.abs(p) ** 2)
    return float(np.abs(np.sum(np.conj(p) * q)) / spread) if spread > 0.0 else float("nan")


def _center_plane(position: Floats) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    """Horizontal positions as complex numbers x + iy about their mean: a rotation is then one factor."""
    plane = position[:, 0] + 1j * position[:, 1]
    return np.asarray(plane - plane.mean(), dtype=np.complex128)


@dataclass(frozen=True)
class Comparison(Brief):
    """Matched points in the truth's frame."""

    alignment: Alignment  # From the solution's frame to the truth's.
    row: Ints  # (M,) samples of the solution; of footprints by number its stances.
    t: Floats  # (M,) s.
    estimate: Floats  # (M, 3) m.
    truth: Floats  # (M, 3) m.
    planar: bool  # The truth has no height.
    yaw_error: Floats | None = None  # (M,) rad, where the truth has attitude.
    notes: tuple[str, ...] = ()

    @property
    def error(self) -> Floats:
        """(M, 3) estimate minus truth, m."""
        return self.estimate - self.truth


def compare(solution: Solution, truth: Truth, mode: str = "yaw") -> Comparison:
    """Lay a solution on a truth with alignment `mode` (`fg_nav.evaluation.comparison`).

    Raises `EvaluationError` where the two share no time, no footprint, or the mode does not fit the truth, and where
    the truth cannot be that of a walk.
    """
    check_truth(truth, solution.t)
    if isinstance(truth, FootprintTruth):
        if mode != "yaw":
            raise EvaluationError(
                f"alignment '{mode}' needs a truth with a known frame, and footprints have none: use 'yaw'."
            )
        return _compare_footprints(solution, truth)
    row, true_position = share_truth(truth, solution.t)
    alignment = align(solution.position[row], true_position, mode)
    estimate, share = alignment.apply(solution.position[row]), len(row) / len(solution.t)
    yaw_error = _measure_yaw_error(solution, truth, alignment)
    notes = () if share > 0.99 else (f"the truth covers {100 * share:.0f} % of the solution's samples",)
    return Comparison(alignment, row, solution.t[row], estimate, true_position, False, yaw_error, notes)


def compare_at_footfalls(solution: Solution, truth: Truth, mode: str) -> Comparison:
    """Lay the footfalls of a solution on a truth; rows of the comparison are footfalls, or footprints with their time.

    Raises `EvaluationError` as `compare`.
    """
    stances = solution.stances
    if isinstance(truth, FootprintTruth):
        return compare(solution, truth, mode)
    path = {name: getattr(stances, name) for name in ("t", "position", "nav_R_body")}
    return compare(replace(solution, velocity=solution.velocity[stances.sample], **path), truth, mode)


def _compare_footprints(solution: Solution, truth: FootprintTruth) -> Comparison:
    """Compare footprints with the positions at their instants where these are known, else with stances by number."""
    if truth.t is None:
        match = match_footprints(solution.stances.position[:, :2], truth)
        known, row, notes = match.found, match.stance[match.found], match.notes
        t, position = solution.stances.t[row], solution.stances.position[row]
    else:
        inside = (truth.t >= solution.t[0]) & (truth.t <= solution.t[-1])
        known, notes = np.flatnonzero(inside), tuple(_note_missed(truth.stride[~inside], "no sample at"))
        if len(known) < MIN_FOOTPRINTS:
            raise EvaluationError(
                f"only {len(known)} of {len(inside)} surveyed footprints are within the time of the solution "
                f"({_format_span(solution.t)}), and {MIN_FOOTPRINTS} are needed: check that their clocks have the "
                "same zero."
            )
        t = truth.t[known]
        row = np.rint(np.interp(t, solution.t, np.arange(len(solution.t)))).astype(np.int64)
        position = interpolate_columns(t, solution.t, solution.position)
    estimate, surveyed = lift_to_space(position), lift_to_space(truth.xy[known])
    alignment = align(estimate, surveyed)
    return Comparison(alignment, row, t, alignment.apply(estimate), surveyed, planar=True, notes=notes)


def share_truth(truth: TrajectoryTruth, t: Floats) -> tuple[Ints, Floats]:
    """Return rows and positions as `interpolate_truth`; raises `EvaluationError` where they are too few to compare."""
    row, position = interpolate_truth(truth, t)
    if len(row) < MIN_SHARED:
        raise EvaluationError(
            f"the truth and the solution share only {len(row)} of {len(t)} samples: that is too little to compare."
        )
    return row, position


def interpolate_truth(truth: TrajectoryTruth, t: Floats) -> tuple[Ints, Floats]:
    """Indices (M,) into `t` (N,) s at which the truth is known, and its positions (M, 3) m there.

    Raises `EvaluationError` where there is no such row.
    """
    seen = np.isfinite(truth.position).all(axis=1)
    stamps, position = truth.t[seen], truth.position[seen]
    row = np.flatnonzero(_is_covered(t, stamps))
    if len(row) == 0:
        raise EvaluationError(
            f"the truth ({_format_span(stamps)}) and the solution ({_format_span(t)}) share no time: "
            "check that their clocks have the same zero."
        )
    return row, interpolate_columns(t[row], stamps, position)


def _is_covered(t: Floats, truth_t: Floats) -> Bools:
    """Mask (N,) of the stamps `t` at a stamp of the truth, or between two that are not the edges of a hole."""
    if len(truth_t) < 2:
        return np.isin(t, truth_t)
    gap = np.diff(truth_t)
    hole = gap > max(HOLE_S, HOLE_PERIODS * float(np.median(gap)))
    left = np.searchsorted(truth_t, t, side="right") - 1
    inside = (t >= truth_t[0]) & (t <= truth_t[-1])
    left = np.clip(left, 0, len(gap) - 1)
    return np.asarray(inside & (~hole[left] | (t == truth_t[left]) | (t == truth_t[left + 1])))


def _measure_yaw_error(solution: Solution, truth: TrajectoryTruth, alignment: Alignment) -> Floats | None:
    """Yaw error (M,) rad, estimate minus truth, where the true attitude is known; None where it nowhere is."""
    if truth.nav_R_body is None:
        return None
    seen = np.isfinite(truth.nav_R_body).all(axis=(1, 2))
    row = np.flatnonzero(_is_covered(solution.t, truth.t[seen]))
    if len(row) == 0 or np.count_nonzero(seen) < 2:
        return None
    from scipy.spatial.transform import Rotation, Slerp  # slow to load, and few walks have a truth

    true_attitude = Slerp(truth.t[seen], Rotation.from_matrix(truth.nav_R_body[seen]))(solution.t[row])
    estimate = alignment.rotate(solution.nav_R_body[row])
    return yaw_between(np.asarray(true_attitude.as_matrix()), estimate)


def yaw_between(nav_R_a: Floats, nav_R_b: Floats) -> Floats:
    """Yaw (...) rad, about up, of the rotation that leads from attitudes a to b (..., 3, 3): nav_R_b nav_R_a^T.

    Unlike the difference of two headings it is defined whichever way the body's axes point.
    """
    turn = nav_R_b @ np.swapaxes(nav_R_a, -1, -2)
    return np.asarray(np.arctan2(turn[..., 1, 0] - turn[..., 0, 1], turn[..., 0, 0] + turn[..., 1, 1]))


def _format_span(t: Floats) -> str:
    return f"{t[0]:.3f} to {t[-1]:.3f} s" if len(t) else "no finite point"


@dataclass(frozen=True)
class FootprintMatch:
    """`stance` (M,) is the stance index of each footprint, or `MISSED`; `notes` say what was assumed."""

    stance: Ints
    notes: tuple[str, ...]

    @property
    def found(self) -> Ints:
        """Rows of the footprints that have a stance."""
        return np.flatnonzero(self.stance != MISSED)


def match_footprints(stance_xy: Floats, truth: FootprintTruth) -> FootprintMatch:
    """Match stances at `stance_xy` (K, 2) m, in any frame, with surveyed footprints by stride number.

    Raises `EvaluationError` where fewer than `MIN_FOOTPRINTS` footprints have a stance.
    """
    surplus = 0 if truth.stride_count is None else len(stance_xy) - 1 - truth.stride_count
    if truth.stride_count is not None and abs(surplus) > max(MAX_SHIFTS, truth.stride_count / 2):
        raise EvaluationError(
            f"the truth counts {truth.stride_count} strides, and {len(stance_xy) - 1} were found, too many apart "
            "to match footprints by number: check that it is of this recording."
        )
    stance, notes = truth.stride.astype(np.int64), []
    for _ in range(abs(surplus)):
        options = list(_shift_tails(stance, int(np.sign(surplus))))
        stance = min(options, key=lambda option: _misfit(option, stance_xy, truth.xy))
    if surplus:
        count, kind = abs(surplus), "more" if surplus > 0 else "fewer"
        notes.append(
            f"{len(stance_xy)} stances are {count} {kind} than the walk has: stride numbers were shifted at {count} "
            f"place{'s' if count > 1 else ''}, where that fits the footprints best"
        )
    stance = np.where(stance < len(stance_xy), stance, MISSED)
    match = FootprintMatch(stance, tuple(notes + _note_missed(truth.stride[stance == MISSED])))
    if len(match.found) < MIN_FOOTPRINTS:
        raise EvaluationError(
            f"only {len(match.found)} of {len(stance)} surveyed footprints have a stance "
            f"({len(stance_xy)} stances were found), and {MIN_FOOTPRINTS} are needed: check the detection."
        )
    return match


def _shift_tails(stance: Ints, step: int) -> Iterator[Ints]:
    """Yield the stance indices (M,) with each tail of them shifted by `step`, +1 or -1; none is used twice.

    Where they would, the missed stance was that of the earlier footprint (another row covers the later one).
    """
    rows = np.arange(len(stance))
    for first in range(len(stance) + 1):
        option = np.where((rows >= first) & (stance != MISSED), stance + step, stance)
        before = np.flatnonzero((rows < first) & (stance != MISSED))
        after = np.flatnonzero((rows >= first) & (stance != MISSED))
        if len(before) and len(after) and option[before[-1]] == option[after[0]]:
            option[before[-1]] = MISSED
        yield option


def _misfit(stance: Ints, stance_xy: Floats, xy: Floats) -> tuple[int, float]:
    """Number of footprints without a stance, then mean square distance, m^2: losing a footprint must not pay."""
    use = (stance != MISSED) & (stance < len(stance_xy))
    lost = int(np.count_nonzero(~use))
    if lost == len(use):
        return lost, float("inf")
    p, q = lift_to_space(stance_xy[stance[use]]), lift_to_space(xy[use])
    return lost, float(np.mean(np.sum((align(p, q).apply(p) - q) ** 2, axis=1)))


def lift_to_space(xy: Floats) -> Floats:
    """Points (M, 2) on the ground as (M, 3) at height zero."""
    return np.column_stack([xy[:, :2], np.zeros(len(xy))])


def _note_missed(missed: Ints, why: str = "no stance for") -> list[str]:
    """Name the footprints that are not scored."""
    if not len(missed):
        return []
    return [f"{why} footprint{'s' if len(missed) > 1 else ''} {', '.join(map(str, missed))}: not scored"]
