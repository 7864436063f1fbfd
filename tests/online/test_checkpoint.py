"""Save, kill, resume: the same answer, whatever the instant."""

import json
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from fg_nav.detection.causal import CausalParameters
from fg_nav.errors import EstimationError
from fg_nav.online import OnlineNavigator, load, save
from fg_nav.online.buffer import COLUMNS, rows_of
from fg_nav.online.sample_filter import UNKNOWN_GAP_S, SampleFilter
from tests.online.walks import NORTH, push, short_walk, worst_difference


@pytest.fixture(scope="module")
def whole():
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows_of(short_walk()))
    navigator.close()
    return navigator


def test_a_resumed_walk_ends_with_the_same_answer(whole, tmp_path):
    rows = rows_of(short_walk())
    rng = np.random.default_rng(5)
    navigator = OnlineNavigator(NORTH)
    at = [0, *np.sort(rng.integers(1, len(rows), 4)), len(rows)]
    for start, stop in pairwise(at):
        push(navigator, rows[start:stop], range(30, stop - start, 30))
        save(navigator, tmp_path / "walk.npz")
        push(navigator, rows[stop : stop + 100])  # walked after the save, and lost
        navigator = load(tmp_path / "walk.npz", NORTH)
    navigator.close()
    assert worst_difference(navigator.causal(), whole.causal()) < 1e-9
    assert worst_difference(navigator.smoothed(), whole.smoothed()) < 1e-9
    assert [p.name for p in tmp_path.iterdir()] == ["walk.npz"]


def test_what_the_checkpoint_knows_is_not_taken_twice(whole, tmp_path):
    rows = rows_of(short_walk())
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows[:700])
    save(navigator, tmp_path / "walk.npz")
    told = []
    again = load(tmp_path / "walk.npz", remark=told.append)
    push(again, rows, range(20, len(rows), 20))  # a file is read from its beginning
    again.close()
    assert worst_difference(again.smoothed(), whole.smoothed()) < 1e-9
    assert again.judge.counts["known"] == 700
    assert len(told) == 1


def admitted(judge, rows, block):
    """Rows (n, 11) that a judge takes of these (n, 10) in blocks."""
    parts = [rows[i : i + block] for i in range(0, len(rows), block)]
    return [judge.accept(part[:, 0], part[:, 1:4], part[:, 4:7], part[:, 7:10]) for part in parts]


def resumed(rows, saved, then, block=7):
    """Samples that a judge takes of the first `saved` rows, and after a resume of the rows `then`; and that judge."""
    judge = SampleFilter()
    before = np.concatenate(admitted(judge, rows[:saved], 13))
    again = SampleFilter.resume(json.loads(json.dumps(judge.state())), [before], lambda words: None)
    return np.concatenate([before, *admitted(again, then, block), again.flush()]), again


def odd_rows():
    """Rows with all that a judge leaves out, and two restarts of the clock, with as many rows before as after."""
    rows = rows_of(short_walk()).copy()
    rows[200:203, 2] = np.nan
    rows[250, 5] = 80.0
    rows[502:507, 1] -= 900.0
    rows[652, 4] = rows[549, 4] = 100.0
    rows[[252, 598, 800], 8] = 1000.0
    rows[300:310] = rows[299]
    rows[400:420, 0] -= 0.5
    rows[450, 0] = 1e6
    for first in (550, 900):
        rows[first:, 0] -= rows[first, 0]
    return rows


@pytest.mark.parametrize("saved", [20, 203, 252, 305, 410, 451, 503, 508, 550, 600, 649, 654, 700, 950, 1300])
@pytest.mark.parametrize("block", [1, 7, 5000])
def test_a_replay_is_known_up_to_the_checkpoint_whatever_the_clock_did(saved, block):
    """The rows before a restart have the stamps of those after it; only their values tell them apart."""
    rows = odd_rows()
    whole = np.concatenate([*admitted(uninterrupted := SampleFilter(), rows, 11), uninterrupted.flush()])
    taken, judge = resumed(rows, saved, rows, block)
    np.testing.assert_array_equal(taken, whole)
    known = judge.counts.pop("known")
    assert 0 < known <= saved
    assert judge.counts == uninterrupted.counts


