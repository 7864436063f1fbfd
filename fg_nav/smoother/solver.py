"""Gauss-Newton with halved steps: a walk as a system of factors, its minimum, and what is read off it.

    repeat   linearize, eliminate, step; halve the step while it raises the error
    until    the error after the step is the one that the linear model promised

where the model holds its minimum is that of the graph, and its triangle serves for the marginals (`square_root`). What
is minimized is a `System`: a walk (`WalkSystem`), or two feet (`feet`).
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Generic, Protocol, TypeAlias, TypeVar

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, X

from fg_nav.arrays import Bools, Brief, Floats, Ints
from fg_nav.errors import EstimationError, FgNavError
from fg_nav.factors.residual import LETTER_SHIFT, POSE, Keys, Stack, read_variables
from fg_nav.smoother.square_root import DIMENSION, NO_SOLUTION, LinearWalk, SquareRoot, stack_factors
from fg_nav.smoother.strides import Nodes

CONVERGENCE = 5e-4  # Of promised and true error, per variable: the nodes of an hour's walk then move by millimetres.
FIRST_CONVERGENCE = 0.05  # The same where the walk is solved again: millimetres and thousandths of a degree a stride.
MAX_STEPS = 25  # And gives up after so many.
MAX_HALVINGS = 6

LOG = logging.getLogger(__name__)

V = TypeVar("V")
UNSOLVED = (RuntimeError, ValueError, IndexError, ArithmeticError, FgNavError)  # Raised without a solution.


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
class Minimum(Brief, Generic[V]):
    """Minimum of a system, the triangle of the last linearization, and the number of linearizations."""

    values: V
    root: SquareRoot
    steps: int
    linearized_at: V  # One step before the minimum.
    error: float  # Of the values.
    stacks: Sequence[Stack] = ()  # The linear factors.


def find_minimum(
    system: System[V], values: V, keys: Keys, convergence: float = CONVERGENCE, largest_steps: int = MAX_STEPS
) -> Minimum[V]:
    """Minimize the error of a system by Gauss-Newton, to this difference of promised and true error per variable.

    `keys` of all variables, in the order of their elimination. Raises `EstimationError` if the equations have no unique
    solution, or no minimum is found in `largest_steps`.
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
            LOG.debug("Gauss-Newton: %d variables, steps: %d, error: %.6g", len(keys), steps, error)
            return Minimum(values, root, steps, linearized_at, error, stacks)
        del root, left, stacks  # as large as all else: not kept beside the next one
    raise EstimationError(
        f"the smoother did not converge in {largest_steps} steps: the stances are not those of a walk on foot, or the "
        "units of the recording are wrong; look at it with 'fg-nav inspect'."
    )


class LinearizableBlock(Protocol):
    """Factors that are linearized next to the graph, many of a kind together in numpy."""

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigmas."""

    def stack(self, values: gtsam.Values) -> list[Stack]:
        """Linearize them at these values, as arrays."""

    def factors(self) -> Iterable[gtsam.NonlinearFactor]:
        """Yield them as factors of gtsam, one by one."""

    counts: dict[str, int]  # By kind, of those that are counted.


class BlockGroup:
    """Blocks that join a walk together, as one."""

    def __init__(self, *blocks: LinearizableBlock) -> None:
        self.blocks = blocks
        self.counts = {kind: count for block in blocks for kind, count in block.counts.items()}

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigmas."""
        return sum(block.error(values) for block in self.blocks)

    def stack(self, values: gtsam.Values) -> list[Stack]:
        """Linearize them at these values, as arrays."""
        return [stack for block in self.blocks for stack in block.stack(values)]

    def factors(self) -> Iterator[gtsam.NonlinearFactor]:
        """Yield them one by one."""
        return chain.from_iterable(block.factors() for block in self.blocks)


