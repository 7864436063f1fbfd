"""Differential field: what the magnetometer shows of the gyro bias while the sensor stays in one place (MD (16)).

In a stretch of samples t in which the sensor hardly moves, the field in the body frame turns as the body does, and
the gyroscope has measured that turn. With y_t the field, uT, dR_t the rotation to the stretch's first sample by the
gyroscope at the bias b0, and d = b - b0 (`rotation.relative_rotations`),

    z_t = dR_t y_t = u + [u]x K_t d + dR_t h + n_t,     K_t = dR_t J_t,

u the field in the first body frame and h the hard iron on the body, uT, unknown. Where the sensor moves a little the
field drifts with place, so that

    C_ts = cov(n_t, n_s) = sigma_n^2 delta_ts + gamma(inf) - gamma(|p_t - p_s|),

the same on each axis, gamma the variogram of the field. With W = C^-1, eliminating u leaves
W' = W - W 1 1^T W / (1^T W 1), and on x = (b, h), about x0 = (b0, 0),

    Lambda = sum_ts W'_ts A_t^T A_s,     A_t = ([u]x K_t, dR_t),     eta = sum_ts W'_ts A_t^T z_s,
    cost(x) = 1/2 (x - x0)^T Lambda (x - x0) - eta^T (x - x0),     u = sum_t w_t (z_t - dR_t h0),  w = W 1 / (1^T W 1),

h0 what is expected of h. What is known of h, mean and covariance, enters when it is eliminated. No pose is needed, and
absolute heading is not observed (`docs/field.md`).

With vectors v = eta + Lambda x0 the quadratics of several stretches add up whatever their b0. Errors that all of a kind
have in common (soft iron, delay, gyroscope scale) do not average out. With a sigma s of those, in rad/s,

    Lambda <- (Lambda^-1 + s^2 P)^-1 = (I + s^2 Lambda P)^-1 Lambda,     v <- (I + s^2 Lambda P)^-1 v,

P the identity on the bias, zero on the iron. Once the iron is eliminated the factor has three rows on the bias,
e = A b - r, A^T A = Lambda, A^T r = v.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .residual import BIAS, Array
from .rotation import Ints, skew

MIN_SHARE = 1e-9  # Of the largest information, below which there is none: rounding.
MIN_INFORMATION = 1.0  # On a bias, s^2/rad^2: any bias is less than 1 rad/s.
GYRO = slice(3, 6)  # Of a bias, whose first half is that of the accelerometer.
AT_ONCE = 64  # Stretches that are in memory together.


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
class Iron:
    """What is known of the hard iron: mean (3,) uT in the body frame, and its covariance (3, 3) uT^2."""

    mean_uT: Array
    covariance: Array

    @classmethod
    def unknown(cls, sigma_uT: float) -> "Iron":
        """Return an iron of which nothing is known but how large it may be, per axis."""
        return cls(np.zeros(3), np.asarray(sigma_uT**2 * np.eye(3)))


@dataclass(frozen=True)
class BiasInformation:
    """Quadratics 1/2 x^T Lambda x - v^T x: `matrix` (..., n, n) and `vector` (..., n).

    x is the gyro bias b (rad/s), n = 3, or b and the hard iron h (uT), n = 6.
    """

    matrix: Array
    vector: Array

    def __add__(self, other: "BiasInformation") -> "BiasInformation":
        return BiasInformation(self.matrix + other.matrix, self.vector + other.vector)

    def scale(self, weight: Array) -> "BiasInformation":
        """Return the same times weights (...)."""
        return BiasInformation(self.matrix * weight[..., None, None], self.vector * weight[..., None])

    def limit(self, sigma: float) -> "BiasInformation":
        """Return the same with an error of this sigma per axis of the bias, rad/s, common to all of it."""
        identity = np.eye(self.matrix.shape[-1])
        shrink = np.linalg.inv(identity + sigma**2 * self.matrix * (np.arange(len(identity)) < 3))
        matrix = shrink @ self.matrix
        return BiasInformation((matrix + np.swapaxes(matrix, -1, -2)) / 2, (shrink @ self.vector[..., None])[..., 0])

    def eliminate_iron(self, iron: Iron) -> "BiasInformation":
        """Return the quadratic on the bias alone, with what is known of the iron."""
        known = np.linalg.inv(iron.covariance)
        by_iron = self.matrix[..., :3, 3:] @ np.linalg.inv(self.matrix[..., 3:, 3:] + known)
        vector = self.vector[..., :3] - (by_iron @ (self.vector[..., 3:] + known @ iron.mean_uT)[..., None])[..., 0]
        return BiasInformation(self.matrix[..., :3, :3] - by_iron @ self.matrix[..., 3:, :3], vector)

    def find_iron(self, before: Iron) -> Iron:
        """Return what is known of the iron once the bias is eliminated, with what was known before."""
        known = np.linalg.inv(before.covariance)
        matrix, vector = self.matrix.copy(), self.vector.copy()
        matrix[3:, 3:] += known
        vector[3:] += known @ before.mean_uT
        matrix[:3, :3] += MIN_INFORMATION * np.eye(3)
        covariance = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        return Iron((covariance @ vector)[3:], covariance[3:, 3:])

    def residual(self) -> DifferentialField:
        """Return it as the residual of a factor; rows of zeros where there is no information."""
        values, axes = np.linalg.eigh(self.matrix)
        known = (values > MIN_SHARE * values[..., -1:]) & (values > 0.0)
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
    """Samples of the field, T in S stretches; where each has its rotation, its bias Jacobian and its place."""

    body_field: Array  # (T, 3) uT, calibrated.
    rotation: Array  # (T, 3, 3) dR_t at the bias b0.
    bias_jacobian: Array  # (T, 3, 3) J_t, s (`rotation.relative_rotations`).
    position: Array  # (T, 3) m, in any frame.
    stretch: Ints  # (T,) 0 to S - 1, ascending; each has samples.
    gyro_bias: Array  # (S, 3) b0 of each, rad/s.

    def select(self, first: int, last: int) -> "FieldStretches":
        """Return those of numbers `first` to `last`, counted from the first."""
        some = slice(*np.searchsorted(self.stretch, [first, last]).tolist())
        samples = self.body_field[some], self.rotation[some], self.bias_jacobian[some], self.position[some]
        return FieldStretches(*samples, self.stretch[some] - first, self.gyro_bias[first:last])

    def in_first_frame(self) -> Array:
        """Return z_t (T, 3) uT."""
        return np.asarray((self.rotation @ self.body_field[..., None])[..., 0])


@dataclass(frozen=True)
class StretchInformation:
    """Of S stretches: what each shows of the bias, chi-square (S,) at its own best bias, degrees of freedom (S,)."""

    information: BiasInformation
    chi_square: Array
    freedom: Array

    @classmethod
    def join(cls, parts: Sequence["StretchInformation"]) -> "StretchInformation":
        """Return that of all stretches of some parts."""
        matrix = np.concatenate([part.information.matrix for part in parts])
        vector = np.concatenate([part.information.vector for part in parts])
        chi_square, freedom = ([getattr(part, name) for part in parts] for name in ("chi_square", "freedom"))
        return cls(BiasInformation(matrix, vector), np.concatenate(chi_square), np.concatenate(freedom))


@dataclass(frozen=True)
class FieldNoise:
    """What is in the field besides the turn of the body: variogram gamma, sigma_n per axis, uT, and hard iron."""

    variogram: Variogram
    white_uT: float
    iron: Iron


def measure_bias(stretches: FieldStretches, noise: FieldNoise, most: int) -> StretchInformation:
    """Reduce the field of each stretch, averaged down to `most` samples, to a quadratic on gyro bias and hard iron."""
    found = []
    for first in range(0, len(stretches.gyro_bias), AT_ONCE):
        some = stretches.select(first, first + AT_ONCE)
        columns, position, weight, count = _pad(some, most)
        covariance = _covariance(position, weight, noise)
        gram = np.swapaxes(columns, 1, 2) @ np.linalg.solve(covariance, columns)
        found.append(_eliminate_field(gram, count, some.gyro_bias, noise.iron))
    return StretchInformation.join(found)


def _pad(stretches: FieldStretches, most: int) -> tuple[Array, Array, Array, Ints]:
    """Average neighbouring samples: at most `most` means for each of S stretches, zero beyond its last.

    Returns columns (S, m, 22), which are 1, z (3), K (9), dR (9), positions (S, m, 3), samples in each mean (S, m), and
    means of each stretch (S,), m of the longest.
    """
    samples = np.bincount(stretches.stretch)
    number = np.arange(len(stretches.stretch)) - np.searchsorted(stretches.stretch, stretches.stretch)
    group = -(-samples // most)
    slot = stretches.stretch * most + number // group[stretches.stretch]
    K = stretches.rotation @ stretches.bias_jacobian
    rows = [
        np.ones((len(K), 1)),
        stretches.in_first_frame(),
        K.reshape(-1, 9),
        stretches.rotation.reshape(-1, 9),
        stretches.position,
    ]
    first = np.flatnonzero(np.diff(slot, prepend=-1))
    weight = np.diff(np.append(first, len(slot)))
    mean = np.add.reduceat(np.concatenate(rows, axis=1), first, axis=0) / weight[:, None]
    means, weights = np.zeros((len(samples) * most, 25)), np.zeros(len(samples) * most)
    means[slot[first]], weights[slot[first]] = mean, weight
    table = means.reshape(len(samples), most, 25)
    filled = weights.reshape(len(samples), most)
    count = -(-samples // group)
    longest = np.s_[:, : count.max()]
    return table[longest][..., :22], table[longest][..., 22:], filled[longest], count


def _covariance(position: Array, weight: Array, noise: FieldNoise) -> Array:
    """Return the field covariance C (S, m, m) uT^2 by the variogram; identity rows for padding."""
    used = weight > 0.0
    covariance = np.zeros((*weight.shape, weight.shape[1]))
    # Each pair once: the powers and exponentials dominate the cost.
    i, j = np.tril_indices(weight.shape[1], -1)
    apart = position[:, i] - position[:, j]
    square = np.einsum("spx,spx->sp", apart, apart)
    pairs = np.where(used[:, i] & used[:, j], noise.variogram.covariance(square), 0.0)
    covariance[:, i, j] = covariance[:, j, i] = pairs
    alone = noise.variogram.sigma_uT**2 + noise.white_uT**2 / np.where(used, weight, 1.0)
    diagonal = np.arange(weight.shape[1])
    covariance[:, diagonal, diagonal] = np.where(used, alone, 1.0)
    return covariance


def _eliminate_field(gram: Array, count: Ints, gyro_bias: Array, iron: Iron) -> StretchInformation:
    """Eliminate the constant field from X^T W X (S, 22, 22), X = (1, z, K, dR); return the bias and iron quadratics."""
    total = gram[:, 0, 0]
    mean = gram[:, 0] / total[:, None]
    u = mean[:, 1:4] - mean[:, 13:].reshape(-1, 3, 3) @ iron.mean_uT
    left = gram - gram[:, :, :1] * gram[:, :1] / total[:, None, None]  # W' in place of W
    # Rows of A for each axis, as sums of the columns of K and dR.
    rows = np.zeros((len(u), 3, 2, 3, 3, 6))
    for b in range(3):
        rows[:, :, 0, :, b, b] = skew(u)
        rows[:, range(3), 1, range(3), b, 3 + b] = 1.0
    A = rows.reshape(-1, 3, 18, 6)
    matrix = np.einsum("saib,sij,sajc->sbc", A, left[:, 4:, 4:], A, optimize=True)
    eta = np.einsum("saib,sia->sb", A, left[:, 4:, 1:4])
    # Chi^2 at the best bias and iron of each stretch, given the iron prior.
    known = np.zeros((6, 6))
    known[:3, :3], known[3:, 3:] = MIN_INFORMATION * np.eye(3), np.linalg.inv(iron.covariance)
    offset = np.append(np.zeros(3), known[3:, 3:] @ iron.mean_uT)
    best = np.linalg.solve(matrix + known, (eta + offset)[..., None])[..., 0]
    explained = (best * (eta + offset)).sum(axis=-1) - iron.mean_uT @ offset[3:]
    chi_square = np.trace(left[:, 1:4, 1:4], axis1=1, axis2=2) - explained
    x0 = np.concatenate([gyro_bias, np.zeros_like(gyro_bias)], axis=1)
    vector = eta + (matrix @ x0[..., None])[..., 0]
    return StretchInformation(BiasInformation(matrix, vector), chi_square, np.asarray(3.0 * (count - 2.0)))
