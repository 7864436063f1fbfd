"""QR elimination of linear factors, variable by variable, in compiled code.

A linear factor is |A x - b|^2 in some variables. The variables are eliminated in a given order, each with a front: the
factors that no earlier variable has taken, and what is left of the fronts whose next variable it is, stacked and
brought to a triangle by Householder reflections,

    Q^T (A b) = (R r),     the rows of the variable itself: R_FF x_F + R_FS x_S = r_F, which are kept (`Fronts`),
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
from fg_nav.system.compiled import njit, unliteral

BLOCK_ROWS = 32  # New rows that are reflected into a triangle together.
ROUNDING = 1e-14  # Of the norm of a column, below which what is left on the diagonal is none.


class Fronts(NamedTuple):
    """Rows of R, front by front."""

    size: Ints  # (V,) dimensions d of the variable.
    first: Ints  # (V,) its first column in the arrays of all.
    parent: Ints  # (V,) front of its parent, -1 without a separator.
    begins: Ints  # (V+1,) where its columns are in `column`: its own d first.
    column: Ints  # (c,) columns.
    at: Ints  # (V,) where its rows (d, columns) are in `rows`.
    rows: Floats  # (r,) R_FF and R_FS, row by row.


@njit(cache=True)
def get_front(fronts: Fronts, i: int) -> tuple[int, Ints, Floats]:
    """Dimensions, columns and rows of a front."""
    d, columns = fronts.size[i], fronts.column[fronts.begins[i] : fronts.begins[i + 1]]
    return d, columns, fronts.rows[fronts.at[i] : fronts.at[i] + d * len(columns)].reshape(d, len(columns))


@njit(cache=True)
def forward_substitute(fronts: Fronts, C: Floats) -> None:
    """Solve R^T Y = C in place, C (N, n), children before parents."""
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
def back_substitute(fronts: Fronts, Y: Floats) -> None:
    """Solve R X = Y in place, Y (N, n), parents before children."""
    for i in range(len(fronts.size)):
        d, columns, A = get_front(fronts, i)
        for k in range(d - 1, -1, -1):
            for n in range(Y.shape[1]):
                left = Y[columns[k], n]
                for j in range(k + 1, len(columns)):
                    left -= A[k, j] * Y[columns[j], n]
                Y[columns[k], n] = left / A[k, k]


@njit(cache=True)
def sum_log_diagonal(fronts: Fronts) -> float:
    """Return log|R|."""
    total = 0.0
    for i in range(len(fronts.size)):
        d, _, A = get_front(fronts, i)
        for k in range(d):
            total += np.log(abs(A[k, k]))
    return total


class Factors(NamedTuple):
    """F linear factors."""

    begins: Ints  # (F+1,) where the variables of each are in `member`.
    member: Ints  # (m,) variables, by their places in the order of elimination.
    rows: Ints  # (F,) its rows.
    at: Ints  # (F+1,) where its (A b) is in `values`, row by row.
    values: Floats  # (v,) A by its variables one after the other, and b.


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


class Plan(NamedTuple):
    """How the variables from `begin` on, up to `end`, are eliminated."""

    begin: int
    end: int
    queue: Queue  # What each takes up.
    parent: Ints  # (C,) of each.
    slot: Ints  # (C,) where the triangle of its front goes: to one of `slots` places, or to the factors left.
    slots: int
    columns: Ints  # (V+1,) first column of each of all variables.


@njit(cache=True)
def plan_elimination(factors: Factors, size: Ints, begin: int, end: int) -> tuple[Plan, Fronts, Factors]:
    """Plan the elimination of `begin <= v < end`: return plan, fronts and factors left, without their numbers."""
    # Each factor is queued at its first variable.
    count = len(size)
    queue = Queue(np.full(count, -1), np.full(len(factors.rows), -1), np.full(count, -1), np.full(count, -1))
    for f in range(len(factors.rows) - 1, -1, -1):
        v = factors.member[factors.begins[f]]
        for k in range(factors.begins[f], factors.begins[f + 1]):
            v = min(v, factors.member[k])
        queue.next_factor[f] = queue.first_factor[v]
        queue.first_factor[v] = f
    members, parent = _gather_members(factors, queue, size, begin, end)
    fronts = _shape_fronts(members, parent, size, end)
    left, slot, slots = _plan_rest(members, parent, queue, size, end)
    return Plan(begin, end, queue, parent, slot, slots, first_columns(size)), fronts, left


@njit(cache=True)
def first_columns(size: Ints) -> Ints:
    """First column (V+1,) of each variable, and their number."""
    first = np.zeros(len(size) + 1, np.int64)
    for v in range(len(size)):
        first[v + 1] = first[v] + size[v]
    return first


@njit(cache=True)
def _gather_members(factors: Factors, queue: Queue, size: Ints, begin: int, end: int) -> tuple[Members, Ints]:
    """Return the variables of each front, ascending, and its parent (C,): the second variable, -1 without one."""
    stamp, front, parent = np.full(len(size), -1), np.empty(len(size), np.int64), np.full(end - begin, -1)
    members, filled = Members(begin, np.zeros(end - begin, np.int64), np.empty(16 * (end - begin), np.int64)), 0
    for v in range(begin, end):
        # The variables of its front in their order, v the first: of its factors, and of the fronts below.
        front[0], stamp[v], many = v, v, unliteral(1)
        f = queue.first_factor[v]
        while f >= 0:
            for k in range(factors.begins[f], factors.begins[f + 1]):
                many = _insert(factors.member[k], v, stamp, front, many)
            f = queue.next_factor[f]
        c = queue.first_front[v]
        while c >= 0:
            for k in range(_begin_of(members, c) + 1, members.ends[c - begin]):
                many = _insert(members.member[k], v, stamp, front, many)
            c = queue.next_front[c]
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
def _begin_of(members: Members, v: int) -> int:
    """Where the variables of a front begin."""
    return members.ends[v - members.begin - 1] if v > members.begin else 0


@njit(cache=True)
def _insert(variable: int, v: int, stamp: Ints, front: Ints, many: int) -> int:
    """Insert a variable into the sorted front of `v` unless `stamp` marks it as there; return the new length."""
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
    """Return the fronts with their structure, parents first; `rows` is empty until the numeric pass."""
    count, first, filled = len(parent), first_columns(size), 0
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
    return Fronts(sizes, firsts, parents, begins, column[:filled].copy(), at, np.empty(0))


@njit(cache=True)
def _plan_rest(members: Members, parent: Ints, queue: Queue, size: Ints, end: int) -> tuple[Factors, Ints, int]:
    """Plan where the separator triangle of each front is stored: a reusable buffer slot, or a remaining factor.

    Returns remaining factors (structure only), slot or factor number (C,) of each front, and number of slots.
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
                    member = _grow(member, unliteral(64))
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
    left = Factors(begins[: lefts + 1], member[:filled], rows[:lefts], at[: lefts + 1], np.empty(0))
    return left, slot, places


