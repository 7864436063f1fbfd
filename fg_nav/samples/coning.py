"""The motion within a sample: coning and sculling.

A sample is the mean of rate w and specific force f over its period h, and strapdown integration holds it. Where both
change within the period that misses, to third order in h, the angle and the velocity

    h^3/12 w x w'                     coning: a swinging foot that rolls and pitches out of step seems to turn about up
    h^3/12 (w x f' - w' x f)          sculling

so the sample that integrates to the right angle and velocity, when held, is

    w + h/12 w x dw,     f + h/12 (w x df - dw x f),     with dw = h w', df = h f' from the neighboring samples.

At 100 Hz a walking foot's coning is some 0.035 deg/s about up, like a gyroscope bias that comes and goes with the
gait; it falls with the square of the rate. What is left is of fourth order
(`scripts/sample_errors.py integration`). Source: Savage (1998), "Strapdown inertial navigation integration algorithm
design", parts 1 and 2, for samples that are integrals over their period.

Before that, peaks beyond the sensors' range are rebuilt (`fg_nav.samples.saturation`), and a sample before a gap, held
until the next stamp, is made the mean over all of that time (`fg_nav.samples.gaps`).
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.samples.gaps import Gaps


def prepare_samples(acc: Floats, gyr: Floats, h: Floats, gaps: Gaps) -> tuple[Floats, Floats]:
    """Specific forces and rates (N, 3), from rebuilt ones, that integrate to the motion when held over `h` (N,) s."""
    share = (gaps.unseen_s / h[gaps.sample])[:, None]
    acc, gyr = acc.copy(), gyr.copy()
    acc[gaps.sample] += share * (gaps.acc - acc[gaps.sample])
    gyr[gaps.sample] += share * (gaps.gyr - gyr[gaps.sample])
    return compensate_coning(acc, gyr, h)


def compensate_coning(acc: Floats, gyr: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Add sculling to specific forces and coning to rates, both (N, 3) means over periods `h` (N,) s, N > 1."""
    d_acc, d_gyr = _differentiate(acc, h), _differentiate(gyr, h)
    share = h[:, None] / 12
    sculling = np.cross(gyr, d_acc) - np.cross(d_gyr, acc)
    return acc + share * sculling, gyr + share * np.cross(gyr, d_gyr)


def _differentiate(samples: Floats, h: Floats) -> Floats:
    """(N, 3) by how much samples change over their own period: a parabola's slope, at either end that to the next."""
    middle = np.cumsum(h) - h / 2
    return np.asarray(np.gradient(samples, middle, axis=0) * h[:, None])
