"""The filter on walks whose truth is known, and its claims about itself."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection.rest import find_start
from fg_nav.detection.stance import Stances
from fg_nav.ekf import OPENSHOE, IezParameters, run_iez
from fg_nav.ekf.core import filter_walk
from fg_nav.errors import EstimationError
from fg_nav.evaluation import align, evaluate, fit_scale
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth
from tests.ekf.motion import Walk

WALK = Walk(strides=20, turn=0.1)
NORTH = yaw_rotation(np.pi / 2)  # With heading 0 the body's x axis points north; the walk's truth starts eastward.


def shaken(recording, seed=0, gyr_sigma=0.002, acc_sigma=0.02, gyro_bias=(0.0, 0.0, 0.0)):
    rng = np.random.default_rng(seed)
    gyr = recording.gyr + gyr_sigma * rng.standard_normal(recording.gyr.shape) + gyro_bias
    return replace(recording, gyr=gyr, acc=recording.acc + acc_sigma * rng.standard_normal(recording.acc.shape))


def test_a_clean_walk_is_found_again():
    recording, stances = WALK.recording()
    solution = run_iez(recording, stances)
    truth = WALK.position(recording.t) @ NORTH.T
    assert np.abs(solution.position - truth).max() < 0.02
    assert np.abs(solution.velocity - WALK.velocity(recording.t) @ NORTH.T).max() < 0.02
    off = NORTH @ WALK.attitude(recording.t) @ np.swapaxes(solution.nav_R_body, 1, 2)
    assert np.degrees(np.arccos((np.trace(off, axis1=1, axis2=2).min() - 1) / 2)) < 0.1
    assert len(solution.stances) == WALK.strides + 1


@pytest.mark.parametrize("heading", [0.5, -2.0, 3.0])
def test_the_initial_heading_turns_the_whole_walk(heading):
    recording, stances = WALK.recording()
    recording = shaken(recording)
    straight, turned = (run_iez(recording, stances, heading=angle) for angle in (0.0, heading))
    turn = yaw_rotation(-heading)  # clockwise from north
    assert compute_heading(turned.nav_R_body[0]) == pytest.approx(heading)
    np.testing.assert_allclose(turned.position, straight.position @ turn.T, atol=1e-6)
    np.testing.assert_allclose(turned.nav_R_body, turn @ straight.nav_R_body, atol=1e-6)
    np.testing.assert_allclose(turned.stances.position_cov, turn @ straight.stances.position_cov @ turn.T, atol=1e-6)


def test_a_sensor_mounted_any_way_gives_the_same_walk():
    recording, stances = WALK.recording()
    recording = shaken(recording)
    mount = np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]])
    tilted = replace(recording, acc=recording.acc @ mount.T, gyr=recording.gyr @ mount.T)
    a, b = (run_iez(r, stances).position for r in (recording, tilted))
    np.testing.assert_allclose(align(a, b).apply(a), b, atol=1e-4)


def test_a_wrong_start_is_corrected_by_the_stances():
    """A wrong sign anywhere between innovation and correction drives the tilt away instead."""
    recording, stances = WALK.recording()
    start = find_start(recording, stances)
    tilt = np.radians(2.0)
    c, s = np.cos(tilt), np.sin(tilt)
    for turn in (np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])):
        wrong = replace(start, nav_R_body=turn @ start.nav_R_body, levelled_at_rest=False)
        rows = stances.stillest(recording.gyr)
        track = filter_walk(recording, stances.mask, rows, wrong, IezParameters())
        up = track.nav_R_body[rows[-1]][2]
        assert np.degrees(np.arccos(min(up[2], 1.0))) < 0.1


def test_gyro_bias_is_taken_from_a_rest():
    recording, stances = WALK.recording()
    bias = np.radians([0.5, -0.4, 0.3])
    solution = run_iez(shaken(recording, gyro_bias=bias), stances)
    error = solution.stances.gyro_bias[-1] - bias
    assert np.all(np.abs(np.degrees(error)) < 0.06)
    assert np.all(np.abs(error) < 3 * solution.stances.gyro_bias_sigma[-1])
    assert solution.notes[0].startswith("gyro bias from a rest of 2")
    assert fit_scale(solution.position, WALK.position(recording.t)) == pytest.approx(1.0, abs=0.005)


def test_a_walk_that_begins_in_mid_swing_is_followed_backward_from_its_first_stance():
    recording, stances = WALK.recording()
    cut = int((WALK.rest_s + 0.3) * 200)
    part = recording.slice(cut, len(recording))
    solution = run_iez(part, Stances.from_mask(stances.mask[cut:]))
    truth = WALK.position(part.t)
    assert not stances.mask[cut]
    first = int(np.argmax(stances.mask[cut:]))
    ours = align(solution.position[first:], truth[first:]).apply(solution.position)
    assert np.abs(ours - truth)[:first].max() < 0.02
    assert np.linalg.norm(truth[0] - truth[first]) > 0.5
    assert solution.notes[0].startswith("no rest at the start")


def test_claims_do_not_hang_on_the_sampling_rate():
    sigmas = []
    for rate in (100.0, 400.0):
        recording, stances = WALK.recording(rate)
        table = run_iez(recording, stances).stances
        sigmas.append([*table.position_sigma[-1], table.heading_sigma[-1], *table.gyro_bias_sigma[-1]])
    np.testing.assert_allclose(sigmas[0], sigmas[1], rtol=0.1)


ROLLING = Walk(strides=20, turn=0.05, roll=-0.3, height=0.06, stance_s=0.5)


def test_a_rolling_foot_makes_plain_zero_velocity_short_and_its_height_mends_that():
    recording, stances = ROLLING.recording()
    truth = ROLLING.position(recording.t)
    plain = fit_scale(run_iez(recording, stances, OPENSHOE).position, truth)
    rolled = fit_scale(run_iez(recording, stances).position, truth)
    assert plain > 1.012
    assert rolled == pytest.approx(1.0, abs=0.003)


def test_a_clipped_gyroscope_hurts_little_and_its_samples_get_extra_noise():
    """The flat tops are found in the recording, the foot's peaks being cut by a tenth, and are rebuilt."""
    walk = Walk(strides=20, turn=0.1, pitch=1.2)
    recording, stances = walk.recording()
    limit = 0.9 * np.abs(recording.gyr).max()
    clipped = replace(recording, gyr=np.clip(shaken(recording).gyr, -limit, limit))
    truth = TrajectoryTruth(recording.t, walk.position(recording.t))
    aware, unaware = (run_iez(clipped, stances, IezParameters(saturated_share=share)) for share in (0.3, 0.0))
    assert evaluate(aware, truth).rmse_3d_m < 0.01
    assert np.all(aware.stances.position_sigma[-1] > unaware.stances.position_sigma[-1])


