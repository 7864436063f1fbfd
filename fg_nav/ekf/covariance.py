"""How the error's covariance moves over one strapdown step.

The error is estimate minus truth, in this order (index of the first of three components):

======= ========== ======================================================================
0       dp         position, m, nav
3       dv         velocity, m/s, nav
6       dphi       attitude as a rotation in nav: R_estimate = Exp(dphi) R_true, rad
9       dbg        gyro bias, rad/s, body
12      dba        accelerometer bias, m/s^2, body
======= ========== ======================================================================

A bias estimated too high makes the rate too low, hence the minus signs. With T and push of
`fg_nav.mechanisation`, and with the mean of an integrand at both ends of the step for its integral,

    dphi' = dphi - T dbg
    dv'   = dv + (dphi + dphi') / 2 x push - T dba
    dp'   = dp + h (dv + dv') / 2

This is x' = F x with a sparse F, of which only T and [push] cost multiplications. P' = F P F^T is the same
map applied to the columns of P and then to its rows. Noise enters at the end of the step, as density times h.

Reference: Foxlin, "Pedestrian tracking with shoe-mounted inertial sensors" (2005); Jimenez et al., "Indoor
pedestrian navigation using an INS/EKF framework for yaw drift reduction and a foot-mounted IMU" (2010), with
the sign of the correction as in `fg_nav.ekf.update`.
"""

from __future__ import annotations

from typing import NamedTuple

from numba import njit

from fg_nav.arrays import Floats

POSITION, VELOCITY, ATTITUDE, GYRO_BIAS, ACC_BIAS = 0, 3, 6, 9, 12
"""First index of each part of the error."""

SIZE = 15

_MOVING = 9


class Densities(NamedTuple):
    """Spectral densities (squared) of the process noise: variance of the integral per second.

    acc (m/s)^2/s, gyr rad^2/s, gyro_bias (rad/s)^2/s, acc_bias (m/s^2)^2/s.
    """

    acc: float
    gyr: float
    gyro_bias: float
    acc_bias: float


@njit(cache=True)
def propagate(P: Floats, turn: Floats, push: Floats, h: float, density: Densities) -> None:
    """Move the covariance `P` (15, 15) over a step of `h` seconds in place; it stays exactly symmetric."""
    carry(P, SIZE, turn, push, h)
    carry(P.T, _MOVING, turn, push, h)
    for i in range(3):
        P[3 + i, 3 + i] += density.acc * h
        P[6 + i, 6 + i] += density.gyr * h
        P[9 + i, 9 + i] += density.gyro_bias * h
        P[12 + i, 12 + i] += density.acc_bias * h
    for i in range(_MOVING):
        for j in range(i + 1, SIZE):
            P[j, i] = P[i, j]


@njit(cache=True)
def carry(X: Floats, columns: int, turn: Floats, push: Floats, h: float) -> None:
    """Replace the first `columns` columns x of `X` (15, .) by F x in place."""
    t00, t01, t02 = turn[0, 0], turn[0, 1], turn[0, 2]
    t10, t11, t12 = turn[1, 0], turn[1, 1], turn[1, 2]
    t20, t21, t22 = turn[2, 0], turn[2, 1], turn[2, 2]
    ux, uy, uz = push[0], push[1], push[2]
    for j in range(columns):
        gx, gy, gz = X[9, j], X[10, j], X[11, j]
        ax, ay, az = X[12, j], X[13, j], X[14, j]
        # what the attitude gains, its mean over the step, and what the velocity gains
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
    """Add to the block of `P` from `first` on what a sample's own `sigma` (3,) in body axes does."""
    for axis in range(3):
        if sigma[axis] > 0.0:
            variance = sigma[axis] ** 2
            for i in range(3):
                for j in range(3):
                    P[first + i, first + j] += variance * (turn[i, axis] * turn[j, axis])
