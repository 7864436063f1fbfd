"""A solution as it is shown: in the truth's frame where there is a truth, else in its own.

Ellipses and bands are the estimator's own uncertainty, turned with the path; they are not made smaller by an alignment.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from fg_nav.arrays import Floats
from fg_nav.evaluation.comparison import Comparison
from fg_nav.recording import Truth
from fg_nav.solution import Solution

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

    def stance_position(self) -> Floats:
        """(K, 3) m of the stances."""
        return self.align_position(self.solution.stances.position)

    @property
    def alignment_words(self) -> str:
        """How the solution was aligned with the truth, to follow a title; empty without a truth."""
        return "" if self.comparison is None else f", {_ALIGNMENTS[self.comparison.alignment.mode]}"


def align_solution(walk: Walk, outcome: Outcome) -> AlignedSolution:
    """Return the solution as it is drawn: with its truth where the two could be compared."""
    usable = outcome.comparison is not None
    return AlignedSolution(outcome.solution, walk.truth if usable else None, outcome.comparison)
