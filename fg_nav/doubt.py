"""Samples that are doubted for themselves, on top of the noise of all.

One at the end of the sensor's range hides a part of its peak, and one before a gap stands for motion that nobody saw.
The doubt is a standard deviation in the units of the sample, constant over the sample's own period h, and taken axis by
axis: a foot clips its pitch rate, and its heading need not suffer.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.recording import GAP_PERIODS
from fg_nav.saturation import saturated


def doubt(samples: Floats, h: Floats, saturated_share: float) -> Floats:
    """Find the standard deviation (N, 3) of single samples on top of the densities: zero for most.

    Parameters
    ----------
    samples
        (N, 3) of one sensor, any unit.
    h
        (N,) s, the periods for which they are held.
    saturated_share
        What a clipped peak may hide, as a share of the sample.
    """
    period = float(np.median(h))
    clipped = saturated_share * np.abs(samples) * saturated(samples)
    unseen = np.where(h > GAP_PERIODS * period, 1.0 - period / h, 0.0)
    return np.asarray(np.hypot(clipped, unseen[:, None] * samples.std(axis=0)))