def eliminate_factors(
    factors: Factors, size: Ints, begin: int, end: int
) -> tuple[Fronts, Floats, float, Factors, bool]:
    """Eliminate the variables `begin <= v < end` by QR; `size` (V,) are the dimensions of all variables.

    Returns fronts, r (N,), twice the error at the minimum, marginal factors on the others, and whether R has full rank.
    """
    plan, fronts, left = plan_elimination(factors, size, begin, end)
    fronts = fronts._replace(rows=np.empty(int(fronts.at[-1])))
    left, right = left._replace(values=np.zeros(int(left.at[-1]))), np.zeros(int(plan.columns[-1]))
    # The workspace of a front, and the triangles that await their parent.
    widest = int(np.diff(fronts.begins).max(initial=0))
    most = max(BLOCK_ROWS, widest, int(factors.rows.max(initial=0))) + 3
    work = Work(np.zeros((widest, widest + 1)), np.zeros((most, widest + 1)), np.zeros(len(right), np.int64))
    kept = np.zeros((plan.slots, widest, widest + 1))
    error, determined = _fill_fronts(factors, plan, fronts, left, work, kept, right)
    return fronts, right, error, left, determined


@njit(cache=True)
def _fill_fronts(
    factors: Factors,
    plan: Plan,
    fronts: Fronts,
    left: Factors,
    work: Work,
    kept: Floats,
    right: Floats,
) -> tuple[float, bool]:
    """Eliminate the planned variables into `fronts`, `left`, `right`; return twice the error, and full rank."""
    queue, slot, begin, end = plan.queue, plan.slot, plan.begin, plan.end
    error = 0.0
    for v in range(begin, end):
        # Clear the triangle, and note the place of each column in it.
        i = end - 1 - v
        d, column = fronts.size[i], fronts.begins[i]
        n = int(fronts.begins[i + 1] - column)
        for k in range(n):
            work.place[fronts.column[column + k]] = k
            for j in range(n + 1):
                work.triangle[k, j] = 0.0
        # Separator triangles of its children: the first becomes the triangle, the others are new rows.
        below, of_fronts = queue.first_front[v], 0.0
        while below >= 0:
            is_first = below == queue.first_front[v]
            out = work.triangle if is_first else work.new
            rows = _place(kept[slot[below - begin]], fronts, end - 1 - below, work.place, out, n, is_first)
            of_fronts += 0.0 if is_first else _reflect(work, n, rows)
            below = queue.next_front[below]
        error += of_fronts
        # Its factors.
        error += _take_factors(factors, queue.first_factor[v], queue.next_factor, plan.columns, work, n)
        # Store its own rows; its separator triangle goes to the parent, or remains as a marginal factor.
        if not _keep_rows(fronts, i, work, right):
            return error, False
        if n > d and plan.parent[v - begin] < end:
            _copy_triangle(work.triangle, d, n, kept[slot[v - begin]])
        elif n > d:
            k = slot[v - begin]
            _copy_triangle(work.triangle, d, n, left.values[left.at[k] : left.at[k + 1]].reshape(n - d, n - d + 1))
    return error, True


