"""Factors of a satellite receiver's fixes on the footfalls of a walk (`own_factors`).

    e = p_j + s - q_k,     Cauchy's loss, over ground

p_j the footfall nearest in time, q_k the fix, s the start of the walk in the axes of the fixes: that which lays the
first solution on them best, with its turn. The heading at the start is found as with any factor of one's own.
"""

from __future__ import annotations

import gtsam
import numpy as np

from fg_nav.factors.walk_constraints import position_fix_noise
from fg_nav.frames import yaw_rotation
from fg_nav.gnss import CAUCHY, Gnss, describe_start, find_turn, select_fixes
from fg_nav.smoother.constraints import FIX_SPEED_M_S, find_nearest_nodes
from fg_nav.smoother.own_factors import ExtraFactors, GraphNodes
from fg_nav.smoother.solver import list_positions


def make_gnss_factors(gnss: Gnss) -> tuple[ExtraFactors, dict[str, float]]:
    """Return what makes the factors of these fixes, and where the walk starts on Earth, once they were made."""
    found: dict[str, float] = {}

    def make(nodes: GraphNodes) -> gtsam.NonlinearFactorGraph:
        # the start, and with it the axes of the walk
        seen = select_fixes(gnss.fixes, float(nodes.t[0]), float(nodes.t[-1]))
        node = find_nearest_nodes(seen.time, nodes.t)
        walked = list_positions(node, nodes.values)[:, :2]
        turn, start = find_turn(walked, seen)
        # the factors
        sigma = np.hypot(seen.sigma, FIX_SPEED_M_S * (seen.time - nodes.t[node]))
        loss = gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY)
        graph = gtsam.NonlinearFactorGraph()
        for j, place, own in zip(node, seen.place - start, sigma, strict=True):
            noise = gtsam.noiseModel.Robust.Create(loss, position_fix_noise(float(own)))
            graph.add(gtsam.GPSFactor(nodes.pose[int(j)], np.array([*place, 0.0]), noise))
        off = np.linalg.norm(seen.place - start - walked @ yaw_rotation(turn)[:2, :2].T, axis=1)
        found.update(describe_start(gnss, start, float(np.sum(seen.sigma**-2.0) ** -0.5), off < CAUCHY * sigma))
        return graph

    return make, found
