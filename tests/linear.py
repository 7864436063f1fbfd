"""Blocks of factors linearized, as factors of gtsam one by one; and covariances from a Bayes tree."""

from collections.abc import Iterator
from typing import Any, Protocol

import gtsam
import numpy as np
from scipy.linalg.lapack import dtrtri

from fg_nav.arrays import Floats
from fg_nav.factors.residual import Stack
from fg_nav.smoother.solver import dimension_of


class Linearizable(Protocol):
    """What has its linear factors as arrays."""

    def stack(self, values: gtsam.Values) -> list[Stack]: ...


def linear_factors(block: Linearizable, values: gtsam.Values) -> Iterator[gtsam.JacobianFactor]:
    """Linear factors of a block at these values, in its order."""
    make: Any = gtsam.JacobianFactor
    sizes = values.dims()
    for keys, rows in block.stack(values):
        ends = np.cumsum([sizes[int(key)] for key in keys[0]])[:-1]
        noise = gtsam.noiseModel.Unit.Create(rows.shape[1])
        for names, A_b in zip(keys.tolist(), rows, strict=True):
            parts = np.split(A_b[:, :-1], ends, axis=1)
            yield make(*(x for pair in zip(names, parts, strict=True) for x in pair), A_b[:, -1], noise)


def marginal_covariances(tree: gtsam.GaussianBayesTree, wanted: set[int]) -> dict[int, Floats]:
    """Return the marginal covariance (d, d) of each wanted key, tangent space, from a Bayes tree, parents first."""
    found: dict[int, Floats] = {}
    nothing: dict[int, tuple[int, int]] = {}  # first row of each key of a clique, and the row after its last
    stack = [(root, nothing, np.zeros((1, 1))) for root in tree.roots()]
    while stack:
        clique, above, parent = stack.pop()
        conditional, rows, end = clique.conditional(), dict[int, tuple[int, int]](), 0
        keys = conditional.keys()
        for key in keys:
            rows[key] = (end, end := end + dimension_of(key))
        known = np.array([i for key in keys if key in above for i in range(*above[key])], dtype=np.int64)
        # Covariance of the frontal variables and of the separator, at rows `known` of the parent's.
        S, R_inverse = conditional.S(), dtrtri(conditional.R())[0]
        f = len(S)
        joint = np.empty((f + len(known), f + len(known)))
        joint[f:, f:] = parent[known[:, None], known]
        W = -R_inverse @ S
        cross = W @ joint[f:, f:]
        joint[:f, f:], joint[f:, :f] = cross, cross.T
        joint[:f, :f] = R_inverse @ R_inverse.T + cross @ W.T
        for key in wanted.intersection(rows).difference(found):
            first, last = rows[key]
            found[key] = joint[first:last, first:last].copy()
        stack += [(clique[i], rows, joint) for i in range(clique.nrChildren())]
    return found