class Work(NamedTuple):
    """To work in: the triangle of a front (w, w + 1), new rows (r, w + 1), and the place of each column (N,) in it."""

    triangle: Floats
    new: Floats
    place: Ints


@njit(cache=True)
def _place(left: Floats, fronts: Fronts, below: int, place: Ints, out: Floats, n: int, as_triangle: bool) -> int:
    """Scatter the separator triangle `left` of child `below` into its parent's `n` columns; return the row count."""
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
    """Reflect the factors queued from `f` (linked by `after`) into the triangle; return the squared remainder of b."""
    rows, error = unliteral(0), 0.0
    while f >= 0:
        if rows + factors.rows[f] > len(work.new) - 3:
            error += _reflect(work, n, rows)
            rows = 0
        # Its rows behind the new ones.
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
        rows += int(factors.rows[f])
        f = after[f]
    return error + _reflect(work, n, rows)


@njit(cache=True)
def _reflect(work: Work, n: int, rows: int) -> float:
    """Reflect `rows` new rows into the triangle of `n` columns (Householder); return the squared remainder of b."""
    triangle, new, _ = work
    dot = np.empty(n + 1)
    # Rows go in fours, the last filled up with zeros, which takes half the time of one by one.
    for r in range(rows, rows + -rows % 4):
        for j in range(n + 1):
            new[r, j] = 0.0
    for k in range(n):
        square = 0.0
        for r in range(rows):
            square += new[r, k] * new[r, k]
        if square == 0.0:
            continue
        top = triangle[k, k]
        length = np.sqrt(top * top + square)
        head = top + length if top >= 0.0 else top - length
        # Inner products of the reflector of column k with the later columns.
        for j in range(k + 1, n + 1):
            dot[j] = head * triangle[k, j]
        for r in range(0, rows, 4):
            a, b, c, d = new[r, k], new[r + 1, k], new[r + 2, k], new[r + 3, k]
            for j in range(k + 1, n + 1):
                dot[j] += a * new[r, j] + b * new[r + 1, j] + c * new[r + 2, j] + d * new[r + 3, j]
        # Apply the reflection to the later columns.
        for j in range(k + 1, n + 1):
            dot[j] *= 2.0 / (head * head + square)
            triangle[k, j] -= head * dot[j]
        for r in range(0, rows, 4):
            a, b, c, d = new[r, k], new[r + 1, k], new[r + 2, k], new[r + 3, k]
            for j in range(k + 1, n + 1):
                y = dot[j]
                new[r, j] -= a * y
                new[r + 1, j] -= b * y
                new[r + 2, j] -= c * y
                new[r + 3, j] -= d * y
        triangle[k, k] = -length if top >= 0.0 else length
    error = 0.0
    for r in range(rows):
        error += new[r, n] * new[r, n]
    return error


@njit(cache=True)
def _keep_rows(fronts: Fronts, i: int, work: Work, right: Floats) -> bool:
    """Store the rows and r of front i's own variable; return whether its diagonal is above rounding."""
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