@pytest.mark.parametrize("saved", [20, 305, 451, 650, 700, 1300])
@pytest.mark.parametrize("back", [0, 2, 10, 150])
def test_a_source_that_goes_on_some_way_back_or_at_once_loses_nothing(saved, back):
    rows = odd_rows()
    whole = np.concatenate(admitted(SampleFilter(), rows, 11))
    taken, _ = resumed(rows, saved, rows[max(saved - back, 0) :])
    np.testing.assert_array_equal(taken, whole)


@pytest.mark.parametrize("saved", [400, 800])
def test_a_source_that_goes_on_later_leaves_a_gap_and_no_more(saved):
    """Before a restart of the clock, and after it."""
    rows = rows_of(short_walk()).copy()
    rows[600:, 0] -= rows[600, 0]
    taken, judge = resumed(rows, saved, rows[saved + 40 :])
    assert judge.counts["known"] == judge.counts["rebooted"] == 0
    assert judge.counts["restart"] == 1
    step = np.diff(taken[:, 0])
    assert step[saved - 1] == pytest.approx(0.41)
    np.testing.assert_array_equal(taken[-500:, 1:COLUMNS], rows[-500:, 1:])


def test_a_sensor_switched_off_and_on_is_carried_on_after_a_gap():
    """Its stamps begin again at 0; and a replay of that second part is known, as is one of the first."""
    rows = rows_of(short_walk()).copy()
    rows[740:, 0] -= rows[740, 0]
    taken, judge = resumed(rows, 700, rows[740:])
    assert judge.counts["rebooted"] == 1
    np.testing.assert_array_equal(taken[700:, 1:COLUMNS], rows[740:, 1:])
    assert taken[700, 0] - taken[699, 0] == pytest.approx(UNKNOWN_GAP_S)
    np.testing.assert_allclose(taken[700:, 0] - taken[700, 0], rows[740:, 0], rtol=0, atol=1e-9)
    sensor_t = [judge.sensor_time(i, float(t)) for i, t in enumerate(taken[:, 0])]
    np.testing.assert_allclose(sensor_t, np.delete(rows[:, 0], np.s_[700:740]), rtol=0, atol=1e-9)
    for begin in (0, 740):
        again = SampleFilter.resume(json.loads(json.dumps(judge.state())), [taken], lambda words: None)
        assert sum(map(len, admitted(again, rows[begin:], 50))) == 0
        assert again.counts["late"] == (40 if begin == 0 else 0)  # that nobody listened to
        assert again.counts["known"] == len(rows) - begin - again.counts["late"]
        more = rows[-30:] + 0.31 * np.eye(11)[0]
        np.testing.assert_array_equal(np.concatenate(admitted(again, more, 50))[:, 1:COLUMNS], more[:, 1:])


def test_where_the_last_rows_of_the_checkpoint_were_lost_the_walk_goes_on():
    rows = rows_of(short_walk())
    replayed = np.delete(rows, np.s_[690:720], axis=0)
    taken, judge = resumed(rows, 700, replayed)
    np.testing.assert_array_equal(taken[:, :COLUMNS], np.delete(rows, np.s_[700:720], axis=0))
    assert judge.counts["known"] == 690


def test_where_they_were_lost_shortly_before_the_end_what_is_behind_them_is_taken():
    rows = rows_of(short_walk())[:780]
    taken, _ = resumed(rows, 700, np.delete(rows, np.s_[690:710], axis=0))
    np.testing.assert_array_equal(taken[:, :COLUMNS], np.delete(rows, np.s_[700:710], axis=0))


@pytest.mark.parametrize("block", [1, 40, 5000])
def test_a_clock_that_restarted_behind_lost_rows_loses_no_more_than_those_that_show_it(block):
    """For how long it was off nobody can know, as the foot moved."""
    rows = rows_of(short_walk()).copy()
    rows[710:, 0] -= rows[710, 0]
    taken, judge = resumed(rows, 700, np.delete(rows, np.s_[690:710], axis=0), block)
    assert judge.counts["rebooted"] == 1
    assert judge.counts["known"] == 690
    np.testing.assert_array_equal(taken[700:, 1:COLUMNS], rows[710 + 99 :, 1:])


