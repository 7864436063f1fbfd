"""Attitudes, poses and fields to try factors with, and the information of their graphs."""

import gtsam
import numpy as np
from hypothesis import strategies as st

vectors = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)
fields = st.lists(st.floats(-60, 60), min_size=3, max_size=3).map(np.array)


def pose(nav_R_body, position=(0.0, 0.0, 0.0)):
    return gtsam.Pose3(gtsam.Rot3(nav_R_body), np.array(position))


def values_of(variables):
    """Values from {key: Pose3, bias or vector}."""
    values = gtsam.Values()
    for key, variable in variables.items():
        values.insert(key, variable)
    return values


def information(graph, variables, order):
    """Information matrix of a graph linearised at {key: variable}, in the order of the keys."""
    ordering = gtsam.Ordering()
    for key in order:
        ordering.push_back(key)
    return graph.linearize(values_of(variables)).hessian(ordering)[0]


def eliminated(matrix, size):
    """Information on the first `size` unknowns once the others are eliminated."""
    a, b, d = matrix[:size, :size], matrix[:size, size:], matrix[size:, size:]
    return a - b @ np.linalg.solve(d, b.T)
