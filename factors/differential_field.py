"""Differential field: what the magnetometer shows of the gyro bias while the sensor stays in one place (MD (16)).

In a stretch of samples t in which the sensor hardly moves, the field in the body frame turns as the body does, and
the gyroscope has measured that turn. With y_t the field, uT, dR_t the rotation to the stretch's first sample by the
gyroscope at the bias b0, and d = b - b0 (`rotation.relative_rotations`),

    z_t = dR_t y_t = u + [u]x K_t d + n_t,     K_t = dR_t J_t,

u the field in the first body frame, unknown. Where the sensor moves a little the field drifts with place, so that

    C_ts = cov(n_t, n_s) = sigma_n^2 delta_ts + gamma(inf) - gamma(|p_t - p_s|) + sigma_h^2 theta_t . theta_s,

the same on each axis, gamma the variogram of the field. The last term is for iron: a hard iron h on the body, unknown
with sigma_h per axis, turns with it, dR_t h = h + theta_t x h, theta_t the rotation vector of dR_t. With W = C^-1,
eliminating u leaves W' = W - W 1 1^T W / (1^T W 1), and on the bias alone

    Lambda = sum_ts W'_ts A_t^T A_s,     A_t = [u]x K_t,     eta = sum_ts W'_ts A_t^T z_s,
    cost(b) = 1/2 (b - b0)^T Lambda (b - b0) - eta^T (b - b0),     u = sum_t w_t z_t,  w = W 1 / (1^T W 1).

No pose is needed, and absolute heading is not observed. Along u there is information only where u's direction in the
body changes. Differences of neighbouring samples share a measurement; taken as white they lose most of this
information, which is why all samples of the stretch enter together.

As h = eta + Lambda b0 the quadratics of several stretches add up whatever their b0. Errors that all stretches of a
kind have in common (soft iron, delay, gyroscope scale) do not average out. With a sigma s of those, in rad/s,

    Lambda <- (Lambda^-1 + s^2 I)^-1 = (I + s^2 Lambda)^-1 Lambda,     h <- (I + s^2 Lambda)^-1 h.

The factor has three rows on the bias, e = A b - r, A^T A = Lambda, A^T r = h.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .residual import BIAS, Array
from .rotation import Ints, skew, unskew

LEAST_SHARE = 1e-9
"""Of the largest information, below which there is none: rounding."""

GYRO = slice(3, 6)
"""Of a bias, whose first half is that of the accelerometer."""


@dataclass(frozen=True)
class DifferentialField:
    """Gyro bias by the field of stretches in one place; variable: bias (gtsam.imuBias.ConstantBias).

    `root` (..., 3, 3) A, s/rad, and `target` (..., 3) r, as above.
    """

    name: ClassVar[str] = "differential field"
    dims: ClassVar[tuple[int, ...]] = (BIAS,)
    rows: ClassVar[int] = 3

    root: Array
    target: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 3) and its Jacobian by the bias."""
        (bias,) = variables
        e = (self.root @ bias[..., GYRO, None])[..., 0] - self.target
        if not with_jacobians:
            return e, []
        return e, [np.concatenate([np.zeros_like(self.root), self.root], axis=-1)]


@dataclass(frozen=True)
class BiasInformation:
    """Quadratics on the gyro bias b (rad/s), 1/2 b^T Lambda b - h^T b: `matrix` (..., 3, 3) and `vector` (..., 3)."""

    matrix: Array
    vector: Array

    def __add__(self, other: "BiasInformation") -> "BiasInformation":
        return BiasInformation(self.matrix + other.matrix, self.vector + other.vector)

    def __sub__(self, other: "BiasInformation") -> "BiasInformation":
        return BiasInformation(self.matrix - other.matrix, self.vector - other.vector)

    def limit(self, sigma: float) -> "BiasInformation":
        """Return the same with an error of this sigma per axis, rad/s, common to all of it."""
        shrink = np.linalg.inv(np.eye(3) + sigma**2 * self.matrix)
        matrix = shrink @ self.matrix
        return BiasInformation((matrix + np.swapaxes(matrix, -1, -2)) / 2, (shrink @ self.vector[..., None])[..., 0])

    def residual(self) -> DifferentialField:
        """Return it as the residual of a factor; rows of zeros where there is no information."""
        values, axes = np.linalg.eigh(self.matrix)
        known = (values > LEAST_SHARE * values[..., -1:]) & (values > 0.0)
        root = np.sqrt(np.where(known, values, 1.0))
        rows = np.swapaxes(axes, -1, -2)
        target = np.where(known, (rows @ self.vector[..., None])[..., 0] / root, 0.0)
        return DifferentialField(np.where(known, root, 0.0)[..., None] * rows, target)


@dataclass(frozen=True)
class Variogram:
    """How the field changes with place: gamma(r) = sigma^2 (1 - exp(-(r / length)^exponent)), uT^2, per axis."""

    sigma_uT: float
    length_m: float
    exponent: float

    def covariance(self, square_m2: Array) -> Array:
        """Return gamma(inf) - gamma(r), uT^2, at squares of distances r."""
        scaled = square_m2 / self.length_m**2
        return np.asarray(self.sigma_uT**2 * np.exp(-(scaled ** (self.exponent / 2))))


@dataclass(frozen=True)
class FieldStretches:
    """Samples of the field, T in S stretches; where each has its rotation, its bias Jacobian and its place.

    ============== ========== ====================================================================
    body_field     (T, 3)     uT, calibrated
    rotation       (T, 3, 3)  dR_t at the bias b0
    bias_jacobian  (T, 3, 3)  J_t, s (`rotation.relative_rotations`)
    position       (T, 3)     m, in any frame
    stretch        (T,)       0 to S - 1, ascending; each has samples
    gyro_bias      (S, 3)     b0 of each, rad/s
    ============== ========== ====================================================================
    """

    body_field: Array
    rotation: Array
    bias_jacobian: Array
    position: Array
    stretch: Ints
    gyro_bias: Array

    def in_first_frame(self) -> Array:
        """Return z_t (T, 3) uT."""
        return np.asarray((self.rotation @ self.body_field[..., None])[..., 0])


