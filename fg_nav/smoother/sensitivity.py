"""How the solution of a walk moves with a few numbers that many of its factors share, without eliminating it again.

The linear graph is |A x + C s - b|^2, x the variables of the walk and s the shared numbers (n of them). Its triangle
without s is R^T R = A^T A, so with one pass up it and one down (`square_root`)

    R^T Y = A^T C,    R X = Y,    x(s) = x(0) - X s,    information of s: C^T C - Y^T Y,    and with P_s = cov(s)

    cov(x) = (R^T R)^-1 + X P_s X^T.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.factors.residual import Keys
from fg_nav.smoother.evidence import fit_shared
from fg_nav.smoother.solver import residuals_at_minimum
from fg_nav.smoother.square_root import SquareRoot
from fg_nav.system.spilled import drop_pages


class SharedColumns:
    """The columns of the shared numbers, A^T C (N, n), taken up the tree of a walk."""

    def __init__(self, root: SquareRoot, products: Floats) -> None:
        self._root, self._Y = root, root.forward_substitute(products)
        self.explained = np.asarray(self._Y.T @ self._Y)
        """Y^T Y (n, n): what the variables of the walk take off the information C^T C."""

    def solve(self) -> Floats:
        """Return X (N, n): by how much each variable falls for a unit of each number."""
        return self._root.back_substitute(self._Y)

    def spread(self, covariance: Floats) -> Floats:
        """Return by how much the walk moves (N, n) with numbers of unit covariance, for one (n, n) of s."""
        return np.asarray(self.solve() @ np.linalg.cholesky(covariance))

    def spread_untaken(self, information: Floats, pull: Floats, prior: Floats) -> Floats:
        """Return the same for numbers that are not taken off, with what the walk says of them and the prior (n, n).

        Their covariance is the second moment about the solution, in which they are zero (`evidence.fit_shared`).
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
    """Return the columns of n numbers that factors share, the walk's information L on them, and eta.

    L (n, n) and eta (n,) are what is left of the factors where the walk is eliminated. They come in parts, and each is
    let go of before the next.
    """
    products, information, pull = np.zeros((root.total, n)), np.zeros((n, n)), np.zeros(n)
    for A, b, keys, C in parts:
        # What is left of the factors at the minimum without the numbers.
        left = -residuals_at_minimum(root, keys, -b, A)
        np.add.at(products, root.find_columns(keys), np.swapaxes(A, 1, 2) @ C)
        information += np.einsum("kri,krj->ij", C, C)
        pull += np.einsum("kri,kr->i", C, left)
        drop_pages()
    # The walk is eliminated, and takes off what it explains.
    columns = SharedColumns(root, products)
    return columns, information - columns.explained, pull
