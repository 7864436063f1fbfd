"""What is known of a walk from elsewhere, and whether it can be of this walk: true paths, position fixes, a receiver's.

Fixes. A person is at the start at the walk's first sample and at each fix at its time. Between two of these, i and j,
he moves no farther than anyone runs, and on the solved path no farther than was walked:

    |fix_i - fix_j| <= 12.5 m/s |t_i - t_j| + 3 (sigma_i + sigma_j)                             before
    |fix_i - fix_j| <= 1.25 walked_ij + 12.5 m/s unseen_ij + 2 m + 3 (sigma_i + sigma_j)        on the path

unseen_ij is the time between them in gaps that are too long to be bridged, in which nothing shows how far he went.

A satellite receiver. Its error lasts, so fixes less than `CORRELATED_S` apart share the information of one. Walls and
the first seconds after a start put some off by many sigmas, so residuals are Cauchy's: at `CAUCHY` sigmas a fix counts
half.

A truth. A person on foot moves no faster over a second, or a stride, and makes no more strides a second than in a
sprint (else another unit, or a wrong row); and moves at all (else degrees of latitude for m, a constant, another
clock). A truth in feet or in km passes; `fg_nav.evaluation.evaluate` compares its size with that of the path.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Brief, Floats, Ints
from fg_nav.errors import EstimationError, EvaluationError
from fg_nav.frames import yaw_rotation

MAX_M_S = 12.5  # Speed of a person on foot over a second: the fastest sprint is 12.4 m/s.
MAX_STRIDE_M = 5.0  # From a footprint to the next of the same foot, in a sprint.
MAX_STRIDES_PER_S = 3.0  # Of one foot, in a sprint.
MIN_EXTENT_M = 0.05  # Over ground; a foot moves by more where one walks on the spot, and 5 km are 0.05 degrees.
USUAL_M_S, USUAL_STRIDE_M = 1.5, 1.3  # Fastest second of a walk and its longest stride,
TIMES_USUAL = 3.0  # and the factor within which those of a given walk are.
SPEED_S = 1.0  # Over which a speed is measured.

SIGMAS = 3.0  # Of each of two fixes: one in 400 true ones is farther off, and hardly ever two at once.
MAX_M = 1e7  # No walk leads farther, and no fix is worse: a quarter of the way round the Earth.
MIN_SIGMA_M = 1e-4  # No survey of a foot is as good.
FIX_REACH_S = 1.5  # Farther than a stride from any footfall there is nothing to tie a fix to.
FIX_SPEED_M_S = 1.4  # Walking pace: for so much a second between a fix and the node it is tied to its sigma grows.
LONGER, LONGER_BY_M = 1.25, 2.0  # Of the path, over that of the first solution: a factor, and m.
NEIGHBORS = 50  # Fixes after each that it is compared with: from those farther off there is more time, or way.

CORRELATED_S = 10.0  # A receiver's filter, and the walls about it, keep an error for so long.
CAUCHY = 2.0  # Residual in sigmas at which a fix counts half.
MIN_FIXES = 3  # Of a receiver, within the walk.
TURNS = 72  # Directions that are tried.


@dataclass(frozen=True)
class TrajectoryTruth(Brief):
    """True path of the sensor. `t` (M,) s, `position` (M, 3) m, `nav_R_body` (M, 3, 3) or None, z up.

    Examples
    --------
    >>> truth = fg_nav.read_truth("truth.tum")
    >>> truth.position.shape == (len(truth.t), 3)
    True
    """

    t: Floats
    position: Floats
    nav_R_body: Floats | None = None


@dataclass(frozen=True)
class FootprintTruth(Brief):
    """Surveyed footprints. `stride` (M,) counts strides (0 = the start), `xy` (M, 2) m, seen from above.

    Azimuth and origin are unknown. `t` (M,) s is an instant within each stance where it is known; without it footprints
    are matched by stride number. `stride_count` is the number of strides of the whole walk where it is known.

    Examples
    --------
    >>> import numpy as np
    >>> truth = fg_nav.FootprintTruth(stride=np.array([0, 6, 12]), xy=np.array([[0.0, 0.0], [3.1, 4.2], [8.0, 9.1]]))
    >>> fg_nav.navigate("walk.csv", "inertial", truth=truth).metrics.points
    3
    """

    stride: Ints
    xy: Floats
    stride_count: int | None = None
    t: Floats | None = None


Truth = TrajectoryTruth | FootprintTruth


@dataclass(frozen=True)
class Fix:
    """A position known at an instant of the walk: at a surveyed point, or by a receiver.

    In the walk's own navigation frame, m, from where the sensor stood in the first stance: subtract a plan's
    coordinates of the start. With an `origin` from there instead, wherever the walk starts.

    Attributes
    ----------
    time_s : s, in the recording's own time.
    position : (3,) m, x east, y north, z up from the start; z does not count where `vertical_sigma_m` is infinite.
    horizontal_sigma_m : of x, and of y.
    vertical_sigma_m : of z; infinite where the height is not known.
    origin : latitude and longitude, deg, and height, m or None, of the zero of all fixes; None for the walk's start.

    Examples
    --------
    >>> fixes = [fg_nav.Fix(time_s=18.0, position=np.array([10.3, 7.7, 0.0]), horizontal_sigma_m=0.1)]
    >>> result = fg_nav.navigate("walk.csv", fixes=fixes)
    >>> bool(result.stances.position_sigma[-1, 0] < 1.0)
    True
    """

    time_s: float
    position: Floats
    horizontal_sigma_m: float
    vertical_sigma_m: float = np.inf
    origin: tuple[float, float, float | None] | None = None


# --- fixes -----------------------------------------------------------------------------------------------------------


def check_fix(fix: Fix) -> None:
    """Raise `EstimationError` if a position is not finite or beyond `MAX_M`, or a sigma not `MIN_SIGMA_M` to `MAX_M`.

    The vertical sigma may be greater, and infinite: the height is not known.
    """
    if not (np.isfinite(fix.position).all() and 0 < fix.horizontal_sigma_m < np.inf and fix.vertical_sigma_m > 0):
        raise EstimationError(
            f"the fix at {fix.time_s:.2f} s needs a finite position and sigmas above zero: correct it or leave it out."
        )
    is_too_good = min(fix.horizontal_sigma_m, fix.vertical_sigma_m) < MIN_SIGMA_M
    if is_too_good or fix.horizontal_sigma_m > MAX_M or np.abs(fix.position).max() > MAX_M:
        raise EstimationError(
            f"the fix at {fix.time_s:.2f} s cannot be: give its place within {MAX_M:g} m of the start, and a sigma "
            f"from {MIN_SIGMA_M:g} to {MAX_M:g} m."
        )


def check_fixes(fixes: Sequence[Fix], t: Floats | None = None) -> None:
    """Refuse fixes that are invalid, contradict each other or, where its stamps `t` (N,) s are given, the walk."""
    for fix in fixes:
        check_fix(fix)
    if len({fix.origin for fix in fixes}) > 1:
        raise EstimationError("the fixes are from different origins: give all from the start, or from one place.")
    if t is not None:
        check_times(fixes, float(t[0]), float(t[-1]))
        fixes = (*list_start(fixes, float(t[0])), *fixes)
    fixes = sorted(fixes, key=lambda fix: fix.time_s)
    time = np.array([fix.time_s for fix in fixes])
    _compare(fixes, MAX_M_S * time, 0.0, lambda i, j: f"in {time[j] - time[i]:.3g} s, faster than anyone runs")


def check_fixes_on_path(fixes: Sequence[Fix], t: Floats, position: Floats, unseen_s: Floats) -> None:
    """Refuse fixes farther apart than the distance walked between them on the path `position` (F, 3) m at `t` (F,) s.

    `unseen_s` (F,) is the time without samples up to each place. Heights may differ by more: there are lifts.
    """
    level = [replace(fix, vertical_sigma_m=np.inf) for fix in (*list_start(fixes, float(t[0])), *fixes)]
    fixes = sorted(level, key=lambda fix: fix.time_s)
    moves = np.linalg.norm(np.diff(position, axis=0), axis=1)
    at, so_far = [fix.time_s for fix in fixes], np.concatenate([[0.0], np.cumsum(moves)])
    walked, unseen = np.interp(at, t, so_far), np.interp(at, t, unseen_s)
    _compare(
        fixes,
        LONGER * walked + MAX_M_S * unseen,
        LONGER_BY_M,
        lambda i, j: f"where {walked[j] - walked[i]:.3g} m were walked",
    )


def list_start(fixes: Sequence[Fix], time_s: float) -> list[Fix]:
    """Return the start of the walk as a fix, if it is the zero of these fixes."""
    return [Fix(time_s, np.zeros(3), MIN_SIGMA_M, MIN_SIGMA_M)] if fixes and fixes[0].origin is None else []


def check_times(fixes: Sequence[Fix], begin_s: float, end_s: float) -> None:
    """Raise `EstimationError` if a fix is farther than `FIX_REACH_S` outside of a walk."""
    outside = [fix.time_s for fix in fixes if not begin_s - FIX_REACH_S <= fix.time_s <= end_s + FIX_REACH_S]
    if outside:
        raise EstimationError(
            f"the fix at {outside[0]:.2f} s is outside the walk, which lasts from {begin_s:.2f} s to {end_s:.2f} s: "
            "give its time as in the recording, or leave it out."
        )


def _compare(fixes: Sequence[Fix], reach: Floats, slack_m: float, explain: Callable[[int, int], str]) -> None:
    """Refuse fixes (K,), sorted by time, farther apart than the rise of `reach` (K,) m, cumulative, plus the slack."""
    place = np.array([fix.position for fix in fixes]).reshape(-1, 3)
    level = SIGMAS * np.array([fix.horizontal_sigma_m for fix in fixes])
    height = SIGMAS * np.array([fix.vertical_sigma_m for fix in fixes])
    for lag in range(1, min(NEIGHBORS, len(fixes) - 1) + 1):
        apart = place[lag:] - place[:-lag]
        most = reach[lag:] - reach[:-lag] + slack_m
        over_ground = np.hypot(*apart.T[:2]) - level[lag:] - level[:-lag]
        upward = np.abs(apart[:, 2]) - height[lag:] - height[:-lag]
        far = np.flatnonzero((over_ground > most) | (upward > most))
        if len(far):
            i, j = int(far[0]), int(far[0]) + lag
            one, other = fixes[i], fixes[j]
            axes = 3 if np.isfinite(other.vertical_sigma_m) else 2
            apart_m = float(np.linalg.norm((other.position - one.position)[:axes]))
            is_start = not one.position.any() and one.horizontal_sigma_m == MIN_SIGMA_M
            raise EstimationError(
                f"the fix at {other.time_s:.2f} s is {apart_m:.4g} m from "
                f"{'the start' if is_start else f'that at {one.time_s:.2f} s'}, "
                f"{explain(i, j)}: give places in m from the start of the walk and honest sigmas, or leave one out."
            )


# --- a satellite receiver --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Gnss(Brief):
    """Fixes in the recording's time, m east and north of an origin at these geodetic degrees; heights are not used."""

    fixes: tuple[Fix, ...]
    latitude_deg: float
    longitude_deg: float


