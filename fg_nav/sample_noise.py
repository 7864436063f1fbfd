"""Samples that are doubted for themselves, on top of the noise of all.

One at the end of the sensor's range is part of a peak that was rebuilt, with the sigma of that
(`fg_nav.samples.peaks`), and the peak may hide a share of the range besides. One before a gap stands for motion that
nobody saw: of that it has the sigma with which the gap was bridged (`fg_nav.samples.gaps`), times the share of the
period that it fills. The doubt is a standard deviation in the units of the sample, constant over the sample's own
period h, and taken axis by axis: a foot clips its pitch rate, and its heading need not suffer.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.recording import Recording


def find_extra_sigmas(recording: Recording, saturated_share: float) -> tuple[Floats, Floats]:
    """Find the standard deviations (N, 3) of single samples on top of the densities: zero for most.

    Parameters
    ----------
    recording
        With N samples.
    saturated_share
        What a clipped peak may hide beyond what is rebuilt, as a share of the range, one sigma; 0 to believe it.

    Returns
    -------
    tuple
        Of specific forces, m/s^2, and of rates, rad/s.
    """
    gaps = recording.gaps
    held_s = recording.t[gaps.sample + 1] - recording.t[gaps.sample]
    share = (gaps.unseen_s / held_s)[:, None]
    found = []
    sensors = (recording.acc, gaps.acc_sigma), (recording.gyr, gaps.gyr_sigma)
    for (samples, unseen), peaks in zip(sensors, recording.peaks, strict=True):
        doubt = np.hypot(peaks.sigma, saturated_share * np.abs(samples) * np.sqrt(peaks.run)) * (saturated_share > 0)
        doubt[gaps.sample] = np.hypot(doubt[gaps.sample], share * unseen)
        found.append(doubt)
    return found[0], found[1]
