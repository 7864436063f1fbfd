"""Fixes on a walk: at which node, how much each is worth, and what they say of the heading at the start.

Fixes are in the walk's own frame, with its start at the origin: where the walk began remains known. That it began in
this heading does not, as any fix away from the start says so as well, with

    sigma^-2 = sum |fix - start|^2 / sigma_fix^2    over ground, rad^-2.

A heading that was told becomes a prior of some degrees as soon as the fixes know better. Where none was told, the walk
is first turned about its start to where it fits the fixes best, and then nothing is believed of its heading.

A fix is tied to the node nearest in time. Between the two the foot moves on, at walking pace on the mean; its sigma
grows by as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.position_fix import position_fix_factor, position_fix_noise
from fg_nav.fixes import Fix
from fg_nav.frames import yaw_rotation
from fg_nav.smoother.initial import turn_walk
from fg_nav.smoother.nodes import Nodes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import Native
from fg_nav.smoother.walk_parameters import WalkParameters

LEAST_KNOWN_HEADING_RAD = 1.0
"""Doubt that fixes leave of the heading at the start beyond which they say nothing of it."""


@dataclass(frozen=True)
class PinnedFixes:
    """Fixes at their nodes: `node` (K,), `position` (K, 3) m, `horizontal` and `vertical` (K,) sigmas, m."""

    node: Ints
    position: Floats
    horizontal: Floats
    vertical: Floats

    def __len__(self) -> int:
        return len(self.node)

    def factors(self) -> Native:
        """Tie the nodes to their fixes."""
        return Native(
            *(
                position_fix_factor(X(int(j)), at, position_fix_noise(float(horizontal), float(vertical)))
                for j, at, horizontal, vertical in zip(
                    self.node, self.position, self.horizontal, self.vertical, strict=True
                )
            )
        )

    @property
    def heading_sigma(self) -> float:
        """Doubt that the fixes leave of the heading at the start, rad; infinite where all are at the start."""
        information = float((np.hypot(*self.position.T[:2]) ** 2 / self.horizontal**2).sum())
        return information**-0.5 if information else float("inf")

    def best_turn(self, values: gtsam.Values) -> Floats:
        """Rotation (3, 3) about up and the start that brings a walk nearest to its fixes."""
        walked = np.array([values.atPose3(X(int(j))).translation() for j in self.node])
        weight = self.horizontal**-2.0
        across = weight @ (walked[:, 0] * self.position[:, 1] - walked[:, 1] * self.position[:, 0])
        along = weight @ (walked[:, :2] * self.position[:, :2]).sum(axis=1)
        return yaw_rotation(float(np.arctan2(across, along)))


def pin_fixes(fixes: Sequence[Fix], t: Floats, nodes: Nodes, p: WalkParameters) -> PinnedFixes:
    """Find the node of each fix.

    Raises
    ------
    EstimationError
        For a fix outside the walk or farther than a stride from any node, or one without a place or a sigma.
    """
    t_node = t[nodes.sample]
    node = [_node_of(fix, t_node, p.fix_reach_s) for fix in fixes]
    apart = np.array([fix.time_s - t_node[j] for fix, j in zip(fixes, node, strict=True)])
    return PinnedFixes(
        np.array(node, dtype=np.intp),
        np.array([fix.position for fix in fixes], dtype=np.float64).reshape(-1, 3),
        np.hypot([fix.horizontal_sigma_m for fix in fixes], p.fix_speed_m_s * apart),
        np.array([fix.vertical_sigma_m for fix in fixes], dtype=np.float64),
    )


def _node_of(fix: Fix, t_node: Floats, reach_s: float) -> int:
    """Index of the node nearest to a fix in time."""
    if not (np.isfinite(fix.position).all() and 0 < fix.horizontal_sigma_m < np.inf and fix.vertical_sigma_m > 0):
        raise EstimationError(
            f"the fix at {fix.time_s:.2f} s needs a finite position and sigmas above zero: correct it or leave it out."
        )
    if not t_node[0] - reach_s <= fix.time_s <= t_node[-1] + reach_s:
        raise EstimationError(
            f"the fix at {fix.time_s:.2f} s is outside the walk, which lasts from {t_node[0]:.2f} s to "
            f"{t_node[-1]:.2f} s: give its time as in the recording, or leave it out."
        )
    apart = np.abs(t_node - fix.time_s)
    if apart.min() > reach_s:
        raise EstimationError(
            f"the fix at {fix.time_s:.2f} s is {apart.min():.1f} s from the nearest footfall, which is farther than a "
            "stride: take fixes where the foot stands, or leave it out."
        )
    return int(apart.argmin())


@dataclass(frozen=True)
class FreedHeading:
    """By what (3, 3) the walk was turned about up to fit its fixes, and with what sigma, rad, that is believed."""

    turn: Floats
    sigma: float


def free_heading(
    pinned: PinnedFixes, told: bool, values: gtsam.Values, nodes: Nodes, p: SmootherParameters
) -> FreedHeading | None:
    """Free the heading at the start where the fixes know it better; a walk whose heading was not told is turned.

    Returns None where the heading stays as it is by definition.
    """
    if told:
        sigma = float(np.radians(p.walk.told_heading_deg))
        return FreedHeading(np.eye(3), sigma) if pinned.heading_sigma < sigma else None
    if pinned.heading_sigma > LEAST_KNOWN_HEADING_RAD:
        return None
    turn = pinned.best_turn(values)
    turn_walk(values, nodes, turn)
    return FreedHeading(turn, float(np.radians(p.unknown_heading_deg)))
