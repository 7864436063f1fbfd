"""R of a solved walk as fronts, and the passes up and down along them in compiled code: see `square_root`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.system.compiled import njit


class Fronts(NamedTuple):
    """Rows of R, front by front.

    ======= ====== ======================================================================
    size    (V,)   dimensions d of the variable
    first   (V,)   its first column in the arrays of all
    parent  (V,)   front of its parent, -1 without a separator
    begins  (V+1,) where its columns are in `column`: its own d first
    column  (c,)   columns
    at      (V,)   where its rows (d, columns) are in `rows`
    rows    (r,)   R_FF and R_FS, row by row
    ======= ====== ======================================================================
    """

    size: Ints
    first: Ints
    parent: Ints
    begins: Ints
    column: Ints
    at: Ints
    rows: Floats


@njit(cache=True)
def get_front(fronts: Fronts, i: int) -> tuple[int, Ints, Floats]:
    """Dimensions, columns and rows of a front."""
    d, columns = fronts.size[i], fronts.column[fronts.begins[i] : fronts.begins[i + 1]]
    return d, columns, fronts.rows[fronts.at[i] : fronts.at[i] + d * len(columns)].reshape(d, len(columns))


@njit(cache=True)
def rise(fronts: Fronts, C: Floats) -> None:
    """Replace C (N, n) by Y."""
    for i in range(len(fronts.size) - 1, -1, -1):
        d, columns, A = get_front(fronts, i)
        for k in range(d):
            for n in range(C.shape[1]):
                y = C[columns[k], n] / A[k, k]
                C[columns[k], n] = y
                if y != 0.0:
                    for j in range(k + 1, len(columns)):
                        C[columns[j], n] -= A[k, j] * y


@njit(cache=True)
def descend(fronts: Fronts, Y: Floats) -> None:
    """Replace Y (N, n) by X."""
    for i in range(len(fronts.size)):
        d, columns, A = get_front(fronts, i)
        for k in range(d - 1, -1, -1):
            for n in range(Y.shape[1]):
                left = Y[columns[k], n]
                for j in range(k + 1, len(columns)):
                    left -= A[k, j] * Y[columns[j], n]
                Y[columns[k], n] = left / A[k, k]


@njit(cache=True)
def log_diagonal(fronts: Fronts) -> float:
    """log|R| of the variables of the fronts."""
    total = 0.0
    for i in range(len(fronts.size)):
        d, _, A = get_front(fronts, i)
        for k in range(d):
            total += np.log(abs(A[k, k]))
    return total
