"""The two feet of one person: beside each other while they walk, and never further apart than a leg reaches.

Beside each other. Over some steps that alternate the mean places of both feet are beside each other (`feet.steps`). Of
the right foot that mean is a point c_R (3,) m next to one of its footfalls, of the left one c_L, both in body axes;
n (3,) is the mean direction to the left of the walk there, in the body axes of the left footfall, and w (m) how far
apart the feet are, one number for the walk. With q = p + R c, R the attitude nav_R_body, p the position of a footfall,

    e = W (q_R - (q_L - w R_L n)),

that of two points at one place (`same_place`) where the left one is moved by w to the right; de/dw = W R_L n.

Within reach. While both feet stand they are at most r (m) apart, with soft edges of sigma (m):

    e = max(0, |p_a - p_b| - r) / sigma,    de/da = [0, u^T R_a] / sigma,    u = (p_a - p_b) / |p_a - p_b|,

and zero within.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .residual import Array
from .same_place import SamePlace


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
        return e, [_by_pose(sign * u, pose) for sign, pose in zip((1.0, -1.0), variables, strict=True)]


def _by_pose(u: Array, nav_T_body: Array) -> Array:
    by_place = u[..., None, :] @ nav_T_body[..., :3, :3]
    return np.concatenate([np.zeros_like(by_place), by_place], axis=-1)
