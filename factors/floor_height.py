"""All footfalls on one floor of a building are at one height.

Each floor has its height Z (1-vector, m) as a variable, each footfall on it the residual

    e = z - Z,    de/dpose = [0, e_z^T nav_R_body],    de/dZ = -1,

z the height of the sensor (navigation frame, z up). The sensor is not at the same height above the floor in each
stance, by a centimetre or so; that is the noise. A kerb or a mat calls for a robust one. No floor's height is known
before, so a floor that is visited once gets flat, and nothing else; one that is visited again also gets its height
back.

Which footfall is on which floor, `floor_labels` proposes from heights that were smoothed before: footfalls in a row
without a step between them are a level stretch, a stretch joins the floor nearest in height if that is near, and else
makes a new one. Footfalls on stairs belong to none. A ramp looks like drift: where there are ramps, leave this factor
out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from .guarded import Array


@dataclass(frozen=True)
class FloorHeight:
    """Height of a footfall above its floor, with `sigma` m; variables nav_T_body and the floor's height (1,) m."""

    name: ClassVar[str] = "floor height"
    dims: ClassVar[tuple[int, ...]] = (6, 1)
    rows: ClassVar[int] = 1

    sigma: float

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 1) and its Jacobians by pose and floor."""
        nav_T_body, floor = variables
        e = (nav_T_body[..., 2, 3, None] - floor) / self.sigma
        if not with_jacobians:
            return e, []
        by_pose = np.zeros((*e.shape, 6))
        by_pose[..., 0, 3:] = nav_T_body[..., 2, :3] / self.sigma
        return e, [by_pose, np.full((*e.shape, 1), -1.0 / self.sigma)]


STEP_M = 0.1
"""Height between successive footfalls of one foot above which they are on stairs: a riser is 0.15 to 0.19 m, and
a foot climbs one or two at a time; the drift of a stride is centimetres."""

STOREY_M = 1.5
"""Height from a floor above which a level stretch is another: half of the lowest storey, so that heights may drift
by as much between two visits."""

FEWEST = 4
"""Footfalls of a level stretch: a landing has two or three."""


def floor_labels(height: Array, step_m: float = STEP_M) -> NDArray[np.intp]:
    """Propose the floor (K,) of each footfall, 0, 1, ... in the order they are found; -1 where it is on none.

    Parameters
    ----------
    height : (K,) m
        Of the footfalls of one foot, in order.
    step_m : float
        Change of height that is a step.
    """
    label = np.full(len(height), -1, dtype=np.intp)
    levels: list[float] = []
    cuts = np.flatnonzero(np.abs(np.diff(height)) > step_m) + 1
    for stretch in np.split(np.arange(len(height)), cuts):
        if len(stretch) >= FEWEST:
            label[stretch] = _floor_of(float(height[stretch[0]]), levels)
            levels[label[stretch[0]]] = float(height[stretch[-1]])
    return label


def _floor_of(level: float, levels: list[float]) -> int:
    """Index of the floor last seen nearest to the level; a new one, added to the levels, if none is near."""
    apart = np.abs(np.array(levels) - level)
    if len(levels) and apart.min() < STOREY_M:
        return int(apart.argmin())
    levels.append(level)
    return len(levels) - 1
