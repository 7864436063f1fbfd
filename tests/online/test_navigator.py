"""A walk in progress: blocks do not matter, odd samples and losses are survived, and it ends where its samples do."""

from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.errors import DetectionError, EstimationError, FgNavError
from fg_nav.estimators import METHODS
from fg_nav.evaluation.metrics import measure_gap
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.magnetic import average_footfall_field
from fg_nav.online import OnlineNavigator
from fg_nav.online import navigator as navigator_module
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.navigator import finish_walk
from fg_nav.online.strides import agrees, find_stride_fixes
from fg_nav.recording import Recording
from fg_nav.samples.intake import MAX_CLOCK_STEP_S, UNKNOWN_GAP_S, Intake
from fg_nav.smoother import smooth
from fg_nav.smoother.constraints import pin_to_times
from fg_nav.solution import StanceTable
from fg_nav.truth import Fix
from fg_nav.walk import Options, Walk
from tests.online.walks import (
    NORTH,
    estimates_of,
    in_earth_field,
    push,
    revisions_of,
    short_walk,
    spoil,
    walked,
    whole_walk,
    worst_difference,
)
from tests.simulated import corridor
from tests.smoother.test_fixes import demo, errors, fixes_at, truth_from_start, with_fixes


def test_blocks_do_not_matter():
    rows = rows_of(short_walk())
    navigator, _ = walked(rows, cuts=range(1, len(rows)))
    assert worst_difference(navigator.causal(), whole_walk()[0].causal()) < 1e-9
    assert worst_difference(navigator.smoothed(), whole_walk()[0].smoothed()) < 1e-9


def test_it_ends_with_what_its_graph_has_and_polished_with_the_batch():
    navigator, recording = whole_walk()[0], short_walk()
    stances = detect_stances(recording)
    batch = smooth(recording, stances, heading=0.0, field=average_footfall_field(recording, stances))
    found, smoothed = finish_walk(navigator, polish=True), navigator.smoothed()
    assert set(found.stances.sample) <= set(smoothed.sample)
    np.testing.assert_allclose(found.position[smoothed.sample], smoothed.position, atol=1e-9)
    np.testing.assert_allclose(found.nav_R_body[smoothed.sample], smoothed.nav_R_body, atol=1e-9)
    assert len(found.moment) == len(found.stances) == stances.n_footfalls
    # between two nodes it is strapdown: no step at a node, and the velocity is the path's derivative
    steps = np.diff(found.position, axis=0) / np.diff(found.t)[:, None]
    assert np.abs(steps - 0.5 * (found.velocity[1:] + found.velocity[:-1])).max() < 0.05
    # further pieces of a long standing are footfalls of the graph, whose field counts with the first
    counts, weight = found.graph, found.stances.compass_weight
    assert len(smoothed) > len(weight)
    assert counts["magnetic_heading"] == np.count_nonzero(weight) > 0
    assert counts["magnetic_heading"] + counts["gated_out"] == len(weight)
    np.testing.assert_allclose(found.polished.position, batch.position, atol=1e-9)
    gap = measure_gap(found, found.polished)
    assert 1e-6 < gap.rms_m < gap.max_m < 0.1
    assert gap.heading_deg < 0.5
    assert finish_walk(navigator, polish=False).polished is None


def test_a_walk_without_a_batch_solution_still_ends(monkeypatch):
    """Polished without its field, if that helps; else with a note."""
    navigator, error = whole_walk()[0], EstimationError("it does not converge.")
    with monkeypatch.context() as patched:
        spoil(patched, navigator_module, "smooth", lambda number, *given: given[5] is not None, error)
        without = navigator.polish()
    assert any("does not converge" in note for note in without.notes)
    assert set(without.stances.field) == {"none"}
    spoil(monkeypatch, navigator_module, "smooth", lambda number, *given: True, error)
    found = finish_walk(navigator, polish=True)
    assert len(found.t) == len(short_walk())
    assert found.polished is None
    assert any("no batch solution: it does not converge" in note for note in found.notes)


