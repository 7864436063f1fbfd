"""The pass that all filters share: strapdown navigation, updated while the foot stands.

    state      position, velocity, attitude, gyro bias, accelerometer bias       (mechanisation)
    error      15 numbers, estimate minus truth, with covariance P               (covariance)

    start      level the sensor in the first stance; at rest, estimate the gyro bias too   (start)
    each sample
        update     in stance the velocity is known: inject the estimated error        (zero_velocity, update)
        update     at the stillest sample of a footfall: heading, direction of up      (attitude_updates)
        record     position, velocity, attitude; once a footfall, the biases and P
        propagate  state and P over the period for which the sample is held            (mechanisation, covariance)

    smooth     on request: backward over the pass, given the whole walk               (rts)

Samples before the first stance are reached by stepping backward from it, without updates. What a filter makes of the
field are its `PseudoMeasurements`; without any it is the IEZ. The uncertainty of a start heading that came from a
compass is a considered (Schmidt) state: it joins P with the first compass that is used (`propagate_considered`).

The attitude is turned by Exp of the rotation vector, where Ma (27), (28) and AIEZ (4), (5) have a Cayley form and a
quaternion; the state of Ma (29) and its model Ma (30)-(32), AIEZ (1)-(3) are those of `fg_nav.ekf.covariance`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from time import perf_counter

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import Rest
from fg_nav.detection.rest import Start, find_start, freeze_ends
from fg_nav.ekf.attitude_updates import (
    PseudoMeasurements,
    compute_direction,
    compute_heading,
    make_pseudo_measurements,
    update_at_footfall,
)
from fg_nav.ekf.covariance import (
    ACC_BIAS,
    ATTITUDE,
    GYRO_BIAS,
    POSITION,
    SIZE,
    VELOCITY,
    MotionNoise,
    add_body_noise,
    compute_densities,
    propagate_covariance,
)
from fg_nav.ekf.parameters import (
    ACC_BIAS_SIGMA,
    ACC_BIAS_WALK,
    STANCE_CORRELATION_S,
    VELOCITY_SIGMA,
    IezParameters,
)
from fg_nav.ekf.rts import Samples, Tape, Track, allocate_tape, allocate_track, smooth_backward, view_state
from fg_nav.ekf.update import inject_error
from fg_nav.ekf.zero_velocity import StanceNoise, update_in_stance
from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import NavState, strapdown, write_state
from fg_nav.recording import Recording
from fg_nav.sample_noise import find_extra_sigmas
from fg_nav.solution import Solution, StanceTable
from fg_nav.stances import Stances
from fg_nav.system.compiled import njit

GAUGE_SIGMA = 1e-4  # Position (m) and heading (rad) at the start are known by definition; a trace keeps P invertible.


def filter_walk(
    recording: Recording,
    stands: Bools,
    rows: Ints,
    start: Start,
    parameters: IezParameters,
    pseudo: PseudoMeasurements | None = None,
    heading_sigma: float = GAUGE_SIGMA,
    start_sigma: float = 0.0,
) -> Track:
    """Run a filter, and smooth backward over its pass where its parameters say so (`smoothed`).

    Parameters
    ----------
    recording : Recording
    stands : (N,) when the foot stands.
    rows : (K,) the stillest sample of each footfall, ascending: where the attitude is updated and P recorded.
    start : where it begins.
    parameters : of sensor and foot.
    pseudo : pseudo-measurements at the K footfalls; None for none.
    heading_sigma : rad, of the heading at the start.
    start_sigma : rad, the same, but a considered state until a compass is used (`propagate_considered`); not with
        `smoothed`.

    Raises
    ------
    EstimationError
        Where the filter diverges to infinity.
    """
    n, k, back = len(recording), len(rows), parameters.smoothed
    track, tape = allocate_track(n, k), allocate_tape(n, int(stands[start.row :].sum()), k, back)
    h = np.append(np.diff(recording.t), recording.period_s)
    extra = map(np.ascontiguousarray, find_extra_sigmas(recording, parameters.saturated_share))
    samples = Samples(h, *recording.integrable, *extra)
    state, P = make_initial_state(start, parameters, heading_sigma)
    noise, stance = make_noise_models(parameters)
    gravity = parameters.gravity
    if not back:
        _step_backward(start.row, samples, _copy(state), gravity, track)
    used = make_pseudo_measurements(k) if pseudo is None else pseudo
    considered = np.zeros(SIZE)
    considered[ATTITUDE + 2] = start_sigma
    _forward(start.row, samples, stands, rows, state, P, noise, stance, used, considered, gravity, back, track, tape)
    if back:
        smooth_backward(start.row, samples, stands, rows, noise, gravity, track, tape)
        _step_backward(start.row, samples, _copy(view_state(start.row, track, tape)), gravity, track)
    _check_finite(recording.t, track)
    return track


def make_initial_state(start: Start, parameters: IezParameters, heading_sigma: float) -> tuple[NavState, Floats]:
    """State and covariance (15, 15) at the start; the gyro bias is the weighted mean of a rest's and the prior's."""
    sigma = np.empty(SIZE)
    sigma[POSITION : POSITION + 3] = GAUGE_SIGMA
    sigma[VELOCITY : VELOCITY + 3] = VELOCITY_SIGMA
    sigma[ATTITUDE : ATTITUDE + 2] = np.radians(
        parameters.tilt_sigma_rest_deg if start.levelled_at_rest else parameters.tilt_sigma_deg
    )
    sigma[ATTITUDE + 2] = heading_sigma
    prior = np.radians(parameters.gyro_bias_sigma_deg_s)
    trust, bias = (np.zeros(3), np.zeros(3)) if start.rest is None else _weigh_rest(start.rest, prior)
    sigma[GYRO_BIAS : GYRO_BIAS + 3] = prior * np.sqrt(1.0 - trust)
    sigma[ACC_BIAS : ACC_BIAS + 3] = ACC_BIAS_SIGMA
    state = NavState(np.zeros(3), np.zeros(3), start.nav_R_body.copy(), trust * bias, np.zeros(3))
    return state, np.diag(sigma**2)


def _weigh_rest(rest: Rest, prior: float) -> tuple[Floats, Floats]:
    """Weights (3,) of the rest's bias against a prior about zero, and that bias, rad/s."""
    return prior**2 / (prior**2 + rest.sigma**2), rest.rate


