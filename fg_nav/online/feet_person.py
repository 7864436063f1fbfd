"""The person between two feet in progress: one estimate a step, and the path again when a foot's past has changed.

Halfway in time between two footfalls of different feet both stand, so that the person, the middle of both, is at

    p = (p_left + p_right) / 2,    P = (P_left + P_right) / 2 >= cov(p).

The bound holds however the errors are correlated, as the covariance of their difference is none below zero; those of
two feet that were solved together are nearly one, and then it is close.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.feet.person import CHORD_M
from fg_nav.online.estimates import EstimateRow, split_rows
from fg_nav.online.feet_lines import PersonEstimate
from fg_nav.online.revision import Revision, thin_rows

MAX_STEP_S = 2.0  # Between footfalls of different feet; who stands has one of each every two seconds.
REMEMBERED = 8  # Steps before, in which the direction is looked for.


class PersonTracker:
    """The steps of a person so far."""

    def __init__(self) -> None:
        self._t: list[float] = []
        self._recent: list[Floats] = []

    def add(self, left: EstimateRow, right: EstimateRow) -> PersonEstimate | None:
        """Return the step that two newest footfalls of both feet make; None where they make no new one."""
        feet = split_rows([left, right])
        t = float(feet.t.mean())
        if np.ptp(feet.t) > MAX_STEP_S or (self._t and t <= self._t[-1]):
            return None
        position, heading = feet.position.mean(axis=0), self._find_heading(feet.position.mean(axis=0))
        self._t.append(t)
        self._recent = [*self._recent[1 - REMEMBERED :], position]
        return PersonEstimate(len(self._t) - 1, t, position, heading, feet.pose_cov.mean(axis=0))

    def revise(self, left: Floats, right: Floats) -> Revision | None:
        """Return the path of all steps so far, by those of both feet (K, 4), t (s) and place (m), as known now."""
        if not self._t:
            return None
        t = np.array(self._t)
        places = [[np.interp(t, path[:, 0], column) for column in path[:, 1:].T] for path in (left, right)]
        path = np.column_stack([t, np.mean(places, axis=0).T])
        self._recent = list(path[-REMEMBERED:, 1:])
        return Revision(float(t[-1]), 0.0, (), path[thin_rows(len(t))])

    def _find_heading(self, position: Floats) -> float | None:
        """Return in which direction a place is reached, from the newest step that is a chord away."""
        for before in reversed(self._recent):
            east, north, _ = position - before
            if np.hypot(east, north) >= CHORD_M:
                return float(np.arctan2(east, north))
        return None
