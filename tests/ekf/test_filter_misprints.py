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

The compass's own misprints are in `tests.magnetic.test_compass`. No filter runs any of these but AIEZ (28), in the
preset as-printed. Angles about z are counter-clockwise, z up, unless said otherwise.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.ekf.covariance import ATTITUDE
from fg_nav.ekf.measurements import COURSE, make_pseudo_measurements, update_at_footfall
from fg_nav.ekf.update import inject_error, update_row
from fg_nav.frames import compute_heading, wrap_angle, yaw_rotation
from fg_nav.mechanisation import cross_matrix, strapdown
from tests.ekf.motion import error_of, random_state, with_error

GRAVITY = 9.81
TO_OURS = np.array([6, 7, 8, 9, 10, 11, 0, 1, 2, 3, 4, 5, 12, 13, 14])  # Of each of the papers' components.
DPHI = np.radians([0.1, -0.2, 0.1])


def angle(rotation):
    return float(np.linalg.norm(Rotation.from_matrix(rotation).as_rotvec()))


def foot(yaw_deg, pitch_deg=10.0, roll_deg=5.0):
    return Rotation.from_euler("ZYX", [yaw_deg, pitch_deg, roll_deg], degrees=True).as_matrix()


def cayley(theta):
    """Rotation (3, 3) about `theta` (3,) rad as Ma (27) has it."""
    half = cross_matrix(theta) / 2
    return np.linalg.solve(np.eye(3) - half, np.eye(3) + half)


# Ma (27): Cayley for the exponential


@pytest.mark.parametrize(("turn", "off"), [(0.025, 1.3e-6), (0.1, 8.3e-5)])
def test_cayley_is_short_by_a_twelfth_of_the_cube(turn, off):
    """10 rad/s at 400 and 100 Hz."""
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    exact = Rotation.from_rotvec(turn * axis).as_matrix()
    assert angle(cayley(turn * axis) @ exact.T) == pytest.approx(turn**3 / 12, rel=0.01)
    assert turn**3 / 12 == pytest.approx(off, rel=0.05)


def test_over_a_swing_ours_turns_by_what_was_turned_and_cayley_by_less():
    """Half a second to 4 rad/s and back at 100 Hz, held between samples: 2 rad, of which Cayley loses 0.01 deg."""
    state, turn, push = random_state(1, np.eye(3), 0.0), np.empty((3, 3)), np.empty(3)
    printed, rates = np.eye(3), 8.0 * np.sin(np.pi * (np.arange(50) + 0.5) / 50) ** 2
    for rate in rates:
        strapdown(state, np.zeros(3), np.array([0.0, 0.0, rate]), 0.01, GRAVITY, turn, push)
        printed = printed @ cayley(np.array([0.0, 0.0, rate * 0.01]))
    exact = Rotation.from_rotvec([0.0, 0.0, rates.sum() * 0.01]).as_matrix()
    assert angle(state.nav_R_body @ exact.T) < 1e-9
    assert angle(printed @ exact.T) == pytest.approx(((rates * 0.01) ** 3).sum() / 12, rel=0.01)


# Ma (31), AIEZ (2): the transition


def transition(nav_R_body, body_force, h):
    """Phi (15, 15) in the papers' order; dw and da are what is still to be taken off rate and force."""
    phi = np.eye(15)
    phi[0:3, 3:6] = phi[9:12, 12:15] = h * nav_R_body
    phi[6:9, 9:12] = h * np.eye(3)
    phi[9:12, 0:3] = -h * cross_matrix(nav_R_body @ body_force)
    return phi


@pytest.mark.parametrize("component", range(15))
def test_the_printed_transition_moves_estimate_minus_truth(component):
    """To first order in the period; a bias residual to take off is minus our estimate-minus-truth of a bias."""
    rng, truth, h, step = np.random.default_rng(2), random_state(2), 1e-4, 1e-5
    acc, gyr = rng.standard_normal(3) * 5, rng.standard_normal(3)
    papers = step * np.eye(15)[component]
    ours, expected = np.zeros(15), np.zeros(15)
    ours[TO_OURS], expected[TO_OURS] = papers, transition(truth.nav_R_body, acc - truth.acc_bias, h) @ papers
    ours[9:] *= -1.0
    expected[9:] *= -1.0
    estimate, turn, push = with_error(truth, ours), np.empty((3, 3)), np.empty(3)
    for state in (truth, estimate):
        strapdown(state, acc, gyr, h, GRAVITY, turn, push)
    moved = error_of(estimate, truth) - expected
    assert np.abs(moved).max() < 0.02 * h * step * max(1.0, np.linalg.norm(acc))


# Ma (36): H


def rows(first):
    """H (6, 15) for three angles, whose errors are components from the `first` on, and velocity."""
    h = np.zeros((6, 15))
    h[:3, first : first + 3] = h[3:, 9:12] = np.eye(3)
    return h


@pytest.mark.parametrize("yaw_deg", [0.0, 100.0, 179.9])
def test_a_heading_is_one_row_on_the_attitude_and_none_on_the_gyro_bias(yaw_deg):
    """Derivative of Ma's dtheta, gyro's less that of the field, by the papers' dx: counter-clockwise as dphi is."""
    truth, slopes, right, step = random_state(4, foot(yaw_deg, 0.0, 0.0)), np.empty(15), np.eye(15)[2], 1e-6
    for component in range(15):
        estimate = with_error(truth, step * np.eye(15)[TO_OURS[component]])
        slopes[component] = -wrap_angle(compute_heading(estimate.nav_R_body) - compute_heading(truth.nav_R_body)) / step
    np.testing.assert_allclose(slopes, right, atol=1e-6)
    for row in rows(3)[:3]:  # as printed: six rows, for a measurement of four numbers
        assert not row[:3].any()
        assert row @ right == 0.0


