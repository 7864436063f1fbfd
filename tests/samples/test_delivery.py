"""A stream as it comes: samples lost, sent again, in another unit; and stamps that are made even."""

import numpy as np
import pytest

from fg_nav.errors import RecordingError
from fg_nav.io import read, read_raw
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import rows_of
from fg_nav.samples.delivery import WINDOW, LossCounter, Overlap, describe_losses
from fg_nav.samples.intake import HELD, MAX_NOTES, RESTART, UNKNOWN_GAP_S, FieldMonitor, Intake, UnitMonitor
from fg_nav.samples.readings import COLUMNS
from fg_nav.samples.stamps import fit_clock, remove_jitter
from tests.online.walks import NORTH, push, short_walk
from tests.real_data import DATA, needs_data


def count(t, block):
    said: list[str] = []
    counter = LossCounter(said.append)
    for start in range(0, len(t), block):
        counter.push(t[start : start + block])
    counter.finish()
    return counter, said


@pytest.mark.parametrize("block", [1, 37, 10_000])
def test_each_sample_that_is_missing_is_counted_whatever_the_blocks(block):
    """At the stamps of a clock that is 200 ppm off, jitters by 20 us, and counts from 1970."""
    rng = np.random.default_rng(3)
    t = 1.7e9 + np.arange(2000) * 0.0025 * 1.0002 + rng.normal(0.0, 2e-5, 2000)
    lost = np.zeros(2000, dtype=bool)
    lost[rng.choice(np.arange(1, 1999), 150, replace=False)] = True
    lost[700:720] = True
    counter, said = count(t[~lost], block)
    assert (counter.samples, counter.came) == (lost.sum(), (~lost).sum())
    assert len(said) == 1
    words = describe_losses({"samples": counter.samples, "came": counter.came, "datagrams": 3})
    assert words[0].startswith(f"by the stamps {lost.sum()} samples of 2000")
    assert "3 datagrams" in words[1]


def test_a_sample_is_counted_wherever_it_is_missing():
    for k in (1, *range(WINDOW - 2, WINDOW + 3), 2 * WINDOW, 998):
        assert count(np.delete(np.arange(1000) * 0.01, k), 61)[0].samples == 1


def test_what_a_logger_stamps_late_is_not_lost():
    """One row in fifty late by a period, one in a hundred by five, and those behind it close upon it; some are lost."""
    rng = np.random.default_rng(5)
    even = np.arange(6000) * 0.005
    for late_s, share in ((0.006, 0.02), (0.025, 0.01)):
        t = np.maximum.accumulate(even + np.where(rng.random(6000) < share, late_s, 0.0)) + 1e-6 * np.arange(6000)
        assert count(t, 61)[0].samples == 0
        lost = rng.choice(np.arange(1, 5999), 50, replace=False)
        assert count(np.delete(t, lost), 61)[0].samples == pytest.approx(50, abs=5)


def test_nothing_is_lost_of_stamps_of_arrival_of_a_clock_that_restarts_or_of_a_sensor_that_was_off():
    rng = np.random.default_rng(4)
    late = np.sort(np.arange(3000) * 0.005 + rng.uniform(0.0, 0.006, 3000))
    even = np.arange(3000) * 0.01
    for t in (late, np.concatenate([even, even]), np.concatenate([even, even + 60.0]), np.zeros(500), even[:1]):
        counter, said = count(t, 61)
        assert counter.samples == 0
        assert said == []
        assert describe_losses({"samples": counter.samples, "came": counter.came, "datagrams": 0}) == ()