@pytest.mark.parametrize("block", [1, 40, 5000])
@pytest.mark.parametrize("until", [450, 800, 1486])
def test_what_was_lost_before_and_comes_now_is_too_late(block, until):
    """Two seconds, longer than what shows that the last rows of a checkpoint were lost; before a restart, and after."""
    rows = rows_of(short_walk()).copy()
    rows[600:, 0] -= rows[600, 0]
    heard = np.delete(rows, np.s_[300:500], axis=0)
    taken, judge = resumed(heard, 800, rows[:until], block)
    known = np.concatenate(admitted(SampleFilter(), heard, 13))
    np.testing.assert_array_equal(taken, known[: max(800, until - 200)])
    assert judge.counts["known"] == (min(until, 1000) - 200 if until > 450 else 300)
    assert judge.counts["late"] == min(until - 300, 200)
    assert judge.counts["restart"] == 1


@pytest.mark.parametrize("block", [1, 16, 17, 200])
def test_blocks_do_not_matter_to_whether_a_clock_restarted(block):
    """Another sensor, say, whose stamps pass the last one of the checkpoint after 40 rows."""
    rows = rows_of(short_walk())
    other = rows[660:1000].copy()
    other[:, 1] += 1e-3
    taken, judge = resumed(rows, 700, other, block)
    assert judge.counts == Counter(rebooted=1, gap=1)
    np.testing.assert_array_equal(taken[700:, 1:COLUMNS], other[:, 1:])


def test_a_stream_that_ended_behind_its_last_stamps_can_be_closed_and_asked(tmp_path):
    rows = rows_of(short_walk())
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows[:700])
    push(navigator, rows[600:605])
    save(navigator, tmp_path / "walk.npz")
    again = load(tmp_path / "walk.npz")
    again.close()
    assert again.buffer.stop == 700
    save(again, tmp_path / "walk.npz")
    assert load(tmp_path / "walk.npz").has_ended


def test_samples_that_are_missing_are_counted_once_though_they_come_again():
    rows = rows_of(short_walk())[:720].copy()
    rows[[3, 200, 690, 705, 712], 2] = np.nan
    for block in (1, 7, 50, 5000):
        _, judge = resumed(rows, 700, rows, block)
        assert judge.counts["missing"] == 5
        _, judge = resumed(rows, 700, rows[700:], block)
        assert judge.counts["missing"] == 5


def test_a_walk_with_another_detection_is_taken_up_with_the_same(tmp_path):
    other = CausalParameters(settle_s=0.35)
    navigator = OnlineNavigator(NORTH, detection=other)
    push(navigator, rows_of(short_walk())[:900])
    save(navigator, tmp_path / "walk.npz")
    again = load(tmp_path / "walk.npz", detection=other)
    assert worst_difference(again.causal(), navigator.causal()) < 1e-9
    with pytest.raises(EstimationError, match="another detection"):
        load(tmp_path / "walk.npz")


def test_sigmas_grow_where_a_sensor_was_switched_off(tmp_path):
    rows = rows_of(short_walk()).copy()
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows[:700])
    save(navigator, tmp_path / "walk.npz")
    told = []
    navigator = load(tmp_path / "walk.npz", remark=told.append)
    rows[:, 0] -= rows[750, 0]
    before = navigator.causal()
    push(navigator, rows[750:], range(20, 600, 20))
    navigator.close()
    table = navigator.causal()
    assert len(told) == 2
    assert "restarted" in told[0]
    assert len(table) > len(before) + 3
    assert (table.position_sigma[len(before) :].max(axis=1) > 2.0).all()
    assert table.heading_sigma[len(before)] > 1.5 * before.heading_sigma[-1]  # that of one reading of the compass
    assert np.isfinite(table.position).all()
    assert np.isfinite(navigator.finish().position).all()


@pytest.mark.parametrize(("step_s", "changes"), [(100.0, 0), (36000.0, 0), (1.7e9, 1)])
def test_after_minutes_without_a_sample_the_walk_is_carried_on(step_s, changes):
    rows = rows_of(short_walk()).copy()
    rows[700:, 0] += step_s
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows, range(33, len(rows), 33))
    navigator.close()
    assert navigator.judge.counts["set"] == changes
    assert len(navigator.causal()) > 8
    assert np.isfinite(navigator.causal().position).all()


def test_a_walk_that_had_ended_can_still_be_asked(whole, tmp_path):
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows_of(short_walk()))
    assert navigator.close()
    save(navigator, tmp_path / "walk.npz")
    again = load(tmp_path / "walk.npz", NORTH)
    assert worst_difference(again.causal(), whole.causal()) < 1e-9
    assert len(again.finish().stances) == len(navigator.finish().stances)
    with pytest.raises(EstimationError, match="has ended"):
        push(again, rows_of(short_walk()))
