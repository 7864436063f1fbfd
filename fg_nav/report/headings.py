"""The heading of the body's x axis along a walk, rad clockwise from north, as it is drawn; its error at the stances.

Turns are counted from stance to stance: in a swing the axis may point anywhere, even up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.report.aligned import AlignedSolution, has_sure_start
from fg_nav.system.spilled import BLOCK_ROWS, drop_pages
from fg_nav.truth import TrajectoryTruth

TURNS_UNWRAPPED = 5.0  # A heading that turns more often than this is shown wrapped.
_STEEP = float(np.sin(np.deg2rad(60.0)))  # An axis steeper than this has hardly a heading.


@dataclass(frozen=True)
class Headings:
    """The headings of a solution of N samples and K stances.

    ========== ==== =====================================================================================
    at_stances (K,) rad, turns counted
    between    (N,) rad, within half a turn of the line through `at_stances`; NaN where the axis is steep
    truth      (N,) rad, likewise; NaN where it is not known
    error      (K,) rad at the stances, wrapped, since the first known one where `gauge`; NaN where unknown
    sigma      (K,) rad, the estimator's own, without what an alignment takes out
    gauge           whether the heading at the start is sure: given, or zero by definition
    wrapped         whether it turns too often to be shown with its turns
    ========== ==== =====================================================================================
    """

    at_stances: Floats
    between: Floats
    truth: Floats
    error: Floats
    sigma: Floats
    gauge: bool
    wrapped: bool


def trace_headings(view: AlignedSolution) -> Headings:
    """Return the headings of a solution that is aligned with its truth, if there is one."""
    stances, t = view.solution.stances, view.solution.t
    heading, steep = _trace_axis(view)
    at_stances = np.unwrap(compute_heading(view.align_attitude(stances.nav_R_body)))
    middle = np.interp(t, stances.t, at_stances) if len(stances) else heading
    gauge = has_sure_start(stances)
    return Headings(
        at_stances,
        np.where(steep, np.nan, middle + wrap_angle(heading - middle)),
        middle + wrap_angle(_read_truth(view, t) - middle),
        _count_error(at_stances - _read_truth(view, stances.t), gauge),
        view.remaining_heading_sigma(),
        gauge,
        bool(len(stances) and np.ptp(at_stances) > TURNS_UNWRAPPED * 2 * np.pi),
    )


def _trace_axis(view: AlignedSolution) -> tuple[Floats, Bools]:
    """Heading (N,) rad of the axis at every sample, and whether it is steep there."""
    nav_R_body = view.solution.nav_R_body
    heading, steep = np.empty(len(nav_R_body)), np.empty(len(nav_R_body), dtype=np.bool_)
    for start in range(0, len(nav_R_body), BLOCK_ROWS):
        part = np.s_[start : start + BLOCK_ROWS]
        heading[part] = compute_heading(view.align_attitude(nav_R_body[part]))
        steep[part] = np.abs(nav_R_body[part, 2, 0]) > _STEEP
        drop_pages()
    return heading, steep


def _count_error(error: Floats, gauge: bool) -> Floats:
    """Where heading at the start is a gauge, claim and error are both counted from the first stance."""
    error = wrap_angle(error)
    known = np.flatnonzero(np.isfinite(error))
    return wrap_angle(error - error[known[0]]) if gauge and len(known) else error


def _read_truth(view: AlignedSolution, t: Floats) -> Floats:
    """Read the true heading (N,) rad at times `t` (N,) s; NaN where it is unknown."""
    truth = view.truth
    if not isinstance(truth, TrajectoryTruth) or truth.nav_R_body is None:
        return np.full(len(t), np.nan)
    seen = np.isfinite(truth.nav_R_body).all(axis=(1, 2))
    if not seen.any():
        return np.full(len(t), np.nan)
    known = np.unwrap(compute_heading(truth.nav_R_body[seen]))
    return np.interp(t, truth.t[seen], known, left=np.nan, right=np.nan)


def break_line(t: Floats, angle_deg: Floats, wrapped: bool) -> tuple[Floats, Floats]:
    """Where angles are shown wrapped: bring them to [0, 360) and break the line where it jumps."""
    if not wrapped:
        return t, angle_deg
    inside = angle_deg % 360.0
    jump = np.flatnonzero(np.abs(np.diff(inside)) > 180.0) + 1
    return np.insert(t, jump, t[jump]), np.insert(inside, jump, np.nan)
