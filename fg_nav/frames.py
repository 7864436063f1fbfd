"""Attitude and heading between the body frame and the navigation frame (East-North-Up).

Symbols: `nav_R_body` maps body vectors to navigation vectors; heading is the direction of the body's x axis
over the ground, radians clockwise from north (degrees only for people); specific force at rest is +g up.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats

GRAVITY_M_S2 = 9.80665  # Standard gravity.
UNKNOWN_RAD = float(np.pi / np.sqrt(3.0))  # Sigma of an angle of which nothing is known.


def compute_heading(nav_R_body: Floats) -> Floats:
    """Heading (...,) rad, clockwise from north, of attitudes (..., 3, 3)."""
    east, north = nav_R_body[..., 0, 0], nav_R_body[..., 1, 0]
    return np.arctan2(east, north)


MIN_LEVEL = 1e-12  # Square of the level part of an axis, below which it has no heading.


def turn_heading(nav_R_body: Floats) -> Floats:
    """By how much the heading turns (3,), counter-clockwise, with a small turn of an attitude (3, 3) about body axes.

    That of a level x axis turns with the body about up. Where the axis is inclined it also turns as the body tilts to
    its side.
    """
    x, y, z = nav_R_body.T
    level = np.array([-x[1], x[0], 0.0]) / max(x[0] ** 2 + x[1] ** 2, MIN_LEVEL)
    return np.array([0.0, -level @ z, level @ y])


def level_attitude(body_up: Floats, heading: float = 0.0) -> Floats:
    """Return nav_R_body (..., 3, 3) from the up direction in the body frame, `body_up` (..., 3), and a heading in rad.

    With the x axis nearly vertical the heading is arbitrary.
    """
    up = body_up / np.linalg.norm(body_up, axis=-1, keepdims=True)
    of_x, of_z = (axis - up[..., k, None] * up for k, axis in ((0, np.eye(3)[0]), (2, np.eye(3)[2])))
    forward = np.where(np.linalg.norm(of_x, axis=-1, keepdims=True) < 1e-6, of_z, of_x)
    forward = forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    left = np.cross(up, forward)
    east = np.sin(heading) * forward - np.cos(heading) * left
    return np.stack([east, np.cos(heading) * forward + np.sin(heading) * left, up], axis=-2)


def wrap_angle(angle: Floats) -> Floats:
    """Angles in rad to [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def average_angles(angles: Floats) -> float:
    """Mean direction of angles (N,) rad, in (-pi, pi]; NaN is left out, and of none it is 0."""
    known = angles[np.isfinite(angles)]
    return float(np.angle(np.exp(1j * known).mean())) if len(known) else 0.0


def yaw_rotation(angle: float | Floats) -> Floats:
    """Rotation (..., 3, 3) about up by `angle` (...) rad, counter-clockwise seen from above."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.zeros((*np.shape(angle), 3, 3))
    turn[..., 0, 0], turn[..., 0, 1], turn[..., 1, 0], turn[..., 1, 1], turn[..., 2, 2] = c, -s, s, c, 1.0
    return turn


def quaternion_xyzw(nav_R_body: Floats) -> Floats:
    """Quaternions (N, 4) as x, y, z, w of attitudes (N, 3, 3); `scipy.spatial` has it too, and is slow to load.

    4 q q^T is linear in the attitude; its row with the largest component of q is the most accurate (Shepperd
    1978).
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(nav_R_body, 0, -1)
    outer = np.stack(
        [
            np.stack([1 + xx - yy - zz, xy + yx, xz + zx, zy - yz], axis=-1),
            np.stack([xy + yx, 1 - xx + yy - zz, yz + zy, xz - zx], axis=-1),
            np.stack([xz + zx, yz + zy, 1 - xx - yy + zz, yx - xy], axis=-1),
            np.stack([zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz], axis=-1),
        ],
        axis=1,
    )
    largest = np.argmax(np.diagonal(outer, axis1=1, axis2=2), axis=1)
    chosen = outer[np.arange(len(outer)), largest]
    return np.asarray(chosen / np.linalg.norm(chosen, axis=1, keepdims=True))