@dataclass(frozen=True)
class FixColumns:
    """Fixes: `time` (K,) s, `place` (K, 2) m, and `sigma` (K,) m by which each counts as an independent one."""

    time: Floats
    place: Floats
    sigma: Floats


def select_fixes(fixes: Sequence[Fix], begin_s: float, end_s: float) -> FixColumns:
    """Return the fixes in a walk, sigmas raised for their correlation; raises `EstimationError` if too few."""
    inside = sorted((fix for fix in fixes if begin_s <= fix.time_s <= end_s), key=lambda fix: fix.time_s)
    if len(inside) < MIN_FIXES:
        raise EstimationError(
            f"{len(inside)} of {len(fixes)} fixes are within the walk, which lasts from {begin_s:.1f} s to {end_s:.1f} "
            f"s, and {MIN_FIXES} are needed: give fixes in the recording's own time, or leave --gnss out."
        )
    time = np.array([fix.time_s for fix in inside])
    place = np.array([fix.position[:2] for fix in inside])
    sharing = np.sqrt(np.clip(CORRELATED_S / np.maximum(np.gradient(time), 1e-3), 1.0, None))
    return FixColumns(time, place, sharing * np.array([fix.horizontal_sigma_m for fix in inside]))


def find_turn(walked: Floats, fixes: FixColumns) -> tuple[float, Floats]:
    """Fit walked positions (K, 2) m to the fixes, robustly; return turn (rad, counter-clockwise) and shift (2,) m."""
    best = (np.inf, 0.0, np.zeros(2))
    for turn in np.linspace(-np.pi, np.pi, TURNS, endpoint=False):
        miss = fixes.place - walked @ yaw_rotation(turn)[:2, :2].T
        # iteratively reweighted mean (Cauchy loss), starting from the median
        shift = np.median(miss, axis=0)
        for _ in range(5):
            off = ((miss - shift) ** 2).sum(axis=1) / fixes.sigma**2
            weight = 1.0 / (fixes.sigma**2 * (1.0 + off / CAUCHY**2))
            shift = weight @ miss / weight.sum()
        cost = float(np.log1p(off / CAUCHY**2).sum())
        if cost < best[0]:
            best = (cost, float(turn), shift)
    return best[1], best[2]


