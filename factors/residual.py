"""One residual, two ways into a graph: one factor of gtsam, or many residuals linearized together in numpy.

A residual is a frozen dataclass of what was measured: at one instant, or at K instants, and then all its arrays have
a leading axis of length K. It has r rows and joins variables x_i, each of d_i dimensions. `evaluate` is the only place
where its formula and its derivatives stand:

    e (..., r)  divided by its sigma,     H_i = de/dx_i (..., r, d_i)  in gtsam's tangent space of x_i.

iSAM2 takes one `factor_of` for each instant. A batch solver takes a `ResidualBlock`: a callback from C++ into Python
takes about 30 us, and a walk has thousands of a kind. gtsam.CustomFactor kills the interpreter on a wrong shape or an
unassigned Jacobian, and lets NaN and float32 pass: `guarded_factor` alone makes one, and checks what it returns.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar

import gtsam
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Evaluate = Callable[[gtsam.Values, bool], tuple[Array, Sequence[Array]]]

POSE = 6  # Dimension of a pose, passed as its matrix (..., 4, 4) of nav_T_body; all others but `BIAS` are vectors.
FEW = 16  # Variables that are sooner read one by one than all of their kind together.
LETTER_SHIFT = 56  # A gtsam key carries its letter in the highest byte.


def guarded_factor(
    name: str, keys: Sequence[int], dims: Sequence[int], noise: gtsam.noiseModel.Base, residual: Evaluate
) -> gtsam.CustomFactor:
    """Wrap a residual as a factor that raises ValueError instead of crashing; `name` is for its message.

    `residual` takes the values of the keys, of these tangent-space dimensions, and whether Jacobians are wanted; it
    returns the residual (r,) and a list with one Jacobian (r, d_i) for each key, in gtsam's tangent-space order.
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


class _Bias(int):
    """Dimension of a bias, distinguished from that of a pose by its type."""


BIAS = _Bias(6)  # A gtsam.imuBias.ConstantBias, passed as its vector (..., 6): accelerometer, then gyroscope.


Keys = NDArray[np.uint64]


class Stack(NamedTuple):
    """K linear factors |A x - b|^2 of a kind: `keys` (K, n) of their variables, and A and b in `rows` (K, r, d + 1)."""

    keys: Keys
    rows: Array


