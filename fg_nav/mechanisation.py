"""One step of strapdown navigation, exact for constant body rate and specific force.

Symbols

=========== ========= ==================================================================================
R           -         attitude, nav_R_body
v, p        m/s, m    velocity and position in nav
w, f        rad/s,    angular rate and specific force in the body frame, biases taken off;
            m/s^2     a sample is held over its own period h: from its stamp to the next one
theta       rad       w h
g           m/s^2     (0, 0, -gravity)
=========== ========= ==================================================================================

With the integrals of the turning body frame,

    Gamma_1 = sum [theta]^n / (n+1)!,   Gamma_2 = sum [theta]^n / (n+2)!,   T = h R Gamma_1  ("turn", s),

the step is

    p' = p + v h + (R Gamma_2 f + g / 2) h^2
    v' = v + T f + g h                                    (T f is the "push")
    R' = R Exp(theta) = R + T [w]                         (because Gamma_1 [theta] = Exp(theta) - I)

A negative h steps back over the same sample. Reference for the Gamma_n: Bloesch et al. (2012), "State
estimation for legged robots: consistent fusion of leg kinematics and IMU".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.system.compiled import njit

SERIES_BELOW = 0.01  # Squared angle, rad^2, below which the series are exact to rounding.
TILT_TIME_S = 0.25  # Time constant of `nudge_tilt` where a foot that stands shows which way is up.


class NavState(NamedTuple):
    """The filter's state as arrays that are changed in place; frames and units as above."""

    position: Floats
    velocity: Floats
    nav_R_body: Floats
    gyro_bias: Floats
    acc_bias: Floats


@njit(cache=True)
def rotation_series(x: float) -> tuple[float, float, float]:
    """Coefficients (1-cos)/x, (a-sin)/a^3 and (cos-1+x/2)/x^2 at squared angle x = a^2 in rad^2."""
    if x < SERIES_BELOW:
        first = 0.5 - x / 24 * (1 - x / 30 * (1 - x / 56 * (1 - x / 90)))
        second = 1 / 6 - x / 120 * (1 - x / 42 * (1 - x / 72 * (1 - x / 110)))
        third = 1 / 24 - x / 720 * (1 - x / 56 * (1 - x / 90 * (1 - x / 132)))
        return first, second, third
    angle = np.sqrt(x)
    cosine, sine = np.cos(angle), np.sin(angle)
    return (1 - cosine) / x, (angle - sine) / (angle * x), (cosine - 1 + x / 2) / (x * x)


@njit(cache=True)
def strapdown(state: NavState, acc: Floats, gyr: Floats, h: float, gravity: float, turn: Floats, push: Floats) -> None:
    """Propagate `state` in place over one sample `acc` (3,) m/s^2, `gyr` (3,) rad/s, held for `h` seconds.

    Writes `turn` (3, 3) s and `push` (3,) m/s for the covariance propagation.
    """
    position, velocity, R, gyro_bias, acc_bias = state
    wx, wy, wz = gyr[0] - gyro_bias[0], gyr[1] - gyro_bias[1], gyr[2] - gyro_bias[2]
    fx, fy, fz = acc[0] - acc_bias[0], acc[1] - acc_bias[1], acc[2] - acc_bias[2]
    x, y, z = wx * h, wy * h, wz * h
    a, b, c = rotation_series(x * x + y * y + z * z)
    # cross = theta x f, twice = theta x (theta x f): the two terms of Gamma_2 f that are not f / 2
    cx, cy, cz = y * fz - z * fy, z * fx - x * fz, x * fy - y * fx
    tx, ty, tz = y * cz - z * cy, z * cx - x * cz, x * cy - y * cx
    sx = 0.5 * fx + b * cx + c * tx
    sy = 0.5 * fy + b * cy + c * ty
    sz = 0.5 * fz + b * cz + c * tz
    for i in range(3):
        r0, r1, r2 = R[i, 0], R[i, 1], R[i, 2]
        # row i of R Gamma_1 = R (I + a [theta] + b [theta]^2): r + a (r x theta) + b (r x theta) x theta
        u0, u1, u2 = r1 * z - r2 * y, r2 * x - r0 * z, r0 * y - r1 * x
        t0 = h * (r0 + a * u0 + b * (u1 * z - u2 * y))
        t1 = h * (r1 + a * u1 + b * (u2 * x - u0 * z))
        t2 = h * (r2 + a * u2 + b * (u0 * y - u1 * x))
        turn[i, 0], turn[i, 1], turn[i, 2] = t0, t1, t2
        push[i] = t0 * fx + t1 * fy + t2 * fz
        position[i] += h * velocity[i] + h * h * (r0 * sx + r1 * sy + r2 * sz)
        velocity[i] += push[i]
        R[i, 0], R[i, 1], R[i, 2] = r0 + t1 * wz - t2 * wy, r1 + t2 * wx - t0 * wz, r2 + t0 * wy - t1 * wx
    position[2] -= 0.5 * gravity * h * h
    velocity[2] -= gravity * h


@njit(cache=True)
def integrate_strides(
    acc: Floats, gyr: Floats, h: Floats, start: Ints, stop: Ints, nav_R_body: Floats, bias: Floats, gravity: float
) -> Floats:
    """Return the velocity (K, 3) m/s at the end of K strides, samples `start` to `stop` (K,), each begun at rest.

    `nav_R_body` (K or more, 3, 3) is propagated in place; `bias` (K or more, 3) rad/s is subtracted; `h` (N,) s.
    """
    count = len(start)
    velocity, position, acc_bias = np.zeros((count, 3)), np.zeros(3), np.zeros(3)
    turn, push = np.zeros((3, 3)), np.zeros(3)
    for k in range(count):
        state = NavState(position, velocity[k], nav_R_body[k], bias[k], acc_bias)
        for i in range(start[k], stop[k]):
            strapdown(state, acc[i], gyr[i], h[i], gravity, turn, push)
    return velocity