def test_a_rate_that_changes_is_said_once():
    t = np.concatenate([np.arange(1500) * 0.01, 15.0 + np.arange(1500) * 0.02])
    in_ms = 1e3 * t[-1] + 20.0 * np.arange(1, 1500)
    _, said = count(np.concatenate([t, in_ms]), 100)
    changes = [words for words in said if "rate" in words]
    assert len(changes) == 1
    assert "from 100 to 50 Hz" in changes[0]


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
    assert uninterrupted.sensor_time(whole[-1, 0]) == pytest.approx(rows[-1, 0])
    for block in (7, 5000, *([1] if saved in (305, 654) else [])):
        taken, judge, overlap = resumed(rows, saved, rows, block)
        np.testing.assert_array_equal(taken, whole)
        assert overlap.left_out == saved
        assert judge.counts == uninterrupted.counts


def test_a_source_that_goes_on_later_leaves_a_gap_and_no_more():
    rows = restarting(600)
    for saved in (400, 800):
        taken, judge, overlap = resumed(rows, saved, rows[saved + 40 :])
        assert overlap.left_out == judge.counts["rebooted"] == 0
        assert judge.counts["restart"] == 1
        assert taken[saved, 0] - taken[saved - 1, 0] == pytest.approx(0.41)
        np.testing.assert_array_equal(taken[-500:, 1:COLUMNS], rows[-500:, 1:])


def test_a_sensor_switched_off_and_on_is_carried_on_after_a_gap():
    rows = restarting(740)
    taken, judge, _ = resumed(rows, 700, rows[740:])
    assert judge.counts["rebooted"] == 1
    begins = 740 + RESTART - 1
    np.testing.assert_array_equal(taken[700:, 1:COLUMNS], rows[begins:, 1:])
    assert taken[700, 0] - taken[699, 0] == pytest.approx(UNKNOWN_GAP_S)
    np.testing.assert_allclose(taken[700:, 0] - taken[700, 0], rows[begins:, 0] - rows[begins, 0], rtol=0, atol=1e-9)
    sensor_t = [judge.sensor_time(t) for t in taken[:, 0].tolist()]
    np.testing.assert_allclose(sensor_t, np.delete(rows[:, 0], np.s_[700:begins]), rtol=0, atol=1e-9)


def test_where_the_last_rows_were_lost_the_walk_goes_on():
    for lost, until in ((np.s_[690:720], None), (np.s_[690:710], 780)):
        rows = rows_of(short_walk())[:until]
        taken, _, overlap = resumed(rows, 700, np.delete(rows, lost, axis=0))
        np.testing.assert_array_equal(taken[:, :COLUMNS], np.delete(rows, np.s_[700 : lost.stop], axis=0))
        assert overlap.left_out == 690


def test_a_clock_that_restarted_behind_lost_rows_loses_no_more_than_those_that_show_it():
    rows = restarting(710)
    for block in (1, 40, 5000):
        taken, judge, overlap = resumed(rows, 700, np.delete(rows, np.s_[690:710], axis=0), block)
        assert judge.counts["rebooted"] == 1
        assert overlap.left_out == 690
        np.testing.assert_array_equal(taken[700:, 1:COLUMNS], rows[710 + 99 :, 1:])


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


RATE = 200.0
N = 12_000


def _ticks(drift_ppm: float = 0.0) -> np.ndarray:
    """True sample times of a crystal that drifts linearly by so much in a minute."""
    t = np.arange(N) / RATE
    return t + drift_ppm * 1e-6 * t**2 / 60.0


def _bursts(t: np.ndarray, rng: np.random.Generator, stalls: int, length_s: float) -> np.ndarray:
    """Stamps of a transport that stalls now and then and then delivers all at once, 50 us apart."""
    late = t.copy()
    for start in rng.uniform(t[0] + 1, t[-1] - 1, stalls):
        held = (t >= start) & (t < start + length_s)
        late[held] = start + length_s + 5e-5 * np.arange(np.count_nonzero(held))
    return np.maximum.accumulate(late + 1e-9 * np.arange(len(t)))


