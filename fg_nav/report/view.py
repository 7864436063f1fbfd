"""A solution as it is drawn.

Pictures are in the truth's frame where there is a truth (the alignment says how the solution was laid on
it), else in the solution's own. Bands and ellipses are the estimator's own claim.
"""

from __future__ import annotations

from dataclasses import dataclass

from fg_nav.arrays import Floats
from fg_nav.evaluation.comparison import Comparison
from fg_nav.recording import Truth
from fg_nav.solution import Solution

_ALIGNMENTS = {
    "yaw": "aligned by yaw and shift",
    "se3": "aligned by rotation and shift",
    "origin": "aligned at the start",
    "none": "not aligned",
}


@dataclass(frozen=True)
class View:
    """A solution as it is drawn; its truth and the comparison that lays it on the truth: both or neither."""

    solution: Solution
    truth: Truth | None = None
    comparison: Comparison | None = None

    def placed(self, position: Floats) -> Floats:
        """Positions (N, 3) m in the frame of the picture."""
        return position if self.comparison is None else self.comparison.alignment.apply(position)

    def turned(self, nav_R_body: Floats) -> Floats:
        """Attitudes (N, 3, 3) in the frame of the picture."""
        return nav_R_body if self.comparison is None else self.comparison.alignment.rotate(nav_R_body)

    def horizontal_cov(self) -> Floats:
        """(K, 2, 2) m^2, covariance of the stances' horizontal position."""
        cov = self.solution.stances.position_cov
        if self.comparison is not None:
            turn = self.comparison.alignment.truth_R_nav
            cov = turn @ cov @ turn.T
        return cov[:, :2, :2]

    @property
    def alignment_words(self) -> str:
        """How the solution was laid on the truth, to follow a title; empty without a truth."""
        return "" if self.comparison is None else f", {_ALIGNMENTS[self.comparison.alignment.mode]}"
