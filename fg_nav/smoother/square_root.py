"""The square-root information of a solved walk as arrays, and the passes along it in compiled code.

Elimination by QR (`elimination`) leaves for each variable, of d dimensions, the rows of R x = r in it: an upper
triangle R_FF (d, d) on itself and R_FS (d, s) on those of its separator, which were eliminated later. They are fronts,
one a variable, those of the separator before it, and the one that comes last of these is its parent. Its separator is
among the parent's own variable and separator, so

    up     R^T Y = C     from the last front to the first,    each leaves C_S - R_FS^T Y_F to those of its separator,
    down   R X = Y       from the first to the last,          X_F = R_FF^-1 (Y_F - R_FS X_S),
    and    W = -R_FF^-1 R_FS,    P_FS = W P_SS,    P_FF = R_FF^-1 R_FF^-T + W P_SS W^T,

P the covariance, P_SS known from the parent. With a group of variables along a path of the tree, as those of a
footfall, comes the covariance K of all others there with G^T x of the group, and G^T P G: P G is added front by front.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.factors.residual import Keys
from fg_nav.smoother.front_covariances import Groups, Wanted, spread_covariance
from fg_nav.smoother.fronts import Fronts, back_substitute, forward_substitute


class SquareRoot:
    """R of a solved walk, of `total` columns; `step` (N,) is R^-1 r.

    It is made of the fronts, r (N,), and the keys and sizes (V,) of the variables, in the order of elimination.
    """

    def __init__(self, fronts: Fronts, right: Floats, keys: Keys, size: Ints) -> None:
        self._fronts, self._keys, self._order = fronts, keys, np.argsort(keys)
        self._known, self._begins, self._size = keys[self._order], np.cumsum(size) - size, size
        self.total, self._shift = len(right), np.uint64(0)
        self.step = self.back_substitute(right[:, None])[:, 0]

    @classmethod
    def of_nothing(cls) -> SquareRoot:
        """Return that of no variables."""
        none = np.zeros(0, np.int64)
        return cls(Fronts(none, none, none, none, none, none, np.zeros(0)), np.zeros(0), np.zeros(0, np.uint64), none)

    def shift_keys(self, shift: int) -> SquareRoot:
        """Return the same triangle to whom variables are known by their keys less `shift`: one foot of two."""
        shifted = copy(self)
        shifted._shift = np.uint64(shift)
        return shifted

    def find_columns(self, keys: Sequence[Sequence[int]] | Keys) -> Ints:
        """Return the columns (K, d) of the variables (K, n) of K factors of a kind."""
        place = self._order[np.searchsorted(self._known, np.asarray(keys, dtype=np.uint64) + self._shift)]
        size = self._size[place[0]]
        within = np.concatenate([np.arange(d) for d in size])
        return np.asarray(np.repeat(self._begins[place], size, axis=1) + within)

    def forward_substitute(self, C: Floats) -> Floats:
        """Return Y (N, n) of C (N, n)."""
        Y = C.copy()
        forward_substitute(self._fronts, Y)
        return Y

    def back_substitute(self, Y: Floats) -> Floats:
        """Return X (N, n) of Y (N, n)."""
        X = Y.copy()
        back_substitute(self._fronts, X)
        return X

    def covariances(self, keys: Iterable[int]) -> dict[int, Floats]:
        """Return the covariance (d, d) of each of these variables."""
        by_size: dict[int, list[int]] = {}
        for key in keys:
            size = self._size[self._order[np.searchsorted(self._known, np.uint64(key) + self._shift)]]
            by_size.setdefault(int(size), []).append(key)
        found: dict[int, Floats] = {}
        for of in by_size.values():
            found.update(zip(of, self.joint_covariances([[key] for key in of]), strict=True))
        return found

    def joint_covariances(self, keys: Sequence[Sequence[int]] | Keys) -> Floats:
        """Return the joint covariances (K, d, d) of the variables (K, n) of K factors of a kind, or of K variables.

        No two may have the same variable as their first in the order of elimination.
        """
        columns = self.find_columns(keys)
        wanted = np.full(self.total, -1)
        wanted[columns.min(axis=1)] = np.arange(len(columns))
        found = np.zeros((*columns.shape, columns.shape[1]))
        none = Groups(np.full(self.total, -1), np.zeros((self.total, 1)), np.zeros(0, np.int64), np.zeros((0, 1)))
        spread_covariance(self._fronts, Wanted(wanted, columns, found), none, np.zeros((0, 1, 1)))
        return found

    def split(self, X: Floats) -> dict[int, Floats]:
        """Split the rows of X (N, n) by variable."""
        ends = (self._begins + self._size).tolist()
        rows = zip(self._keys.tolist(), self._begins.tolist(), ends, strict=True)
        return {key: X[first:end] for key, first, end in rows}

    def quadratic_forms(self, groups: Groups) -> Floats:
        """Return G^T P G (F, n, n) of each group."""
        forms = np.zeros((len(groups.common), groups.G.shape[1], groups.G.shape[1]))
        nothing = Wanted(np.full(self.total, -1), np.zeros((0, 1), np.int64), np.zeros((0, 1, 1)))
        spread_covariance(self._fronts, nothing, groups, forms)
        return forms
