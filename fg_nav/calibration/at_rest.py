"""What a sensor that lies still shows of itself: the gyroscope's bias, the accelerometer's scale and bias, the noise.

    gyr = omega + b_g          at rest omega = 0 (the Earth's 15 deg/h are left in b_g, and so is the g-sensitivity)
    acc = s f + b_a            at rest ||f|| = g

A rest shows one number about the accelerometer, ||acc||, and four are unknown: one attitude cannot separate scale from
bias. Rests in several attitudes lie on a sphere with radius s g about b_a, found by least squares with the covariance
of the four. The attitudes must surround the center for that: six faces do, a foot's do not.

One scale stands for three axes. With E what scales and axes differ from that by, each entry of sd e, a rest in the
direction n_i is g n_i' E n_i off the sphere. So rests are correlated, e^2 g^2 (n_i . n_j)^2, and the covariance has it.

Between recordings the bias changes, by a hundredth to some tenths of a deg/s. With b_k +- s_k an axis of recording k

    b_k = mu + e_k + n_k,     e_k ~ N(0, tau^2),   n_k ~ N(0, s_k^2),

a random-effects model: tau is averaged over levels by the evidence left when mu is integrated out (DerSimonian and
Laird 1986; Gelman et al. 2013, section 5.4), common to the axes. A recording far off counts little: e_k is a mixture
with a sensor that has changed (`CHANGED_SHARE`). The next recording is then expected at mu, within the sigma of mu and
tau together. One recording is the case of n = 1, in which tau is that of the levels' prior.

Noise: an Allan deviation of each axis (`fg_nav.calibration.allan`) over the longest stillness. Stillness is defined by
the sensor's own noise, not by a foot's rest (`fg_nav.detection.rest`): one second is quiet if its scatter is about that
of the quietest seconds, and two quiet seconds belong together if their means agree as far as noise allows. Any motion,
a step on the floor nearby even, ends the stretch. A magnetometer with a rate of its own is read at its own rows.
Samples that a recording lacks lie on a line between their neighbors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np
from scipy.optimize import least_squares

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.allan import (
    MIN_READINGS,
    AllanCurve,
    NoiseFit,
    choose_averaging_factors,
    compute_allan_curve,
    fit_noise,
)
from fg_nav.detection import Rest, RestParameters, find_rests
from fg_nav.detection.rest import MIN_SIGMA_DEG_S, find_still_stretches
from fg_nav.errors import CalibrationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.stances import find_runs
from fg_nav.text import format_count

UNKNOWNS = 4  # Scale and bias of the accelerometer; fewer attitudes than that cannot show them.
MAX_CONDITION = 1e3  # Of the sphere's equations: beyond it the attitudes lie in a plane, but for noise.


GRAVITY_SIGMA_M_S2 = 0.013  # Of gravity where the place is not given: 9.780 on the equator, 9.832 on the poles.

AXES_SIGMA = 0.003
"""e: what scales and axes of a consumer part differ by (cross-axis errors of `mpu-9250` in the simulator)."""

FORCE_SIGMA_M_S2 = 0.01  # Of the mean force of a rest: 1 mg, for a hand's or a table's tremor and what a bias drifts.
SAME_ATTITUDE_DEG = 20.0  # Attitudes closer than this are one: a sphere does not show in a cap of it.

MIN_ATTITUDE_S = 2.0
"""A rest in a new attitude is at least this long: it is not compared with the bias of others, since that changes
with the attitude (g-sensitivity), so a slow stance must not pass for one."""

MAX_BIAS_SIGMA_M_S2 = 0.05  # A bias more uncertain than this (5 mg, a common one's size) is not worth to be taken off.


CHANGES_DEG_S = (0.02, 0.06, 0.2, 0.6)  # tau: from a sensor kept warm to one of the 1990s; 0.06 is typical of MEMS.
CHANGE_PRIOR = (0.3, 0.4, 0.2, 0.1)  # Of these levels, before the recordings.
ALONE = (("smoother.gyro_bias_sigma_deg_s", 1.0),)  # `Options.changes` with which a walk shows its bias itself.
CHANGED_SHARE, CHANGED_DEG_S = 0.05, 1.0  # One recording in twenty is of a sensor that was hit, heated or exchanged.
ROUNDS = 20  # Of the weights of such recordings.


class BiasPrior(TypedDict):
    """Parameters of the smoother by which it begins with a calibrated bias (`SmootherParameters`)."""

    gyro_bias_deg_s: tuple[float, float, float]
    gyro_bias_sigma_deg_s: float


@dataclass(frozen=True)
class GyroscopeCalibration:
    """Bias of a gyroscope, and where to expect it in the next recording.

    Attributes
    ----------
    bias, sigma : (3,) rad/s, of this recording, or the mean of several.
    next_sigma : rad/s an axis, of the bias of another recording about it: with the change between recordings.
    recordings, rests, seconds : that it is from, and how long the rests are together.
    """

    bias: Floats
    sigma: Floats
    next_sigma: float
    recordings: int
    rests: int
    seconds: float

    @property
    def prior(self) -> BiasPrior:
        """Prior of another recording's bias, to the digits that matter."""
        x, y, z = np.round(np.degrees(self.bias), 4).tolist()
        return {"gyro_bias_deg_s": (x, y, z), "gyro_bias_sigma_deg_s": round(float(np.degrees(self.next_sigma)), 4)}

    def apply_to(self, recording: Recording) -> Recording:
        """Return the recording with the bias taken off its rates."""
        return replace(recording, gyr=recording.gyr - self.bias)


