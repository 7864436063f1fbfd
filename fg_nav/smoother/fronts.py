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
def build_fronts(
    members: Ints, ends: Ints, size: Ints, first: Ints, row: Ints, column: Ints, value: Floats, most: int
) -> tuple[Fronts, Floats]:
    """Make the fronts of cliques, parents first, with variables `members` until `ends`, and r (N,), of all entries."""
    front_of, owned = _number_fronts(members, ends, len(size))
    shape = _shape_fronts(members, ends, owned, front_of, size, first, most)
    front_of_row, place = _place_rows(members, ends, owned, front_of, size)
    return _fill_rows(shape, front_of_row, place, row, column, value)


@njit(cache=True)
def _number_fronts(members: Ints, ends: Ints, count: int) -> tuple[Ints, Ints]:
    """Front (V,) of each variable, and how many of the members of each clique are its own, in no clique above."""
    front_of, owned = np.full(count, -1), np.zeros(len(ends), np.int64)
    begin, new = 0, 0
    for c in range(len(ends)):
        while begin + owned[c] < ends[c] and front_of[members[begin + owned[c]]] < 0:
            owned[c] += 1
        # The last of its own is eliminated last.
        for k in range(begin + owned[c] - 1, begin - 1, -1):
            front_of[members[k]] = new
            new += 1
        begin = ends[c]
    return front_of, owned


@njit(cache=True)
def _shape_fronts(members: Ints, ends: Ints, owned: Ints, front_of: Ints, size: Ints, first: Ints, most: int) -> Fronts:
    """Make the fronts without their rows."""
    count, begin, filled = len(size), 0, 0
    variable_of, begins, columns = np.empty(count, np.int64), np.zeros(count + 1, np.int64), np.empty(most, np.int64)
    parent, at = np.full(count, -1), np.zeros(count + 1, np.int64)
    for c in range(len(ends)):
        for k in range(begin + owned[c] - 1, begin - 1, -1):
            i = front_of[members[k]]
            variable_of[i] = members[k]
            for j in range(k, ends[c]):
                w = members[j]
                for column_of_w in range(first[w], first[w] + size[w]):
                    columns[filled] = column_of_w
                    filled += 1
                if j > k:
                    parent[i] = max(parent[i], front_of[w])
            begins[i + 1] = filled
            at[i + 1] = at[i] + size[members[k]] * (filled - begins[i])
        begin = ends[c]
    return Fronts(size[variable_of], first[variable_of], parent, begins, columns[:filled].copy(), at, np.empty(0))


@njit(cache=True)
def _place_rows(members: Ints, ends: Ints, owned: Ints, front_of: Ints, size: Ints) -> tuple[Ints, Ints]:
    """Front (N,) of each row of R, clique by clique, and its place there."""
    total = size.sum()
    front_of_row, place = np.empty(total, np.int64), np.empty(total, np.int64)
    begin, row = 0, 0
    for c in range(len(ends)):
        for k in range(begin, begin + owned[c]):
            for d in range(size[members[k]]):
                front_of_row[row], place[row] = front_of[members[k]], d
                row += 1
        begin = ends[c]
    return front_of_row, place


@njit(cache=True)
def _fill_rows(
    shape: Fronts, front_of_row: Ints, place: Ints, row: Ints, column: Ints, value: Floats
) -> tuple[Fronts, Floats]:
    """Put the entries of R into the rows of fronts, and those of r (N,): rows by their front and place in it."""
    size, first, parent, begins, columns, at, _ = shape
    rows, right, where, shown = np.zeros(at[len(size)]), np.zeros(len(place)), np.full(len(place), -1), -1
    for e in range(len(row)):
        i = front_of_row[row[e]]
        if column[e] >= len(place):
            right[columns[begins[i] + place[row[e]]]] = value[e]
            continue
        if i != shown:
            for k in range(begins[i], begins[i + 1]):
                where[columns[k]] = k - begins[i]
            shown = i
        width = begins[i + 1] - begins[i]
        rows[at[i] + place[row[e]] * width + where[column[e]]] = value[e]
    return Fronts(size, first, parent, begins, columns, at, rows), right


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
