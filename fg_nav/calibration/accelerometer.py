"""A large error of the accelerometer, as rests and strides of a walk show it.

A rest reads a force m, and a stride that begins and ends in a stance, its force turned by the gyroscope into the axes
of its start, has a mean m. With acc = s f + b, and M = 1/T int R_start^T R dt of a stride (I of a rest),

    ||m|| - g = n' M b + (s - 1) g + c,   n = m / ||m||

c is what all strides have in common, of a foot that is not quite still in its stances. So the size is one number for
each attitude, linear in b and s, and who is to have it the attitudes say, by the turning, and sheets: an error of the
zero is ten times as large as one of the scale. Two priors, of a sensor that was calibrated and of one that was not, are
averaged by their evidence; what the first explains is left to the estimators.

Rests in several attitudes, of a sensor that is turned over on purpose, show more (`fg_nav.calibration.at_rest`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection import find_rests
from fg_nav.detection.handedness import LOOKED_S, find_stance_strides
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import integrate_strides
from fg_nav.recording import Recording
from fg_nav.stances import Stances

BIAS_M_S2, SCALE_SIGMA = (0.02, 0.4), (0.003, 0.01)  # Zero-g offset and sensitivity, one sigma: factory, and sheets.
PRIOR = (0.9, 0.1)  # Of these two sensors, before the walk.
REST_M_S2, STRIDE_M_S, COMMON_M_S2 = 0.025, 0.15, 0.1  # Of ||f|| at a rest, of a stride's velocity, and c.
MAX_READINGS = 40  # Strides and rests that are looked at of each, evenly over the recording: more tell no more.


def average_out_error(recording: Recording, stances: Stances) -> Recording:
    """Take off what a walk shows of a large bias, and of the scale; a remark in its provenance says how much.

    The same recording where that is within what every estimator assumes of a calibrated sensor.
    """
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
    uncalibrated = 1.0 / (1.0 + PRIOR[0] / PRIOR[1] * np.exp(min(log_evidence[0] - log_evidence[1], 500.0)))
    bias, scale = uncalibrated * found[1][:3], 1.0 + float(uncalibrated * found[1][3])
    if np.linalg.norm(bias) < BIAS_M_S2[0]:
        return recording
    axes = ", ".join(f"{one:.2f}" for one in bias)
    note = f"an accelerometer bias of {axes} m/s^2 and a scale of {scale:.3f} are taken off, as the walk shows them"
    provenance = replace(recording.provenance, notes=(*recording.provenance.notes, note))
    return replace(recording, acc=(recording.acc - bias) / scale, provenance=provenance)


def _read_sizes(recording: Recording, stances: Stances) -> tuple[Floats, Floats, Floats]:
    """||f|| - g (K,) m/s^2 of rests and strides, its derivative (K, 3) by the bias, and its covariance (K, K)."""
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

    def average_turned(samples: Floats) -> Floats:
        attitude = np.tile(np.eye(3), (len(kept), 1, 1))
        return integrate_strides(samples, gyr, h, start, stop, attitude, rate, 0.0) / lasts

    force = np.vstack([force, average_turned(acc)])
    columns = [average_turned(np.ascontiguousarray(np.broadcast_to(one, gyr.shape))) for one in np.eye(3)]
    turned = np.concatenate([turned, np.stack(columns, axis=2)])
    # a stride in which the foot did not stand counts less, as of a Student distribution
    size = np.linalg.norm(force, axis=1) - GRAVITY_M_S2
    stride = STRIDE_M_S / lasts[:, 0]
    off = (size[len(rests) :] - (np.median(size[len(rests) :]) if len(kept) else 0.0)) / stride
    sigma, common = np.append(sigma, stride * np.sqrt(1.0 + off**2 / 4)), np.append(common, np.ones(len(kept)))
    by_bias = np.einsum("ki,kij->kj", force / np.linalg.norm(force, axis=1, keepdims=True), turned)
    return size, by_bias, np.diag(sigma**2) + COMMON_M_S2**2 * np.outer(common, common)
