"""IEZ: strapdown navigation, corrected while the foot stands (INS + EKF + ZUPT).

    state      position, velocity, attitude, gyro bias, accelerometer bias       (mechanisation)
    error      15 numbers, estimate minus truth, with covariance P               (covariance)

    begin      level the sensor in the first stance; at rest, take the gyro bias too       (start)
    each sample
        correct    if the foot stands its velocity is known: take the error off       (zero_velocity, update)
        keep       position, velocity, attitude; once a footfall, the biases and P
        move       state and P over the period for which the sample is held           (mechanisation, noise)

Samples before the first stance are reached by stepping backward from it, without corrections.

All noises are densities: a white error of s a sample at rate f has the density s / sqrt(f), and the result
does not hang on the sampling rate.

References: Foxlin (2005), "Pedestrian tracking with shoe-mounted inertial sensors"; Jimenez et al. (2010),
"Indoor pedestrian navigation using an INS/EKF framework for yaw drift reduction and a foot-mounted IMU".
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import cache
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numba import njit

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import Rest, RestParameters
from fg_nav.doubt import doubt
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
from fg_nav.ekf.noise import MotionNoise, densities_in_motion
from fg_nav.ekf.update import take_off
from fg_nav.ekf.zero_velocity import StanceNoise, correct_in_stance
from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.recording import Recording
from fg_nav.solution import Solution, StanceTable
from fg_nav.stances import Stances
from fg_nav.start import Start, starting_point
from fg_nav.tails import hold_tails

GAUGE_SIGMA = 1e-4
"""Position (m) and heading (rad) at the start are known by definition; a trace keeps P invertible."""


@dataclass(frozen=True)
class IezParameters:
    """What the filter believes about sensor and foot; `OPENSHOE` has the values of the literature."""

    acc_density: float = 0.02
    """White error of the specific force, m/s^2/sqrt(Hz). Sheets say 0.001; impacts ring on."""
    acc_relative_density: float = 0.007
    """The same per m/s^2 of acceleration, sqrt(s): 2 %, correlated over 60 ms."""
    gyr_density_deg: float = 0.015
    """White error of the angular rate, deg/s/sqrt(Hz). Sheets of MEMS gyroscopes: 0.005 to 0.015."""
    gyr_relative_density: float = 5e-4
    """The same per rad/s of rate, sqrt(s): 0.15 %, correlated over 60 ms."""
    saturated_share: float = 0.3
    """What a peak cut at the end of the range may hide, as a share of the range."""
    zero_velocity_density: float = 1e-3
    """Velocity of a foot that stands and does not turn, m/s/sqrt(Hz): 5 mm/s, correlated over 20 ms."""
    roll_height_m: float = 0.06
    """Height of the sensor above the point about which the foot rolls, m; 0 for plain zero velocity."""
    roll_sigma_m: float = 0.05
    """Uncertainty of that lever, in any direction, m."""
    roll_correlation_s: float = 0.04
    """Time over which it stays the same, s: a part of a stance."""
    gyro_bias_sigma_deg_s: float = 0.2
    """Gyro bias of a calibrated sensor, deg/s, before a rest has measured it."""
    gyro_bias_walk_deg_s: float = 1e-4
    """Its random walk, deg/s/sqrt(s): 0.004 deg/s in half an hour."""
    acc_bias_sigma: float = 0.02
    """Accelerometer bias, m/s^2 (2 mg)."""
    acc_bias_walk: float = 1e-4
    """Its random walk, m/s^2/sqrt(s)."""
    velocity_sigma: float = 0.01
    """Velocity at the start, in stance, m/s."""
    tilt_sigma_rest_deg: float = 0.3
    """Tilt after levelling at rest, deg: the accelerometer bias, with a margin."""
    tilt_sigma_deg: float = 2.0
    """Tilt after levelling in a stance that is no rest, deg: 0.3 m/s^2 of motion is taken for gravity."""
    gravity: float = GRAVITY_M_S2
    """m/s^2."""
    rest: RestParameters = field(default_factory=RestParameters)
    """When the first stance is a rest."""


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
et al. 2012, "Foot-mounted INS for everybody"; PyShoe has the same). Biases are estimated; theirs are not.
"""


class Track(NamedTuple):
    """What a pass of the filter leaves behind.

    Path `position`, `velocity` (N, 3), `nav_R_body` (N, 3, 3) and `nis` (N,) of the corrections, NaN where
    there was none; at one sample a footfall `gyro_bias` (K, 3) and `covariance` (K, 15, 15).
    """

    position: Floats
    velocity: Floats
    nav_R_body: Floats
    nis: Floats
    gyro_bias: Floats
    covariance: Floats


def run_iez(
    recording: Recording,
    stances: Stances,
    parameters: IezParameters = IezParameters(),
    heading: float = 0.0,
) -> Solution:
    """Navigate a walk forward in time.

    Parameters
    ----------
    recording : Recording
        The magnetometer is not used.
    stances : Stances
        When the foot stood, on this recording.
    parameters : IezParameters
    heading : float
        Of the body's x axis at the start, rad clockwise from north.

    Raises
    ------
    EstimationError
        Without a stance, with stances of another recording, without gravity in the specific force, or where
        the filter diverges to infinity.
    """
    _compile()
    began = perf_counter()
    start = starting_point(recording, stances, heading, parameters.rest)
    rows = stances.stillest(recording.gyr)
    track = filter_walk(recording, stances.mask, rows, start, parameters)
    tails = hold_tails(recording.t, stances, track.position, track.velocity)
    _check_finite(recording.t, track)
    return Solution(
        method="iez",
        t=recording.t,
        position=track.position,
        velocity=track.velocity,
        nav_R_body=track.nav_R_body,
        stances=_stance_table(recording.t, rows, track),
        runtime_s=perf_counter() - began,
        parameters=asdict(parameters),
        notes=(_start_note(recording, start, parameters), *tails),
    )


