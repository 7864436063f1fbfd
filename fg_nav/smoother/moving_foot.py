"""A foot that moves on at its stillest instant: the scale of a walk, counted in its sigmas.

Motion capture sees the sensor on a shoe move on at 1 to 5 percent of the walking speed when it is stillest, forward
more than sideways; some of that is the rolling about the lever, and some is not. So every stride is off by the same
share, and the walk by its scale. In a stance after a stride of the horizontal displacement d (m) in T (s) the velocity
is off by

    c_1 a + c_2 (up x a),     a = d / T,     navigation axes, m/s,

c = (c_1, c_2) the same for a whole walk, 0 +- (`FORWARD_SIGMA`, `SIDEWAYS_SIGMA`). A foot that stands for long does not
move on. On a straight even walk nothing inertial shows c (Galilei). Where a walk turns, stops or changes its pace, it
does, but rolling that the lever does not describe looks the same there. So c is not taken off, and with what the walk
says of it, information L and estimate s = P eta with P = (L + S^-1)^-1 (`evidence.fit_shared`), the covariances of the
walk grow by X (P + s s^T) X^T: the second moment about the solution with c = 0, X how a variable moves with c
(`sensitivity`). The columns C of c are those of the residual e of a stance's velocity (`factors.zero_velocity`),

    C = -(de/dv) (a, up x a).

A walk in progress has the prior instead: (c_1 d, c_2 up x d) in each position, d what the walk has come so far.
"""

from __future__ import annotations

import gtsam
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.factors.zero_velocity import StanceVelocity
from fg_nav.samples.gaps import cross_holes
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.sensitivity import SharedColumns, SharingFactors, shared_information
from fg_nav.smoother.solver import Solved, list_positions

FORWARD_SIGMA, SIDEWAYS_SIGMA = 0.02, 0.01
"""Shares of the walking speed: scatter between the shoes, mountings and gaits of motion-captured walks."""

MAX_STRIDE_S = 1.5  # What is longer was standing.


def spread_moving_foot(problem: WalkProblem, solved: Solved) -> Floats:
    """Return by how much the walk moves (N, 2), for numbers of unit covariance, with what is not known of c."""
    columns, information, pull = weigh_moving_foot(problem, solved)
    return columns.spread_untaken(information, pull, np.diag([FORWARD_SIGMA**2, SIDEWAYS_SIGMA**2]))


def weigh_moving_foot(problem: WalkProblem, solved: Solved) -> tuple[SharedColumns, Floats, Floats]:
    """Return the columns of c in the tree of a solved walk, its information L (2, 2) on c, and eta (2,)."""
    block = problem.velocities
    residual, jacobians = block.evaluate(solved.linearized_at)
    by_share = -jacobians[1] @ find_motion(problem, solved.values)
    factors = SharingFactors(np.concatenate(jacobians, axis=2), -residual, block.keys, by_share)
    return shared_information(solved.root, [factors], 2)


def find_motion(problem: WalkProblem, values: gtsam.Values) -> Floats:
    """Return (a, up x a) (M, 3, 2) m/s at each node, navigation axes; zero in the first and in long stances.

    And after a stride that was not seen.
    """
    nodes = problem.nodes
    t = problem.recording.t[nodes.sample[nodes.result]]
    position = list_positions(nodes.result, values)
    d = np.diff(position, axis=0, prepend=position[:1])
    a = d[:, :2] / np.minimum(np.diff(t, prepend=-np.inf), MAX_STRIDE_S)[:, None]
    a[1:][cross_holes(problem.recording.t, nodes.sample[nodes.result])] = 0.0
    level = np.zeros(len(a))
    motion = np.stack([np.column_stack([a, level]), np.column_stack([-a[:, 1], a[:, 0], level])], axis=2)
    ties = problem.velocities.residuals
    assert isinstance(ties, StanceVelocity)
    walks = ties.sinks_per_m > 0.0
    return np.asarray(motion[nodes.footfall] * walks[:, None, None])


def extend_covariance(pose_cov: Floats, position: Floats) -> Floats:
    """Return the covariance (4, 4) of a pose in a walk in progress, with what is not known of c.

    `position` (3,) m from the start.
    """
    east, north = position[:2]
    moved = np.array([[east, -north], [north, east]]) * (FORWARD_SIGMA, SIDEWAYS_SIGMA)
    extended = pose_cov.copy()
    extended[:2, :2] += moved @ moved.T
    return extended