@dataclass(frozen=True)
class AccelerometerCalibration:
    """Scale and bias of an accelerometer, or how far its reading is from gravity.

    Attributes
    ----------
    scale : s; where scale and bias are not separable ||acc|| / g, which has the bias in it.
    scale_sigma : its standard deviation; infinite where not separable.
    bias : b_a (3,) m/s^2; zero where not separable.
    bias_sigma : its standard deviation (3,) m/s^2; infinite where not separable.
    norm_m_s2 : mean of ||acc|| over all rests, by their length.
    attitudes, seconds : that it rests on.
    separable : whether the attitudes tell scale from bias.
    """

    scale: float
    scale_sigma: float
    bias: Floats
    bias_sigma: Floats
    norm_m_s2: float
    attitudes: int
    seconds: float
    separable: bool

    def correct(self, acc: Floats) -> Floats:
        """Return specific forces (n, 3) m/s^2 with bias and scale taken off; nothing is, where not separable."""
        return np.asarray((acc - self.bias) / self.scale) if self.separable else acc

    def apply_to(self, recording: Recording) -> Recording:
        """Return the recording with bias and scale taken off; raises `CalibrationError` if they are not separable."""
        if not self.separable:
            raise CalibrationError(
                f"rests in {format_count(self.attitudes, 'attitude')} do not tell the accelerometer's scale "
                f"from its bias: let it lie for {MIN_ATTITUDE_S:g} s on each of its six faces."
            )
        return replace(recording, acc=self.correct(recording.acc))


def calibrate_gyroscope(recording: Recording) -> GyroscopeCalibration | None:
    """Bias from all rests of a recording, weighted by what each is worth; None where nothing rests.

    Its sigma is not below `fg_nav.detection.rest.MIN_SIGMA_DEG_S`, however many rests there are, and grows where they
    disagree by more than their own sigmas.
    """
    rests = find_rests(recording)
    if not rests:
        return None
    rate, sigma = np.array([rest.rate for rest in rests]), np.array([rest.sigma for rest in rests])
    bias = (sigma**-2 * rate).sum(axis=0) / (sigma**-2).sum(axis=0)
    disagreement = (((rate - bias) / sigma) ** 2).sum(axis=0) / max(1, len(rests) - 1)
    spread = np.sqrt(np.maximum(disagreement, 1.0) / (sigma**-2).sum(axis=0))
    least = np.radians(MIN_SIGMA_DEG_S)
    sigma = np.maximum(spread, least)
    return _calibrate(bias, sigma, len(rests), _seconds(recording, rests))


