"""The filter of Munoz Diaz et al. (2017): orientation and gyro bias of a sensor in a trouser pocket.

    start       level by the first second, bias zero                                          (track)
    each sample
        predict     attitude by the rate less its bias, bias by its model                     MD (3)-(11)
        gravity     where the specific force looks like gravity alone: roll and pitch         MD (12)-(14)
        field       where the field holds still: its rotation since the last sample           MD (15), (16)
        store       attitude, bias, their sigmas

The heading itself is never observed: turned about up, all results are the same. A rate is the mean over the period from
its stamp to the next one; a field is that of its stamp.

Specific force of the gravity update (`average_force`)
    The mean over two seconds in one frame, by a raised cosine (docs/pocket.md): to 0.1 to 0.25 m/s^2 an axis.

        sum over the window of  w_j G_k^T G_j f_j,     G the attitude by the gyroscope alone, from any start

    A bias b rotates the mean, which is half a window T old, by b T / 2: its row has that term.

Detectors (MD 2.1.2 names two and refers to its reference 26). Ours are causal.
    zero acceleration: | |a| - g | < limit, for a while. Only the strength is used: an acceleration across gravity
    shows in it by its square, 0.3 m/s^2 for 2.4. Hence the sigma of the direction.

    magnetic disturbance: s, the standard deviation of |B| over the last n samples with a field, against sigma and the
    drift that may pass

        s^2 < sigma^2 chi2_{n-1}(1 - p) / (n - 1) + (drift T)^2 / 12

    p being the false-alarm rate of noise alone, and T the window. A field that turns at the same strength passes.

State, MD (1): R = nav_R_body and the gyro bias b. The error is estimate minus truth, in this order:

======= ========== ==================================================================================
0       attitude   a small rotation in nav, R_estimate = Exp(dphi) R_true, rad
3       bias       gyro bias, rad/s, body
======= ========== ==================================================================================

Prediction over a sample: a rate w held for h seconds, the Earth's rate W in nav, Jr the right Jacobian of SO(3),

    theta = (w - b - R^T W) h,    A = Exp(theta)                                     MD (2), (3), (5), (6), (26)
    R' = R A                                                                         MD (4)
    b' = c b,    c = exp(-h / t_B), or 1                                             MD (10)

A bias too high by db turns A by -Jr h db in the body at the end, so that errors propagate as

    dphi' = (I - h [W]) dphi - R' Jr h db,    db' = c db                             MD (7)-(9), (11)

Noise enters at the end of the step: the gyroscope's rotates the attitude by the same about all axes, and the bias walks
by sigma_n of MD (24) a sample.

Reference of the field: while the body rotates by A = A_1 A_2 ... since the last field mu that was measured, a field
that does not change in nav becomes, in the body,

    A^T mu                                                                           MD (15), read with MD (4)

A depends on the gyro bias: each A_i is rotated by -Jr h db at its end, and so with S as A is A Exp(S db),

    A <- A A_i,    S <- A_i^T S - Jr h.

With a magnetometer slower than the gyroscope A spans several samples; in MD it spans one. When an update in between
changes the bias, A is rotated along.

Absolute gravity update, of a specific force a that is gravity alone                 MD (12)-(14)
    u = R a / |a| in nav is up but for the tilt: (u_x, u_y) = (dphi_y, -dphi_x), each with variance s^2 / |a|^2. A mean
    over T is T / 2 old: with a + (T / 2) b x a for a, u gains (T / 2) R (db x a) / |a|. In angles, as printed, it is
    the same to first order.

Differential magnetic field update, of the field m measured now, against m' = A^T mu predicted
    z = m' - m,    H = [0, [m'] S]                                                   MD (15), (16)
    N = 2 s_m^2 I + q [m'] [m']^T,    q = variance of the gyroscope's angle since then
Along m' H is zero, for no rotation changes a strength; and N is 2 s_m^2 + q |m'|^2 across it. So it is two rows: with
u, v and m' / |m'| a right-handed set, |m'| v^T S and -|m'| u^T S about u and v. The noise of each field enters two
differences, once with either sign; the filter takes them as independent, as MD does.

Misprints: docs/equations.md. Munoz Diaz, de Ponte Mueller, Garcia Dominguez (2017), "Use of the Magnetic Field for
Improving Gyroscopes' Biases Estimation", Sensors 17(4) 832.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from fg_nav.arrays import Bools, Floats
from fg_nav.ekf.update import rotate_in_nav, update_row
from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import cross_matrix, multiply, right_jacobian, rotate_in_body, transpose
from fg_nav.pocket.track import STORED_EVERY_S, PocketStart, PocketTrack, level_start
from fg_nav.recording import Recording
from fg_nav.system.compiled import njit

ATTITUDE, GYRO_BIAS, SIZE = 0, 3, 6
MAX_DIFFERENCE_S = 0.25  # Fields farther apart than the shortest difference and this, s, are not compared: a gap.
GYR_DENSITY_DEG = 0.01  # White error of the rate, deg/s/sqrt(Hz): a MEMS's; MD Table 2, 0.1 deg/s at 100 Hz.
BIAS_INSTABILITY_DEG_H = 10.0  # B of MD (24), deg/h, stationary sigma B / sqrt(2). Not printed: usual for a good MEMS.
BIAS_TIME_S = 200.0  # t_B of MD (25), s, where the Allan deviation is lowest. Not printed: such sensors have 100 to 300
EARTH_RATE_RAD_S = 7.29e-5  # Rotation rate of the Earth, MD (27).
ZERO_ACCELERATION_M_S2 = 0.3  # Largest distance of the specific force's strength from gravity, m/s^2. Not printed.
ZERO_ACCELERATION_S = 0.05  # ... and for how long it must have been within it, s. Not printed.
FIELD_WINDOW_S = 0.5  # Window over which the field's strength must hold still, s: half a stride. Not printed.
FIELD_DRIFT_UT_S = 0.5  # ... its steady change that may pass, uT/s: it may turn the field by 1 deg/s. Not printed.
FIELD_FALSE_ALARM = 0.01  # ... and the false-alarm rate of noise alone.


def compute_bias_walk() -> float:
    """Random walk of the bias, rad/s/sqrt(s): sigma_n of MD (24) over the root of a sample's period."""
    return float(np.radians(BIAS_INSTABILITY_DEG_H / 3600.0 / BIAS_TIME_S**0.5))