# Ma (38), (39), AIEZ (6), (7): injecting the error into the attitude


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 180.0])
def test_the_sign_of_zhang_takes_the_error_off_and_that_of_ma_doubles_it(yaw_deg):
    truth, error = random_state(6, foot(yaw_deg)), np.zeros(15)
    error[6:9] = DPHI
    estimate = with_error(truth, error)
    zhang, ma = (cayley(sign * DPHI) @ estimate.nav_R_body for sign in (-1, 1))
    inject_error(estimate, error)
    assert angle(estimate.nav_R_body @ truth.nav_R_body.T) < 1e-9
    assert angle(zhang @ truth.nav_R_body.T) < 1e-8
    assert angle(ma @ truth.nav_R_body.T) == pytest.approx(2 * np.linalg.norm(DPHI), rel=1e-4)


def test_with_the_period_next_to_nothing_is_corrected():
    h = 1 / 400
    assert angle(cayley(DPHI * h)) == pytest.approx(h * np.linalg.norm(DPHI), rel=1e-6)


# AIEZ (22), (29): errors of Euler angles


def euler_angles(nav_R_body):
    """Roll, pitch, yaw (3,) rad."""
    return Rotation.from_matrix(nav_R_body).as_euler("ZYX")[::-1]


def axes_of_euler_errors(nav_R_body):
    """(3, 3), whose columns are the axes in nav about which roll, pitch and yaw turn: dphi = it times their errors."""
    _, pitch, yaw = euler_angles(nav_R_body)
    level = np.stack([[np.cos(pitch), 0.0, -np.sin(pitch)], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], axis=1)
    return yaw_rotation(yaw) @ level


@pytest.mark.parametrize("yaw_deg", [0.0, 60.0, 90.0, 180.0])
def test_errors_of_euler_angles_turn_about_their_own_axes(yaw_deg):
    truth = foot(yaw_deg)
    for dphi in 1e-6 * np.eye(3):
        errors = wrap_angle(euler_angles(Rotation.from_rotvec(dphi).as_matrix() @ truth) - euler_angles(truth))
        np.testing.assert_allclose(axes_of_euler_errors(truth) @ errors, dphi, atol=1e-9)


def levelled_again_and_again(yaw_deg, printed, rounds=20):
    """Tilt error (deg) left after so many corrections of 3 deg by a true roll and pitch."""
    truth = random_state(7, foot(yaw_deg))
    estimate = with_error(truth, np.radians(3.0) * np.eye(15)[6])
    for _ in range(rounds):
        x, P = np.zeros(15), np.diag(np.repeat([1e-6, 1e-6, np.radians(1.0) ** 2, 1e-12, 1e-12], 3))
        z = wrap_angle(euler_angles(estimate.nav_R_body) - euler_angles(truth.nav_R_body))
        z = z if printed else axes_of_euler_errors(truth.nav_R_body) @ z
        for axis in (0, 1):
            row = np.zeros(15)
            row[TO_OURS] = rows(0)[axis]
            update_row(P, x, row, z[axis], np.radians(1.0) ** 2)
        inject_error(estimate, x)
    return np.degrees(np.linalg.norm(error_of(estimate, truth)[6:8]))


def test_tilt_converges_at_every_yaw_and_the_printed_rows_overturn_facing_west():
    """Positive feedback beyond a quarter of a turn."""
    for yaw_deg in (0.0, 60.0, 90.0, 120.0, 180.0):
        assert levelled_again_and_again(yaw_deg, printed=False) < 0.01
    assert levelled_again_and_again(0.0, printed=True) < 0.01
    assert levelled_again_and_again(180.0, printed=True, rounds=5) > 15.0
    assert levelled_again_and_again(120.0, printed=True, rounds=10) > 15.0


# AIEZ (26)-(28), (32): a zero in a curve, and angles that are not wrapped


def held_to_course(P, x, before, direction, **changed):
    """Update the error by the course of the footfall behind these (k,); returns whether it was used."""
    k, innovation = len(before), np.full(4, np.nan)
    pseudo = make_pseudo_measurements(k + 1)._replace(
        course_variance=np.full(k + 1, np.radians(2.0) ** 2), course_limit=float(np.radians(4.0)), **changed
    )
    given = pseudo, np.zeros(15), innovation, np.zeros((3, 32))
    update_at_footfall(random_state(9).nav_R_body, P, x, k, direction, before, *given)
    return np.isfinite(innovation[COURSE])


def test_zero_in_a_curve_reduces_the_variance_without_a_measurement():
    turns, sigma = np.radians(20.0) * np.arange(31), {}  # a curve all the way
    for as_printed in (False, True):
        P, x = np.eye(15), np.zeros(15)
        for k in range(1, 31):
            used = held_to_course(P, x, turns[:k], turns[k], course_strides=1, curve_is_zero=as_printed)
            assert used == as_printed
            assert not x.any()
        sigma[as_printed] = np.sqrt(P[ATTITUDE + 2, ATTITUDE + 2])
    assert sigma[False] == 1.0
    assert sigma[True] < np.radians(0.4)


def test_unwrapped_a_straight_walk_southward_is_a_curve():
    before, now, x = np.radians([179.0, -179.0, 178.5]), np.radians(-179.5), np.zeros(15)
    assert abs(now - before.mean()) > np.radians(4.0)
    assert held_to_course(np.eye(15), x, before, now, course_strides=3)
    # 1 deg clockwise of their mean, 179.5
    assert x[8] == pytest.approx(-np.radians(1.0), rel=0.01)
