"""Stance intervals: mask and intervals are one another, and the stillest sample of a footfall is its stillest."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fg_nav.detection.stance import Stances

masks = st.lists(st.booleans(), min_size=1, max_size=60).map(lambda bits: np.array(bits, dtype=bool))


@given(mask=masks, seed=st.integers(0, 9))
def test_a_mask_comes_back_from_its_intervals_and_the_stillest_sample_lies_in_its_footfall(mask, seed):
    stances = Stances.from_mask(mask, "labels")
    start, stop = stances.start, stances.stop
    assert np.all(stop > start)
    assert np.all(start[1:] > stop[:-1])  # else they would be one
    rebuilt = np.zeros_like(mask)
    for a, b in zip(start, stop, strict=True):
        rebuilt[a:b] = True
    np.testing.assert_array_equal(rebuilt, mask)
    np.testing.assert_array_equal(stances.mask, mask)
    assert (stances.n_samples, stances.detector, stances.n_footfalls) == (len(mask), "labels", len(stances))
    rate = np.linalg.norm(np.random.default_rng(seed).standard_normal((len(mask), 3)), axis=1)
    sample = stances.stillest(rate[:, None] * [1.0, 0.0, 0.0])
    assert np.all((sample >= start) & (sample < stop))
    assert rate[sample].tolist() == [rate[a:b].min() for a, b in zip(start, stop, strict=True)]


def test_no_samples_and_no_stances():
    assert len(Stances.from_mask(np.zeros(0, dtype=bool))) == 0
    nothing = Stances.from_mask(np.zeros(10, dtype=bool))
    assert nothing.n_footfalls == 0
    assert not nothing.mask.any()
    assert len(nothing.stillest(np.ones((10, 3)))) == 0
    assert [len(one) for one in nothing.spans] == [0, 0]


INTERVALS = Stances(
    start=np.array([0, 10, 20]), stop=np.array([5, 15, 30]), footfall=np.array([0, 0, 1]), n_samples=30, detector="shoe"
)


def test_a_footfall_of_several_intervals_has_one_span_and_one_stillest_sample():
    arrives, leaves = INTERVALS.spans
    assert (arrives.tolist(), leaves.tolist()) == ([0, 20], [15, 30])
    assert (len(INTERVALS), INTERVALS.n_footfalls, INTERVALS.mask.sum()) == (3, 2, 20)
    gyr = np.ones((30, 3))
    gyr[[3, 12, 17, 25]] *= np.array([[0.5], [0.2], [0.01], [0.3]])  # 17 lies in the swing
    assert INTERVALS.stillest(gyr).tolist() == [12, 25]
    statistic = np.full(30, 0.9)
    statistic[[4, 29]] = 0.1
    assert replace(INTERVALS, statistic=statistic).stillest(gyr).tolist() == [4, 29]  # which goes first