def read_walk_bias(solution: Solution) -> GyroscopeCalibration:
    """Bias of a walk that was solved under a wide prior (`ALONE`), so that what other walks show does not count twice.

    Within a walk the bias hardly changes and its error is one: mean and root mean square over the footfalls.
    """
    table = solution.stances
    sigma = np.sqrt(np.mean(table.gyro_bias_sigma**2, axis=0))
    return _calibrate(table.gyro_bias.mean(axis=0), np.asarray(sigma))


def _calibrate(bias: Floats, sigma: Floats, rests: int = 0, seconds: float = 0.0) -> GyroscopeCalibration:
    return GyroscopeCalibration(bias, sigma, average_biases(bias[None], sigma[None])[2], 1, rests, seconds)


def average_gyroscopes(found: Sequence[GyroscopeCalibration]) -> GyroscopeCalibration:
    """Mean of one sensor's bias over its recordings, and how far from it the next one is expected."""
    bias, sigma, next_sigma = average_biases(
        np.array([one.bias for one in found]), np.array([one.sigma for one in found])
    )
    rests, seconds = sum(one.rests for one in found), sum(one.seconds for one in found)
    return GyroscopeCalibration(bias, sigma, next_sigma, sum(one.recordings for one in found), rests, seconds)


def average_biases(biases: Floats, sigmas: Floats) -> tuple[Floats, Floats, float]:
    """Mean (3,) of a sensor's biases (n, 3) in n recordings, its sigma (3,), and that of the next recording's bias.

    `sigmas` (n, 3) are of each recording's own bias; the last number is the root mean square over the axes. All in
    rad/s.
    """
    levels = []
    for change in np.radians(CHANGES_DEG_S):
        # of the sensor as it was, and of one that has changed
        variance = sigmas**2 + np.array([change, np.hypot(change, np.radians(CHANGED_DEG_S))])[:, None, None] ** 2
        mean = np.median(biases, axis=0)
        for _ in range(ROUNDS):
            off = 0.5 * ((biases - mean) ** 2 / variance + np.log(variance)).sum(axis=2)
            log_density = np.log([[1.0 - CHANGED_SHARE], [CHANGED_SHARE]]) - off
            log_sum = np.logaddexp(*log_density)
            weight = np.exp(log_density - log_sum)[:, :, None] / variance
            information = weight.sum(axis=(0, 1))
            mean = (weight * biases).sum(axis=(0, 1)) / information
        levels.append((change, mean, 1.0 / information, 0.5 * np.log(information).sum() - log_sum.sum()))
    changes, means, variances, minus_log = (np.array(one) for one in zip(*levels, strict=True))
    weight = np.exp(minus_log.min() - minus_log) * np.array(CHANGE_PRIOR)
    weight = weight / weight.sum()
    mean = weight @ means
    # a scale, about which the estimators weigh others: the level's geometric mean
    change = np.exp(weight @ np.log(changes))
    variance = np.exp(weight @ np.log(variances)) + weight @ (means - mean) ** 2
    return mean, np.sqrt(variance), float(np.sqrt(variance.mean() + change**2))


def calibrate_accelerometer(recording: Recording) -> AccelerometerCalibration | None:
    """Scale and bias from rests in several attitudes, or ||acc|| / g from fewer; None where nothing rests."""
    long = RestParameters(shortest_s=MIN_ATTITUDE_S, shortest_at_end_s=MIN_ATTITUDE_S)
    rests = find_still_stretches(recording, long) or find_rests(recording)
    if not rests:
        return None
    force = np.array([rest.force for rest in rests])
    samples = np.array([rest.stop - rest.start for rest in rests], dtype=np.float64)
    attitudes = _attitudes(force, np.radians(SAME_ATTITUDE_DEG))
    norm = float(np.average(np.linalg.norm(force, axis=1), weights=samples))
    unknown = AccelerometerCalibration(
        scale=norm / GRAVITY_M_S2, scale_sigma=np.inf, bias=np.zeros(3), bias_sigma=np.full(3, np.inf),
        norm_m_s2=norm, attitudes=attitudes, seconds=_seconds(recording, rests), separable=False,
    )  # fmt: skip
    return _separate_scale(unknown, force) if attitudes >= UNKNOWNS else unknown


