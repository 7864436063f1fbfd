"""Gauss-Newton with halved steps, its outer loop in Python so that no factor is handed a copy of the values.

    repeat   linearize, eliminate, step; halve the step while it raises the error
    until    the error after the step is the one that the linear model promised

where the model holds its minimum is that of the graph: one linearization less than waiting for a step that changes
nothing, and its triangle serves for the marginals (`square_root`). The elimination is `linear`.

What is minimized is a `System`: a walk (`solver.WalkSystem`), or two feet (`feet`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import Keys, Stack
from fg_nav.smoother.linear import LinearWalk
from fg_nav.smoother.square_root import SquareRoot

CONVERGENCE = 5e-4
"""The solver stops when the error differs from what the linear model promised by less than this per variable: by
then the nodes of an hour's walk move by millimetres, at a sigma of metres."""

FIRST_CONVERGENCE = 0.05
"""The same where the walk is looked at and solved again: it is then millimetres and thousandths of a degree a stride
from the minimum."""

MAX_STEPS = 25  # And gives up after so many.

MAX_HALVINGS = 6

V = TypeVar("V")


class System(Protocol[V]):
    """What is minimized, in values of a kind."""

    def stack(self, values: V) -> list[Stack]:
        """Linearize all factors, as arrays; raises `EstimationError` where that cannot be."""

    def error(self, values: V) -> float:
        """Half the sum of squares of all residuals over their sigmas."""

    def excess(self, values: V) -> float:
        """By how much the error is more than that of the linearized factors: of those with a robust loss."""

    def move(self, values: V, step: Mapping[int, Floats]) -> V:
        """Return the values moved by steps in the tangent spaces of the variables."""


@dataclass(frozen=True)
class Minimum(Generic[V]):
    """Values at the minimum of a system, the triangle of the last linearization, and the number of linearizations.

    `linearized_at` are the values of that linearization, one step before the minimum, where the error is `error`;
    `volume` is log|R|. `stacks` are its factors, until they are let go of.
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
        values, error = _descend(system, values, root, error)
        if not np.isfinite(error):
            raise EstimationError("the smoother's error is not finite: check the recording with 'fg-nav inspect'.")
        if abs(error - promised) <= convergence * len(keys):
            return Minimum(values, root, steps, linearized_at, error, left.volume, stacks)
        del root, left, stacks  # as large as all else: not kept beside the next one
    raise EstimationError(
        f"the smoother did not converge in {largest_steps} steps: the stances are not those of a walk on foot, or the "
        "units of the recording are wrong; look at it with 'fg-nav inspect'."
    )


def _descend(system: System[V], values: V, root: SquareRoot, before: float) -> tuple[V, float]:
    """Values after the step, halved as often as it takes not to raise the error `before` it, and their error."""
    step = root.step
    for _ in range(MAX_HALVINGS):
        moved = system.move(values, root.split(step))
        error = system.error(moved)
        if error <= before:
            return moved, error
        step = 0.5 * step
    return values, before
