"""QR elimination of linear factors, variable by variable, in compiled code.

A linear factor is |A x - b|^2 in some variables. The variables are eliminated in a given order, each with a front: the
factors that no earlier variable has taken, and what is left of the fronts whose next variable it is, stacked and
brought to a triangle by Householder reflections,

    Q^T (A b) = (R r),     the rows of the variable itself: R_FF x_F + R_FS x_S = r_F, which are kept (`fronts`),
                0 e        the others: a triangle on its separator S, which goes to the front of the next of these,
                           and e, whose squares over all fronts are twice the error at the minimum.

What comes up from the first such front is a triangle in its columns already, so only the rows that are new are
reflected into it, by a reflection for each column of one row of the triangle and all new rows (Golub and Van Loan 2013,
section 5.1; LAPACK's `tpqrt`). On a chain that is half the work of a front that is reflected whole.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.smoother.fronts import Fronts
from fg_nav.system.compiled import njit

BLOCK_ROWS = 32
"""New rows that are reflected into a triangle together."""

ROUNDING = 1e-14
"""Of the norm of a column, below which what is left on the diagonal is none."""


class Factors(NamedTuple):
    """F linear factors.

    ======= ====== ==================================================================
    begins  (F+1,) where the variables of each are in `member`
    member  (m,)   variables, by their places in the order of elimination
    rows    (F,)   its rows
    at      (F+1,) where its (A b) is in `values`, row by row
    values  (v,)   A by its variables one after the other, and b
    ======= ====== ==================================================================
    """

    begins: Ints
    member: Ints
    rows: Ints
    at: Ints
    values: Floats


class Queue(NamedTuple):
    """What each variable (V,) takes up: its first factor, or first front below it, and then that after each; or -1."""

    first_factor: Ints
    next_factor: Ints
    first_front: Ints
    next_front: Ints


class Members(NamedTuple):
    """Variables `member` of the fronts from `begin` on, up to `ends` (C,) of each, its own first, in their order."""

    begin: int
    ends: Ints
    member: Ints


@njit(cache=True)
def eliminate_factors(
    factors: Factors, size: Ints, begin: int, end: int
) -> tuple[Fronts, Floats, float, Factors, bool]:
    """Eliminate the variables `begin <= v < end` of those of sizes (V,), which are all that factors join.

    Returns their fronts, parents first, r of all columns (N,), twice the error, the factors that are left in the
    others, and whether each is determined.
    """
    queue = _queue_factors(factors, len(size))
    members, parent = _gather_members(factors, queue, size, begin, end)
    fronts = _shape_fronts(members, parent, size, end)
    left, slot, slots = _plan_rest(members, parent, queue, size, end)
    right, columns = np.zeros(size.sum()), _first_columns(size)
    work, kept = _prepare(factors, fronts, len(right), slots)
    error = 0.0
    for v in range(begin, end):
        i = end - 1 - v
        d, n = fronts.size[i], _clear(fronts, i, work)
        error += _take_fronts(queue, v, fronts, end, kept, slot, work, n)
        error += _take_factors(factors, queue.first_factor[v], queue.next_factor, columns, work, n)
        if not _keep_rows(fronts, i, work, right):
            return fronts, right, error, left, False
        if n > d and parent[v - begin] < end:
            _copy_triangle(work.triangle, d, n, kept[slot[v - begin]])
        elif n > d:
            k = slot[v - begin]
            _copy_triangle(work.triangle, d, n, left.values[left.at[k] : left.at[k + 1]].reshape(n - d, n - d + 1))
    return fronts, right, error, left, True


@njit(cache=True)
def _first_columns(size: Ints) -> Ints:
    """First column (V+1,) of each variable, and their number."""
    first = np.zeros(len(size) + 1, np.int64)
    for v in range(len(size)):
        first[v + 1] = first[v] + size[v]
    return first


@njit(cache=True)
def _queue_factors(factors: Factors, count: int) -> Queue:
    """Queue each factor at its first variable."""
    queue = Queue(np.full(count, -1), np.full(len(factors.rows), -1), np.full(count, -1), np.full(count, -1))
    for f in range(len(factors.rows) - 1, -1, -1):
        v = factors.member[factors.begins[f]]
        for k in range(factors.begins[f], factors.begins[f + 1]):
            v = min(v, factors.member[k])
        queue.next_factor[f] = queue.first_factor[v]
        queue.first_factor[v] = f
    return queue


@njit(cache=True)
def _gather_members(factors: Factors, queue: Queue, size: Ints, begin: int, end: int) -> tuple[Members, Ints]:
    """Gather the variables of the fronts, and the second of each, its parent, or -1."""
    stamp, front, parent = np.full(len(size), -1), np.empty(len(size), np.int64), np.full(end - begin, -1)
    members, filled = Members(begin, np.zeros(end - begin, np.int64), np.empty(16 * (end - begin), np.int64)), 0
    for v in range(begin, end):
        many = _gather_front(factors, queue, v, members, stamp, front)
        if filled + many > len(members.member):
            members = Members(begin, members.ends, _grow(members.member, filled + many))
        for k in range(many):
            members.member[filled + k] = front[k]
        filled += many
        members.ends[v - begin] = filled
        if many > 1:
            parent[v - begin] = front[1]
            queue.next_front[v] = queue.first_front[front[1]]
            queue.first_front[front[1]] = v
    return members, parent


@njit(cache=True)
def _grow(array: Ints, least: int) -> Ints:
    """Return a longer array that begins with this one."""
    out = np.empty(max(2 * len(array), least), np.int64)
    for i in range(len(array)):
        out[i] = array[i]
    return out


@njit(cache=True)
def _gather_front(factors: Factors, queue: Queue, v: int, members: Members, stamp: Ints, front: Ints) -> int:
    """Write the variables of a front in their order, `v` the first, and return how many; `stamp` (V,) to work in."""
    front[0], stamp[v], many = v, v, 1
    f = queue.first_factor[v]
    while f >= 0:
        for k in range(factors.begins[f], factors.begins[f + 1]):
            many = _insert(factors.member[k], v, stamp, front, many)
        f = queue.next_factor[f]
    c = queue.first_front[v]
    while c >= 0:
        for k in range(_begin_of(members, c) + 1, members.ends[c - members.begin]):
            many = _insert(members.member[k], v, stamp, front, many)
        c = queue.next_front[c]
    return many


@njit(cache=True)
def _begin_of(members: Members, v: int) -> int:
    """Where the variables of a front begin."""
    return members.ends[v - members.begin - 1] if v > members.begin else 0


@njit(cache=True)
def _insert(variable: int, v: int, stamp: Ints, front: Ints, many: int) -> int:
    """Insert a variable into the sorted front of `v`, unless it is there; return how many it has."""
    if stamp[variable] == v:
        return many
    stamp[variable] = v
    k = many
    while front[k - 1] > variable:
        front[k] = front[k - 1]
        k -= 1
    front[k] = variable
    return many + 1


@njit(cache=True)
def _shape_fronts(members: Members, parent: Ints, size: Ints, end: int) -> Fronts:
    """Make the fronts, parents first, their rows not filled."""
    count, first, filled = len(parent), _first_columns(size), 0
    begins, at, column = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64), np.empty(0, np.int64)
    sizes, firsts, parents = np.empty(count, np.int64), np.empty(count, np.int64), np.full(count, -1)
    for i in range(count):
        v = end - 1 - i
        sizes[i], firsts[i] = size[v], first[v]
        if 0 <= parent[v - members.begin] < end:
            parents[i] = end - 1 - parent[v - members.begin]
        for k in range(_begin_of(members, v), members.ends[v - members.begin]):
            w = members.member[k]
            if filled + size[w] > len(column):
                column = _grow(column, 64 * count)
            for c in range(first[w], first[w + 1]):
                column[filled] = c
                filled += 1
        begins[i + 1] = filled
        at[i + 1] = at[i] + size[v] * (filled - begins[i])
    return Fronts(sizes, firsts, parents, begins, column[:filled].copy(), at, np.empty(at[count]))


@njit(cache=True)
def _plan_rest(members: Members, parent: Ints, queue: Queue, size: Ints, end: int) -> tuple[Factors, Ints, int]:
    """Plan where the triangle of each front (C,) goes: to a place of those that are used again, or to a factor left.

    Returns the factors left, without their numbers, the place or factor, and the number of places.
    """
    count, places, lefts, frees, filled = len(parent), 0, 0, 0, 0
    slot, free, rows = np.full(count, -1), np.empty(count, np.int64), np.zeros(count, np.int64)
    begins, at, member = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64), np.empty(0, np.int64)
    for c in range(count):
        v = members.begin + c
        below = queue.first_front[v]
        while below >= 0:
            free[frees] = slot[below - members.begin]
            frees += 1
            below = queue.next_front[below]
        if parent[c] >= end:
            slot[c] = lefts
            for k in range(_begin_of(members, v) + 1, members.ends[c]):
                if filled == len(member):
                    member = _grow(member, 64)
                member[filled] = members.member[k]
                rows[lefts] += size[members.member[k]]
                filled += 1
            lefts += 1
            begins[lefts] = filled
            at[lefts] = at[lefts - 1] + rows[lefts - 1] * (rows[lefts - 1] + 1)
        elif parent[c] >= 0:
            frees -= 1
            if frees < 0:
                slot[c], frees, places = places, 0, places + 1
            else:
                slot[c] = free[frees]
    left = Factors(begins[: lefts + 1], member[:filled], rows[:lefts], at[: lefts + 1], np.zeros(at[lefts]))
    return left, slot, places


class Work(NamedTuple):
    """To work in: the triangle of a front (w, w + 1), new rows (r, w + 1), and the place of each column (N,) in it."""

    triangle: Floats
    new: Floats
    place: Ints


@njit(cache=True)
def _prepare(factors: Factors, fronts: Fronts, columns: int, slots: int) -> tuple[Work, Floats]:
    """Make what there is to work in, and the places of triangles."""
    widest, most = 0, BLOCK_ROWS
    for i in range(len(fronts.size)):
        widest = max(widest, fronts.begins[i + 1] - fronts.begins[i])
    for rows in factors.rows:
        most = max(most, rows)
    most = max(most, widest)
    work = Work(np.zeros((widest, widest + 1)), np.zeros((most, widest + 1)), np.zeros(columns, np.int64))
    return work, np.zeros((slots, widest, widest + 1))


@njit(cache=True)
def _clear(fronts: Fronts, i: int, work: Work) -> int:
    """Clear the triangle for a front, note where its columns are, and return how many it has."""
    begin = fronts.begins[i]
    n = int(fronts.begins[i + 1] - begin)
    for k in range(n):
        work.place[fronts.column[begin + k]] = k
        for j in range(n + 1):
            work.triangle[k, j] = 0.0
    return n


@njit(cache=True)
def _take_fronts(queue: Queue, v: int, fronts: Fronts, end: int, kept: Floats, slot: Ints, work: Work, n: int) -> float:
    """Take what is left of the fronts below, the first as the triangle, the others as rows; return twice an error."""
    below, error = queue.first_front[v], 0.0
    if below >= 0:
        _place(kept[slot[len(slot) - end + below]], fronts, end - 1 - below, work.place, work.triangle, n, True)
        below = queue.next_front[below]
    while below >= 0:
        rows = _place(kept[slot[len(slot) - end + below]], fronts, end - 1 - below, work.place, work.new, n, False)
        error += _reflect(work, n, rows)
        below = queue.next_front[below]
    return error


@njit(cache=True)
def _place(left: Floats, fronts: Fronts, below: int, place: Ints, out: Floats, n: int, as_triangle: bool) -> int:
    """Put what is left of the front `below` into the columns of a front, of which there are `n`; return its rows."""
    begin = fronts.begins[below] + fronts.size[below]
    rows = int(fronts.begins[below + 1] - begin)
    for k in range(rows):
        to = place[fronts.column[begin + k]] if as_triangle else k
        if not as_triangle:
            for j in range(n):
                out[to, j] = 0.0
        for j in range(k, rows):
            out[to, place[fronts.column[begin + j]]] = left[k, j]
        out[to, n] = left[k, rows]
    return rows


@njit(cache=True)
def _take_factors(factors: Factors, f: int, after: Ints, columns: Ints, work: Work, n: int) -> float:
    """Take the factors of a queue that begins with `f`; return twice an error."""
    rows, error = 0, 0.0
    while f >= 0:
        if rows + factors.rows[f] > len(work.new):
            error += _reflect(work, n, rows)
            rows = 0
        rows = _add_factor(factors, f, columns, work, n, rows)
        f = after[f]
    return error + _reflect(work, n, rows)


@njit(cache=True)
def _add_factor(factors: Factors, f: int, columns: Ints, work: Work, n: int, rows: int) -> int:
    """Add the rows of a factor to the new ones; return how many they are."""
    e = factors.at[f]
    for k in range(rows, rows + factors.rows[f]):
        for j in range(n):
            work.new[k, j] = 0.0
        for m in range(factors.begins[f], factors.begins[f + 1]):
            v = factors.member[m]
            for column in range(columns[v], columns[v + 1]):
                work.new[k, work.place[column]] = factors.values[e]
                e += 1
        work.new[k, n] = factors.values[e]
        e += 1
    return rows + int(factors.rows[f])


@njit(cache=True)
def _reflect(work: Work, n: int, rows: int) -> float:
    """Reflect new rows into the triangle of `n` columns; return the sum of the squares of what is left of b."""
    triangle, new, _ = work
    dot = np.empty(n + 1)
    for k in range(n):
        square = 0.0
        for r in range(rows):
            square += new[r, k] * new[r, k]
        if square == 0.0:
            continue
        top = triangle[k, k]
        length = np.sqrt(top * top + square)
        head = top + length if top >= 0.0 else top - length
        scale = 2.0 / (head * head + square)
        for j in range(k + 1, n + 1):
            dot[j] = head * triangle[k, j]
        for r in range(rows):
            x = new[r, k]
            for j in range(k + 1, n + 1):
                dot[j] += x * new[r, j]
        for j in range(k + 1, n + 1):
            dot[j] *= scale
            triangle[k, j] -= head * dot[j]
        for r in range(rows):
            x = new[r, k]
            for j in range(k + 1, n + 1):
                new[r, j] -= x * dot[j]
        triangle[k, k] = -length if top >= 0.0 else length
    error = 0.0
    for r in range(rows):
        error += new[r, n] * new[r, n]
    return error


@njit(cache=True)
def _keep_rows(fronts: Fronts, i: int, work: Work, right: Floats) -> bool:
    """Keep the rows of a front's own variable, and its r; return whether it is determined."""
    triangle, d, n = work.triangle, fronts.size[i], fronts.begins[i + 1] - fronts.begins[i]
    for k in range(n):
        square = 0.0
        for row in range(k + 1):
            square += triangle[row, k] ** 2
        if not abs(triangle[k, k]) > ROUNDING * np.sqrt(square):
            triangle[k, k] = 0.0
            if k < d:
                return False
    for k in range(d):
        right[fronts.first[i] + k] = triangle[k, n]
        for j in range(n):
            fronts.rows[fronts.at[i] + k * n + j] = triangle[k, j]
    return True


@njit(cache=True)
def _copy_triangle(triangle: Floats, d: int, n: int, out: Floats) -> None:
    """Copy the triangle behind the first `d` of `n` columns."""
    for k in range(d, n):
        for j in range(k, n + 1):
            out[k - d, j - d] = triangle[k, j]
