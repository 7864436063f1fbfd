"""Stances in which the foot moves: found by what the rest of the walk says of its velocity there, and trusted less.

Crawling, ladders, a foot that drags or slips, a mid-swing taken for a stance: the detector sees a still sensor, and the
tie of its velocity to zero is wrong by decimeters a second. Its own residual does not show it, since pose and velocity
follow the tie. What the walk says without it does. Let the velocity of the stance of footfall k be off by a constant
d_k (nav, m/s) in all its rows. With their residuals e_k at the minimum, whitened, H_k how they change with d_k, J their
Jacobian and P the covariance of their variables,

    M_k = I - J P J^T,     F_k = H_k^T M_k H_k,     d_k = F_k^-1 H_k^T e_k,     T_k = d_k^T F_k d_k

T_k is by how much twice the error falls at the minimum where d_k is free (a deletion diagnostic; Cook 1977), chi^2 of
three degrees of freedom where the stance is one. It costs one pass down the triangle (`square_root`), each footfall a
group with G = J^T H.

A stance is refused where T is above `MIN_STATISTIC` (of a mid-swing `MIN_OF_SWING`) and the largest within `NEIGHBORS`
footfalls, for a wrong tie spoils those next to it, and |d_k| is more than a foot rolls with. Its ties are not dropped:
their sigma grows to |d_k|. Then the walk is solved again, until none is refused.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from fg_nav.arrays import Bools, Floats
from fg_nav.factors.residual import ResidualBlock
from fg_nav.factors.zero_velocity import StanceVelocity
from fg_nav.smoother.gauss_newton import FIRST_CONVERGENCE
from fg_nav.smoother.graph import WalkProblem, solve_and_keep
from fg_nav.smoother.solver import Solved, residuals_at_minimum
from fg_nav.smoother.square_root import Groups, SquareRoot
from fg_nav.smoother.strides import Nodes
from fg_nav.text import format_count

MIN_STATISTIC = 40.0  # T of stances: median 0.1 to 2, beside a shock 15 to 35, of a foot at 0.35 m/s 52.
SWINGS_M_S = 1.5  # |d| of a mid-swing: no shock makes a stance look like one.
MIN_OF_SWING = 20.0  # T of a mid-swing: it raises the noise of all swings, by which its T comes down to 21 to 40.
MIN_SPEED_M_S = 0.15  # |d| below which none is refused: feet that walk fast roll with as much.
NEIGHBORS = 2  # Footfalls on either side whose T a wrong tie swells.
ROUNDS = 4  # Of solving again.
MIN_SHARE = 1e-6  # Of the strongest direction of F, below which rounding decides.


@dataclass(frozen=True)
class StanceStatistics:
    """Of each footfall: `statistic` T (F,), and the velocity d (F, 3) m/s, nav, that the rest of the walk gives it."""

    statistic: Floats
    velocity: Floats

    def refused(self) -> Bools:
        """Which footfalls (F,) are refused."""
        largest = self.statistic >= maximum_filter1d(self.statistic, 2 * NEIGHBORS + 1)
        speed = np.linalg.norm(self.velocity, axis=1)
        limit = np.where(speed > SWINGS_M_S, MIN_OF_SWING, MIN_STATISTIC)
        return np.asarray(largest & (self.statistic > limit) & (speed > MIN_SPEED_M_S))


def weaken_refused_stances(problem: WalkProblem, solved: Solved) -> tuple[WalkProblem, Solved]:
    """Return a problem, solved near its minimum, with the ties weakened that the walk refuses, and its solution."""
    refused = np.zeros(len(problem.nodes.result), dtype=np.bool_)
    for _ in range(ROUNDS):
        # The velocity of each stance by the rest of the walk.
        found = compute_stance_statistics(problem, solved)
        now = found.refused()
        if not now.any():
            break
        # The same ties with a sigma as large as what they are off by; and solve again.
        refused |= now
        off = np.where(now, np.linalg.norm(found.velocity, axis=1), 0.0)[problem.nodes.footfall]
        ties = problem.velocities.residuals
        assert isinstance(ties, StanceVelocity)
        ties = replace(ties, sigma=np.hypot(ties.sigma, off[:, None]))
        problem = replace(problem, velocities=ResidualBlock(ties, problem.velocities.keys))
        solved = solve_and_keep(problem, FIRST_CONVERGENCE)
        problem = replace(problem, values=solved.values)
    if refused.any():
        first = problem.recording.t[problem.nodes.sample[problem.nodes.result[refused]]][0]
        problem = problem.with_note(
            f"{format_count(int(refused.sum()), 'stance')} of {len(refused)} trusted less, the first at {first:.1f} s: "
            "by the rest of the walk the foot moves there"
        )
    return problem, solved


def compute_stance_statistics(problem: WalkProblem, solved: Solved) -> StanceStatistics:
    """Measure T and d of every footfall, at the minimum of the last linearization."""
    nodes, block = problem.nodes, problem.velocities
    residual, jacobians = block.evaluate(solved.linearized_at)
    jacobian, root = np.concatenate(jacobians, axis=2), solved.root
    left = residuals_at_minimum(root, block.keys, residual, jacobian)
    # H^T H and H^T e of each footfall, and what the walk explains of the first.
    H, begins = jacobians[1], nodes.first[:-1]
    seen = np.add.reduceat(np.swapaxes(H, 1, 2) @ H, begins)
    by = np.add.reduceat((np.swapaxes(H, 1, 2) @ left[..., None])[..., 0], begins)
    F = seen - root.quadratic_forms(_group_ties(root, block, nodes, np.swapaxes(jacobian, 1, 2) @ H))
    # Pseudo-inverse; directions without information are dropped.
    strength, axes = np.linalg.eigh(F)
    along = (np.swapaxes(axes, 1, 2) @ by[..., None])[..., 0]
    along = np.divide(along, strength, out=np.zeros_like(along), where=strength > MIN_SHARE * strength[:, -1:])
    velocity = (axes @ along[..., None])[..., 0]
    return StanceStatistics((velocity * by).sum(axis=1), velocity)


def _group_ties(root: SquareRoot, block: ResidualBlock, nodes: Nodes, products: Floats) -> Groups:
    """Group the variables of ties by footfall, with J^T H (M, d, 3) of each tie; the last, settling, is in common."""
    columns, begins = root.find_columns(block.keys), nodes.first[:-1]
    groups = Groups(
        np.full(root.total, -1),
        np.zeros((root.total, 3)),
        columns[begins, -1],
        np.add.reduceat(products[:, -1], begins),
    )
    groups.of_column[columns[:, :-1]] = nodes.footfall[:, None]
    groups.G[columns[:, :-1]] = products[:, :-1]
    return groups