@njit(cache=True)
def write_state(
    position: Floats, velocity: Floats, nav_R_body: Floats, p: Floats, v: Floats, R: Floats, i: int
) -> None:
    """Write a state to row `i` of a path (N, 3), (N, 3), (N, 3, 3)."""
    for k in range(3):
        p[i, k], v[i, k] = position[k], velocity[k]
        for axis in range(3):
            R[i, k, axis] = nav_R_body[k, axis]


@njit(cache=True)
def rotate_in_body(R: Floats, x: float, y: float, z: float) -> None:
    """Replace R by R Exp((x, y, z)): each row r becomes r + (1 - b q) (r x a) + c (r x a) x a, q = |a|^2."""
    square = x * x + y * y + z * z
    c, b, _ = rotation_series(square)
    s = 1.0 - b * square
    for i in range(3):
        r0, r1, r2 = R[i, 0], R[i, 1], R[i, 2]
        u0, u1, u2 = r1 * z - r2 * y, r2 * x - r0 * z, r0 * y - r1 * x
        R[i, 0] = r0 + s * u0 + c * (u1 * z - u2 * y)
        R[i, 1] = r1 + s * u1 + c * (u2 * x - u0 * z)
        R[i, 2] = r2 + s * u2 + c * (u0 * y - u1 * x)


@njit(cache=True)
def nudge_tilt(nav_R_body: Floats, force: Floats, gain: float) -> None:
    """Correct the tilt in place by a share `gain` of the angle from `force` (3,), body frame, to up; orthonormalize.

    In free fall there is no vertical: the attitude is left unchanged.
    """
    R = nav_R_body
    fx, fy, fz = force[0], force[1], force[2]
    e0, e1, e2, n0, n1, n2, u0, u1, u2 = R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2], R[2, 0], R[2, 1], R[2, 2]
    strength = np.sqrt(fx * fx + fy * fy + fz * fz)
    share = gain / strength if strength > 0.0 else 0.0
    along_east, along_north = e0 * fx + e1 * fy + e2 * fz, n0 * fx + n1 * fy + n2 * fz
    u0 += share * (along_east * e0 + along_north * n0)
    u1 += share * (along_east * e1 + along_north * n1)
    u2 += share * (along_east * e2 + along_north * n2)
    length = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
    u0, u1, u2 = u0 / length, u1 / length, u2 / length
    over = n0 * u0 + n1 * u1 + n2 * u2
    n0, n1, n2 = n0 - over * u0, n1 - over * u1, n2 - over * u2
    length = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    n0, n1, n2 = n0 / length, n1 / length, n2 / length
    R[0, 0], R[0, 1], R[0, 2] = n1 * u2 - n2 * u1, n2 * u0 - n0 * u2, n0 * u1 - n1 * u0
    R[1, 0], R[1, 1], R[1, 2] = n0, n1, n2
    R[2, 0], R[2, 1], R[2, 2] = u0, u1, u2


@njit(cache=True)
def rotation_about(v: Floats) -> Floats:
    """Exp(v) (3, 3) of a rotation vector (3,) rad."""
    R = np.eye(3)
    rotate_in_body(R, v[0], v[1], v[2])
    return R


@njit(cache=True)
def cross_matrix(v: Floats) -> Floats:
    """[v] (3, 3), so that [v] w = v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@njit(cache=True)
def right_jacobian(theta: Floats) -> Floats:
    """Jr (3, 3) of a rotation vector (3,) rad: Exp(theta + d) = Exp(theta) Exp(Jr d); the left one is Jr(-theta)."""
    x, y, z = theta[0], theta[1], theta[2]
    a, b, _ = rotation_series(x * x + y * y + z * z)
    J = np.empty((3, 3))
    J[0, 0], J[0, 1], J[0, 2] = 1.0 - b * (y * y + z * z), b * x * y + a * z, b * x * z - a * y
    J[1, 0], J[1, 1], J[1, 2] = b * x * y - a * z, 1.0 - b * (x * x + z * z), b * y * z + a * x
    J[2, 0], J[2, 1], J[2, 2] = b * x * z + a * y, b * y * z - a * x, 1.0 - b * (x * x + y * y)
    return J


@njit(cache=True)
def multiply(A: Floats, B: Floats) -> Floats:
    """A B in loops, for compiled code: compiled sooner than `@`, and as fast on a few dozen rows."""
    out = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            for j in range(B.shape[1]):
                out[i, j] += A[i, k] * B[k, j]
    return out


@njit(cache=True)
def transpose(A: Floats) -> Floats:
    """A^T as an array of its own, in rows."""
    out = np.empty((A.shape[1], A.shape[0]))
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[j, i] = A[i, j]
    return out


@njit(cache=True)
def rotation_vector(R: Floats) -> Floats:
    """Return the rotation vector (3,) rad of a rotation well below half a turn."""
    x, y, z = 0.5 * (R[2, 1] - R[1, 2]), 0.5 * (R[0, 2] - R[2, 0]), 0.5 * (R[1, 0] - R[0, 1])
    sine = np.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    stretch = np.arctan2(sine, cosine) / sine if sine >= 1e-12 else 1.0
    axis = np.empty(3)
    axis[0], axis[1], axis[2] = x * stretch, y * stretch, z * stretch
    return axis
