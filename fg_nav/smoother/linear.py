"""The linear graph of a walk as arrays, and its elimination.

A linear factor is |A x - b|^2, divided by its sigmas. A walk has thousands of a kind, with as many rows and variables
of the same dimensions, and numpy linearizes most of them together: K of a kind are a `Stack`. Those of gtsam are
stacked one by one, at 2 us each. `elimination` is by QR: the information of a bias over hours and of a node over
milliseconds differ by more than Cholesky bears.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import gtsam
import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import LETTER_SHIFT, Keys, Stack
from fg_nav.smoother.elimination import eliminate_factors
from fg_nav.smoother.elimination_plan import Factors
from fg_nav.smoother.fronts import Fronts, log_diagonal
from fg_nav.smoother.square_root import SquareRoot
from fg_nav.system.spilled import drop_pages, empty_column, join_rows

DIMENSION = dict(zip(map(ord, "xvbsmzwap"), (6, 3, 6, 1, 9, 1, 1, 1, 2), strict=True))
"""Of the tangent space of pose, velocity, bias, settling, state of the field, floor, width between two feet, direction
of a building and state of the barometer, by the letter in the key."""

MAX_STACKED = 1 << 14  # Factors of a stack: an hour of walking has as many inertial ones.

NO_SOLUTION = "the smoother's equations have no unique solution: the recording holds too little, or not finite, motion."

EXACT_WEIGHT = 1e6
"""Of a row without a sigma: a caller's own factor may be a constraint, which then holds to 1e-6 of its unit."""


def stack_factors(factors: Iterable[gtsam.GaussianFactor]) -> list[Stack]:
    """Stack linear factors of gtsam, those alike together, `MAX_STACKED` at most."""
    # Keys one behind the other, as thousands of small lists would have the interpreter look for garbage.
    piles: dict[tuple[int, ...], tuple[list[int], list[Floats]]] = {}
    stacks = []
    for factor in factors:
        A_b, of = _augment(factor), factor.keys()
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
    stacked = empty_column(len(rows), *rows[0].shape)
    np.stack(rows, out=stacked)
    drop_pages()
    return Stack(np.array(keys, dtype=np.uint64).reshape(len(rows), -1), stacked)


def _augment(factor: gtsam.GaussianFactor) -> Floats:
    """A and b (r, d + 1) of a linear factor, divided by its sigmas."""
    if not (isinstance(factor, gtsam.JacobianFactor) and factor.isConstrained()):
        return factor.augmentedJacobian()
    sigmas = factor.get_model().sigmas()
    weight = np.divide(1.0, sigmas, out=np.full(len(sigmas), EXACT_WEIGHT), where=sigmas > 0.0)
    return np.asarray(weight[:, None] * factor.augmentedJacobianUnweighted())


def find_sizes(keys: Keys) -> Ints:
    """Find the dimensions (V,) of the variables."""
    letter, kind = np.unique(keys >> np.uint64(LETTER_SHIFT), return_inverse=True)
    return np.array([DIMENSION[one] for one in letter.tolist()], dtype=np.int64)[kind]


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
    def of(cls, stacks: Iterable[Stack], keys: Keys) -> LinearWalk:
        """Take the factors of stacks."""
        return cls(keys, ()).join(stacks)

    def join(self, stacks: Iterable[Stack]) -> LinearWalk:
        """Return it with further factors."""
        order = np.argsort(self.keys)
        known = self.keys[order]
        further = [_lay_out(one.rows, order[np.searchsorted(known, one.keys)]) for one in stacks if len(one.keys)]
        return replace(self, factors=(*self.factors, *further))

    def eliminate(self) -> tuple[SquareRoot, LinearWalk]:
        """Eliminate all variables; return the triangle, and what is left, without factors.

        Raises `EstimationError` where there is no unique solution, as `eliminate_before`.
        """
        fronts, right, left = self._eliminate(len(self.keys))
        return SquareRoot(fronts, right, self.keys, self._size), left

    def eliminate_before(self, end: int) -> LinearWalk:
        """Eliminate the variables before place `end`."""
        return self._eliminate(end)[2]

    def eliminate_all(self) -> LinearWalk:
        """Eliminate all variables, for the error and the volume."""
        return self.eliminate_before(len(self.keys))

    @cached_property
    def _size(self) -> Ints:
        return find_sizes(self.keys)

    def _eliminate(self, end: int) -> tuple[Fronts, Floats, LinearWalk]:
        later = [] if end == len(self.keys) else [one for part in self.factors for one in _select_later(part, end)]
        factors = _chain(self.factors)
        fronts, right, error, left, determined = eliminate_factors(factors, self._size, self.begin, end)
        if not determined:
            raise EstimationError(NO_SOLUTION)
        volume = self.volume + log_diagonal(fronts)
        return fronts, right, LinearWalk(self.keys, (left, *later), end, self.error + 0.5 * error, volume)


def _lay_out(rows: Floats, place: Ints) -> Factors:
    """Lay out K factors, `rows` (K, r, d + 1), in variables at `place` (K, n)."""
    count = np.arange(len(rows) + 1)
    size = rows.shape[1] * rows.shape[2]
    return Factors(count * place.shape[1], place.ravel(), np.full(len(rows), rows.shape[1]), count * size, rows.ravel())


def _select_later(factors: Factors, end: int) -> tuple[Factors, ...]:
    """Select the factors, where there are any, that have no variable before place `end`."""
    begins, member, rows, at, values = factors
    later = np.minimum.reduceat(member, begins[:-1]) >= end
    if not later.any():
        return ()
    many, size = np.diff(begins), np.diff(at)
    places = (np.concatenate([[0], np.cumsum(count[later])]) for count in (many, size))
    begins, at = places
    return (Factors(begins, member[np.repeat(later, many)], rows[later], at, values[np.repeat(later, size)]),)


def _chain(parts: Sequence[Factors]) -> Factors:
    """Return factors one behind the other."""
    begins, at = _chain_places([part.begins for part in parts]), _chain_places([part.at for part in parts])
    member, rows = np.concatenate([part.member for part in parts]), np.concatenate([part.rows for part in parts])
    return Factors(begins, member, rows, at, join_rows([part.values for part in parts]))


def _chain_places(parts: Sequence[Ints]) -> Ints:
    """Return places (F+1,) that each begin at 0 as those of one array."""
    behind = np.cumsum([part[-1] for part in parts])
    ahead = [part[:-1] + before for part, before in zip(parts, [0, *behind], strict=False)]
    return np.concatenate([*ahead, behind[-1:]])
