"""Covariance of linear combinations of a walk's footfalls: length of the path, yaw of a stretch, difference of two.

The errors of two footfalls are nearly the same error: heading and scale belong to the walk. So what is said of several
footfalls together needs their joint covariance, which the marginal ones (`solver.stance_table`) do not hold. With
e_k (4,) the error of footfall k, east, north, up (m) and yaw about up (rad), and n combinations

    c = sum_k w_k^T e_k,    w_k (4, n),

T_k the map of the tangent space of pose k to e_k, R the triangle of the walk, and g_k = T_k^T w_k,

    cov(c) = g^T (R^T R)^-1 g = Y^T Y,    R^T Y = g,    cov(e_k, c) = T_k X_k,    R X = Y,

one pass up the tree and one down it (`sensitivity`), linear in the walk. What the tree does not hold, numbers shared
by all the walk as the gyroscope's scale, moves pose k by L_k a, a of unit covariance; that adds L_k sum_l L_l^T g_l.

The length of the path is the sum of its straight moves, so its weights are the unit vectors u of these,

    w_k = u_k - u_(k+1),    u_k = (p_k - p_(k-1)) / |p_k - p_(k-1)|,

and its sigma counts what is common to all strides, as that of independent strides would not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats
from fg_nav.smoother.sensitivity import SharedColumns
from fg_nav.smoother.solver import Solved, list_attitudes, pose_in_nav
from fg_nav.smoother.square_root import SquareRoot
from fg_nav.smoother.strides import Nodes


@dataclass(frozen=True)
class FootfallCovariance:
    """Joint covariance of the footfalls of a solved walk.

    Attributes
    ----------
    root : of the walk, eliminated by QR.
    keys : of the poses of the F footfalls.
    nav_T_body : (F, 4, 6), from their tangent spaces to east, north, up and yaw.
    shared : L (N, n) of all columns of the walk, n = 0 where the tree holds all.
    """

    root: SquareRoot
    keys: tuple[int, ...]
    nav_T_body: Floats
    shared: Floats

    @classmethod
    def of(cls, solved: Solved, nodes: Nodes, shared: Floats) -> FootfallCovariance:
        """Take that of a walk's footfalls, each at its stillest node."""
        keys = tuple(X(int(j)) for j in nodes.result)
        return cls(solved.root, keys, pose_in_nav(list_attitudes(nodes.result, solved.values)), shared)

    def combine(self, weights: Floats) -> tuple[Floats, Floats]:
        """Return cov(c) (n, n), and cov(e_k, c) (F, 4, n) with each footfall, of weights (F, 4, n)."""
        g = np.swapaxes(self.nav_T_body, 1, 2) @ weights
        at, products = self.root.find_columns([(key,) for key in self.keys]), np.zeros((self.root.total, g.shape[2]))
        products[at] = g
        columns = SharedColumns(self.root, products)
        L = self.shared[at]
        pull = np.einsum("kds,kdn->sn", L, g)
        return columns.explained + pull.T @ pull, self.nav_T_body @ (columns.solve()[at] + L @ pull)


def weigh_path(position: Floats, until: int | None = None) -> Floats:
    """Weights (F, 4) of the length of the path through footfalls at `position` (F, 3) m, up to footfall `until`.

    With heights of zero it is the length over the ground.
    """
    weights = np.zeros((len(position), 4))
    move = np.diff(position[: until if until is None else until + 1], axis=0)
    length = np.linalg.norm(move, axis=1, keepdims=True)
    unit = np.divide(move, length, out=np.zeros_like(move), where=length > 0.0)
    weights[1 : len(unit) + 1, :3] += unit
    weights[: len(unit), :3] -= unit
    return weights
