"""Evidence for an assumption, numbers that a whole walk shares, and the joint covariance of its footfalls.

All are of the linear graph at its minimum, R the triangle of its square-root information.

Evidence (Laplace; MacKay 2003, section 27). With E the error at the minimum, S_i the noise covariances of the factors,

    -log p(z | assumed) = E + log|R| + 1/2 sum_i log|S_i|.

Of the S_i each caller adds those that its assumption changes. All else is left out.

Shared numbers. The linear graph is |A x + C s - b|^2, x the variables of the walk and s numbers (n of them) that many
of its factors share, with the prior 0 and S. Without eliminating the walk again, with one pass up its triangle without
s, R^T R = A^T A, and one down (`square_root`)

    R^T Y = A^T C,    R X = Y,    x(s) = x(0) - X s,    information of s: L = C^T C - Y^T Y,

and with eta the product of L with the estimate

    s = P eta,     P = (L + S^-1)^-1,     log p(z | S) = 1/2 eta^T P eta - 1/2 log|I + S L| + const,
    cov(x) = (R^T R)^-1 + X P X^T.

Footfalls. The errors of two footfalls are nearly the same error: heading and scale belong to the walk. So what is said
of several footfalls together, as the length of the path, needs their joint covariance, which the marginal ones
(`batch.stance_table`) do not hold. With e_k (4,) the error of footfall k, east, north, up (m) and yaw about up (rad),
T_k the map of the tangent space of pose k to e_k, n combinations c and g_k = T_k^T w_k,

    c = sum_k w_k^T e_k,    w_k (4, n),
    cov(c) = g^T (R^T R)^-1 g = Y^T Y,    R^T Y = g,    cov(e_k, c) = T_k X_k,    R X = Y.

Numbers that the triangle does not hold, as the gyroscope's scale, move pose k by L_k a, a of unit covariance; that adds
L_k sum_l L_l^T g_l. The length of the path is the sum of its straight moves, so its weights are their unit vectors u,

    w_k = u_k - u_(k+1),    u_k = (p_k - p_(k-1)) / |p_k - p_(k-1)|,

and its sigma counts what is common to all strides, as that of independent strides would not.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats, weigh_models
from fg_nav.factors.residual import Keys
from fg_nav.smoother.solver import Solved, list_attitudes, pose_in_nav, residuals_at_minimum
from fg_nav.smoother.square_root import SquareRoot
from fg_nav.smoother.strides import Nodes

MAX_NATS = 3.0  # Twenty to one: what counts as strong evidence (Kass and Raftery 1995).


def average(values: Floats, minus_log_evidence: Floats, prior: Floats | None = None) -> Floats:
    """Mean of values (L, ...) of L models, weighted by their evidence (L,) and, if given, by prior weights (L,)."""
    return np.asarray(np.tensordot(weigh_models(-minus_log_evidence, prior), values, axes=1))


def fit_shared(information: Floats, pull: Floats, prior: Floats) -> tuple[Floats, Floats, float]:
    """Return mean s (n,), covariance P (n, n), log evidence, from information L, its vector eta and N(0, S) prior."""
    covariance = np.asarray(np.linalg.inv(information + np.linalg.inv(prior)))
    found = covariance @ pull
    occam = 0.5 * np.linalg.slogdet(np.eye(len(prior)) + prior @ information)[1]
    return found, covariance, float(0.5 * pull @ found - occam)


class SharedColumns:
    """The columns of the shared numbers, A^T C (N, n), taken up the tree of a walk."""

    def __init__(self, root: SquareRoot, products: Floats) -> None:
        self._root, self._Y = root, root.forward_substitute(products)
        self.explained = np.asarray(self._Y.T @ self._Y)  # (n, n), what the walk takes off the information C^T C.

    def solve(self) -> Floats:
        """Return X (N, n) = R^-1 Y: the walk moves by -X s if the shared numbers are s (n,)."""
        return self._root.back_substitute(self._Y)

    def spread(self, covariance: Floats) -> Floats:
        """Return S (N, n): S S^T is the walk's covariance from the shared numbers, theirs being `covariance` (n, n)."""
        return np.asarray(self.solve() @ np.linalg.cholesky(covariance))

    def spread_untaken(self, information: Floats, pull: Floats, prior: Floats) -> Floats:
        """Return S (N, n) as `spread`, for numbers left at zero: L, eta and prior covariance (n, n) as of `fit_shared`.

        Their covariance is the second moment about the solution, in which they are zero (`fit_shared`).
        """
        found, covariance, _ = fit_shared(information, pull, prior)
        return self.spread(covariance + np.outer(found, found))


class SharingFactors(NamedTuple):
    """K factors of a kind |A x + C s - b|^2, linearized with the walk.

    A (K, r, d) in the variables `keys` (K, v), b (K, r) and C (K, r, n).
    """

    A: Floats
    b: Floats
    keys: Sequence[Sequence[int]] | Keys
    C: Floats


def shared_information(
    root: SquareRoot, parts: Iterable[SharingFactors], n: int
) -> tuple[SharedColumns, Floats, Floats]:
    """Return the columns of n shared numbers, and their information L and information vector eta, walk marginalized.

    L (n, n) = C^T C - Y^T Y (Schur complement), eta (n,) = C^T residual.
    """
    products, information, pull = np.zeros((root.total, n)), np.zeros((n, n)), np.zeros(n)
    for A, b, keys, C in parts:
        # b less A x at the minimum without the shared numbers.
        left = -residuals_at_minimum(root, keys, -b, A)
        np.add.at(products, root.find_columns(keys), np.swapaxes(A, 1, 2) @ C)
        information += np.einsum("kri,krj->ij", C, C)
        pull += np.einsum("kri,kr->i", C, left)
    # Schur complement: less the information that the walk absorbs.
    columns = SharedColumns(root, products)
    return columns, information - columns.explained, pull


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
    """Return the gradient (F, 4) of path length by the error of each footfall, position (F, 3) m, up to `until`.

    With heights of zero it is the length over the ground.
    """
    weights = np.zeros((len(position), 4))
    move = np.diff(position[: until if until is None else until + 1], axis=0)
    length = np.linalg.norm(move, axis=1, keepdims=True)
    unit = np.divide(move, length, out=np.zeros_like(move), where=length > 0.0)
    weights[1 : len(unit) + 1, :3] += unit
    weights[: len(unit), :3] -= unit
    return weights
