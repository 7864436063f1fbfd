"""The anchor: all that a walk says of the variables of one footfall, as one Gaussian, in arrays.

A linear graph of a whole walk is eliminated by QR but for the variables x of its newest footfall. What is left is

    1/2 |A d - b|^2,     d the step of x in its tangent space from the values where the graph was linearized:

the Schur complement of the information matrix, as a square root. As one linear factor it stands for the whole past in
the graph of the strides that follow (concurrent filtering and smoothing: Williams et al. 2014, IJRR 33, 1544).
Nothing is lost but the choice to linearize the past again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import solve_triangular

from fg_nav.arrays import Floats
from fg_nav.factors.residual import guarded_factor
from fg_nav.smoother.solver import dimension_of
from fg_nav.smoother.square_root import SquareRoot


@dataclass(frozen=True)
class MarginalPrior:
    """Square-root information A (r, d) and b (r,) on the variables `keys`, at their `values`.

    The value of a pose is its matrix (4, 4), that of a bias (6,) accelerometer and gyroscope, others are vectors.
    """

    keys: tuple[int, ...]
    values: tuple[Floats, ...]
    A: Floats
    b: Floats

    def factor(self) -> gtsam.CustomFactor:
        """Return it as a factor, d the logarithm of what its variables have moved since."""
        dims = [dimension_of(key) for key in self.keys]
        by_key = np.split(self.A, np.cumsum(dims)[:-1], axis=1)

        def evaluate(values: gtsam.Values, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
            steps = [_step_to(values, key, value) for key, value in zip(self.keys, self.values, strict=True)]
            e = self.A @ np.concatenate(steps) - self.b
            if not with_jacobians:
                return e, []
            return e, [_differentiate(A, key, d) for A, key, d in zip(by_key, self.keys, steps, strict=True)]

        unit = gtsam.noiseModel.Unit.Create(len(self.b))
        return guarded_factor("anchor", self.keys, dims, unit, evaluate)

    def initial_values(self) -> gtsam.Values:
        """Return the values of its variables."""
        values = gtsam.Values()
        for key, value in zip(self.keys, self.values, strict=True):
            _insert_value(values, key, value)
        return values


def marginalize(
    linear: gtsam.GaussianFactorGraph, values: gtsam.Values, keep: Sequence[int], others: Iterable[int]
) -> MarginalPrior:
    """Condense a graph, linearized at these values, to what it says of the variables `keep`.

    Parameters
    ----------
    others : the other variables, in the order in which they are eliminated.

    Raises
    ------
    RuntimeError
        Where the factors do not determine the others.
    """
    order, kept = gtsam.Ordering(), gtsam.Ordering()
    for key in others:
        order.push_back(key)
    for key in keep:
        kept.push_back(key)
    remaining = linear.eliminatePartialMultifrontal(order, gtsam.EliminateQR)[1] if order.size() else linear
    A, b = remaining.jacobian(kept)
    root: Floats = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    return MarginalPrior(
        tuple(keep), tuple(_value_of(values, key) for key in keep), root[:, :-1].copy(), root[:, -1].copy()
    )


def condense_root(root: SquareRoot, values: gtsam.Values, keep: Sequence[int]) -> MarginalPrior:
    """Condense the triangle R of a solved graph to what it says of the variables `keep`, at these values, its minimum.

    With Y = R^-T E, E the columns of these variables, their covariance is Y^T Y = T^T T by QR of Y, so A = T^-T.
    """
    columns = np.concatenate([root.find_columns([[key]])[0] for key in keep])
    unit = np.zeros((root.total, len(columns)))
    unit[columns, np.arange(len(columns))] = 1.0
    T: Floats = np.asarray(np.linalg.qr(root.forward_substitute(unit), mode="r"))
    A: Floats = np.asarray(solve_triangular(T, np.eye(len(T)), trans="T"))
    return MarginalPrior(tuple(keep), tuple(_value_of(values, key) for key in keep), A, np.zeros(len(A)))


def _step_to(values: gtsam.Values, key: int, value: Floats) -> Floats:
    """Step (d,) in the tangent space from a value of a variable to its present one."""
    now = _value_of(values, key)
    if value.ndim == 1:
        return np.asarray(now - value)
    return np.asarray(gtsam.Pose3.Logmap(gtsam.Pose3(value).between(gtsam.Pose3(now))))


def _differentiate(A: Floats, key: int, step: Floats) -> Floats:
    """Columns of a variable by its present tangent space, a step from that of A."""
    is_pose = chr(gtsam.Symbol(key).chr()) == "x"
    return np.ascontiguousarray(A @ gtsam.Pose3.LogmapDerivative(step) if is_pose else A)


def _value_of(values: gtsam.Values, key: int) -> Floats:
    letter = chr(gtsam.Symbol(key).chr())
    if letter == "x":
        return np.array(values.atPose3(key).matrix())
    return np.array(values.atConstantBias(key).vector() if letter == "b" else values.atVector(key))


def _insert_value(values: gtsam.Values, key: int, value: Floats) -> None:
    letter = chr(gtsam.Symbol(key).chr())
    if letter == "x":
        values.insert(key, gtsam.Pose3(value))
    elif letter == "b":
        values.insert(key, gtsam.imuBias.ConstantBias(value[:3], value[3:]))
    else:
        values.insert(key, value)