def test_samples_before_a_gap_get_extra_noise():
    """In a swing that nothing else in the recording is like, the extra variance covers the error of the gap."""
    recording, stances = replace(WALK, strides=1).recording()
    swing = int((WALK.rest_s + 0.25) * 200)
    keep = np.ones(len(recording), dtype=bool)
    keep[swing + 1 : swing + 15] = False
    holed = Recording(t=recording.t[keep], acc=recording.acc[keep], gyr=recording.gyr[keep])
    solution = run_iez(holed, Stances.from_mask(stances.mask[keep]))
    whole = run_iez(recording, stances)
    error = np.linalg.norm(solution.stances.position[1] - whole.stances.position[1])
    claims = [np.linalg.norm(s.stances.position_sigma[1]) for s in (solution, whole)]
    added = np.sqrt(claims[0] ** 2 - claims[1] ** 2)
    assert error > 0.005
    assert 0.6 * error < added < 2.5 * error


def test_what_cannot_be_navigated_is_said():
    recording, stances = WALK.recording()
    with pytest.raises(EstimationError, match="no stance to start from"):
        run_iez(recording, Stances.from_mask(np.zeros(len(recording), dtype=bool)))
    with pytest.raises(EstimationError, match=r"belong to \d+ samples and the recording has \d+"):
        run_iez(recording.slice(0, 1000), stances)
    with pytest.raises(EstimationError, match="there is no up: accelerations must include gravity"):
        run_iez(replace(recording, acc=recording.acc - [0.0, 0.0, 9.80665]), stances)
    with pytest.raises(EstimationError, match=r"diverged to infinity at 0\.005 s"):
        run_iez(recording, stances, IezParameters(gravity=np.inf))