def compute_bias_decay(returns_to_zero: bool) -> float:
    """Decay rate of the bias, 1/s: that of MD (10), or zero for a random walk."""
    return 1.0 / BIAS_TIME_S if returns_to_zero else 0.0


def compute_earth_rate(latitude_deg: float | None) -> Floats:
    """Rotation rate of the Earth (3,) rad/s in nav, MD (27); zero for None, where it is not removed."""
    if latitude_deg is None:
        return np.zeros(3)
    latitude = np.radians(latitude_deg)
    return EARTH_RATE_RAD_S * np.array([0.0, np.cos(latitude), np.sin(latitude)])


@dataclass(frozen=True)
class PocketParameters:
    """Of the filter of Munoz Diaz et al. (2017).

    `gyro_bias_sigma_deg_s` is not printed. It alone sets how soon the z bias is found, as its inverse square; with this
    one the simulated street has the minutes of MD Figure 9. A MEMS has 0.1 to 0.5.
    `gravity_window_s`: the specific force is a weighted mean over two strides, used once every half window
    (`average_force`); 0 as in MD, the sample's own, which does not hold the tilt in the simulated pocket.
    `acc_sigma_m_s2`: motion left in a specific force that looks like gravity alone, an axis: 0.1 to 0.25, and 0.03 of
    accelerometer. MD uses the accelerometer's noise without its value.
    `shortest_difference_s`: between fields that are compared; 0 as in MD, from each sample to the next. The noise of a
    difference does not grow with the time over which the bias turns it: 0.25 s finds z in 1.5 min, not 13.
    """

    gyro_bias_sigma_deg_s: float = 0.035  # Prior sigma of the bias.
    bias_returns_to_zero: bool = False  # MD (10) as printed, b <- c b, c = exp(-h / t_B); else a random walk, c = 1.
    latitude_deg: float | None = None  # North, to remove the Earth's rate, MD (26), (27); None as in MD's filter.
    gravity_window_s: float = 2.0
    acc_sigma_m_s2: float = 0.3
    gravity_update: bool = True
    mag_sigma_uT: float = 0.015  # White error of the magnetometer, an axis and sample (MD Table 2).
    field_update: bool = True  # Where there is a magnetometer.
    field_gated: bool = True  # Only where the field holds still; MD uses it everywhere in homogeneous fields.
    shortest_difference_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("gyro_bias_sigma_deg_s", "acc_sigma_m_s2", "mag_sigma_uT"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise EstimationError(f"{name} of {getattr(self, name):g} cannot be: give a number above zero.")
        for name in ("gravity_window_s", "shortest_difference_s"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise EstimationError(f"{name} of {getattr(self, name):g} cannot be: give zero or more.")
        if self.latitude_deg is not None and not abs(self.latitude_deg) <= 90.0:
            raise EstimationError(f"latitude_deg of {self.latitude_deg:g} is none: give -90 to 90, or None.")


class PocketState(NamedTuple):
    """State of the filter: `nav_R_body` (3, 3), `gyro_bias` (3,) rad/s and `P` (6, 6), changed in place."""

    nav_R_body: Floats
    gyro_bias: Floats
    P: Floats


class FieldReference(NamedTuple):
    """The last field that was measured, propagated to now, changed in place."""

    field: Floats  # (3,) uT.
    turn: Floats  # (3, 3), A, from the body now to the body then.
    per_bias: Floats  # (3, 3) s, S: with a bias higher by db, A is A Exp(S db).
    age: Floats  # (1,) s; NaN where no field was measured yet.


class FilterModel(NamedTuple):
    """The parameters in SI units, variances in place of sigmas."""

    gyr_density: float
    bias_density: float
    bias_decay_per_s: float
    earth_rate: Floats  # (3,) rad/s in nav.
    acc_variance: float
    gravity_age_s: float  # Half the window over which the specific force is averaged.
    mag_variance: float
    shortest_s: float
    longest_s: float


def build_model(p: PocketParameters) -> FilterModel:
    """Return noise densities and gates of the compiled filter, in rad, m/s^2 and uT."""
    return FilterModel(
        gyr_density=float(np.radians(GYR_DENSITY_DEG)) ** 2,
        bias_density=compute_bias_walk() ** 2,
        bias_decay_per_s=compute_bias_decay(p.bias_returns_to_zero),
        earth_rate=compute_earth_rate(p.latitude_deg),
        acc_variance=p.acc_sigma_m_s2**2,
        gravity_age_s=p.gravity_window_s / 2.0,
        mag_variance=p.mag_sigma_uT**2,
        shortest_s=p.shortest_difference_s,
        longest_s=p.shortest_difference_s + MAX_DIFFERENCE_S,
    )


# prediction: MD (3)-(11), (26)


@njit(cache=True)
def predict_state(state: PocketState, reference: FieldReference, rate: Floats, h: float, model: FilterModel) -> None:
    """Propagate state, covariance and field reference, in place, over angular `rate` (3,) rad/s held for `h` s."""
    R, bias, P = state
    # attitude, bias and reference
    theta, earth, decay = np.empty(3), model.earth_rate, np.exp(-h * model.bias_decay_per_s)
    for i in range(3):
        turned = R[0, i] * earth[0] + R[1, i] * earth[1] + R[2, i] * earth[2]
        theta[i] = (rate[i] - bias[i] - turned) * h
        bias[i] *= decay
    rotate_in_body(R, theta[0], theta[1], theta[2])
    per_bias = -h * right_jacobian(theta)
    propagate_reference(reference, theta, per_bias, h)
    # transition of the errors
    F = np.zeros((SIZE, SIZE))
    F[:GYRO_BIAS, :GYRO_BIAS], F[:GYRO_BIAS, GYRO_BIAS:] = np.eye(3) - h * cross_matrix(earth), multiply(R, per_bias)
    F[GYRO_BIAS:, GYRO_BIAS:] = decay * np.eye(3)
    # covariance
    P[:, :] = multiply(multiply(F, P), transpose(F))
    for i in range(3):
        P[i, i] += model.gyr_density * h
        P[GYRO_BIAS + i, GYRO_BIAS + i] += model.bias_density * h


# reference of the field: MD (15)


def create_reference() -> FieldReference:
    """Return the reference before the first field."""
    return FieldReference(np.zeros(3), np.eye(3), np.zeros((3, 3)), np.full(1, np.nan))


@njit(cache=True)
def set_reference(reference: FieldReference, field: Floats) -> None:
    """Start again from a field (3,) uT just measured."""
    reference.field[:] = field
    reference.turn[:, :], reference.per_bias[:, :], reference.age[0] = np.eye(3), 0.0, 0.0


@njit(cache=True)
def propagate_reference(reference: FieldReference, theta: Floats, per_bias: Floats, h: float) -> None:
    """Propagate the field reference, in place, by `theta` (3,) rad in `h` s; `per_bias` (3, 3) s: d theta / d bias."""
    S = transpose(reference.per_bias)
    rotate_in_body(S, theta[0], theta[1], theta[2])  # S^T A_i is (A_i^T S)^T
    reference.per_bias[:, :] = transpose(S) + per_bias
    rotate_in_body(reference.turn, theta[0], theta[1], theta[2])
    reference.age[0] += h


@njit(cache=True)
def predict_field(reference: FieldReference) -> Floats:
    """Predicted body field m' (3,) uT; a bias higher by db moves it by m' x (S db)."""
    field = np.zeros(3)
    for i in range(3):
        for j in range(3):
            field[i] += reference.turn[j, i] * reference.field[j]
    return field


@njit(cache=True)
def shift_reference_bias(reference: FieldReference, change: Floats) -> None:
    """Rotate A along with a change (3,) rad/s of the bias."""
    theta = np.zeros(3)
    for i in range(3):
        for j in range(3):
            theta[i] += reference.per_bias[i, j] * change[j]
    rotate_in_body(reference.turn, theta[0], theta[1], theta[2])


# absolute gravity update: MD (12)-(14)


@njit(cache=True)
def update_gravity(state: PocketState, reference: FieldReference, force: Floats, model: FilterModel) -> float:
    """Update roll and pitch by a specific force (3,) m/s^2 of gravity alone; return the NIS, two degrees of freedom."""
    R, b, age = state.nav_R_body, state.gyro_bias, model.gravity_age_s
    square, up, x = 0.0, np.empty(3), np.zeros(SIZE)
    # the force is `age` old: as it is in the body now
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        square += force[i] ** 2
        up[i] = force[i] + age * (b[j] * force[k] - b[k] * force[j])
    z, h = np.zeros(2), np.zeros((2, SIZE))
    h[0, ATTITUDE + 1], h[1, ATTITUDE] = 1.0, -1.0
    for i in range(3):
        up[i] /= np.sqrt(square)
    for row in range(2):  # R (db x up), row by row: r . (db x up) = db . (up x r)
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            h[row, GYRO_BIAS + i] = age * (up[j] * R[row, k] - up[k] * R[row, j])
            z[row] += R[row, i] * up[i]
    first = update_row(state.P, x, h[0], z[0], model.acc_variance / square)
    second = update_row(state.P, x, h[1], z[1], model.acc_variance / square)
    inject_error(state, reference, x)
    return first**2 + second**2


# differential magnetic field update: MD (15), (16)


@njit(cache=True)
def update_field(state: PocketState, reference: FieldReference, field: Floats, model: FilterModel) -> float:
    """Update by a body field (3,) uT, across the predicted one; return the NIS, two degrees of freedom."""
    expected, per_bias = predict_field(reference), reference.per_bias
    strength = np.sqrt(expected[0] ** 2 + expected[1] ** 2 + expected[2] ** 2)
    for i in range(3):
        expected[i] /= strength
    across = _span_across(expected)
    variance = 2.0 * model.mag_variance + model.gyr_density * reference.age[0] * strength**2
    x, h, z = np.zeros(SIZE), np.zeros((2, SIZE)), np.zeros(2)
    for i in range(3):
        for j in range(3):
            h[0, GYRO_BIAS + i] -= strength * across[1, j] * per_bias[j, i]
            h[1, GYRO_BIAS + i] += strength * across[0, j] * per_bias[j, i]
        for row in range(2):
            z[row] -= across[row, i] * field[i]
    first = update_row(state.P, x, h[0], z[0], variance)
    second = update_row(state.P, x, h[1], z[1], variance)
    inject_error(state, reference, x)
    return first**2 + second**2


@njit(cache=True)
def _span_across(along: Floats) -> Floats:
    """Unit vectors u, v (2, 3) across `along` (3,), such that u, v, along are right-handed."""
    least = 0
    for i in range(1, 3):
        if abs(along[i]) < abs(along[least]):
            least = i
    j, k, out = (least + 1) % 3, (least + 2) % 3, np.zeros((2, 3))
    length = np.sqrt(along[j] ** 2 + along[k] ** 2)
    out[0, j], out[0, k] = -along[k] / length, along[j] / length  # of the axis it is least along, and it
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[1, i] = along[j] * out[0, k] - along[k] * out[0, j]
    return out


@njit(cache=True)
def inject_error(state: PocketState, reference: FieldReference, x: Floats) -> None:
    """Subtract error `x` (6,), attitude rad and bias rad/s, from the state; correct the reference for the new bias."""
    rotate_in_nav(state.nav_R_body, -x[0], -x[1], -x[2])
    change = -x[GYRO_BIAS:]
    for i in range(3):
        state.gyro_bias[i] += change[i]
    shift_reference_bias(reference, change)


# the filter


class FilterInputs(NamedTuple):
    """Samples for the compiled pass, and when to use them."""

    h: Floats  # (N,) s, periods.
    rate: Floats  # (N, 3).
    force: Floats  # (N, 3).
    field: Floats  # (N, 3).
    gravity: Bools  # (N,) whether the force is gravity alone,
    fresh: Bools  # there is a field,
    steady: Bools  # and it holds still.


def estimate_pocket(
    recording: Recording, parameters: PocketParameters = PocketParameters(), start: PocketStart | None = None
) -> PocketTrack:
    """Estimate orientation and gyro bias of a sensor in a trouser pocket; the field is used in the rows that have one.

    `start`: attitude at the first sample; level with heading 0 if None.

    Raises `EstimationError` if it cannot be levelled, or the filter diverges to infinity.
    """
    inputs = prepare_inputs(recording, parameters)
    state = initialize_state(level_start(recording) if start is None else start, parameters)
    track = allocate_track(recording.t, max(round(STORED_EVERY_S / recording.period_s), 1))
    run_filter(inputs, state, create_reference(), build_model(parameters), track)
    finite = np.isfinite(track.gyro_bias).all(axis=1) & np.isfinite(track.nav_R_body).all(axis=(1, 2))
    if not finite.all():
        raise EstimationError(
            f"the filter diverged to infinity at {recording.t[np.argmin(finite)]:.3f} s: check the samples there."
        )
    return track


def initialize_state(start: PocketStart, parameters: PocketParameters) -> PocketState:
    """Return attitude, zero bias and covariance at the first sample."""
    R = np.ascontiguousarray(start.nav_R_body, dtype=np.float64).copy()
    bias_sigma = np.radians(parameters.gyro_bias_sigma_deg_s)
    sigma = np.append([start.tilt_sigma, start.tilt_sigma, start.heading_sigma], np.full(3, bias_sigma))
    return PocketState(R, np.zeros(3), np.diag(sigma**2))


@njit(cache=True)
def run_filter(
    inputs: FilterInputs, state: PocketState, reference: FieldReference, model: FilterModel, track: PocketTrack
) -> None:
    """Filter all samples into a blank `track`."""
    for i in range(len(inputs.h)):
        # propagate over the sample before
        if i > 0:
            predict_state(state, reference, inputs.rate[i - 1], inputs.h[i - 1], model)
        # correct by gravity
        if inputs.gravity[i]:
            track.gravity_nis[i] = update_gravity(state, reference, inputs.force[i], model)
        # correct by the field, if it holds still and the reference is neither too near nor too far, and replace that
        age = reference.age[0]
        if inputs.fresh[i] and not (inputs.steady[i] and age < model.shortest_s - 1e-9):
            if inputs.steady[i] and age <= model.longest_s + 1e-9:
                track.field_nis[i] = update_field(state, reference, inputs.field[i], model)
            set_reference(reference, inputs.field[i])
        store_state(i, state, track)


@njit(cache=True)
def store_state(i: int, state: PocketState, track: PocketTrack) -> None:
    """Write the state at sample i."""
    track.gyro_bias[i], track.nav_R_body[i] = state.gyro_bias, state.nav_R_body
    for row in range(SIZE):
        track.sigma[i, row] = np.sqrt(state.P[row, row])
    number = np.searchsorted(track.covariance_sample, i)
    if number < len(track.covariance_sample) and track.covariance_sample[number] == i:
        track.covariance[number] = state.P


def allocate_track(t: Floats, every: int) -> PocketTrack:
    """Return a blank track at stamps `t` (N,) s, with the covariance at each `every`-th."""
    n, stored, nan = len(t), np.arange(0, len(t), every), np.full(len(t), np.nan)
    blank = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, SIZE))
    return PocketTrack(t, *blank, stored, np.empty((len(stored), SIZE, SIZE)), nan, nan.copy())


