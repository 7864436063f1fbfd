"""Two sensors that send at once, and a sensor that is worn elsewhere, are seen in the first minute."""

import numpy as np
import pytest

from fg_nav.detection.source import SourceCheck
from fg_nav.errors import EstimationError, StreamError
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online.buffer import rows_of


@pytest.fixture(scope="module")
def feet():
    """Rows of a foot and of the thigh of another walk, 100 Hz."""
    walks = [simulate("demo", seed, Choices(worn=worn, rate_hz=100.0)) for seed, worn in ((104, None), (105, "pocket"))]
    return [rows_of(walk.recording)[:3000] for walk in walks]


def check(rows, mount="foot", block=61):
    """Look at rows in blocks; the remarks."""
    remarks = []
    looks = SourceCheck(mount, remarks.append)
    for start in range(0, len(rows), block):
        looks.push(rows[start : start + block])
    return remarks


def alternate(one, other, length):
    """Rows of two, so many of each in turn."""
    pieces = [piece[k : k + length] for k in range(0, len(one), length) for piece in (one, other)]
    return np.concatenate(pieces)


def test_one_sensor_passes_where_it_is_said_to_be_worn_and_nowhere_else(feet):
    assert check(feet[0]) == check(feet[1], "pocket") == []
    for rows, mount, words in (
        (feet[1], "foot", "add --mount pocket"),
        (feet[0], "pocket", "leave --mount pocket out"),
    ):
        with pytest.raises(EstimationError, match=words):
            check(rows, mount)


@pytest.mark.parametrize("length", [1, 10])
@pytest.mark.parametrize("offset", [0.0, 0.0031, 412.7])
@pytest.mark.parametrize("begin", [0, 1200])
def test_two_sensors_are_refused(feet, length, offset, begin):
    """Standing or walking, row by row or in datagrams, with one clock or two."""
    one, other = (rows[begin:].copy() for rows in feet)
    other[:, 0] += offset
    with pytest.raises(StreamError, match="two sensors") as refused:
        check(alternate(one, other, length))
    assert "\n" not in str(refused.value)


def test_two_sensors_late_in_a_walk_are_remarked(feet):
    one, other = feet
    before = np.concatenate([one, one, one])
    before[:, 0] = np.arange(len(before)) / 100.0
    later = alternate(one, other, 1)
    later[:, 0] += before[-1, 0]
    remarks = check(np.concatenate([before, later]))
    assert len(remarks) == 1
    assert "two sensors" in remarks[0]


def test_rows_that_a_network_delays_or_sends_twice_and_a_clock_that_restarts_are_of_one_sensor(feet):
    rng = np.random.default_rng(2)
    late = feet[0][:, 0] + rng.choice([0.0, 0.05], len(feet[0]), p=[0.9, 0.1])
    again = feet[0].copy()
    again[1000:, 0] -= 9.0
    for rows in (feet[0][np.argsort(late, kind="stable")], np.repeat(feet[0], 2, axis=0), again):
        assert check(rows) == []


def test_of_a_clock_that_hardly_goes_nothing_is_kept(feet):
    slow = np.tile(feet[0][:200], (1600, 1))
    for t in (np.arange(len(slow)) * 1e-5, np.full(len(slow), 3.0)):
        looks = SourceCheck("foot", print)
        looks.push(np.column_stack([t, slow[:, 1:]]))
        assert looks._seen == []


def test_numbers_beyond_all_bounds_are_no_samples(feet):
    rows = feet[0].copy()
    rows[::7, 1:7] = [1e200, -1e308, 1e38, 1e300, np.inf, -1e200]
    with np.errstate(all="raise"):
        assert check(rows) == []
