"""The covariance of a solved walk, from the root of its tree down in compiled code: `square_root` has the equations.

What is asked for is kept, and the rest forgotten once no child needs it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.smoother.fronts import Fronts, get_front, list_parts
from fg_nav.system.compiled import njit


class Wanted(NamedTuple):
    """Joint covariances that are asked for, each of columns of one front.

    `of_column` (N,) number of that whose first column this is, or -1, `columns` (K, d), `found` (K, d, d) to write.
    """

    of_column: Ints
    columns: Ints
    found: Floats


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


class _Above(NamedTuple):
    """What is kept of fronts that children still need, in the place `slot` (V,) of each of the P places there are.

    Covariances P (P, w, w), of the front's variables with the sums of its group K (P, w, n), and which group that is,
    `active` (P,), or -1. `where` (N,) is to work in.
    """

    slot: Ints
    P: Floats
    K: Floats
    active: Ints
    where: Ints


def spread_covariance(fronts: Fronts, wanted: Wanted, groups: Groups, forms: Floats) -> None:
    """Write the covariances that are wanted, and the forms of groups."""
    slot, slots = _plan_slots(fronts.parent)
    widest, n = _find_widest(fronts.begins), groups.G.shape[1]
    P, K, active = np.zeros((slots, widest, widest)), np.zeros((slots, widest, n)), np.full(slots, -1)
    above = _Above(slot, P, K, active, np.full(len(wanted.of_column), -1))
    for first, end in list_parts(0, len(fronts.size)):
        _spread(fronts, wanted, groups, forms, above, first, end)


@njit(cache=True)
def _spread(fronts: Fronts, wanted: Wanted, groups: Groups, forms: Floats, kept: _Above, first: int, end: int) -> None:
    """Go down along the fronts `first <= i < end`."""
    slot, P, K, active, where = kept
    n = groups.G.shape[1]
    for i in range(first, end):
        p, here = fronts.parent[i], slot[i]
        d, columns, A = get_front(fronts, i)
        above = _find_above(fronts, p, columns, d, where)
        joint, cross = _join(A, d, P[slot[p]], above), np.zeros((len(columns), n))
        group = active[slot[p]] if p >= 0 else -1
        active[here] = _follow_group(groups, group, columns, A, d, K[slot[p]], above, joint, cross, forms)
        _copy(joint, P[here])
        _copy(cross, K[here])
        if wanted.of_column[columns[0]] >= 0:
            _pick(joint, columns, wanted, wanted.of_column[columns[0]], where)


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
def _pick(joint: Floats, columns: Ints, wanted: Wanted, number: int, where: Ints) -> None:
    """Write the part of a front's joint covariance that is wanted; `where` (N,) is to work in."""
    for k in range(len(columns)):
        where[columns[k]] = k
    of = wanted.columns[number]
    for j in range(len(of)):
        for k in range(len(of)):
            wanted.found[number, j, k] = joint[where[of[j]], where[of[k]]]


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