def filter_walk(recording: Recording, stands: Bools, rows: Ints, start: Start, parameters: IezParameters) -> Track:
    """Run the filter from `start` with a foot that `stands` (N,), and keep P at `rows` (K,), ascending."""
    n, k = len(recording), len(rows)
    track = Track(
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty((n, 3, 3)),
        np.full(n, np.nan),
        np.empty((k, 3)),
        np.empty((k, SIZE, SIZE)),
    )
    h = np.append(np.diff(recording.t), recording.period_s)
    gyr_doubt = doubt(recording.gyr, h, parameters.saturated_share)
    acc_doubt = doubt(recording.acc, h, parameters.saturated_share)
    state, P = initial_belief(start, parameters)
    samples = (h, recording.acc, recording.gyr)
    _backward(start.row, *samples, _copy(state), parameters.gravity, track)
    noise, stance = _noises(parameters)
    _forward(
        start.row,
        *samples,
        acc_doubt,
        gyr_doubt,
        stands,
        rows,
        state,
        P,
        noise,
        stance,
        parameters.gravity,
        track,
    )
    return track


def initial_belief(start: Start, parameters: IezParameters) -> tuple[NavState, Floats]:
    """State and covariance (15, 15) at the start; a rest's gyro bias is weighed against the prior."""
    sigma = np.empty(SIZE)
    sigma[POSITION : POSITION + 3] = GAUGE_SIGMA
    sigma[VELOCITY : VELOCITY + 3] = parameters.velocity_sigma
    sigma[ATTITUDE : ATTITUDE + 2] = np.radians(
        parameters.tilt_sigma_rest_deg if start.levelled_at_rest else parameters.tilt_sigma_deg
    )
    sigma[ATTITUDE + 2] = GAUGE_SIGMA
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
def _compile() -> None:
    """Run the filter over a fifth of a second of rest, so that no walk is charged for the compiler."""
    t = np.linspace(0.0, 0.2, 20)
    rest = Recording(t=t, acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (20, 1)), gyr=np.zeros((20, 3)))
    stances = Stances.from_mask(np.ones(20, dtype=np.bool_))
    filter_walk(rest, stances.mask, stances.start, starting_point(rest, stances), IezParameters())


@njit(cache=True)
def _forward(
    first: int,
    h: Floats,
    acc: Floats,
    gyr: Floats,
    acc_doubt: Floats,
    gyr_doubt: Floats,
    stands: Bools,
    rows: Ints,
    state: NavState,
    P: Floats,
    noise: MotionNoise,
    stance: StanceNoise,
    gravity: float,
    track: Track,
) -> None:
    x, turn, push = np.zeros(SIZE), np.empty((3, 3)), np.empty(3)
    kept = 0
    for i in range(first, len(h)):
        if stands[i]:
            track.nis[i] = correct_in_stance(state, P, x, gyr[i], h[i], stance)
            take_off(state, x)
        _keep(i, state, track)
        if kept < len(rows) and rows[kept] == i:
            track.gyro_bias[kept] = state.gyro_bias
            track.covariance[kept] = P
            kept += 1
        strapdown(state, acc[i], gyr[i], h[i], gravity, turn, push)
        propagate(P, turn, push, h[i], densities_in_motion(noise, gyr[i], push, h[i], gravity))
        add_body_noise(P, ATTITUDE, turn, gyr_doubt[i])
        add_body_noise(P, VELOCITY, turn, acc_doubt[i])


@njit(cache=True)
def _backward(first: int, h: Floats, acc: Floats, gyr: Floats, state: NavState, gravity: float, track: Track) -> None:
    turn, push = np.empty((3, 3)), np.empty(3)
    for i in range(first - 1, -1, -1):
        strapdown(state, acc[i], gyr[i], -h[i], gravity, turn, push)
        _keep(i, state, track)


@njit(cache=True)
def _keep(i: int, state: NavState, track: Track) -> None:
    track.position[i] = state.position
    track.velocity[i] = state.velocity
    track.nav_R_body[i] = state.nav_R_body


def _noises(p: IezParameters) -> tuple[MotionNoise, StanceNoise]:
    """Densities of the parameters, squared and in SI units."""
    noise = MotionNoise(
        p.acc_density**2,
        p.acc_relative_density**2,
        float(np.radians(p.gyr_density_deg)) ** 2,
        p.gyr_relative_density**2,
        float(np.radians(p.gyro_bias_walk_deg_s)) ** 2,
        p.acc_bias_walk**2,
    )
    rolling = p.roll_sigma_m**2 * 2.0 * p.roll_correlation_s
    return noise, StanceNoise(p.zero_velocity_density**2, rolling, p.roll_height_m)


def _copy(state: NavState) -> NavState:
    return NavState(*(part.copy() for part in state))


def _stance_table(t: Floats, rows: Ints, track: Track) -> StanceTable:
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
        field=("none",) * len(rows),
        field_reason=("the filter does not use the magnetometer",) * len(rows),
    )


def _check_finite(t: Floats, track: Track) -> None:
    finite = np.isfinite(track.position).all(axis=1)
    if not finite.all():
        raise EstimationError(
            f"the filter diverged to infinity at {t[np.argmin(finite)]:.3f} s: check the samples there."
        )


def _start_note(recording: Recording, start: Start, parameters: IezParameters) -> str:
    if start.rest is None:
        return f"no rest at the start: gyro bias unknown to {parameters.gyro_bias_sigma_deg_s:g} deg/s"
    duration = (start.rest.stop - start.rest.start) * recording.period_s
    return f"gyro bias from a rest of {duration:.1f} s at the start"
