"""The filter of Munoz Diaz et al. (2017): orientation and gyro bias of a sensor in a trouser pocket.

    start       level by the first second, bias zero                                          (track)
    each sample
        predict     attitude by the rate less its bias, bias by its model                     MD (3)-(11)
        gravity     where the specific force looks like gravity alone: roll and pitch         MD (12)-(14)
        field       where the field holds still: its rotation since the last sample           MD (15), (16)
        store       attitude, bias, their sigmas

Gravity shows drifts of the tilt, that is of the two biases that are level at the time. The differential field shows the
bias across the field: two of three components while the body keeps one attitude to it, the third as the leg swings or
the walk turns. The heading itself is never observed: turned about up, all results are the same.

A rate is the mean over the period from its stamp to the next one; a field is that of its stamp.

Specific force of the gravity update (`average_force`)
    MD uses a sample while its strength is gravity's. A walking thigh passes through that strength with as much and more
    across, and to the same side in each stride: by up to 4.7 m/s^2 an axis on two real thighs (`qmt_fullbody`), by 3 to
    5 in the mean in the simulated street, where the tilt is 60 deg off. But over a stride the hip's velocity comes back
    to itself, and the mean specific force, its samples rotated into one frame by the gyroscope, is gravity. Weighted by
    a raised cosine over two seconds, so that it need not span a whole number of strides, it is so to 0.1 to 0.25 m/s^2
    an axis on those thighs and to 0.1 in the simulator (a plain mean over one second: 0.15 to 0.35).

        sum over the window of  w_j G_k^T G_j f_j,     G the attitude by the gyroscope alone, from any start

    A bias b rotates the mean, which is half a window T old, by b T / 2: its row has that term.

Detectors (MD 2.1.2 names two and refers to its reference 26). Ours are causal.
    zero acceleration: | |a| - g | < limit, for a while. Only the strength is used: an acceleration across gravity
    shows in it by its square, 0.3 m/s^2 for 2.4. Hence the sigma of the direction.

    magnetic disturbance: s, the standard deviation of |B| over the last n samples with a field, against sigma and the
    drift that may pass

        s^2 < sigma^2 chi2_{n-1}(1 - p) / (n - 1) + (drift T)^2 / 12

    p being the false-alarm rate of noise alone, and T the window: a steady drift spreads by drift T / sqrt(12).
    The strength needs no attitude. A field that turns at the same strength is not detected.

Reference: Munoz Diaz, de Ponte Mueller, Garcia Dominguez (2017), "Use of the Magnetic Field for Improving Gyroscopes'
Biases Estimation", Sensors 17(4) 832.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import rotate_in_body
from fg_nav.pocket.filter_equations import (
    SIZE,
    FieldReference,
    FilterModel,
    PocketParameters,
    PocketState,
    build_model,
    create_reference,
    predict_state,
    set_reference,
    update_field,
    update_gravity,
)
from fg_nav.pocket.track import STORED_EVERY_S, PocketStart, PocketTrack, level_start
from fg_nav.recording import Recording
from fg_nav.system.compiled import njit

ZERO_ACCELERATION_M_S2 = 0.3  # Largest distance of the specific force's strength from gravity, m/s^2. Not printed.
ZERO_ACCELERATION_S = 0.05  # ... and for how long it must have been within it, s. Not printed.
FIELD_WINDOW_S = 0.5  # Window over which the field's strength must hold still, s: half a stride. Not printed.
FIELD_DRIFT_UT_S = 0.5  # ... its steady change that may pass, uT/s: it may turn the field by 1 deg/s. Not printed.
FIELD_FALSE_ALARM = 0.01  # ... and the false-alarm rate of noise alone.


class FilterInputs(NamedTuple):
    """Samples for the compiled pass: periods `h` (N,) s, `rate`, `force`, `field` (N, 3), and when to use the latter.

    `gravity`, `fresh` and `steady` (N,): whether the force is gravity alone, there is a field, and it holds still.
    """

    h: Floats
    rate: Floats
    force: Floats
    field: Floats
    gravity: Bools
    fresh: Bools
    steady: Bools


def estimate_pocket(
    recording: Recording, parameters: PocketParameters = PocketParameters(), start: PocketStart | None = None
) -> PocketTrack:
    """Estimate orientation and gyro bias of a sensor in a trouser pocket.

    Parameters
    ----------
    recording : Recording
        Without a magnetometer, or in rows without one, the field is not used.
    parameters : PocketParameters
        MD's by default.
    start : PocketStart
        Attitude at the first sample; level with heading 0 if None.

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
    attitude = _integrate_rates(gyr, h)
    force = acc + np.cross(gyr, acc) * (h / 2)[:, None]
    weight = 1.0 - np.cos(2 * np.pi * (np.arange(count) + 0.5) / count)
    mean = np.full((len(recording), 3), np.nan)
    if len(recording) > count:
        level = np.einsum("nij,nj->ni", attitude, force)
        smooth = np.stack([np.convolve(axis, weight / weight.sum(), "valid")[:-1] for axis in level.T], axis=1)
        mean[count:] = np.einsum("nji,nj->ni", attitude[count:], smooth)
    return mean


@njit(cache=True)
def _integrate_rates(gyr: Floats, h: Floats) -> Floats:
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
