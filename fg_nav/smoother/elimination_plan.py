"""Which variables meet in each front of an elimination (`elimination`), before there are numbers in it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.smoother.fronts import Fronts
from fg_nav.system.compiled import njit


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


class Plan(NamedTuple):
    """How the variables from `begin` on, up to `end`, are eliminated.

    ======= ====== =====================================================================================
    queue          what each takes up
    parent  (C,)   of each
    slot    (C,)   where the triangle of its front goes: to one of `slots` places, or to the factors left
    columns (V+1,) first column of each of all variables
    ======= ====== =====================================================================================
    """

    begin: int
    end: int
    queue: Queue
    parent: Ints
    slot: Ints
    slots: int
    columns: Ints


@njit(cache=True)
def plan_elimination(factors: Factors, size: Ints, begin: int, end: int) -> tuple[Plan, Fronts, Factors]:
    """Plan the elimination of the variables `begin <= v < end`.

    Returns the plan, the fronts and the factors left, without their numbers.
    """
    queue = _queue_factors(factors, len(size))
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
    left = Factors(begins[: lefts + 1], member[:filled], rows[:lefts], at[: lefts + 1], np.empty(0))
    return left, slot, places
