"""Each flagged equation of the filters: the printed form against ours, on states and rotations known without either."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.ekf.covariance import ATTITUDE
from fg_nav.ekf.measurements import COURSE, make_pseudo_measurements, update_at_footfall
from fg_nav.ekf.update import inject_error, update_row
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.mechanisation import strapdown
from tests.ekf.errors import error_of, random_state, with_error
from tests.ekf.printed import (
    TO_OURS,
    axes_of_euler_errors,
    cayley,
    euler_angles,
    ma_corrected,
    ma_rows,
    transition,
    zhang_corrected,
    zhang_rows,
)

GRAVITY = 9.81


def angle(rotation):
    return float(np.linalg.norm(Rotation.from_matrix(rotation).as_rotvec()))


def foot(yaw_deg, pitch_deg=10.0, roll_deg=5.0):
    return Rotation.from_euler("ZYX", [yaw_deg, pitch_deg, roll_deg], degrees=True).as_matrix()


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
    state, turn, push = random_state(np.random.default_rng(1)), np.empty((3, 3)), np.empty(3)
    state.nav_R_body[:] = np.eye(3)
    state.gyro_bias[:] = 0.0
    printed, rates = np.eye(3), 8.0 * np.sin(np.pi * (np.arange(50) + 0.5) / 50) ** 2
    for rate in rates:
        strapdown(state, np.zeros(3), np.array([0.0, 0.0, rate]), 0.01, GRAVITY, turn, push)
        printed = printed @ cayley(np.array([0.0, 0.0, rate * 0.01]))
    exact = Rotation.from_rotvec([0.0, 0.0, rates.sum() * 0.01]).as_matrix()
    assert angle(state.nav_R_body @ exact.T) < 1e-9
    assert angle(printed @ exact.T) == pytest.approx(((rates * 0.01) ** 3).sum() / 12, rel=0.01)


# Ma (31), AIEZ (2): the transition


@pytest.mark.parametrize("component", range(15))
def test_the_printed_transition_moves_estimate_minus_truth(component):
    """To first order in the period; a bias residual to take off is minus our estimate-minus-truth of a bias."""
    rng = np.random.default_rng(2)
    truth, h, step = random_state(rng), 1e-4, 1e-5
    acc, gyr = rng.standard_normal(3) * 5, rng.standard_normal(3)
    ours, papers = np.zeros(15), np.zeros(15)
    papers[component] = step
    ours[TO_OURS] = papers
    ours[9:] *= -1.0
    estimate, turn, push = with_error(truth, ours), np.empty((3, 3)), np.empty(3)
    expected = np.zeros(15)
    expected[TO_OURS] = transition(truth.nav_R_body, acc - truth.acc_bias, h) @ papers
    expected[9:] *= -1.0
    for state in (truth, estimate):
        strapdown(state, acc, gyr, h, GRAVITY, turn, push)
    moved = error_of(estimate, truth) - expected
    assert np.abs(moved).max() < 0.02 * h * step * max(1.0, np.linalg.norm(acc))


# Ma (36): H


def heading_slopes(yaw_deg, step=1e-6):
    """Derivative of Ma's dtheta, gyro's less that of the field, by the papers' dx: counter-clockwise as dphi is."""
    truth = random_state(np.random.default_rng(4))
    truth.nav_R_body[:] = foot(yaw_deg, 0.0, 0.0)
    slopes = np.empty(15)
    for component in range(15):
        error = np.zeros(15)
        error[TO_OURS[component]] = step
        turned = compute_heading(with_error(truth, error).nav_R_body) - compute_heading(truth.nav_R_body)
        slopes[component] = -wrap_angle(turned) / step
    return slopes


@pytest.mark.parametrize("yaw_deg", [0.0, 100.0, 179.9])
def test_a_heading_is_one_row_on_the_attitude_and_none_on_the_gyro_bias(yaw_deg):
    right = np.zeros(15)
    right[2] = 1.0
    np.testing.assert_allclose(heading_slopes(yaw_deg), right, atol=1e-6)
    printed = ma_rows()
    assert printed.shape == (6, 15)  # for a measurement of four numbers
    for row in printed[:3]:
        assert not row[:3].any()
        assert row @ right == 0.0


# Ma (38), (39), AIEZ (6), (7): injecting the error into the attitude


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 180.0])
def test_the_sign_of_zhang_takes_the_error_off_and_that_of_ma_doubles_it(yaw_deg):
    dphi = np.radians([0.1, -0.2, 0.1])
    truth = random_state(np.random.default_rng(6))
    truth.nav_R_body[:] = foot(yaw_deg)
    error, none = np.zeros(15), np.zeros(15)
    error[6:9] = dphi
    estimate = with_error(truth, error)
    ours = with_error(estimate, none)
    inject_error(ours, error.copy())
    assert angle(ours.nav_R_body @ truth.nav_R_body.T) < 1e-9
    assert angle(zhang_corrected(estimate.nav_R_body, dphi) @ truth.nav_R_body.T) < 1e-8
    without_period = ma_corrected(estimate.nav_R_body, dphi, 1.0)
    assert angle(without_period @ truth.nav_R_body.T) == pytest.approx(2 * np.linalg.norm(dphi), rel=1e-4)