class GtsamFactors:
    """Factors of gtsam that are not in the graph of the walk; `kind` is the word under which they are counted."""

    def __init__(self, *factors: gtsam.NonlinearFactor, kind: str = "") -> None:
        self._graph, self.counts = gtsam.NonlinearFactorGraph(), {kind: len(factors)} if kind and factors else {}
        for factor in factors:
            self._graph.push_back(factor)

    def __len__(self) -> int:
        return int(self._graph.size())

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigmas."""
        return float(self._graph.error(values))

    def stack(self, values: gtsam.Values) -> list[Stack]:
        """Linearize them at these values, as arrays."""
        linear = self._graph.linearize(values)
        factors = map(linear.at, range(linear.size()))
        return stack_factors(gtsam.JacobianFactor(one) for one in factors if one is not None)

    def factors(self) -> Iterator[gtsam.NonlinearFactor]:
        """Yield them one by one."""
        return (self._graph.at(i) for i in range(self._graph.size()))

    def excess(self, values: gtsam.Values) -> float:
        """Excess of the robust loss over the quadratic one; zero for quadratic factors."""
        return 0.0


def list_in_time(
    nodes: Nodes, with_field: bool = False, floor: Ints | None = None, directions: int = 0, with_air: bool = False
) -> Keys:
    """Return the keys in elimination order: node by node, bias and settling after their last node.

    The states M of the field and P of a barometer follow the node of their footfall's result, floors the last footfall
    on them, of which `floor` (F,) has the number. The `directions` of a building, which all courses join, are last.
    """
    number, bias = np.arange(len(nodes)), nodes.bias[nodes.footfall]
    ends = np.flatnonzero(np.diff(bias, append=bias[-1] + 1))
    # Sort key: node that each variable follows, plus a fraction for its order there.
    parts = [("x", number, number), ("v", number, number)]
    if with_field:
        parts.append(("m", np.arange(len(nodes.result)), nodes.result))
    if floor is not None:
        last_on = dict(zip(floor.tolist(), nodes.result.tolist(), strict=True))
        left = np.array(sorted(one for one in last_on.items() if one[0] >= 0), dtype=np.int64).reshape(-1, 2)
        parts.append(("z", left[:, 0], left[:, 1]))
    if with_air:
        parts.append(("p", np.arange(len(nodes.result)), nodes.result))
    parts += [("s", bias[ends], ends), ("b", bias[ends], ends)]
    parts.append(("a", np.arange(directions), np.full(directions, number[-1])))
    keys = np.concatenate([(ord(letter) << LETTER_SHIFT) + of.astype(np.uint64) for letter, of, _ in parts])
    behind = np.concatenate([node for _, _, node in parts])
    return keys[np.argsort(behind, kind="stable")]


def split_tied(keys: Keys, nodes: Nodes, tied: Ints) -> tuple[Bools, Bools]:
    """Whether each key is of a footfall `tied` (n,): node, bias, settling or field; and whether of what many join."""
    node, bias = nodes.result[tied], np.unique(nodes.bias[tied])
    kinds = (("x", node), ("v", node), ("m", tied), ("b", bias), ("s", bias))
    names = [(ord(letter) << LETTER_SHIFT) + number.astype(np.uint64) for letter, number in kinds]
    return np.isin(keys, np.concatenate(names)), np.isin(keys >> np.uint64(LETTER_SHIFT), [ord("z"), ord("a")])


Solved: TypeAlias = Minimum[gtsam.Values]
"""The minimum of a walk."""


@dataclass(frozen=True)
class WalkSystem:
    """The graph of a walk and its blocks."""

    graph: gtsam.NonlinearFactorGraph
    blocks: Sequence[LinearizableBlock]

    def stack(self, values: gtsam.Values) -> list[Stack]:
        """Linearize all factors, as arrays; raises `EstimationError` where that cannot be."""
        try:
            stacks = stack_factors(self.graph.at(i).linearize(values) for i in range(self.graph.size()))
            for block in self.blocks:
                stacks += block.stack(values)
        except RuntimeError as reason:
            raise EstimationError(NO_SOLUTION) from reason
        return stacks

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of all residuals over their sigmas."""
        return float(self.graph.error(values) + sum(block.error(values) for block in self.blocks))

    def excess(self, values: gtsam.Values) -> float:
        """Robust-loss excess; zero for quadratic factors."""
        return sum(block.excess(values) for block in self.blocks if isinstance(block, GtsamFactors))

    def move(self, values: gtsam.Values, step: Mapping[int, Floats]) -> gtsam.Values:
        """Retract each variable."""
        vectors = gtsam.VectorValues()
        for key, x in step.items():
            vectors.insert(key, x)
        return values.retract(vectors)


def dimension_of(key: int) -> int:
    """Dimension of the tangent space of a variable of the walk."""
    return DIMENSION[key >> LETTER_SHIFT]


def residuals_at_minimum(
    root: SquareRoot, keys: Sequence[Sequence[int]] | Keys, residual: Floats, jacobian: Floats
) -> Floats:
    """Return the residuals (K, r) of K factors at the minimum of a tree, from those where it was linearized."""
    return np.asarray(residual + (jacobian @ root.step[root.find_columns(keys)][..., None])[..., 0])


def list_attitudes(nodes: Iterable[int], values: gtsam.Values) -> Floats:
    """List the attitudes (n, 3, 3) at some nodes."""
    return list_poses(nodes, values)[:, :3, :3].copy()


def list_positions(nodes: Iterable[int], values: gtsam.Values) -> Floats:
    """List the positions (n, 3) m at some nodes."""
    return list_poses(nodes, values)[:, :3, 3].copy()


def list_poses(nodes: Iterable[int], values: gtsam.Values) -> Floats:
    """List the poses (n, 4, 4) at some nodes."""
    return read_variables(values, [X(int(j)) for j in nodes], POSE).reshape(-1, 4, 4)


def list_biases(nodes: Nodes, values: gtsam.Values) -> Floats:
    """Return the bias variables (K, 6) of a walk: accelerometer m/s^2, gyroscope rad/s."""
    return np.array([values.atConstantBias(B(k)).vector() for k in range(int(nodes.bias[-1]) + 1)])


def pose_in_nav(nav_R_body: Floats) -> Floats:
    """(F, 4, 6) from the tangent spaces of poses, body axes, to place and yaw in navigation axes."""
    turn = np.zeros((len(nav_R_body), 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = nav_R_body
    return turn[:, [3, 4, 5, 2]]


def in_nav(nav_R_body: Floats, body_cov: Floats) -> Floats:
    """Covariances (F, 4, 4) of place and yaw in navigation axes, from those of poses (F, 6, 6) in body axes."""
    turn = pose_in_nav(nav_R_body)
    return np.asarray(turn @ body_cov @ turn.transpose(0, 2, 1))


def list_covariances(keys: Sequence[int], root: SquareRoot, shared: Floats) -> Floats:
    """Covariances (K, d, d) of variables of a kind, with what is `shared` (N, n)."""
    each = np.array(keys, dtype=np.uint64)[:, None]
    moved = shared[root.find_columns(each)]
    return np.asarray(root.joint_covariances(each) + moved @ np.swapaxes(moved, 1, 2))
