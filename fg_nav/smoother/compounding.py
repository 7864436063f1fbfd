"""Many samples as two: the same motion, in fewer calls.

Every call of GTSAM's preintegration takes Python some microseconds, and what a foot does in a dozen samples fits into
two. A block of samples turns the body by R and moves it by v (m/s) and p (m) in T seconds, exactly (`mechanisation`,
without gravity). The two that stand for it hold one rate w for all of T, and a specific force each for half of it:

    theta = w h,    h = T / 2,    Exp(2 theta) = R,
    v = h Gamma_1 (f_1 + g),      p = h^2 ((Gamma_1 + Gamma_2) f_1 + Gamma_2 g),      g = Exp(theta) f_2,

and as all functions of [theta] commute, with s = Gamma_1^-1 v / h,

    f_1 = Gamma_1^-1 (p / h^2 - Gamma_2 s),    f_2 = Exp(theta)^T (s - f_1).

So R, v and p between two nodes are those of the samples, coning and sculling with them. How they change with the bias
and the covariance of their noise are those of the two: they differ by the square of what turns in a block, which ends
before it has turned by `MAX_TURN_RAD` or lasts `MAX_S`, by which the sigmas of a walk are right to 1 %, and its
end moves by 1 % of its sigma at most.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.mechanisation import NavState, rotation_series, rotation_vector, strapdown
from fg_nav.system.compiled import njit

MAX_TURN_RAD = 0.3  # Of the body in a block, along its way.

MAX_S = 0.12

SHORTEST = 3  # Samples in a block: fewer stand for themselves.


class Compound(NamedTuple):
    """Samples that stand for those between nodes: `force` (K, 3) m/s^2 and `rate` (K, 3) rad/s, held for `h` (K,) s.

    Those from node k to the next are `first[k]` to `first[k + 1]`, (M,).
    """

    force: Floats
    rate: Floats
    h: Floats
    first: Ints


@njit(cache=True)
def compound_samples(
    force: Floats, rate: Floats, h: Floats, sample: Ints, acc_bias: Floats, gyro_bias: Floats
) -> Compound:
    """Compound samples (N, 3) held for `h` (N,) s between nodes at `sample` (M,), for these biases (3,)."""
    most = sample[-1] - sample[0]
    out = Compound(np.empty((most, 3)), np.empty((most, 3)), np.empty(most), np.zeros(len(sample), np.int64))
    state = NavState(np.empty(3), np.empty(3), np.empty((3, 3)), gyro_bias, acc_bias)
    turn, work, count = np.empty((3, 3)), np.empty((3, 3)), 0
    for k in range(len(sample) - 1):
        i = sample[k]
        while i < sample[k + 1]:
            stop = _end_block(rate, h, i, sample[k + 1], gyro_bias)
            if stop - i < SHORTEST:
                write_sample(out, count, force[i], rate[i], h[i])
                i, count = i + 1, count + 1
            else:
                _halve(out, count, force, rate, h, i, stop, state, turn, work)
                i, count = stop, count + 2
        out.first[k + 1] = count
    return Compound(out.force[:count].copy(), out.rate[:count].copy(), out.h[:count].copy(), out.first)


@njit(cache=True)
def write_sample(out: Compound, row: int, force: Floats, rate: Floats, h: float) -> None:
    """Write one sample."""
    out.h[row] = h
    for axis in range(3):
        out.force[row, axis], out.rate[row, axis] = force[axis], rate[axis]


@njit(cache=True)
def _end_block(rate: Floats, h: Floats, first: int, last: int, gyro_bias: Floats) -> int:
    """Sample after the last of the block that begins with `first`, at most `last`."""
    turned, elapsed, i = 0.0, 0.0, first
    while i < last:
        square = 0.0
        for axis in range(3):
            square += (rate[i, axis] - gyro_bias[axis]) ** 2
        turned += np.sqrt(square) * h[i]
        elapsed += h[i]
        # A quarter of a sample more: the rounding of stamps, as that of the hour, decides nothing.
        if i > first and (turned > MAX_TURN_RAD or elapsed > MAX_S + 0.25 * h[i]):
            break
        i += 1
    return i


@njit(cache=True)
def _halve(
    out: Compound,
    row: int,
    force: Floats,
    rate: Floats,
    h: Floats,
    first: int,
    stop: int,
    state: NavState,
    turn: Floats,
    work: Floats,
) -> None:
    """Write the two samples that stand for the block from `first` to `stop`; state, turn and work are to work in."""
    T, acc_bias, gyro_bias = 0.0, state.acc_bias, state.gyro_bias
    for k in range(3):
        state.position[k], state.velocity[k] = 0.0, 0.0
        for axis in range(3):
            state.nav_R_body[k, axis] = 1.0 if k == axis else 0.0
    for i in range(first, stop):
        strapdown(state, force[i], rate[i], h[i], 0.0, turn, work[0])
        T += h[i]
    half, theta = 0.5 * T, rotation_vector(state.nav_R_body)
    x = 0.0
    for axis in range(3):
        theta[axis] *= 0.5
        x += theta[axis] ** 2
    a, b, c = rotation_series(x)
    to_mean = (1.0 - (1.0 - b * x) / (2.0 * a)) / x if x > 1e-12 else 1.0 / 12.0
    total, one, other = work[0], work[1], work[2]
    _apply(theta, 1.0, -0.5, to_mean, state.velocity, total)
    _apply(theta, 0.5, b, c, total, other)
    for axis in range(3):
        other[axis] = (state.position[axis] / half - other[axis]) / half
    _apply(theta, 1.0, -0.5, to_mean, other, one)
    for axis in range(3):
        other[axis] = total[axis] / half - one[axis]
    _apply(theta, 1.0, b * x - 1.0, a, other, total)
    for axis in range(3):
        one[axis] += acc_bias[axis]
        total[axis] += acc_bias[axis]
        theta[axis] = theta[axis] / half + gyro_bias[axis]
    write_sample(out, row, one, theta, half)
    write_sample(out, row + 1, total, theta, half)


@njit(cache=True)
def _apply(theta: Floats, by_itself: float, by_one: float, by_two: float, v: Floats, out: Floats) -> None:
    """Write (by_itself I + by_one [theta] + by_two [theta]^2) v: in numbers, which are compiled sooner than arrays."""
    x, y, z = theta[0], theta[1], theta[2]
    c0, c1, c2 = y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]
    out[0] = by_itself * v[0] + by_one * c0 + by_two * (y * c2 - z * c1)
    out[1] = by_itself * v[1] + by_one * c1 + by_two * (z * c0 - x * c2)
    out[2] = by_itself * v[2] + by_one * c2 + by_two * (x * c1 - y * c0)
