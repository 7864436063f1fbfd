"""Stance intervals: mask and intervals are one another, and the stillest sample of a footfall is its stillest."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fg_nav.arrays import find_runs
from fg_nav.detection.stance import Stances

masks = st.lists(st.booleans(), min_size=1, max_size=60).map(lambda bits: np.array(bits, dtype=bool))


@given(mask=masks)
def test_runs_are_the_stretches_of_true(mask):
    start, stop = find_runs(mask)
    assert np.all(stop > start)
    assert np.all(start[1:] > stop[:-1])  # else they would be one
    rebuilt = np.zeros_like(mask)
    for a, b in zip(start, stop, strict=True):
        rebuilt[a:b] = True
    np.testing.assert_array_equal(rebuilt, mask)


@given(mask=masks)
def test_a_mask_comes_back_from_its_intervals(mask):
    stances = Stances.from_mask(mask, "labels")
    np.testing.assert_array_equal(stances.mask, mask)
    assert (stances.n_samples, stances.detector) == (len(mask), "labels")
    assert stances.n_footfalls == len(stances) == len(find_runs(mask)[0])


def test_no_samples_and_no_stances():
    assert len(Stances.from_mask(np.zeros(0, dtype=bool))) == 0
    nothing = Stances.from_mask(np.zeros(10, dtype=bool))
    assert nothing.n_footfalls == 0
    assert not nothing.mask.any()
    assert len(nothing.stillest(np.ones((10, 3)))) == 0


INTERVALS = Stances(
    start=np.array([0, 10, 20]), stop=np.array([5, 15, 30]), footfall=np.array([0, 0, 1]), n_samples=30, detector="shoe"
)


def test_footfalls_may_have_several_intervals():
    assert (len(INTERVALS), INTERVALS.n_footfalls) == (3, 2)
    assert INTERVALS.mask.sum() == 20


def test_the_stillest_sample_by_rate():
    gyr = np.ones((30, 3))
    gyr[[3, 12, 17, 25]] *= np.array([[0.5], [0.2], [0.01], [0.3]])  # 17 lies in the swing
    assert INTERVALS.stillest(gyr).tolist() == [12, 25]


def test_the_stillest_sample_by_statistic_where_there_is_one():
    statistic = np.full(30, 0.9)
    statistic[[4, 29]] = 0.1
    judged = Stances(INTERVALS.start, INTERVALS.stop, INTERVALS.footfall, 30, statistic=statistic)
    gyr = np.ones((30, 3))
    gyr[12] = 0.0
    assert judged.stillest(gyr).tolist() == [4, 29]


@given(mask=masks, seed=st.integers(0, 9))
def test_the_stillest_sample_lies_in_its_footfall(mask, seed):
    stances = Stances.from_mask(mask)
    gyr = np.random.default_rng(seed).standard_normal((len(mask), 3))
    sample = stances.stillest(gyr)
    assert np.all((sample >= stances.start) & (sample < stances.stop))
    for i, a, b in zip(sample, stances.start, stances.stop, strict=True):
        assert np.linalg.norm(gyr[i]) == pytest.approx(np.linalg.norm(gyr[a:b], axis=1).min())


def test_a_footfall_spans_all_stances_that_it_has():
    stances = Stances(np.array([2, 6, 20]), np.array([4, 9, 30]), np.array([0, 0, 1]), n_samples=40, detector="given")
    arrives, leaves = stances.spans
    assert (arrives.tolist(), leaves.tolist()) == ([2, 20], [9, 30])
    none = Stances.from_mask(np.zeros(5, dtype=bool)).spans
    assert [len(one) for one in none] == [0, 0]
