"""Where the field of a recording is disturbed, sample by sample: for a sensor that never stands, as in a pocket.

Munoz Diaz (2017) gates the differential magnetic field update by a detector that she takes from her reference 26, which
was not to be had. What follows is ours, on the one signal that an unknown attitude leaves: the strength |B|.

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

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, ncx2

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import MagneticError
from fg_nav.magnetic.verdicts import OverThreshold
from fg_nav.recording import Recording

FEWEST = 3
"""Samples of the field in a window without which it is not judged."""


@dataclass(frozen=True)
class DisturbanceParameters:
    """What is taken for a disturbance.

    Attributes
    ----------
    window_s : s, the time looked back on; a walker passes a lamp or a car in one to three seconds.
    sigma_uT : of one sample of |B|; noise and what a calibration leaves as the sensor turns. The simulated MTw has
        0.11 uT of the one; a percent of soft iron would be 0.3 uT of the other, and has to be allowed for here.
    matters_uT : least change over the window that is to be rejected; 0.5 uT across the field turns it by half a degree
        in 48 uT.
    false_alarm_rate : share of such changes that pass all the same.
    """

    window_s: float = 1.0
    sigma_uT: float = 0.15
    matters_uT: float = 0.5
    false_alarm_rate: float = 0.05

    def __post_init__(self) -> None:
        for name in ("window_s", "sigma_uT", "matters_uT"):
            value = getattr(self, name)
            if not value > 0.0 or not np.isfinite(value):
                raise MagneticError(f"{name} of the disturbance detector must be positive, not {value}.")
        if not 0.0 < self.false_alarm_rate < 1.0:
            raise MagneticError(f"a false-alarm rate must be between 0 and 1, not {self.false_alarm_rate}.")

    def threshold(self, count: int) -> float:
        """Of the statistic, with so many samples in the window."""
        noncentrality = (self.matters_uT / self.sigma_uT) ** 2 * count * (count + 1) / (12 * (count - 1))
        return float(ncx2.ppf(self.false_alarm_rate, count - 1, noncentrality))

    def detection_rate(self, count: int) -> float:
        """P_D, the share of still fields that pass, with so many samples in the window."""
        return float(chi2.cdf(self.threshold(count), count - 1))


@dataclass(frozen=True)
class Disturbance(OverThreshold):
    """Verdicts on each of N samples.

    Attributes
    ----------
    statistic : (N,) over its threshold: below 1 the field passes; NaN where there was too little to judge by.
    """

    statistic: Floats


def judge_samples(recording: Recording, parameters: DisturbanceParameters = DisturbanceParameters()) -> Disturbance:
    """Judge the field at each sample by the window that ends there.

    Raises
    ------
    MagneticError
        Without a magnetometer, or if no window has enough samples of the field.
    """
    if recording.mag is None:
        raise MagneticError("the recording has no magnetometer, so nothing is known of the field: record with one.")
    scatter, count = _scatter(recording.t, np.linalg.norm(recording.mag, axis=1), parameters.window_s)
    if not (count >= FEWEST).any():
        raise MagneticError(
            f"no {parameters.window_s:g} s of the recording have {FEWEST} samples of the field: make the window longer."
        )
    threshold = np.full(count.max() + 1, np.nan)
    for n in np.unique(count[count >= FEWEST]):
        threshold[n] = parameters.threshold(int(n))
    return Disturbance(scatter / parameters.sigma_uT**2 / threshold[count])


def _scatter(t: Floats, strength: Floats, window_s: float) -> tuple[Floats, Ints]:
    """Sum of squares about the mean (N,) uT^2 of the window that ends at each sample, and its samples (N,)."""
    fresh = np.isfinite(strength)
    value = np.where(fresh, strength - (np.median(strength[fresh]) if fresh.any() else 0.0), 0.0)
    count, total, squares = (_sums(x, t, window_s) for x in (fresh.astype(np.float64), value, value**2))
    scatter = squares - total**2 / np.maximum(count, 1.0)
    return np.maximum(scatter, 0.0), np.rint(count).astype(np.int64)


def _sums(x: Floats, t: Floats, window_s: float) -> Floats:
    """Sum over the samples later than `window_s` before each, itself included."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    return np.asarray(total[1:] - total[np.searchsorted(t, t - window_s, side="right")])
