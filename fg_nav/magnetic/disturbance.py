"""Where the field of a recording is disturbed, sample by sample: for a sensor that never stands, as in a pocket.

MD (16) is gated by a detector of the paper's reference 26, which was not available. What follows is ours, on
the one signal that an unknown attitude leaves: the strength |B|.

Over a window that ends at the sample, of n samples of |B| with standard deviation sigma,

    T = sum (|B| - mean)^2 / sigma^2      is chi squared with n - 1 degrees of freedom in a field that is still.

The rate d|B|/dt alone vanishes where the strength is greatest, in the midst of a disturbance; the scatter does not.
If the strength changes evenly by the least change that matters across the window, T is noncentral with

    lambda = (matters / sigma)^2 sum_j (j/(n - 1) - 1/2)^2 = (matters / sigma)^2 n (n + 1) / (12 (n - 1)),

and the threshold is its quantile at the false-alarm rate: the share of such changes that pass. A field that turns and
keeps its strength is not seen, and a magnetometer that is not calibrated is disturbed by its own turning.

A magnetometer slower than the recording leaves NaN rows; only what it measured is counted. At the beginning, and after
a gap, the window is shorter than it should be, and is judged as if all of a change had to happen in what is there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.special import chdtr, chndtrix

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import MagneticError
from fg_nav.magnetic.quasi_static import OverThreshold
from fg_nav.recording import Recording

FEWEST = 3  # Samples of the field in a window; with fewer it is not judged.


WINDOW_S = 1.0  # s; a walker passes a lamp or a car in one to three seconds.

SIGMA_UT = 0.15
"""uT, of one sample of |B|: noise and the residual of a calibration as the sensor turns. The simulated MTw has 0.11 uT
of the one; a percent of soft iron would be 0.3 uT of the other, and has to be allowed for here."""

MATTERS_UT = 0.5
"""uT, least change over the window that is to be rejected; 0.5 uT across a field of 48 uT turns it by half a degree."""

FALSE_ALARM_RATE = 0.05  # Share of such changes that pass all the same.

SETTINGS: Mapping[str, float] = MappingProxyType(
    {
        "window_s": WINDOW_S,
        "sigma_uT": SIGMA_UT,
        "matters_uT": MATTERS_UT,
        "false_alarm_rate": FALSE_ALARM_RATE,
    }
)
"""These four for a file of results."""


def find_threshold(count: int) -> float:
    """Threshold of the statistic with so many samples in the window."""
    noncentrality = (MATTERS_UT / SIGMA_UT) ** 2 * count * (count + 1) / (12 * (count - 1))
    return float(chndtrix(FALSE_ALARM_RATE, count - 1, noncentrality))


def compute_detection_rate(count: int) -> float:
    """P_D, the share of still fields that pass, with so many samples in the window."""
    return float(chdtr(count - 1, find_threshold(count)))


@dataclass(frozen=True)
class Disturbance(OverThreshold):
    """Verdicts on each of N samples.

    Attributes
    ----------
    statistic : (N,) over its threshold: below 1 the field passes; NaN where there was too little to judge by.
    """

    statistic: Floats


def judge_samples(recording: Recording) -> Disturbance:
    """Judge the field at each sample by the window that ends there.

    Raises
    ------
    MagneticError
        Without a magnetometer, or if no window has enough samples of the field.
    """
    if recording.mag is None:
        raise MagneticError("the recording has no magnetometer, so nothing is known of the field: record with one.")
    scatter, count = _compute_scatter(recording.t, np.linalg.norm(recording.mag, axis=1))
    if not (count >= FEWEST).any():
        raise MagneticError(f"no {WINDOW_S:g} s of the recording have {FEWEST} samples of the field: record it faster.")
    threshold = np.full(count.max() + 1, np.nan)
    for n in np.unique(count[count >= FEWEST]):
        threshold[n] = find_threshold(int(n))
    return Disturbance(scatter / SIGMA_UT**2 / threshold[count])


def _compute_scatter(t: Floats, strength: Floats) -> tuple[Floats, Ints]:
    """Sum of squares about the mean (N,) uT^2 of the window that ends at each sample, and its samples (N,)."""
    fresh = np.isfinite(strength)
    value = np.where(fresh, strength - (np.median(strength[fresh]) if fresh.any() else 0.0), 0.0)
    count, total, squares = (_sum_windows(x, t) for x in (fresh.astype(np.float64), value, value**2))
    scatter = squares - total**2 / np.maximum(count, 1.0)
    return np.maximum(scatter, 0.0), np.rint(count).astype(np.int64)


def _sum_windows(x: Floats, t: Floats) -> Floats:
    """Sum over the samples later than `WINDOW_S` before each, itself included."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    return np.asarray(total[1:] - total[np.searchsorted(t, t - WINDOW_S, side="right")])
