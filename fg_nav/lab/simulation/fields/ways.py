"""Where people walk, as far as those who furnish a building need to know.

Things stand beside a way, not on it. The sensor may be anywhere over the way from the foot to the pocket, so the room
to keep is the distance from that upright strip.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import SimulationError

SPACING_M = 0.2
"""Points of a way lie no further apart than this."""

SPOTS_M = 1.0
"""Things are counted by the metre of way."""

SENSOR_HEIGHTS_M = (0.1, 0.4, 0.7, 1.0)
"""From a foot's sensor to above a pocket's."""

LEVEL_M = 0.1
"""A way that rises less than this in all lies on one floor."""


@dataclass(frozen=True)
class Ways:
    """Points on the floor along which somebody walks.

    Attributes
    ----------
    points : (M, 3) m in nav, closely spaced.
    """

    points: Floats

    @property
    def is_level(self) -> bool:
        """Whether all of it lies on one floor."""
        return bool(np.ptp(self.points[:, 2]) < LEVEL_M)

    @property
    def floor_m(self) -> float:
        """Height of the floor in nav where the way is level."""
        return float(np.median(self.points[:, 2]))

    @property
    def spots(self) -> Floats:
        """Points (K, 3) m of the way, about `SPOTS_M` apart: what is walked again counts once."""
        spots: Floats = self.points[self._spot]
        return spots

    @property
    def spot_directions(self) -> Floats:
        """Direction (K, 3) of the way at its spots, with its slope; zero where it has none."""
        last = len(self.points) - 1
        chord = self.points[np.minimum(self._spot + 1, last)] - self.points[np.maximum(self._spot - 1, 0)]
        length = np.linalg.norm(chord, axis=1, keepdims=True)
        direction: Floats = np.divide(chord, length, out=np.zeros_like(chord), where=length > 0)
        return direction

    def room(self, position: Floats) -> Floats:
        """Distance (K,) m of `position` (K, 3) m from where the sensor may be."""
        distance, _ = self._tree.query(position)
        return np.asarray(distance, dtype=np.float64)

    @cached_property
    def _spot(self) -> Ints:
        tree = KDTree(self.points)
        free = np.ones(len(self.points), dtype=np.bool_)
        kept = []
        for i, point in enumerate(self.points):
            if free[i]:
                kept.append(i)
                free[tree.query_ball_point(point, SPOTS_M - SPACING_M / 2)] = False
        return np.array(kept)

    @cached_property
    def _tree(self) -> KDTree:
        lifts = np.array([[0.0, 0.0, height] for height in SENSOR_HEIGHTS_M])
        return KDTree((self.points[:, None] + lifts).reshape(-1, 3))


def closely_spaced(points: Floats) -> Ways:
    """Ways through corners `points` (M, 3) m, on the floor, joined by straight lines.

    Raises
    ------
    SimulationError
        Without a point, or with one that is not finite.
    """
    corners = np.asarray(points, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 3 or not len(corners) or not np.isfinite(corners).all():
        raise SimulationError(f"ways of shape {corners.shape} are no path: give finite points (M, 3) in metres.")
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    asked = np.linspace(0.0, along[-1], int(along[-1] / SPACING_M) + 2)
    return Ways(np.stack([np.interp(asked, along, corners[:, i]) for i in range(3)], axis=1))
