"""The filter on walks whose truth is known, its claims about itself, and its figures on real ones."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection.rest import find_start
from fg_nav.detection.stance import Stances
from fg_nav.ekf import OPENSHOE, IezParameters, run_iez
from fg_nav.ekf.core import filter_walk
from fg_nav.errors import EstimationError
from fg_nav.evaluation import align, evaluate, fit_scale
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.io import read
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.lab.pyshoe import read_pyshoe_labels
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth
from tests.ekf.motion import Walk
from tests.real_data import DATA, needs_data

WALK = Walk(strides=20, turn=0.1)
NORTH = yaw_rotation(np.pi / 2)  # With heading 0 the body's x axis points north; the walk's truth starts eastward.


@pytest.fixture(scope="module")
def clean():
    return WALK.recording()


def shaken(recording, gyro_bias=(0.0, 0.0, 0.0)):
    rng = np.random.default_rng(0)
    gyr = recording.gyr + 0.002 * rng.standard_normal(recording.gyr.shape) + gyro_bias
    return replace(recording, gyr=gyr, acc=recording.acc + 0.02 * rng.standard_normal(recording.acc.shape))


def test_a_clean_walk_is_found_again(clean):
    recording, stances = clean
    solution = run_iez(recording, stances)
    assert np.abs(solution.position - WALK.position(recording.t) @ NORTH.T).max() < 0.02
    assert np.abs(solution.velocity - WALK.velocity(recording.t) @ NORTH.T).max() < 0.02
    off = Rotation.from_matrix(NORTH @ WALK.attitude(recording.t) @ np.swapaxes(solution.nav_R_body, 1, 2))
    assert np.degrees(off.magnitude().max()) < 0.1
    assert len(solution.stances) == WALK.strides + 1


@pytest.mark.parametrize("heading", [0.5, -2.0, 3.0])
def test_the_initial_heading_turns_the_whole_walk(clean, heading):
    recording, stances = shaken(clean[0]), clean[1]
    straight, turned = (run_iez(recording, stances, heading=angle) for angle in (0.0, heading))
    turn = yaw_rotation(-heading)  # clockwise from north
    assert compute_heading(turned.nav_R_body[0]) == pytest.approx(heading)
    np.testing.assert_allclose(turned.position, straight.position @ turn.T, atol=1e-6)
    np.testing.assert_allclose(turned.nav_R_body, turn @ straight.nav_R_body, atol=1e-6)
    np.testing.assert_allclose(turned.stances.position_cov, turn @ straight.stances.position_cov @ turn.T, atol=1e-6)


def test_a_sensor_mounted_any_way_gives_the_same_walk(clean):
    recording, mount = shaken(clean[0]), np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]])
    tilted = replace(recording, acc=recording.acc @ mount.T, gyr=recording.gyr @ mount.T)
    a, b = (run_iez(r, clean[1]).position for r in (recording, tilted))
    np.testing.assert_allclose(align(a, b).apply(a), b, atol=1e-4)


def test_a_wrong_start_is_corrected_by_the_stances(clean):
    """A wrong sign anywhere between innovation and correction drives the tilt away instead."""
    recording, stances = clean
    start, rows = find_start(recording, stances), stances.stillest(recording.gyr)
    for axis in "xy":
        turn = Rotation.from_euler(axis, 2.0, degrees=True).as_matrix()
        wrong = replace(start, nav_R_body=turn @ start.nav_R_body, levelled_at_rest=False)
        track = filter_walk(recording, stances.mask, rows, wrong, IezParameters())
        assert np.degrees(np.arccos(min(track.nav_R_body[rows[-1]][2, 2], 1.0))) < 0.1


def test_gyro_bias_is_taken_from_a_rest(clean):
    recording, stances = clean
    bias = np.radians([0.5, -0.4, 0.3])
    solution = run_iez(shaken(recording, gyro_bias=bias), stances)
    error = np.abs(solution.stances.gyro_bias[-1] - bias)
    assert np.all(np.degrees(error) < 0.06)
    assert np.all(error < 3 * solution.stances.gyro_bias_sigma[-1])
    assert solution.notes[0].startswith("gyro bias from a rest of 2")
    assert fit_scale(solution.position, WALK.position(recording.t)) == pytest.approx(1.0, abs=0.005)


def test_a_walk_that_begins_in_mid_swing_is_followed_backward_from_its_first_stance(clean):
    recording, stances = clean
    cut = int((WALK.rest_s + 0.3) * 200)
    part, mask = recording.slice(cut, len(recording)), stances.mask[cut:]
    solution, truth, first = run_iez(part, Stances.from_mask(mask)), WALK.position(part.t), int(np.argmax(mask))
    assert first > 0
    ours = align(solution.position[first:], truth[first:]).apply(solution.position)
    assert np.abs(ours - truth)[:first].max() < 0.02
    assert np.linalg.norm(truth[0] - truth[first]) > 0.5
    assert solution.notes[0].startswith("no rest at the start")


def test_claims_do_not_hang_on_the_sampling_rate():
    tables = [run_iez(*WALK.recording(rate)).stances for rate in (100.0, 400.0)]
    one, other = ([*t.position_sigma[-1], t.heading_sigma[-1], *t.gyro_bias_sigma[-1]] for t in tables)
    np.testing.assert_allclose(one, other, rtol=0.1)


def test_a_rolling_foot_makes_plain_zero_velocity_short_and_its_height_mends_that():
    walk = Walk(strides=20, turn=0.05, roll=-0.3, height=0.06, stance_s=0.5)
    recording, stances = walk.recording()
    plain, rolled = (run_iez(recording, stances, parameters) for parameters in (OPENSHOE, IezParameters()))
    truth = walk.position(recording.t)
    assert fit_scale(plain.position, truth) > 1.012
    assert fit_scale(rolled.position, truth) == pytest.approx(1.0, abs=0.003)


def test_a_clipped_gyroscope_hurts_little_and_its_samples_get_extra_noise():
    """The flat tops are found in the recording, the foot's peaks being cut by a tenth, and are rebuilt."""
    walk = replace(WALK, pitch=1.2)
    recording, stances = walk.recording()
    limit = 0.9 * np.abs(recording.gyr).max()
    clipped = replace(recording, gyr=np.clip(shaken(recording).gyr, -limit, limit))
    aware, unaware = (run_iez(clipped, stances, IezParameters(saturated_share=share)) for share in (0.3, 0.0))
    assert evaluate(aware, TrajectoryTruth(recording.t, walk.position(recording.t))).rmse_3d_m < 0.01
    assert np.all(aware.stances.position_sigma[-1] > unaware.stances.position_sigma[-1])


