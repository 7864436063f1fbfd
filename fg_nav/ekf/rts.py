"""The backward pass of a filter (Rauch, Tung, Striebel): every state given the whole walk (fixed-interval smoother).

Written for the error e = estimate - truth of the filter at each sample, after its own injections. The information of
later innovations nu on it is accumulated backward in the adjoint lambda (15,) and its information Lambda (15, 15)
(modified Bryson-Frazier), with c = P h^T, s = h c + r, K = c / s from the traces of the updates:

    end of the walk     lambda = 0,  Lambda = 0,  e = 0
    over a step         lambda <- F^T lambda                 Lambda <- F^T Lambda F
    over an update      lambda <- lambda + h^T (nu / s - K^T lambda)
                        Lambda <- (I - K h)^T Lambda (I - K h) + h^T h / s

    at a footfall       e = P lambda,   covariance of the smoothed state  P - P Lambda P

P is recorded at footfalls only. In between the same e follows from the noise w of the step, whose smoothed value is
Q lambda (Koopman 1993), and from the error injected at each update:

    over a step         e <- F^-1 (e - Q lambda),  lambda before it is propagated
    over an update      e <- e + K nu

Both agree but for rounding (tested), and the path has no steps. The smoothed state is the filter's minus e. No matrix
is inverted: F is a unit triangle, and its inverse is the same map with other signs. With the symbols of
`fg_nav.ekf.covariance`,

    dphi' = dphi - T dbg,   k = (dphi + dphi') / 2 x u - T dba,   dv' = dv + k,   dp' = dp + h (dv + k / 2)

the transpose takes (p, v, a, g, b)', the parts of lambda on position, velocity, attitude and the two biases, to

    kappa = v' + h p' / 2,   mu = u x kappa,
    p = p',   v = v' + h p',   a = a' + mu,   g = g' - T^T (a' + mu / 2),   b = b' - T^T kappa

Linear where the filter is: F belongs to the path of the filter, each innovation to the state before its injection.
A heading that is only observed late in a walk turns its beginning by the linear part of the rotation.

References: Bierman (1977), Factorization Methods for Discrete Sequential Estimation, X.; Koopman (1993), "Disturbance
smoother for state space models"; Bar-Shalom, Li, Kirubarajan (2001), 8.6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.ekf.covariance import ATTITUDE, SIZE, VELOCITY, Densities, MotionNoise, compute_densities
from fg_nav.ekf.update import INNOVATION, ROW, VARIANCE, inject_error
from fg_nav.mechanisation import NavState, multiply, strapdown
from fg_nav.system.compiled import njit


class Samples(NamedTuple):
    """`h` (N,) s; `acc`, `gyr` (N, 3) and the extra standard deviations of single ones (`find_extra_sigmas`)."""

    h: Floats
    acc: Floats
    gyr: Floats
    acc_sigma: Floats
    gyr_sigma: Floats


class Track(NamedTuple):
    """Path of N samples and K footfalls, one sample each, of a pass."""

    position: Floats  # (N, 3) m
    velocity: Floats  # (N, 3) m/s
    nav_R_body: Floats  # (N, 3, 3)
    nis: Floats  # (N,) of the velocity, NaN without an update
    gyro_bias: Floats  # (K, 3) rad/s
    covariance: Floats  # (K, 15, 15)
    innovation: Floats  # (K, 4) standardized, columns of `fg_nav.ekf.measurements`, NaN where not used


class Tape(NamedTuple):
    """Further input of the backward pass: 50 MB a million samples, and 400 MB a million of them in stance.

    A pass without smoothing has one row of `bias` and `stance`, which is overwritten.
    """

    bias: Floats  # (N, 6) of gyroscope (rad/s) and accelerometer (m/s^2) at each sample
    stance: Floats  # (S, 3, 17) traces (`fg_nav.ekf.update`) of the velocity in stance, from the start on
    footfall: Floats  # (K, 3, 32) traces of the attitude, s = 0 without an update


@njit(cache=True)
def propagate_information(information: Floats, turn: Floats, delta_v: Floats, h: float) -> None:
    """Replace Lambda (15, 15) by F^T Lambda F in place; it stays exactly symmetric."""
    propagate_adjoint(information, 0, SIZE, turn, delta_v, h)
    propagate_adjoint(information.T, VELOCITY, SIZE, turn, delta_v, h)
    for i in range(SIZE):
        for j in range(i + 1, SIZE):
            information[i, j] = information[j, i]


@njit(cache=True)
def propagate_adjoint(X: Floats, first: int, stop: int, turn: Floats, delta_v: Floats, h: float) -> None:
    """Replace the columns x, `first` <= j < `stop`, of `X` (15, .) by F^T x in place."""
    t00, t01, t02 = turn[0, 0], turn[0, 1], turn[0, 2]
    t10, t11, t12 = turn[1, 0], turn[1, 1], turn[1, 2]
    t20, t21, t22 = turn[2, 0], turn[2, 1], turn[2, 2]
    ux, uy, uz = delta_v[0], delta_v[1], delta_v[2]
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
def undo_step(e: Floats, turn: Floats, delta_v: Floats, h: float) -> None:
    """Replace the error `e` (15,) by F^-1 e in place."""
    tg, ta = np.empty(3), np.empty(3)
    for i in range(3):
        tg[i] = turn[i, 0] * e[9] + turn[i, 1] * e[10] + turn[i, 2] * e[11]
        ta[i] = turn[i, 0] * e[12] + turn[i, 1] * e[13] + turn[i, 2] * e[14]
    mx, my, mz = e[6] + 0.5 * tg[0], e[7] + 0.5 * tg[1], e[8] + 0.5 * tg[2]
    gained = (
        my * delta_v[2] - mz * delta_v[1] - ta[0],
        mz * delta_v[0] - mx * delta_v[2] - ta[1],
        mx * delta_v[1] - my * delta_v[0] - ta[2],
    )
    for i in range(3):
        e[6 + i] += tg[i]
        e[3 + i] -= gained[i]
        e[i] -= h * (e[3 + i] + 0.5 * gained[i])


@njit(cache=True)
def remove_noise(
    e: Floats, adjoint: Floats, turn: Floats, h: float, density: Densities, acc_sigma: Floats, gyr_sigma: Floats
) -> None:
    """Subtract from the error `e` (15,) the smoothed noise of the step: Q lambda, lambda after the step."""
    for i in range(3):
        e[3 + i] -= density.acc * h * adjoint[3 + i]
        e[6 + i] -= density.gyr * h * adjoint[6 + i]
        e[9 + i] -= density.gyro_bias * h * adjoint[9 + i]
        e[12 + i] -= density.acc_bias * h * adjoint[12 + i]
    _remove_body_noise(e, adjoint, ATTITUDE, turn, gyr_sigma)
    _remove_body_noise(e, adjoint, VELOCITY, turn, acc_sigma)


@njit(cache=True)
def _remove_body_noise(e: Floats, adjoint: Floats, first: int, turn: Floats, sigma: Floats) -> None:
    """Subtract from `e` at `first` the smoothed extra noise of a sample, `sigma` (3,) in body axes."""
    for axis in range(3):
        if sigma[axis] > 0.0:
            along = 0.0
            for i in range(3):
                along += turn[i, axis] * adjoint[first + i]
            for i in range(3):
                e[first + i] -= sigma[axis] ** 2 * turn[i, axis] * along


@njit(cache=True)
def undo_update(e: Floats, adjoint: Floats, information: Floats, trace: Floats, h: Floats) -> None:
    """Carry `e`, lambda (`adjoint`) and Lambda back over the update by row `h` (15,) that left this trace."""
    # weighted = Lambda K, gained = nu / s - K^T lambda, square = K^T Lambda K + 1 / s
    weighted, s = np.zeros(SIZE), trace[VARIANCE]
    gained, square = trace[INNOVATION] / s, 1.0 / s
    for i in range(SIZE):
        gain = trace[i] / s
        e[i] += gain * trace[INNOVATION]
        gained -= gain * adjoint[i]
        for j in range(SIZE):
            weighted[i] += information[i, j] * (trace[j] / s)
        square += gain * weighted[i]
    for i in range(SIZE):
        adjoint[i] += h[i] * gained
        for j in range(SIZE):
            information[i, j] += h[i] * h[j] * square - (h[i] * weighted[j] + weighted[i] * h[j])


@njit(cache=True)
def smooth_backward(
    first: int,
    samples: Samples,
    stands: Bools,
    rows: Ints,
    noise: MotionNoise,
    gravity: float,
    track: Track,
    tape: Tape,
) -> None:
    """Replace the filter's `track` and the biases of its `tape` from sample `first` on by the smoothed ones."""
    last = len(samples.h) - 1
    e, adjoint, information = np.zeros(SIZE), np.zeros(SIZE), np.zeros((SIZE, SIZE))
    injected, along_velocity = np.empty(SIZE), np.zeros((3, SIZE))
    for axis in range(3):
        along_velocity[axis, VELOCITY + axis] = 1.0
    stood, k = len(tape.stance), len(rows)
    for i in range(last, first - 1, -1):
        # back over the period of the sample
        if i < last:
            _undo_step(i, samples, noise, gravity, track, tape, e, adjoint, information)
        # at a footfall: error P lambda anew, and the smoothed covariance
        at_footfall = k > 0 and rows[k - 1] == i
        if at_footfall:
            k -= 1
            _smooth_footfall(track.covariance[k], e, adjoint, information)
        # inject the error into the recorded state
        smoothed = view_state(i, track, tape)
        injected[:] = e
        inject_error(smoothed, injected)
        if at_footfall:
            track.gyro_bias[k] = smoothed.gyro_bias
            # back over the updates of the footfall, then of the stance
            for row in range(2, -1, -1):
                trace = tape.footfall[k, row]
                if trace[VARIANCE] > 0.0:
                    undo_update(e, adjoint, information, trace, trace[ROW:])
        if stands[i]:
            stood -= 1
            for axis in range(2, -1, -1):
                undo_update(e, adjoint, information, tape.stance[stood, axis], along_velocity[axis])


