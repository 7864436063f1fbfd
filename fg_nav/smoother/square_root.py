"""The linear graph of a walk as arrays, its square-root information, and the passes along it in compiled code.

A linear factor is |A x - b|^2, divided by its sigmas. A walk has thousands of a kind, with as many rows and variables
of the same dimensions, and numpy linearizes most of them together: K of a kind are a `Stack`. Those of gtsam are
stacked one by one, at 2 us each. A `LinearWalk` eliminates them by QR (`elimination`), all or up to a variable.

QR leaves for each variable, of d dimensions, the rows of R x = r in it: an upper triangle R_FF (d, d) on itself and
R_FS (d, s) on those of its separator, which were eliminated later. They are fronts, one a variable, those of the
separator before it, and the one that comes last of these is its parent. Its separator is among the parent's own
variable and separator, so

    up     R^T Y = C     from the last front to the first,    each leaves C_S - R_FS^T Y_F to those of its separator,
    down   R X = Y       from the first to the last,          X_F = R_FF^-1 (Y_F - R_FS X_S),
    and    W = -R_FF^-1 R_FS,    P_FS = W P_SS,    P_FF = R_FF^-1 R_FF^-T + W P_SS W^T,

P the covariance, P_SS known from the parent. With a group of variables along a path of the tree, as those of a
footfall, comes the covariance K of all others there with G^T x of the group, and G^T P G: P G is added front by front.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import gtsam
import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import LETTER_SHIFT, Keys, Stack
from fg_nav.smoother.elimination import (
    Factors,
    Fronts,
    back_substitute,
    eliminate_factors,
    forward_substitute,
    get_front,
    sum_log_diagonal,
)
from fg_nav.system.compiled import njit

DIMENSION = dict(zip(map(ord, "xvbsmzwap"), (6, 3, 6, 1, 9, 1, 1, 1, 2), strict=True))
"""Of the tangent space of pose, velocity, bias, settling, state of the field, floor, width between two feet, direction
of a building and state of the barometer, by the letter in the key."""

MAX_STACKED = 1 << 14  # Factors of a stack: an hour of walking has as many inertial ones.
NO_SOLUTION = "the smoother's equations have no unique solution: the recording holds too little, or not finite, motion."
EXACT_WEIGHT = 1e6  # Of a row without a sigma: a caller's factor may be a constraint, then held to 1e-6 of its unit.


class Wanted(NamedTuple):
    """Joint covariances to find, each of columns of one front."""

    of_column: Ints  # (N,) number of that whose first column this is, or -1.
    columns: Ints  # (K, d).
    found: Floats  # (K, d, d) to write.


class Groups(NamedTuple):
    """Groups of variables, each along a path of the tree, and its n sums G^T x."""

    of_column: Ints  # (N,) group of each column, -1 in none.
    G: Floats  # (N, n) of all columns.
    common: Ints  # (F, c) columns that a group has in common with others, in the front where its path begins,
    by_common: Floats  # (F, c, n) and G there.


@njit(cache=True)
def _plan_slots(parent: Ints) -> tuple[Ints, int]:
    """Return the buffer slot (V,) of each front's covariance, reused after its last child, and the slot count."""
    children, slot = np.zeros(len(parent), np.int64), np.zeros(len(parent), np.int64)
    for p in parent:
        if p >= 0:
            children[p] += 1
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
def spread_covariance(fronts: Fronts, wanted: Wanted, groups: Groups, forms: Floats) -> None:
    """Write wanted covariances to `wanted.found`, and G^T P G (F, n, n) of groups to `forms`, parents first."""
    # Of fronts that children still need: covariance, that with the sums of their group, and which group that is, or -1.
    (slot, slots), widest, n = _plan_slots(fronts.parent), 0, groups.G.shape[1]
    for i in range(len(fronts.size)):
        widest = max(widest, fronts.begins[i + 1] - fronts.begins[i])
    P, K, active = np.zeros((slots, widest, widest)), np.zeros((slots, widest, n)), np.full(slots, -1)
    where = np.full(len(wanted.of_column), -1)
    for i in range(len(fronts.size)):
        p, here = fronts.parent[i], slot[i]
        d, columns, A = get_front(fronts, i)
        # Rows of its separator in its parent's covariance.
        above = np.zeros(len(columns) - d, np.int64)
        if p >= 0:
            for k in range(fronts.begins[p], fronts.begins[p + 1]):
                where[fronts.column[k]] = k - fronts.begins[p]
            for k in range(len(above)):
                above[k] = where[columns[d + k]]
        # The joint covariance of its variables, and that with the sums of its group.
        joint, cross = _join(A, d, P[slot[p]], above), np.zeros((len(columns), n))
        group = active[slot[p]] if p >= 0 else -1
        active[here] = _follow_group(groups, group, columns, A, d, K[slot[p]], above, joint, cross, forms)
        _copy(joint, P[here])
        _copy(cross, K[here])
        # What of it is wanted.
        number = wanted.of_column[columns[0]]
        if number >= 0:
            of = wanted.columns[number]
            for k in range(len(columns)):
                where[columns[k]] = k
            for j in range(len(of)):
                for k in range(len(of)):
                    wanted.found[number, j, k] = joint[where[of[j]], where[of[k]]]


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
    """Write Cov(front, G^T x) to `cross` and update G^T P G in `forms`; return the active group, -1 for none."""
    own: int = groups.of_column[columns[0]]
    sums = cross.shape[1]
    if group >= 0 and (own == group or own < 0):
        # The covariance of the front's variables with the sums, from its parent's.
        for n in range(sums):
            for j in range(len(above)):
                cross[d + j, n] = parent[above[j], n]
            for k in range(d - 1, -1, -1):
                total = 0.0
                for j in range(k + 1, len(cross)):
                    total -= A[k, j] * cross[j, n]
                cross[k, n] = total / A[k, k]
    elif own >= 0:
        # A new group begins with what it has in common with others.
        for c in range(groups.common.shape[1]):
            for k in range(len(columns)):
                if columns[k] == groups.common[own, c]:
                    _add_to_sums(k, groups.by_common[own, c], joint, cross, forms[own])
    if own < 0:
        return group
    # The front's own variable joins the sums.
    for k in range(d):
        _add_to_sums(k, groups.G[columns[k]], joint, cross, forms[own])
    return int(own)


