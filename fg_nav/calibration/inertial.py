"""Gyroscope and accelerometer: bias and scale of a sensor from its rests, and a large error from a walk's strides.

    gyr = omega + b_g          at rest omega = 0 (the Earth's 15 deg/h remain in b_g, and so does the g-sensitivity)
    acc = s f + b_a            at rest ||f|| = g

Rests in several attitudes lie on a sphere with radius s g about b_a, found by least squares; the attitudes must
surround the center for that: six faces do, a foot's do not. One scale stands for three axes. With E the deviation of
scales and axes from it, each entry of sd e, a rest in the direction n_i is g n_i' E n_i off the sphere. So rests are
correlated, e^2 g^2 (n_i . n_j)^2, and the covariance has it.

Between recordings the gyroscope's bias changes, by a hundredth to some tenths of a deg/s. With b_k +- s_k an axis of
recording k

    b_k = mu + e_k + n_k,     e_k ~ N(0, tau^2),   n_k ~ N(0, s_k^2),

a random-effects model: tau is averaged over levels by the evidence left when mu is integrated out (DerSimonian and
Laird 1986; Gelman et al. 2013, section 5.4), common to the axes. A recording far off has a low weight: e_k is a mixture
with a sensor that has changed (`CHANGED_SHARE`). The next recording is then expected at mu, within the sigma of mu and
tau together. One recording is the case of n = 1, in which tau is that of the levels' prior.

Strides. One that begins and ends in a stance, its force rotated by the gyroscope into the axes of its start, has a mean
m, as a rest has. With M = 1/T int R_start^T R dt (I of a rest),

    ||m|| - g = n' M b_a + (s - 1) g + c,   n = m / ||m||

where c is common to all strides, of a foot that is not quite still in its stances. The norm is one number for each
attitude, linear in b_a and s; the attitudes, by rotation, and data sheets separate the two: an error of the zero is ten
times as large as one of the scale. Two priors, of a calibrated sensor and of another, are averaged by their evidence;
an error within the first is left to the estimators.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

from fg_nav.arrays import Floats, weigh_models
from fg_nav.detection import Rest, RestParameters, find_rests
from fg_nav.detection.mount import LOOKED_S, find_stance_strides
from fg_nav.detection.rest import MIN_SIGMA_DEG_S, find_still_stretches
from fg_nav.detection.stance import Stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import integrate_strides
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.text import format_count

UNKNOWNS = 4  # Scale and bias of the accelerometer, and the attitudes needed for them.
MAX_CONDITION = 1e3  # Of the sphere's equations: beyond it the attitudes lie in a plane, but for noise.
GRAVITY_SIGMA_M_S2 = 0.013  # Of gravity at an unknown place: 9.780 on the equator, 9.832 on the poles.
AXES_SIGMA = 0.003  # e, of scales and axes of a consumer part (cross-axis errors of `mpu-9250` in the simulator).
FORCE_SIGMA_M_S2 = 0.01  # Of the mean force of a rest: 1 mg, for a hand's or a table's tremor and drift of the bias.
SAME_ATTITUDE_DEG = 20.0  # Attitudes closer than this are one: a sphere does not show in a cap of it.
MIN_ATTITUDE_S = 2.0  # Of a rest in a new attitude: g-sensitivity hides its bias, so a slow stance could pass for one.
MAX_BIAS_SIGMA_M_S2 = 0.05  # Of a bias that is removed (5 mg, the size of a common one).
CHANGES_DEG_S = (0.02, 0.06, 0.2, 0.6)  # tau: from a sensor kept warm to one of the 1990s; 0.06 is typical of MEMS.
CHANGE_PRIOR = (0.3, 0.4, 0.2, 0.1)  # Of these levels, before the recordings.
ALONE = (("smoother.gyro_bias_sigma_deg_s", 1.0),)  # `Options.changes` by which a walk estimates its bias alone.
CHANGED_SHARE, CHANGED_DEG_S = 0.05, 1.0  # One recording in twenty is of a sensor that was hit, heated or exchanged.
ROUNDS = 20  # Of the weights of such recordings.
BIAS_M_S2, SCALE_SIGMA = (0.02, 0.4), (0.003, 0.01)  # Zero-g offset and sensitivity, one sigma: factory, and sheets.
PRIOR = (0.9, 0.1)  # Of these two sensors, before the walk.
REST_M_S2, STRIDE_M_S, COMMON_M_S2 = 0.025, 0.15, 0.1  # Of ||f|| at a rest, of a stride's velocity, and c.
MAX_READINGS = 40  # Strides, and rests, evenly over the recording.


class BiasPrior(TypedDict):
    """Prior of a calibrated bias, as parameters of the smoother (`SmootherParameters`)."""

    gyro_bias_deg_s: tuple[float, float, float]
    gyro_bias_sigma_deg_s: float


@dataclass(frozen=True)
class GyroscopeCalibration:
    """Bias of a gyroscope, and its prediction for the next recording."""

    bias: Floats  # (3,) rad/s, of this recording, or the mean of several.
    sigma: Floats  # (3,) rad/s.
    next_sigma: float  # rad/s an axis, of the bias of another recording about it: with the change between recordings.
    recordings: int  # Number of recordings, and of their rests.
    rests: int
    seconds: float  # Duration of the rests.

    @property
    def prior(self) -> BiasPrior:
        """Prior of another recording's bias, rounded."""
        x, y, z = np.round(np.degrees(self.bias), 4).tolist()
        return {"gyro_bias_deg_s": (x, y, z), "gyro_bias_sigma_deg_s": round(float(np.degrees(self.next_sigma)), 4)}

    def apply_to(self, recording: Recording) -> Recording:
        """Return the recording with the bias removed from its rates."""
        return replace(recording, gyr=recording.gyr - self.bias)


