"""The specific force by which up is told: that of the stamp, or a mean over about two strides.

The paper takes in a sample while its strength is gravity's. A walking thigh passes through that strength, with as much
and more across, and to the same side in each stride. On the two thighs of a real walk (`qmt_fullbody`, 41 s) 0.1 % of
the samples have been within 0.3 m/s^2 for 50 ms, with an error of up to 4.7 m/s^2 an axis; in the simulated street 2 %,
with means of 3 to 5, and the tilt is 60 deg off. But over a stride the hip's velocity comes back to itself, and the
mean specific force, its parts turned into one frame by the gyroscope, is gravity. Weighted by a raised cosine over two
seconds, so that it need not be a whole number of strides, it is so to 0.1 to 0.25 m/s^2 an axis on those thighs and to
0.1 in the simulator. (A plain mean over one second has 0.15 to 0.35, in step with the leg, and the bias along the
thigh follows that.)

    sum over the window of  w_j G_k^T G_j f_j,     G the attitude by the gyroscope alone, from anywhere

A bias b turns the mean, which is half a window W old, by b W / 2: `fg_nav.pocket.updates` has that in its row.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fg_nav.arrays import Bools, Floats
from fg_nav.mechanisation import rotate_in_body
from fg_nav.recording import Recording


def force_at_stamps(acc: Floats) -> Floats:
    """Specific force (N, 3) at the stamps, of samples that are means over the period after them."""
    force = acc.copy()
    force[1:] = (acc[1:] + acc[:-1]) / 2
    return force


def mean_force(recording: Recording, count: int) -> Floats:
    """Mean specific force (N, 3) m/s^2 over the `count` periods before each stamp, in the body at it; NaN at first.

    Weighted by a raised cosine, so it is half a window old.
    """
    h = np.append(np.diff(recording.t), recording.period_s)
    acc, gyr = recording.integrable
    turned = gyro_attitude(gyr, h)
    force = acc + np.cross(gyr, acc) * (h / 2)[:, None]
    weight = 1.0 - np.cos(2 * np.pi * (np.arange(count) + 0.5) / count)
    mean = np.full((len(recording), 3), np.nan)
    if len(recording) > count:
        level = np.einsum("nij,nj->ni", turned, force)
        smooth = np.stack([np.convolve(axis, weight / weight.sum(), "valid")[:-1] for axis in level.T], axis=1)
        mean[count:] = np.einsum("nji,nj->ni", turned[count:], smooth)
    return mean


@njit(cache=True)
def gyro_attitude(gyr: Floats, h: Floats) -> Floats:
    """Attitudes (N, 3, 3) at the stamps by rates (N, 3) rad/s held for `h` (N,) s, from the identity on."""
    attitude = np.empty((len(gyr), 3, 3))
    R = np.eye(3)
    for i in range(len(gyr)):
        attitude[i] = R
        rotate_in_body(R, gyr[i, 0] * h[i], gyr[i, 1] * h[i], gyr[i, 2] * h[i])
    return attitude


def thinned(t: Floats, flags: Bools, period_s: float) -> Bools:
    """Those of the flags (N,) that are a period or more after the last one that is kept."""
    kept, last = np.zeros(len(t), dtype=np.bool_), -np.inf
    for row in np.flatnonzero(flags):
        if t[row] - last >= period_s - 1e-9:
            kept[row], last = True, t[row]
    return kept
