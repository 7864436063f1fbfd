"""R of a solved walk as fronts, and the passes up and down along them in compiled code: see `square_root`.

The rows of a long walk lie in a file (`fg_nav.system.spilled`). A pass goes along them in parts, and lets go of what it
has looked at behind each.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.system.compiled import njit
from fg_nav.system.spilled import drop_pages

MAX_FRONTS = 1 << 15  # Of a part: some 40 MB of rows.


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


def list_parts(begin: int, end: int) -> Iterator[tuple[int, int]]:
    """Yield where parts of `begin <= i < end` begin and end; pages of files are let go of behind each."""
    for first in range(begin, end, MAX_FRONTS):
        yield first, min(first + MAX_FRONTS, end)
        drop_pages()


def forward_substitute(fronts: Fronts, C: Floats) -> None:
    """Replace C (N, n) by Y."""
    count = len(fronts.size)
    for first, end in list_parts(0, count):
        _forward_substitute(fronts, C, count - end, count - first)


@njit(cache=True)
def _forward_substitute(fronts: Fronts, C: Floats, first: int, end: int) -> None:
    """Go up along the fronts `first <= i < end`."""
    for i in range(end - 1, first - 1, -1):
        d, columns, A = get_front(fronts, i)
        for k in range(d):
            for n in range(C.shape[1]):
                y = C[columns[k], n] / A[k, k]
                C[columns[k], n] = y
                if y != 0.0:
                    for j in range(k + 1, len(columns)):
                        C[columns[j], n] -= A[k, j] * y


def back_substitute(fronts: Fronts, Y: Floats) -> None:
    """Replace Y (N, n) by X."""
    for first, end in list_parts(0, len(fronts.size)):
        _back_substitute(fronts, Y, first, end)


@njit(cache=True)
def _back_substitute(fronts: Fronts, Y: Floats, first: int, end: int) -> None:
    """Go down along the fronts `first <= i < end`."""
    for i in range(first, end):
        d, columns, A = get_front(fronts, i)
        for k in range(d - 1, -1, -1):
            for n in range(Y.shape[1]):
                left = Y[columns[k], n]
                for j in range(k + 1, len(columns)):
                    left -= A[k, j] * Y[columns[j], n]
                Y[columns[k], n] = left / A[k, k]


def log_diagonal(fronts: Fronts) -> float:
    """log|R| of the variables of the fronts."""
    total = 0.0
    for first, end in list_parts(0, len(fronts.size)):
        total = _add_log_diagonal(fronts, total, first, end)
    return total


@njit(cache=True)
def _add_log_diagonal(fronts: Fronts, total: float, first: int, end: int) -> float:
    """Add that of the fronts `first <= i < end`."""
    for i in range(first, end):
        d, _, A = get_front(fronts, i)
        for k in range(d):
            total += np.log(abs(A[k, k]))
    return total
