"""Quantities that pictures and page draw of a solution, in the truth's frame where there is a truth, else in its own.

Bands and ellipses are the estimator's own uncertainty, relative to the first footfall and turned with the path. The
turn that an alignment removes is removed from the ellipses too: where the heading at the start is not sure, the whole
path may be turned about it. With p the position relative to the start, J p = (-p_y, p_x, 0) and psi the heading, an
error e of such a turn moves pose (p, psi) by v e, v = (J p, 1), and the rest of its covariance

    Q - s^2 v v^T >= 0    for s^2 <= 1 / (v^T Q^-1 v),

so s^2, the variance of the turn that all footfalls have in common, is the least of these bounds over the footfalls.

Headings are of the body's x axis, rad clockwise from north. Turns are counted from stance to stance: in a swing the
axis may point anywhere, even up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.evaluation.comparison import Comparison
from fg_nav.evaluation.metrics import pose_covariance
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.solution import Solution, StanceTable
from fg_nav.stances import Stances
from fg_nav.truth import TrajectoryTruth, Truth

if TYPE_CHECKING:
    from fg_nav.walk import Outcome, Walk

ELLIPSE_RADIUS = float(np.sqrt(-2.0 * np.log(1.0 - 0.95)))  # 95 % ellipse of a 2-D normal distribution, sigmas.
REACH = 0.3  # Largest share of a map's extent that an ellipse adds to it: a huge one would hide the path.
ZOOMS = np.array([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000])  # By which small ellipses are enlarged.
GAUGE_RAD = 0.02  # A heading surer than this at the start was given, or is zero by definition; no compass is as good.
TURNS_UNWRAPPED = 5.0  # A heading that turns more often than this is shown wrapped.
STEEP = float(np.sin(np.deg2rad(60.0)))  # The heading of an axis steeper than this is ill-defined.
EXCERPT_S = 10.0  # Length of the close-up of the stance detection: about ten strides.

_ALIGNMENTS = {
    "yaw": "aligned by yaw and shift",
    "se3": "aligned by rotation and shift",
    "origin": "aligned at the start",
    "none": "not aligned",
}


@dataclass(frozen=True)
class AlignedSolution:
    """A solution in the frame of the picture; its truth and the comparison that aligns the two: both or neither."""

    solution: Solution
    truth: Truth | None = None
    comparison: Comparison | None = None

    def align_position(self, position: Floats) -> Floats:
        """Positions (N, 3) m in the frame of the picture."""
        return position if self.comparison is None else self.comparison.alignment.apply(position)

    def align_attitude(self, nav_R_body: Floats) -> Floats:
        """Attitudes (N, 3, 3) in the frame of the picture."""
        return nav_R_body if self.comparison is None else self.comparison.alignment.rotate(nav_R_body)

    def stance_position(self) -> Floats:
        """(K, 3) m of the stances."""
        return self.align_position(self.solution.stances.position)

    def position_cov(self) -> Floats:
        """(K, 3, 3) m^2, covariance of the stances' position."""
        cov = self.solution.stances.position_cov
        if self.comparison is None:
            return cov
        turn = self.comparison.alignment.truth_R_nav
        return turn @ cov @ turn.T

    @property
    def is_turned(self) -> bool:
        """Whether the path was turned onto its truth by a fit, so that its heading as a whole is no error."""
        return self.comparison is not None and self.comparison.alignment.mode in ("yaw", "se3")

    @cached_property
    def turn_variance(self) -> float:
        """Variance (rad^2) of the turn that the alignment removes: the most that all covariances allow; 0 for none."""
        table = self.solution.stances
        if not self.is_turned or has_sure_start(table):
            return 0.0
        moved = table.position - table.position[:1]
        v = np.column_stack([-moved[:, 1], moved[:, 0], np.zeros(len(table)), np.ones(len(table))])
        covariance, _ = pose_covariance(table, np.arange(len(table)))
        known = np.isfinite(covariance).all(axis=(1, 2))
        if not known.any():
            return 0.0
        inverse = np.linalg.pinv(covariance[known], hermitian=True)
        bound = 1.0 / np.maximum(np.einsum("ki,kij,kj->k", v[known], inverse, v[known]), 1e-12)
        return float(np.min(bound))

    @property
    def alignment_words(self) -> str:
        """The alignment with the truth, to follow a title; empty without a truth."""
        return "" if self.comparison is None else f", {_ALIGNMENTS[self.comparison.alignment.mode]}"


