"""The extra standard deviation of single samples, on top of the noise of all.

A sample at the end of the sensor's range is part of a peak that was rebuilt, with the sigma of that
(`fg_nav.samples.saturation`), and the peak may hide a share of the range besides. A sample before a gap stands for
motion that was not observed, with the sigma of `fg_nav.samples.gaps` times the share of the period that the gap fills,
and one that was bad of one sensor has that of `fg_nav.samples.gaps`. All are in the units of the sample, constant
over the sample's own period h, and axis by axis: a foot clips its pitch rate, and its heading need not suffer.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.recording import Recording


def find_extra_sigmas(recording: Recording, saturated_share: float) -> tuple[Floats, Floats]:
    """Return extra sigmas of single samples on top of the noise densities, (N, 3) m/s^2 and (N, 3) rad/s; mostly zero.

    `saturated_share` is the sigma of a clipped peak beyond its reconstruction, as a share of the range; 0 for
    no extra sigma of peaks. The arrays are not to be written to.
    """
    gaps = recording.gaps
    held_s = recording.t[gaps.sample + 1] - recording.t[gaps.sample]
    share = (gaps.unseen_s / held_s)[:, None]
    found = []
    sensors = (recording.acc, gaps.acc_sigma), (recording.gyr, gaps.gyr_sigma)
    for (samples, unseen), peaks, bridge in zip(sensors, recording.peaks, recording.bridges, strict=True):
        cut = np.flatnonzero(peaks.run.any(axis=1)) if saturated_share > 0 else gaps.sample[:0]
        if not (len(cut) or len(gaps.sample) or len(bridge.sample)):
            found.append(np.broadcast_to(0.0, samples.shape))
            continue
        sigma = np.zeros(samples.shape)
        hidden = saturated_share * np.abs(samples[cut]) * np.sqrt(peaks.run[cut])
        sigma[cut] = np.hypot(peaks.sigma[cut], hidden)
        sigma[gaps.sample] = np.hypot(sigma[gaps.sample], share * unseen)
        sigma[bridge.sample] = np.hypot(sigma[bridge.sample], bridge.sigma)
        found.append(sigma)
    return found[0], found[1]
