"""The one place that touches gtsam.CustomFactor.

A custom factor whose error has the wrong shape, or that leaves a Jacobian unassigned, kills the interpreter; NaN, a
wrong column count or float32 pass silently and spoil the solution. `guarded_factor` checks what a residual function
returns before gtsam sees it, and says which factor it was.

A residual function takes the values of its keys and whether Jacobians are wanted, and returns the residual
`(r,)` and a list with one `(r, d_i)` Jacobian for each key, in gtsam's tangent-space order.
"""

from collections.abc import Callable, Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Residual = Callable[[gtsam.Values, bool], tuple[Array, Sequence[Array]]]


def guarded_factor(
    name: str, keys: Sequence[int], dims: Sequence[int], noise: gtsam.noiseModel.Base, residual: Residual
) -> gtsam.CustomFactor:
    """Wrap a residual as a factor that raises ValueError instead of crashing.

    Parameters
    ----------
    name : str
        Of the factor, for messages.
    keys, dims
        Variables it touches and their tangent-space dimensions.
    noise
        Its dimension is that of the residual.
    residual
        As described above.

    Raises
    ------
    ValueError
        If keys and dims do not match; later, from within gtsam, if what the residual function returns does not.
        That a key's variable has the dimension given here, nothing checks.
    """
    if len(keys) != len(dims):
        raise ValueError(f"{name}: there are {len(keys)} keys and {len(dims)} dimensions.")
    size = noise.dim()
    shapes = [(size, d) for d in dims]

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        e, H = residual(values, jacobians is not None)
        _check(name, "residual", e, (size,))
        if jacobians is not None:
            if H is None or len(H) != len(shapes):
                raise ValueError(f"{name}: there must be a Jacobian for each of the {len(shapes)} keys.")
            for i, shape in enumerate(shapes):
                _check(name, f"Jacobian {i}", H[i], shape)
                jacobians[i] = H[i]
        return e

    return gtsam.CustomFactor(noise, list(keys), error)


def _check(name: str, what: str, array: object, shape: tuple[int, ...]) -> None:
    if not isinstance(array, np.ndarray):
        raise ValueError(f"{name}: the {what} is a {type(array).__name__}, and must be float64{shape}.")
    if array.shape != shape or array.dtype != np.float64:
        raise ValueError(f"{name}: the {what} is {array.dtype}{array.shape}, and must be float64{shape}.")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: the {what} is not finite.")
