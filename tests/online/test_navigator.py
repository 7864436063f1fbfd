"""A walk in progress: blocks do not matter, odd samples are survived, and it ends where the recording does."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.errors import DetectionError, EstimationError, FgNavError, RecordingError
from fg_nav.estimators import METHODS
from fg_nav.evaluation.metrics import measure_gap
from fg_nav.magnetic import average_footfall_field
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import rows_of
from fg_nav.online.navigator import finish_walk
from fg_nav.samples.intake import MAX_CLOCK_STEP_S, UNKNOWN_GAP_S, Intake
from fg_nav.smoother import smooth
from fg_nav.walk import Options, Walk
from tests.online.walks import NORTH, estimates_of, push, short_walk, worst_difference


@pytest.fixture(scope="module")
def whole():
    """The walk in one block: its navigator, and the estimates."""
    navigator = OnlineNavigator(NORTH)
    found = push(navigator, rows_of(short_walk()))
    return navigator, estimates_of(found + navigator.close())


def test_each_footfall_is_returned_once_and_in_order(whole):
    navigator, found = whole
    assert [e.number for e in found] == list(range(len(found)))
    assert (np.diff([e.t for e in found]) > 0).all()
    new = sum(not f.continues for f in navigator.footfalls)
    assert new == detect_stances(short_walk()).n_footfalls
    for estimate in found:
        assert np.isfinite(estimate.position).all()
        assert (np.linalg.eigvalsh(estimate.pose_cov) > 0).all()
    assert np.array_equal(navigator.causal().position, [e.position for e in found])


@pytest.mark.parametrize("seed", [None, 1])
def test_blocks_do_not_matter(whole, seed):
    rows = rows_of(short_walk())
    rng = np.random.default_rng(seed)
    cuts = range(1, len(rows)) if seed is None else np.sort(rng.integers(0, len(rows), rng.integers(1, 300)))
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows, cuts)
    navigator.close()
    assert worst_difference(navigator.causal(), whole[0].causal()) < 1e-9
    assert worst_difference(navigator.smoothed(), whole[0].smoothed()) < 1e-9


def test_it_ends_with_what_its_graph_has_and_polished_with_the_batch(whole):
    navigator, _ = whole
    recording = short_walk()
    stances = detect_stances(recording)
    batch = smooth(recording, stances, heading=0.0, field=average_footfall_field(recording, stances))
    found = finish_walk(navigator, polish=True)
    smoothed = navigator.smoothed()
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


def test_between_footfalls_the_pose_is_carried_on():
    """In mid-swing it is where the whole walk has the foot then, to what a second of strapdown loses."""
    recording = short_walk()
    rows = rows_of(recording)
    stances = detect_stances(recording)
    batch = smooth(recording, stances, heading=0.0)
    navigator, begin = OnlineNavigator(NORTH), 0
    assert navigator.pose() is None
    for k in range(5, 10):
        stop = int(stances.stop[k] + stances.start[k + 1]) // 2
        push(navigator, rows[begin:stop])
        begin = stop
        pose = navigator.pose()
        assert pose.t == [recording.t[stop - 1]]
        assert np.linalg.norm(pose.velocity) > 1.0
        assert np.linalg.norm(pose.position[0] - batch.position[stop - 1]) < 0.15
        assert np.degrees(np.arccos((np.trace(pose.nav_R_body[0].T @ batch.nav_R_body[stop - 1]) - 1) / 2)) < 5.0
    push(navigator, np.repeat(rows[stop : stop + 1], 1500, axis=0) + 0.01 * np.arange(1500)[:, None] * np.eye(11)[0])
    assert np.isfinite(navigator.pose().position).all()
    assert np.linalg.norm(navigator.pose().velocity) < 1.0


def spoiled(rows, kind):
    rows, rng = rows.copy(), np.random.default_rng(3)
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
def test_odd_samples_are_left_out_counted_and_reported_once(whole, kind):
    rows = spoiled(rows_of(short_walk()), kind)
    told = []
    navigator = OnlineNavigator(NORTH, told.append)
    found = estimates_of(push(navigator, rows, range(7, len(rows), 7)) + navigator.close())
    assert navigator.intake.counts[kind] >= 1
    kinds = [kind for kind, number in navigator.intake.counts.items() if number]
    assert len(told) == len(kinds)
    assert np.isfinite([e.position for e in found]).all()
    last = whole[1][-1]
    if kind in ("repeated", "backward", "ahead"):
        expected = {"repeated": len(rows) // 51, "backward": 30, "ahead": 1}[kind]
        assert abs(navigator.intake.counts[kind] - expected) <= 1
        assert np.abs(found[-1].position - last.position).max() < 1e-9
    assert any(str(navigator.intake.counts[kind]) in note for note in navigator.intake.notes)
    if kind == "gap":
        with_gap, without = (np.linalg.norm(n.causal().position_sigma[-1]) for n in (navigator, whole[0]))
        assert with_gap > 3 * without
    if kind == "restart":  # stamps go on, and those of the sensor are found again
        begins, table = len(rows) // 2, navigator.smoothed()
        assert 3 < np.searchsorted(table.sample, begins) < len(table) - 3
        np.testing.assert_allclose(table.t, rows_of(short_walk())[table.sample, 0], rtol=0, atol=1e-9)
        sensor_t = [navigator.intake.sensor_time(one) for one in table.t.tolist()]
        np.testing.assert_allclose(sensor_t, rows[table.sample, 0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(navigator.finish().t, rows_of(short_walk())[:, 0], rtol=0, atol=1e-9)


@pytest.mark.parametrize(("step_s", "taken_s"), [(9.9, 9.91), (7200.0, 7200.01), (1.7e9, UNKNOWN_GAP_S)])
def test_a_gap_keeps_its_length_unless_the_clock_was_set_and_then_it_is_said_by_how_much(step_s, taken_s):
    rows = rows_of(short_walk()).copy()
    rows[700:, 0] += step_s
    told = []
    judge = Intake(told.append)
    taken = judge.push(rows)
    assert taken[700, 0] - taken[699, 0] == pytest.approx(taken_s)
    sensor_t = [judge.sensor_time(t) for t in taken[:, 0].tolist()]
    np.testing.assert_allclose(sensor_t, rows[:, 0], rtol=1e-15, atol=1e-9)
    back = f"{step_s + 0.01 - taken_s:.3f} s"
    assert any(f"set back by {back}" in words for words in told) == (step_s > MAX_CLOCK_STEP_S)
    assert any(f"set back by {back}" in words for words in judge.notes) == (step_s > MAX_CLOCK_STEP_S)


@pytest.mark.parametrize(("first", "step_s"), [(700, 15.0), (-1, 2.0)])
def test_a_recording_keeps_its_samples_and_its_stamps(first, step_s):
    """It was judged as a file already: no gap in it is shortened, and no sample left out."""
    walk = short_walk()
    t = walk.t.copy()
    t[first:] += step_s
    recording = replace(walk, t=t)
    found = METHODS["foot"]["online"].run(
        Walk(recording, detect_stances(recording), options=Options(heading_deg=0.0)), None
    )
    np.testing.assert_array_equal(found.t, t)
    assert found.runtime_s > 0.1
    assert not any("times" in note for note in found.notes)


@pytest.mark.parametrize(("column", "factor", "word"), [(slice(1, 4), 0.102, "in g"), (slice(7, 10), 0.01, "gauss")])
def test_a_wrong_unit_is_refused_as_in_a_file(column, factor, word):
    rows = rows_of(short_walk())
    rows[:, column] *= factor
    with pytest.raises(RecordingError, match=word):
        push(OnlineNavigator(NORTH), rows, range(50, len(rows), 50))


def test_there_is_no_end_without_a_walk():
    navigator = OnlineNavigator(NORTH)
    with pytest.raises(FgNavError):
        navigator.finish()
    t = np.arange(500) / 100.0
    rng = np.random.default_rng(0)
    shaken = OnlineNavigator(NORTH)
    assert shaken.push(t, rng.normal(0, 30, (500, 3)), rng.normal(0, 10, (500, 3))) == []
    with pytest.raises(DetectionError):
        shaken.finish()
    with pytest.raises(EstimationError):
        shaken.push(t, t[:, None], t[:, None])
    with pytest.raises(DetectionError):
        OnlineNavigator(replace(NORTH, lag_s=60.0)).finish()


def test_a_walk_without_a_batch_solution_still_ends(whole, monkeypatch):
    """Polished without its field, if that helps; else with a note."""
    from fg_nav.online import navigator as module

    navigator, _ = whole
    solve = module.smooth

    def never(*_: object) -> None:
        raise EstimationError("it does not converge.")

    def not_with_field(*given: object) -> object:
        return never() if given[5] is not None else solve(*given)

    monkeypatch.setattr(module, "smooth", not_with_field)
    without = navigator.polish()
    assert any("does not converge" in note for note in without.notes)
    assert set(without.stances.field) == {"none"}
    monkeypatch.setattr(module, "smooth", never)
    found = finish_walk(navigator, polish=True)
    assert len(found.t) == len(short_walk())
    assert found.polished is None
    assert any("no batch solution: it does not converge" in note for note in found.notes)
