"""The velocity ties of a footfall as factors of a graph, for a solver that linearises them one by one.

The same residual as that of `strides.VelocityTies`, in the body's axes, D = diag(1/sigma) on nav's:

    r = R^T D (V - R u - settling + sinks_per_m S up),
    dr/dpose = [R^T D R [u]x + [r]x, 0],    dr/dV = R^T D,    dr/dS = sinks_per_m R^T D up.
"""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import S, V, X

from fg_nav.arrays import Floats
from fg_nav.factors import guarded_factor
from fg_nav.factors.rotation import skew
from fg_nav.smoother.strides import VelocityTies


class GraphTies(VelocityTies):
    """Velocity ties that are linearised together, and are factors of a graph as well."""

    def __init__(self, graph: gtsam.NonlinearFactorGraph) -> None:
        super().__init__()
        self._graph = graph

    def add(
        self, node: int, body_velocity: Floats, settling: Floats, sigma: Floats, sole: int, sinks_per_m: float
    ) -> None:
        """Add the tie of a node, as `VelocityTies.add` does."""
        super().add(node, body_velocity, settling, sigma, sole, sinks_per_m)
        self._graph.push_back(
            velocity_tie_factor(X(node), V(node), S(sole), body_velocity, settling, sigma, sinks_per_m)
        )


def velocity_tie_factor(
    pose_key: int,
    velocity_key: int,
    excess_key: int,
    body_velocity: Floats,
    settling: Floats,
    sigma: Floats,
    sinks_per_m: float,
) -> gtsam.CustomFactor:
    """Tie the velocity of a sensor on a rolling, settling foot to its attitude; arrays as in `VelocityTies.add`."""
    u, expected, weight = body_velocity.copy(), settling.copy(), 1.0 / sigma
    by_turn = skew(u)

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
        nav_R_body = values.atPose3(pose_key).rotation().matrix()
        weighted = nav_R_body.T * weight
        off = values.atVector(velocity_key) - nav_R_body @ u - expected
        off[2] += sinks_per_m * values.atVector(excess_key)[0]
        r = weighted @ off
        if not with_jacobians:
            return r, []
        by_pose = np.zeros((3, 6))
        by_pose[:, :3] = weighted @ nav_R_body @ by_turn + skew(r)
        return r, [by_pose, weighted, sinks_per_m * weighted[:, 2:]]

    unit = gtsam.noiseModel.Unit.Create(3)
    return guarded_factor("velocity tie", [pose_key, velocity_key, excess_key], [6, 3, 1], unit, residual)
