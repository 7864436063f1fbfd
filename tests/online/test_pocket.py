"""A walk in progress with the sensor in a trouser pocket, against the batch, its truth, and itself in other pieces."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.evaluation import evaluate
from fg_nav.frames import yaw_rotation
from fg_nav.io import write_canonical
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.estimates import Revision, StanceEstimate, format_estimate
from fg_nav.online.pocket import PocketNavigator
from fg_nav.pocket.dead_reckoning import MOUNTING_SIGMA_DEG, STEP_HEADING_SIGMA_DEG, StepLength, reckon_path
from fg_nav.pocket.navigate import choose_start
from fg_nav.pocket.steps import estimate_swing, find_steps

EAST = OnlineOptions(heading_rad=np.pi / 2, mount="pocket")
COMPASS = OnlineOptions(heading_rad=None, mount="pocket")


@pytest.fixture(scope="module")
def recording():
    """Half a minute of corridors, in the pocket."""
    return simulate("demo", 103, Choices(worn="pocket", rate_hz=100.0)).recording.slice(0, 3500)


def push(navigator, rows, block=64):
    """The lines of rows that come in blocks."""
    found = []
    for start in range(0, len(rows), block):
        found += navigator.add_rows(rows[start : start + block])
    return found


def walk(recording, options=COMPASS, block=64):
    """The navigator of a walk, and what it told."""
    navigator = PocketNavigator(options)
    told = push(navigator, rows_of(recording), block) + navigator.close()
    return navigator, [one for one in told if isinstance(one, StanceEstimate)]


def lines(told):
    return [format_estimate(one, continues=False) for one in told if isinstance(one, StanceEstimate)]


@pytest.fixture(scope="module")
def walked(recording):
    return walk(recording)


@pytest.fixture(scope="module")
def forward(recording):
    """Steps, and their path by the orientation forward, of the whole recording."""
    track = follow_pocket(recording, start=choose_start(recording, None)[0])
    swing = estimate_swing(recording, track, with_force=False)
    steps = find_steps(recording.t, swing.flexion, swing.up_now)
    return steps, reckon_path(track, swing, steps, StepLength())


def test_it_has_the_steps_of_the_batch_and_ends_near_the_filter_forward(recording, walked, forward):
    (navigator, told), (steps, path) = walked, forward
    found = navigator.finish()
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
        assert lines(walk(recording, block=block)[1]) == lines(walked[1])
    navigator, told, late = PocketNavigator(COMPASS), [], []
    for row in rows_of(recording):
        new = [one for one in navigator.add_rows(row[None]) if isinstance(one, StanceEstimate)]
        told, late = [*told, *new], [*late, *(row[0] - one.t for one in new)]
    assert lines(told) == lines(walked[1])[: len(told)]
    assert max(late[2:]) < 1.0  # a line within two steps; the first two wait until three steps are a walk


def test_the_heading_that_is_given_is_that_of_the_first_strides(recording):
    navigator, told = walk(recording, EAST)
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
    rows = rows_of(recording)
    navigator = PocketNavigator(COMPASS)
    told = [one for one in push(navigator, rows[~lost]) + navigator.close() if isinstance(one, StanceEstimate)]
    before = [one for one in told if one.t < 14.0]
    after = [one for one in told if one.t > 17.0]
    sigma = [float(np.sqrt(np.trace(one.pose_cov[:2, :2]))) for one in (before[-1], after[0])]
    assert sigma[1] > sigma[0] + 3.0
    truth = {one.sample: one for one in walked[1]}
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
    navigator = PocketNavigator(COMPASS)
    told = push(navigator, rows) + navigator.close()
    first = next(one for one in told if isinstance(one, StanceEstimate) and one.number == 2)
    turned = [one for one in told[told.index(first) :] if isinstance(one, Revision)]
    assert turned
    now = navigator.smoothed().position[2]
    by_turns = yaw_rotation(-sum(one.turn for one in turned)) @ first.position
    assert np.linalg.norm(by_turns - now) < 0.03 * np.linalg.norm(now)
    assert np.linalg.norm(first.position - now) > 0.1 * np.linalg.norm(now)
    np.testing.assert_allclose(turned[-1].path[:2, 1:3], navigator.smoothed().position[:2, :2], atol=0.2)


def test_a_stream_prints_and_writes_what_a_recording_run_online_does(fg_nav, recording, tmp_path):
    write_canonical(recording, tmp_path / "walk.csv")
    words = ("--mount", "pocket", "--step-constant", 0.8, "--polish")
    ran = fg_nav("stream", tmp_path / "walk.csv", "--silence", 0.3, *words)
    assert ran.code == 0, ran.err
    kinds = [json.loads(line) for line in ran.out.splitlines()]
    rows = {kind: [one for one in kinds if one["kind"] == kind] for kind in ("now", "smoothed", "polished")}
    assert len(rows["now"]) == len(rows["smoothed"]) > 10
    for one in rows.values():
        assert [line["stance"] for line in one] == list(range(len(one)))
        assert one[0].keys() <= rows["now"][0].keys()
    now, smoothed = rows["now"][-1], rows["smoothed"][-1]
    assert now["heading_deg"] == pytest.approx(smoothed["heading_deg"], abs=2.0)
    folders = {name: tmp_path / name for name in ("stream", "run")}
    assert fg_nav("stream", tmp_path / "walk.csv", "--silence", 0.3, *words, "--out", folders["stream"]).code == 0
    assert fg_nav("run", tmp_path / "walk.csv", "--method", "online", *words, "--out", folders["run"]).code == 0
    ends = [np.loadtxt(folder / "trajectory.tum")[-1, 1:4] for folder in folders.values()]
    assert np.linalg.norm(ends[0] - ends[1]) < 0.3  # a recording's magnetometer is aligned before
    assert (folders["stream"] / "online.csv").exists()
    words = ("--mount", "pocket", "--step-constant", 5)
    assert fg_nav("stream", tmp_path / "walk.csv", *words).refused("no person's")
