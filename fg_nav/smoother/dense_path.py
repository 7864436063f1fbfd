"""The path of a walk at the rate of its samples, through its nodes.

Between two nodes the samples are integrated from the first one with its bias. What is left at the second, a rotation
d_R, a velocity d_v and a position d_p, is given back smoothly over the interval of length T, with s in [0, 1]:

    R(s) Exp(a d_R),  a = 3 s^2 - 2 s^3;      p(s) + a d_p + b T d_v,  b = s^3 - s^2;      v(s) its derivative.

So the trajectory passes through every smoothed node in position, velocity and attitude. Before the first node and
after the last, and on both sides of a hole, the samples are integrated, backward and forward.
"""

from __future__ import annotations

from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V

from fg_nav.arrays import Floats, Ints
from fg_nav.factors.residual import read_variables
from fg_nav.mechanisation import NavState, rotate_in_body, rotation_vector, strapdown, write_state
from fg_nav.recording import Recording
from fg_nav.samples.gaps import MAX_HELD_S
from fg_nav.smoother.solver import list_biases, list_poses
from fg_nav.smoother.strides import Nodes
from fg_nav.system.compiled import njit


class Trajectory(NamedTuple):
    """Position (N, 3) m, velocity (N, 3) m/s and attitude (N, 3, 3) at every sample."""

    position: Floats
    velocity: Floats
    nav_R_body: Floats


def trajectory_of(recording: Recording, nodes: Nodes, values: gtsam.Values, gravity: float) -> Trajectory:
    """Return the trajectory of a solved walk at the recording's rate."""
    poses = list_poses(range(len(nodes)), values)
    bias = list_biases(nodes, values)[nodes.bias[nodes.footfall]]
    return dense_trajectory(
        recording,
        nodes.sample,
        poses[:, :3, 3].copy(),
        read_variables(values, [V(j) for j in range(len(nodes))], 3),
        poses[:, :3, :3].copy(),
        np.ascontiguousarray(bias[:, 3:]),
        np.ascontiguousarray(bias[:, :3]),
        gravity,
    )


def dense_trajectory(
    recording: Recording,
    sample: Ints,
    position: Floats,
    velocity: Floats,
    nav_R_body: Floats,
    gyro_bias: Floats,
    acc_bias: Floats,
    gravity: float,
) -> Trajectory:
    """Return the trajectory at every sample, strapdown between the states (M, ...) at nodes `sample` (M,).

    Position in m, velocity in m/s, gyro bias in rad/s, accelerometer bias in m/s^2.
    """
    samples = _HeldSamples(recording.periods_s, *recording.integrable)
    nodes, n = NavState(position, velocity, nav_R_body, gyro_bias, acc_bias), len(recording)
    path = Trajectory(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3)))
    _fill(samples, sample, nodes, gravity, path)
    return path


class _HeldSamples(NamedTuple):
    """Time `h` (N,) s for which each is held, specific force `acc` and rate `gyr` (N, 3)."""

    h: Floats
    acc: Floats
    gyr: Floats


@njit(cache=True)
def _fill(samples: _HeldSamples, sample: Ints, nodes: NavState, gravity: float, path: Trajectory) -> None:
    """Write `path` from each node to the next; `nodes` are the solved states (M, ...)."""
    p, v, R = path
    h, position, velocity, nav_R_body = samples.h, nodes.position, nodes.velocity, nodes.nav_R_body
    m = len(sample)
    for j in range(m):
        if j == 0:
            write_state(position[j], velocity[j], nav_R_body[j], p, v, R, sample[j])
            _integrate(samples, sample[j], j, nodes.gyro_bias[j], nodes.acc_bias[j], gravity, path)  # to the very first
        end = sample[j + 1] if j + 1 < m else len(h) - 1
        before = _find_hole(h, sample[j], end) if j + 1 < m else end
        write_state(position[j], velocity[j], nav_R_body[j], p, v, R, sample[j])
        _integrate(samples, sample[j], before, nodes.gyro_bias[j], nodes.acc_bias[j], gravity, path)
        if before < end:
            behind = _find_hole(h, end - 1, sample[j] - 1) + 1
            write_state(position[j + 1], velocity[j + 1], nav_R_body[j + 1], p, v, R, end)
            _integrate(samples, end, behind, nodes.gyro_bias[j], nodes.acc_bias[j], gravity, path)
            _join(h, before, behind, path)
        elif j + 1 < m:
            _meet(h, sample[j], end, position[j + 1], velocity[j + 1], nav_R_body[j + 1], path)
            write_state(position[j + 1], velocity[j + 1], nav_R_body[j + 1], p, v, R, end)


@njit(cache=True)
def _find_hole(h: Floats, first: int, last: int) -> int:
    """Return the first sample from `first` towards `last` that is held over a gap; `last` if there is none."""
    i, way = first, 1 if last > first else -1
    while i != last and h[i] <= MAX_HELD_S:
        i += way
    return i


@njit(cache=True)
def _join(h: Floats, before: int, behind: int, path: Trajectory) -> None:
    """Write `path` between samples `before` and `behind` of a gap: a straight line, attitude held from `before`."""
    p, v, R = path
    duration, elapsed = 0.0, 0.0
    for i in range(before, behind):
        duration += h[i]
    for i in range(before + 1, behind):
        elapsed += h[i - 1]
        write_state(p[before], v[before], R[before], p, v, R, i)
        for k in range(3):
            move = p[behind, k] - p[before, k]
            p[i, k] += move * (elapsed / duration)
            v[i, k] = move / duration


@njit(cache=True)
def _integrate(
    samples: _HeldSamples, first: int, last: int, gyro_bias: Floats, acc_bias: Floats, gravity: float, path: Trajectory
) -> None:
    """Write `path` by strapdown from its state at sample `first` to `last` inclusive, forward or backward."""
    p, v, R = path
    turn, push = np.empty((3, 3)), np.empty(3)
    state = NavState(p[first].copy(), v[first].copy(), R[first].copy(), gyro_bias, acc_bias)
    way = 1 if last > first else -1
    for i in range(first, last, way):
        held = min(i, i + way)  # a sample holds from its stamp to the next
        strapdown(state, samples.acc[held], samples.gyr[held], way * samples.h[held], gravity, turn, push)
        write_state(state.position, state.velocity, state.nav_R_body, p, v, R, i + way)


@njit(cache=True)
def _meet(
    h: Floats, first: int, last: int, position: Floats, velocity: Floats, nav_R_body: Floats, path: Trajectory
) -> None:
    """Spread the mismatch at sample `last` over `path` since `first`, so that it ends in the solved state."""
    p, v, R = path
    duration, elapsed = 0.0, 0.0
    for i in range(first, last):
        duration += h[i]
    left = np.zeros((3, 3))  # R_last^T nav_R_body
    for row in range(3):
        for column in range(3):
            for k in range(3):
                left[row, column] += R[last, k, row] * nav_R_body[k, column]
    d_R = rotation_vector(left)
    for i in range(first + 1, last):
        elapsed += h[i - 1]
        s = elapsed / duration
        a, b = s * s * (3 - 2 * s), s * s * (s - 1)
        da, db = 6 * s * (1 - s) / duration, s * (3 * s - 2)
        for k in range(3):
            d_p, d_v = position[k] - p[last, k], velocity[k] - v[last, k]
            p[i, k] += a * d_p + b * duration * d_v
            v[i, k] += da * d_p + db * d_v
        rotate_in_body(R[i], a * d_R[0], a * d_R[1], a * d_R[2])
