"""Fixes of the position while the walk goes on: those whose time has come.

In a solution of all the walk they are the batch's (`fg_nav.smoother.constraints`): where they show the heading better
than it is known, the walk is turned to them. Between two such solutions a fix is added with its stride, to the node of
it or of the footfall before that is nearest in time. The heading of a graph in progress is held by all that went
before, so a fix that is farther off than the sigmas allow would bend the walk, not turn it: it waits for the next
solution of all of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.factors.walk_constraints import position_fix_factor, position_fix_noise
from fg_nav.fix_check import FIX_REACH_S
from fg_nav.smoother.constraints import add_fixes, pin_to_times
from fg_nav.smoother.gauss_newton import FIRST_CONVERGENCE
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.solver import in_nav
from fg_nav.truth import Fix

AGREES = 4.0
"""Sigmas within which a fix agrees with the walk so far; one in 3000 that is true does not, and comes later."""


def select_fixes(fixes: Sequence[Fix], t_node: Floats, after_s: float = -np.inf) -> tuple[Fix, ...]:
    """Return the fixes after a time and up to the last of some nodes (n,) s that have one of them within reach."""
    return tuple(
        fix
        for fix in fixes
        if after_s < fix.time_s <= t_node[-1] and float(np.abs(t_node - fix.time_s).min()) <= FIX_REACH_S
    )


def add_fixes_so_far(problem: WalkProblem, fixes: Sequence[Fix]) -> WalkProblem:
    """Add fixes to a walk so far, at its solution with them; those that it has not come to are left out."""
    reached = select_fixes(fixes, problem.recording.t[problem.nodes.sample])
    if not reached:
        return problem
    problem = add_fixes(problem, problem.values, reached)
    return replace(problem, values=solve(problem, FIRST_CONVERGENCE).values)


def find_stride_fixes(fixes: Sequence[Fix], t_node: Floats, before_s: float) -> list[tuple[int, Fix]]:
    """Return the fixes of a stride, each with the number of its node and with the sigma that it has there.

    Parameters
    ----------
    t_node : (n,) s, of the nodes of the footfall before and of the new one.
    before_s : of the last node of the footfall before.
    """
    reached = select_fixes(fixes, t_node, before_s)
    pinned = pin_to_times(reached, t_node)
    return [
        (int(node), replace(fix, horizontal_sigma_m=float(sigma)))
        for node, fix, sigma in zip(pinned.node, reached, pinned.horizontal, strict=True)
    ]


def fix_factor(key: int, fix: Fix) -> gtsam.GPSFactor:
    """Tie a pose to a fix at its time."""
    return position_fix_factor(key, fix.position, position_fix_noise(fix.horizontal_sigma_m, fix.vertical_sigma_m))


def agrees(pose: gtsam.Pose3, body_cov: Floats, fix: Fix) -> bool:
    """Whether a pose with this covariance (6, 6) in body axes agrees with a fix over ground."""
    offset = fix.position[:2] - pose.translation()[:2]
    covariance = in_nav(pose.rotation().matrix()[None], body_cov[None])[0, :2, :2]
    total = covariance + fix.horizontal_sigma_m**2 * np.eye(2)
    return bool(offset @ np.linalg.solve(total, offset) <= AGREES**2)