def test_samples_before_a_gap_get_extra_noise():
    """In a swing that nothing else in the recording is like, the extra variance covers the error of the gap."""
    recording, stances = replace(WALK, strides=1).recording()
    swing = int((WALK.rest_s + 0.25) * 200)
    keep = np.delete(np.arange(len(recording)), range(swing + 1, swing + 15))
    holed = Recording(t=recording.t[keep], acc=recording.acc[keep], gyr=recording.gyr[keep])
    tables = run_iez(holed, Stances.from_mask(stances.mask[keep])).stances, run_iez(recording, stances).stances
    error = np.linalg.norm(tables[0].position[1] - tables[1].position[1])
    claims = [np.linalg.norm(table.position_sigma[1]) for table in tables]
    assert error > 0.005
    assert 0.6 * error < np.sqrt(claims[0] ** 2 - claims[1] ** 2) < 2.5 * error


def test_what_cannot_be_navigated_is_said(clean):
    recording, stances = clean
    weightless = replace(recording, acc=recording.acc - [0.0, 0.0, 9.80665])
    for arguments, words in (
        ((recording, Stances.from_mask(0 * stances.mask > 0)), "no stance to start from"),
        ((recording.slice(0, 1000), stances), r"belong to \d+ samples and the recording has \d+"),
        ((weightless, stances), "there is no up: accelerations must include gravity"),
        ((recording, stances, IezParameters(gravity=np.inf)), r"diverged to infinity at 0\.005 s"),
    ):
        with pytest.raises(EstimationError, match=words):
            run_iez(*arguments)


@needs_data
def test_real_walks_are_no_worse_than_pyshoe_s_and_the_claimed_sigmas_mean_something():
    """Against the rmse in m, horizontal and in space, of PyShoe's own EKF on these trials with the same labels."""
    rows = []
    for path in sorted((DATA / "vicon").glob("*.mat")):
        recording = read(path)
        solution = run_iez(recording, Stances.from_mask(read_pyshoe_labels(path, "shoe")))
        metrics = evaluate(solution, recording.truth)
        nees = compute_stance_nees(solution.stances, recording.truth).median_ratio
        rows.append((metrics.rmse_2d_m, metrics.rmse_3d_m, metrics.scale, nees))
    rmse, median = np.array(rows)[:, :2], np.median(rows, axis=0)
    assert len(rows) == 28
    assert np.all(rmse.mean(axis=0) <= (0.079, 0.131))
    assert np.all(median[:2] <= (0.055, 0.087))
    assert 0.6 < median[3] < 1.6
    assert median[2] == pytest.approx(1.0, abs=0.015)