@njit(cache=True)
def _add_to_sums(k: int, g: Floats, joint: Floats, cross: Floats, form: Floats) -> None:
    """Add column k of a front times g (n,) to the sums: to their covariance `form`, and with the front to `cross`."""
    for n in range(len(g)):
        for m in range(len(g)):
            form[n, m] += g[n] * cross[k, m] + cross[k, n] * g[m] + joint[k, k] * g[n] * g[m]
    for n in range(len(g)):
        for j in range(len(cross)):
            cross[j, n] += joint[j, k] * g[n]


@njit(cache=True)
def _copy(block: Floats, to: Floats) -> None:
    """Copy a matrix into the corner of another: in loops, which are compiled sooner than slices."""
    for j in range(block.shape[0]):
        for k in range(block.shape[1]):
            to[j, k] = block[j, k]


@njit(cache=True)
def _join(A: Floats, d: int, parent: Floats, above: Ints) -> Floats:
    """Return the joint covariance of a front's variable and separator; that is rows `above` of `parent`."""
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


class SquareRoot:
    """R of a solved walk, of `total` columns; `step` (N,) is R^-1 r.

    It is made of the fronts, r (N,), and the keys and sizes (V,) of the variables, in the order of elimination.
    """

    def __init__(self, fronts: Fronts, right: Floats, keys: Keys, size: Ints) -> None:
        self._fronts, self._keys, self._order = fronts, keys, np.argsort(keys)
        self._known, self._begins, self._size = keys[self._order], np.cumsum(size) - size, size
        self.total, self._shift = len(right), np.uint64(0)
        self.step = self.back_substitute(right[:, None])[:, 0]

    def shift_keys(self, shift: int) -> SquareRoot:
        """Return the same triangle with all keys less `shift`: one foot of two."""
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
        """Return Y (N, n), R^T Y = C."""
        Y = C.copy()
        forward_substitute(self._fronts, Y)
        return Y

    def back_substitute(self, Y: Floats) -> Floats:
        """Return X (N, n), R X = Y."""
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
        none = Groups(
            np.full(self.total, -1), np.zeros((self.total, 1)), np.zeros((0, 1), np.int64), np.zeros((0, 1, 1))
        )
        spread_covariance(self._fronts, Wanted(wanted, columns, found), none, np.zeros((0, 1, 1)))
        return found

    def split(self, X: Floats) -> dict[int, Floats]:
        """Split the rows of X (N, n) by variable."""
        ends = (self._begins + self._size).tolist()
        rows = zip(self._keys.tolist(), self._begins.tolist(), ends, strict=True)
        return {key: X[first:end] for key, first, end in rows}

    def quadratic_forms(self, groups: Groups) -> Floats:
        """Return G^T P G (F, n, n), the covariance of the sums G^T x, of each group."""
        forms = np.zeros((len(groups.common), groups.G.shape[1], groups.G.shape[1]))
        nothing = Wanted(np.full(self.total, -1), np.zeros((0, 1), np.int64), np.zeros((0, 1, 1)))
        spread_covariance(self._fronts, nothing, groups, forms)
        return forms


