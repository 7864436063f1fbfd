"""Jacobians of a factor of gtsam on the manifold of its variables: its own, and by finite differences."""

import gtsam
import numpy as np

STEP = 1e-5


def residual(factor, values):
    """Whitened residual, from the right-hand side -e of the linearised factor."""
    return -factor.linearize(values).jacobian()[1]


def moved(values, key, step):
    """Values with one variable a tangent-space step away."""
    steps = gtsam.VectorValues()
    steps.insert(key, np.asarray(step, dtype=float))
    return values.retract(steps)


def jacobians(factor, values):
    """Whitened Jacobian of each key, as the factor states it."""
    A, _ = factor.linearize(values).jacobian()
    widths = [values.dims()[key] for key in list(factor.keys())]
    return dict(zip(factor.keys(), np.split(A, np.cumsum(widths)[:-1], axis=1), strict=True))


def differences(factor, values):
    """Whitened Jacobian of each key, by central differences of the residual."""
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
    """Compare the two."""
    stated, numeric = jacobians(factor, values), differences(factor, values)
    for key, H in stated.items():
        np.testing.assert_allclose(H, numeric[key], atol=atol, err_msg=gtsam.DefaultKeyFormatter(key))