def test_with_the_period_next_to_nothing_is_corrected():
    dphi, h = np.radians([0.1, -0.2, 0.1]), 1 / 400
    moved = ma_corrected(foot(30.0), dphi, h) @ foot(30.0).T
    assert angle(moved) == pytest.approx(h * np.linalg.norm(dphi), rel=1e-6)


# AIEZ (22), (29): errors of Euler angles


@pytest.mark.parametrize("yaw_deg", [0.0, 60.0, 90.0, 180.0])
def test_errors_of_euler_angles_turn_about_their_own_axes(yaw_deg):
    truth, step = foot(yaw_deg), 1e-6
    for component in range(3):
        turned = Rotation.from_rotvec(step * np.eye(3)[component]).as_matrix() @ truth
        errors = wrap_angle(euler_angles(turned) - euler_angles(truth))
        np.testing.assert_allclose(axes_of_euler_errors(truth) @ errors, step * np.eye(3)[component], atol=1e-9)


def levelled_again_and_again(yaw_deg, printed, rounds=20):
    """Tilt error (rad) left after so many corrections of 3 deg by a true roll and pitch."""
    truth = random_state(np.random.default_rng(7))
    truth.nav_R_body[:] = foot(yaw_deg)
    error = np.zeros(15)
    error[6:8] = np.radians([3.0, 0.0])
    estimate = with_error(truth, error)
    for _ in range(rounds):
        x, P = np.zeros(15), np.diag(np.repeat([1e-6, 1e-6, np.radians(1.0) ** 2, 1e-12, 1e-12], 3))
        z = wrap_angle(euler_angles(estimate.nav_R_body) - euler_angles(truth.nav_R_body))
        z = z if printed else axes_of_euler_errors(truth.nav_R_body) @ z
        for axis in (0, 1):
            row = np.zeros(15)
            row[TO_OURS] = zhang_rows()[axis]
            update_row(P, x, row, z[axis], np.radians(1.0) ** 2)
        inject_error(estimate, x)
    return float(np.linalg.norm(error_of(estimate, truth)[6:8]))


@pytest.mark.parametrize("yaw_deg", [0.0, 60.0, 90.0, 120.0, 180.0])
def test_tilt_converges_at_every_yaw(yaw_deg):
    assert levelled_again_and_again(yaw_deg, printed=False) < np.radians(0.01)


def test_the_printed_rows_level_facing_east_and_overturn_facing_west():
    """Positive feedback beyond a quarter of a turn."""
    assert levelled_again_and_again(0.0, printed=True) < np.radians(0.01)
    assert levelled_again_and_again(180.0, printed=True, rounds=5) > np.radians(15.0)
    assert levelled_again_and_again(120.0, printed=True, rounds=10) > np.radians(15.0)


def update_at(estimate, P, x, pseudo, before=(), k=0, direction=0.0):
    innovation, headings = np.full(4, np.nan), np.array(before, dtype=float)
    given = pseudo, np.zeros(15), innovation, np.zeros((3, 32))
    update_at_footfall(estimate.nav_R_body, P, x, k, direction, headings, *given)
    return innovation


# AIEZ (28), (32): zero in a curve


def test_zero_in_a_curve_reduces_the_variance_without_a_measurement():
    turns = np.radians(20.0) * np.arange(31)  # a curve all the way
    sigma = {}
    for as_printed in (False, True):
        pseudo = make_pseudo_measurements(31)._replace(
            course_variance=np.full(31, np.radians(2.0) ** 2),
            course_limit=float(np.radians(4.0)),
            course_strides=1,
            curve_is_zero=as_printed,
        )
        estimate, P, x = random_state(np.random.default_rng(9)), np.eye(15), np.zeros(15)
        for k in range(1, 31):
            innovation = update_at(estimate, P, x, pseudo, turns[:k], k, turns[k])
            assert np.isfinite(innovation[COURSE]) == as_printed
            assert not x.any()
        sigma[as_printed] = np.sqrt(P[ATTITUDE + 2, ATTITUDE + 2])
    assert sigma[False] == 1.0
    assert sigma[True] < np.radians(0.4)


# AIEZ (26), (27): angles are wrapped


def test_unwrapped_a_straight_walk_southward_is_a_curve():
    before, now = np.radians([179.0, -179.0, 178.5]), np.radians(-179.5)
    assert abs(now - before.mean()) > np.radians(4.0)
    pseudo = make_pseudo_measurements(4)._replace(
        course_variance=np.full(4, np.radians(2.0) ** 2), course_limit=float(np.radians(4.0)), course_strides=3
    )
    x = np.zeros(15)
    update_at(random_state(np.random.default_rng(10)), np.eye(15), x, pseudo, before, 3, now)
    # 1 deg clockwise of their mean, 179.5
    assert x[8] == pytest.approx(-np.radians(1.0), rel=0.01)