@pytest.mark.parametrize("drift_ppm", [0.0, 20.0, -20.0])
@pytest.mark.parametrize("jitter_ms", [0.1, 0.5, 1.0])
def test_white_jitter_and_drift(drift_ppm: float, jitter_ms: float) -> None:
    rng = np.random.default_rng(1)
    truth = _ticks(drift_ppm)
    stamps = np.sort(truth + 1e-3 * jitter_ms * rng.exponential(size=N))
    even = remove_jitter(stamps)
    assert np.std(stamps - truth) > 0.5e-3 * jitter_ms
    assert np.std(even - truth) < 0.15e-3 * jitter_ms
    assert np.std(np.diff(even) - np.diff(truth)) < 0.01e-3 * jitter_ms


def test_dropped_samples_stay_dropped() -> None:
    rng = np.random.default_rng(2)
    kept = np.sort(rng.choice(N, N - 150, replace=False))
    truth = _ticks()[kept]
    even = remove_jitter(np.sort(truth + 3e-4 * rng.exponential(size=len(kept))))
    np.testing.assert_allclose(np.diff(even) * RATE, np.diff(kept), atol=0.02)


def test_bursts_are_no_gaps() -> None:
    rng = np.random.default_rng(3)
    truth = _ticks()
    stamps = _bursts(truth + 1e-4 * rng.exponential(size=N), rng, stalls=40, length_s=0.06)
    assert np.diff(stamps).max() > 0.05
    even = remove_jitter(stamps)
    np.testing.assert_allclose(np.diff(even), 1 / RATE, rtol=1e-3)
    assert np.abs(even - truth - np.median(even - truth)).max() < 5e-4


def test_polling_slower_than_the_sensor() -> None:
    """A logger that looks every 6 ms stamps what it finds with the time of its look."""
    truth = _ticks()
    look = np.ceil(truth / 0.006) * 0.006
    stamps = look + 2e-5 * np.concatenate(([0], np.cumsum(np.diff(look) == 0)))
    stamps = np.maximum.accumulate(stamps) + 1e-7 * np.arange(N)
    assert np.median(np.diff(stamps)) > 0.0055
    assert fit_clock(stamps).period == pytest.approx(1 / RATE, rel=1e-2)
    np.testing.assert_allclose(np.diff(remove_jitter(stamps)), np.mean(np.diff(stamps)), rtol=1e-2)


def test_a_true_gap_that_is_no_whole_number_of_ticks() -> None:
    rng = np.random.default_rng(4)
    truth = _ticks()
    truth[5000:] += 0.1017
    even = remove_jitter(truth + 2e-4 * rng.uniform(size=N))
    assert even[5000] - even[4999] == pytest.approx(0.1067, abs=2e-4)
    np.testing.assert_allclose(np.delete(np.diff(even), 4999), 1 / RATE, rtol=1e-2)


def test_few_uneven_and_even_stamps_are_left_alone() -> None:
    """Where the sensor itself samples unevenly, the deviations add up: its stamps are right."""
    rng = np.random.default_rng(5)
    few = (_ticks()[:n] + 1e-4 * rng.uniform(size=n) for n in (2, 20, 49))
    for t in (np.cumsum(rng.uniform(4e-3, 6e-3, N)), *few, _ticks() + 1e-6 * rng.normal(size=N)):
        assert remove_jitter(t) is t


@needs_data
def test_real_stamps() -> None:
    """Those of vicon and a gdin recording become even; drops of x-io stay."""
    for path in sorted((DATA / "vicon").glob("*.mat"))[::7]:
        t = read_raw(path).t
        even = remove_jitter(t)
        np.testing.assert_allclose(np.diff(even), 0.005, rtol=1e-3)
        assert np.abs(even - t).max() < 5e-3
    t = read_raw(DATA / "gdin/own/SensorConnectData_40.csv").t
    assert np.median(np.diff(t)) > 0.0059
    np.testing.assert_allclose(np.diff(remove_jitter(t)), 0.005, rtol=1e-3)
    t = read(DATA / "xio/short_walk.csv").t
    assert remove_jitter(t) is t
    assert np.count_nonzero(np.diff(fit_clock(t).tick) > 1) == np.count_nonzero(np.diff(t) > 0.004)