def test_between_footfalls_the_pose_is_carried_on():
    """In mid-swing it is where the whole walk has the foot then, to what a second of strapdown loses."""
    recording = short_walk()
    rows, stances = rows_of(recording), detect_stances(recording)
    batch = smooth(recording, stances, heading=0.0)
    navigator, begin = OnlineNavigator(NORTH), 0
    assert navigator.pose() is None
    for k in range(5, 10):
        stop = int(stances.stop[k] + stances.start[k + 1]) // 2
        push(navigator, rows[begin:stop])
        begin, pose = stop, navigator.pose()
        assert pose.t == [recording.t[stop - 1]]
        assert np.linalg.norm(pose.velocity) > 1.0
        assert np.linalg.norm(pose.position[0] - batch.position[stop - 1]) < 0.15
        assert np.degrees(np.arccos((np.trace(pose.nav_R_body[0].T @ batch.nav_R_body[stop - 1]) - 1) / 2)) < 5.0
    push(navigator, np.repeat(rows[stop : stop + 1], 1500, axis=0) + 0.01 * np.arange(1500)[:, None] * np.eye(11)[0])
    assert np.isfinite(navigator.pose().position).all()
    assert np.linalg.norm(navigator.pose().velocity) < 1.0


# --- odd samples -----------------------------------------------------------------------------------------------------


def spoiled(kind):
    """Rows of the walk with something odd in their middle."""
    rows, rng = rows_of(short_walk()), np.random.default_rng(3)
    middle = len(rows) // 2
    if kind == "missing":
        rows[middle : middle + 5, 4:7] = np.nan
        rows[rng.integers(0, len(rows), 2), 2] = np.nan
    elif kind == "repeated":
        rows = np.repeat(rows, np.where(np.arange(len(rows)) % 50 == 7, 2, 1), axis=0)
    elif kind == "backward":
        rows = np.concatenate([rows[:middle], rows[middle - 40 : middle - 10], rows[middle:]])
    elif kind == "ahead":
        rows = np.insert(rows, middle, rows[middle] + np.eye(11)[0] * 1e6, axis=0)
    elif kind == "gap":
        rows = np.delete(rows, np.s_[middle : middle + 150], axis=0)
    elif kind == "restart":
        rows[middle:, 0] -= rows[middle, 0]
    return rows


