"""Gauss-Newton with halved steps, and the linear graph of a walk as arrays.

    repeat   linearize, eliminate, step; halve the step while it raises the error
    until    the error after the step is the one that the linear model promised

where the model holds its minimum is that of the graph: one linearization less than waiting for a step that changes
nothing, and its triangle serves for the marginals (`square_root`). The outer loop is in Python, so that no factor is
handed a copy of the values. What is minimized is a `System`: a walk (`solver.WalkSystem`), or two feet (`feet`).

A linear factor is |A x - b|^2, divided by its sigmas. A walk has thousands of a kind, with as many rows and variables
of the same dimensions, and numpy linearizes most of them together: K of a kind are a `Stack`. Those of gtsam are
stacked one by one, at 2 us each. The elimination (`LinearWalk`, `elimination`) is by QR: the information of a bias over
hours and of a node over milliseconds differ by more than Cholesky bears.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import gtsam
import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import LETTER_SHIFT, Keys, Stack
from fg_nav.smoother.elimination import Factors, Fronts, eliminate_factors, sum_log_diagonal
from fg_nav.smoother.square_root import SquareRoot

DIMENSION = dict(zip(map(ord, "xvbsmzwap"), (6, 3, 6, 1, 9, 1, 1, 1, 2), strict=True))
"""Of the tangent space of pose, velocity, bias, settling, state of the field, floor, width between two feet, direction
of a building and state of the barometer, by the letter in the key."""

MAX_STACKED = 1 << 14  # Factors of a stack: an hour of walking has as many inertial ones.
NO_SOLUTION = "the smoother's equations have no unique solution: the recording holds too little, or not finite, motion."
EXACT_WEIGHT = 1e6  # Of a row without a sigma: a caller's factor may be a constraint, then held to 1e-6 of its unit.
CONVERGENCE = 5e-4  # Of promised and true error, per variable: the nodes of an hour's walk then move by millimetres.
FIRST_CONVERGENCE = 0.05  # The same where the walk is solved again: millimetres and thousandths of a degree a stride.
MAX_STEPS = 25  # And gives up after so many.
MAX_HALVINGS = 6


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
        """Return the walk of the factors of stacks."""
        return cls(keys, ()).join(stacks)

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
        """Eliminate all variables; return the triangle, and what is left, without factors.

        Raises `EstimationError` where there is no unique solution, as `eliminate_before`.
        """
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
        return find_sizes(self.keys)

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


V = TypeVar("V")


class System(Protocol[V]):
    """What is minimized, in values of a kind."""

    def stack(self, values: V) -> list[Stack]:
        """Linearize all factors, as arrays; raises `EstimationError` where that cannot be."""

    def error(self, values: V) -> float:
        """Half the sum of squares of all residuals over their sigmas."""

    def excess(self, values: V) -> float:
        """Robust-loss excess of the error over that of the linearized factors; zero for quadratic factors."""

    def move(self, values: V, step: Mapping[int, Floats]) -> V:
        """Return the values moved by steps in the tangent spaces of the variables."""


@dataclass(frozen=True)
class Minimum(Generic[V]):
    """Values at the minimum of a system, the triangle of the last linearization, and the number of linearizations.

    `error` is that of `values`; `linearized_at` are those of the last linearization, one step before the minimum;
    `volume` is log|R|, `stacks` are the linear factors.
    """

    values: V
    root: SquareRoot
    steps: int
    linearized_at: V
    error: float
    volume: float
    stacks: Sequence[Stack] = ()


def find_minimum(
    system: System[V], values: V, keys: Keys, convergence: float = CONVERGENCE, largest_steps: int = MAX_STEPS
) -> Minimum[V]:
    """Minimize the error of a system by Gauss-Newton.

    Parameters
    ----------
    keys
        Of all variables, in the order of their elimination.
    convergence
        Largest difference of promised and true error per variable.

    Raises
    ------
    EstimationError
        If the equations have no unique solution, or no minimum is found in `largest_steps`.
    """
    error = np.inf
    for steps in range(1, largest_steps + 1):
        linearized_at, stacks = values, system.stack(values)
        root, left = LinearWalk.of(stacks, keys).eliminate()
        promised = left.error + system.excess(values)
        # Step, halved until the error no longer rises (backtracking).
        step, before = root.step, error
        for _ in range(MAX_HALVINGS):
            moved = system.move(linearized_at, root.split(step))
            error = system.error(moved)
            if error <= before:
                values = moved
                break
            step = 0.5 * step
        else:
            error = before
        if not np.isfinite(error):
            raise EstimationError("the smoother's error is not finite: check the recording with 'fg-nav inspect'.")
        if abs(error - promised) <= convergence * len(keys):
            return Minimum(values, root, steps, linearized_at, error, left.volume, stacks)
        del root, left, stacks  # as large as all else: not kept beside the next one
    raise EstimationError(
        f"the smoother did not converge in {largest_steps} steps: the stances are not those of a walk on foot, or the "
        "units of the recording are wrong; look at it with 'fg-nav inspect'."
    )
