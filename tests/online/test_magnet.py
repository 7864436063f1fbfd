"""A walk in progress past a magnet: that footfall's compass weighs next to nothing, and the heading stays."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.frames import compute_heading
from fg_nav.magnetic.detectors import DEFAULT, find_gate
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import rows_of
from tests.online.walks import NORTH, push, short_walk, solve_in_windows, solve_only_at

STRIDES = 16
SOLVED_AGAIN = (1, 2, 3, 4)  # Footfalls; those behind are judged by the walk in progress.
AT = 8  # Footfall at the magnet.

MAGNET_UT = np.array([50.0, -36.0, 24.0])
NEAR = 8  # Samples before and after the stance that the magnet reaches.


@pytest.fixture(autouse=True)
def solved_again_early(monkeypatch):
    solve_only_at(monkeypatch, *SOLVED_AGAIN)


def walked(field_there: np.ndarray | float, lag_s: float | None = None, compass_alone: bool = False) -> OnlineNavigator:
    """The navigator of a walk in whose field there is something more at one footfall."""
    recording = short_walk(STRIDES)
    stances, rows = detect_stances(recording), rows_of(recording)
    of = stances.footfall == AT
    rows[stances.start[of][0] - NEAR : stances.stop[of][-1] + NEAR, 7:10] += field_there
    more = not compass_alone
    magnetic = replace(NORTH.parameters.magnetic, differential=more, potential=more)
    parameters = replace(NORTH.parameters, magnetic=magnetic)
    navigator = OnlineNavigator(replace(NORTH, lag_s=lag_s, parameters=parameters))
    push(navigator, rows)
    navigator.close()
    return navigator


@cache
def past_a_magnet() -> OnlineNavigator:
    return walked(MAGNET_UT)


@cache
def without_magnet() -> OnlineNavigator:
    return walked(0.0)


def headings(navigator: OnlineNavigator) -> np.ndarray:
    return np.degrees(compute_heading(navigator.causal().nav_R_body))


def test_the_window_of_the_gate_that_holds_the_magnet_is_disturbed_and_no_other():
    field, window = past_a_magnet().finish().moment.field, slice(AT, AT + find_gate(DEFAULT).rows)
    assert set(field[window]) == {"disturbed"}
    assert set(field[SOLVED_AGAIN[-1] : AT] + field[window.stop :]) == {"quasi-static"}
    assert "disturbed" not in without_magnet().causal().field


def test_its_compass_weighs_next_to_nothing():
    """By its compass alone, all is at that footfall nearly as if there had been no sample of the field.

    Its variance follows the gate's statistic, and its loss is robust: at 27 sigmas a hundredth of the weight is left.
    """
    disturbed, unseen = (walked(there, compass_alone=True).causal() for there in (MAGNET_UT, np.nan))
    assert unseen.field[AT] == "none"
    assert unseen.compass_weight[AT] == 0.0
    assert 0.0 < disturbed.compass_weight[AT] < 0.2
    np.testing.assert_allclose(disturbed.nav_R_body[AT], unseen.nav_R_body[AT], atol=1e-3)
    np.testing.assert_allclose(*(np.diagonal(one.pose_cov[AT]) for one in (disturbed, unseen)), rtol=0.01)
    assert walked(0.0, compass_alone=True).causal().heading_sigma[AT] < 0.985 * disturbed.heading_sigma[AT]


def test_the_heading_stays():
    """By what the footfalls in the window of the gate, which weigh less, would have shown of it: two sigmas of that."""
    past, without = (one.causal().heading_sigma for one in (past_a_magnet(), without_magnet()))
    lost = np.degrees(np.sqrt(np.maximum(past**2 - without**2, 0.0)))
    assert (np.abs(headings(past_a_magnet()) - headings(without_magnet())) < 2 * lost + 0.05).all()
    np.testing.assert_allclose(past_a_magnet().causal().position, without_magnet().causal().position, atol=0.1)


@pytest.mark.parametrize("lag_s", [None, 6.0])
def test_what_is_solved_again_in_windows_keeps_its_verdicts(monkeypatch, lag_s):
    solve_in_windows(monkeypatch, behind=6, window=4)
    navigator = walked(MAGNET_UT, lag_s)
    smoothed = navigator.smoothed()
    assert smoothed.field[AT] == "disturbed"
    assert "quasi-static" in smoothed.field[:AT]
    assert "quasi-static" in smoothed.field[AT + find_gate(DEFAULT).rows :]
