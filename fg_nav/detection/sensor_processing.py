"""Processing of the samples inside the sensor, from a foot's strides: a low-pass, a high-pass and a delay.

Low-pass. A heel strike has power up to a hundred hertz, and a foot in the air some up to 12. With P the power of the
specific force in a band, P(1 to 4 Hz) over P(8 to 12 Hz) is 2 to 25 on real feet, and 600 behind a low-pass of 5 Hz,
which removes the stances too.

High-pass of the gyroscope, of time constant 1 / k: the rate w becomes y with y' = w' - k y, and the part removed is

    w - y = k int y dt

so a turn seems to go back within 1 / k, and a constant rate vanishes. Gravity shows it. From one stance to the next,
with C the turn by y, the vertical misses the part removed, and that added by a constant bias b:

    u_(j+1) - C^T u_j = u_(j+1) x (k int int y dt dt + b T)

k and b by least squares with Student weights; the evidence for k is the decrease of the log of the misses, two to a
stride, over b alone. On real sensors k is 0.

Delay of the gyroscope behind the accelerometer of the same foot: 20 ms are 4 per cent of the length. Between two
instants in which the foot stands, strapdown from rest ends at rest, with up as measured, if and only if both sensors
read at one time. With the rate read at t + tau, r_k = (v_k / s_v, (up_k - up) / s_u) at the end of stride k
(`fg_nav.detection.mount`) and the biases b of both sensors, with their priors, as further unknowns,

    r(tau, b) -> least by Gauss-Newton with robust weights 1 / (1 + |r_k|^2 / 4),

the variance of tau is that of the scores g_k of the strides, H^-1 (sum g_k g_k^T) H^-1, plus the square of
`SYSTEMATIC_S`, for the effects of rolling, scale and clipping: on 45 real walks without a delay 4 ms rms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints, interpolate_columns
from fg_nav.detection.mount import DECISIVE, LOOKED_S, average_force, find_stance_strides, find_strides_of
from fg_nav.detection.rest import remove_large_bias
from fg_nav.detection.stance import Stances
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2, level_attitude
from fg_nav.mechanisation import integrate_strides
from fg_nav.recording import Recording

GAIT_HZ, STRIKE_HZ = (1.0, 4.0), (8.0, 12.0)
MIN_SMOOTHING_HZ = 30.0  # A slower recording does not show the strikes.
SPECTRUM_S = 4.0  # Pieces of which the power is averaged.
UP_S = 0.05  # Around the stillest sample, of the mean specific force.
MIN_FILTER_STRIDES = 12  # For four unknowns.
WEIGHT_ROUNDS = 10  # Of the Student weights.
MIN_DELAY_STRIDES = 8  # For a scatter.
VELOCITY_M_S, UP = 0.3, 0.05  # s_v and s_u, errors of ordinary strides.
BIAS_SIGMA = np.array([1.0, *[0.05] * 3, *[0.3] * 3])  # Priors of tau (s, none), gyroscope (rad/s), accelerometer bias.
STEP = np.array([2e-3, *[1e-3] * 3, *[0.02] * 3])  # Of the differences by which r is linearized.
STARTS_S = (0.0, -0.05, 0.05)  # Initial delays: beyond half a swing there are other minima.
MAX_STEPS, MAX_STEP_S, CLOSE_S = 8, 0.02, 2e-4  # Of Gauss-Newton; it takes 4.
SYSTEMATIC_S, SIGMAS, MAX_S = 4e-3, 3.0, 0.1  # A delay that is removed: sigmas, and no longer than a sensor can have.
MAX_MISS = 8.0  # Median of |r|^2 above which they are no strides of a foot.


def measure_smoothing(recording: Recording) -> float:
    """Power of the specific force at the gait's rate over that of heel strikes; NaN of too short a recording."""
    if recording.period_s > 1.0 / MIN_SMOOTHING_HZ or recording.duration_s < SPECTRUM_S:
        return np.nan
    acc = recording.acc[: round(LOOKED_S / recording.period_s)]
    length = round(SPECTRUM_S / recording.period_s)
    pieces = acc[: len(acc) // length * length].reshape(-1, length, 3)
    window = np.hanning(length)[:, None]
    power = np.abs(np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2
    f, power = np.fft.rfftfreq(length, recording.period_s), power.sum(axis=(0, 2))
    of_gait, of_strike = (power[(f >= low) & (f < high)].mean() for low, high in (GAIT_HZ, STRIKE_HZ))
    return float(of_gait / max(of_strike, 1e-30))


class HighPass(NamedTuple):
    """A high-pass of the gyroscope: k, 1/s, and the evidence for it, nats; none for k < 0."""

    rate: float
    evidence: float

    @property
    def problem(self) -> str:
        """Remark for the user."""
        return (
            "the sensor has a high-pass on its gyroscope: a turn is taken back within "
            f"{1 / max(self.rate, 1e-9):.0f} s, as gravity shows, so no heading can be had of it: switch it off and "
            "record again"
        )


def refuse_high_pass(recording: Recording, stances: Stances) -> None:
    """Raise `RecordingError` where strides clearly show a high-pass of the gyroscope."""
    found = measure_high_pass(recording, stances)
    if found.evidence > 2 * DECISIVE:
        raise RecordingError(f"{found.problem}.")


def measure_high_pass(recording: Recording, stances: Stances) -> HighPass:
    """Estimate the gyroscope's high-pass from the tilt errors of strides; no evidence where there are too few."""
    start, stop = find_stance_strides(recording, stances)
    if len(start) < MIN_FILTER_STRIDES:
        return HighPass(0.0, 0.0)
    n = int(np.searchsorted(recording.t, recording.t[0] + LOOKED_S))
    t, acc, gyr = recording.t[:n], recording.acc[:n], recording.gyr[:n]
    h = np.append(np.diff(t), recording.period_s)
    # tilt error of each stride: up at its end, less up at its start rotated by the gyroscope
    reach = max(1, round(UP_S / recording.period_s))
    force = np.vstack([np.zeros(3), np.cumsum(acc, axis=0)])
    before, up = (force[np.minimum(at + reach + 1, n)] - force[np.maximum(at - reach, 0)] for at in (start, stop))
    before, up = (one / np.linalg.norm(one, axis=1, keepdims=True) for one in (before, up))
    turn, none = np.tile(np.eye(3), (len(start), 1, 1)), np.zeros((len(start), 3))
    integrate_strides(acc, gyr, h, start, stop, turn, none, 0.0)
    miss = up - np.einsum("kji,kj->ki", turn, before)
    # regress it on a high-pass (double integral of the rate) and a bias, reweighted against outliers
    taken = np.cumsum(np.cumsum((gyr - gyr.mean(axis=0)) * h[:, None], axis=0) * h[:, None], axis=0)
    lasts = (t[stop] - t[start])[:, None]
    columns = [taken[stop] - taken[start], *(lasts * one for one in np.eye(3))]
    design = np.stack([np.cross(up, column) for column in columns], axis=2)
    weight = np.ones(len(start))
    for _ in range(WEIGHT_ROUNDS):
        found = _solve(design, miss, weight)
        left = np.sum((miss - design @ found) ** 2, axis=1)
        weight = 1.0 / (1.0 + left / (4.0 * max(float(np.median(left)), 1e-30)))
    without = np.sum((miss - design[:, :, 1:] @ _solve(design[:, :, 1:], miss, weight)) ** 2, axis=1)
    gain = len(start) * np.log(max(float(weight @ without), 1e-30) / max(float(weight @ left), 1e-30))
    return HighPass(float(found[0]), float(gain) if found[0] > 0.0 else 0.0)


def _solve(design: Floats, miss: Floats, weight: Floats) -> Floats:
    """Coefficients (p,) of weighted least squares: design (K, 3, p), observations (K, 3), weights (K,)."""
    root = np.sqrt(weight)[:, None]
    rows = (root[..., None] * design).reshape(-1, design.shape[2])
    return np.asarray(np.linalg.lstsq(rows, (root * miss).ravel(), rcond=None)[0])


@dataclass(frozen=True)
class GyroDelay:
    """Delay `tau_s` of the gyroscope behind the accelerometer, negative where it is early, and its `sigma_s`."""

    tau_s: float
    sigma_s: float

    @property
    def is_clear(self) -> bool:
        """Whether it is significant and possible."""
        return SIGMAS * self.sigma_s < abs(self.tau_s) <= MAX_S

    def __str__(self) -> str:
        """Remark for the user."""
        side = "late" if self.tau_s > 0 else "early"
        found = f"{1e3 * abs(self.tau_s):.0f} ms {side} (sigma {1e3 * self.sigma_s:.0f} ms)"
        return f"the gyroscope is {found} against the accelerometer, which is taken off"


def estimate_gyro_delay(recording: Recording) -> GyroDelay | None:
    """Estimate the gyroscope's delay by strapdown over strides of a foot; None where they are too few or do not fit."""
    looked = np.s_[: int(np.searchsorted(recording.t, recording.t[0] + LOOKED_S))]
    t, (acc, gyr) = recording.t[looked], (peaks.whole[looked] for peaks in recording.peaks)
    start, stop = find_strides_of(t, recording.acc[looked], recording.gyr[looked])
    if len(start) < MIN_DELAY_STRIDES:
        return None
    gyr = remove_large_bias(t, acc, gyr)
    up_start, up_stop = (average_force(t, acc, sample) for sample in (start, stop))
    # the samples of the strides alone
    rows = np.unique(np.concatenate([np.arange(a, b + 1) for a, b in zip(start, stop, strict=True)]))
    h, acc = np.diff(t, append=2 * t[-1] - t[-2])[rows], acc[rows]
    start, stop = np.searchsorted(rows, start), np.searchsorted(rows, stop)

    def miss(x: Floats, rate: Floats) -> Floats:
        """Residuals r (K, 6), velocity and vertical at the strides' ends; x (7,) is delay, gyro and acc bias."""
        attitude, bias = level_attitude(up_start - x[4:]), np.tile(x[1:4], (len(start), 1))
        velocity = integrate_strides(acc - x[4:], rate, h, start, stop, attitude, bias, GRAVITY_M_S2)
        up = up_stop - x[4:]
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        return np.hstack([velocity / VELOCITY_M_S, (attitude[:, 2] - up) / UP])

    found = [_minimize(lambda tau_s: read_rate_at(t, gyr, tau_s, rows), miss, start_s) for start_s in STARTS_S]
    _, x, H, scores, square = min(found, key=lambda one: one[0])
    if np.median(square) > MAX_MISS or not abs(x[0]) < 2 * MAX_S:
        return None
    variance = np.linalg.solve(H, np.linalg.solve(H, scores.T @ scores).T)[0, 0]
    return GyroDelay(float(x[0]), float(np.sqrt(variance + SYSTEMATIC_S**2)))


def _minimize(
    read_rate: Callable[[float], Floats], miss: Callable[[Floats, Floats], Floats], tau_s: float
) -> tuple[float, Floats, Floats, Floats, Floats]:
    """Gauss-Newton from `tau_s`: robust cost, unknowns (7,), normal matrix (7, 7), scores (K, 7), |r|^2 (K,)."""
    x, information = np.array([tau_s, *[0.0] * 6]), 1.0 / BIAS_SIGMA**2
    for _ in range(MAX_STEPS):
        rate = read_rate(x[0])
        r = miss(x, rate)
        rates = [read_rate(x[0] + STEP[0]), *[rate] * 6]
        J = np.stack([(miss(x + row, own) - r) / row.sum() for row, own in zip(np.diag(STEP), rates, strict=True)], 2)
        square = (r**2).sum(axis=1)
        scores = np.einsum("kij,ki->kj", J, r) / (1.0 + square / 4.0)[:, None]
        H = np.einsum("kij,kil,k->jl", J, J, 1.0 / (1.0 + square / 4.0)) + np.diag(information)
        step = np.linalg.solve(H, -(scores.sum(axis=0) + information * x))
        step[0] = np.clip(step[0], -MAX_STEP_S, MAX_STEP_S)
        x = x + step
        if abs(step[0]) < CLOSE_S:
            break
    return float(np.log1p(square / 4.0).sum()), x, H, scores, square


def read_rate_at(t: Floats, gyr: Floats, tau_s: float, rows: Ints | slice = np.s_[:]) -> Floats:
    """Interpolate the rates gyr (N, 3) linearly at the stamps of `rows`, shifted by `tau_s`; return (R, 3)."""
    return interpolate_columns(t[rows] + tau_s, t, gyr)


def remove_gyro_delay(recording: Recording) -> Recording:
    """Return a foot's recording without the delay of its gyroscope, and with a note, where it is significant."""
    delay = estimate_gyro_delay(recording)
    if delay is None or not delay.is_clear:
        return recording
    known = recording.provenance
    gyr = read_rate_at(recording.t, recording.gyr, delay.tau_s)
    return replace(recording, gyr=gyr, provenance=replace(known, notes=(*known.notes, str(delay))))
