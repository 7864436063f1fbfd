"""How the solution of a walk moves with a few numbers that many of its factors share, without eliminating it again.

The linear graph is |A x + C s - b|^2, x the variables of the walk and s the shared numbers (n of them). Its Bayes tree
without s is R^T R = A^T A, so with one pass up the tree and one down it

    R^T Y = A^T C,    R X = Y,    x(s) = x(0) - X s,    information of s: C^T C - Y^T Y,    and with P_s = cov(s)

    cov(x) = (R^T R)^-1 + X P_s X^T.

In a clique R x_F + S x_S = d, F its frontal variables and S its separator, the pass up is Y_F = R^-T c_F, and leaves
c_S - S^T Y_F to the cliques above; the pass down is X_F = R^-1 (Y_F - S X_S).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import gtsam
import numpy as np
from scipy.linalg.blas import dtrsm  # LAPACK's dtrtrs wakes threads, which takes a hundred times as long

from fg_nav.arrays import Floats
from fg_nav.smoother.solver import dimension_of, list_cliques, residuals_at_minimum


class SharedColumns:
    """The columns C of the shared numbers, taken up a Bayes tree that was eliminated by QR.

    `products` has A^T C (d, n) of each variable that they touch; it is used up.
    """

    def __init__(self, tree: gtsam.GaussianBayesTree, products: dict[int, Floats], shared: int) -> None:
        self.explained = np.zeros((shared, shared))
        """Y^T Y (n, n): what the variables of the walk take off the information C^T C."""
        self._shared = shared
        self._up: list[tuple[gtsam.GaussianConditional, Floats | None]] = []
        for clique in reversed(list_cliques(tree)):
            conditional, Y = clique.conditional(), None
            keys = conditional.keys()
            # Cliques that the columns do not reach stay as they are.
            if not products.keys().isdisjoint(keys):
                Y = self._reduce(conditional, keys, products)
            self._up.append((conditional, Y))

    def _reduce(
        self, conditional: gtsam.GaussianConditional, keys: Sequence[int], products: dict[int, Floats]
    ) -> Floats:
        """Take the columns of the frontal variables out of `products`, hand the rest up, and return Y_F."""
        R, S = conditional.R(), conditional.S()
        frontal, separator = _split(keys, len(R))
        nothing = (np.zeros((dimension_of(key), self._shared)) for key in frontal)
        c = np.concatenate([products.pop(key, zero) for key, zero in zip(frontal, nothing, strict=True)])
        Y = np.asarray(dtrsm(1.0, R, c, trans_a=1))
        self.explained += Y.T @ Y
        left, row = S.T @ Y, 0
        for key in separator:
            size = dimension_of(key)
            part = left[row : row + size]
            products[key] = products[key] - part if key in products else -part
            row += size
        return Y

    def solve(self) -> dict[int, Floats]:
        """Return X (d, n) of each variable: by how much it falls for a unit of each number."""
        found: dict[int, Floats] = {}
        for conditional, Y in reversed(self._up):
            R, S = conditional.R(), conditional.S()
            frontal, separator = _split(conditional.keys(), len(R))
            right = np.zeros((len(R), self._shared)) if Y is None else Y
            if separator:
                right = right - S @ np.concatenate([found[key] for key in separator])
            X, row = np.asarray(dtrsm(1.0, R, right)), 0
            for key in frontal:
                found[key] = X[row : row + dimension_of(key)]
                row += dimension_of(key)
        return found

    def spread(self, covariance: Floats) -> dict[int, Floats]:
        """Return by how much (d, n) each variable moves with numbers of unit covariance, for one (n, n) of s."""
        lower = np.linalg.cholesky(covariance)
        return {key: moved @ lower for key, moved in self.solve().items()}


def join_shared(one: Mapping[int, Floats], other: Mapping[int, Floats]) -> Mapping[int, Floats]:
    """Return by how much each variable moves with the numbers of both, which are independent; either may be empty."""
    if not (one and other):
        return one or other
    return {key: np.hstack([moved, other[key]]) for key, moved in one.items()}


def weigh_shared(
    tree: gtsam.GaussianBayesTree, A: Floats, b: Floats, keys: Sequence[Sequence[int]], C: Floats
) -> tuple[SharedColumns, Floats, Floats]:
    """Return the columns of numbers that K factors of a kind share, the walk's information L on them, and eta.

    The factors |A x + C s - b|^2, linearized with the tree: A (K, r, d), b (K, r), C (K, r, n), and their keys. L
    (n, n) and eta (n,) are what is left of them where the walk is eliminated.
    """
    # What is left of the factors at the minimum without the numbers.
    left = -residuals_at_minimum(tree, keys, -b, A)
    # The walk is eliminated, and takes off what it explains.
    columns = SharedColumns(tree, sum_by_key(np.swapaxes(A, 1, 2) @ C, keys), C.shape[2])
    return columns, np.einsum("kri,krj->ij", C, C) - columns.explained, np.einsum("kri,kr->i", C, left)


def sum_by_key(products: Floats, keys: Sequence[Sequence[int]]) -> dict[int, Floats]:
    """Sum the rows of A^T C (K, d, n) of K factors of a kind that belong to the same variable; keys (K, variables)."""
    total: dict[int, Floats] = {}
    last = np.cumsum([dimension_of(key) for key in keys[0]])[:-1]
    for position, part in enumerate(np.split(products, last, axis=1)):
        for one, rows in zip(keys, part, strict=True):
            key = one[position]
            total[key] = total[key] + rows if key in total else rows
    return total


def _split(keys: Sequence[int], rows: int) -> tuple[Sequence[int], Sequence[int]]:
    """Split the keys of a clique into those of its `rows` rows, and the separator's."""
    count = 0
    while rows > 0:
        rows -= dimension_of(keys[count])
        count += 1
    return keys[:count], keys[count:]