@njit(cache=True)
def _undo_step(
    i: int,
    samples: Samples,
    noise: MotionNoise,
    gravity: float,
    track: Track,
    tape: Tape,
    e: Floats,
    adjoint: Floats,
    information: Floats,
) -> None:
    """Carry `e`, lambda (15,), Lambda (15, 15) back over the period of sample `i`; F and Q from the filter's path."""
    turn, delta_v, h = np.empty((3, 3)), np.empty(3), samples.h[i]
    before = view_state(i, track, tape)
    moved = NavState(np.zeros(3), np.zeros(3), before.nav_R_body.copy(), before.gyro_bias, before.acc_bias)
    strapdown(moved, samples.acc[i], samples.gyr[i], h, gravity, turn, delta_v)
    density = compute_densities(noise, samples.gyr[i], delta_v, h, gravity)
    remove_noise(e, adjoint, turn, h, density, samples.acc_sigma[i], samples.gyr_sigma[i])
    undo_step(e, turn, delta_v, h)
    propagate_adjoint(adjoint.reshape(SIZE, 1), 0, 1, turn, delta_v, h)
    propagate_information(information, turn, delta_v, h)


@njit(cache=True)
def _smooth_footfall(P: Floats, e: Floats, adjoint: Floats, information: Floats) -> None:
    """Set `e` to P lambda and the filter's `P` (15, 15) to the smoothed P - P Lambda P, exactly symmetric."""
    error, change = multiply(P, adjoint.reshape(SIZE, 1)), multiply(P, multiply(information, P))
    for i in range(SIZE):
        e[i] = error[i, 0]
        for j in range(i + 1):
            P[i, j] = P[j, i] = (P[i, j] - change[i, j] + P[j, i] - change[j, i]) / 2


@njit(cache=True)
def view_state(i: int, track: Track, tape: Tape) -> NavState:
    """The state at sample `i`, as views."""
    return NavState(track.position[i], track.velocity[i], track.nav_R_body[i], tape.bias[i, :3], tape.bias[i, 3:])
