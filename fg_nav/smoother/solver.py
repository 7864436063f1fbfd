"""Gauss-Newton with halved steps, its outer loop in Python so that no factor is handed a copy of the values.

    repeat   linearize, eliminate, step; halve the step while it raises the error
    until    the error after the step is the one that the linear model promised

where the model holds its minimum is that of the graph: one linearization less than waiting for a step that changes
nothing, and its Bayes tree serves for the marginals. QR elimination: the information of a bias over hours and of a
node over milliseconds differ by more than Cholesky bears. The variables are eliminated in the order of time, which on
a chain is as good as any ordering and leaves the last footfall at the root.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, M, S, V, X, Z

from fg_nav.errors import EstimationError, FgNavError
from fg_nav.smoother.nodes import Nodes

CONVERGENCE = 5e-4
"""The solver stops when the error differs from what the linear model promised by less than this per variable: by
then the nodes of an hour's walk move by millimetres, at a sigma of metres."""

LARGEST_STEPS = 25
"""And gives up after so many."""

MOST_HALVINGS = 6

UNSOLVED = (RuntimeError, ValueError, IndexError, ArithmeticError, FgNavError)
"""What gtsam, numpy and fg_nav say where there is no solution: an indeterminate system, a key that is not there, a
matrix that cannot be divided by, no convergence."""


class LinearizableBlock(Protocol):
    """Factors that are linearized next to the graph, many of a kind together in numpy."""

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigmas."""

    def linearize(self, values: gtsam.Values) -> Iterator[gtsam.GaussianFactor]:
        """Yield its factors, linearized at these values."""


class GtsamFactors:
    """Factors of gtsam that are not in the graph of the walk."""

    def __init__(self, *factors: gtsam.NonlinearFactor) -> None:
        self._graph = gtsam.NonlinearFactorGraph()
        for factor in factors:
            self._graph.push_back(factor)

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigmas."""
        return float(self._graph.error(values))

    def linearize(self, values: gtsam.Values) -> Iterator[gtsam.GaussianFactor]:
        """Yield its factors, linearized at these values."""
        linear = self._graph.linearize(values)
        return (linear.at(i) for i in range(linear.size()))


def time_order(nodes: Nodes, with_field: bool = False, floors: int = 0) -> gtsam.Ordering:
    """Order in which the variables are eliminated: node by node, bias and settling after the last node that uses them.

    With the field its state M at each footfall follows the node of the footfall's result. Floors come after all else,
    as the walk may come back to each.
    """
    ordering = gtsam.Ordering()
    bias = nodes.bias[nodes.footfall]
    footfall = {int(j): k for k, j in enumerate(nodes.result)} if with_field else {}
    for j in range(len(nodes)):
        if j > 0 and bias[j] != bias[j - 1]:
            ordering.push_back(S(bias[j - 1]))
            ordering.push_back(B(bias[j - 1]))
        ordering.push_back(X(j))
        ordering.push_back(V(j))
        if j in footfall:
            ordering.push_back(M(footfall[j]))
    ordering.push_back(S(bias[-1]))
    ordering.push_back(B(bias[-1]))
    for floor in range(floors):
        ordering.push_back(Z(floor))
    return ordering


@dataclass(frozen=True)
class Solved:
    """Values at the minimum, the Bayes tree of the last linearization, and the number of linearizations."""

    values: gtsam.Values
    tree: gtsam.GaussianBayesTree
    steps: int


def minimize(
    graph: gtsam.NonlinearFactorGraph,
    blocks: Sequence[LinearizableBlock],
    values: gtsam.Values,
    ordering: gtsam.Ordering,
    convergence: float = CONVERGENCE,
    largest_steps: int = LARGEST_STEPS,
) -> Solved:
    """Minimize the error of the graph and its blocks.

    Parameters
    ----------
    convergence
        Largest difference of promised and true error per variable.

    Raises
    ------
    EstimationError
        If the equations have no unique solution, or no minimum is found in `largest_steps`.
    """
    error = np.inf
    for steps in range(1, largest_steps + 1):
        tree, step, promised = _solve_linear(graph, blocks, values, ordering)
        values, error = _descend(graph, blocks, values, step, error)
        if not np.isfinite(error):
            raise EstimationError("the smoother's error is not finite: check the recording with 'fg-nav inspect'.")
        if abs(error - promised) <= convergence * ordering.size():
            return Solved(values, tree, steps)
    raise EstimationError(
        f"the smoother did not converge in {largest_steps} steps: the stances are not those of a walk on foot, or the "
        "units of the recording are wrong; look at it with 'fg-nav inspect'."
    )


def _solve_linear(
    graph: gtsam.NonlinearFactorGraph,
    blocks: Sequence[LinearizableBlock],
    values: gtsam.Values,
    ordering: gtsam.Ordering,
) -> tuple[gtsam.GaussianBayesTree, gtsam.VectorValues, float]:
    """Bayes tree of the linearized graph, its minimum, and the error there."""
    try:
        linear = graph.linearize(values)
        for block in blocks:
            for factor in block.linearize(values):
                linear.push_back(factor)
        tree = linear.eliminateMultifrontal(ordering, gtsam.EliminateQR)
        step = tree.optimize()
    except RuntimeError as error:
        raise EstimationError(
            "the smoother's equations have no unique solution: the recording holds too little, or not finite, motion."
        ) from error
    return tree, step, linear.error(step)


def _descend(
    graph: gtsam.NonlinearFactorGraph,
    blocks: Sequence[LinearizableBlock],
    values: gtsam.Values,
    step: gtsam.VectorValues,
    before: float,
) -> tuple[gtsam.Values, float]:
    """Values after the step, halved as often as it takes not to raise the error `before` it, and their error."""
    for _ in range(MOST_HALVINGS):
        moved = values.retract(step)
        error = graph.error(moved) + sum(block.error(moved) for block in blocks)
        if error <= before:
            return moved, error
        step = step.scale(0.5)
    return values, before