class Residual(Protocol):
    """What was measured, and the residual it leaves."""

    name: ClassVar[str]  # For messages.
    dims: ClassVar[tuple[int, ...]]  # Of the variables, in tangent space.
    rows: ClassVar[int]  # r.

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual over its sigma, and where asked for its Jacobians."""


R = TypeVar("R", bound=Residual)


def _read(values: gtsam.Values, key: int, dim: int) -> Array:
    if isinstance(dim, _Bias):
        return values.atConstantBias(key).vector()
    return values.atPose3(key).matrix() if dim == POSE else values.atVector(key)


def read_variables(values: gtsam.Values, keys: Array | Sequence[int], dim: int) -> Array:
    """Return K variables of a kind, (K, 4, 4) poses, (K, 6) biases or (K, d) vectors; many by bulk extraction."""
    letter = int(keys[0]) >> LETTER_SHIFT if len(keys) else 0
    if len(keys) >= FEW and not isinstance(dim, _Bias) and letter:
        known = np.array(values.keys(), dtype=np.uint64)
        known = known[known >> np.uint64(LETTER_SHIFT) == letter]
        # All of the kind, in the order of their keys.
        if dim == POSE:
            columns = gtsam.utilities.extractPose3(values)
            rows = np.zeros((len(columns), 4, 4))
            rows[:, :3, :3], rows[:, :3, 3], rows[:, 3, 3] = columns[:, :9].reshape(-1, 3, 3), columns[:, 9:], 1.0
        else:
            rows = gtsam.utilities.extractVectors(values, chr(letter))
        row = np.searchsorted(known, np.asarray(keys, dtype=np.uint64))
        # extractVectors skips other types: only if the counts agree do rows match the keys.
        if len(rows) == len(known) and np.array_equal(known[np.minimum(row, len(known) - 1)], keys):
            return np.asarray(rows[row])
    return np.array([_read(values, int(key), dim) for key in keys])


def factor_of(residual: Residual, keys: Sequence[int]) -> gtsam.CustomFactor:
    """Make a factor of gtsam of one residual, without leading axes."""
    sizes = list(zip(keys, residual.dims, strict=True))

    def evaluate(values: gtsam.Values, with_jacobians: bool) -> tuple[Array, list[Array]]:
        return residual.evaluate([_read(values, key, d) for key, d in sizes], with_jacobians)

    return guarded_factor(residual.name, keys, residual.dims, gtsam.noiseModel.Unit.Create(residual.rows), evaluate)


def linear_factor_of(residual: Residual, keys: Sequence[int]) -> gtsam.LinearContainerFactor:
    """Make a factor that runs in C++ of one residual that is linear in vectors and biases."""
    zero = [np.zeros(d) for d in residual.dims]
    at = gtsam.Values()
    for key, x, dim in zip(keys, zero, residual.dims, strict=True):
        at.insert(key, gtsam.imuBias.ConstantBias() if isinstance(dim, _Bias) else x)
    e, H = residual.evaluate(zero, True)
    terms: list[Any] = [x for pair in zip(keys, H, strict=True) for x in pair]
    return gtsam.LinearContainerFactor(_JACOBIAN_FACTOR(*terms, -e, gtsam.noiseModel.Unit.Create(len(e))), at)


_JACOBIAN_FACTOR: Any = gtsam.JacobianFactor  # Of any number of keys, which its types do not say.


def hold_cauchy(square: Array, sigmas: float) -> tuple[Array, Array]:
    """Return sqrt(w) (...) for whitened residuals with squares x^2 (...), and the second row (...) of Cauchy's loss.

    Cauchy's loss rho = c^2 / 2 log(1 + x^2 / c^2), c = `sigmas`, in rows [sqrt(w) x | sqrt(2 rho - w x^2)] with the
    weight w = 1 / (1 + x^2 / c^2) held: arrays, gtsam's optimisers and iSAM2 then have the same loss (IRLS).
    """
    weight = 1.0 / (1.0 + square / sigmas**2)
    above = sigmas**2 * np.log1p(square / sigmas**2) - weight * square
    return np.sqrt(weight), np.sqrt(np.maximum(above, 0.0))


class ResidualBlock:
    """K residuals of a kind with their keys (K, n), linearized together.

    `is_linear` ones become factors of gtsam that run in C++; `kind` is the word under which they are counted, if any.
    """

    def __init__(
        self, residuals: Residual, keys: Sequence[Sequence[int]], is_linear: bool = False, kind: str = ""
    ) -> None:
        self.residuals, self.keys, self._make = residuals, keys, linear_factor_of if is_linear else factor_of
        self.counts = {kind: len(keys)} if kind else {}

    def __len__(self) -> int:
        return len(self.keys)

    @cached_property
    def _columns(self) -> Keys:
        """Keys (n, K) of each variable."""
        return np.array(self.keys, dtype=np.uint64).T.copy()

    def evaluate(self, values: gtsam.Values, with_jacobians: bool = True) -> tuple[Array, list[Array]]:
        """Return residuals (K, r) over their sigmas, and Jacobians (K, r, d) by each of the n variables."""
        columns = zip(self._columns, self.residuals.dims, strict=True)
        variables = [read_variables(values, keys, d) for keys, d in columns]
        return self.residuals.evaluate(variables, with_jacobians)

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigmas."""
        return 0.5 * float((self.evaluate(values, False)[0] ** 2).sum()) if len(self) else 0.0

    def stack(self, values: gtsam.Values) -> list[Stack]:
        """Return the block as one stack [A | b] linearized at these values, b = -e; empty for no residuals."""
        if not len(self):
            return []
        e, H = self.evaluate(values)
        return [Stack(self._columns.T, np.concatenate([*H, -e[..., None]], axis=2))]

    def factors(self) -> Iterator[gtsam.NonlinearFactor]:
        """Yield the same residuals as factors of gtsam, one by one."""
        return (self._make(one_of(self.residuals, k), keys) for k, keys in enumerate(self.keys))


def one_of(residuals: R, k: int | slice | NDArray[np.bool_]) -> R:
    """Return residual k of K, or some of them: every array indexed by k, all else unchanged."""
    of: Any = residuals
    arrays = {f.name: getattr(of, f.name) for f in fields(of) if isinstance(getattr(of, f.name), np.ndarray)}
    one: R = replace(of, **{name: np.array(array[k]) for name, array in arrays.items()})
    return one
