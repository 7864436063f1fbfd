"""The pass that all filters are: strapdown navigation, corrected while the foot stands.

    state      position, velocity, attitude, gyro bias, accelerometer bias       (mechanisation)
    error      15 numbers, estimate minus truth, with covariance P               (covariance)

    begin      level the sensor in the first stance; at rest, take the gyro bias too       (start)
    each sample
        correct    if the foot stands its velocity is known: take the error off       (zero_velocity, update)
        correct    at the stillest sample of a footfall: its heading, its up               (attitude_updates)
        keep       position, velocity, attitude; once a footfall, the biases and P
        move       state and P over the period for which the sample is held           (mechanisation, noise)

    walk back  if asked: the same, given the whole walk                                     (rts)

Samples before the first stance are reached by stepping backward from it, without corrections. What a filter believes of
the field is its `Evidence`; without any it is the IEZ. The doubt of a heading that a compass told at the start is kept
aside from P until a compass is believed (`turned_about_start`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from time import perf_counter

import numpy as np
from numba import njit

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import Rest
from fg_nav.ekf.attitude_updates import correct_at_footfall, direction_at, heading_at
from fg_nav.ekf.covariance import (
    ACC_BIAS,
    ATTITUDE,
    GYRO_BIAS,
    POSITION,
    SIZE,
    VELOCITY,
    add_body_noise,
    propagate,
)
from fg_nav.ekf.evidence import Evidence, no_evidence
from fg_nav.ekf.noise import MotionNoise, densities_in_motion
from fg_nav.ekf.parameters import IezParameters
from fg_nav.ekf.rts import Samples, smooth_back, state_at
from fg_nav.ekf.track import Tape, Track, blank_tape, blank_track
from fg_nav.ekf.update import take_off
from fg_nav.ekf.zero_velocity import StanceNoise, correct_in_stance
from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.recording import Recording
from fg_nav.sample_noise import doubts
from fg_nav.solution import Solution, StanceTable
from fg_nav.stances import Stances
from fg_nav.start import Start, starting_point
from fg_nav.tails import hold_tails

GAUGE_SIGMA = 1e-4
"""Position (m) and heading (rad) at the start are known by definition; a trace keeps P invertible."""


def filter_walk(
    recording: Recording,
    stands: Bools,
    rows: Ints,
    start: Start,
    parameters: IezParameters,
    evidence: Evidence | None = None,
    heading_sigma: float = GAUGE_SIGMA,
    start_sigma: float = 0.0,
) -> Track:
    """Run a filter, and walk back over its pass where its parameters say so (`smoothed`).

    Parameters
    ----------
    recording : Recording
    stands : (N,) when the foot stands.
    rows : (K,) the stillest sample of each footfall, ascending: where evidence is taken in and P kept.
    start : where it begins.
    parameters : of sensor and foot.
    evidence : of K footfalls; None for none.
    heading_sigma : rad, of the heading at the start.
    start_sigma : rad, the same, but set aside until a compass is believed (`turned_about_start`); not with `smoothed`.

    Raises
    ------
    EstimationError
        Where the filter diverges to infinity.
    """
    n, k = len(recording), len(rows)
    back = parameters.smoothed
    track, tape = blank_track(n, k), blank_tape(n, int(stands[start.row :].sum()), k, back)
    h = np.append(np.diff(recording.t), recording.period_s)
    samples = Samples(h, *recording.integrable, *doubts(recording, parameters.saturated_share))
    state, P = initial_belief(start, parameters, heading_sigma)
    noise, stance = noises(parameters)
    if not back:
        _backward(start.row, samples, _copy(state), parameters.gravity, track)
    told = no_evidence(k) if evidence is None else evidence
    aside = np.zeros(SIZE)
    aside[ATTITUDE + 2] = start_sigma
    _forward(
        start.row, samples, stands, rows, state, P, noise, stance, told, aside, parameters.gravity, back, track, tape
    )
    if back:
        smooth_back(start.row, samples, stands, rows, noise, parameters.gravity, track, tape)
        _backward(start.row, samples, _copy(state_at(start.row, track, tape)), parameters.gravity, track)
    _check_finite(recording.t, track)
    return track


def initial_belief(start: Start, parameters: IezParameters, heading_sigma: float) -> tuple[NavState, Floats]:
    """State and covariance (15, 15) at the start; a rest's gyro bias is weighed against the prior."""
    sigma = np.empty(SIZE)
    sigma[POSITION : POSITION + 3] = GAUGE_SIGMA
    sigma[VELOCITY : VELOCITY + 3] = parameters.velocity_sigma
    sigma[ATTITUDE : ATTITUDE + 2] = np.radians(
        parameters.tilt_sigma_rest_deg if start.levelled_at_rest else parameters.tilt_sigma_deg
    )
    sigma[ATTITUDE + 2] = heading_sigma
    prior = np.radians(parameters.gyro_bias_sigma_deg_s)
    trust, bias = (0.0, np.zeros(3)) if start.rest is None else _weighed(start.rest, prior)
    sigma[GYRO_BIAS : GYRO_BIAS + 3] = prior * np.sqrt(1.0 - trust)
    sigma[ACC_BIAS : ACC_BIAS + 3] = parameters.acc_bias_sigma
    state = NavState(np.zeros(3), np.zeros(3), start.nav_R_body.copy(), trust * bias, np.zeros(3))
    return state, np.diag(sigma**2)


