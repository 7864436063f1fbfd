"""The pass that all filters share: strapdown navigation, updated while the foot stands (docs/filters.md).

    state      position, velocity, attitude, gyro bias, accelerometer bias       (mechanisation)
    error      15 numbers, estimate minus truth, with covariance P               (covariance)

    start      level the sensor in the first stance; at rest, estimate the gyro bias too   (detection.rest)
    each sample
        update     in stance, by the known velocity: inject the estimated error       (measurements, update)
        update     at the stillest sample of a footfall: heading, direction of up      (measurements)
        record     position, velocity, attitude; once a footfall, the biases and P
        propagate  state and P over the period for which the sample is held            (mechanisation, covariance)

    smooth     on request: backward over the pass, given the whole walk               (rts)

Samples before the first stance are reached by stepping backward from it, without updates. A filter's use of the field
is its `PseudoMeasurements`; without any it is the IEZ (`run_iez`). The attitude is rotated by Exp of the rotation
vector, where Ma (27), (28) and AIEZ (4), (5) have a Cayley form and a quaternion; the state of Ma (29) and its model
Ma (30)-(32), AIEZ (1)-(3) are those of `fg_nav.ekf.covariance`.

References: Foxlin (2005), "Pedestrian tracking with shoe-mounted inertial sensors"; Jimenez et al. (2010), "Indoor
pedestrian navigation using an INS/EKF framework for yaw drift reduction and a foot-mounted IMU".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from time import perf_counter

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import RestParameters
from fg_nav.detection.rest import Start, find_start, freeze_ends
from fg_nav.detection.stance import Stances
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
from fg_nav.ekf.measurements import (
    PseudoMeasurements,
    StanceNoise,
    compute_direction,
    compute_heading,
    make_pseudo_measurements,
    update_at_footfall,
    update_in_stance,
)
from fg_nav.ekf.rts import Samples, Tape, Track, smooth_backward, view_state
from fg_nav.ekf.update import ROW, inject_error
from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import NavState, strapdown, write_state
from fg_nav.recording import Recording, find_extra_sigmas
from fg_nav.solution import Solution, StanceTable
from fg_nav.system.compiled import njit

GAUGE_SIGMA = 1e-4  # Position (m) and heading (rad) at the start are known by definition; a trace keeps P invertible.
STANCE_CORRELATION_S = 0.04  # Of lever and residual motion in stance: half the spacing of the smoother's factors.
ACC_BIAS_SIGMA = 0.02  # Accelerometer bias, m/s^2 (2 mg).
ACC_BIAS_WALK = 1e-4  # Its random walk, m/s^2/sqrt(s).
VELOCITY_SIGMA = 0.01  # Velocity at the start, in stance, m/s.


@dataclass(frozen=True)
class IezParameters:
    """Noises of sensor and foot, of every filter; `OPENSHOE` has the values of the literature.

    Densities: a white error of s a sample at rate f has s / sqrt(f), and no result depends on the sampling rate.
    """

    acc_density: float = 0.02  #: White error of the specific force, m/s^2/sqrt(Hz). Sheets say 0.001; impacts ring on.
    acc_relative_density: float = 0.007  #: The same per m/s^2 of acceleration, sqrt(s): 2 %, correlated over 60 ms.
    gyr_density_deg: float = 0.015  #: White error of the angular rate, deg/s/sqrt(Hz). Sheets: 0.005 to 0.015.
    gyr_relative_density: float = 5e-4  #: The same per rad/s of rate, sqrt(s): 0.15 %, correlated over 60 ms.
    saturated_share: float = 0.3  #: Error of a sample clipped at the end of the range, as a share of the range.
    zero_velocity_density: float = 1e-3  #: Velocity of a still foot, m/s/sqrt(Hz): 5 mm/s, correlated over 20 ms.
    roll_height_m: float = 0.06  #: Sensor above the point about which the foot rolls, m; 0 for plain zero velocity.
    rolling_lever_m: tuple[float, float, float] | None = None  #: Its lever, body frame, m; None: the height.
    roll_sigma_m: float = 0.05  #: Uncertainty of that lever, in any direction, m.
    unsteady_s: float = 0.0  #: How long a force that is not gravity may already have lasted in stance, s; 0: left out.
    gyro_bias_sigma_deg_s: float = 0.2  #: Gyro bias of a calibrated sensor, deg/s, before a rest has measured it.
    gyro_bias_walk_deg_s: float = 1e-4  #: Its random walk, deg/s/sqrt(s): 0.004 deg/s in half an hour.
    tilt_sigma_rest_deg: float = 0.3  #: Tilt after levelling at rest, deg: the accelerometer bias, with a margin.
    tilt_sigma_deg: float = 2.0  #: Tilt after levelling in a stance that is no rest, deg: 0.3 m/s^2 of motion.
    gravity: float = GRAVITY_M_S2  #: m/s^2.
    rest: RestParameters = field(default_factory=RestParameters)  #: Criteria for the rest in the first stance.
    smoothed: bool = False  #: Smooth backward over the pass (`fg_nav.ekf.rts`).


OPENSHOE = IezParameters(
    acc_density=0.5 / 200.0**0.5,
    acc_relative_density=0.0,
    gyr_density_deg=0.5 / 200.0**0.5,
    gyr_relative_density=0.0,
    saturated_share=0.0,
    zero_velocity_density=0.01 / 200.0**0.5,
    roll_height_m=0.0,
    roll_sigma_m=0.0,
    gyro_bias_sigma_deg_s=0.05,
)
"""Constant noise and a foot that does not roll: 0.5 m/s^2, 0.5 deg/s and 0.01 m/s a sample at 200 Hz (Nilsson
et al. 2012, "Foot-mounted INS for everybody"; PyShoe has the same). Here the biases are estimated; there they are not.
"""


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
    """Run a filter, smooth backward where its parameters say so (`smoothed`), and return path and footfalls.

    `stands` (N,) marks the samples in stance; `rows` (K,) are the stillest ones of the footfalls, ascending, where the
    attitude is updated by `pseudo` and P recorded. `heading_sigma` (rad) is that of the heading at the start;
    `start_sigma` (rad) too, but a considered state until a compass is used (`propagate_considered`): not with
    `smoothed`.

    Raises `EstimationError` where the filter diverges to infinity.
    """
    n, k, back = len(recording), len(rows), parameters.smoothed
    taped, stood = (n, int(stands[start.row :].sum())) if back else (1, 1)  # without a backward pass overwritten
    path = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3)), np.full(n, np.nan)
    track = Track(*path, np.empty((k, 3)), np.empty((k, SIZE, SIZE)), np.full((k, 4), np.nan))
    tape = Tape(np.zeros((taped, 6)), np.empty((stood, 3, ROW)), np.zeros((k, 3, ROW + SIZE)))
    extra = map(np.ascontiguousarray, find_extra_sigmas(recording, parameters.saturated_share))
    samples = Samples(recording.periods_s, *recording.integrable, *extra)
    state, P = make_initial_state(start, parameters, heading_sigma)
    noise, stance = make_noise_models(parameters)
    gravity = parameters.gravity
    if not back:
        _step_backward(start.row, samples, state, gravity, track)
    used = make_pseudo_measurements(k) if pseudo is None else pseudo
    considered = np.zeros(SIZE)
    considered[ATTITUDE + 2] = start_sigma
    _forward(start.row, samples, stands, rows, state, P, noise, stance, used, considered, gravity, back, track, tape)
    if back:
        smooth_backward(start.row, samples, stands, rows, noise, gravity, track, tape)
        _step_backward(start.row, samples, view_state(start.row, track, tape), gravity, track)
    finite = np.isfinite(track.position).all(axis=1)
    if not finite.all():
        at_s = recording.t[np.argmin(finite)]
        raise EstimationError(f"the filter diverged to infinity at {at_s:.3f} s: check the samples there.")
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
    prior, trust, bias = np.radians(parameters.gyro_bias_sigma_deg_s), np.zeros(3), np.zeros(3)
    if start.rest is not None:
        trust, bias = prior**2 / (prior**2 + start.rest.sigma**2), start.rest.rate
    sigma[GYRO_BIAS : GYRO_BIAS + 3] = prior * np.sqrt(1.0 - trust)
    sigma[ACC_BIAS : ACC_BIAS + 3] = ACC_BIAS_SIGMA
    state = NavState(np.zeros(3), np.zeros(3), start.nav_R_body.copy(), trust * bias, np.zeros(3))
    return state, np.diag(sigma**2)


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
    """Filter from sample `first` on and write `track`; with `taping` the tape too. `state`, `P` change in place."""
    h, acc, gyr, acc_sigma, gyr_sigma = samples
    x, turn, delta_v = np.zeros(SIZE), np.empty((3, 3)), np.empty(3)
    k, stood, directions, last = 0, 0, np.empty(len(rows)), state.position.copy()
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
            direction = compute_direction(state.nav_R_body, state.position - last, pseudo.course_by_path)
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
            last[:], track.gyro_bias[k] = state.position, state.gyro_bias
            track.covariance[k] = P + np.outer(considered, considered)
            k += 1
        # propagate over the period of the sample
        strapdown(state, acc[i], gyr[i], h[i], gravity, turn, delta_v)
        propagate_covariance(P, turn, delta_v, h[i], compute_densities(noise, gyr[i], delta_v, h[i], gravity))
        add_body_noise(P, ATTITUDE, turn, gyr_sigma[i])
        add_body_noise(P, VELOCITY, turn, acc_sigma[i])


@njit(cache=True)
def propagate_considered(considered: Floats, state: NavState) -> None:
    """Set position and velocity of `considered` (15,), one sigma, by its heading part, an error a of the start heading.

    The walk is then turned counter-clockwise about its start: dp = a z x p and dv = a z x v, with z up. Zero velocity
    does not observe the start heading. But an update with velocities of a turned path reduces its variance, the more
    the larger it is: so it is considered, not part of P.
    """
    a = considered[ATTITUDE + 2]
    considered[POSITION], considered[POSITION + 1] = -a * state.position[1], a * state.position[0]
    considered[VELOCITY], considered[VELOCITY + 1] = -a * state.velocity[1], a * state.velocity[0]


@njit(cache=True)
def _step_backward(first: int, samples: Samples, start: NavState, gravity: float, track: Track) -> None:
    """Strapdown without updates from the state at sample `first` back to the first of all; write `track`."""
    position, velocity, R, gyro_bias, acc_bias = start
    state = NavState(position.copy(), velocity.copy(), R.copy(), gyro_bias, acc_bias)
    turn, delta_v = np.empty((3, 3)), np.empty(3)
    for i in range(first - 1, -1, -1):
        strapdown(state, samples.acc[i], samples.gyr[i], -samples.h[i], gravity, turn, delta_v)
        _record(i, state, track)


@njit(cache=True)
def _record(i: int, state: NavState, track: Track) -> None:
    write_state(state.position, state.velocity, state.nav_R_body, track.position, track.velocity, track.nav_R_body, i)


def make_noise_models(p: IezParameters) -> tuple[MotionNoise, StanceNoise]:
    """Squared densities of the process noise, and of the velocity in stance, in SI units."""
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
    rows = stances.stillest(recording.gyr)
    variance = np.diagonal(track.covariance, axis1=1, axis2=2)
    table = StanceTable(
        sample=rows,
        t=recording.t[rows],
        position=track.position[rows],
        nav_R_body=track.nav_R_body[rows],
        gyro_bias=track.gyro_bias,
        position_cov=track.covariance[:, POSITION : POSITION + 3, POSITION : POSITION + 3],
        heading_sigma=np.sqrt(variance[:, ATTITUDE + 2]),
        gyro_bias_sigma=np.sqrt(variance[:, GYRO_BIAS : GYRO_BIAS + 3]),
        field=tuple(field[0]),
        field_reason=tuple(field[1]),
    )
    return Solution(
        method=method,
        t=recording.t,
        position=track.position,
        velocity=track.velocity,
        nav_R_body=track.nav_R_body,
        stances=table,
        runtime_s=perf_counter() - began,
        parameters=parameters,
        notes=(note, *tails),
    )


def describe_start(recording: Recording, start: Start, parameters: IezParameters) -> str:
    """Note for the user on the initial gyro bias."""
    if start.rest is None:
        return f"no rest at the start: gyro bias unknown to {parameters.gyro_bias_sigma_deg_s:g} deg/s"
    duration = (start.rest.stop - start.rest.start) * recording.period_s
    return f"gyro bias from a rest of {duration:.1f} s at the start"


UNUSED = "the filter does not use the magnetometer"  # Reason at every footfall.


def run_iez(
    recording: Recording, stances: Stances, parameters: IezParameters = IezParameters(), heading: float = 0.0
) -> Solution:
    """IEZ: strapdown navigation, updated while the foot stands (INS + EKF + ZUPT), without the magnetometer.

    `heading` is rad clockwise from north, of the body's x axis at the start.

    Raises `EstimationError` without a stance, with stances of another recording, without gravity in the specific force,
    or where the filter diverges to infinity.

    Examples
    --------
    >>> recording = fg_nav.read("walk.csv")
    >>> fg_nav.run_iez(recording, fg_nav.detect_stances(recording)).method
    'iez'
    """
    compile_filter()
    began = perf_counter()
    start = find_start(recording, stances, heading, parameters.rest)
    rows = stances.stillest(recording.gyr)
    track = filter_walk(recording, stances.mask, rows, start, parameters)
    note, unused = describe_start(recording, start, parameters), (("none",) * len(rows), (UNUSED,) * len(rows))
    return make_solution(recording, stances, track, unused, asdict(parameters), "iez", began, note)
