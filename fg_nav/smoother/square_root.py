"""The square-root information of a solved walk as arrays, and the passes along it in compiled code.

A Bayes tree that was eliminated by QR holds for each of its variables, of d dimensions, the rows of R x = r in it: an
upper triangle R_FF (d, d) on itself and R_FS (d, s) on those of its separator, which were eliminated later. GTSAM hands
all of them over in one call. Here they are fronts, one a variable, those of the separator before it, and the one that
comes last of these is its parent. Its separator is among the parent's own variable and separator, so

    up     R^T Y = C     from the last front to the first,    each leaves C_S - R_FS^T Y_F to those of its separator,
    down   R X = Y       from the first to the last,          X_F = R_FF^-1 (Y_F - R_FS X_S),
    and    W = -R_FF^-1 R_FS,    P_FS = W P_SS,    P_FF = R_FF^-1 R_FF^-T + W P_SS W^T,

P the covariance, P_SS known from the parent. With a group of variables along a path of the tree, as those of a
footfall, comes the covariance K of all others there with G^T x of the group, and G^T P G: P G is added front by front.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import gtsam
import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.smoother.front_covariances import LARGEST, Groups, spread_covariance
from fg_nav.smoother.fronts import build_fronts, descend, rise


class SquareRoot:
    """R of a solved walk: `first` has the first column of each of its variables, of `total`; `step` (N,) is R^-1 r.

    `dimension` is that of variables by their letter.
    """

    def __init__(self, tree: gtsam.GaussianBayesTree, dimension: Mapping[int, int]) -> None:
        graph = gtsam.GaussianFactorGraph()
        graph.push_back(tree)
        cliques = [graph.at(i).keys() for i in range(graph.size())]
        keys = sorted({key for clique in cliques for key in clique})
        size = np.array([dimension[key >> 56] for key in keys])
        first = np.cumsum(size) - size
        self.first = dict(zip(keys, first.tolist(), strict=True))
        self._size = dict(zip(keys, size.tolist(), strict=True))
        self.total = int(size.sum())
        number = {key: i for i, key in enumerate(keys)}
        members = np.array([number[key] for clique in cliques for key in clique])
        ends = np.cumsum([len(clique) for clique in cliques])
        most = int((np.diff(ends, prepend=0) * np.add.reduceat(size[members], np.append(0, ends[:-1]))).sum())
        row, column, value = graph.sparseJacobian_()
        place = row.astype(np.int64) - 1, column.astype(np.int64) - 1
        self._fronts, right = build_fronts(members, ends, size, first, *place, value, most)
        self.step = self.descend(right[:, None])[:, 0]

    def find_columns(self, keys: Sequence[Sequence[int]]) -> Ints:
        """Return the columns (K, d) of the variables (K, n) of K factors of a kind."""
        size = [self._size[key] for key in keys[0]]
        first = np.array([[self.first[key] for key in one] for one in keys])
        within = np.concatenate([np.arange(d) for d in size])
        return np.asarray(np.repeat(first, size, axis=1) + within)

    def rise(self, C: Floats) -> Floats:
        """Return Y (N, n) of C (N, n)."""
        Y = C.copy()
        rise(self._fronts, Y)
        return Y

    def descend(self, Y: Floats) -> Floats:
        """Return X (N, n) of Y (N, n)."""
        X = Y.copy()
        descend(self._fronts, X)
        return X

    def covariances(self, keys: Iterable[int]) -> dict[int, Floats]:
        """Return the covariance (d, d) of each of these variables."""
        first = {self.first[key]: key for key in keys}
        wanted = np.full(self.total, -1)
        wanted[list(first)] = np.arange(len(first))
        found = np.zeros((len(first), LARGEST, LARGEST))
        none = Groups(np.full(self.total, -1), np.zeros((self.total, 1)), np.zeros(0, np.int64), np.zeros((0, 1)))
        spread_covariance(self._fronts, wanted, found, none, np.zeros((0, 1, 1)))
        size = (self._size[key] for key in first.values())
        return {key: one[:d, :d] for key, one, d in zip(first.values(), found, size, strict=True)}

    def split(self, X: Floats) -> dict[int, Floats]:
        """Split the rows of X (N, n) by variable."""
        return {key: X[first : first + self._size[key]] for key, first in self.first.items()}

    def quadratic_forms(self, groups: Groups) -> Floats:
        """Return G^T P G (F, n, n) of each group."""
        forms = np.zeros((len(groups.common), groups.G.shape[1], groups.G.shape[1]))
        nothing = np.zeros((0, LARGEST, LARGEST))
        spread_covariance(self._fronts, np.full(self.total, -1), nothing, groups, forms)
        return forms
