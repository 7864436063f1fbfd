"""A walk in progress with the sensor in a trouser pocket, against the batch, its truth, and itself in other pieces."""

import json
from dataclasses import replace

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
from fg_nav.pocket.dead_reckoning import StepLength, reckon_path
from fg_nav.pocket.navigate import choose_start
from fg_nav.pocket.online import OnlinePocket
from fg_nav.pocket.steps import Openings, estimate_swing, find_steps
from fg_nav.pocket.track import PocketStart

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


def test_it_finds_the_steps_of_the_batch(walked, forward):
    steps, _ = forward
    found = walked[0].finish()
    assert len(found.stances) == len(steps.strides) + 1
    rows = np.append(steps.start[steps.strides], steps.stop[-1])
    assert np.abs(found.stances.sample - rows).max() <= 2


def test_its_end_is_near_the_filter_forward(recording, walked, forward):
    found, path = walked[0].finish(), forward[1]
    at, first = np.unique(recording.t[path.sample], return_index=True)
    position = np.stack([np.interp(found.stances.t, at, axis) for axis in path.position[first].T], axis=1)
    off = np.linalg.norm(found.stances.position - position, axis=1)  # it learns of a node up to a block later
    assert off.max() < 0.01 * path.length.sum()
    assert evaluate(found).distance_m == pytest.approx(path.length.sum(), rel=5e-3)


def test_a_stride_is_told_soon_and_within_its_sigmas_of_the_end(walked):
    navigator, told = walked
    table = navigator.finish().stances
    assert len(told) == len(table)
    off = np.array([one.position for one in told]) - table.position
    sigma = np.sqrt([np.diagonal(one.pose_cov)[:2] for one in told])
    assert (np.abs(off[1:, :2]) < 2.0 * sigma[1:]).all()


def test_nothing_depends_on_the_blocks(recording, walked):
    for block in (1, 33, len(recording)):
        assert lines(walk(recording, block=block)[1]) == lines(walked[1])


def test_a_line_comes_within_two_steps(recording):
    navigator, late = PocketNavigator(COMPASS), []
    for row in rows_of(recording):
        late += [row[0] - one.t for one in navigator.add_rows(row[None]) if isinstance(one, StanceEstimate)]
    assert max(late[2:]) < 1.0  # the first two wait until three steps are a walk


def test_the_heading_that_is_given_is_that_of_the_first_strides(recording):
    navigator, told = walk(recording, EAST)
    assert told[2].position[0] > 1.5
    assert abs(told[2].position[1]) < 0.3
    found = navigator.finish()
    assert found.stances.position[2, 0] > 1.5
    assert np.degrees(told[0].pose_cov[3, 3] ** 0.5) < 10.0


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


def test_without_a_magnetometer_the_field_is_unknown(recording):
    navigator, told = walk(replace(recording, mag=None))
    assert {one.field for one in told} == {"none"}
    assert any("unknown" in note for note in navigator.finish().notes)


def test_a_path_that_turns_with_the_axes_of_the_thigh_says_so(recording):
    """The first strides swing about another axis: a sensor that then slipped by 50 deg about the thigh."""
    turn = Rotation.from_rotvec(np.radians(50.0) * up_of(recording)).as_matrix()
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


def up_of(recording):
    """Direction of up in the body while it stands."""
    force = recording.acc[:200].mean(axis=0)
    return force / np.linalg.norm(force)


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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--mount", "pocket", "--lag", 60), ("--lag", "foot")),
        (("--mount", "pocket", "--gate", "aiez"), ("--gate", "foot")),
        (("--step-constant", 0.8), ("--step-constant", "--mount pocket")),
        (("--mount", "pocket", "--step-constant", 5), ("no person's",)),
    ],
)
def test_options_of_another_mount_are_refused(fg_nav, tmp_path, words, said):
    (tmp_path / "walk.csv").write_text("")
    assert fg_nav("stream", tmp_path / "walk.csv", *words).refused(*said)


@pytest.mark.parametrize("fronts", ["---++", "+++----", "+-+-+-"])
def test_lines_stay_in_order_where_front_and_back_are_exchanged(fronts):
    """Between bouts of three steps, of which one front makes one stride and the other two: none twice, none lost."""
    thigh = OnlinePocket(PocketStart(np.eye(3), 0.1), 0.01)
    told = []
    for bout, front in enumerate(fronts):
        turn = 1000 * bout + 50 * np.arange(4)
        sample = np.stack([turn[:-1], turn[:-1] + 5, turn[1:] - 5, turn[1:]], axis=1)
        swept = np.array([1.0, -1.0, 1.0])
        new = Openings(sample, 0.01 * sample, np.abs(swept), swept, np.ones(3, dtype=np.bool_))
        thigh._openings = Openings(*(np.concatenate(pair) for pair in zip(thigh._openings, new, strict=True)))
        many = np.broadcast_to(np.eye(3), (3 * (bout + 1), 2, 3, 3))
        thigh._moments = thigh._moments._replace(t=thigh._openings.t[:, [0, 3]], nav_R_body=many)
        thigh._front = 1.0 if front == "+" else -1.0
        ends = thigh._end_strides()
        assert ends[-1].steps == 3 * (bout + 1)
        told += ends
    assert told[0].steps == 0
    assert (np.diff([end.steps for end in told]) > 0).all()
    assert (np.diff([end.t for end in told]) > 0.0).all()
