"""A stream in another unit is refused before it is used; where the unit changes midway, what is wrong is left out."""

import numpy as np
import pytest

from fg_nav.errors import RecordingError
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import rows_of
from fg_nav.samples.intake import HELD, MAX_NOTES, FieldMonitor, Intake, UnitMonitor

STAMP, ACC, GYR, MAG = slice(0, 1), slice(1, 4), slice(4, 7), slice(7, 10)
G = 9.80665


@pytest.fixture(scope="module")
def rows():
    """A minute of a foot, 100 Hz, that stands for five seconds first."""
    return rows_of(simulate("demo", 104, Choices(rate_hz=100.0)).recording)[:5000]


def change(rows, columns, factor, first=0, stop=None, offset=0.0):
    changed = rows.copy()
    changed[first:stop, columns] = (changed[first:stop, columns] + offset) * factor
    return changed


def admit(rows, block=61):
    """The rows that pass both monitors, and what is said."""
    said = []
    units, field = UnitMonitor(said.append), FieldMonitor(said.append)
    taken = [field.push(units.push(rows[start : start + block])) for start in range(0, len(rows), block)]
    return np.concatenate([*taken, field.push(units.push(rows[:0], at_end=True))]), said


def test_a_stream_in_another_unit_is_refused_with_it(rows):
    """Stamps since the start, since boot and since 1970; readings; stamps that never rise."""
    for unit, per_s in (("ms", 1e3), ("us", 1e6), ("ns", 1e9)):
        for since_s in (0.0, 3 * 86400.0, 1.7e9):
            for block in (1, 5000):
                with pytest.raises(RecordingError, match=f"in {unit} .*--columns"):
                    admit(change(rows[:100], STAMP, per_s, offset=since_s), block)
    for columns, factor, words in (
        (ACC, 1.0 / G, "acc seems to be in g "),
        (ACC, 1e3 / G, "acc seems to be in mg"),
        (GYR, 180.0 / np.pi, "gyr seems to be in deg/s"),
        (GYR, np.pi / 180.0, "gyr turns by less than"),
        (STAMP, 0.0, "do not advance"),
        (STAMP, -1.0, "do not advance"),
    ):
        with pytest.raises(RecordingError, match=words):
            admit(change(rows, columns, factor))
    sent = change(rows[:1500], STAMP, 1e9, offset=1.7e9)
    with pytest.raises(RecordingError, match="in ns"):
        OnlineNavigator().push(sent[:, 0], sent[:, 1:4], sent[:, 4:7])


def test_rows_without_stamps_do_not_wait_for_ever(rows):
    watch = UnitMonitor(print)
    sent = change(rows[:1500], STAMP, np.nan)
    assert sum(len(watch.push(sent[k : k + 100])) for k in range(0, 1500, 100)) == 1000
    assert len(watch.push(rows[:0], at_end=True)) == 500


def test_a_unit_that_changes_midway_is_left_out_until_it_is_right_again(rows):
    """Rows around the change, where the foot stands or swings, do not show it: less than a second of them."""
    known = {row.tobytes() for row in rows}
    for columns, factor, words in (
        (STAMP, 1e3, "in ms"),
        (STAMP, 1e9, "in ns"),
        (STAMP, 1e-3, "no inertial sensor's rate"),
        (ACC, 1.0 / G, "in g "),
        (GYR, 180.0 / np.pi, "in deg/s"),
    ):
        for block in (17, 5000):
            taken, said = admit(change(rows, columns, factor, 2000, 3000), block)
            assert len(said) == 2, (words, block)
            assert words in said[0]
            assert "as before" in said[1]
            assert sum(row.tobytes() not in known for row in taken) < 100
            assert 4000 - 2 * HELD < sum(row.tobytes() in known for row in taken) <= 4000


