"""Filters with a gated compass on walks in closed form: a drifting gyro, a field that is right, wrong, or moves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection.rest import find_start
from fg_nav.ekf.compass import find_first_heading, run_with_compass
from fg_nav.ekf.core import IezParameters, filter_walk, propagate_considered, run_iez
from fg_nav.ekf.presets import GATED, PHYSICAL, RTS, find_parameters, run_filter
from fg_nav.errors import EstimationError
from fg_nav.magnetic import average_footfall_field
from fg_nav.magnetic.detectors import scale_detector
from fg_nav.mechanisation import NavState
from tests.ekf.errors import error_of, random_state
from tests.ekf.field_walks import STRAIGHT, off_deg, walked

DRIFT = {"gyro_bias_deg_s": 0.2, "from_s": 3.0}  # Not seen in the rest at the start: 12 deg at the end.


def solved(method, recording, stances, field, heading):
    return run_with_compass(recording, stances, field, find_parameters(method, PHYSICAL), heading, method)


@pytest.mark.parametrize("method", GATED)
def test_a_right_compass_holds_a_drifting_gyro(method):
    recording, stances, field, headings = walked(STRAIGHT, **DRIFT)
    drifted = off_deg(run_iez(recording, stances, heading=float(headings[0])), headings)
    held = off_deg(solved(method, recording, stances, field, float(headings[0])), headings)
    assert abs(drifted[-1]) > 8.0
    assert abs(held[-1]) < 0.5 * abs(drifted[-1])


NOTHING_PASSES = replace(
    find_parameters("ma2018", PHYSICAL), detector=scale_detector(find_parameters("ma2018", PHYSICAL).detector, 1e-9)
)


def test_without_a_heading_and_an_accepted_footfall_it_is_the_iez_turned_with_its_sigma():
    """On a foot that rolls and a force that is off, whose stances would reduce the variance of an unknown heading."""
    walk = replace(STRAIGHT, strides=20, turn=0.1, roll=0.3, height=0.1)
    recording, stances, _, _ = walked(walk)
    rng = np.random.default_rng(2)
    recording = replace(recording, acc=recording.acc + 0.5 * rng.standard_normal(recording.acc.shape))
    field = average_footfall_field(recording, stances)
    solution = run_with_compass(recording, stances, field, NOTHING_PASSES)
    plain = run_iez(recording, stances, heading=find_first_heading(field))
    assert "quasi-static" not in solution.stances.field
    np.testing.assert_allclose(solution.position, plain.position, atol=1e-9)
    sigma = np.hypot(plain.stances.heading_sigma, np.radians(NOTHING_PASSES.start_sigma_deg))
    np.testing.assert_allclose(solution.stances.heading_sigma, sigma, rtol=1e-3)
    considered = np.sqrt(np.trace(solution.stances.position_cov[-1, :2, :2]))
    at_start = np.linalg.norm(plain.stances.position[-1, :2]) * np.radians(NOTHING_PASSES.start_sigma_deg)
    assert considered == pytest.approx(at_start, rel=0.05)


@pytest.mark.parametrize("name", ["qsf-stance", "aiez"])
@pytest.mark.parametrize("back", ["", RTS])
def test_the_compass_that_gave_the_start_is_not_used_a_second_time(name, back):
    """Of one footfall with a field the heading stays as unsure as a start is; of two it is surer."""
    recording, stances, _, _ = walked(replace(STRAIGHT, strides=4))
    sigmas = []
    for known in (1, 2):
        mag = np.where((recording.t < 2.0 + known - 0.8)[:, None], recording.mag, np.nan)
        seen = replace(recording, mag=mag)
        field = average_footfall_field(seen, stances)
        assert np.isfinite(field.strength).sum() == known
        solution = run_filter(name + back, PHYSICAL, seen, stances, field, None)
        assert solution.stances.field[0] == ("none" if name == "aiez" else "quasi-static")
        sigmas.append(np.degrees(solution.stances.heading_sigma[-1]))
    parameters = find_parameters(name, PHYSICAL)
    start = parameters.start_sigma_deg
    assert sigmas[0] == pytest.approx(start, abs=0.2)
    assert sigmas[1] == pytest.approx(1 / np.hypot(1 / start, 1 / parameters.compass_sigma_deg), abs=0.3)


def test_a_compass_accepted_late_turns_the_walk_about_its_start():
    """The first footfalls' field is 15 deg off and moves too much to be used."""
    wild = lambda t: np.where(t < 2.3, 15.0, 15.0 + 40.0 * (np.floor(t - 0.3) % 2))  # noqa: E731
    recording, stances, field, headings = walked(STRAIGHT, lambda t: np.where(t < 20.3, wild(t), 0.0))
    parameters = replace(find_parameters("ma2018", PHYSICAL), compass_sigma_deg=3.0)
    solution = run_with_compass(recording, stances, field, parameters)
    words, at = np.array(solution.stances.field), solution.stances.t
    assert "quasi-static" not in words[at < 20.0]
    assert abs(off_deg(solution, headings)[recording.t < 19.0]).min() > 10.0
    assert abs(off_deg(solution, headings)[-1]) < 2.0
    end = STRAIGHT.position(recording.t[-1:])[0] - STRAIGHT.position(np.zeros(1))[0]
    assert np.linalg.norm(solution.position[-1] - end) < 0.05 * np.linalg.norm(end)


