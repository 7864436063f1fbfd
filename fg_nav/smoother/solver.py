"""Gauss-Newton with halved steps, its outer loop in Python so that no factor is handed a copy of the values.

    repeat   linearise, eliminate, step; halve the step while it does not lower the error
    until    the error falls by less than a share of itself

QR elimination: the information of a bias over hours and of a node over milliseconds differ by more than Cholesky
bears. The variables are eliminated in the order of time, which on a chain is as good as any ordering and leaves the
last footfall at the root.
"""

from __future__ import annotations

from collections.abc import Callable

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.smoother.nodes import Nodes

MOST_HALVINGS = 6


def time_order(nodes: Nodes) -> gtsam.Ordering:
    """Order in which the variables are eliminated: a footfall's bias after the nodes of the next swing's start."""
    ordering = gtsam.Ordering()
    for j in range(len(nodes)):
        if j > 0 and nodes.footfall[j] != nodes.footfall[j - 1]:
            ordering.push_back(B(nodes.footfall[j - 1]))
        ordering.push_back(X(j))
        ordering.push_back(V(j))
    ordering.push_back(B(nodes.footfall[-1]))
    return ordering


def solve(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    ordering: gtsam.Ordering,
    convergence: float,
    largest_iterations: int,
    progress: Callable[[float], None] | None = None,
) -> tuple[gtsam.Values, int]:
    """Minimise the error of the graph; returns the values and the number of iterations.

    Raises
    ------
    EstimationError
        If the error is not finite, or has not settled after `largest_iterations`.
    """
    error = graph.error(values)
    for iteration in range(1, largest_iterations + 1):
        step = eliminate(graph, values, ordering).optimize()
        values, lower = _descend(graph, values, step, error)
        if not np.isfinite(lower):
            raise EstimationError("the smoother's error is not finite: check the recording with 'fg-nav inspect'.")
        if error - lower <= convergence * error:
            return values, iteration
        error = lower
        if progress is not None:
            progress(iteration / largest_iterations)
    raise EstimationError(
        f"the smoother did not converge in {largest_iterations} steps: the stances are not those of a walk on foot, "
        "or the units of the recording are wrong; look at it with 'fg-nav inspect'."
    )


def eliminate(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, ordering: gtsam.Ordering
) -> gtsam.GaussianBayesTree:
    """Linearise at the values and eliminate by QR; raises `EstimationError` where that has no unique solution."""
    try:
        return graph.linearize(values).eliminateMultifrontal(ordering, gtsam.EliminateQR)
    except RuntimeError as error:
        raise EstimationError(
            "the smoother's equations have no unique solution: the recording holds too little, or not finite, motion."
        ) from error


def _descend(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, step: gtsam.VectorValues, error: float
) -> tuple[gtsam.Values, float]:
    """Values after the step, halved as often as it takes not to raise the error; unchanged if nothing helps."""
    for _ in range(MOST_HALVINGS):
        moved = values.retract(step)
        lower = graph.error(moved)
        if lower <= error:
            return moved, lower
        step = step.scale(0.5)
    return values, error
