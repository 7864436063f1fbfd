"""Can fixes be those of a walk at all? Judged before the walk is solved, and by the path of its first solution.

A person is at the start at the walk's first sample and at each fix at its time. Between two of these, i and j, he moves
no farther than anyone runs, and on the solved path no farther than was walked:

    |fix_i - fix_j| <= 12.5 m/s |t_i - t_j| + 3 (sigma_i + sigma_j)                             before
    |fix_i - fix_j| <= 1.25 walked_ij + 12.5 m/s unseen_ij + 2 m + 3 (sigma_i + sigma_j)        on the path

unseen_ij is the time between them in gaps that are too long to be bridged, in which nothing shows how far he went.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.evaluation.comparison import MAX_M_S
from fg_nav.truth import Fix

SIGMAS = 3.0  # Of each of two fixes: one in 400 true ones is farther off, and hardly ever two at once.
MAX_M = 1e7  # No walk leads farther, and no fix is worse: a quarter of the way round the Earth.
MIN_SIGMA_M = 1e-4  # No survey of a foot is as good.
FIX_REACH_S = 1.5  # Farther than a stride from any footfall there is nothing to tie a fix to.
LONGER, LONGER_BY_M = 1.25, 2.0  # Of the path, over that of the first solution: a factor, and m.
_NEIGHBORS = 50  # Fixes after each that it is compared with: from those farther off there is more time, or way.


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
    """Refuse fixes that are invalid, contradict each other or, where its stamps `t` (N,) s are given, the walk's span.

    Raises `EstimationError` with the time of the fix.
    """
    for fix in fixes:
        check_fix(fix)
    if t is not None:
        check_times(fixes, float(t[0]), float(t[-1]))
        fixes = (_start(float(t[0])), *fixes)
    fixes = sorted(fixes, key=lambda fix: fix.time_s)
    time = np.array([fix.time_s for fix in fixes])
    _compare(fixes, MAX_M_S * time, 0.0, lambda i, j: f"in {time[j] - time[i]:.3g} s, faster than anyone runs")


def check_fixes_on_path(fixes: Sequence[Fix], t: Floats, position: Floats, unseen_s: Floats) -> None:
    """Refuse fixes farther apart than the distance walked between them on the path `position` (F, 3) m at `t` (F,) s.

    `unseen_s` (F,) is the time without samples up to each place. Heights may differ by more: there are lifts.

    Raises `EstimationError` with the time of the fix.
    """
    level = [replace(fix, vertical_sigma_m=np.inf) for fix in (_start(float(t[0])), *fixes)]
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


def _start(time_s: float) -> Fix:
    return Fix(time_s, np.zeros(3), MIN_SIGMA_M, MIN_SIGMA_M)


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
    for lag in range(1, min(_NEIGHBORS, len(fixes) - 1) + 1):
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
