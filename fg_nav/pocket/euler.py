"""Roll, pitch and yaw of MD: rotations nav_R_body of them and back, MD (12), (13), and their errors as rotations.

A body in nav is rotated by roll about x, then pitch about y, then yaw about z, all in rad. Within a degree of a pitch
of +-90 deg roll and yaw are not usable.

Reference: as in `fg_nav.pocket.filter_equations`.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.system.compiled import njit

MIN_COSINE = float(np.sin(np.radians(1.0)))  # Within a degree of a pitch of +-90 deg roll and yaw are not usable.


@njit(cache=True)
def angles_of_rotation(nav_R_body: Floats) -> Floats:
    """Roll, pitch, yaw (3,) rad."""
    R = nav_R_body
    pitch = np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2]))
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


@njit(cache=True)
def rotation_of_angles(angles: Floats) -> Floats:
    """nav_R_body (3, 3) of roll, pitch, yaw (3,) rad."""
    cr, sr = np.cos(angles[0]), np.sin(angles[0])
    cp, sp = np.cos(angles[1]), np.sin(angles[1])
    cy, sy = np.cos(angles[2]), np.sin(angles[2])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


@njit(cache=True)
def error_axes(nav_R_body: Floats) -> Floats:
    """E (3, 3): from errors of the angles to the rotation in nav."""
    x, y = nav_R_body[0, 0], nav_R_body[1, 0]
    cosine = np.hypot(x, y)
    return np.array([[x, -y / cosine, 0.0], [y, x / cosine, 0.0], [nav_R_body[2, 0], 0.0, 1.0]])


@njit(cache=True)
def inverse_error_axes(nav_R_body: Floats) -> Floats:
    """E^-1 (3, 3): from a small rotation in nav to errors of the angles."""
    x, y, sine = nav_R_body[0, 0], nav_R_body[1, 0], -nav_R_body[2, 0]
    square = x * x + y * y
    cosine = np.sqrt(square)
    return np.array(
        [[x / square, y / square, 0.0], [-y / cosine, x / cosine, 0.0], [sine * x / square, sine * y / square, 1.0]]
    )


@njit(cache=True)
def angles_of_up(force: Floats) -> tuple[float, float]:
    """Roll and pitch, rad, of a specific force (3,) of gravity alone, MD (12), (13), in all quadrants."""
    roll = np.arctan2(force[1], force[2])
    return roll, np.arctan2(-force[0], np.hypot(force[1], force[2]))


@njit(cache=True)
def is_degenerate(nav_R_body: Floats) -> bool:
    """Whether the x axis is within a degree of vertical, where Euler angles end."""
    return bool(nav_R_body[0, 0] ** 2 + nav_R_body[1, 0] ** 2 < MIN_COSINE**2)
