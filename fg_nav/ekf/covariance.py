"""Propagation of the error's covariance over one strapdown step: Ma (30)-(32), AIEZ (1)-(3), to second order.

The error is estimate minus truth, in this order (index of the first of three components; in Ma (29) the order is dphi,
gyro bias, position, velocity, accelerometer bias):

======= ========== ======================================================================
0       dp         position, m, nav
3       dv         velocity, m/s, nav
6       dphi       attitude as a rotation in nav: R_estimate = Exp(dphi) R_true, rad
9       dbg        gyro bias, rad/s, body
12      dba        accelerometer bias, m/s^2, body
======= ========== ======================================================================

A bias estimated too high makes the rate too low, hence the minus signs. With T (`turn`) and the velocity gained u
(`delta_v`) of `fg_nav.mechanisation`, and with the mean of an integrand at both ends of the step for its integral,

    dphi' = dphi - T dbg
    dv'   = dv + (dphi + dphi') / 2 x u - T dba
    dp'   = dp + h (dv + dv') / 2

This is x' = F x with a sparse F, of which only T and [u] cost multiplications. P' = F P F^T is the same map applied to
the columns of P and then to its rows. Noise enters at the end of the step, as density times h.

Density. On a foot the noise of the data sheet is the smallest part. Scale factors, cross-axis terms, soft mounting and
uneven stamps make errors that grow with the motion and last a few samples: a share e of a signal x, correlated over a
time tau, acts on its integral like white noise of density e |x| sqrt(2 tau). So with the acceleration a in nav and the
angular rate w,

    density of the specific force = floor + relative |a|        (squares added),        likewise with |w|.

The floor is the noise while the foot stands. Extra noise of single samples: `fg_nav.recording.find_extra_sigmas`.

References: Foxlin, "Pedestrian tracking with shoe-mounted inertial sensors" (2005); Jimenez et al., "Indoor
pedestrian navigation using an INS/EKF framework for yaw drift reduction and a foot-mounted IMU" (2010), with
the sign of the correction as in `fg_nav.ekf.update`.
"""

from __future__ import annotations

from typing import NamedTuple

from fg_nav.arrays import Floats
from fg_nav.system.compiled import njit

POSITION, VELOCITY, ATTITUDE, GYRO_BIAS, ACC_BIAS = 0, 3, 6, 9, 12  # First index of each part of the error.

SIZE = 15

_MOVING = 9  # Position, velocity, attitude; the biases below have unit rows in F.


class Densities(NamedTuple):
    """Spectral densities (squared) of the process noise: variance of the integral per second."""

    acc: float  # (m/s)^2/s
    gyr: float  # rad^2/s
    gyro_bias: float  # (rad/s)^2/s
    acc_bias: float  # (m/s^2)^2/s


@njit(cache=True)
def propagate_covariance(P: Floats, turn: Floats, delta_v: Floats, h: float, density: Densities) -> None:
    """Replace `P` (15, 15) by F P F^T + Q over `h` s in place, exactly symmetric; T is `turn`, u is `delta_v`, m/s."""
    propagate_columns(P, SIZE, turn, delta_v, h)
    propagate_columns(P.T, _MOVING, turn, delta_v, h)
    for i in range(3):
        P[3 + i, 3 + i] += density.acc * h
        P[6 + i, 6 + i] += density.gyr * h
        P[9 + i, 9 + i] += density.gyro_bias * h
        P[12 + i, 12 + i] += density.acc_bias * h
    for i in range(_MOVING):
        for j in range(i + 1, SIZE):
            P[j, i] = P[i, j]


@njit(cache=True)
def propagate_columns(X: Floats, columns: int, turn: Floats, delta_v: Floats, h: float) -> None:
    """Replace the first `columns` columns x of `X` (15, .) by F x in place."""
    t00, t01, t02 = turn[0, 0], turn[0, 1], turn[0, 2]
    t10, t11, t12 = turn[1, 0], turn[1, 1], turn[1, 2]
    t20, t21, t22 = turn[2, 0], turn[2, 1], turn[2, 2]
    ux, uy, uz = delta_v[0], delta_v[1], delta_v[2]
    for j in range(columns):
        gx, gy, gz = X[9, j], X[10, j], X[11, j]
        ax, ay, az = X[12, j], X[13, j], X[14, j]
        # change of the attitude, its mean over the step, and change of the velocity
        ox = -(t00 * gx + t01 * gy + t02 * gz)
        oy = -(t10 * gx + t11 * gy + t12 * gz)
        oz = -(t20 * gx + t21 * gy + t22 * gz)
        mx, my, mz = X[6, j] + 0.5 * ox, X[7, j] + 0.5 * oy, X[8, j] + 0.5 * oz
        kx = my * uz - mz * uy - (t00 * ax + t01 * ay + t02 * az)
        ky = mz * ux - mx * uz - (t10 * ax + t11 * ay + t12 * az)
        kz = mx * uy - my * ux - (t20 * ax + t21 * ay + t22 * az)
        X[0, j] += h * (X[3, j] + 0.5 * kx)
        X[1, j] += h * (X[4, j] + 0.5 * ky)
        X[2, j] += h * (X[5, j] + 0.5 * kz)
        X[3, j] += kx
        X[4, j] += ky
        X[5, j] += kz
        X[6, j] += ox
        X[7, j] += oy
        X[8, j] += oz


@njit(cache=True)
def add_body_noise(P: Floats, first: int, turn: Floats, sigma: Floats) -> None:
    """Add to the 3 x 3 block of `P` at `first` the extra noise of a sample, `sigma` (3,) in body axes."""
    for axis in range(3):
        if sigma[axis] > 0.0:
            variance = sigma[axis] ** 2
            for i in range(3):
                for j in range(3):
                    P[first + i, first + j] += variance * (turn[i, axis] * turn[j, axis])


class MotionNoise(NamedTuple):
    """Squared densities: floors (m/s)^2/s and rad^2/s, relative parts s, walks of the biases per second."""

    acc_floor: float
    acc_relative: float
    gyr_floor: float
    gyr_relative: float
    gyro_bias: float
    acc_bias: float


@njit(cache=True)
def compute_densities(noise: MotionNoise, gyr: Floats, delta_v: Floats, h: float, gravity: float) -> Densities:
    """Densities for one sample, from its rate and from the velocity it gains in `h` seconds."""
    rate = gyr[0] ** 2 + gyr[1] ** 2 + gyr[2] ** 2
    gained = delta_v[0] ** 2 + delta_v[1] ** 2 + (delta_v[2] - gravity * h) ** 2
    return Densities(
        noise.acc_floor + noise.acc_relative * gained / (h * h),
        noise.gyr_floor + noise.gyr_relative * rate,
        noise.gyro_bias,
        noise.acc_bias,
    )