@cache
def compile_filter() -> None:
    """Run the filter over a fifth of a second of rest, so that no walk is charged for the compiler."""
    t = np.linspace(0.0, 0.2, 20)
    rest = Recording(t=t, acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (20, 1)), gyr=np.zeros((20, 3)))
    stances = Stances.from_mask(np.ones(20, dtype=np.bool_))
    for smoothed in (False, True):
        parameters = IezParameters(smoothed=smoothed)
        filter_walk(rest, stances.mask, stances.start, find_start(rest, stances), parameters)


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
    pseudo: PseudoMeasurements,
    considered: Floats,
    gravity: float,
    taping: bool,
    track: Track,
    tape: Tape,
) -> None:
    h, acc, gyr, acc_sigma, gyr_sigma = samples
    x, turn, delta_v = np.zeros(SIZE), np.empty((3, 3)), np.empty(3)
    k, stood, directions, last, step = 0, 0, np.empty(len(rows)), np.empty(3), np.empty(3)
    for axis in range(3):
        last[axis] = state.position[axis]
    for i in range(first, len(h)):
        # in stance: update by the known velocity
        if stands[i]:
            track.nis[i] = update_in_stance(state, P, x, acc[i], gyr[i], h[i], stance, tape.stance[stood])
            inject_error(state, x)
            stood += taping
        # at the stillest sample of a footfall: update the attitude
        at_footfall = k < len(rows) and rows[k] == i
        if at_footfall:
            heading = compute_heading(state.nav_R_body)
            propagate_considered(considered, state)
            for axis in range(3):
                step[axis] = state.position[axis] - last[axis]
            direction = compute_direction(state.nav_R_body, step, pseudo.course_by_path)
            innovation, traces = track.innovation[k], tape.footfall[k]
            update_at_footfall(state.nav_R_body, P, x, k, direction, directions, pseudo, considered, innovation, traces)
            inject_error(state, x)
        # record the path, and at a footfall bias and covariance
        _record(i, state, track)
        if taping:
            for axis in range(3):
                tape.bias[i, axis], tape.bias[i, 3 + axis] = state.gyro_bias[axis], state.acc_bias[axis]
        if at_footfall:
            directions[k] = direction + compute_heading(state.nav_R_body) - heading
            for axis in range(3):
                last[axis], track.gyro_bias[k, axis] = state.position[axis], state.gyro_bias[axis]
            for row in range(SIZE):
                for column in range(SIZE):
                    track.covariance[k, row, column] = P[row, column] + considered[row] * considered[column]
            k += 1
        # propagate over the period of the sample
        strapdown(state, acc[i], gyr[i], h[i], gravity, turn, delta_v)
        propagate_covariance(P, turn, delta_v, h[i], compute_densities(noise, gyr[i], delta_v, h[i], gravity))
        add_body_noise(P, ATTITUDE, turn, gyr_sigma[i])
        add_body_noise(P, VELOCITY, turn, acc_sigma[i])


