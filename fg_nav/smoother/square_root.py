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
from typing import NamedTuple

import gtsam
import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.compiled import njit

LARGEST = 8
"""Dimensions of a variable."""


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
        self._fronts, right = _build(members, ends, size, first, *place, value, most)
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
        _rise(self._fronts, Y)
        return Y

    def descend(self, Y: Floats) -> Floats:
        """Return X (N, n) of Y (N, n)."""
        X = Y.copy()
        _descend(self._fronts, X)
        return X

    def covariances(self, keys: Iterable[int]) -> dict[int, Floats]:
        """Return the covariance (d, d) of each of these variables."""
        first = {self.first[key]: key for key in keys}
        wanted = np.full(self.total, -1)
        wanted[list(first)] = np.arange(len(first))
        found = np.zeros((len(first), LARGEST, LARGEST))
        none = Groups(np.full(self.total, -1), np.zeros((self.total, 1)), np.zeros(0, np.int64), np.zeros((0, 1)))
        _spread(self._fronts, wanted, found, none, np.zeros((0, 1, 1)))
        size = (self._size[key] for key in first.values())
        return {key: one[:d, :d] for key, one, d in zip(first.values(), found, size, strict=True)}

    def split(self, X: Floats) -> dict[int, Floats]:
        """Split the rows of X (N, n) by variable."""
        return {key: X[first : first + self._size[key]] for key, first in self.first.items()}

    def quadratic_forms(self, groups: Groups) -> Floats:
        """Return G^T P G (F, n, n) of each group."""
        forms = np.zeros((len(groups.common), groups.G.shape[1], groups.G.shape[1]))
        nothing = np.zeros((0, LARGEST, LARGEST))
        _spread(self._fronts, np.full(self.total, -1), nothing, groups, forms)
        return forms


class Groups(NamedTuple):
    """Groups of variables, each along a path of the tree, and its n sums G^T x.

    `of_column` (N,) group of each column, -1 in none, `G` (N, n) of all columns, and one column that a group has in
    common with others: `common` (F,), `by_common` (F, n).
    """

    of_column: Ints
    G: Floats
    common: Ints
    by_common: Floats


