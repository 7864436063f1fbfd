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
from fg_nav.smoother.elimination_plan import Factors, Plan, plan_elimination
from fg_nav.smoother.fronts import Fronts, list_parts
from fg_nav.system.compiled import njit
from fg_nav.system.spilled import drop_pages, empty_column

BLOCK_ROWS = 32  # New rows that are reflected into a triangle together.
ROUNDING = 1e-14  # Of the norm of a column, below which what is left on the diagonal is none.


def eliminate_factors(
    factors: Factors, size: Ints, begin: int, end: int
) -> tuple[Fronts, Floats, float, Factors, bool]:
    """Eliminate the variables `begin <= v < end` of those of sizes (V,), which are all that factors join.

    Returns their fronts, parents first, r of all columns (N,), twice the error, the factors that are left in the
    others, and whether each is determined.
    """
    plan, fronts, left = plan_elimination(factors, size, begin, end)
    fronts, left = (
        fronts._replace(rows=empty_column(int(fronts.at[-1]))),
        left._replace(values=_zero_column(left.at[-1])),
    )
    right = np.zeros(int(plan.columns[-1]))
    work, kept = _prepare(factors, fronts, len(right), plan.slots)
    error, determined = 0.0, True
    for first, stop in list_parts(begin, end):
        error, determined = _fill_fronts(factors, plan, fronts, left, work, kept, right, error, first, stop)
        if not determined:
            break
    return fronts, right, error, left, determined


def _zero_column(count: int) -> Floats:
    """Return as many zeros, in a file where they are many."""
    column = empty_column(int(count))
    column[:] = 0.0
    drop_pages()
    return column


@njit(cache=True)
def _fill_fronts(
    factors: Factors,
    plan: Plan,
    fronts: Fronts,
    left: Factors,
    work: Work,
    kept: Floats,
    right: Floats,
    error: float,
    first: int,
    stop: int,
) -> tuple[float, bool]:
    """Eliminate the variables `first <= v < stop` as planned; add to twice the error; return whether all went."""
    queue, begin, end = plan.queue, plan.begin, plan.end
    for v in range(first, stop):
        i = end - 1 - v
        d, n = fronts.size[i], _clear(fronts, i, work)
        error += _take_fronts(plan, v, fronts, kept, work, n)
        error += _take_factors(factors, queue.first_factor[v], queue.next_factor, plan.columns, work, n)
        if not _keep_rows(fronts, i, work, right):
            return error, False
        if n > d and plan.parent[v - begin] < end:
            _copy_triangle(work.triangle, d, n, kept[plan.slot[v - begin]])
        elif n > d:
            k = plan.slot[v - begin]
            _copy_triangle(work.triangle, d, n, left.values[left.at[k] : left.at[k + 1]].reshape(n - d, n - d + 1))
    return error, True


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
    most = max(most, widest) + 3
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
def _take_fronts(plan: Plan, v: int, fronts: Fronts, kept: Floats, work: Work, n: int) -> float:
    """Take what is left of the fronts below, the first as the triangle, the others as rows; return twice an error."""
    queue, slot, begin, end = plan.queue, plan.slot, plan.begin, plan.end
    below, error = queue.first_front[v], 0.0
    if below >= 0:
        _place(kept[slot[below - begin]], fronts, end - 1 - below, work.place, work.triangle, n, True)
        below = queue.next_front[below]
    while below >= 0:
        rows = _place(kept[slot[below - begin]], fronts, end - 1 - below, work.place, work.new, n, False)
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
        if rows + factors.rows[f] > len(work.new) - 3:
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
        for j in range(k + 1, n + 1):
            dot[j] = head * triangle[k, j]
        _add_products(new, k, n, rows, dot)
        for j in range(k + 1, n + 1):
            dot[j] *= 2.0 / (head * head + square)
            triangle[k, j] -= head * dot[j]
        _take_off(new, k, n, rows, dot)
        triangle[k, k] = -length if top >= 0.0 else length
    error = 0.0
    for r in range(rows):
        error += new[r, n] * new[r, n]
    return error


@njit(cache=True)
def _add_products(new: Floats, k: int, n: int, rows: int, dot: Floats) -> None:
    """Add to `dot` the products of column `k` of the new rows with those behind it."""
    for r in range(0, rows, 4):
        a, b, c, d = new[r, k], new[r + 1, k], new[r + 2, k], new[r + 3, k]
        for j in range(k + 1, n + 1):
            dot[j] += a * new[r, j] + b * new[r + 1, j] + c * new[r + 2, j] + d * new[r + 3, j]


@njit(cache=True)
def _take_off(new: Floats, k: int, n: int, rows: int, dot: Floats) -> None:
    """Take column `k` of the new rows times `dot` off the columns behind it."""
    for r in range(0, rows, 4):
        a, b, c, d = new[r, k], new[r + 1, k], new[r + 2, k], new[r + 3, k]
        for j in range(k + 1, n + 1):
            y = dot[j]
            new[r, j] -= a * y
            new[r + 1, j] -= b * y
            new[r + 2, j] -= c * y
            new[r + 3, j] -= d * y


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