# inputs: specific force, field, and the detectors


def prepare_inputs(recording: Recording, parameters: PocketParameters) -> FilterInputs:
    """Return samples, periods and the flags of the gravity and field detectors, as the compiled filter needs them."""
    t, n = recording.t, len(recording)
    # specific force at the stamps, and where it is gravity
    count = round(parameters.gravity_window_s / recording.period_s)
    force = average_force(recording, count) if count else interpolate_force(recording.acc)
    gravity = np.zeros(n, dtype=np.bool_)
    if parameters.gravity_update:
        gravity = thin_flags(t, detect_gravity(t, force), parameters.gravity_window_s / 2)
    # field, and where it holds still
    field = np.full((n, 3), np.nan) if recording.mag is None or not parameters.field_update else recording.mag
    fresh = np.asarray(np.isfinite(field).all(axis=1) & field.any(axis=1), dtype=np.bool_)
    steady = detect_steady_field(t, field, parameters.mag_sigma_uT) if parameters.field_gated else fresh
    return FilterInputs(recording.periods_s, recording.integrable[1], force, field, gravity, fresh, steady)


def interpolate_force(acc: Floats) -> Floats:
    """Specific force (N, 3) at the stamps, of samples that are means over the period after them."""
    force = acc.copy()
    force[1:] = (acc[1:] + acc[:-1]) / 2
    return force