def stack_factors(factors: Iterable[gtsam.GaussianFactor]) -> list[Stack]:
    """Stack gtsam's linear factors of equal shape into arrays of `MAX_STACKED` at most."""
    # Keys one behind the other, as thousands of small lists start the garbage collector.
    piles: dict[tuple[int, ...], tuple[list[int], list[Floats]]] = {}
    stacks = []
    for factor in factors:
        of = factor.keys()
        if isinstance(factor, gtsam.JacobianFactor) and factor.isConstrained():
            sigmas = factor.get_model().sigmas()
            weight = np.divide(1.0, sigmas, out=np.full(len(sigmas), EXACT_WEIGHT), where=sigmas > 0.0)
            A_b = np.asarray(weight[:, None] * factor.augmentedJacobianUnweighted())
        else:
            A_b = factor.augmentedJacobian()
        keys, rows = piles.setdefault((*A_b.shape, len(of)), ([], []))
        keys.extend(of)
        rows.append(A_b)
        if len(rows) == MAX_STACKED:
            stacks.append(_stack(keys, rows))
            keys.clear()
            rows.clear()
    return [*stacks, *(_stack(*pile) for pile in piles.values() if pile[1])]


def _stack(keys: Sequence[int], rows: Sequence[Floats]) -> Stack:
    """Stack linear factors alike, with their keys one behind the other."""
    return Stack(np.array(keys, dtype=np.uint64).reshape(len(rows), -1), np.stack(rows))


@dataclass(frozen=True)
class LinearWalk:
    """Linear factors in variables `keys` (V,), in the order of elimination, of which those before `begin` are gone.

    `error` and `volume` are the least error, and log|R|, of what is gone.
    """

    keys: Keys
    factors: tuple[Factors, ...]
    begin: int = 0
    error: float = 0.0
    volume: float = 0.0

    @classmethod
    def of(cls, stacks: Iterable[Stack], keys: Keys, first: Bools | None = None) -> LinearWalk:
        """Return the walk of the factors of stacks; variables `first` (V,), where given, are eliminated first."""
        if first is None:
            return cls(keys, ()).join(stacks)
        return cls.of(stacks, np.concatenate([keys[first], keys[~first]])).eliminate_before(int(first.sum()))

    def join(self, stacks: Iterable[Stack]) -> LinearWalk:
        """Return it with further factors."""
        order = np.argsort(self.keys)
        known = self.keys[order]
        further = []
        for stack_keys, rows in stacks:
            if count := len(stack_keys):
                place, number, size = order[np.searchsorted(known, stack_keys)], np.arange(count + 1), rows[0].size
                lengths = np.full(count, rows.shape[1])
                further.append(Factors(number * place.shape[1], place.ravel(), lengths, number * size, rows.ravel()))
        return replace(self, factors=(*self.factors, *further))

    def eliminate(self) -> tuple[SquareRoot, LinearWalk]:
        """Eliminate all variables; return the triangle, and what is left; `EstimationError` without one solution."""
        fronts, right, left = self._eliminate(len(self.keys))
        return SquareRoot(fronts, right, self.keys, self._size), left

    def eliminate_before(self, end: int) -> LinearWalk:
        """Eliminate the variables before place `end`."""
        return self._eliminate(end)[2]

    def minus_log_evidence(self, log_noise: float) -> float:
        """Return -log p(z | assumed) up to a constant, `log_noise` that of the noises that the assumption changes.

        E + log|R| + 1/2 sum_i log|S_i| of `sensitivity`, all variables eliminated.
        """
        left = self.eliminate_before(len(self.keys))
        return float(left.error + left.volume + log_noise)

    @cached_property
    def _size(self) -> Ints:
        """Dimensions (V,) of the variables."""
        letter, kind = np.unique(self.keys >> np.uint64(LETTER_SHIFT), return_inverse=True)
        return np.array([DIMENSION[one] for one in letter.tolist()], dtype=np.int64)[kind]

    def _eliminate(self, end: int) -> tuple[Fronts, Floats, LinearWalk]:
        later = []
        for begins, member, rows, at, values in () if end == len(self.keys) else self.factors:
            # The factors, where there are any, that have no variable before place `end`.
            kept = np.minimum.reduceat(member, begins[:-1]) >= end
            if kept.any():
                many, size = np.diff(begins), np.diff(at)
                places = [np.concatenate([[0], np.cumsum(count[kept])]) for count in (many, size)]
                of_kept = member[np.repeat(kept, many)], rows[kept]
                later.append(Factors(places[0], *of_kept, places[1], values[np.repeat(kept, size)]))
        parts = self.factors
        factors = Factors(
            _chain_places([part.begins for part in parts]),
            np.concatenate([part.member for part in parts]),
            np.concatenate([part.rows for part in parts]),
            _chain_places([part.at for part in parts]),
            np.concatenate([part.values for part in parts]),
        )
        fronts, right, error, left, determined = eliminate_factors(factors, self._size, self.begin, end)
        if not determined:
            raise EstimationError(NO_SOLUTION)
        volume = self.volume + sum_log_diagonal(fronts)
        left_over = LinearWalk(self.keys, (left, *later), end, self.error + 0.5 * error, volume)
        return fronts, right, left_over


def _chain_places(parts: Sequence[Ints]) -> Ints:
    """Return places (F+1,) that each begin at 0 as those of one array."""
    behind = np.cumsum([part[-1] for part in parts])
    ahead = [part[:-1] + before for part, before in zip(parts, [0, *behind], strict=False)]
    return np.concatenate([*ahead, behind[-1:]])