@pytest.mark.parametrize("kind", ["missing", "repeated", "backward", "ahead", "gap", "restart"])
def test_odd_samples_are_left_out_counted_and_reported_once(kind):
    rows, told = spoiled(kind), list[str]()
    count = {"repeated": len(rows) // 51, "backward": 30, "ahead": 1}.get(kind)
    navigator, found = walked(rows, remark=told.append, cuts=range(7, len(rows), 7))
    counts, found = navigator.intake.counts, estimates_of(found)
    assert counts[kind] >= 1
    assert len(told) == sum(number > 0 for number in counts.values())
    assert any(str(counts[kind]) in note for note in navigator.intake.notes)
    assert np.isfinite([e.position for e in found]).all()
    if count is not None:
        assert abs(counts[kind] - count) <= 1
        assert np.abs(found[-1].position - whole_walk()[1][-1].position).max() < 1e-9
    if kind == "gap":
        with_gap, without = (np.linalg.norm(n.causal().position_sigma[-1]) for n in (navigator, whole_walk()[0]))
        assert with_gap > 3 * without
    if kind == "restart":  # stamps go on, and those of the sensor are found again
        t, table = rows_of(short_walk())[:, 0], navigator.smoothed()
        assert 3 < np.searchsorted(table.sample, len(rows) // 2) < len(table) - 3
        sensor_t = [navigator.intake.sensor_time(one) for one in table.t.tolist()]
        for one, expected in ((table.t, t[table.sample]), (sensor_t, rows[table.sample, 0]), (navigator.finish().t, t)):
            np.testing.assert_allclose(one, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("step_s", "taken_s"), [(9.9, 9.91), (7200.0, 7200.01), (1.7e9, UNKNOWN_GAP_S)])
def test_a_gap_keeps_its_length_unless_the_clock_was_set_and_then_it_is_said_by_how_much(step_s, taken_s):
    rows, told = rows_of(short_walk()).copy(), list[str]()
    rows[700:, 0] += step_s
    judge = Intake(told.append)
    taken = judge.push(rows)
    assert taken[700, 0] - taken[699, 0] == pytest.approx(taken_s)
    sensor_t = [judge.sensor_time(t) for t in taken[:, 0].tolist()]
    np.testing.assert_allclose(sensor_t, rows[:, 0], rtol=1e-15, atol=1e-9)
    for said in (told, judge.notes):
        was_set = any(f"set back by {step_s + 0.01 - taken_s:.3f} s" in words for words in said)
        assert was_set == (step_s > MAX_CLOCK_STEP_S)


@pytest.mark.parametrize(("first", "step_s"), [(700, 15.0), (-1, 2.0)])
def test_a_recording_keeps_its_samples_and_its_stamps(first, step_s):
    """It was judged as a file already: no gap in it is shortened, and no sample left out."""
    t = short_walk().t.copy()
    t[first:] += step_s
    recording = replace(short_walk(), t=t)
    walk = Walk(recording, detect_stances(recording), options=Options(heading_deg=0.0))
    found = METHODS["foot"]["online"].run(walk, None)
    np.testing.assert_array_equal(found.t, t)
    assert found.runtime_s > 0.1
    assert not any("times" in note for note in found.notes)


def test_there_is_no_end_without_a_walk():
    with pytest.raises(FgNavError):
        OnlineNavigator(NORTH).finish()
    with pytest.raises(DetectionError):
        OnlineNavigator(replace(NORTH, lag_s=60.0)).finish()
    t, rng, shaken = np.arange(500) / 100.0, np.random.default_rng(0), OnlineNavigator(NORTH)
    assert shaken.push(t, rng.normal(0, 30, (500, 3)), rng.normal(0, 10, (500, 3))) == []
    with pytest.raises(DetectionError):
        shaken.finish()
    with pytest.raises(EstimationError):
        shaken.push(t, t[:, None], t[:, None])


# --- fixes -----------------------------------------------------------------------------------------------------------


TURN_DEG = 40.0


@cache
def through_fixes(heading: float | None, turn_deg: float):
    behind = Fix(1e4, np.zeros(3), 0.05)  # the walk has ended by then
    options = OnlineOptions(heading_rad=heading, use_field=False, fixes=(*fixes(turn_deg), behind))
    rows = rows_of(demo().recording)
    return walked(rows, options, cuts=range(64, len(rows), 64))


def fixes(turn_deg: float = 0.0) -> list[Fix]:
    return fixes_at([12, 25], turn_deg, sigma=0.05)


def test_the_walk_goes_through_its_fixes_as_in_batch():
    found, batch = through_fixes(0.0, 0.0)[0].finish(), with_fixes(fixes(), heading=0.0)
    where = np.searchsorted(found.stances.t, [fix.time_s - 0.05 for fix in fixes()])
    assert errors(found)[where].max() < 0.04
    assert found.graph["position_fix"] == len(fixes())
    assert through_fixes(0.0, 0.0)[0].polish().graph["position_fix"] == len(fixes())
    assert np.linalg.norm((found.stances.position - batch.stances.position)[:, :2], axis=1).max() < 0.1


def test_the_map_turns_to_the_fixes_and_says_so_and_what_they_have_yet_to_show_is_in_the_sigmas():
    navigator, told = through_fixes(None, TURN_DEG)
    assert errors(navigator.finish(), TURN_DEG).max() < 0.25
    turns, turn = [one for one in revisions_of(told) if one.turn], np.radians(TURN_DEG)
    assert abs(sum(one.turn for one in turns) + turn) < np.radians(1.5)
    first = fixes()[0].time_s
    assert first < turns[0].t < first + 12.0  # the next solution of all of it
    lines = estimates_of(told)
    truth = truth_from_start(demo())[[one.sample for one in lines]]
    east = np.cos(turn) * truth[:, 0] - np.sin(turn) * truth[:, 1]
    off = np.abs([one.position[0] for one in lines] - east)
    sigma = np.sqrt([one.pose_cov[0, 0] for one in lines])
    assert off.max() > 2.0
    assert (off < 3.0 * sigma + 0.02).all()
    assert np.degrees(lines[-1].pose_cov[3, 3] ** 0.5) < 3.0


def test_a_fix_that_four_sigmas_of_the_walk_and_its_own_do_not_explain_comes_later():
    cov = np.diag([0.0, 0.0, 0.0, 9.0, 16.0, 1.0])  # m^2, in the body, which is turned by a right angle
    pose = gtsam.Pose3(gtsam.Rot3.Rz(np.pi / 2), np.zeros(3))
    for east, north, is_near in ((19.9, 0.0, True), (20.4, 0.0, False), (0.0, 15.0, True), (0.0, 16.8, False)):
        assert agrees(pose, cov, Fix(0.0, np.array([east, north, 0.0]), 2.8 if north else 3.0)) == is_near


def test_a_line_is_turned_with_its_attitude():
    line = estimates_of(through_fixes(0.0, 0.0)[1])[5]
    found = line.turn(0.3)
    assert wrap_angle(compute_heading(found.nav_R_body) - compute_heading(line.nav_R_body)) == pytest.approx(0.3)
    assert found.heading - line.heading == pytest.approx(0.3)


def test_a_fix_of_a_stride_has_the_node_and_the_sigma_of_the_batch():
    rng = np.random.default_rng(4)
    t_node = np.sort(rng.uniform(0.0, 4.0, 6))
    several = [Fix(float(t), rng.normal(size=3), 0.2, 0.3) for t in rng.uniform(-1.0, 5.0, 40)]
    before = float(t_node[2])
    found = find_stride_fixes(several, t_node, before)
    inside = [fix for fix in several if before < fix.time_s <= t_node[-1]]
    assert [fix.time_s for _, fix in found] == [fix.time_s for fix in inside]
    pinned = pin_to_times(inside, t_node)
    np.testing.assert_array_equal([node for node, _ in found], pinned.node)
    np.testing.assert_allclose([fix.horizontal_sigma_m for _, fix in found], pinned.horizontal)


# --- seconds lost in mid-walk


LOST_AT_S, LOST_S = 30.2, 5.0
"""In mid-swing, and round a corner of the corridor: the heading behind it is a right angle off."""


@cache
def cut() -> tuple[Recording, float]:
    """A minute round a corridor in a homogeneous field, seconds cut out; and its heading at the start."""
    simulated = corridor(seed=1, rate_hz=100.0)
    whole = in_earth_field(simulated.recording, simulated.motion.at(simulated.recording.t).nav_R_body)
    kept = (whole.t < LOST_AT_S) | (whole.t >= LOST_AT_S + LOST_S)
    lossy = replace(whole, t=whole.t[kept], acc=whole.acc[kept], gyr=whole.gyr[kept], mag=whole.mag[kept])
    return lossy, float(compute_heading(whole.truth.nav_R_body[0]))


@cache
def online(with_field: bool) -> OnlineNavigator:
    recording, heading = cut()
    options = OnlineOptions(heading_rad=heading, use_field=with_field)
    return walked(rows_of(recording), options, cuts=range(50, len(recording), 50))[0]


def solve(method: str, with_field: bool) -> StanceTable:
    if method == "online":
        return online(with_field).causal()
    recording, heading = cut()
    recording = recording if with_field else replace(recording, mag=None)
    stances = detect_stances(recording)
    field = average_footfall_field(recording, stances, heading) if with_field else None
    return smooth(recording, stances, heading=heading, field=field).stances


def errors_of(table: StanceTable) -> tuple[np.ndarray, np.ndarray]:
    """How far each footfall is off over the ground, m, and how far it is turned, rad."""
    truth = cut()[0].truth
    true = np.array([np.interp(table.t, truth.t, axis) for axis in truth.position.T]).T
    off = (table.position - table.position[0]) - (true - true[0])
    heading = compute_heading(truth.nav_R_body[np.searchsorted(truth.t, table.t).clip(0, len(truth.t) - 1)])
    return np.linalg.norm(off[:, :2], axis=1), wrap_angle(compute_heading(table.nav_R_body) - heading)


@pytest.mark.parametrize("method", ["online", "batch"])
@pytest.mark.parametrize("with_field", [False, True])
def test_behind_a_loss_of_seconds_the_sigmas_are_those_of_a_person_who_walked_on(method, with_field):
    """By the compass the right angle round a corner is found; what is walked behind it is as certain as before."""
    table = solve(method, with_field)
    k = int(np.searchsorted(table.t, LOST_AT_S + LOST_S))
    off, turned = errors_of(table)
    sigma = np.linalg.norm(table.position_sigma[:, :2], axis=1)
    assert (off[k:] < 3.0 * sigma[k:]).all()
    if with_field:
        assert np.degrees(table.heading_sigma[k + 10]) < 3.0
        assert (np.abs(turned[k + 3 :]) < 3.0 * table.heading_sigma[k + 3 :] + np.radians(1.0)).all()
        assert abs(sigma[-1] - sigma[k]) < 0.5
    else:
        assert off[k - 1] < 0.2
        assert 2.0 < sigma[k] < 15.0
        assert 1.0 < abs(turned[k]) < 3.0 * table.heading_sigma[k] < 6.0
        np.testing.assert_allclose(sigma[: k - 1].max(), sigma[k - 2], rtol=0.5)


def test_the_batch_of_a_stream_with_a_loss_is_that_of_its_samples():
    """Path and sigmas; and neither leaps but over the loss."""
    found, polished = online(False).finish(), online(False).polish()
    apart = np.linalg.norm((found.position - polished.position)[:, :2], axis=1)
    assert apart[found.t < LOST_AT_S].max() < 0.1
    assert apart.max() < 0.1 * np.linalg.norm(polished.stances.position_sigma[-1, :2])
    np.testing.assert_allclose(polished.stances.position_sigma[-1, :2], found.stances.position_sigma[-1, :2], rtol=0.1)
    step = np.linalg.norm(np.diff(polished.position, axis=0), axis=1)
    assert np.delete(step, np.argmax(np.diff(polished.t))).max() < 0.1
