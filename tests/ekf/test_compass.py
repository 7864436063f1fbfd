"""Filters with a gated compass, and AIEZ, on walks in closed form: a drifting gyro; a field that is right, or moves.

And the equations as printed that do not do what they are meant to, on states known without either. Errors are estimate
minus truth, in the order of Ma (29), dx = (dphi, dw, dr, dv, da), three each. What is printed, and must stand there:

================= ======================================= ===========================================================
Ma (27)           Cayley: (2 I + W h) / (2 I - W h)       right to third order: 8e-5 rad off at 0.1 rad a sample. Exp
Ma (31), AIEZ (2) the transition                          right with these errors and a residual bias, first order
Ma (36)           H = rows (0 I 0 0 0), (0 0 0 I 0)       heading row (0, 0, 1) on dphi; printed, it is the gyro bias
Ma (38)           (2 I + Theta h) / (2 I - Theta h)       dphi is an angle: no h, or a 1/h of it is never removed
Ma (39)           Theta = +[dphi]                         -[dphi], as AIEZ (7): else the error doubles
AIEZ (22), (29)   errors of roll, pitch, yaw are dphi     dphi = Rz(yaw) Ry(pitch) e_x droll + Rz(yaw) e_y dpitch + ...
AIEZ (28), (32)   in a curve z = 0 with sigma_HDR         no row: zero is a measurement, and shrinks P
================= ======================================= ===========================================================

The transition, the heading row and the sign are in `test_model`, the compass's own misprints in
`tests.magnetic.test_footfall_field`. No filter runs any of these but AIEZ (28), in the preset as-printed. Angles about
z are counter-clockwise, z up.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection.rest import find_start
from fg_nav.ekf.compass import compute_steadiness, find_first_heading, make_aiez_measurements, run_with_compass
from fg_nav.ekf.core import IezParameters, filter_walk, propagate_considered, run_iez
from fg_nav.ekf.covariance import ATTITUDE
from fg_nav.ekf.measurements import COURSE, make_pseudo_measurements, update_at_footfall
from fg_nav.ekf.presets import AS_PRINTED, GATED, PHYSICAL, RTS, find_parameters, run_filter
from fg_nav.ekf.update import inject_error, update_row
from fg_nav.errors import EstimationError
from fg_nav.frames import wrap_angle
from fg_nav.magnetic import average_footfall_field
from fg_nav.magnetic.detectors import DETECTORS, scale_detector
from fg_nav.mechanisation import NavState, cross_matrix, strapdown
from tests.ekf.motion import STRAIGHT, error_of, off_deg, random_state, walked, with_error

DRIFT = {"gyro_bias_deg_s": 0.2, "from_s": 3.0}  # Not seen in the rest at the start: 12 deg at the end.
MA, OWN = find_parameters("ma2018", PHYSICAL), find_parameters("aiez", PHYSICAL)
PARAMETERS = replace(OWN, compass_sigma_deg=5.0, course_sigma_deg=2.0)  # Sure enough of both to show in a minute.
NO_COURSE = replace(PARAMETERS, course_limit_deg=-1.0)


def solved(recording, stances, field, headings, parameters=PARAMETERS, method="aiez"):
    return run_with_compass(recording, stances, field, parameters, float(headings[0]), method)


def words_of(solution, after_s):
    """Verdicts on the field before and after a time."""
    words, after = np.array(solution.stances.field), solution.stances.t > after_s
    return set(words[~after]), set(words[after])


def magnet(t):
    """40 deg wrong from 20 s on, for good."""
    return np.where(t > 20.0, 40.0, 0.0)


@pytest.mark.parametrize("method", [*GATED, "aiez"])
def test_a_right_compass_holds_a_drifting_gyro(method):
    recording, stances, field, headings = walked(STRAIGHT, **DRIFT)
    own = NO_COURSE if method == "aiez" else find_parameters(method, PHYSICAL)
    drifted = off_deg(run_iez(recording, stances, heading=float(headings[0])), headings)[-1]
    solution = solved(recording, stances, field, headings, own, method)
    assert abs(drifted) > 8.0
    assert abs(off_deg(solution, headings)[-1]) < (3.0 if method == "aiez" else 0.5 * abs(drifted))
    assert method != "aiez" or set(solution.stances.field) == {"quasi-static"}
    with pytest.raises(EstimationError, match=f"{method} needs a magnetometer.*iez"):
        solved(recording, stances, None, headings, own, method)


def test_without_a_heading_and_an_accepted_footfall_it_is_the_iez_turned_with_its_sigma():
    """On a foot that rolls and a force that is off, whose stances would reduce the variance of an unknown heading."""
    nothing_passes = replace(MA, detector=scale_detector(MA.detector, 1e-9))
    recording, stances, _, _ = walked(replace(STRAIGHT, strides=20, turn=0.1, roll=0.3, height=0.1))
    off = 0.5 * np.random.default_rng(2).standard_normal(recording.acc.shape)
    recording = replace(recording, acc=recording.acc + off)
    field = average_footfall_field(recording, stances)
    solution = run_with_compass(recording, stances, field, nothing_passes)
    plain = run_iez(recording, stances, heading=find_first_heading(field))
    assert "quasi-static" not in solution.stances.field
    np.testing.assert_allclose(solution.position, plain.position, atol=1e-9)
    start_sigma = np.radians(nothing_passes.start_sigma_deg)
    sigma = np.hypot(plain.stances.heading_sigma, start_sigma)
    np.testing.assert_allclose(solution.stances.heading_sigma, sigma, rtol=1e-3)
    considered = np.sqrt(np.trace(solution.stances.position_cov[-1, :2, :2]))
    assert considered == pytest.approx(np.linalg.norm(plain.stances.position[-1, :2]) * start_sigma, rel=0.05)


@pytest.mark.parametrize("name", ["qsf-stance", "aiez"])
@pytest.mark.parametrize("back", ["", RTS])
def test_the_compass_that_gave_the_start_is_not_used_a_second_time(name, back):
    recording, stances, _, _ = walked(replace(STRAIGHT, strides=4))
    sigmas, parameters = [], find_parameters(name, PHYSICAL)
    for known in (1, 2):
        mag = np.where((recording.t < 2.0 + known - 0.8)[:, None], recording.mag, np.nan)
        seen = replace(recording, mag=mag)
        field = average_footfall_field(seen, stances)
        assert np.isfinite(field.strength).sum() == known
        solution = run_filter(name + back, PHYSICAL, seen, stances, field, None)
        assert solution.stances.field[0] == ("none" if name == "aiez" else "quasi-static")
        sigmas.append(np.degrees(solution.stances.heading_sigma[-1]))
    start = parameters.start_sigma_deg
    assert sigmas[0] == pytest.approx(start, abs=0.2)
    assert sigmas[1] == pytest.approx(1 / np.hypot(1 / start, 1 / parameters.compass_sigma_deg), abs=0.3)


def test_a_compass_accepted_late_turns_the_walk_about_its_start():
    wild = lambda t: np.where(t < 2.3, 15.0, 15.0 + 40.0 * (np.floor(t - 0.3) % 2))  # noqa: E731
    recording, stances, field, headings = walked(STRAIGHT, lambda t: np.where(t < 20.3, wild(t), 0.0))
    solution = run_with_compass(recording, stances, field, replace(MA, compass_sigma_deg=3.0))
    assert "quasi-static" not in words_of(solution, 20.0)[0]
    off = np.abs(off_deg(solution, headings))
    assert off[recording.t < 19.0].min() > 10.0
    assert off[-1] < 2.0
    end = STRAIGHT.position(recording.t[-1:])[0] - STRAIGHT.position(np.zeros(1))[0]
    assert np.linalg.norm(solution.position[-1] - end) < 0.05 * np.linalg.norm(end)


def test_declination_turns_what_the_compass_says():
    recording, stances, field, headings = walked(STRAIGHT, lambda t: np.full(len(t), 7.0))
    for heading in (None, float(headings[0])):
        solution = run_with_compass(recording, stances, field, replace(MA, declination_deg=7.0), heading)
        assert np.abs(off_deg(solution, headings)).max() < 0.3  # from the start


def test_a_field_that_turns_is_left_out_and_one_that_stays_turned_is_accepted():
    """What tests on changes cannot see: Ma's filter follows a lasting deviation, as the paper's would."""
    recording, stances, field, headings = walked(STRAIGHT, lambda t: np.where(t > 20.0, 25.0, 0.0))
    solution = solved(recording, stances, field, headings, MA, "ma2018")
    words, at = np.array(solution.stances.field), solution.stances.t
    just_after = (at > 20.0) & (at < 22.0)
    assert set(words[just_after]) == {"disturbed"}
    assert set(words[at > 26.0]) == {"quasi-static"}
    off = off_deg(solution, headings)
    assert abs(off[recording.t < 22.0]).max() < 1.0
    assert off[-1] < -10.0


def test_a_considered_heading_turns_the_walk_about_its_start():
    """Against a walk that is turned: an estimate a rad too far to the left is R(a) truth, in every component."""
    truth, a = random_state(5), 1e-6
    turn = Rotation.from_rotvec([0.0, 0.0, a]).as_matrix()
    turned = NavState(turn @ truth.position, turn @ truth.velocity, turn @ truth.nav_R_body, *truth[3:])
    considered = a * np.eye(15)[8]
    propagate_considered(considered, truth)
    np.testing.assert_allclose(considered, error_of(turned, truth), atol=a * 1e-5)
    assert np.abs(considered[[0, 1, 3, 4]]).min() > 0.05 * a


def test_position_and_heading_covary_as_a_walk_with_another_start_heading():
    """Nothing used of the field: the covariance of a considered start heading is the derivative by it, squared."""
    recording, stances, _, headings = walked(replace(STRAIGHT, strides=20, turn=0.1))
    rows, step, sigma = stances.stillest(recording.gyr), np.radians(0.1), np.radians(20.0)

    def run(heading, start_sigma=0.0):
        start = find_start(recording, stances, float(headings[0]) + heading)
        return filter_walk(recording, stances.mask, rows, start, IezParameters(), start_sigma=start_sigma)

    # a heading is clockwise, the error about up counter-clockwise
    slope = (run(-step).position - run(step).position)[rows, :2] / (2 * step)
    added = run(0.0, sigma).covariance - run(0.0).covariance
    np.testing.assert_allclose(added[:, :2, 8], sigma**2 * slope, rtol=1e-3, atol=1e-3 * sigma**2)
    np.testing.assert_allclose(added[:, 8, 8], sigma**2)
    assert np.abs(slope[-1]).min() > 5.0


# AIEZ: which of compass and course it takes, and what each does


def test_a_field_that_is_steadily_wrong_is_refused_for_good_and_one_whose_strength_changes_though_it_points_north():
    """What a test on changes accepts after three strides (AIEZ, Figure 6); and 5 deg off north, which alone pass."""
    recording, stances, field, headings = walked(STRAIGHT, magnet)
    solution = solved(recording, stances, field, headings)
    assert words_of(solution, 20.0) == ({"quasi-static"}, {"disturbed"})
    assert np.abs(off_deg(solution, headings)).max() < 1.0
    recording, stances, _, headings = walked(STRAIGHT, lambda t: np.where(t > 20.0, 5.0, 0.0))
    stronger = replace(recording, mag=recording.mag * (1.0 + 0.2 * np.maximum(recording.t - 20.0, 0.0))[:, None])
    solution = solved(stronger, stances, average_footfall_field(stronger, stances), headings)
    assert words_of(solution, 20.0) == ({"quasi-static"}, {"disturbed"})
    assert np.abs(off_deg(solution, headings)).max() < 1.0


def test_tilt_course_and_compass_are_measured_with_the_sigmas_of_the_parameters():
    _, _, field, _ = walked(replace(STRAIGHT, strides=3))
    used = make_aiez_measurements(field, np.zeros(len(field)), replace(PARAMETERS, tilt_sigma_deg=0.7))
    for variance, sigma_deg in ((used.tilt_variance, 0.7), (used.course_variance, 2.0), (used.compass_variance, 5.0)):
        np.testing.assert_allclose(np.degrees(np.sqrt(variance)), sigma_deg)
    changing = replace(field, strength_rate=field.strength_rate + 1.5, strength_rate_sigma=np.full(len(field), 0.2))
    np.testing.assert_allclose(compute_steadiness(changing, OWN.detector), 1.5**2 / (0.5**2 + 0.2**2))


def test_where_the_compass_is_refused_a_straight_course_holds_the_gyro():
    given = walked(STRAIGHT, magnet, gyro_bias_deg_s=0.1, from_s=20.0)
    held, free = (solved(*given, parameters) for parameters in (PARAMETERS, NO_COURSE))
    for solution, said in ((held, True), (free, False)):
        assert any("held to the course" in reason for reason in solution.stances.field_reason) == said
    off = [abs(off_deg(solution, given[3])[-1]) for solution in (held, free)]
    assert off[0] < 0.8 * off[1]


def test_of_a_slow_bend_a_part_is_bent_back_and_of_a_curve_nothing():
    """What HDR costs by design: a bend of less than xi over the n strides is a straight line to it."""
    as_printed = replace(PARAMETERS, course_limit_deg=5.0, course_sigma_deg=1.0, hdr_as_printed=True)
    for turn_deg, parameters, least, most in (
        (0.6, OWN, 0.1, 0.2),
        (0.6, PARAMETERS, 0.2, 0.4),
        (0.6, as_printed, 0.4, 1.0),
        (1.0, PARAMETERS, -0.002, 0.002),
        (5.0, PARAMETERS, -0.0003, 0.0003),
    ):  # how much of a bend of sixty strides without a compass the filter takes for drift
        given = walked(replace(STRAIGHT, turn=float(np.radians(turn_deg))), lambda t: np.full(len(t), 40.0))
        share = off_deg(solved(*given, parameters), given[3])[-1] / (60 * turn_deg)
        assert least < share < most


def test_the_sensor_is_levelled_by_the_force():
    """With stances that say nothing of velocity a gyro biased about the foot's left would tip it over."""
    recording, stances, field, headings = walked(STRAIGHT)
    biased = replace(recording, gyr=recording.gyr + np.outer(recording.t > 3.0, np.radians([0.0, 0.3, 0.0])))
    blind, tips = replace(PARAMETERS.inertial, zero_velocity_density=1e3, roll_sigma_m=0.0), []
    for sigma in (1.0, 1e6):
        parameters = replace(PARAMETERS, inertial=blind, tilt_sigma_deg=sigma)
        solution = solved(biased, stances, field, headings, parameters)
        at = solution.stances.sample[-1]
        true_up = STRAIGHT.attitude(recording.t[[at]])[0, 2]
        tips.append(np.degrees(np.arccos(np.clip(solution.nav_R_body[at, 2] @ true_up, -1.0, 1.0))))
    assert tips[0] < 1.5
    assert tips[1] > 4.0


