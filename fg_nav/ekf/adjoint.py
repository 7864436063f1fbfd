"""The steps of `fg_nav.ekf.covariance` and the corrections of `fg_nav.ekf.update`, taken backward.

The adjoint lambda and its information Lambda go through the transpose of a map, the error e through its inverse. With
the symbols of the step forward,

    dphi' = dphi - T dbg,   k = (dphi + dphi') / 2 x push - T dba,   dv' = dv + k,   dp' = dp + h (dv + k / 2)

the transpose takes (p, v, a, g, b)', the parts of lambda on position, velocity, attitude and the two biases, to

    kappa = v' + h p' / 2,   mu = push x kappa,
    p = p',   v = v' + h p',   a = a' + mu,   g = g' - T^T (a' + mu / 2),   b = b' - T^T kappa
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.ekf.covariance import ATTITUDE, SIZE, VELOCITY, Densities
from fg_nav.ekf.update import INNOVATION, VARIANCE


@njit(cache=True)
def carry_information(information: Floats, turn: Floats, push: Floats, h: float) -> None:
    """Replace Lambda (15, 15) by F^T Lambda F in place; it stays exactly symmetric."""
    carry_adjoint(information, 0, SIZE, turn, push, h)
    carry_adjoint(information.T, VELOCITY, SIZE, turn, push, h)
    for i in range(SIZE):
        for j in range(i + 1, SIZE):
            information[i, j] = information[j, i]


@njit(cache=True)
def carry_adjoint(X: Floats, first: int, stop: int, turn: Floats, push: Floats, h: float) -> None:
    """Replace the columns `first` <= j < `stop` of `X` (15, .) by F^T times them, in place."""
    t00, t01, t02 = turn[0, 0], turn[0, 1], turn[0, 2]
    t10, t11, t12 = turn[1, 0], turn[1, 1], turn[1, 2]
    t20, t21, t22 = turn[2, 0], turn[2, 1], turn[2, 2]
    ux, uy, uz = push[0], push[1], push[2]
    for j in range(first, stop):
        kx, ky, kz = X[3, j] + 0.5 * h * X[0, j], X[4, j] + 0.5 * h * X[1, j], X[5, j] + 0.5 * h * X[2, j]
        mx, my, mz = uy * kz - uz * ky, uz * kx - ux * kz, ux * ky - uy * kx
        ox, oy, oz = X[6, j] + 0.5 * mx, X[7, j] + 0.5 * my, X[8, j] + 0.5 * mz
        X[3, j] += h * X[0, j]
        X[4, j] += h * X[1, j]
        X[5, j] += h * X[2, j]
        X[6, j] += mx
        X[7, j] += my
        X[8, j] += mz
        X[9, j] -= t00 * ox + t10 * oy + t20 * oz
        X[10, j] -= t01 * ox + t11 * oy + t21 * oz
        X[11, j] -= t02 * ox + t12 * oy + t22 * oz
        X[12, j] -= t00 * kx + t10 * ky + t20 * kz
        X[13, j] -= t01 * kx + t11 * ky + t21 * kz
        X[14, j] -= t02 * kx + t12 * ky + t22 * kz


@njit(cache=True)
def undo_step(e: Floats, turn: Floats, push: Floats, h: float) -> None:
    """Replace the error `e` (15,) by F^-1 e in place."""
    tg, ta = np.empty(3), np.empty(3)
    for i in range(3):
        tg[i] = turn[i, 0] * e[9] + turn[i, 1] * e[10] + turn[i, 2] * e[11]
        ta[i] = turn[i, 0] * e[12] + turn[i, 1] * e[13] + turn[i, 2] * e[14]
    mx, my, mz = e[6] + 0.5 * tg[0], e[7] + 0.5 * tg[1], e[8] + 0.5 * tg[2]
    gained = (
        my * push[2] - mz * push[1] - ta[0],
        mz * push[0] - mx * push[2] - ta[1],
        mx * push[1] - my * push[0] - ta[2],
    )
    for i in range(3):
        e[6 + i] += tg[i]
        e[3 + i] -= gained[i]
        e[i] -= h * (e[3 + i] + 0.5 * gained[i])


@njit(cache=True)
def take_noise_off(
    e: Floats, adjoint: Floats, turn: Floats, h: float, density: Densities, acc_doubt: Floats, gyr_doubt: Floats
) -> None:
    """Take off the error `e` (15,) what the noise of the step added to it: Q lambda, lambda after the step."""
    for i in range(3):
        e[3 + i] -= density.acc * h * adjoint[3 + i]
        e[6 + i] -= density.gyr * h * adjoint[6 + i]
        e[9 + i] -= density.gyro_bias * h * adjoint[9 + i]
        e[12 + i] -= density.acc_bias * h * adjoint[12 + i]
    _take_body_noise_off(e, adjoint, ATTITUDE, turn, gyr_doubt)
    _take_body_noise_off(e, adjoint, VELOCITY, turn, acc_doubt)


@njit(cache=True)
def _take_body_noise_off(e: Floats, adjoint: Floats, first: int, turn: Floats, sigma: Floats) -> None:
    for axis in range(3):
        if sigma[axis] > 0.0:
            along = 0.0
            for i in range(3):
                along += turn[i, axis] * adjoint[first + i]
            for i in range(3):
                e[first + i] -= sigma[axis] ** 2 * turn[i, axis] * along


@njit(cache=True)
def undo_correction(e: Floats, adjoint: Floats, information: Floats, trace: Floats, h: Floats) -> None:
    """Go back over the correction by the row `h` (15,) that left this trace."""
    gain, gathered = _gain_and_gathered(e, information, trace)
    told = trace[INNOVATION] / trace[VARIANCE] - np.dot(gain, adjoint)
    square = np.dot(gain, gathered) + 1.0 / trace[VARIANCE]
    for i in range(SIZE):
        adjoint[i] += h[i] * told
        for j in range(SIZE):
            information[i, j] += h[i] * h[j] * square - (h[i] * gathered[j] + gathered[i] * h[j])


@njit(cache=True)
def undo_component(e: Floats, adjoint: Floats, information: Floats, trace: Floats, index: int) -> None:
    """`undo_correction` for a unit row, cheaper."""
    gain, gathered = _gain_and_gathered(e, information, trace)
    adjoint[index] += trace[INNOVATION] / trace[VARIANCE] - np.dot(gain, adjoint)
    square = np.dot(gain, gathered) + 1.0 / trace[VARIANCE]
    for j in range(SIZE):
        information[index, j] -= gathered[j]
        information[j, index] -= gathered[j]
    information[index, index] += square


@njit(cache=True)
def _gain_and_gathered(e: Floats, information: Floats, trace: Floats) -> tuple[Floats, Floats]:
    """Put K nu back onto `e`; returns K (15,) and Lambda K (15,)."""
    gain, gathered = trace[:SIZE] / trace[VARIANCE], np.empty(SIZE)
    for i in range(SIZE):
        e[i] += gain[i] * trace[INNOVATION]
        gathered[i] = 0.0
        for j in range(SIZE):
            gathered[i] += information[i, j] * gain[j]
    return gain, gathered
