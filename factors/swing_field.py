"""Field over a swing: what all its samples say of the gyro bias, once the unknown field is eliminated.

In a stretch in which the field is constant in space, sample t sees in its body frame

    y_t = dR_t(b)^T u + n,     dR_t: body frame at t to that at the stretch's first sample,

u the field in the body frame at the first sample (uT, unknown), n white noise of sigma, b the gyro bias (rad/s). Rates
are held over their periods h: dR_t = Exp(t_0) Exp(t_1) ..., t_k = (w_k - b) h_k. To first order in d = b - b0,

    dR_t(b) = dR_t(b0) Exp(J_t d),     K_t = dR_t J_t,

both from `factors.rotation.relative_rotations`. In the first frame

    z_t = dR_t(b0) y_t = u + [u]x K_t d + n,

linear in d, and in u but for the product, in which u is the mean of z. Eliminating u takes the means off:

    Lambda = sum A_t^T A_t / sigma^2,     eta = sum A_t^T (z_t - z) / sigma^2,     A_t = [u]x (K_t - K),
    cost(b) = 1/2 (chi - 2 eta^T d + d^T Lambda d),     chi = sum |z_t - z|^2 / sigma^2.

No pose is needed, and Lambda and eta of several stretches about the same b0 add up. Along u there is information only
through turns that change u's direction in the body.

A field that drifts across itself by g while the sensor moves looks like a bias of g / (|u| T) about the axis across
both: 2 uT in 3 s are 0.8 deg/s, with a sigma of 0.04. The least chi-square does not show it unless the sensor turns
much; only the bias of the rest of the walk does (`chi_square_at`). So a drift, linear over the samples and of unknown
direction, can be put into the model with its sigma per axis: z_t gets + g s_t, s_t from -1/2 to 1/2, and eliminating g

    Lambda -= p C^T C / sigma^2,     eta -= p C^T r / sigma^2,     chi -= p |r|^2 / sigma^2,
    C = sum s_t A_t,     r = sum s_t (z_t - z),     p = 1 / (sum s_t^2 + sigma^2 / sigma_g^2).

Samples used here and in `local_field` count twice; hard iron must be taken off before. The gyro's own noise is left
out: angle random walk times |u| must stay below sigma (0.05 deg, 50 uT: 0.04 uT).
"""

from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from .guarded import Array
from .rotation import Ints, skew

LARGEST_TURN = 0.05
"""rad by which a change of bias may turn the end of a stretch before the quadratic has to be made anew."""

LEAST_SHARE = 1e-9
"""Of the largest information, below which there is none: rounding."""


@dataclass(frozen=True)
class SwingQuadratics:
    """Quadratics on the change of the gyro bias, one for each of S stretches.

    `information` (S, 3, 3) and `vector` (S, 3) are Lambda and eta; `chi_square` (S,) that at no change of bias;
    `samples` (S,) how many fields were used; `body_field` (S, 3) uT the mean field in the first body frame;
    `reach_s` (S,) how far a bias turns the stretch's end, rad per rad/s.
    """

    information: Array
    vector: Array
    chi_square: Array
    samples: Ints
    body_field: Array
    reach_s: Array


def swing_field_quadratics(
    rotations: Array,
    bias_jacobians: Array,
    body_fields: Array,
    segment: Ints,
    sigma_uT: Array | float,
    inflation: Array | float = 1.0,
    drift_uT: Array | float = 0.0,
) -> SwingQuadratics:
    """Reduce the fields of S stretches to quadratics on the bias.

    Parameters
    ----------
    rotations, bias_jacobians : (T, 3, 3)
        dR_t and J_t of each sample, as from `relative_rotations`.
    body_fields : (T, 3) uT
        NaN where there is no new field: a value that is only held must not count twice.
    segment : (T,) int
        Stretch 0 to S - 1 of each sample, in ascending order.
    sigma_uT : float or (S,)
        White noise per axis.
    inflation : float or (S,)
        Factor on sigma for all that is not white; it lowers chi-square as well.
    drift_uT : float or (S,)
        Sigma per axis of how much the field drifts from a stretch's first sample to its last.
    """
    stretches = int(segment[-1]) + 1 if len(segment) else 0
    used = np.isfinite(body_fields).all(axis=1)
    R, index = rotations[used], segment[used]
    sums = _Sums(index, stretches)
    z = np.einsum("tab,tb->ta", R, body_fields[used])
    K = R @ bias_jacobians[used]
    u = sums.mean(z)
    A = skew(u)[index] @ (K - sums.mean(K)[index])
    off = z - u[index]
    variance = np.broadcast_to(np.square(np.multiply(sigma_uT, inflation)), stretches)
    information = sums.total(np.swapaxes(A, 1, 2) @ A)
    vector = sums.total(np.einsum("tab,ta->tb", A, off))
    chi_square = sums.total((off**2).sum(axis=1))
    of_drift = _of_drift(sums, A, off, variance, drift_uT)
    information, vector, chi_square = (x - y for x, y in zip((information, vector, chi_square), of_drift, strict=True))
    return SwingQuadratics(
        information=information / variance[:, None, None],
        vector=vector / variance[:, None],
        chi_square=chi_square / variance,
        samples=sums.count,
        body_field=u,
        reach_s=np.sqrt(sums.largest((K**2).sum(axis=(1, 2))) / 3.0),
    )


