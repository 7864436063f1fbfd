"""The path of a walk at the rate of its samples, through its nodes.

Between two nodes the samples are integrated from the first one with its bias. What is left at the second, a rotation
d_R, a velocity d_v and a position d_p, is given back smoothly over the interval of length T, with s in [0, 1]:

    R(s) Exp(a d_R),  a = 3 s^2 - 2 s^3;      p(s) + a d_p + b T d_v,  b = s^3 - s^2;      v(s) its derivative.

So the trajectory passes through every smoothed node in position, velocity and attitude. Before the first node and
after the last there is nothing to meet: the samples are integrated, backward and forward; so they are before a hole
and behind it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fg_nav.arrays import Floats, Ints
from fg_nav.mechanisation import NavState, rotate_in_body, rotation_vector, strapdown
from fg_nav.samples.gaps import LONGEST_HELD_S


@njit(cache=True)
def fill_path(
    h: Floats,
    acc: Floats,
    gyr: Floats,
    sample: Ints,
    position: Floats,
    velocity: Floats,
    nav_R_body: Floats,
    gyro_bias: Floats,
    acc_bias: Floats,
    gravity: float,
) -> tuple[Floats, Floats, Floats]:
    """Position (N, 3), velocity (N, 3) and attitude (N, 3, 3) at samples held for `h` (N,) s.

    The states are those at nodes `sample` (M,): as in `Trajectory`, gyro bias (M, 3) rad/s, force bias (M, 3) m/s^2.
    """
    n, m = len(h), len(sample)
    p, v, R = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3))
    for j in range(m):
        state = NavState(position[j].copy(), velocity[j].copy(), nav_R_body[j].copy(), gyro_bias[j], acc_bias[j])
        if j == 0:
            backward = NavState(position[j].copy(), velocity[j].copy(), nav_R_body[j].copy(), gyro_bias[j], acc_bias[j])
            _integrate(h, acc, gyr, sample[0], 0, backward, gravity, p, v, R)
        end = sample[j + 1] if j + 1 < m else n - 1
        before = _find_hole(h, sample[j], end, 1) if j + 1 < m else end
        _integrate(h, acc, gyr, sample[j], before, state, gravity, p, v, R)
        if before < end:
            behind = _find_hole(h, end - 1, sample[j] - 1, -1) + 1
            state = NavState(
                position[j + 1].copy(), velocity[j + 1].copy(), nav_R_body[j + 1].copy(), gyro_bias[j], acc_bias[j]
            )
            _integrate(h, acc, gyr, end, behind, state, gravity, p, v, R)
            _join(h, before, behind, p, v, R)
        elif j + 1 < m:
            _meet(h, sample[j], end, position[j + 1], velocity[j + 1], nav_R_body[j + 1], p, v, R)
    return p, v, R


@njit(cache=True)
def _find_hole(h: Floats, first: int, last: int, way: int) -> int:
    """Sample before a hole, the first from `first` on forward (1) or backward (-1); `last` where none is before it."""
    i = first
    while i != last and h[i] <= LONGEST_HELD_S:
        i += way
    return i


@njit(cache=True)
def _join(h: Floats, before: int, behind: int, p: Floats, v: Floats, R: Floats) -> None:
    """Fill in between two holes or more: straight on, in the attitude of before."""
    duration, elapsed = h[before:behind].sum(), 0.0
    move = p[behind] - p[before]
    for i in range(before + 1, behind):
        elapsed += h[i - 1]
        p[i], v[i], R[i] = p[before] + move * (elapsed / duration), move / duration, R[before]


@njit(cache=True)
def _integrate(
    h: Floats,
    acc: Floats,
    gyr: Floats,
    first: int,
    last: int,
    state: NavState,
    gravity: float,
    p: Floats,
    v: Floats,
    R: Floats,
) -> None:
    """Fill in from sample `first` to `last` inclusive, forward or backward."""
    turn, push = np.empty((3, 3)), np.empty(3)
    i = first
    p[i], v[i], R[i] = state.position, state.velocity, state.nav_R_body
    forward = last >= first
    while (forward and i < last) or (not forward and i > last):
        if forward:
            strapdown(state, acc[i], gyr[i], h[i], gravity, turn, push)
            i += 1
        else:
            i -= 1
            strapdown(state, acc[i], gyr[i], -h[i], gravity, turn, push)
        p[i], v[i], R[i] = state.position, state.velocity, state.nav_R_body


@njit(cache=True)
def _meet(
    h: Floats,
    first: int,
    last: int,
    position: Floats,
    velocity: Floats,
    nav_R_body: Floats,
    p: Floats,
    v: Floats,
    R: Floats,
) -> None:
    """Bend the path from sample `first` to `last` so that it ends in the given state."""
    duration = h[first:last].sum()
    d_p, d_v = position - p[last], velocity - v[last]
    d_R = rotation_vector(R[last].T @ nav_R_body)
    elapsed = 0.0
    for i in range(first + 1, last):
        elapsed += h[i - 1]
        s = elapsed / duration
        a, b = s * s * (3 - 2 * s), s * s * (s - 1)
        da, db = 6 * s * (1 - s) / duration, s * (3 * s - 2)
        for k in range(3):
            p[i, k] += a * d_p[k] + b * duration * d_v[k]
            v[i, k] += da * d_p[k] + db * d_v[k]
        rotate_in_body(R[i], a * d_R[0], a * d_R[1], a * d_R[2])
    p[last], v[last], R[last] = position, velocity, nav_R_body
