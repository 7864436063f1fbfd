"""How the solution of a walk moves with a few numbers that many of its factors share, without eliminating it again.

The linear graph is |A x + C s - b|^2, x the variables of the walk and s the shared numbers (n of them). Its triangle
without s is R^T R = A^T A, so with one pass up it and one down (`square_root`)

    R^T Y = A^T C,    R X = Y,    x(s) = x(0) - X s,    information of s: C^T C - Y^T Y,    and with P_s = cov(s)

    cov(x) = (R^T R)^-1 + X P_s X^T.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.smoother.solver import residuals_at_minimum
from fg_nav.smoother.square_root import SquareRoot


class SharedColumns:
    """The columns of the shared numbers, A^T C (N, n), taken up the tree of a walk."""

    def __init__(self, root: SquareRoot, products: Floats) -> None:
        self._root, self._Y = root, root.rise(products)
        self.explained = np.asarray(self._Y.T @ self._Y)
        """Y^T Y (n, n): what the variables of the walk take off the information C^T C."""

    def solve(self) -> Floats:
        """Return X (N, n): by how much each variable falls for a unit of each number."""
        return self._root.descend(self._Y)

    def spread(self, covariance: Floats) -> dict[int, Floats]:
        """Return by how much (d, n) each variable moves with numbers of unit covariance, for one (n, n) of s."""
        return self._root.split(self.solve() @ np.linalg.cholesky(covariance))


def join_shared(one: Mapping[int, Floats], other: Mapping[int, Floats]) -> Mapping[int, Floats]:
    """Return by how much each variable moves with the numbers of both, which are independent; either may be empty."""
    if not (one and other):
        return one or other
    return {key: np.hstack([moved, other[key]]) for key, moved in one.items()}


def weigh_shared(
    root: SquareRoot, A: Floats, b: Floats, keys: Sequence[Sequence[int]], C: Floats
) -> tuple[SharedColumns, Floats, Floats]:
    """Return the columns of numbers that K factors of a kind share, the walk's information L on them, and eta.

    The factors |A x + C s - b|^2, linearized with the walk: A (K, r, d), b (K, r), C (K, r, n), and their keys. L
    (n, n) and eta (n,) are what is left of them where the walk is eliminated.
    """
    # What is left of the factors at the minimum without the numbers.
    left = -residuals_at_minimum(root, keys, -b, A)
    # The walk is eliminated, and takes off what it explains.
    products = np.zeros((root.total, C.shape[2]))
    np.add.at(products, root.find_columns(keys), np.swapaxes(A, 1, 2) @ C)
    columns = SharedColumns(root, products)
    return columns, np.einsum("kri,krj->ij", C, C) - columns.explained, np.einsum("kri,kr->i", C, left)