def describe_start(gnss: Gnss, start: Floats, sigma_m: float, close: Bools) -> dict[str, float]:
    """Return latitude, longitude (deg) and sigma (m) of `start` (2,) m, with the fixes not `close` (K,) counted."""
    from pymap3d import enu2geodetic

    east, north = float(start[0]), float(start[1])
    latitude, longitude, _ = enu2geodetic(east, north, 0.0, gnss.latitude_deg, gnss.longitude_deg, 0.0)
    return {
        "latitude_deg": float(latitude),
        "longitude_deg": float(longitude),
        "sigma_m": sigma_m,
        "fixes": len(close),
        "at_less_than_half_weight": int((~close).sum()),
    }


def describe_fixes(start: dict[str, float]) -> str:
    """Return a note on a walk that was laid on fixes."""
    return (
        f"laid on {start['fixes']} fixes of GNSS, {start['at_less_than_half_weight']} of them at less than half "
        f"weight: north is the true one, and the start at {start['latitude_deg']:.6f}, "
        f"{start['longitude_deg']:.6f} within {start['sigma_m']:.1f} m"
    )


# --- a truth ---------------------------------------------------------------------------------------------------------


def check_truth(truth: Truth, t: Floats) -> None:
    """Raise `EvaluationError` for a truth that cannot be that of a walk with samples at `t` (N,) s."""
    if isinstance(truth, FootprintTruth):
        _check_footprints(truth, float(t[-1] - t[0]))
        return
    inside = np.isfinite(truth.position).all(axis=1) & (truth.t >= t[0]) & (truth.t <= t[-1])
    stamps, position = truth.t[inside], truth.position[inside]
    if len(stamps) < 2:
        return  # that they share no time is said where they are compared
    # mean speeds over a second or the next longer step
    last = np.searchsorted(stamps, stamps + SPEED_S)
    first = np.flatnonzero(last < len(stamps))
    first, last = (first, last[first]) if len(first) else (np.array([0]), np.array([len(stamps) - 1]))
    speed = _measure_distances(position[last], position[first]) / np.maximum(stamps[last] - stamps[first], SPEED_S)
    if speed.max() > MAX_M_S:
        at = f"{speed.max():.3g} m/s from {stamps[first[np.argmax(speed)]]:.3f} s on"
        what = _explain_size(speed, MAX_M_S, USUAL_M_S)
        raise EvaluationError(f"the truth moves at {at}, faster than anyone runs: {what}.")
    extent = float(np.linalg.norm(np.ptp(position[:, :2], axis=0)))
    if extent < MIN_EXTENT_M:
        raise EvaluationError(
            f"the truth moves by {extent:.2g} m over ground in the {stamps[-1] - stamps[0]:.3g} s that it shares with "
            "the recording: give places in m, not degrees, and stamps in s of the recording's clock."
        )