def has_sure_start(table: StanceTable) -> bool:
    """Whether the heading at the start counts as sure."""
    return len(table) == 0 or bool(table.heading_sigma[0] < GAUGE_RAD)


def align_solution(walk: Walk | None, outcome: Outcome) -> AlignedSolution:
    """Return the solution with its truth, where the two were compared."""
    usable = outcome.comparison is not None and walk is not None
    return AlignedSolution(outcome.solution, walk.truth if usable and walk is not None else None, outcome.comparison)


# --- thinning --------------------------------------------------------------------------------------------------------


def spread_rows(n: int, at_most: int) -> Ints:
    """At most `at_most` of `n` rows, evenly spread, the first and the last among them."""
    rows = np.arange(0, n, max(-(-(n - 1) // max(at_most - 1, 1)), 1))
    return rows if rows[-1] == n - 1 else np.append(rows, n - 1)


def envelope(t: Floats, value: Floats, bins: int = 2000) -> tuple[Floats, Floats]:
    """Smallest and largest value of each of `bins` slices, in turn: as a line it looks like the whole signal.

    `t`, `value` (N,); returns at most (2 bins,) of each. NaN is left out; a slice without a number stays NaN.
    """
    if len(t) <= 2 * bins:
        return t, value
    edge = np.linspace(0, len(t), bins, endpoint=False).astype(np.int64)
    low, high = np.fmin.reduceat(value, edge), np.fmax.reduceat(value, edge)
    middle = t[(edge + np.append(edge[1:], len(t))) // 2]
    return np.repeat(middle, 2), np.stack([low, high], axis=1).ravel()


# --- 95 % ellipses from above ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ellipses:
    """E ellipses: `centre` (E, 2) m, `semi` (E, 2) m minor and major, `angle` (E,) rad of the major axis from east.

    `zoom` is a factor that makes the largest visible on a map of the path, 1 where it is anyway.
    """

    centre: Floats
    semi: Floats
    angle: Floats
    zoom: int

    def outline(self, points: int, factor: float = 1.0) -> Floats:
        """Closed outlines (E, points, 2) m."""
        around = np.linspace(0.0, 2 * np.pi, points)
        along, across = np.cos(around) * self.semi[:, 1:], np.sin(around) * self.semi[:, :1]
        cos, sin = np.cos(self.angle)[:, None], np.sin(self.angle)[:, None]
        turned = np.stack([cos * along - sin * across, sin * along + cos * across], axis=-1)
        return self.centre[:, None, :] + factor * turned


def find_extent(points: Floats) -> float:
    """Larger side (m) of the box around points (N, 2 or 3), seen from above."""
    return float(np.max(np.ptp(points[:, :2], axis=0)))


def find_ellipses(view: AlignedSolution, at_most: int) -> Ellipses | None:
    """Ellipses of footfalls evenly spread along the path, fewer where they are huge; None without a covariance."""
    position = view.stance_position()
    # covariance without the turn that an alignment removes
    lever = np.cross([0.0, 0.0, 1.0], position - position[:1])
    remaining = np.asarray(view.position_cov() - view.turn_variance * lever[:, :, None] * lever[:, None, :])
    centre, cov = position[:, :2], remaining[:, :2, :2]
    claimed = np.flatnonzero(np.isfinite(cov).all(axis=(1, 2)))
    if not len(claimed):
        return None
    extent_m = find_extent(centre)
    largest_m = ELLIPSE_RADIUS * float(np.sqrt(np.max(np.linalg.eigvalsh(cov[claimed]))))
    fitting = int(np.clip(4 * extent_m / max(largest_m, 1e-9), 6, at_most))
    row = claimed[spread_rows(len(claimed), fitting)]
    variance, direction = np.linalg.eigh(cov[row])
    semi = ELLIPSE_RADIUS * np.sqrt(np.maximum(variance, 0.0))
    angle = np.arctan2(direction[:, 1, 1], direction[:, 0, 1])
    # zoom the largest to a fiftieth of the extent at least
    wanted = 0.02 * extent_m / max(largest_m, 1e-9)
    zoom = int(ZOOMS[np.searchsorted(ZOOMS, min(wanted, 1000.0))]) if wanted > 2.0 else 1
    return Ellipses(centre[row], semi, angle, zoom)


# --- headings --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Headings:
    """The headings of a solution of N samples and K stances.

    ========== ==== =====================================================================================
    at_stances (K,) rad, turns counted
    between    (N,) rad, within half a turn of the line through `at_stances`; NaN where the axis is steep
    truth      (N,) rad, likewise; NaN where unknown
    error      (K,) rad at the stances, wrapped, since the first known one where `gauge`; NaN where unknown
    sigma      (K,) rad, the estimator's own, without the turn that an alignment removes
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
    stances, t, nav_R_body = view.solution.stances, view.solution.t, view.solution.nav_R_body
    # heading and steepness of the body's x axis at every sample
    heading, steep = compute_heading(view.align_attitude(nav_R_body)), np.abs(nav_R_body[:, 2, 0]) > STEEP
    at_stances = np.unwrap(compute_heading(view.align_attitude(stances.nav_R_body)))
    middle = np.interp(t, stances.t, at_stances) if len(stances) else heading
    # where the heading at the start is a gauge, claim and error both count from the first stance
    gauge, error = has_sure_start(stances), wrap_angle(at_stances - _read_truth(view, stances.t))
    known = np.flatnonzero(np.isfinite(error))
    if gauge and len(known):
        error = wrap_angle(error - error[known[0]])
    return Headings(
        at_stances,
        np.where(steep, np.nan, middle + wrap_angle(heading - middle)),
        middle + wrap_angle(_read_truth(view, t) - middle),
        error,
        np.sqrt(np.maximum(stances.heading_sigma**2 - view.turn_variance, 0.0)),
        gauge,
        bool(len(stances) and np.ptp(at_stances) > TURNS_UNWRAPPED * 2 * np.pi),
    )


def _read_truth(view: AlignedSolution, t: Floats) -> Floats:
    """Interpolate the true heading (N,) rad at times `t` (N,) s; NaN where unknown."""
    truth = view.truth
    if not isinstance(truth, TrajectoryTruth) or truth.nav_R_body is None:
        return np.full(len(t), np.nan)
    known = np.isfinite(truth.nav_R_body).all(axis=(1, 2))
    if not known.any():
        return np.full(len(t), np.nan)
    heading = np.unwrap(compute_heading(truth.nav_R_body[known]))
    return np.interp(t, truth.t[known], heading, left=np.nan, right=np.nan)


def break_line(t: Floats, angle_deg: Floats, wrapped: bool) -> tuple[Floats, Floats]:
    """Wrap angles to [0, 360) where they are shown wrapped, with NaN where the line jumps."""
    if not wrapped:
        return t, angle_deg
    inside = angle_deg % 360.0
    jump = np.flatnonzero(np.abs(np.diff(inside)) > 180.0) + 1
    return np.insert(t, jump, t[jump]), np.insert(inside, jump, np.nan)


# --- close-up of the stance detection --------------------------------------------------------------------------------


def choose_excerpt(t: Floats, stances: Stances) -> slice:
    """Samples of the close-up: around the middle stance, where the walk is in full swing."""
    k = len(stances) // 2
    centre = t[stances.start[k]] if len(stances) else t[len(t) // 2]
    begin = min(max(centre - EXCERPT_S / 2, t[0]), max(t[-1] - EXCERPT_S, t[0]))
    return slice(int(np.searchsorted(t, begin)), int(np.searchsorted(t, begin + EXCERPT_S, side="right")))


def find_log_limits(statistic: Floats) -> tuple[float, float]:
    """Range of a logarithmic axis that shows the statistic and its threshold, 1."""
    positive = statistic[np.isfinite(statistic) & (statistic > 0)]
    if not len(positive):
        return 0.1, 10.0
    low, high = np.percentile(positive, [0.5, 100.0])
    return min(float(low) / 2, 0.5), max(float(high) * 2, 2.0)
