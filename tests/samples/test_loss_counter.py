"""Samples that were lost on the way are counted by the stamps, and a rate that changes is said."""

import numpy as np
import pytest

from fg_nav.samples.delivery import WINDOW, LossCounter, describe_losses


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
