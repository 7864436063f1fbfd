"""Rotation vectors and their matrices, for many at once.

    [v]x w = v x w,     Exp(t) = exp([t]x),     Exp(t + d) = Exp(Jl(t) d) Exp(t) to first order in d.

With x = |t|, a = sin x / x, b = (1 - cos x) / x^2, c = (x - sin x) / x^3,

    Exp = cos x I + a [t]x + b t t^T,     Jl = a I + b [t]x + c t t^T.

Samples of a gyro with bias b, each held over its period h, make the rotation from the body frame of sample t to that
of the first,

    dR_t(b) = Exp(t_0) ... Exp(t_t-1),     t_k = (w_k - b) h_k,
    dR_t(b0 + d) = dR_t(b0) Exp(J_t d) to first order,     dR_t J_t = -sum_{k<t} dR_k Jl(t_k) h_k:

seen from the first frame, later rotations leave an earlier disturbance alone, so that the disturbances add up.
"""

import numpy as np
from numpy.typing import NDArray

from .residual import Array

Ints = NDArray[np.int64]

_CROSS = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)
"""Row i: the matrix [e_i]x, row by row."""


def skew(v: Array) -> Array:
    """Matrices (..., 3, 3) of the cross product with the vectors (..., 3)."""
    return np.asarray((v @ _CROSS).reshape(*v.shape, 3))


def unskew(R: Array) -> Array:
    """Return vectors (..., 3) of the antisymmetric part of matrices (..., 3, 3); for small rotations, of rotation."""
    return (
        np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1) / 2
    )


def rotation_exp(t: Array) -> Array:
    """Rotations (..., 3, 3) by the rotation vectors (..., 3) rad."""
    x, a, b = _coefficients(t)
    return _sum_of(t, np.cos(x), a, b)


def left_jacobian(t: Array) -> Array:
    """Left Jacobians (..., 3, 3) of Exp at the rotation vectors (..., 3) rad."""
    x, a, b = _coefficients(t)
    far = x > 0.05
    c = np.where(far, (1.0 - a) / np.where(far, x, 1.0) ** 2, 1.0 / 6.0 - x**2 / 120.0 + x**4 / 5040.0)
    return _sum_of(t, a, b, c)


def turn_about_up(turn: Array) -> Array:
    """Angle (...,) rad about up, counter-clockwise, of rotations (..., 3, 3) in the navigation frame."""
    return np.asarray(np.arctan2(turn[..., 1, 0] - turn[..., 0, 1], turn[..., 0, 0] + turn[..., 1, 1]))


def turn_from(nav_R_level: Array, nav_R_body: Array) -> tuple[Array, Array, Array]:
    """Return cos psi, sin psi (...) and d psi (..., 3) of the turn about up between attitudes (..., 3, 3).

    psi is the twist about up of D = nav_R_body nav_R_level^T, the angle of `turn_about_up`; its derivative is that by
    the tangent space of nav_R_body. It is e_z^T nav_R_body where both have the same tilt.
    """
    D = nav_R_body @ np.swapaxes(nav_R_level, -1, -2)
    c, s = D[..., 0, 0] + D[..., 1, 1], D[..., 1, 0] - D[..., 0, 1]
    east, north = D[..., 2, 0], D[..., 2, 1]
    square = c * c + s * s
    by_nav = np.stack([s * north - c * east, -(s * east + c * north), square], axis=-1) / square[..., None]
    length = np.sqrt(square)
    return c / length, s / length, (by_nav[..., None, :] @ nav_R_body)[..., 0, :]


def relative_rotations(rates: Array, periods: Array, segment: Ints, bias: Array) -> tuple[Array, Array]:
    """Return dR_t(b0) and J_t (T, 3, 3) s of each sample of each stretch: the identity and zero at each first one.

    `rates` (T, 3) rad/s are held over `periods` (T,) s; `segment` (T,) is the stretch of each sample, ascending; `bias`
    b0 (3,) or (S, 3) rad/s is common or one for each stretch.
    """
    first = np.searchsorted(segment, segment)
    turn = (rates - (bias if bias.ndim == 1 else bias[segment])) * periods[:, None]
    before = np.roll(rotation_exp(turn), 1, axis=0)
    position = np.arange(len(segment)) - first
    before[position == 0] = np.eye(3)
    # Cumulative rotations by a parallel prefix product: log2(longest stretch) passes.
    rotations, width = before.copy(), 1
    while width <= position.max(initial=0):
        far = np.flatnonzero(position >= width)
        rotations[far] = rotations[far - width] @ rotations[far]
        width *= 2
    by_bias = rotations @ (left_jacobian(turn) * periods[:, None, None])
    total = np.cumsum(by_bias, axis=0) - by_bias
    return rotations, np.swapaxes(rotations, -1, -2) @ (total[first] - total)


def _coefficients(t: Array) -> tuple[Array, Array, Array]:
    """x, a and b of the formulas above, each (...,)."""
    x = np.sqrt((t**2).sum(axis=-1))
    return x, np.sinc(x / np.pi), 0.5 * np.sinc(x / (2.0 * np.pi)) ** 2


def _sum_of(t: Array, one: Array, cross: Array, outer: Array) -> Array:
    """One I + cross [t]x + outer t t^T, (..., 3, 3)."""
    out = skew(cross[..., None] * t) + (outer[..., None] * t)[..., :, None] * t[..., None, :]
    out[..., range(3), range(3)] += one[..., None]
    return np.asarray(out)