def average_force(recording: Recording, count: int) -> Floats:
    """Mean specific force (N, 3) m/s^2 over the last `count` periods, in the body frame at each stamp; NaN at first.

    Weights are a raised cosine: the mean lags by half the window.
    """
    h, (acc, gyr) = recording.periods_s, recording.integrable
    attitude = integrate_rates(gyr, h)
    force = acc + np.cross(gyr, acc) * (h / 2)[:, None]
    weight = 1.0 - np.cos(2 * np.pi * (np.arange(count) + 0.5) / count)
    mean = np.full((len(recording), 3), np.nan)
    if len(recording) > count:
        level = np.einsum("nij,nj->ni", attitude, force)
        smooth = np.stack([np.convolve(axis, weight / weight.sum(), "valid")[:-1] for axis in level.T], axis=1)
        mean[count:] = np.einsum("nji,nj->ni", attitude[count:], smooth)
    return mean


@njit(cache=True)
def integrate_rates(gyr: Floats, h: Floats) -> Floats:
    """Attitudes (N, 3, 3) at the stamps, from the identity, by strapdown of rates (N, 3) rad/s held for `h` (N,) s."""
    attitude = np.empty((len(gyr), 3, 3))
    R = np.eye(3)
    for i in range(len(gyr)):
        for row in range(3):
            for column in range(3):
                attitude[i, row, column] = R[row, column]
        rotate_in_body(R, gyr[i, 0] * h[i], gyr[i, 1] * h[i], gyr[i, 2] * h[i])
    return attitude