@dataclass(frozen=True)
class StretchInformation:
    """Of S stretches: what each shows of the bias, chi-square (S,) at its own best bias, and degrees of freedom (S,).

    The covariance C is taken as it is: where chi-square is beyond its freedom, the information is too large by that.
    """

    information: BiasInformation
    chi_square: Array
    freedom: Array


@dataclass(frozen=True)
class FieldNoise:
    """What is in the field besides the turn of the body: variogram gamma, and sigma_n and sigma_h per axis, uT."""

    variogram: Variogram
    white_uT: float
    iron_uT: float


def measure_bias(stretches: FieldStretches, noise: FieldNoise, most: int) -> StretchInformation:
    """Reduce the field of each stretch to a quadratic on the gyro bias.

    Parameters
    ----------
    noise : of the walk.
    most : samples of a stretch; neighbours are averaged until they are no more.
    """
    padded = _pad(stretches, most)
    gram = np.empty((len(padded.count), 13, 13))
    for first in range(0, len(gram), AT_ONCE):
        # What is beyond the last mean of the longest of them is empty.
        some = np.s_[first : first + AT_ONCE, : padded.count[first : first + AT_ONCE].max()]
        covariance = _covariance(padded.position[some], padded.angle[some], padded.weight[some], noise)
        columns = padded.columns[some]
        gram[first : first + AT_ONCE] = np.swapaxes(columns, 1, 2) @ np.linalg.solve(covariance, columns)
    return _eliminate_field(gram, padded.count, stretches.gyro_bias)


AT_ONCE = 64
"""Stretches whose covariances are in memory together."""


@dataclass(frozen=True)
class _Padded:
    """Means of neighbouring samples, `most` for each of S stretches, zero beyond the last.

    `columns` (S, most, 13): 1, z (3), K (9); `position` and `angle` theta (S, most, 3); `weight` (S, most) samples in
    each mean; `count` (S,) means of each.
    """

    columns: Array
    position: Array
    angle: Array
    weight: Array
    count: Ints


def _pad(stretches: FieldStretches, most: int) -> _Padded:
    samples = np.bincount(stretches.stretch)
    number = np.arange(len(stretches.stretch)) - np.searchsorted(stretches.stretch, stretches.stretch)
    group = -(-samples // most)
    slot = stretches.stretch * most + number // group[stretches.stretch]
    K = stretches.rotation @ stretches.bias_jacobian
    rows = [
        np.ones((len(K), 1)),
        stretches.in_first_frame(),
        K.reshape(-1, 9),
        stretches.position,
        unskew(stretches.rotation),
    ]
    first = np.flatnonzero(np.diff(slot, prepend=-1))
    weight = np.diff(np.append(first, len(slot)))
    mean = np.add.reduceat(np.concatenate(rows, axis=1), first, axis=0) / weight[:, None]
    means, weights = np.zeros((len(samples) * most, 19)), np.zeros(len(samples) * most)
    means[slot[first]], weights[slot[first]] = mean, weight
    table = means.reshape(len(samples), most, 19)
    filled = weights.reshape(len(samples), most)
    return _Padded(table[..., :13], table[..., 13:16], table[..., 16:], filled, -(-samples // group))


def _covariance(position: Array, angle: Array, weight: Array, noise: FieldNoise) -> Array:
    """C (S, most, most) uT^2; the identity where there is no sample."""
    used = weight > 0.0
    square = ((position[:, :, None] - position[:, None]) ** 2).sum(axis=-1)
    covariance = np.where(used[:, :, None] & used[:, None], noise.variogram.covariance(square), 0.0)
    covariance += noise.iron_uT**2 * angle @ np.swapaxes(angle, 1, 2)
    diagonal = np.arange(used.shape[1])
    covariance[:, diagonal, diagonal] += np.where(used, noise.white_uT**2 / np.where(used, weight, 1.0), 1.0)
    return np.asarray(covariance)


def _eliminate_field(gram: Array, count: Ints, gyro_bias: Array) -> StretchInformation:
    """From X^T W X (S, 13, 13) of X = (1, z, K) to the quadratics."""
    total = gram[:, 0, 0]
    u = gram[:, 0, 1:4] / total[:, None]
    left = gram[:, 1:, 1:] - gram[:, 1:, :1] * gram[:, :1, 1:] / total[:, None, None]  # W' in place of W
    z_z, z_K = left[:, :3, :3], left[:, :3, 3:].reshape(-1, 3, 3, 3)
    K_K = left[:, 3:, 3:].reshape(-1, 3, 3, 3, 3)
    cross = skew(u)
    squared = np.swapaxes(cross, 1, 2) @ cross
    matrix = np.einsum("sac,sabcd->sbd", squared, K_K)
    eta = np.einsum("sea,seab->sb", cross, z_K)
    chi_square = np.trace(z_z, axis1=1, axis2=2) - _explained(matrix, eta)
    vector = eta + (matrix @ gyro_bias[..., None])[..., 0]
    return StretchInformation(BiasInformation(matrix, vector), chi_square, np.asarray(3.0 * (count - 2.0)))


def _explained(matrix: Array, eta: Array) -> Array:
    """eta^T Lambda^+ eta (S,): what the best bias takes off chi-square."""
    residual = BiasInformation(matrix, eta).residual()
    return np.asarray((residual.target**2).sum(axis=-1))
