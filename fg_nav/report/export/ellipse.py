"""The 95 % ellipses of footfalls as closed outlines, for maps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.report.decimation import spread_rows
from fg_nav.report.ellipses import ELLIPSE_RADIUS
from fg_nav.report.export.track import POSITION, Track

AT_MOST = 200  # More ellipses hide each other on any map.
CORNERS = 33  # Of an outline, the first again as the last: within half a percent of the ellipse.


class Outlines(NamedTuple):
    """Closed outlines (E, CORNERS, 3) m, counter-clockwise, of the footfalls `row` (E,)."""

    row: Ints
    corner: Floats


def outline_ellipses(track: Track) -> Outlines:
    """Outline footfalls that are evenly spread along the path and claim a covariance.

    The outline is p + r L (cos u, sin u), with P = L L^T and r that of 95 %.
    """
    cov = track.cov[:, :2, :2]
    claimed = np.flatnonzero(np.isfinite(cov).all(axis=(1, 2)))
    row = claimed[spread_rows(len(claimed), AT_MOST)] if len(claimed) else claimed
    variance, axes = np.linalg.eigh(cov[row])
    axes[:, :, 1] *= np.sign(np.linalg.det(axes))[:, None]  # right-handed, so that outlines turn left
    around = np.linspace(0.0, 2 * np.pi, CORNERS)
    circle = np.stack([np.cos(around), np.sin(around)], axis=1)
    circle[-1] = circle[0]
    semi = ELLIPSE_RADIUS * np.sqrt(np.maximum(variance, 0.0))
    corner = np.repeat(track.footfalls[POSITION].to_numpy()[row][:, None, :], CORNERS, axis=1)
    corner[:, :, :2] += np.einsum("eij,ej,cj->eci", axes, semi, circle)
    return Outlines(row, corner)
