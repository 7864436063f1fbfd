"""What the inertial sensors do wrong from sample to sample, beyond their biases.

On a foot the noise of the data sheet is the smallest part. Scale factors, cross-axis terms, soft mounting and
uneven stamps make errors that grow with the motion and last a few samples: a share e of a signal x,
correlated over a time tau, acts on its integral like white noise of density e |x| sqrt(2 tau). So with the
acceleration a in nav and the angular rate w,

    density of the specific force = floor + relative |a|        (squares added),        likewise with |w|.

The floor is what is left while the foot stands. Single samples that are doubted for themselves: `fg_nav.sample_noise`.
"""

from __future__ import annotations

from typing import NamedTuple

from numba import njit

from fg_nav.arrays import Floats
from fg_nav.ekf.covariance import Densities


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
