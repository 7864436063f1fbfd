"""What a source that a resumed walk follows sends again is left out, whatever its clock did; what is new is taken."""

from collections import Counter

import numpy as np
import pytest

from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import rows_of
from fg_nav.samples.delivery import Overlap
from fg_nav.samples.intake import RESTART, UNKNOWN_GAP_S, Intake
from fg_nav.samples.readings import COLUMNS
from tests.online.walks import NORTH, push, short_walk


def admitted(judge, rows, block):
    """Samples (n, 12) that an intake takes of these rows in blocks."""
    return [judge.push(rows[i : i + block]) for i in range(0, len(rows), block)]


def resumed(rows, saved, then, block=7):
    """Samples that a judge takes of the first `saved` rows, and behind an interruption of `then`."""
    judge, overlap = Intake(), Overlap(rows[:saved])
    taken, is_first = admitted(judge, rows[:saved], 13), True
    for begin in [*range(0, len(then), block), len(then)]:
        new = overlap.select_new(then[begin : begin + block], at_end=begin == len(then))
        if len(new) and is_first and not overlap.skips:
            judge.resume()
        is_first &= not len(new)
        taken += admitted(judge, new, len(new) or 1)
    return np.concatenate([*taken, judge.push(rows[:0], at_end=True)]), judge, overlap


def restarting(at):
    """Rows of a clock that begins again there."""
    rows = rows_of(short_walk()).copy()
    rows[at:, 0] -= rows[at, 0]
    return rows


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


@pytest.mark.parametrize("saved", [20, 203, 252, 305, 410, 451, 503, 550, 600, 649, 654, 950, 1300])
def test_a_replay_is_known_up_to_where_it_was_interrupted_whatever_the_clock_did(saved):
    """The rows before a restart have the stamps of those after it; only their values tell them apart."""
    rows = odd_rows()
    whole = np.concatenate([*admitted(uninterrupted := Intake(), rows, 11), uninterrupted.push(rows[:0], at_end=True)])
    for block in (7, 5000, *([1] if saved in (305, 654) else [])):
        taken, judge, overlap = resumed(rows, saved, rows, block)
        np.testing.assert_array_equal(taken, whole)
        assert overlap.left_out == saved
        assert judge.counts == uninterrupted.counts


@pytest.mark.parametrize("saved", [20, 305, 451, 650, 700, 1300])
@pytest.mark.parametrize("back", [0, 2, 10, 150])
def test_a_source_that_goes_on_some_way_back_or_at_once_loses_nothing(saved, back):
    rows = odd_rows()
    whole = np.concatenate(admitted(Intake(), rows, 11))
    taken, _, _ = resumed(rows, saved, rows[max(saved - back, 0) :])
    np.testing.assert_array_equal(taken, whole)


def test_a_source_that_goes_on_later_leaves_a_gap_and_no_more():
    """Before a restart of the clock, and after it."""
    rows = restarting(600)
    for saved in (400, 800):
        taken, judge, overlap = resumed(rows, saved, rows[saved + 40 :])
        assert overlap.left_out == judge.counts["rebooted"] == 0
        assert judge.counts["restart"] == 1
        assert taken[saved, 0] - taken[saved - 1, 0] == pytest.approx(0.41)
        np.testing.assert_array_equal(taken[-500:, 1:COLUMNS], rows[-500:, 1:])


def test_a_sensor_switched_off_and_on_is_carried_on_after_a_gap():
    """Its stamps begin again at 0; the rows that show it are left out."""
    rows = restarting(740)
    taken, judge, _ = resumed(rows, 700, rows[740:])
    assert judge.counts["rebooted"] == 1
    begins = 740 + RESTART - 1
    np.testing.assert_array_equal(taken[700:, 1:COLUMNS], rows[begins:, 1:])
    assert taken[700, 0] - taken[699, 0] == pytest.approx(UNKNOWN_GAP_S)
    np.testing.assert_allclose(taken[700:, 0] - taken[700, 0], rows[begins:, 0] - rows[begins, 0], rtol=0, atol=1e-9)
    sensor_t = [judge.sensor_time(t) for t in taken[:, 0].tolist()]
    np.testing.assert_allclose(sensor_t, np.delete(rows[:, 0], np.s_[700:begins]), rtol=0, atol=1e-9)