@dataclass(frozen=True)
class AccelerometerCalibration:
    """Scale and bias of an accelerometer, or the ratio of its reading to gravity."""

    scale: float  # s; where scale and bias are not separable ||acc|| / g, which includes the bias.
    scale_sigma: float  # Infinite where not separable.
    bias: Floats  # b_a (3,) m/s^2; zero where not separable.
    bias_sigma: Floats  # (3,) m/s^2; infinite where not separable.
    norm_m_s2: float  # Mean of ||acc|| over all rests, by their length.
    attitudes: int
    seconds: float  # Duration of the rests.
    separable: bool  # Whether the attitudes separate scale from bias.

    def correct(self, acc: Floats) -> Floats:
        """Return specific forces (n, 3) m/s^2 without bias and scale; unchanged where not separable."""
        return np.asarray((acc - self.bias) / self.scale) if self.separable else acc

    def apply_to(self, recording: Recording) -> Recording:
        """Return the recording without bias and scale; raises `CalibrationError` if they are not separable."""
        if not self.separable:
            raise CalibrationError(
                f"rests in {format_count(self.attitudes, 'attitude')} do not tell the accelerometer's scale "
                f"from its bias: let it lie for {MIN_ATTITUDE_S:g} s on each of its six faces."
            )
        return replace(recording, acc=self.correct(recording.acc))


def calibrate_gyroscope(recording: Recording) -> GyroscopeCalibration | None:
    """Bias from all rests of a recording, weighted by their information; None where nothing rests."""
    rests = find_rests(recording)
    if not rests:
        return None
    rate, sigma = np.array([rest.rate for rest in rests]), np.array([rest.sigma for rest in rests])
    bias = (sigma**-2 * rate).sum(axis=0) / (sigma**-2).sum(axis=0)
    disagreement = (((rate - bias) / sigma) ** 2).sum(axis=0) / max(1, len(rests) - 1)
    spread = np.sqrt(np.maximum(disagreement, 1.0) / (sigma**-2).sum(axis=0))
    sigma = np.maximum(spread, np.radians(MIN_SIGMA_DEG_S))
    next_sigma = average_biases(bias[None], sigma[None])[2]
    return GyroscopeCalibration(bias, sigma, next_sigma, 1, len(rests), _sum_seconds(recording, rests))


def read_walk_bias(solution: Solution) -> GyroscopeCalibration:
    """Bias of a walk that was solved under a wide prior (`ALONE`), so that other walks do not count twice.

    Within a walk the bias and its error are nearly constant: mean and root mean square over the footfalls.
    """
    table = solution.stances
    bias, sigma = table.gyro_bias.mean(axis=0), np.asarray(np.sqrt(np.mean(table.gyro_bias_sigma**2, axis=0)))
    return GyroscopeCalibration(bias, sigma, average_biases(bias[None], sigma[None])[2], 1, 0, 0.0)


