"""AIEZ on walks in closed form: which of compass and course it takes, and what each does."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.ekf.compass import make_aiez_measurements, run_with_compass
from fg_nav.ekf.core import run_iez
from fg_nav.ekf.presets import AS_PRINTED, PHYSICAL, find_parameters
from fg_nav.errors import EstimationError
from fg_nav.magnetic import average_footfall_field
from fg_nav.magnetic.detectors import DETECTORS
from tests.ekf.field_walks import STRAIGHT, off_deg, walked

DRIFT = {"gyro_bias_deg_s": 0.2, "from_s": 3.0}
OWN = find_parameters("aiez", PHYSICAL)
PARAMETERS = replace(OWN, compass_sigma_deg=5.0, course_sigma_deg=2.0)  # Sure enough of both to show in a minute.


def solved(recording, stances, field, headings, parameters=PARAMETERS):
    return run_with_compass(recording, stances, field, parameters, float(headings[0]), "aiez")


def magnet(t):
    """40 deg wrong from 20 s on, for good."""
    return np.where(t > 20.0, 40.0, 0.0)


def test_a_right_compass_holds_a_drifting_gyro():
    recording, stances, field, headings = walked(STRAIGHT, **DRIFT)
    solution = solved(recording, stances, field, headings, replace(PARAMETERS, course_limit_deg=-1.0))
    assert set(solution.stances.field) == {"quasi-static"}
    assert abs(off_deg(solution, headings)[-1]) < 3.0
    assert abs(off_deg(run_iez(recording, stances, heading=float(headings[0])), headings)[-1]) > 8.0


def test_a_field_that_is_steadily_wrong_is_refused_for_good():
    """What a test on changes accepts after three strides (AIEZ, Figure 6)."""
    recording, stances, field, headings = walked(STRAIGHT, magnet)
    solution = solved(recording, stances, field, headings)
    words = np.array(solution.stances.field)
    assert (words[solution.stances.t > 20.0] == "disturbed").all()
    assert (words[solution.stances.t < 20.0] == "quasi-static").all()
    assert np.abs(off_deg(solution, headings)).max() < 1.0


def test_a_field_whose_strength_changes_in_a_stance_is_refused_though_it_points_north():
    recording, stances, _, headings = walked(STRAIGHT)
    stronger = replace(recording, mag=recording.mag * (1.0 + 0.2 * np.maximum(recording.t - 20.0, 0.0))[:, None])
    table = solved(stronger, stances, average_footfall_field(stronger, stances), headings).stances
    words, after = np.array(table.field), table.t > 20.0
    assert (words[after] == "disturbed").all()
    assert (words[~after] == "quasi-static").all()


def test_tilt_course_and_compass_are_measured_with_the_sigmas_of_the_parameters():
    _, _, field, _ = walked(replace(STRAIGHT, strides=3))
    used = make_aiez_measurements(field, np.zeros(len(field)), replace(PARAMETERS, tilt_sigma_deg=0.7))
    for variance, sigma_deg in ((used.tilt_variance, 0.7), (used.course_variance, 2.0), (used.compass_variance, 5.0)):
        np.testing.assert_allclose(np.degrees(np.sqrt(variance)), sigma_deg)


def test_where_the_compass_is_refused_a_straight_course_holds_the_gyro():
    recording, stances, field, headings = walked(STRAIGHT, magnet, gyro_bias_deg_s=0.1, from_s=20.0)
    with_course = solved(recording, stances, field, headings)
    without = solved(recording, stances, field, headings, replace(PARAMETERS, course_limit_deg=-1.0))
    assert any("held to the course" in reason for reason in with_course.stances.field_reason)
    assert not any("held to the course" in reason for reason in without.stances.field_reason)
    assert abs(off_deg(with_course, headings)[-1]) < 0.8 * abs(off_deg(without, headings)[-1])


def bent_back_deg(turn_deg, parameters=PARAMETERS):
    """How much of a bend of sixty strides without a compass the filter takes for drift."""
    walk = replace(STRAIGHT, turn=float(np.radians(turn_deg)))
    recording, stances, field, headings = walked(walk, lambda t: np.full(len(t), 40.0))
    return float(off_deg(solved(recording, stances, field, headings, parameters), headings)[-1])


def test_of_a_slow_bend_a_part_is_bent_back_and_of_a_curve_nothing():
    """What HDR costs by design: a bend of less than xi over the n strides is a straight line to it."""
    assert 60 * 0.6 * 0.1 < bent_back_deg(0.6, OWN) < 60 * 0.6 * 0.2
    assert 60 * 0.6 * 0.2 < bent_back_deg(0.6) < 60 * 0.6 * 0.4
    assert abs(bent_back_deg(1.0)) < 0.1
    assert abs(bent_back_deg(5.0)) < 0.1
    as_printed = replace(PARAMETERS, course_limit_deg=5.0, course_sigma_deg=1.0, hdr_as_printed=True)
    assert bent_back_deg(0.6, as_printed) > 60 * 0.6 * 0.4


def test_the_sensor_is_levelled_by_the_force():
    """With stances that say nothing of velocity a gyro biased about the foot's left would tip it over."""
    recording, stances, field, headings = walked(STRAIGHT)
    biased = replace(recording, gyr=recording.gyr + np.outer(recording.t > 3.0, np.radians([0.0, 0.3, 0.0])))
    blind = replace(PARAMETERS.inertial, zero_velocity_density=1e3, roll_sigma_m=0.0)
    tips = {}
    for sigma in (1.0, 1e6):
        parameters = replace(PARAMETERS, inertial=blind, tilt_sigma_deg=sigma)
        solution = solved(biased, stances, field, headings, parameters)
        at = solution.stances.sample[-1]
        true_up = STRAIGHT.attitude(recording.t[[at]])[0, 2]
        tips[sigma] = np.degrees(np.arccos(np.clip(solution.nav_R_body[at, 2] @ true_up, -1.0, 1.0)))
    assert tips[1.0] < 1.5
    assert tips[1e6] > 4.0