@njit(cache=True)
def _build(
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
def _front(fronts: Fronts, i: int) -> tuple[int, Ints, Floats]:
    """Dimensions, columns and rows of a front."""
    d, columns = fronts.size[i], fronts.column[fronts.begins[i] : fronts.begins[i + 1]]
    return d, columns, fronts.rows[fronts.at[i] : fronts.at[i] + d * len(columns)].reshape(d, len(columns))


@njit(cache=True)
def _rise(fronts: Fronts, C: Floats) -> None:
    """Replace C (N, n) by Y."""
    for i in range(len(fronts.size) - 1, -1, -1):
        d, columns, A = _front(fronts, i)
        for k in range(d):
            for n in range(C.shape[1]):
                y = C[columns[k], n] / A[k, k]
                C[columns[k], n] = y
                if y != 0.0:
                    for j in range(k + 1, len(columns)):
                        C[columns[j], n] -= A[k, j] * y


@njit(cache=True)
def _descend(fronts: Fronts, Y: Floats) -> None:
    """Replace Y (N, n) by X."""
    for i in range(len(fronts.size)):
        d, columns, A = _front(fronts, i)
        for k in range(d - 1, -1, -1):
            for n in range(Y.shape[1]):
                left = Y[columns[k], n]
                for j in range(k + 1, len(columns)):
                    left -= A[k, j] * Y[columns[j], n]
                Y[columns[k], n] = left / A[k, k]


@njit(cache=True)
def _count_children(parent: Ints) -> Ints:
    """Count the children (V,) of each front."""
    children = np.zeros(len(parent), np.int64)
    for p in parent:
        if p >= 0:
            children[p] += 1
    return children


@njit(cache=True)
def _plan_slots(parent: Ints) -> tuple[Ints, int]:
    """Place of each front's covariance, used again when all its children are done, and how many there are."""
    children, slot = _count_children(parent), np.zeros(len(parent), np.int64)
    free, frees, count = np.empty(len(parent), np.int64), 0, 0
    for i in range(len(parent)):
        if frees > 0:
            frees -= 1
            slot[i] = free[frees]
        else:
            slot[i] = count
            count += 1
        p = parent[i]
        if p >= 0:
            children[p] -= 1
            if children[p] == 0:
                free[frees] = slot[p]
                frees += 1
        if children[i] == 0:
            free[frees] = slot[i]
            frees += 1
    return slot, count


@njit(cache=True)
def _spread(fronts: Fronts, wanted: Ints, found: Floats, groups: Groups, forms: Floats) -> None:
    """Write the covariances of variables whose first column is `wanted`, and the forms of groups."""
    slot, slots = _plan_slots(fronts.parent)
    widest, n = _find_widest(fronts.begins), groups.G.shape[1]
    P, K, active = np.zeros((slots, widest, widest)), np.zeros((slots, widest, n)), np.full(slots, -1)
    where = np.full(len(wanted), -1)
    for i in range(len(fronts.size)):
        p, here = fronts.parent[i], slot[i]
        d, columns, A = _front(fronts, i)
        above = _find_above(fronts, p, columns, d, where)
        joint, cross = _join(A, d, P[slot[p]], above), np.zeros((len(columns), n))
        group = active[slot[p]] if p >= 0 else -1
        active[here] = _follow_group(groups, group, columns, A, d, K[slot[p]], above, joint, cross, forms)
        _copy(joint, P[here])
        _copy(cross, K[here])
        if wanted[columns[0]] >= 0:
            _copy(joint[:d, :d], found[wanted[columns[0]]])


@njit(cache=True)
def _find_widest(begins: Ints) -> int:
    """Most columns of a front."""
    widest = 0
    for i in range(len(begins) - 1):
        widest = max(widest, begins[i + 1] - begins[i])
    return widest


@njit(cache=True)
def _find_above(fronts: Fronts, parent: int, columns: Ints, d: int, where: Ints) -> Ints:
    """Places (s,) of a front's separator among its parent's columns; `where` (N,) is to work in."""
    above = np.zeros(len(columns) - d, np.int64)
    if parent >= 0:
        for k in range(fronts.begins[parent], fronts.begins[parent + 1]):
            where[fronts.column[k]] = k - fronts.begins[parent]
        for k in range(len(above)):
            above[k] = where[columns[d + k]]
    return above


@njit(cache=True)
def _follow_group(
    groups: Groups,
    group: int,
    columns: Ints,
    A: Floats,
    d: int,
    parent: Floats,
    above: Ints,
    joint: Floats,
    cross: Floats,
    forms: Floats,
) -> int:
    """Add a front to the sums of its group, where it has one, or pass on its parent's; return which group it is."""
    own: int = groups.of_column[columns[0]]
    if group >= 0 and (own == group or own < 0):
        _cross(A, d, parent, above, cross)
    elif own >= 0:
        _begin_group(groups, own, columns, joint, cross, forms)
    if own < 0:
        return group
    _add_to_group(groups, own, columns, d, joint, cross, forms)
    return int(own)


@njit(cache=True)
def _copy(block: Floats, to: Floats) -> None:
    """Copy a matrix into the corner of another: in loops, which are compiled sooner than slices."""
    for j in range(block.shape[0]):
        for k in range(block.shape[1]):
            to[j, k] = block[j, k]


@njit(cache=True)
def _join(A: Floats, d: int, parent: Floats, above: Ints) -> Floats:
    """Joint covariance of a front's own variable and its separator, at rows `above` of its parent's."""
    s = len(above)
    joint = np.zeros((d + s, d + s))
    for j in range(s):
        for k in range(s):
            joint[d + j, d + k] = parent[above[j], above[k]]
    # From the last row on: x_k = (r_k - sum A_kj x_j) / A_kk, r of unit covariance.
    for k in range(d - 1, -1, -1):
        for column in range(k + 1, d + s):
            total = 0.0
            for j in range(k + 1, d + s):
                total -= A[k, j] * joint[j, column]
            joint[k, column] = total / A[k, k]
            joint[column, k] = joint[k, column]
        total = 1.0 / A[k, k]
        for j in range(k + 1, d + s):
            total -= A[k, j] * joint[j, k]
        joint[k, k] = total / A[k, k]
    return joint


@njit(cache=True)
def _cross(A: Floats, d: int, parent: Floats, above: Ints, cross: Floats) -> None:
    """Write the covariance (d + s, n) of a front's variables with the sums of a group, from its parent's."""
    for n in range(cross.shape[1]):
        for j in range(len(above)):
            cross[d + j, n] = parent[above[j], n]
        for k in range(d - 1, -1, -1):
            total = 0.0
            for j in range(k + 1, len(cross)):
                total -= A[k, j] * cross[j, n]
            cross[k, n] = total / A[k, k]


@njit(cache=True)
def _begin_group(groups: Groups, group: int, columns: Ints, joint: Floats, cross: Floats, forms: Floats) -> None:
    """Begin the sums of a group with what it has in common with others."""
    by = groups.by_common[group]
    for k in range(len(columns)):
        if columns[k] == groups.common[group]:
            for n in range(len(by)):
                for j in range(len(columns)):
                    cross[j, n] = joint[j, k] * by[n]
                for m in range(len(by)):
                    forms[group, n, m] = joint[k, k] * by[n] * by[m]


@njit(cache=True)
def _add_to_group(
    groups: Groups, group: int, columns: Ints, d: int, joint: Floats, cross: Floats, forms: Floats
) -> None:
    """Add a front's own variable to the sums of its group."""
    for k in range(d):
        g = groups.G[columns[k]]
        for n in range(len(g)):
            for m in range(len(g)):
                forms[group, n, m] += g[n] * cross[k, m] + cross[k, n] * g[m] + joint[k, k] * g[n] * g[m]
        for n in range(len(g)):
            for j in range(len(columns)):
                cross[j, n] += joint[j, k] * g[n]
