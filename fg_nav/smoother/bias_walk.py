"""The random walk of the gyroscope's bias, averaged by the evidence of the walk.

q (deg/s/sqrt(s)) is the density of the walk: from one bias variable to the next, t seconds later, each axis changes by
q sqrt(t), one sigma. Gyroscopes differ in it a hundredfold, and a shoe that warms up walks on top. Too small a q makes
the sigmas of bias, heading and position too small, too large a q loses what the minutes before have shown.

Only the noise S_i(q) of these changes depends on q, so one linearization serves for all, the last one of the solution
with the q that is assumed. What lies between the nodes at which the bias changes is eliminated once, and what is left,
a chain of the biases and these nodes, for each level. With all that does not depend on q left out,

    -log p(z | q) = E(q) + log|R(q)| + 1/2 sum_i log|S_i(q)|                 (Laplace; MacKay 2003, section 27)

E the error at the minimum of the linear graph, R the triangle of its square-root information. The walk has the mean of
q^2 over `LEVELS_DEG_S`, weighted by evidence and `PRIOR`: the variance of the mixture, so no level has to win, and a
walk too short to show one has that of the prior.

The evidence is that of the inertial graph. With the magnetic field it is larger, and chooses the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X

from fg_nav.factors.differential_field import GYRO
from fg_nav.factors.residual import LETTER_SHIFT, Keys, Stack
from fg_nav.smoother.evidence import average
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.linear import LinearWalk
from fg_nav.smoother.solver import list_in_time
from fg_nav.smoother.strides import MIN_WALK_DEG_S

LEVELS_DEG_S = (6e-4, 2e-3, 6e-3, 2e-2)
"""deg/s/sqrt(s), half a decade apart: 0.04 to 1.2 deg/s in an hour. None is below the walk assumed: a bias that may
walk so far also takes up what scale errors and an uneven field leave, which look like a walk. In a simulated office
whose bias walks by 2e-4 the evidence chooses that level, and the error with an indoor field grows from 0.08 to 0.11
m."""

PRIOR = (0.9, 0.09, 0.009, 0.001)  # Before the walk: gyroscopes by their sheets, and one in ten that warms up.

Change = gtsam.BetweenFactorConstantBias
"""From one bias variable to the next."""


def average_bias_walk(problem: WalkProblem, stacks: Sequence[Stack]) -> WalkProblem:
    """Return the problem with the random walk of its gyro bias averaged; `stacks` are its factors, linearized."""
    assumed = max(problem.parameters.gyro_bias_walk_deg_s, MIN_WALK_DEG_S)
    changes = [one for one in stacks if _are_changes(one)]
    if not changes:
        return _with_note(problem, f"gyro bias walk {_write(assumed)}, as assumed")
    # The linear graph without the changes of the bias.
    keys, between = _split_order(problem)
    others = [one for one in stacks if not _are_changes(one)]
    chain = LinearWalk.of(others, keys).eliminate_before(between)
    # The evidence of each level, and the mean variance.
    levels = assumed / LEVELS_DEG_S[0] * np.array(LEVELS_DEG_S)
    evidence = np.array([_minus_log_evidence(chain, changes, level / assumed) for level in levels])
    level = float(np.sqrt(average(levels**2, evidence, np.array(PRIOR))))
    # The problem with it.
    averaged = replace(problem.parameters, gyro_bias_walk_deg_s=level)
    graph = _scale_changes(problem.graph, level / assumed)
    count = sum(len(one.keys) for one in changes)
    note = f"gyro bias walk {_write(level)}, the mean over the evidence of {count} changes of the bias"
    return _with_note(replace(problem, graph=graph, parameters=averaged), note)


def _split_order(problem: WalkProblem) -> tuple[Keys, int]:
    """Split the order of time: nodes within the time of one bias first, and how many variables that are, then the rest.

    That is the nodes where a new bias begins, and the biases.
    """
    nodes, with_air = problem.nodes, problem.barometer is not None
    begins = np.flatnonzero(np.diff(nodes.bias[nodes.footfall])) + 1
    at_change = [key(int(j)) for j in begins for key in (X, V)]
    keys = list_in_time(nodes, with_air=with_air)
    is_node = np.isin(keys >> np.uint64(LETTER_SHIFT), _NODE_LETTERS)
    between = is_node & ~np.isin(keys, np.array(at_change, dtype=np.uint64))
    return np.concatenate([keys[between], keys[~between]]), int(between.sum())


_NODE_LETTERS = (ord("x"), ord("v"), ord("p"))


def _are_changes(stack: Stack) -> bool:
    """Whether the factors of a stack are those from one bias variable to the next."""
    return stack.keys.shape[1] == 2 and bool((stack.keys >> np.uint64(LETTER_SHIFT) == ord("b")).all())


def _minus_log_evidence(chain: LinearWalk, changes: Sequence[Stack], by: float) -> float:
    """Of the walk with the changes of the bias, the sigmas of the gyroscope so many times as large."""
    scaled, noise = [], 0.0
    for keys, rows in changes:
        rows = rows.copy()
        rows[:, GYRO] /= by
        scaled.append(Stack(keys, rows))
        noise += 3 * len(keys) * np.log(by)
    left = chain.join(scaled).eliminate_all()
    return float(left.error + left.volume + noise)


def _scale_changes(graph: gtsam.NonlinearFactorGraph, by: float) -> gtsam.NonlinearFactorGraph:
    """Return the graph with the sigmas of the gyroscope in the changes of the bias so many times as large."""
    scaled = gtsam.NonlinearFactorGraph()
    for factor in map(graph.at, range(graph.size())):
        scaled.push_back(_scale_change(factor, by) if isinstance(factor, Change) else factor)
    return scaled


def _scale_change(factor: Change, by: float) -> Change:
    sigmas = np.array(cast("gtsam.noiseModel.Diagonal", factor.noiseModel()).sigmas())
    sigmas[GYRO] *= by
    before, after = factor.keys()
    return Change(before, after, factor.measured(), gtsam.noiseModel.Diagonal.Sigmas(sigmas))


def _with_note(problem: WalkProblem, note: str) -> WalkProblem:
    return replace(problem, known=replace(problem.known, notes=(*problem.known.notes, note)))


def _write(level: float) -> str:
    return f"{level:.2g} deg/s/sqrt(s)"