def test_as_printed_the_compass_stays_locked_out_once_the_gyro_has_drifted():
    """40 deg of drift while a magnet hid the field: AIEZ (17) does not count the filter's own variance."""
    hidden = lambda t: np.where((t > 10.3) & (t < 40.3), -120.0, 0.0)  # noqa: E731
    recording, stances, field, headings = walked(STRAIGHT, hidden, gyro_bias_deg_s=1.6, from_s=10.0)
    drifting = replace(PARAMETERS.inertial, gyr_density_deg=4.0)
    found = {}
    for preset in (PHYSICAL, AS_PRINTED):
        own = find_parameters("aiez", preset)
        parameters = replace(own, inertial=drifting, course_limit_deg=-1.0, hdr_as_printed=False)
        words = np.array(solved(recording, stances, field, headings, parameters).stances.field)
        found[preset] = (words[-15:] == "quasi-static").mean()
    assert found[PHYSICAL] == 1.0
    assert found[AS_PRINTED] == 0.0


@pytest.mark.parametrize("detector", ["qsf", "ma2018", "qsf-stance"])
def test_a_detector_that_does_not_test_the_heading_is_refused(detector):
    recording, stances, field, headings = walked(replace(STRAIGHT, strides=3))
    with pytest.raises(EstimationError, match=f"'{detector}' does not test the heading"):
        solved(recording, stances, field, headings, replace(PARAMETERS, detector=DETECTORS[detector]))


def test_without_a_magnetometer_it_says_what_to_take():
    recording, stances, _, headings = walked(replace(STRAIGHT, strides=3))
    with pytest.raises(EstimationError, match="aiez needs a magnetometer"):
        solved(recording, stances, None, headings)
