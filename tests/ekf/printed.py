"""The papers' filters: the equations as printed that do not do what they are meant to.

Errors are estimate minus truth, in the order of Ma (29), dx = (dphi, dw, dr, dv, da), three each. What is printed, and
what must stand there (test_filter_misprints.py compares the two):

================= ======================================= ===========================================================
Ma (27)           Cayley: (2 I + W h) / (2 I - W h)       right to third order: 8e-5 rad off at 0.1 rad a sample. Exp
Ma (31), AIEZ (2) the transition                          right with these errors and a residual bias, first order
Ma (36)           H = rows (0 I 0 0 0), (0 0 0 I 0)       heading row (0, 0, 1) on dphi; printed, it is the gyro bias
Ma (38)           (2 I + Theta h) / (2 I - Theta h)       dphi is an angle: no h, or a 1/h of it is never removed
Ma (39)           Theta = +[dphi]                         -[dphi], as AIEZ (7): else the error doubles
AIEZ (22), (29)   errors of roll, pitch, yaw are dphi     dphi = Rz(yaw) Ry(pitch) e_x droll + Rz(yaw) e_y dpitch + ...
AIEZ (28), (32)   in a curve z = 0 with sigma_HDR         no row: zero is a measurement, and shrinks P
================= ======================================= ===========================================================

The compass's own misprints are in `tests.magnetic.test_compass`. No filter runs any of these but AIEZ (28), in the
preset as-printed. Angles about z are counter-clockwise, z up, unless said otherwise.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import yaw_rotation
from fg_nav.mechanisation import cross_matrix

ATTITUDE, GYRO_BIAS, POSITION, VELOCITY, ACC_BIAS = 0, 3, 6, 9, 12
"""First index of each part of dx in the papers' order."""

TO_OURS = np.array([6, 7, 8, 9, 10, 11, 0, 1, 2, 3, 4, 5, 12, 13, 14])
"""Where each of the papers' components is in our order (`fg_nav.ekf.covariance`)."""


def cayley(theta: Floats) -> Floats:
    """Rotation (3, 3) about `theta` (3,) rad as Ma (27) has it."""
    half = cross_matrix(theta) / 2
    return np.asarray(np.linalg.solve(np.eye(3) - half, np.eye(3) + half))


def transition(nav_R_body: Floats, body_force: Floats, h: float) -> Floats:
    """Phi (15, 15) of Ma (31) and AIEZ (2), in the papers' order.

    Here dw and da are what is still to be taken off rate and force, so that a rate is too high by dw.
    """
    phi = np.eye(15)
    phi[ATTITUDE : ATTITUDE + 3, GYRO_BIAS : GYRO_BIAS + 3] = h * nav_R_body
    phi[POSITION : POSITION + 3, VELOCITY : VELOCITY + 3] = h * np.eye(3)
    phi[VELOCITY : VELOCITY + 3, ATTITUDE : ATTITUDE + 3] = -h * cross_matrix(nav_R_body @ body_force)
    phi[VELOCITY : VELOCITY + 3, ACC_BIAS : ACC_BIAS + 3] = h * nav_R_body
    return phi


def ma_rows() -> Floats:
    """H (6, 15) of Ma (36) for the four numbers of Ma (34), (dtheta, v)."""
    return _rows(GYRO_BIAS)


def zhang_rows() -> Floats:
    """H (6, 15) of AIEZ (29), for errors of roll, pitch and yaw, and of velocity."""
    return _rows(ATTITUDE)


def _rows(first: int) -> Floats:
    h = np.zeros((6, 15))
    h[:3, first : first + 3] = np.eye(3)
    h[3:, VELOCITY : VELOCITY + 3] = np.eye(3)
    return h


def ma_corrected(nav_R_body: Floats, dphi: Floats, h: float) -> Floats:
    """Attitude (3, 3) after Ma (38), (39)."""
    return cayley(dphi * h) @ nav_R_body


def zhang_corrected(nav_R_body: Floats, dphi: Floats) -> Floats:
    """Attitude (3, 3) after AIEZ (6), (7), which are right."""
    return cayley(-dphi) @ nav_R_body


def euler_angles(nav_R_body: Floats) -> Floats:
    """Roll, pitch, yaw (3,) rad of Rz(yaw) Ry(pitch) Rx(roll)."""
    R = nav_R_body
    return np.array([np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0])])


def axes_of_euler_errors(nav_R_body: Floats) -> Floats:
    """(3, 3), whose columns are the axes in nav about which roll, pitch and yaw turn: dphi = it times their errors."""
    _, pitch, yaw = euler_angles(nav_R_body)
    turned = yaw_rotation(yaw)
    roll_axis = np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
    return np.stack([turned @ roll_axis, turned @ np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])], axis=1)