def _separate_scale(unknown: AccelerometerCalibration, force: Floats) -> AccelerometerCalibration:
    """The same with scale and bias by the sphere through `force` (n, 3) m/s^2, if it is known well enough."""
    g = GRAVITY_M_S2

    def off_the_sphere(x: Floats) -> Floats:
        return np.asarray(np.linalg.norm(force - x[:3], axis=1) - x[3] * g)

    found = least_squares(off_the_sphere, np.append(force.mean(axis=0), 1.0))
    direction = (force - found.x[:3]) / np.linalg.norm(force - found.x[:3], axis=1, keepdims=True)
    jacobian = np.column_stack([-direction, np.full(len(force), -g)])
    if np.linalg.cond(jacobian) > MAX_CONDITION:
        return unknown
    sigma = _sigmas(jacobian, direction, found.fun)
    if sigma[:3].max() > MAX_BIAS_SIGMA_M_S2:
        return unknown
    scale_sigma = float(np.hypot(sigma[3], GRAVITY_SIGMA_M_S2 / g))
    return replace(
        unknown, scale=float(found.x[3]), scale_sigma=scale_sigma, bias=found.x[:3], bias_sigma=sigma[:3],
        separable=True,
    )  # fmt: skip


def _sigmas(jacobian: Floats, direction: Floats, residual: Floats) -> Floats:
    """Standard deviations of bias and scale (4,); grown where the residuals are larger than the model has them."""
    covariance = (AXES_SIGMA * GRAVITY_M_S2 * (direction @ direction.T)) ** 2 + FORCE_SIGMA_M_S2**2 * np.eye(
        len(direction)
    )
    inverse = np.linalg.pinv(jacobian)
    off = np.eye(len(direction)) - jacobian @ inverse
    expected = np.trace(off @ covariance)
    growth = max(1.0, float(residual @ residual / expected)) if len(direction) > UNKNOWNS else 1.0
    return np.asarray(np.sqrt(growth * np.diag(inverse @ covariance @ inverse.T)))


def _attitudes(force: Floats, apart_rad: float) -> int:
    """Count the attitudes of forces (n, 3)."""
    distinct: list[Floats] = []
    for direction in force / np.linalg.norm(force, axis=1, keepdims=True):
        if all(other @ direction < np.cos(apart_rad) for other in distinct):
            distinct.append(direction)
    return len(distinct)


def _seconds(recording: Recording, rests: Sequence[Rest]) -> float:
    return float(sum(rest.stop - rest.start for rest in rests) * recording.period_s)


BLOCK_S = 1.0  # Long enough to average noise, short enough to notice a touch.
QUIETEST_PERCENT = 10.0  # The noise is that of the quietest blocks: so many of a hundred are at rest, or nothing is.
MAX_SCATTER = 1.5  # Of a block over the noise; that of a hundred samples is off by 7 per cent, and blocks are many.
MAX_GYR_DEG_S, MAX_ACC_M_S2 = 2.0, 0.5  # Largest scatter of a resting sensor: noisier ones are not made, but feet are.

GYR_STEP_DEG_S, ACC_STEP_M_S2 = 0.2, 0.03
"""By how much the means may change from block to block, besides noise: a finger's touch; 0.2 deg of tilt."""

STEP_SIGMAS = 6.0  # Noise of a block's mean that is allowed on top, for an hour of blocks.

MIN_S = 30.0
"""Averages of a second are then seen thirty times, which shows N to some per cent, and as a rule nothing else."""


@dataclass(frozen=True)
class SensorNoise:
    """Allan deviation of a sensor (`gyr`, `acc` or `mag`), one curve and fit an axis; its rate in Hz."""

    sensor: str
    rate_hz: float
    curves: tuple[AllanCurve, ...]
    fits: tuple[NoiseFit, ...]


@dataclass(frozen=True)
class RecordingNoise:
    """Noise of the sensors of a recording, seen from `start_s` for `seconds`, on the recording's clock."""

    start_s: float
    seconds: float
    sensors: tuple[SensorNoise, ...]