def thin_flags(t: Floats, flags: Bools, period_s: float) -> Bools:
    """Those of the flags (N,) that are a period or more after the last one that remains."""
    thinned, last = np.zeros(len(t), dtype=np.bool_), -np.inf
    for row in np.flatnonzero(flags):
        if t[row] - last >= period_s - 1e-9:
            thinned[row], last = True, t[row]
    return thinned


def detect_gravity(t: Floats, acc: Floats) -> Bools:
    """(N,) True where the specific force (N, 3) m/s^2 has had gravity's strength for long enough."""
    near = np.abs(np.linalg.norm(acc, axis=1) - GRAVITY_M_S2) < ZERO_ACCELERATION_M_S2  # not NaN
    rows = np.arange(len(t))
    last_far = np.maximum.accumulate(np.where(near, -1, rows))
    since = t[np.minimum(last_far + 1, len(t) - 1)]
    period = float(np.median(np.diff(t)))
    return np.asarray(near & (t - since + period > ZERO_ACCELERATION_S - 1e-9))


def detect_steady_field(t: Floats, mag: Floats, mag_sigma_uT: float) -> Bools:
    """(N,) True where the strength of `mag` (N, 3) uT, NaN without a reading, is constant within its noise."""
    fresh = np.flatnonzero(np.isfinite(mag).all(axis=1))
    steady = np.zeros(len(t), dtype=np.bool_)
    if len(fresh) < 2:
        return steady
    count = max(round(FIELD_WINDOW_S / float(np.median(np.diff(t[fresh])))), 3)
    if len(fresh) >= count:
        strength = np.linalg.norm(mag[fresh], axis=1)
        spread = np.lib.stride_tricks.sliding_window_view(strength, count).var(axis=1, ddof=1)
        noise = mag_sigma_uT**2 * float(chdtri(count - 1, FIELD_FALSE_ALARM)) / (count - 1)
        steady[fresh[count - 1 :]] = spread < noise + (FIELD_DRIFT_UT_S * FIELD_WINDOW_S) ** 2 / 12.0
    return steady


def estimate_field_noise_uT(recording: Recording) -> float:
    """White noise of the magnetometer, uT per axis and sample: first decile over the seconds of the recording.

    By second differences, of variance 6 sigma^2, in which a thigh that swings leaves 0.1 uT or less at 100 Hz where it
    turns back. It is never below that of MD Table 2.
    """
    least_uT = PocketParameters().mag_sigma_uT
    mag = np.zeros((0, 3)) if recording.mag is None else recording.mag[np.isfinite(recording.mag).all(axis=1)]
    second = np.diff(mag, n=2, axis=0)
    rate = len(mag) / (recording.t[-1] - recording.t[0])
    blocks = np.array_split(second, max(int(len(second) / max(rate, 4.0)), 1))
    scatter = [float(np.sqrt((block**2).mean() / 6.0)) for block in blocks if len(block) > 1]
    return max(float(np.percentile(scatter, 10)), least_uT) if scatter else least_uT
