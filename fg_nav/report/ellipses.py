"""The 95 % ellipses of a path, seen from above: which footfalls have one, their axes, and how large they are drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.report.aligned import AlignedSolution
from fg_nav.report.decimation import spread_rows

ELLIPSE_RADIUS = float(np.sqrt(-2.0 * np.log(1.0 - 0.95)))
"""Semi-axes of the 95 % ellipse of a two-dimensional normal distribution, in standard deviations."""

REACH = 0.3  # Share of a map's extent that an ellipse may add to it: a huge one would hide the path.


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
    """Ellipses of footfalls evenly spread along the path, fewer where they are huge; None where none is claimed."""
    centre, cov = view.stance_position()[:, :2], view.remaining_cov()[:, :2, :2]
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
    return Ellipses(centre[row], semi, angle, _find_zoom(largest_m, extent_m))


def _find_zoom(semi_m: float, extent_m: float) -> int:
    wanted = 0.02 * extent_m / max(semi_m, 1e-9)
    steps = np.array([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000])
    return int(steps[np.searchsorted(steps, min(wanted, 1000.0))]) if wanted > 2.0 else 1
