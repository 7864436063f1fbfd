"""Verdicts on the magnetic field at each sample, by the scatter of its strength.

For a sensor that never stands, as in a pocket. MD (16) is gated by a detector of the paper's reference 26,
which was not available. This one is ours, on the one signal that an unknown attitude leaves: the strength |B|. Over a
window that ends at the sample, of n samples of |B| with standard deviation sigma,

    T = sum (|B| - mean)^2 / sigma^2      is chi squared with n - 1 degrees of freedom in a static field.

The rate d|B|/dt alone vanishes where the strength is greatest, in the midst of a disturbance; the scatter does not.
If the strength changes evenly by the least change that matters across the window, T is noncentral with

    lambda = (matters / sigma)^2 sum_j (j/(n - 1) - 1/2)^2 = (matters / sigma)^2 n (n + 1) / (12 (n - 1)),

and the threshold is its quantile at the false-alarm rate: the share of such changes that pass. A field that turns and
keeps its strength is not detected, and an uncalibrated magnetometer is disturbed by its own turning. Only measured
samples count, not the NaN rows of a slow magnetometer. At the beginning, and after a gap, the window is shorter, and is
judged as if all of a change had to happen in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.special import chndtrix

from fg_nav.arrays import Floats
from fg_nav.errors import MagneticError
from fg_nav.magnetic.detectors import FALSE_ALARM_RATE, OverThreshold
from fg_nav.recording import Recording

WINDOW_S = 1.0  # Of samples: a walker passes a lamp or a car in one to three seconds.
MIN_SAMPLES = 3  # Of the field in a window that is judged.
SIGMA_UT = 0.15  # Of one sample of |B|: noise, 0.11 on the simulated MTw, and the residual of a calibration in a turn.
MATTERS_UT = 0.5  # Least change over the window to be rejected: across a field of 48 uT a turn of half a degree.
SETTINGS: Mapping[str, float] = MappingProxyType(
    {
        "window_s": WINDOW_S, "sigma_uT": SIGMA_UT, "matters_uT": MATTERS_UT, "false_alarm_rate": FALSE_ALARM_RATE,
    }
)  # fmt: skip  # For a file of results.


@dataclass(frozen=True)
class Disturbance(OverThreshold):
    """Verdicts on each of N samples."""

    statistic: Floats


def find_sample_threshold(count: int) -> float:
    """Threshold of the statistic of a sample with `count` samples in its window."""
    noncentrality = (MATTERS_UT / SIGMA_UT) ** 2 * count * (count + 1) / (12 * (count - 1))
    return float(chndtrix(FALSE_ALARM_RATE, count - 1, noncentrality))


def judge_samples(recording: Recording) -> Disturbance:
    """Judge the field at each sample by the window that ends there; NaN where that has too few of the field.

    Raises `MagneticError` without a magnetometer, or if no window has enough samples of the field.
    """
    if recording.mag is None:
        raise MagneticError("the recording has no magnetometer, so nothing is known of the field: record with one.")
    t, strength = recording.t, np.linalg.norm(recording.mag, axis=1)
    fresh = np.isfinite(strength)
    value = np.where(fresh, strength - (np.median(strength[fresh]) if fresh.any() else 0.0), 0.0)
    # sums over the window that ends at each sample
    begin = np.searchsorted(t, t - WINDOW_S, side="right")
    totals = (np.concatenate([[0.0], np.cumsum(x)]) for x in (fresh.astype(np.float64), value, value**2))
    samples, total, squares = (x[1:] - x[begin] for x in totals)
    scatter = np.maximum(squares - total**2 / np.maximum(samples, 1.0), 0.0)
    count = np.rint(samples).astype(np.int64)
    if not (count >= MIN_SAMPLES).any():
        raise MagneticError(
            f"no {WINDOW_S:g} s of the recording have {MIN_SAMPLES} samples of the field: record it faster."
        )
    threshold = np.full(count.max() + 1, np.nan)
    for n in np.unique(count[count >= MIN_SAMPLES]):
        threshold[n] = find_sample_threshold(int(n))
    return Disturbance(scatter / SIGMA_UT**2 / threshold[count])