def test_as_printed_the_compass_stays_locked_out_once_the_gyro_has_drifted():
    """40 deg of drift while a magnet hid the field: AIEZ (17) does not count the filter's own variance."""
    hidden = lambda t: np.where((t > 10.3) & (t < 40.3), -120.0, 0.0)  # noqa: E731
    given = walked(STRAIGHT, hidden, gyro_bias_deg_s=1.6, from_s=10.0)
    drifting = replace(PARAMETERS.inertial, gyr_density_deg=4.0)
    for preset, word in ((PHYSICAL, "quasi-static"), (AS_PRINTED, "disturbed")):
        own = find_parameters("aiez", preset)
        parameters = replace(own, inertial=drifting, course_limit_deg=-1.0, hdr_as_printed=False)
        assert set(solved(*given, parameters).stances.field[-15:]) == {word}


@pytest.mark.parametrize("detector", ["qsf", "ma2018", "qsf-stance"])
def test_a_detector_that_does_not_test_the_heading_is_refused(detector):
    given = walked(replace(STRAIGHT, strides=3))
    with pytest.raises(EstimationError, match=f"'{detector}' does not test the heading"):
        solved(*given, replace(PARAMETERS, detector=DETECTORS[detector]))


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


def levelled_again_and_again(yaw_deg, printed, rounds=20):
    """Tilt error (deg) left after so many corrections of 3 deg by a true roll and pitch, or by the filter's up."""
    truth = random_state(7, Rotation.from_euler("ZYX", [yaw_deg, 10.0, 5.0], degrees=True).as_matrix())
    estimate = with_error(truth, np.radians(np.eye(15)[ATTITUDE : ATTITUDE + 2].T @ [3.0, 1.0]))
    pseudo = make_pseudo_measurements(1)._replace(
        body_force=9.81 * truth.nav_R_body[[2]], tilt_variance=np.full(1, np.radians(1.0) ** 2)
    )
    for _ in range(rounds):
        x, P = np.zeros(15), np.diag(np.repeat([1e-6, 1e-6, np.radians(1.0) ** 2, 1e-12, 1e-12], 3))
        z = wrap_angle(euler_angles(estimate.nav_R_body) - euler_angles(truth.nav_R_body))
        for axis in (0, 1) if printed else ():
            update_row(P, x, np.eye(15)[ATTITUDE + axis], z[axis], np.radians(1.0) ** 2)
        if not printed:
            given = pseudo, np.zeros(15), np.full(4, np.nan), np.zeros((3, 32))
            update_at_footfall(estimate.nav_R_body, P, x, 0, 0.0, np.zeros(0), *given)
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
