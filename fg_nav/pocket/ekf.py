"""The filter of Munoz Diaz et al. (2017): orientation and gyro bias of a sensor in a trouser pocket.

    begin       level by the first second, bias zero                                          (start)
    each sample
        predict     attitude by the rate less its bias, bias by its model                     (prediction, Eq. 3-11)
        gravity     where the specific force looks like gravity alone: roll and pitch         (updates, Eq. 12-14)
        field       where the field keeps still: how it turned since the last sample          (updates, Eq. 15-16)
        keep        attitude, bias, their sigmas

Where it sees a bias from. Gravity shows drifts of the tilt, that is of the two biases that are level at the time. The
differential field shows the bias across the field: where the body keeps one attitude to it, two of three. A leg that
swings, or a walk that turns, puts the third across as well. Nowhere does the heading itself come in: turned about up,
all is as before.

A rate is the mean over the period from its stamp to the next one; a field is that of its stamp. The specific force at a
stamp is made of several samples (`gravity`).

Reference: Munoz Diaz, de Ponte Mueller, Garcia Dominguez (2017), "Use of the Magnetic Field for Improving Gyroscopes'
Biases Estimation", Sensors 17(4) 832.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.pocket.belief import GYRO_BIAS, SIZE, Belief, Chain, PocketState, belief_of, blank_chain
from fg_nav.pocket.detectors import steady_field, zero_acceleration
from fg_nav.pocket.difference import begin
from fg_nav.pocket.euler import axes, degenerate, inverse_axes
from fg_nav.pocket.gravity import force_at_stamps, mean_force, thinned
from fg_nav.pocket.parameters import PocketParameters
from fg_nav.pocket.prediction import predict
from fg_nav.pocket.start import PocketStart, level_start
from fg_nav.pocket.track import PocketTrack
from fg_nav.pocket.updates import absolute_gravity, differential_field
from fg_nav.recording import Recording

KEPT_EVERY_S = 1.0
"""The whole covariance is kept so often: 40 minutes of it are 0.7 MB."""


class Inputs(NamedTuple):
    """Samples as the pass takes them: periods `h` (N,) s, `rate`, `force`, `field` (N, 3), and when to use the latter.

    `gravity`, `fresh` and `steady` (N,): whether the force is gravity alone, there is a field, and it kept still.
    """

    h: Floats
    rate: Floats
    force: Floats
    field: Floats
    gravity: Bools
    fresh: Bools
    steady: Bools


class Kept(NamedTuple):
    """What the pass writes, as in `PocketTrack`; `covariance` of every `every`-th sample."""

    nav_R_body: Floats
    gyro_bias: Floats
    sigma: Floats
    covariance: Floats
    gravity_nis: Floats
    field_nis: Floats
    every: int


def estimate_pocket(
    recording: Recording,
    parameters: PocketParameters = PocketParameters(),
    start: PocketStart | None = None,
) -> PocketTrack:
    """Estimate orientation and gyro bias of a sensor in a trouser pocket.

    Parameters
    ----------
    recording : Recording
        Without a magnetometer, or in rows without one, the field is not used.
    parameters : PocketParameters
        Of a preset, `fg_nav.pocket.presets`; the paper's, corrected, by default.
    start : PocketStart
        Attitude at the first sample; level with heading 0 if None.

    Raises
    ------
    EstimationError
        Where it cannot be levelled, or the filter diverges to infinity; with a state in Euler angles also where these
        end.
    """
    inputs = inputs_of(recording, parameters)
    state = initial_state(level_start(recording, parameters) if start is None else start, parameters)
    every = max(round(KEPT_EVERY_S / recording.period_s), 1)
    kept = _blank(len(recording), every)
    end = run(inputs, state, blank_chain(), belief_of(parameters), kept)
    if end < len(recording):
        raise EstimationError(
            f"the body's x axis is vertical at {recording.t[end]:.3f} s, where the paper's Euler angles end: "
            f"set euler_state to False, as in the default preset."
        )
    _check_finite(recording.t, kept)
    return PocketTrack(
        t=recording.t,
        nav_R_body=kept.nav_R_body,
        gyro_bias=kept.gyro_bias,
        sigma=kept.sigma,
        covariance_sample=_rows_kept(len(recording), every),
        covariance=kept.covariance,
        gravity_nis=kept.gravity_nis,
        field_nis=kept.field_nis,
    )


def inputs_of(recording: Recording, parameters: PocketParameters) -> Inputs:
    """Samples and what the detectors say of them."""
    t, n = recording.t, len(recording)
    force, gravity = _gravity_of(recording, parameters)
    field = np.full((n, 3), np.nan) if recording.mag is None or not parameters.field_update else recording.mag
    fresh = np.asarray(np.isfinite(field).all(axis=1) & field.any(axis=1), dtype=np.bool_)
    steady = steady_field(t, field, parameters) if parameters.field_gated else fresh
    h = np.append(np.diff(t), recording.period_s)
    return Inputs(h, recording.integrable[1], force, field, gravity, fresh, steady)


def _gravity_of(recording: Recording, parameters: PocketParameters) -> tuple[Floats, Bools]:
    """Specific force (N, 3) at the stamps, and (N,) when it is gravity and to be taken in."""
    window = parameters.gravity_window_s
    count = round(window / recording.period_s)
    force = mean_force(recording, count) if count else force_at_stamps(recording.acc)
    if not parameters.gravity_update:
        return force, np.zeros(len(recording), dtype=np.bool_)
    alone = zero_acceleration(recording.t, force, parameters)
    return force, thinned(recording.t, alone, window / 2)


def initial_state(start: PocketStart, parameters: PocketParameters) -> PocketState:
    """State at the first sample; the covariance in the coordinates that the parameters say."""
    R = np.ascontiguousarray(start.nav_R_body, dtype=np.float64).copy()
    P = np.zeros((SIZE, SIZE))
    tilt = np.diag([start.tilt_sigma, start.tilt_sigma, start.heading_sigma]) ** 2
    to_state = inverse_axes(R) if parameters.euler_state and not degenerate(R) else np.eye(3)
    P[:GYRO_BIAS, :GYRO_BIAS] = to_state @ tilt @ to_state.T
    P[GYRO_BIAS:, GYRO_BIAS:] = np.eye(3) * np.radians(parameters.gyro_bias_sigma_deg_s) ** 2
    return PocketState(R, np.zeros(3), P)


@njit(cache=True)
def run(inputs: Inputs, state: PocketState, chain: Chain, belief: Belief, kept: Kept) -> int:
    """Pass over all samples; returns their number, or the sample at which Euler angles end."""
    for i in range(len(inputs.h)):
        if i > 0:
            predict(state, chain, inputs.rate[i - 1], inputs.h[i - 1], belief)
        if belief.euler and degenerate(state.nav_R_body):
            return i
        if inputs.gravity[i]:
            kept.gravity_nis[i] = absolute_gravity(state, chain, inputs.force[i], belief)
        if inputs.fresh[i]:
            _meet_field(i, inputs, state, chain, belief, kept)
        if belief.euler and degenerate(state.nav_R_body):
            return i
        _keep(i, state, belief.euler, kept)
    return len(inputs.h)


@njit(cache=True)
def _meet_field(i: int, inputs: Inputs, state: PocketState, chain: Chain, belief: Belief, kept: Kept) -> None:
    """Compare a field with the last one if it kept still and is neither too near nor too far; then begin anew at it."""
    age = chain.age[0]
    if inputs.steady[i] and age < belief.shortest_s - 1e-9:
        return
    if inputs.steady[i] and age <= belief.longest_s + 1e-9:
        kept.field_nis[i] = differential_field(state, chain, inputs.field[i], belief)
    begin(chain, inputs.field[i])


@njit(cache=True)
def _keep(i: int, state: PocketState, euler: bool, kept: Kept) -> None:
    kept.nav_R_body[i] = state.nav_R_body
    kept.gyro_bias[i] = state.gyro_bias
    P = in_nav(state) if euler else state.P
    for j in range(len(P)):
        kept.sigma[i, j] = np.sqrt(P[j, j])
    if i % kept.every == 0:
        kept.covariance[i // kept.every] = P


@njit(cache=True)
def in_nav(state: PocketState) -> Floats:
    """Covariance (6, 6) with the attitude as a rotation in nav, of one with it in Euler angles."""
    G = np.eye(6)
    G[:3, :3] = axes(state.nav_R_body)
    return G @ state.P @ G.T


def _blank(samples: int, every: int) -> Kept:
    return Kept(
        np.empty((samples, 3, 3)),
        np.empty((samples, 3)),
        np.empty((samples, SIZE)),
        np.empty((len(_rows_kept(samples, every)), SIZE, SIZE)),
        np.full(samples, np.nan),
        np.full(samples, np.nan),
        every,
    )


def _rows_kept(samples: int, every: int) -> Ints:
    return np.arange(0, samples, every)


def _check_finite(t: Floats, kept: Kept) -> None:
    finite = np.isfinite(kept.gyro_bias).all(axis=1) & np.isfinite(kept.nav_R_body).all(axis=(1, 2))
    if not finite.all():
        raise EstimationError(
            f"the filter diverged to infinity at {t[np.argmin(finite)]:.3f} s: check the samples there."
        )