def _weighed(rest: Rest, prior: float) -> tuple[float, Floats]:
    """Weight of what a rest shows of the bias against a prior about zero, and what it shows."""
    return prior**2 / (prior**2 + rest.sigma**2), rest.rate


@cache
def compiled() -> None:
    """Run the filter over a fifth of a second of rest, so that no walk is charged for the compiler."""
    t = np.linspace(0.0, 0.2, 20)
    rest = Recording(t=t, acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (20, 1)), gyr=np.zeros((20, 3)))
    stances = Stances.from_mask(np.ones(20, dtype=np.bool_))
    for smoothed in (False, True):
        parameters = IezParameters(smoothed=smoothed)
        filter_walk(rest, stances.mask, stances.start, starting_point(rest, stances), parameters)


@njit(cache=True)
def _forward(
    first: int,
    samples: Samples,
    stands: Bools,
    rows: Ints,
    state: NavState,
    P: Floats,
    noise: MotionNoise,
    stance: StanceNoise,
    evidence: Evidence,
    aside: Floats,
    gravity: float,
    taping: bool,
    track: Track,
    tape: Tape,
) -> None:
    h, acc, gyr, acc_doubt, gyr_doubt = samples
    x, turn, push = np.zeros(SIZE), np.empty((3, 3)), np.empty(3)
    kept, stood, directions, last = 0, 0, np.empty(len(rows)), state.position.copy()
    for i in range(first, len(h)):
        if stands[i]:
            track.nis[i] = correct_in_stance(state, P, x, acc[i], gyr[i], h[i], stance, tape.stance[stood])
            take_off(state, x)
            stood += taping
        at_footfall = kept < len(rows) and rows[kept] == i
        if at_footfall:
            heading = heading_at(state.nav_R_body)
            turned_about_start(aside, state)
            direction = direction_at(state.nav_R_body, state.position - last, evidence.course_by_path)
            correct_at_footfall(
                state.nav_R_body,
                P,
                x,
                kept,
                direction,
                directions,
                evidence,
                aside,
                track.innovation[kept],
                tape.footfall[kept],
            )
            take_off(state, x)
        _keep(i, state, track)
        if taping:
            tape.bias[i, :3], tape.bias[i, 3:] = state.gyro_bias, state.acc_bias
        if at_footfall:
            directions[kept] = direction + heading_at(state.nav_R_body) - heading
            last[:] = state.position
            track.gyro_bias[kept] = state.gyro_bias
            track.covariance[kept] = P + np.outer(aside, aside)
            kept += 1
        strapdown(state, acc[i], gyr[i], h[i], gravity, turn, push)
        propagate(P, turn, push, h[i], densities_in_motion(noise, gyr[i], push, h[i], gravity))
        add_body_noise(P, ATTITUDE, turn, gyr_doubt[i])
        add_body_noise(P, VELOCITY, turn, acc_doubt[i])


