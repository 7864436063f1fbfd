"""A solution as it is shown: in the truth's frame where there is a truth, else in its own.

Bands and ellipses are the estimator's own uncertainty, relative to the first footfall and turned with the path. What an
alignment takes out is taken out of the ellipses too: where the heading at the start is not sure, all of the path may
be turned about it. With p the position relative to the start, J p = (-p_y, p_x, 0) and psi the heading, an error e of
such a turn moves pose (p, psi) by v e, v = (J p, 1), and the rest of its covariance

    Q - s^2 v v^T >= 0    for s^2 <= 1 / (v^T Q^-1 v),

so s^2, the variance of the turn that all footfalls have in common, is the least of these bounds over the footfalls.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.evaluation.comparison import Comparison
from fg_nav.evaluation.metrics import pose_covariance
from fg_nav.solution import Solution, StanceTable
from fg_nav.truth import Truth

if TYPE_CHECKING:
    from fg_nav.walk import Outcome, Walk

_ALIGNMENTS = {
    "yaw": "aligned by yaw and shift",
    "se3": "aligned by rotation and shift",
    "origin": "aligned at the start",
    "none": "not aligned",
}


@dataclass(frozen=True)
class AlignedSolution:
    """A solution as it is drawn; its truth and the comparison that aligns it with the truth: both or neither."""

    solution: Solution
    truth: Truth | None = None
    comparison: Comparison | None = None

    def align_position(self, position: Floats) -> Floats:
        """Positions (N, 3) m in the frame of the picture."""
        return position if self.comparison is None else self.comparison.alignment.apply(position)

    def align_attitude(self, nav_R_body: Floats) -> Floats:
        """Attitudes (N, 3, 3) in the frame of the picture."""
        return nav_R_body if self.comparison is None else self.comparison.alignment.rotate(nav_R_body)

    def position_cov(self) -> Floats:
        """(K, 3, 3) m^2, covariance of the stances' position."""
        cov = self.solution.stances.position_cov
        if self.comparison is None:
            return cov
        turn = self.comparison.alignment.truth_R_nav
        return turn @ cov @ turn.T

    @property
    def is_turned(self) -> bool:
        """Whether the path was turned onto its truth as fits best, so that its heading as a whole is no error."""
        return self.comparison is not None and self.comparison.alignment.mode in ("yaw", "se3")

    def remaining_cov(self) -> Floats:
        """(K, 3, 3) m^2, covariance of the stances' position without the turn that an alignment takes out."""
        moved = self.stance_position()
        lever = np.cross([0.0, 0.0, 1.0], moved - moved[:1])
        return np.asarray(self.position_cov() - self.turn_variance * lever[:, :, None] * lever[:, None, :])

    def remaining_heading_sigma(self) -> Floats:
        """(K,) rad, likewise."""
        return np.sqrt(np.maximum(self.solution.stances.heading_sigma**2 - self.turn_variance, 0.0))

    @cached_property
    def turn_variance(self) -> float:
        """Variance (rad^2) of the turn of the whole path that the alignment takes out; 0 where there is none."""
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

    def stance_position(self) -> Floats:
        """(K, 3) m of the stances."""
        return self.align_position(self.solution.stances.position)

    @property
    def alignment_words(self) -> str:
        """How the solution was aligned with the truth, to follow a title; empty without a truth."""
        return "" if self.comparison is None else f", {_ALIGNMENTS[self.comparison.alignment.mode]}"


GAUGE_RAD = 0.02
"""A heading surer than this at the start was given, or zero by definition; a compass does not know it as well."""


def has_sure_start(table: StanceTable) -> bool:
    """Whether the heading at the start counts as sure."""
    return len(table) == 0 or bool(table.heading_sigma[0] < GAUGE_RAD)


def align_solution(walk: Walk, outcome: Outcome) -> AlignedSolution:
    """Return the solution as it is drawn: with its truth where the two could be compared."""
    usable = outcome.comparison is not None
    return AlignedSolution(outcome.solution, walk.truth if usable else None, outcome.comparison)