@njit(cache=True)
def propagate_considered(considered: Floats, state: NavState) -> None:
    """Write the position and velocity of `considered` (15,) for its heading part, an error a of the start heading.

    The walk is then turned counter-clockwise about its start: dp = a z x p and dv = a z x v, with z up. Zero velocity
    does not observe the start heading. But an update with velocities of a turned path reduces its variance, the more
    the larger it is: so it is considered, not part of P.
    """
    a = considered[ATTITUDE + 2]
    considered[POSITION], considered[POSITION + 1] = -a * state.position[1], a * state.position[0]
    considered[VELOCITY], considered[VELOCITY + 1] = -a * state.velocity[1], a * state.velocity[0]


@njit(cache=True)
def _step_backward(first: int, samples: Samples, state: NavState, gravity: float, track: Track) -> None:
    turn, delta_v = np.empty((3, 3)), np.empty(3)
    for i in range(first - 1, -1, -1):
        strapdown(state, samples.acc[i], samples.gyr[i], -samples.h[i], gravity, turn, delta_v)
        _record(i, state, track)


@njit(cache=True)
def _record(i: int, state: NavState, track: Track) -> None:
    write_state(state.position, state.velocity, state.nav_R_body, track.position, track.velocity, track.nav_R_body, i)


def make_noise_models(p: IezParameters) -> tuple[MotionNoise, StanceNoise]:
    """Densities of the parameters, squared and in SI units."""
    noise = MotionNoise(
        p.acc_density**2,
        p.acc_relative_density**2,
        float(np.radians(p.gyr_density_deg)) ** 2,
        p.gyr_relative_density**2,
        float(np.radians(p.gyro_bias_walk_deg_s)) ** 2,
        ACC_BIAS_WALK**2,
    )
    stance = StanceNoise(
        p.zero_velocity_density**2,
        p.roll_sigma_m**2 * 2.0 * STANCE_CORRELATION_S,
        p.unsteady_s**2 * 2.0 * STANCE_CORRELATION_S,
        p.roll_height_m if p.rolling_lever_m is None else 0.0,
        np.array(p.rolling_lever_m or (0.0, 0.0, 0.0)),
        p.gravity,
    )
    return noise, stance


def _copy(state: NavState) -> NavState:
    return NavState(*(part.copy() for part in state))


def make_stance_table(t: Floats, rows: Ints, track: Track, field: Sequence[str], reason: Sequence[str]) -> StanceTable:
    """Solution at the footfalls, with the verdicts on the `field` (K,) and their `reason` (K,)."""
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


def make_solution(
    recording: Recording,
    stances: Stances,
    track: Track,
    field: tuple[Sequence[str], Sequence[str]],
    parameters: Mapping[str, object],
    method: str,
    began: float,
    note: str,
) -> Solution:
    """Solution of a pass that `began` (perf_counter); `field` are verdicts and reasons, (K,) each."""
    tails = freeze_ends(recording.t, stances, track.position, track.velocity)
    return Solution(
        method=method,
        t=recording.t,
        position=track.position,
        velocity=track.velocity,
        nav_R_body=track.nav_R_body,
        stances=make_stance_table(recording.t, stances.stillest(recording.gyr), track, *field),
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


def describe_start(recording: Recording, start: Start, parameters: IezParameters) -> str:
    """Note for the user on the initial gyro bias."""
    if start.rest is None:
        return f"no rest at the start: gyro bias unknown to {parameters.gyro_bias_sigma_deg_s:g} deg/s"
    duration = (start.rest.stop - start.rest.start) * recording.period_s
    return f"gyro bias from a rest of {duration:.1f} s at the start"