def test_declination_turns_what_the_compass_says():
    recording, stances, field, headings = walked(STRAIGHT, lambda t: np.full(len(t), 7.0))
    parameters = replace(find_parameters("ma2018", PHYSICAL), declination_deg=7.0)
    for heading in (None, float(headings[0])):
        solution = run_with_compass(recording, stances, field, parameters, heading)
        assert abs(off_deg(solution, headings)[-1]) < 0.3


def test_a_field_that_turns_is_left_out_and_one_that_stays_turned_is_accepted():
    """What tests on changes cannot see: Ma's filter follows a lasting deviation, as the paper's would."""
    recording, stances, field, headings = walked(STRAIGHT, lambda t: np.where(t > 20.0, 25.0, 0.0))
    solution = solved("ma2018", recording, stances, field, float(headings[0]))
    words = np.array(solution.stances.field)
    at = solution.stances.t
    just_after = (at > 20.0) & (at < 22.9)
    assert just_after.any()
    assert (words[just_after] == "disturbed").all()
    assert (words[at > 26.0] == "quasi-static").all()
    off = off_deg(solution, headings)
    assert abs(off[recording.t < 22.0]).max() < 1.0
    assert off[-1] < -10.0


@pytest.mark.parametrize("method", GATED)
def test_without_a_magnetometer_it_says_what_to_take(method):
    recording, stances, _, _ = walked(replace(STRAIGHT, strides=3))
    with pytest.raises(EstimationError, match=f"{method} needs a magnetometer.*iez"):
        solved(method, recording, stances, None, 0.0)


def test_a_considered_heading_turns_the_walk_about_its_start():
    """Against a walk that is turned: an estimate a rad too far to the left is R(a) truth, in every component."""
    rng, a = np.random.default_rng(5), 1e-6
    truth = random_state(rng)
    turn = Rotation.from_rotvec([0.0, 0.0, a]).as_matrix()
    turned = NavState(turn @ truth.position, turn @ truth.velocity, turn @ truth.nav_R_body, *truth[3:])
    considered = np.zeros(15)
    considered[8] = a
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

    certain, considered = run(0.0), run(0.0, sigma)
    # a heading is clockwise, the error about up counter-clockwise
    slope = (run(-step).position - run(step).position)[rows, :2] / (2 * step)
    added = considered.covariance - certain.covariance
    np.testing.assert_allclose(added[:, :2, 8], sigma**2 * slope, rtol=1e-3, atol=1e-3 * sigma**2)
    np.testing.assert_allclose(added[:, 8, 8], sigma**2)
    assert np.abs(slope[-1]).min() > 5.0