@njit(cache=True)
def turned_about_start(aside: Floats, state: NavState) -> None:
    """Write into `aside` (15,) what its heading's part, a walk turned about its start, does to position and velocity.

    Stances say nothing of the heading at the start. But a filter that takes up velocities of a path turned too far
    believes that they do, the more the less it knows of the heading: hence aside, and not in P.
    """
    turned = aside[ATTITUDE + 2]
    aside[POSITION], aside[POSITION + 1] = -turned * state.position[1], turned * state.position[0]
    aside[VELOCITY], aside[VELOCITY + 1] = -turned * state.velocity[1], turned * state.velocity[0]


@njit(cache=True)
def _backward(first: int, samples: Samples, state: NavState, gravity: float, track: Track) -> None:
    turn, push = np.empty((3, 3)), np.empty(3)
    for i in range(first - 1, -1, -1):
        strapdown(state, samples.acc[i], samples.gyr[i], -samples.h[i], gravity, turn, push)
        _keep(i, state, track)


@njit(cache=True)
def _keep(i: int, state: NavState, track: Track) -> None:
    track.position[i] = state.position
    track.velocity[i] = state.velocity
    track.nav_R_body[i] = state.nav_R_body


def noises(p: IezParameters) -> tuple[MotionNoise, StanceNoise]:
    """Densities of the parameters, squared and in SI units."""
    noise = MotionNoise(
        p.acc_density**2,
        p.acc_relative_density**2,
        float(np.radians(p.gyr_density_deg)) ** 2,
        p.gyr_relative_density**2,
        float(np.radians(p.gyro_bias_walk_deg_s)) ** 2,
        p.acc_bias_walk**2,
    )
    stance = StanceNoise(
        p.zero_velocity_density**2,
        p.roll_sigma_m**2 * 2.0 * p.roll_correlation_s,
        p.unsteady_s**2 * 2.0 * p.unsteady_correlation_s,
        p.roll_height_m if p.rolling_lever_m is None else 0.0,
        np.array(p.rolling_lever_m or (0.0, 0.0, 0.0)),
        p.gravity,
    )
    return noise, stance


def _copy(state: NavState) -> NavState:
    return NavState(*(part.copy() for part in state))


def stance_table(t: Floats, rows: Ints, track: Track, field: Sequence[str], reason: Sequence[str]) -> StanceTable:
    """Rows of the solution at the footfalls, with the verdicts on the `field` (K,) and their `reason` (K,)."""
    variance = np.diagonal(track.covariance, axis1=1, axis2=2)
    return StanceTable(
        sample=rows,
        t=t[rows],
        position=track.position[rows],
        nav_R_body=track.nav_R_body[rows],
        gyro_bias=track.gyro_bias,
        position_cov=track.covariance[:, POSITION : POSITION + 3, POSITION : POSITION + 3],
        heading_sigma=np.sqrt(variance[:, ATTITUDE + 2]),
        gyro_bias_sigma=np.sqrt(variance[:, GYRO_BIAS : GYRO_BIAS + 3]),
        field=tuple(field),
        field_reason=tuple(reason),
    )


def solution_of(
    recording: Recording,
    stances: Stances,
    track: Track,
    field: tuple[Sequence[str], Sequence[str]],
    parameters: Mapping[str, object],
    method: str,
    began: float,
    note: str,
) -> Solution:
    """Put the solution of a pass that `began` (perf_counter) together; `field` are verdicts and reasons, (K,) each."""
    tails = hold_tails(recording.t, stances, track.position, track.velocity)
    return Solution(
        method=method,
        t=recording.t,
        position=track.position,
        velocity=track.velocity,
        nav_R_body=track.nav_R_body,
        stances=stance_table(recording.t, stances.stillest(recording.gyr), track, *field),
        runtime_s=perf_counter() - began,
        parameters=parameters,
        notes=(note, *tails),
    )


def _check_finite(t: Floats, track: Track) -> None:
    finite = np.isfinite(track.position).all(axis=1)
    if not finite.all():
        raise EstimationError(
            f"the filter diverged to infinity at {t[np.argmin(finite)]:.3f} s: check the samples there."
        )


def start_note(recording: Recording, start: Start, parameters: IezParameters) -> str:
    """What is told the user of how the gyro bias was begun."""
    if start.rest is None:
        return f"no rest at the start: gyro bias unknown to {parameters.gyro_bias_sigma_deg_s:g} deg/s"
    duration = (start.rest.stop - start.rest.start) * recording.period_s
    return f"gyro bias from a rest of {duration:.1f} s at the start"