def average_gyroscopes(found: Sequence[GyroscopeCalibration]) -> GyroscopeCalibration:
    """Mean of one sensor's bias over its recordings, and the sigma of the next one about it."""
    biases, sigmas = (np.array([getattr(one, name) for one in found]) for name in ("bias", "sigma"))
    bias, sigma, next_sigma = average_biases(biases, sigmas)
    rests, seconds = sum(one.rests for one in found), sum(one.seconds for one in found)
    return GyroscopeCalibration(bias, sigma, next_sigma, sum(one.recordings for one in found), rests, seconds)


def average_biases(biases: Floats, sigmas: Floats) -> tuple[Floats, Floats, float]:
    """Mean (3,) of biases (n, 3) of n recordings, its sigma (3,), and the predictive sigma of the next one's bias.

    `sigmas` (n, 3) are those of each bias; the predictive sigma is the rms over the axes, and includes the change from
    one recording to the next. All in rad/s.
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
        levels.append((change, mean, 1.0 / information, log_sum.sum() - 0.5 * np.log(information).sum()))
    changes, means, variances, log_evidence = (np.array(one) for one in zip(*levels, strict=True))
    weight = weigh_models(log_evidence, np.array(CHANGE_PRIOR))
    mean = weight @ means
    # a scale: the geometric mean of the levels
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
    distinct: list[Floats] = []
    for direction in force / np.linalg.norm(force, axis=1, keepdims=True):
        if all(other @ direction < np.cos(np.radians(SAME_ATTITUDE_DEG)) for other in distinct):
            distinct.append(direction)
    norm = float(np.average(np.linalg.norm(force, axis=1), weights=samples))
    unknown = AccelerometerCalibration(
        scale=norm / GRAVITY_M_S2, scale_sigma=np.inf, bias=np.zeros(3), bias_sigma=np.full(3, np.inf),
        norm_m_s2=norm, attitudes=len(distinct), seconds=_sum_seconds(recording, rests), separable=False,
    )  # fmt: skip
    return _separate_scale(unknown, force) if len(distinct) >= UNKNOWNS else unknown


def _separate_scale(unknown: AccelerometerCalibration, force: Floats) -> AccelerometerCalibration:
    """Return scale and bias by the sphere through resting `force` (n, 3) m/s^2; `unknown` if too uncertain."""
    from scipy.optimize import least_squares  # slow to load, and a walk has no use for it

    g = GRAVITY_M_S2

    def miss_sphere(x: Floats) -> Floats:
        return np.asarray(np.linalg.norm(force - x[:3], axis=1) - x[3] * g)

    found = least_squares(miss_sphere, np.append(force.mean(axis=0), 1.0))
    direction = (force - found.x[:3]) / np.linalg.norm(force - found.x[:3], axis=1, keepdims=True)
    jacobian = np.column_stack([-direction, np.full(len(force), -g)])
    if np.linalg.cond(jacobian) > MAX_CONDITION:
        return unknown
    # sigmas, larger where the residuals are larger than the model's
    covariance = (AXES_SIGMA * g * (direction @ direction.T)) ** 2 + FORCE_SIGMA_M_S2**2 * np.eye(len(force))
    inverse = np.linalg.pinv(jacobian)
    expected = np.trace((np.eye(len(force)) - jacobian @ inverse) @ covariance)
    growth = max(1.0, float(found.fun @ found.fun / expected)) if len(force) > UNKNOWNS else 1.0
    sigma = np.sqrt(growth * np.diag(inverse @ covariance @ inverse.T))
    if sigma[:3].max() > MAX_BIAS_SIGMA_M_S2:
        return unknown
    scale_sigma = float(np.hypot(sigma[3], GRAVITY_SIGMA_M_S2 / g))
    return replace(
        unknown, scale=float(found.x[3]), scale_sigma=scale_sigma, bias=found.x[:3], bias_sigma=sigma[:3],
        separable=True,
    )  # fmt: skip


def _sum_seconds(recording: Recording, rests: Sequence[Rest]) -> float:
    return float(sum(rest.stop - rest.start for rest in rests) * recording.period_s)


def average_out_error(recording: Recording, stances: Stances) -> Recording:
    """Remove a bias, and scale error, beyond the priors of a calibrated sensor, with a remark in the provenance."""
    size, by_bias, covariance = _read_sizes(recording, stances)
    if not len(size):
        return recording
    jacobian = np.column_stack([by_bias, np.full(len(size), GRAVITY_M_S2)])
    found, log_evidence = [], []
    for bias_sigma, scale_sigma in zip(BIAS_M_S2, SCALE_SIGMA, strict=True):
        prior = np.diag([bias_sigma**2] * 3 + [scale_sigma**2])
        expected = covariance + jacobian @ prior @ jacobian.T
        weighted = np.linalg.solve(expected, size)
        found.append(prior @ jacobian.T @ weighted)
        log_evidence.append(-0.5 * (size @ weighted + np.linalg.slogdet(expected)[1]))
    uncalibrated = weigh_models(np.array(log_evidence), np.array(PRIOR))[1]
    bias, scale = uncalibrated * found[1][:3], 1.0 + float(uncalibrated * found[1][3])
    if np.linalg.norm(bias) < BIAS_M_S2[0]:
        return recording
    axes = ", ".join(f"{one:.2f}" for one in bias)
    note = f"an accelerometer bias of {axes} m/s^2 and a scale of {scale:.3f} are taken off, as the walk shows them"
    provenance = replace(recording.provenance, notes=(*recording.provenance.notes, note))
    return replace(recording, acc=(recording.acc - bias) / scale, provenance=provenance)


def _read_sizes(recording: Recording, stances: Stances) -> tuple[Floats, Floats, Floats]:
    """Residuals ||f|| - g (K,) m/s^2 of rests and strides, their Jacobian (K, 3) by the bias, and covariance (K, K)."""
    # rests
    rests = find_rests(recording)
    rests = rests[:: -(-len(rests) // MAX_READINGS)] if rests else ()
    force = np.array([rest.force for rest in rests]).reshape(-1, 3)
    turned = np.tile(np.eye(3), (len(rests), 1, 1))
    sigma, common = np.full(len(rests), REST_M_S2), np.zeros(len(rests))
    # strides in which no sensor was clipped
    start, stop = find_stance_strides(recording, stances)
    cut = np.cumsum(np.any([(peaks.run > 0).any(axis=1) for peaks in recording.peaks], axis=0))
    kept = np.flatnonzero(cut[stop] == cut[start])
    kept = kept[:: max(1, -(-len(kept) // MAX_READINGS))]
    start, stop = start[kept], stop[kept]
    n = int(np.searchsorted(recording.t, recording.t[0] + LOOKED_S))
    t, acc, gyr = recording.t[:n], recording.acc[:n], recording.gyr[:n]
    h = np.append(np.diff(t), recording.period_s)
    rate = np.tile(np.mean([rest.rate for rest in rests], axis=0) if rests else np.zeros(3), (len(kept), 1))
    lasts = (t[stop] - t[start])[:, None]
    # means of the force, and of constant vectors of the body, in the frame of each stride's start
    averages = []
    for samples in (acc, *(np.ascontiguousarray(np.broadcast_to(one, gyr.shape)) for one in np.eye(3))):
        attitude = np.tile(np.eye(3), (len(kept), 1, 1))
        averages.append(integrate_strides(samples, gyr, h, start, stop, attitude, rate, 0.0) / lasts)
    force, columns = np.vstack([force, averages[0]]), averages[1:]
    turned = np.concatenate([turned, np.stack(columns, axis=2)])
    # Student weights: a stride in which the foot did not stand counts less
    size = np.linalg.norm(force, axis=1) - GRAVITY_M_S2
    stride = STRIDE_M_S / lasts[:, 0]
    off = (size[len(rests) :] - (np.median(size[len(rests) :]) if len(kept) else 0.0)) / stride
    sigma, common = np.append(sigma, stride * np.sqrt(1.0 + off**2 / 4)), np.append(common, np.ones(len(kept)))
    by_bias = np.einsum("ki,kij->kj", force / np.linalg.norm(force, axis=1, keepdims=True), turned)
    return size, by_bias, np.diag(sigma**2) + COMMON_M_S2**2 * np.outer(common, common)
