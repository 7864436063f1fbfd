"""Velocity of the sensor on a standing foot: the velocity rows of Ma (34), Ma (36) and AIEZ (29), (30), with a lever.

The sole is still, the sensor is not: the foot rolls from heel to toe, and the sensor rides at some height
above the point about which it rolls. With the lever l from that point to the sensor and the angular rate w,
both in nav,

    v = w x l + noise,    l = (0, 0, height) + unknown part.

Setting v = 0 makes strides too short, in the median by 2 % on motion-captured walks. The height stands for the
mean lever: sensors sit 5 to 10 cm above the sole, and where the foot rolls is not a point. The unknown part
of the lever, in any direction, is noise that grows with the rate; being the same for a while, it has the
density sigma |w| sqrt(2 tau). At rest all of this vanishes and a small floor is left.

The lever may also be given in the body frame, where a recording shows it (`fg_nav.detection.rolling_lever`). And a
foot whose specific force f is not gravity has begun to move: with the time for which that may have lasted, the velocity
gets the further standard deviation unsteady | |f| - g |, again as a density.

H leaves out how attitude and gyro bias enter through w x l: the lever times a hundredth of a radian.

References: Foxlin (2005), "Pedestrian tracking with shoe-mounted inertial sensors". That the velocity is not
zero and the error not white: Nilsson, Skog, Handel (2012), "A note on the limitations of ZUPTs and the
implications on sensor error modeling". The rolling lever is ours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.ekf.covariance import VELOCITY
from fg_nav.ekf.update import update_component_traced
from fg_nav.mechanisation import NavState
from fg_nav.system.compiled import njit


class StanceNoise(NamedTuple):
    """Squared density `floor` (m/s)^2 s, its growths, and the lever.

    It grows by `rolling` m^2 s with the squared rate, and by `unsteady` s^3 with the square of the force's excess over
    `gravity` m/s^2. The lever is `height` m straight up and `lever` (3,) m in the body frame, the one or the other.
    """

    floor: float
    rolling: float
    unsteady: float
    height: float
    lever: Floats
    gravity: float


@njit(cache=True)
def update_in_stance(
    state: NavState, P: Floats, x: Floats, acc: Floats, gyr: Floats, h: float, stance: StanceNoise, traces: Floats
) -> float:
    """Update the error `x` (15,) and `P` by the known velocity over a sample of `h` s; returns its NIS.

    Leaves the `traces` (3, 17) of east, north and up.
    """
    rate, expected, square, force = np.empty(3), np.empty(3), 0.0, 0.0
    for axis in range(3):
        rate[axis] = gyr[axis] - state.gyro_bias[axis]
        square += rate[axis] ** 2
        force += acc[axis] ** 2
    _compute_rolling_velocity(state.nav_R_body, rate, stance, expected)
    variance = (stance.floor + stance.rolling * square) / h
    if stance.unsteady > 0.0:
        variance += stance.unsteady * (np.sqrt(force) - stance.gravity) ** 2 / h
    nis = 0.0
    for axis in range(3):
        z = state.velocity[axis] - expected[axis]
        nis += update_component_traced(P, x, VELOCITY + axis, z, variance, traces[axis]) ** 2
    return nis


@njit(cache=True)
def _compute_rolling_velocity(R: Floats, w: Floats, stance: StanceNoise, velocity: Floats) -> None:
    """Write the velocity (3,) m/s, nav, of the sensor on a foot that rolls with the rate `w` (3,)."""
    x, y, z = stance.lever[0], stance.lever[1], stance.lever[2]
    vx, vy, vz = w[1] * z - w[2] * y, w[2] * x - w[0] * z, w[0] * y - w[1] * x
    east = R[0, 0] * w[0] + R[0, 1] * w[1] + R[0, 2] * w[2]
    north = R[1, 0] * w[0] + R[1, 1] * w[1] + R[1, 2] * w[2]
    velocity[0] = R[0, 0] * vx + R[0, 1] * vy + R[0, 2] * vz + north * stance.height
    velocity[1] = R[1, 0] * vx + R[1, 1] * vy + R[1, 2] * vz - east * stance.height
    velocity[2] = R[2, 0] * vx + R[2, 1] * vy + R[2, 2] * vz
