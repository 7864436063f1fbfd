"""A walk in progress with the sensor in a trouser pocket, against the batch, its truth, and itself in other pieces."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.evaluation import evaluate
from fg_nav.frames import yaw_rotation
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.estimates import format_estimate
from fg_nav.online.pocket import PocketNavigator
from fg_nav.online.record import GivenLines
from fg_nav.pocket.dead_reckoning import MOUNTING_SIGMA_DEG, STEP_HEADING_SIGMA_DEG, StepLength, reckon_path
from fg_nav.pocket.navigate import choose_start
from fg_nav.pocket.steps import estimate_swing, find_steps
from tests.online.walks import estimates_of, revisions_of

EAST = OnlineOptions(heading_rad=np.pi / 2, mount="pocket")
COMPASS = OnlineOptions(heading_rad=None, mount="pocket")


@pytest.fixture(scope="module")
def recording():
    return simulate("demo", 103, Choices(worn="pocket", rate_hz=100.0)).recording.slice(0, 3500)


def walk(rows, options=COMPASS, block=64):
    navigator, told = PocketNavigator(options), []
    for start in range(0, len(rows), block):
        told += navigator.add_rows(rows[start : start + block])
    return navigator, told + navigator.close()


def lines(told):
    return [format_estimate(one, continues=False) for one in estimates_of(told)]


@pytest.fixture(scope="module")
def walked(recording):
    return walk(rows_of(recording))


def test_it_has_the_steps_of_the_batch_and_ends_near_the_filter_forward(recording, walked):
    track = follow_pocket(recording, start=choose_start(recording, None)[0])
    swing = estimate_swing(recording, track, with_force=False)
    steps = find_steps(recording.t, swing.flexion, swing.up_now)
    path, found, told = reckon_path(track, swing, steps, StepLength()), walked[0].finish(), estimates_of(walked[1])
    rows = np.append(steps.start[steps.strides], steps.stop[-1])
    assert np.abs(found.stances.sample - rows).max() <= 2
    at, first = np.unique(recording.t[path.sample], return_index=True)
    position = np.stack([np.interp(found.stances.t, at, axis) for axis in path.position[first].T], axis=1)
    off = np.linalg.norm(found.stances.position - position, axis=1)  # it learns of a node up to a block later
    assert off.max() < 0.01 * path.length.sum()
    assert evaluate(found).distance_m == pytest.approx(path.length.sum(), rel=5e-3)
    moved = np.array([one.position for one in told]) - found.stances.position
    sigma = np.sqrt([np.diagonal(one.pose_cov)[:2] for one in told])
    assert (np.abs(moved[1:, :2]) < 2.0 * sigma[1:]).all()


def test_nothing_depends_on_the_blocks(recording, walked):
    for block in (33, len(recording)):
        assert lines(walk(rows_of(recording), block=block)[1]) == lines(walked[1])
    navigator, told, late = PocketNavigator(COMPASS), [], []
    for row in rows_of(recording):
        new = estimates_of(navigator.add_rows(row[None]))
        told, late = [*told, *new], [*late, *(row[0] - one.t for one in new)]
    assert lines(told) == lines(walked[1])[: len(told)]
    assert max(late[2:]) < 1.0  # a line within two steps; the first two wait until three steps are a walk


def test_the_heading_that_is_given_is_that_of_the_first_strides(recording):
    navigator, told = walk(rows_of(recording), EAST)
    told = estimates_of(told)
    assert told[2].position[0] > 1.5
    assert abs(told[2].position[1]) < 0.3
    found = navigator.finish()
    assert found.stances.position[2, 0] > 1.5
    assert np.degrees(told[0].pose_cov[3, 3] ** 0.5) < 10.0
    # the mounting's sigma, and the direction of each of two steps on its own, are independent of each other
    least = np.radians(np.hypot(MOUNTING_SIGMA_DEG, STEP_HEADING_SIGMA_DEG / np.sqrt(2.0)))
    assert least**2 < told[0].pose_cov[3, 3] < least**2 + np.radians(3.0) ** 2


def test_a_gap_widens_the_sigmas_and_the_walk_goes_on(recording, walked):
    lost = (recording.t > 14.0) & (recording.t < 17.0)
    navigator, told = walk(rows_of(recording)[~lost])
    told = estimates_of(told)
    before, after = [one for one in told if one.t < 14.0], [one for one in told if one.t > 17.0]
    sigma = [float(np.sqrt(np.trace(one.pose_cov[:2, :2]))) for one in (before[-1], after[0])]
    assert sigma[1] > sigma[0] + 3.0
    truth = {one.sample: one for one in estimates_of(walked[1])}
    same = [one for one in after if one.sample + int(lost.sum()) in truth]
    assert len(same) > 4
    for one in same:
        off = one.position - truth[one.sample + int(lost.sum())].position
        assert np.linalg.norm(off[:2]) < 2.0 * np.sqrt(np.trace(one.pose_cov[:2, :2]))
    assert len(navigator.finish().stances) == len(told)


def test_a_path_that_turns_with_the_axes_of_the_thigh_says_so(recording):
    """The first strides swing about another axis: a sensor that then slipped by 50 deg about the thigh."""
    force = recording.acc[:200].mean(axis=0)  # standing
    turn = Rotation.from_rotvec(np.radians(50.0) * force / np.linalg.norm(force)).as_matrix()
    slipped = recording.t < 11.0
    rows = rows_of(recording)
    for part in (slice(1, 4), slice(4, 7), slice(7, 10)):
        rows[slipped, part] = rows[slipped, part] @ turn.T
    navigator, told = walk(rows)
    first = estimates_of(told)[2]
    turned = revisions_of(told[told.index(first) :])
    assert turned
    now = navigator.smoothed().position[2]
    by_turns = yaw_rotation(-sum(one.turn for one in turned)) @ first.position
    assert np.linalg.norm(by_turns - now) < 0.03 * np.linalg.norm(now)
    assert np.linalg.norm(first.position - now) > 0.1 * np.linalg.norm(now)
    np.testing.assert_allclose(turned[-1].path[:2, 1:3], navigator.smoothed().position[:2, :2], atol=0.2)


def test_lines_of_a_walk_whose_samples_do_not_come_again_are_taken_back(walked):
    given = [replace(one, number=k) for k, one in enumerate(estimates_of(walked[1])[:4])]
    navigator = PocketNavigator(COMPASS)
    navigator.resume(GivenLines(given, given, [False] * 4, [0.0] * 4, {2}))
    (revision,) = navigator.end_replay()
    assert revision.retracted == tuple((one.number, one.t) for one in given if one.number != 2)