def test_a_foot_that_stands_before_and_after_does_not_hide_that_the_sensor_was_off():
    """Force and rate go on as before, and how long it was off is unknown all the same."""
    rng = np.random.default_rng(3)
    rows = np.column_stack([0.01 * np.arange(800), np.tile([0.0, 0.0, 9.8], (800, 1)), np.zeros((800, 7))])
    rows[:, 1:7] += 0.01 * rng.normal(size=(800, 6))
    rows[:, 7:] = np.nan
    rows[400:, 0] -= 3.9
    assert resumed(rows, 400, rows[400:])[1].counts["rebooted"] == 1
    whole = Intake()
    admitted(whole, rows, 50)
    assert whole.counts["restart"] == 1


def test_where_the_last_rows_were_lost_the_walk_goes_on():
    """Of a replay, far from its end and shortly before it."""
    for lost, until in ((np.s_[690:720], None), (np.s_[690:710], 780)):
        rows = rows_of(short_walk())[:until]
        taken, _, overlap = resumed(rows, 700, np.delete(rows, lost, axis=0))
        np.testing.assert_array_equal(taken[:, :COLUMNS], np.delete(rows, np.s_[700 : lost.stop], axis=0))
        assert overlap.left_out == 690


def test_a_clock_that_restarted_behind_lost_rows_loses_no_more_than_those_that_show_it():
    """For how long it was off nobody can know, as the foot moved."""
    rows = restarting(710)
    for block in (1, 40, 5000):
        taken, judge, overlap = resumed(rows, 700, np.delete(rows, np.s_[690:710], axis=0), block)
        assert judge.counts["rebooted"] == 1
        assert overlap.left_out == 690
        np.testing.assert_array_equal(taken[700:, 1:COLUMNS], rows[710 + 99 :, 1:])


@pytest.mark.parametrize(("block", "until"), [(1, 450), (40, 800), (40, 1486), (5000, 450), (5000, 1486)])
def test_what_was_lost_before_and_comes_now_is_too_late(block, until):
    """Two seconds, longer than what shows that the last rows were lost; before a restart, and after."""
    rows = restarting(600)
    heard = np.delete(rows, np.s_[300:500], axis=0)
    taken, judge, overlap = resumed(heard, 800, rows[:until], block)
    known = np.concatenate(admitted(Intake(), heard, 13))
    np.testing.assert_array_equal(taken, known[: max(800, until - 200)])
    assert overlap.left_out == min(until, 1000)
    assert judge.counts["restart"] == 1


def test_blocks_do_not_matter_to_whether_a_clock_restarted():
    """Another sensor, say, whose stamps pass the last one after 40 rows: those before are left out."""
    rows = rows_of(short_walk())
    other = rows[660:1000].copy()
    other[:, 1] += 1e-3
    for block in (1, 16, 17, 200):
        taken, judge, _ = resumed(rows, 700, other, block)
        assert judge.counts == Counter(backward=39, repeated=1)
        np.testing.assert_array_equal(taken[700:, 1:COLUMNS], other[40:, 1:])


def test_samples_that_are_missing_are_counted_once_though_they_come_again():
    rows = rows_of(short_walk())[:720].copy()
    rows[[3, 200, 690, 705, 712], 2] = np.nan
    for block in (1, 7, 50, 5000):
        for then in (rows, rows[700:]):
            _, judge, _ = resumed(rows, 700, then, block)
            assert judge.counts["missing"] == 5


@pytest.mark.parametrize(("step_s", "changes"), [(36000.0, 0), (1.7e9, 1)])
def test_after_minutes_without_a_sample_the_walk_is_carried_on(step_s, changes):
    rows = rows_of(short_walk()).copy()
    rows[700:, 0] += step_s
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows, range(33, len(rows), 33))
    navigator.close()
    assert navigator.intake.counts["set"] == changes
    assert len(navigator.causal()) > 8
    assert np.isfinite(navigator.causal().position).all()
