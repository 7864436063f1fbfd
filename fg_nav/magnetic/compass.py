"""From the field in the body frame to a magnetic heading, an inclination and a strength.

Symbols, in the frames of this project

=================== ===== ===================================================================================
body_field          uT    flux density in the body frame
body_up             -     direction of up in the body frame: the specific force of a sensor at rest
level_field         uT    the same field in levelled axes: x along the body's x axis over the ground, y to its
                          left, z up (the sensor laid level without being turned)
heading             rad   of the body's x axis, clockwise from magnetic north
inclination         rad   of the field below the horizon, positive on the northern hemisphere
declination         rad   of magnetic north, clockwise from true north: true heading = magnetic heading + declination
=================== ===== ===================================================================================

With H the horizontal strength and psi the heading, north lies psi to the left of x:

    level_field = (H cos psi, H sin psi, -H tan I),    psi = atan2(y, x),    I = atan2(-z, H).

These are Ma (1)-(5) and AIEZ (19)-(25), each of which has axes of its own: the levelling of Ma (3)-(5) is right with an
accelerometer that reads (0, 0, -g) at rest, that of AIEZ (19)-(24) with (0, 0, +g); the heading of Ma (1) and AIEZ (25)
has the wrong sign, half of the circle, and for AIEZ the declination's sign. docs/equations.md lists them.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import wrap_angle


def compute_level_R_body(body_up: Floats) -> Floats:
    """Rotation (..., 3, 3) to levelled axes from the body frame, by the direction of up (..., 3) in the body frame.

    The body's x axis must not be vertical: over the ground it then has no direction.
    """
    up = body_up / np.linalg.norm(body_up, axis=-1, keepdims=True)
    forward = np.array([1.0, 0.0, 0.0]) - up[..., :1] * up
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    return np.stack([forward, np.cross(up, forward), up], axis=-2)


def rotate_to_level(body_field: Floats, body_up: Floats) -> Floats:
    """Field (..., 3) uT in levelled axes: Ma (3), (5), AIEZ (23), (24)."""
    return np.asarray(np.einsum("...ij,...j->...i", compute_level_R_body(body_up), body_field))


def compute_field_heading(level_field: Floats) -> Floats:
    """Magnetic heading (...,) rad of the body's x axis, clockwise from magnetic north: Ma (1), AIEZ (25)."""
    return np.asarray(np.arctan2(level_field[..., 1], level_field[..., 0]))


def compute_true_heading(magnetic_heading: Floats, declination: float) -> Floats:
    """Heading (...,) rad clockwise from true north, from that of the compass; `declination` rad, east positive."""
    return wrap_angle(magnetic_heading + declination)


def compute_inclination(up_field: Floats) -> Floats:
    """Inclination (...,) rad of a field (..., 3) in any axes whose third is up: Ma (2)."""
    return np.asarray(np.arctan2(-up_field[..., 2], np.linalg.norm(up_field[..., :2], axis=-1)))
