"""Two moments of a walk at one place: a person came back, and the field along the path was the same again.

Each moment is a point q next to a footfall, c (3,) m from its pose in body axes, as the path has it. Place and
footfall turn together, so that the path may turn about up without being bent,

    q = p + R c,    e = W (q_later - q_earlier),    de/dlater = W [-R [c]x, R],    de/dearlier = -W [-R [c]x, R],

R the attitude nav_R_body and p the position of a footfall. W (3, 3) is the inverse root of the covariance in navigation
axes: along the direction of walking as sharp as the field was aligned, across it as wide as a corridor is walked, and
up as level as one floor is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .residual import Array
from .rotation import skew


@dataclass(frozen=True)
class SamePlace:
    """Points next to two footfalls that are one place; variables nav_T_body of the later and of the earlier one.

    `later`, `earlier` (..., 3) m are the points in the body axes of the footfalls; `weight` (..., 3, 3) W, 1/m.
    """

    name: ClassVar[str] = "same place"
    dims: ClassVar[tuple[int, ...]] = (6, 6)
    rows: ClassVar[int] = 3

    later: Array
    earlier: Array
    weight: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 3) and its Jacobians by the later pose and the earlier one."""
        parts = list(zip(variables, (self.later, self.earlier), (1.0, -1.0), strict=True))
        apart = sum(sign * (pose[..., :3, 3] + (pose[..., :3, :3] @ c[..., None])[..., 0]) for pose, c, sign in parts)
        e = (self.weight @ np.asarray(apart)[..., None])[..., 0]
        if not with_jacobians:
            return e, []
        return e, [sign * self._by_pose(pose, c) for pose, c, sign in parts]

    def _by_pose(self, nav_T_body: Array, c: Array) -> Array:
        turned = self.weight @ nav_T_body[..., :3, :3]
        return np.concatenate([-turned @ skew(c), turned], axis=-1)


def weigh_place(heading: Array, along_m: Array | float, across_m: Array | float, up_m: Array | float) -> Array:
    """W (K, 3, 3) for these directions of walking (K,) rad, counterclockwise from east, and sigmas, (K,) or one, m."""
    c, s, none, one = np.cos(heading), np.sin(heading), np.zeros_like(heading), np.ones_like(heading)
    axes = np.array([[c, s, none], [-s, c, none], [none, none, one]])
    sigma = np.stack([np.broadcast_to(sigma, heading.shape) for sigma in (along_m, across_m, up_m)], axis=-1)
    return np.asarray(np.moveaxis(axes, 2, 0) / sigma[..., None])
