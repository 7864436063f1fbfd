"""The motion within a sample: coning and sculling.

A sample is the mean of rate w and specific force f over its period h, and strapdown integration holds it. Where both
change within the period that misses, to third order in h, the angle and the velocity

    h^3/12 w x w'                     coning: a swinging foot that rolls and pitches out of step seems to turn about up
    h^3/12 (w x f' - w' x f)          sculling

so the sample that integrates to the right turn and push, when held, is

    w + h/12 w x dw,     f + h/12 (w x df - dw x f),     with dw = h w', df = h f' from the neighbouring samples.

At 100 Hz a walking foot's coning is some 0.035 deg/s about up, which nothing tells from a gyroscope bias that comes and
goes with the gait; it falls with the square of the rate. What is left is of fourth order
(`scripts/kinematic_consistency.py`). Source: Savage (1998), "Strapdown inertial navigation integration algorithm
design", parts 1 and 2, for samples that are integrals over their period.

No correction at the first and last sample and beside gaps: there the neighbours do not tell the slope.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.recording import GAP_PERIODS, Recording


def integrable(recording: Recording) -> tuple[Floats, Floats]:
    """Specific force (N, 3) m/s^2 and rate (N, 3) rad/s that, held over their periods, integrate to what was moved."""
    h = np.append(np.diff(recording.t), recording.period_s)
    return compensated(recording.acc, recording.gyr, h)


def compensated(acc: Floats, gyr: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Add sculling to specific forces and coning to rates, both (N, 3), held over periods `h` (N,) s."""
    d_acc, d_gyr = _change_within(acc, h), _change_within(gyr, h)
    share = h[:, None] / 12
    sculling = np.cross(gyr, d_acc) - np.cross(d_gyr, acc)
    return acc + share * sculling, gyr + share * np.cross(gyr, d_gyr)


def _change_within(samples: Floats, h: Floats) -> Floats:
    """(N, 3) by how much samples change over their own period, from the neighbours; zero where these do not tell."""
    change = np.zeros_like(samples)
    between = h[1:-1] + (h[:-2] + h[2:]) / 2
    change[1:-1] = (samples[2:] - samples[:-2]) * (h[1:-1] / between)[:, None]
    gap = h > GAP_PERIODS * np.median(h)
    change[1:][gap[:-1]] = change[gap] = 0.0
    return change