@pytest.mark.parametrize("block", [7, 5000])
def test_rows_that_become_rare_are_left_out_within_some_steps_until_they_come_as_before(rows, block):
    """One a second in place of 400: not held for as many seconds as there are rows in one."""
    sent = rows.copy()
    sent[:, 0] = rows[0, 0] + np.cumsum(np.where(np.arange(len(rows)) // 60 == 30, 1.0, 0.0025))
    watch, said = UnitMonitor(lambda words: said.append((words, k))), []
    for k in range(0, 1830, block):
        watch.push(sent[k : min(k + block, 1830)])
    assert len(said) == 1
    assert "left out" in said[0][0]
    assert said[0][1] < 1800 + 12
    taken, both = admit(sent, block)
    assert len(both) == 2
    assert "as before" in both[1]
    assert 4000 < len(taken) < 4970


def test_what_is_in_no_other_unit_is_let_pass(rows):
    """Seconds since 1970; gaps, impacts, missing and single wrong samples; iron, and a magnetometer that is off."""
    odd = np.delete(rows, slice(1500, 1900), axis=0)
    odd[700, ACC], odd[800, GYR], odd[1000:1005, GYR], odd[1200:1210, ACC] = 800.0, 300.0, 100.0, 0.5
    odd[2000:2300, 1:7], odd[2600, 0], odd[2700, ACC] = np.nan, 1e9, 0.0
    odd[2800:3000:7, ACC], odd[3100, GYR] = 1e300, -1e200
    odd[3200:3202, 0] = np.inf
    field = change(rows, MAG, 2.5, 1000, 1400)
    field[2000:2900, MAG], field[3000:3900:2, MAG] = np.nan, 0.0
    for sent in (change(rows, STAMP, 1.0, offset=1.7e9), odd, field):
        with np.errstate(invalid="raise"):
            taken, said = admit(sent)
        assert np.array_equal(taken, sent, equal_nan=True)
        assert said == []


def test_a_gyroscope_that_stops_turning_midway_is_said(rows):
    taken, said = admit(change(rows, GYR, 0.01, 2000))
    assert len(taken) == len(rows)
    assert len(said) == 1
    assert "not to be used" in said[0]


def test_a_magnetometer_in_another_unit_midway_is_left_out_and_the_rest_is_taken(rows):
    """None of what is in the other unit is taken, all of what is not."""
    wrong = slice(2000, 3500)
    for factor, words, block in (
        (10.0, "in mG", 61), (0.01, "in gauss", 5000), (1e3, "in nT", 61), (1e-6, "in T", 61),
        (150.0, "no field", 5000), (25.0, "strong iron", 1), (25.0, "strong iron", 61), (10.0, "in mG", 5000),
    ):  # fmt: skip
        taken, said = admit(change(rows, MAG, factor, 2000, 3500), block)
        assert np.array_equal(np.delete(taken, wrong, axis=0), np.delete(rows, wrong, axis=0), equal_nan=True)
        assert np.array_equal(taken[:, :7], rows[:, :7])
        assert np.isnan(taken[wrong, MAG]).all()
        assert len(said) == 2, (factor, block)
        assert words in said[0]
        assert "mag is as before" in said[1]


def test_a_beginning_beside_iron_is_not_the_strength_of_the_walk(rows):
    """At 180 uT for four seconds, and 45 uT from then on: 450 uT are left out."""
    strength = np.linalg.norm(rows[:, MAG], axis=1, keepdims=True)
    sent = rows.copy()
    sent[:, MAG] *= np.where(np.arange(len(rows)) < 400, 180.0, 45.0)[:, None] / strength
    watch = FieldMonitor(print)
    watch.push(sent)
    assert np.isnan(watch.push(change(sent[:100], MAG, 450.0 / 180.0))[:, MAG]).all()
    assert watch.left_out == 100


def test_what_is_left_out_of_a_magnetometer_is_counted_and_noted_a_few_times(rows):
    intake = Intake(print)
    intake.push(change(rows, MAG, 25.0, 2000, 2200))  # too short to be said at once
    assert intake.notes == ("200 fields of another strength than before left out",)
    sent = rows[600:800].copy()
    sent[:, MAG] = 45.0 / np.sqrt(3.0)
    intake = Intake()
    for k in range(150):
        block = change(sent, MAG, 10.0 if k // 3 % 2 else 1.0)
        block[:, 0] += 2.0 * k
        intake.push(block)
    assert len([words for words in intake.notes if "mag" in words]) == MAX_NOTES
