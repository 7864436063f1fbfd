"""The equations as printed that do not do what they are meant to, against ours, on states known without either.

Errors are estimate minus truth, in the order of Ma (29), dx = (dphi, dw, dr, dv, da), three each. What is printed, and
what must stand there:

================= ======================================= ===========================================================
Ma (27)           Cayley: (2 I + W h) / (2 I - W h)       right to third order: 8e-5 rad off at 0.1 rad a sample. Exp
Ma (31), AIEZ (2) the transition                          right with these errors and a residual bias, first order
Ma (36)           H = rows (0 I 0 0 0), (0 0 0 I 0)       heading row (0, 0, 1) on dphi; printed, it is the gyro bias
Ma (38)           (2 I + Theta h) / (2 I - Theta h)       dphi is an angle: no h, or a 1/h of it is never removed
Ma (39)           Theta = +[dphi]                         -[dphi], as AIEZ (7): else the error doubles
AIEZ (22), (29)   errors of roll, pitch, yaw are dphi     dphi = Rz(yaw) Ry(pitch) e_x droll + Rz(yaw) e_y dpitch + ...
AIEZ (28), (32)   in a curve z = 0 with sigma_HDR         no row: zero is a measurement, and shrinks P
================= ======================================= ===========================================================

The transition, the heading row and the sign are in `test_model` and `test_measurements`, the compass's own misprints in
`tests.magnetic.test_compass`. No filter runs any of these but AIEZ (28), in the preset as-printed. Angles about z are
counter-clockwise, z up.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.ekf.covariance import ATTITUDE
from fg_nav.ekf.measurements import COURSE, make_pseudo_measurements, update_at_footfall
from fg_nav.ekf.update import inject_error, update_row
from fg_nav.frames import wrap_angle, yaw_rotation
from fg_nav.mechanisation import cross_matrix, strapdown
from tests.ekf.motion import error_of, random_state, with_error


def cayley(theta):
    """Rotation (3, 3) about `theta` (3,) rad as Ma (27) has it."""
    half = cross_matrix(theta) / 2
    return np.linalg.solve(np.eye(3) - half, np.eye(3) + half)


def test_over_a_swing_ours_turns_by_what_was_turned_and_cayley_by_a_twelfth_of_the_cubes_less():
    """Half a second to 8 rad/s and back at 100 Hz, held between samples: 2 rad, of which Cayley loses 0.04 deg."""
    state, turn, push = random_state(1, np.eye(3), 0.0), np.empty((3, 3)), np.empty(3)
    printed, rates = np.eye(3), 8.0 * np.sin(np.pi * (np.arange(50) + 0.5) / 50) ** 2
    for rate in rates:
        strapdown(state, np.zeros(3), np.array([0.0, 0.0, rate]), 0.01, 9.81, turn, push)
        printed = printed @ cayley(np.array([0.0, 0.0, rate * 0.01]))
    exact = Rotation.from_rotvec([0.0, 0.0, rates.sum() * 0.01]).as_matrix()
    ours, theirs = (Rotation.from_matrix(R @ exact.T).magnitude() for R in (state.nav_R_body, printed))
    assert ours < 1e-9
    assert theirs == pytest.approx(((rates * 0.01) ** 3).sum() / 12, rel=0.01)


# AIEZ (22), (29): errors of Euler angles


def euler_angles(nav_R_body):
    """Roll, pitch, yaw (3,) rad."""
    return Rotation.from_matrix(nav_R_body).as_euler("ZYX")[::-1]


def axes_of_euler_errors(nav_R_body):
    """(3, 3), whose columns are the axes in nav about which roll, pitch and yaw turn: dphi = it times their errors."""
    _, pitch, yaw = euler_angles(nav_R_body)
    level = np.stack([[np.cos(pitch), 0.0, -np.sin(pitch)], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], axis=1)
    return yaw_rotation(yaw) @ level


def levelled_again_and_again(yaw_deg, printed, rounds=20):
    """Tilt error (deg) left after so many corrections of 3 deg by a true roll and pitch."""
    truth = random_state(7, Rotation.from_euler("ZYX", [yaw_deg, 10.0, 5.0], degrees=True).as_matrix())
    estimate = with_error(truth, np.radians(3.0) * np.eye(15)[ATTITUDE])
    for _ in range(rounds):
        x, P = np.zeros(15), np.diag(np.repeat([1e-6, 1e-6, np.radians(1.0) ** 2, 1e-12, 1e-12], 3))
        z = wrap_angle(euler_angles(estimate.nav_R_body) - euler_angles(truth.nav_R_body))
        z = z if printed else axes_of_euler_errors(truth.nav_R_body) @ z
        for axis in (0, 1):
            update_row(P, x, np.eye(15)[ATTITUDE + axis], z[axis], np.radians(1.0) ** 2)
        inject_error(estimate, x)
    return np.degrees(np.linalg.norm(error_of(estimate, truth)[6:8]))


def test_tilt_converges_at_every_yaw_and_the_printed_rows_overturn_facing_west():
    """Positive feedback beyond a quarter of a turn."""
    for yaw_deg in (0.0, 60.0, 90.0, 120.0, 180.0):
        assert levelled_again_and_again(yaw_deg, printed=False) < 0.01
    assert levelled_again_and_again(0.0, printed=True) < 0.01
    assert levelled_again_and_again(180.0, printed=True, rounds=5) > 15.0
    assert levelled_again_and_again(120.0, printed=True, rounds=10) > 15.0


# AIEZ (28), (32): a zero in a curve


def test_zero_in_a_curve_reduces_the_variance_without_a_measurement():
    turns, sigma = np.radians(20.0) * np.arange(31), {}
    for as_printed in (False, True):
        P, x, innovation = np.eye(15), np.zeros(15), np.full(4, np.nan)
        pseudo = make_pseudo_measurements(31)._replace(
            course_variance=np.full(31, np.radians(2.0) ** 2),
            course_limit=float(np.radians(4.0)),
            course_strides=1,
            curve_is_zero=as_printed,
        )
        for k in range(1, 31):
            given = pseudo, np.zeros(15), innovation, np.zeros((3, 32))
            update_at_footfall(random_state(9).nav_R_body, P, x, k, turns[k], turns[:k], *given)
            assert np.isfinite(innovation[COURSE]) == as_printed
            assert not x.any()
        sigma[as_printed] = np.sqrt(P[ATTITUDE + 2, ATTITUDE + 2])
    assert sigma[False] == 1.0
    assert sigma[True] < np.radians(0.4)
