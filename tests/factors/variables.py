"""Variables to try factors with, and Jacobians on their manifold: a factor's own, and by finite differences."""

import gtsam
import numpy as np
from hypothesis import strategies as st

STEP = 1e-5

vectors = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)


def pose(nav_R_body, position=(0.0, 0.0, 0.0)):
    return gtsam.Pose3(gtsam.Rot3(nav_R_body), np.array(position))


def values_of(variables):
    values = gtsam.Values()
    for key, variable in variables.items():
        values.insert(key, variable)
    return values


def residual(factor, values):
    """Whitened residual, from the right-hand side -e of the linearised factor."""
    return -factor.linearize(values).jacobian()[1]


def moved(values, key, step):
    steps = gtsam.VectorValues()
    steps.insert(key, np.asarray(step, dtype=float))
    return values.retract(steps)


def jacobians(factor, values):
    A, _ = factor.linearize(values).jacobian()
    widths = [values.dims()[key] for key in list(factor.keys())]
    return dict(zip(factor.keys(), np.split(A, np.cumsum(widths)[:-1], axis=1), strict=True))


def differences(factor, values):
    return {
        key: np.transpose(
            [
                (residual(factor, moved(values, key, STEP * e)) - residual(factor, moved(values, key, -STEP * e)))
                / (2 * STEP)
                for e in np.eye(values.dims()[key])
            ]
        )
        for key in list(factor.keys())
    }


def assert_jacobians_are_derivatives(factor, values, atol=1e-7):
    stated, numeric = jacobians(factor, values), differences(factor, values)
    for key, H in stated.items():
        np.testing.assert_allclose(H, numeric[key], atol=atol, err_msg=gtsam.DefaultKeyFormatter(key))