def measure_recording_noise(recording: Recording) -> RecordingNoise:
    """Allan deviations over the longest stretch at rest.

    Raises `CalibrationError` if the sensor does not lie still, or not for long enough.
    """
    start, stop = find_longest_stillness(recording)
    seconds = (stop - start) * recording.period_s
    if seconds < MIN_S * (1 - 1e-3):
        raise CalibrationError(
            f"the sensor lies still for {seconds:.0f} s at most, which is too short for an Allan deviation: record it "
            f"lying untouched, for {MIN_S:.0f} s at least and for hours to see its bias instability."
        )
    rest = recording.slice(start, stop)
    sensors = [_sensor(name, t, readings) for name, t, readings in _readings(rest)]
    return RecordingNoise(float(rest.t[0]), seconds, tuple(sensors))


def find_longest_stillness(recording: Recording) -> tuple[int, int]:
    """Find the samples `start <= i < stop` of the longest stretch at rest; none, 0 and 0, where nothing rests."""
    block = max(2, round(BLOCK_S / recording.period_s))
    count = len(recording) // block
    if not count:
        return 0, 0
    quiet, together = np.ones(count, dtype=bool), np.ones(max(0, count - 1), dtype=bool)
    for samples, most, step in (
        (recording.gyr, np.radians(MAX_GYR_DEG_S), np.radians(GYR_STEP_DEG_S)),
        (recording.acc, MAX_ACC_M_S2, ACC_STEP_M_S2),
    ):
        here, joined = _still(samples[: count * block].reshape(count, block, 3), most, step)
        quiet &= here
        together &= joined
    return _longest(quiet, together, block)


def _still(blocks: Floats, most: float, step: float) -> tuple[Bools, Bools]:
    """Which blocks (B, n, 3) are quiet (B,), and which are together with the next (B - 1,)."""
    scatter, mean = blocks.std(axis=1), blocks.mean(axis=1)
    noise = np.percentile(scatter, QUIETEST_PERCENT, axis=0)
    limit = np.minimum(most, MAX_SCATTER * noise + 1e-12)
    allowed = step + STEP_SIGMAS * np.sqrt(2 / blocks.shape[1]) * noise
    return (scatter <= limit).all(axis=1), (np.abs(np.diff(mean, axis=0)) < allowed).all(axis=1)


def _longest(quiet: Bools, together: Bools, block: int) -> tuple[int, int]:
    """Samples of the longest run of quiet blocks that are together."""
    if not quiet.any():
        return 0, 0
    first, last = find_runs(quiet[1:] & quiet[:-1] & together)
    if not len(first):
        return 0, block
    longest = int(np.argmax(last - first))
    return int(first[longest]) * block, (int(last[longest]) + 1) * block


def _readings(rest: Recording) -> Iterator[tuple[str, Floats, Floats]]:
    """Name, stamps and readings of each sensor, in rows where it has a sample."""
    yield "gyr", rest.t, rest.gyr
    yield "acc", rest.t, rest.acc
    if rest.mag is not None:
        fresh = ~np.isnan(rest.mag).any(axis=1)
        if np.count_nonzero(fresh) >= MIN_READINGS:
            yield "mag", rest.t[fresh], rest.mag[fresh]


def _sensor(name: str, t: Floats, readings: Floats) -> SensorNoise:
    even, period_s = _evenly(t, readings)
    factors = choose_averaging_factors(len(even))
    curves = tuple(compute_allan_curve(axis, period_s, factors) for axis in even.T)
    fits = tuple(fit_noise(curve) for curve in curves)
    return SensorNoise(name, 1 / period_s, curves, fits)


def _evenly(t: Floats, readings: Floats) -> tuple[Floats, float]:
    """Readings with a row for every sample that should be there, and the time between two."""
    place = np.concatenate([[0], np.cumsum(np.maximum(1, np.round(np.diff(t) / np.median(np.diff(t)))))])
    period_s = float((t[-1] - t[0]) / place[-1])
    if place[-1] == len(t) - 1:
        return readings, period_s
    every = np.arange(int(place[-1]) + 1)
    return np.column_stack([np.interp(every, place, axis) for axis in readings.T]), period_s
