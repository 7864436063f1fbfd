"""The way back over a filter's pass: every state given the whole walk (fixed-interval smoother, Rauch, Tung, Striebel).

Written for the error e = estimate - truth of the filter at each sample, of which the filter has already taken off what
it knew. What later innovations nu tell of it is gathered backward in lambda (15,) and its information Lambda (15, 15)
(modified Bryson-Frazier), with c = P h^T, s = h c + r, K = c / s from the traces of the corrections:

    end of the walk     lambda = 0,  Lambda = 0,  e = 0
    over a step         lambda <- F^T lambda                 Lambda <- F^T Lambda F
    over a correction   lambda <- lambda + h^T (nu / s - K^T lambda)
                        Lambda <- (I - K h)^T Lambda (I - K h) + h^T h / s

    at a footfall       e = P lambda,   covariance of the smoothed state  P - P Lambda P

P is kept at footfalls only. In between the same e follows from the noise w of the step, whose smoothed value is
Q lambda (Koopman 1993), and from what was taken off at each correction:

    over a step         e <- F^-1 (e - Q lambda),  lambda before it is carried back
    over a correction   e <- e + K nu

Both agree but for rounding (tested), and the path has no steps. The smoothed state is the filter's with e taken off. No
matrix is inverted: F is a unit triangle, and its inverse is the same map with other signs.

Linear where the filter is: F belongs to the path of the filter, each innovation to the state before it was taken off.
A heading that is only known late in a walk turns its beginning by the linear part of the rotation.

References: Bierman (1977), Factorization Methods for Discrete Sequential Estimation, X.; Koopman (1993), "Disturbance
smoother for state space models"; Bar-Shalom, Li, Kirubarajan (2001), 8.6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.ekf.adjoint import (
    carry_adjoint,
    carry_information,
    take_noise_off,
    undo_component,
    undo_correction,
    undo_step,
)
from fg_nav.ekf.covariance import SIZE, VELOCITY
from fg_nav.ekf.noise import MotionNoise, densities_in_motion
from fg_nav.ekf.track import Tape, Track
from fg_nav.ekf.update import ROW, VARIANCE, take_off
from fg_nav.mechanisation import NavState, strapdown


class Samples(NamedTuple):
    """`h` (N,) s; `acc`, `gyr` (N, 3) and by how much single ones are doubted (`fg_nav.sample_noise`)."""

    h: Floats
    acc: Floats
    gyr: Floats
    acc_doubt: Floats
    gyr_doubt: Floats


@njit(cache=True)
def smooth_back(
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
    stood, k = len(tape.stance), len(rows)
    for i in range(last, first - 1, -1):
        if i < last:
            _undo_step(i, samples, noise, gravity, track, tape, e, adjoint, information)
        at_footfall = k > 0 and rows[k - 1] == i
        if at_footfall:
            k -= 1
            _smooth_footfall(track.covariance[k], e, adjoint, information)
        smoothed = state_at(i, track, tape)
        take_off(smoothed, e.copy())
        if at_footfall:
            track.gyro_bias[k] = smoothed.gyro_bias
            _undo_footfall(tape.footfall[k], e, adjoint, information)
        if stands[i]:
            stood -= 1
            for axis in range(2, -1, -1):
                undo_component(e, adjoint, information, tape.stance[stood, axis], VELOCITY + axis)


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
    """Go back over the step that began at sample `i`, along the path of the filter."""
    turn, push, h = np.empty((3, 3)), np.empty(3), samples.h[i]
    before = state_at(i, track, tape)
    moved = NavState(np.zeros(3), np.zeros(3), before.nav_R_body.copy(), before.gyro_bias, before.acc_bias)
    strapdown(moved, samples.acc[i], samples.gyr[i], h, gravity, turn, push)
    density = densities_in_motion(noise, samples.gyr[i], push, h, gravity)
    take_noise_off(e, adjoint, turn, h, density, samples.acc_doubt[i], samples.gyr_doubt[i])
    undo_step(e, turn, push, h)
    carry_adjoint(adjoint.reshape(SIZE, 1), 0, 1, turn, push, h)
    carry_information(information, turn, push, h)


@njit(cache=True)
def _smooth_footfall(P: Floats, e: Floats, adjoint: Floats, information: Floats) -> None:
    """Write the error `e` (15,) and make the filter's `P` (15, 15) the smoothed one."""
    e[:] = P @ adjoint
    P -= P @ information @ P
    P[:] = (P + P.T) / 2


@njit(cache=True)
def _undo_footfall(traces: Floats, e: Floats, adjoint: Floats, information: Floats) -> None:
    for row in range(2, -1, -1):
        if traces[row, VARIANCE] > 0.0:
            undo_correction(e, adjoint, information, traces[row], traces[row, ROW:])


@njit(cache=True)
def state_at(i: int, track: Track, tape: Tape) -> NavState:
    """The state at sample `i`, as views."""
    return NavState(track.position[i], track.velocity[i], track.nav_R_body[i], tape.bias[i, :3], tape.bias[i, 3:])