def chi_square_at(quadratics: SwingQuadratics, bias_change: Array) -> Array:
    """Chi-square (S,) at changes of the bias (3,) or (S, 3) rad/s; of 3 (samples - 1) degrees of freedom."""
    d = np.broadcast_to(bias_change, quadratics.vector.shape)
    quadratic = np.einsum("sa,sab,sb->s", d, quadratics.information, d)
    return np.asarray(quadratics.chi_square - 2.0 * (quadratics.vector * d).sum(axis=1) + quadratic)


def least_chi_square(quadratics: SwingQuadratics) -> tuple[Array, Ints]:
    """Chi-square (S,) at each stretch's own best bias, and its degrees of freedom (S,)."""
    A, b = square_root(quadratics.information, quadratics.vector)
    known = (A**2).sum(axis=2) > 0.0
    freedom = 3 * (quadratics.samples - 1) - known.sum(axis=1)
    return quadratics.chi_square - (b**2).sum(axis=1), np.maximum(freedom, 0)


def square_root(information: Array, vector: Array) -> tuple[Array, Array]:
    """Rows of a least-squares problem in the change of bias d, for quadratics Lambda (..., 3, 3) and eta (..., 3).

    Returns
    -------
    A, b : (..., 3, 3) and (..., 3)
        |A d - b|^2 = d^T Lambda d - 2 eta^T d + constant; rows of zeros where there is no information.
    """
    values, axes = np.linalg.eigh(information)
    known = values > LEAST_SHARE * values[..., -1:]
    root = np.sqrt(np.where(known, values, 1.0))
    rows = np.swapaxes(axes, -1, -2)
    b = np.where(known, np.einsum("...ab,...b->...a", rows, vector) / root, 0.0)
    return np.where(known, root, 0.0)[..., None] * rows, b


def has_moved_too_far(quadratics: SwingQuadratics, bias_change: Array) -> NDArray[np.bool_]:
    """Whether (S,) a change of bias (3,) or (S, 3) rad/s from b0 asks for new rotations and quadratics."""
    return np.asarray(np.linalg.norm(bias_change, axis=-1) * quadratics.reach_s > LARGEST_TURN)


def swing_field_factor(
    bias_key: int, quadratics: SwingQuadratics, bias: gtsam.imuBias.ConstantBias
) -> gtsam.LinearContainerFactor:
    """All the stretches together as one factor on the bias (gtsam.imuBias.ConstantBias); in C++.

    Parameters
    ----------
    quadratics
        Made at the gyro bias of `bias`. To move it: `has_moved_too_far`, then all from `relative_rotations` on.
    bias
        b0. The accelerometer's part of it is of no consequence.
    """
    A, b = square_root(quadratics.information.sum(axis=0), quadratics.vector.sum(axis=0))
    by_bias = np.hstack([np.zeros((3, 3)), A])  # the tangent space is accelerometer first, gyro last
    at = gtsam.Values()
    at.insert(bias_key, bias)
    linear = gtsam.JacobianFactor(bias_key, by_bias, b, gtsam.noiseModel.Unit.Create(3))
    return gtsam.LinearContainerFactor(linear, at)


def _of_drift(
    sums: "_Sums", A: Array, off: Array, variance: Array, drift_uT: Array | float
) -> tuple[Array, Array, Array]:
    """What a drift takes off: p C^T C, p C^T r and p |r|^2."""
    s = sums.share()
    C, r = sums.total(s[:, None, None] * A), sums.total(s[:, None] * off)
    p = np.square(drift_uT) / (np.square(drift_uT) * sums.total(s**2) + variance)
    Cp = p[:, None, None] * np.swapaxes(C, 1, 2)
    return Cp @ C, np.einsum("sab,sb->sa", Cp, r), p * (r**2).sum(axis=1)


class _Sums:
    """Sums over the samples of each of S stretches, which come in ascending order."""

    def __init__(self, index: Ints, stretches: int) -> None:
        self.count = np.bincount(index, minlength=stretches).astype(np.int64)
        self._present = np.flatnonzero(self.count)
        self._first = np.searchsorted(index, self._present)
        self._index = index

    def total(self, x: Array) -> Array:
        """Sums (S, ...) of x (T, ...)."""
        return self._each(np.add, x)

    def largest(self, x: Array) -> Array:
        """Largest (S, ...) of x (T, ...), not negative."""
        return self._each(np.maximum, x)

    def mean(self, x: Array) -> Array:
        """Means (S, ...) of x (T, ...), zero where there is no sample."""
        shape = (-1,) + (1,) * (x.ndim - 1)
        return np.asarray(self.total(x) / np.maximum(self.count, 1).reshape(shape))

    def share(self) -> Array:
        """How far along its stretch each sample is, (T,), from -1/2 at the first to 1/2 at the last."""
        position = np.arange(len(self._index)) - np.searchsorted(self._index, self._index)
        last = (self.count - 1)[self._index]
        return np.asarray(np.where(last > 0, position / np.maximum(last, 1) - 0.5, 0.0))

    def _each(self, operation: np.ufunc, x: Array) -> Array:
        out = np.zeros((len(self.count), *x.shape[1:]))
        out[self._present] = operation.reduceat(x, self._first, axis=0)
        return out
