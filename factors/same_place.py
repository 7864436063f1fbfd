"""Two poses that lie at one place or near each other: of a walk that comes back, or of a person's two feet.

Same place. Each of two moments is a point q next to a footfall, c (3,) m from its pose in body axes, by the path.
Place and footfall turn together, so that the path may turn about up without being bent,

    q = p + R c,    e = W (q_later - q_earlier),    de/dlater = W [-R [c]x, R],    de/dearlier = -W [-R [c]x, R],

R the attitude nav_R_body and p the position of a footfall. W (3, 3) is the inverse root of the covariance in navigation
axes: along the direction of walking, across it and up.

Two feet of one person. Over some alternating steps the mean places of both feet are beside each other (`feet.steps`):
points c_R and c_L (3,) m next to a footfall of each, in body axes; n (3,) is the mean direction to the left of the walk
there, in the body axes of the left footfall, and w (m) how far apart the feet are, one number for the walk,

    e = W (q_R - (q_L - w R_L n)),

that of two points at one place (`SamePlace`) where the left one is moved by w to the right; de/dw = W R_L n.

Within reach. While both feet stand they are at most r (m) apart, with soft edges of sigma (m):

    e = max(0, |p_a - p_b| - r) / sigma,    de/da = [0, u^T R_a] / sigma,    u = (p_a - p_b) / |p_a - p_b|,

and zero within.
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
        turned = [self.weight @ pose[..., :3, :3] for pose in variables]
        by_pose = [np.concatenate([-T @ skew(c), T], axis=-1) for T, (_, c, _) in zip(turned, parts, strict=True)]
        return e, [by_pose[0], -by_pose[1]]


def weigh_place(heading: Array, along_m: Array | float, across_m: Array | float, up_m: Array | float) -> Array:
    """Return W (K, 3, 3) 1/m, rows along, across and up, for walking directions (K,) rad, anticlockwise from east."""
    c, s, none, one = np.cos(heading), np.sin(heading), np.zeros_like(heading), np.ones_like(heading)
    axes = np.array([[c, s, none], [-s, c, none], [none, none, one]])
    sigma = np.stack([np.broadcast_to(sigma, heading.shape) for sigma in (along_m, across_m, up_m)], axis=-1)
    return np.asarray(np.moveaxis(axes, 2, 0) / sigma[..., None])


@dataclass(frozen=True)
class BesideEachOther:
    """Mean places of both feet over some steps; variables nav_T_body of a right and of a left footfall, and w (1,) m.

    `right`, `left` (..., 3) m are c_R and c_L, `left_normal` (..., 3) is n, `weight` (..., 3, 3) W, 1/m.
    """

    name: ClassVar[str] = "beside each other"
    dims: ClassVar[tuple[int, ...]] = (6, 6, 1)
    rows: ClassVar[int] = 3

    right: Array
    left: Array
    left_normal: Array
    weight: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 3) and its Jacobians by both poses and the width."""
        *poses, width = variables
        moved = SamePlace(self.right, self.left - width * self.left_normal, self.weight)
        e, by_poses = moved.evaluate(poses, with_jacobians)
        if not with_jacobians:
            return e, []
        return e, [*by_poses, self.weight @ (poses[1][..., :3, :3] @ self.left_normal[..., None])]


@dataclass(frozen=True)
class WithinReach:
    """Two feet that stand at one time; variables their nav_T_body. `reach`, `sigma` (...,) m."""

    name: ClassVar[str] = "within reach"
    dims: ClassVar[tuple[int, ...]] = (6, 6)
    rows: ClassVar[int] = 1

    reach: Array
    sigma: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 1) and its Jacobians by both poses."""
        d = variables[0][..., :3, 3] - variables[1][..., :3, 3]
        apart = np.linalg.norm(d, axis=-1)
        beyond = np.maximum(apart - self.reach, 0.0)
        e = (beyond / self.sigma)[..., None]
        if not with_jacobians:
            return e, []
        u = d / np.maximum(apart, 1e-9)[..., None] * ((beyond > 0.0) / self.sigma)[..., None]
        by_place = [
            (sign * u)[..., None, :] @ pose[..., :3, :3] for sign, pose in zip((1.0, -1.0), variables, strict=True)
        ]
        return e, [np.concatenate([np.zeros_like(one), one], axis=-1) for one in by_place]
