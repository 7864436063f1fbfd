"""Samples that are doubted for themselves, on top of the noise of all.

One at the end of the sensor's range hides a part of its peak, and one before a gap stands for motion that nobody saw:
of that it has the sigma with which the gap was bridged (`fg_nav.gaps`), times the share of the period that it fills.
The doubt is a standard deviation in the units of the sample, constant over the sample's own period h, and taken axis by
axis: a foot clips its pitch rate, and its heading need not suffer.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.recording import Recording
from fg_nav.saturation import saturated


def doubts(recording: Recording, saturated_share: float) -> tuple[Floats, Floats]:
    """Find the standard deviations (N, 3) of single samples on top of the densities: zero for most.

    Parameters
    ----------
    recording
        With N samples.
    saturated_share
        What a clipped peak may hide, as a share of the sample.

    Returns
    -------
    tuple
        Of specific forces, m/s^2, and of rates, rad/s.
    """
    gaps = recording.gaps
    held_s = recording.t[gaps.sample + 1] - recording.t[gaps.sample]
    share = (gaps.unseen_s / held_s)[:, None]
    found = []
    for samples, unseen in ((recording.acc, gaps.acc_sigma), (recording.gyr, gaps.gyr_sigma)):
        doubt = saturated_share * np.abs(samples) * saturated(samples)
        doubt[gaps.sample] = np.hypot(doubt[gaps.sample], share * unseen)
        found.append(doubt)
    return found[0], found[1]
