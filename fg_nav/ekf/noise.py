"""What the inertial sensors do wrong from sample to sample, beyond their biases.

On a foot the noise of the data sheet is the smallest part. Scale factors, cross-axis terms, soft mounting and
uneven stamps make errors that grow with the motion and last a few samples: a share e of a signal x,
correlated over a time tau, acts on its integral like white noise of density e |x| sqrt(2 tau). So with the
acceleration a in nav and the angular rate w,

    density of the specific force = floor + relative |a|        (squares added),        likewise with |w|.

The floor is what is left while the foot stands. Two kinds of sample are doubted for themselves: one at the
end of the sensor's range hides a part of its peak, and one before a gap stands for motion that nobody saw.
Their doubt, a standard deviation in the units of the sample, is taken axis by axis: a foot clips its pitch
rate, and its heading need not suffer.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.ekf.covariance import Densities
from fg_nav.saturation import saturated

GAP_PERIODS = 2.5
"""A sample held for longer than this many periods stands before a gap."""


class MotionNoise(NamedTuple):
    """Squared densities: floors (m/s)^2/s and rad^2/s, relative parts s, walks of the biases per second."""

    acc_floor: float
    acc_relative: float
    gyr_floor: float
    gyr_relative: float
    gyro_bias: float
    acc_bias: float


@njit(cache=True)
def densities_in_motion(noise: MotionNoise, gyr: Floats, push: Floats, h: float, gravity: float) -> Densities:
    """Densities for one sample, from its rate and from what it adds to the velocity in `h` seconds."""
    rate = gyr[0] ** 2 + gyr[1] ** 2 + gyr[2] ** 2
    gained = push[0] ** 2 + push[1] ** 2 + (push[2] - gravity * h) ** 2
    return Densities(
        noise.acc_floor + noise.acc_relative * gained / (h * h),
        noise.gyr_floor + noise.gyr_relative * rate,
        noise.gyro_bias,
        noise.acc_bias,
    )


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
