"""The papers' levelling and compass: the equations in their own axes, as printed and as they must be.

======================== ============================ ======================================
in its own axes          Ma (1)-(5)                   AIEZ (19)-(25)
======================== ============================ ======================================
body axes                forward, right, down         forward, left, up
accelerometer at rest    (0, 0, -g)                   (0, 0, +g)
heading turns about      down: clockwise              up: counter-clockwise
======================== ============================ ======================================

Both axes stop at the door of `ma_heading` and `aiez_heading`, which take our body frame and give our heading. What is
printed wrong, and what must stand there:

========== ======================================= =====================================================
Ma (1)     atan(B_y / B_x) +- D                    -atan2(B_y, B_x) + D: else the heading counts twice
Ma (4)     asin(a_y (g cos p))                     asin(a_y / (g cos p)), better atan2(a_y, -a_z)
AIEZ (20)  atan(a_y / a_z)                         atan2: else upside down is upright
AIEZ (25)  atan(B_E / B_N) + D                     -atan2(B_E, B_N) - D: its heading turns the other way
========== ======================================= =====================================================

Ma's angles (r, p) are minus the usual roll and pitch, and Ma (3) has the usual matrix with the signs of both turned:
together they are right. AIEZ (23) and its angles are the usual ones. Each is right with its own accelerometer only,
which is why both stand here with their tilt.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import GRAVITY_M_S2, wrap_angle

Tilt: TypeAlias = tuple[Floats, Floats]
"""Roll and pitch (...,) rad in the sense of the paper."""

FRD_FROM_FLU = np.array([1.0, -1.0, -1.0])  # Forward-left-up to forward-right-down, axis by axis, and back.


def ma_heading(body_field: Floats, acc: Floats, declination: float = 0.0, as_printed: bool = False) -> Floats:
    """Heading (...,) rad clockwise from true north by Ma (1), (4), (5), from our body frame.

    Parameters
    ----------
    body_field, acc : (..., 3) uT and m/s^2, +g up at rest.
    declination : rad, east positive.
    as_printed : with the sign of Ma (1) and the product of Ma (4) as printed.
    """
    field, force = body_field * FRD_FROM_FLU, acc * FRD_FROM_FLU
    tilt = ma_tilt_as_printed(force) if as_printed else ma_tilt(force)
    heading = ma_compass_as_printed if as_printed else ma_compass
    return heading(ma_levelled(field, tilt), declination)


def ma_tilt(force: Floats) -> Tilt:
    """(r, p) of Ma (4) in all quadrants and without g; `force` (..., 3) is (0, 0, -g) at rest."""
    x, y, z = np.moveaxis(force, -1, 0)
    return np.arctan2(y, -z), -np.arctan2(x, np.hypot(y, z))


def ma_tilt_as_printed(force: Floats) -> Tilt:
    """(r, p) of Ma (4), its product clipped to what an arcsine takes."""
    x, y, _ = np.moveaxis(force, -1, 0)
    p = -np.arcsin(np.clip(x / GRAVITY_M_S2, -1.0, 1.0))
    return np.arcsin(np.clip(y * (GRAVITY_M_S2 * np.cos(p)), -1.0, 1.0)), p


def ma_levelled(field: Floats, tilt: Tilt) -> Floats:
    """Ma (3), its first two rows Ma (5): levelled field (..., 3), forward, right and down."""
    r, p = tilt
    x, y, z = np.moveaxis(field, -1, 0)
    across = np.sin(r) * y - np.cos(r) * z
    return np.stack(
        [np.cos(p) * x + np.sin(p) * across, np.cos(r) * y + np.sin(r) * z, np.sin(p) * x - np.cos(p) * across], axis=-1
    )


def ma_compass(levelled: Floats, declination: float = 0.0) -> Floats:
    """Heading of Ma (1) with the right sign: the field is (H cos psi, -H sin psi, .)."""
    return wrap_angle(-np.arctan2(levelled[..., 1], levelled[..., 0]) + declination)


def ma_compass_as_printed(levelled: Floats, declination: float = 0.0) -> Floats:
    """Heading of Ma (1); of its two signs of D the upper."""
    return wrap_angle(np.arctan(levelled[..., 1] / levelled[..., 0]) + declination)


def ma_inclination(levelled: Floats) -> Floats:
    """Inclination of Ma (2), which is right: positive down."""
    return np.asarray(np.arctan2(levelled[..., 2], np.linalg.norm(levelled[..., :2], axis=-1)))


def aiez_heading(body_field: Floats, acc: Floats, declination: float = 0.0, as_printed: bool = False) -> Floats:
    """Heading (...,) rad clockwise from true north by AIEZ (20)-(25), from our body frame.

    Parameters
    ----------
    body_field, acc : (..., 3) uT and m/s^2, +g up at rest.
    declination : rad, east positive.
    as_printed : with the arctangent of AIEZ (20) and the signs of AIEZ (25) as printed.
    """
    tilt = aiez_tilt_as_printed(acc) if as_printed else aiez_tilt(acc)
    heading = aiez_compass_as_printed if as_printed else aiez_compass
    return wrap_angle(-heading(aiez_levelled(body_field, tilt), declination))


def aiez_force(tilt: Tilt) -> Floats:
    """AIEZ (19): specific force (..., 3) m/s^2 at rest with this roll and pitch."""
    roll, pitch = tilt
    direction = [-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)]
    return GRAVITY_M_S2 * np.stack(direction, axis=-1)


def aiez_tilt(force: Floats) -> Tilt:
    """Roll and pitch of AIEZ (20), (21) in all quadrants; `force` (..., 3) is (0, 0, +g) at rest."""
    x, y, z = np.moveaxis(force, -1, 0)
    return np.arctan2(y, z), -np.arctan2(x, np.hypot(y, z))


def aiez_tilt_as_printed(force: Floats) -> Tilt:
    """Roll and pitch of AIEZ (20), (21)."""
    x, y, z = np.moveaxis(force, -1, 0)
    return np.arctan(y / z), -np.arctan(x / np.hypot(y, z))


def aiez_levelled(field: Floats, tilt: Tilt) -> Floats:
    """AIEZ (23), its first two rows AIEZ (24): levelled field (..., 3), forward, left ("B_E") and up."""
    roll, pitch = tilt
    x, y, z = np.moveaxis(field, -1, 0)
    across = np.sin(roll) * y + np.cos(roll) * z
    return np.stack(
        [
            np.cos(pitch) * x + np.sin(pitch) * across,
            np.cos(roll) * y - np.sin(roll) * z,
            np.cos(pitch) * across - np.sin(pitch) * x,
        ],
        axis=-1,
    )


def aiez_compass(levelled: Floats, declination: float = 0.0) -> Floats:
    """Yaw of AIEZ (25) about its upward axis, so declination, which is clockwise, is taken off."""
    return wrap_angle(-np.arctan2(levelled[..., 1], levelled[..., 0]) - declination)


def aiez_compass_as_printed(levelled: Floats, declination: float = 0.0) -> Floats:
    """Yaw of AIEZ (25)."""
    return wrap_angle(np.arctan(levelled[..., 1] / levelled[..., 0]) + declination)
