"""Delay and axes of the magnetometer while the walk goes on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fg_nav.magnetic.axes import MagAxes
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import rows_of
from fg_nav.recording import Recording
from tests.magnetic.turning_walks import minute
from tests.online.walks import NORTH, push

LATE_S, ROWS = 0.022, 2700


@cache
def late_walk() -> Recording:
    """Twenty-seven seconds at 100 Hz."""
    return replace(minute(5, LATE_S, rate_hz=100.0), truth=None).slice(0, ROWS)


@pytest.fixture(scope="module")
def walked() -> OnlineNavigator:
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows_of(late_walk()))
    return navigator


def test_the_delay_is_found_on_the_way_and_taken_off_what_follows(walked):
    walk = walked.smoother.walk
    delay = walk.sensor.magnetometer.delay
    assert delay.taken_off
    assert delay.tau_s == pytest.approx(LATE_S, abs=0.0015)
    right = minute(5, 0.0, "indoor", 100.0).mag[: walk.stop]
    cut = walk.cut_whole().mag
    known = np.isfinite(cut).all(axis=1)
    assert np.flatnonzero(~known).min() >= len(cut) - 4
    error, before = (mag[known] - right[known] for mag in (cut, rows_of(late_walk())[: walk.stop, 7:10]))
    assert np.sqrt(np.mean(error**2)) < 0.25 * np.sqrt(np.mean(before**2))
    np.testing.assert_allclose(walk.cut_recording(walk.stop - 500).mag, cut[-500:], atol=1e-9)
    for notes in (walked.smoother.initial.notes, walked.finish().notes):
        assert any("ms late" in note for note in notes)


def test_wrong_axes_are_said_once_and_not_used():
    turned = MagAxes(MagAxes.parse("y,x,z").P.T).apply_to(late_walk())
    said: list[str] = []
    navigator = OnlineNavigator(NORTH, said.append)
    push(navigator, rows_of(turned))
    assert sum("--mag-axes=y,x,z" in words for words in said) == 1
    assert navigator.smoother.walk.cut_whole().mag is None