def _check_footprints(truth: FootprintTruth, duration_s: float) -> None:
    """Raise `EvaluationError` for footprints that cannot be those of a walk of this duration."""
    strides = max(truth.stride_count or 0, int(truth.stride.max(initial=0)))
    most = MAX_STRIDES_PER_S * (duration_s + 1.0)
    if strides > most:
        raise EvaluationError(
            f"the truth counts {strides} strides, and in {duration_s:.1f} s a foot makes at most {most:.0f}: check "
            "that it is of this recording."
        )
    if len(truth.stride) < 2:
        return  # too few to compare is said where they are compared
    apart = _measure_distances(truth.xy[1:], truth.xy[:-1]) / np.diff(truth.stride)
    if apart.max() > MAX_STRIDE_M:
        stride = truth.stride[np.argmax(apart) + 1]
        raise EvaluationError(
            f"the footprints up to stride {stride} are {apart.max():.3g} m a stride apart, farther than anyone runs: "
            f"{_explain_size(apart, MAX_STRIDE_M, USUAL_STRIDE_M)}."
        )
    extent = float(np.linalg.norm(np.ptp(truth.xy, axis=0)))
    if extent < MIN_EXTENT_M:
        raise EvaluationError(f"the footprints lie within {extent:.2g} m: give their places in m, not degrees.")


def _measure_distances(one: Floats, other: Floats) -> Floats:
    """Distances (M,) m between points; the largest float, or infinity, where they overflow."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(np.linalg.norm(one - other, axis=1), nan=np.inf))


def _explain_size(sizes: Floats, most: float, usual: float) -> str:
    """Advice on speeds or strides beyond their limit: another unit, if many are, else a wrong row."""
    for unit, factor in (("cm", 100.0), ("mm", 1000.0)):
        ratio = float(sizes.max()) / factor / usual
        if np.percentile(sizes, 75) > most and 1.0 / TIMES_USUAL < ratio < TIMES_USUAL:
            return f"it seems to be in {unit}, divide by {factor:.0f}"
    return "correct that row, and give places in m"
