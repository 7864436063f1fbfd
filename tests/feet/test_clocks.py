"""Clocks of two feet that were set apart."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError
from fg_nav.feet.clocks import Swings, _choose, align_clocks, list_swings
from fg_nav.lab.simulation import simulate_feet
from fg_nav.recording import Recording

Feet = dict[str, Recording]


@pytest.fixture(scope="module")
def feet() -> Feet:
    walk = simulate_feet("demo", 7)
    return {side: replace(one.recording, truth=None, mag=None) for side, one in walk.sides.items()}


def align(feet: Feet, offset: float) -> float:
    left, right = feet["left"], feet["right"]
    stances = [detect_stances(one) for one in (left, right)]
    return align_clocks(left, stances[0], replace(right, t=right.t + offset), stances[1]).offset_s


def test_clocks_that_fit_stay_as_they_are(feet: Feet) -> None:
    assert align(feet, 0.0) == 0.0


@pytest.mark.parametrize("offset", [0.3, -0.3, 1.2, -11.0, 1000.0, -50.0])
def test_an_offset_is_found_and_not_one_of_a_stride_more(feet: Feet, offset: float) -> None:
    assert align(feet, offset) == pytest.approx(-offset, abs=0.05)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("offset", [0.0, 0.3, -5.0])
def test_an_interrupted_recording_is_aligned_by_what_both_recorded(feet: Feet, side: str, offset: float) -> None:
    t = feet[side].t
    kept = (t < 20.0) | (t > 35.0)
    cut = Recording(t[kept], feet[side].acc[kept], feet[side].gyr[kept])
    assert align({**feet, side: cut}, offset) == pytest.approx(-offset, abs=0.05)


def test_feet_of_two_walks_are_refused_in_a_sentence(feet: Feet) -> None:
    other = simulate_feet("stairs", 8).right.recording
    left = feet["left"]
    with pytest.raises(EstimationError, match=r"feet of one walk.*--clock-offset"):
        align_clocks(left, detect_stances(left), other, detect_stances(other))


def test_an_even_walk_does_not_show_which_stride_it_is() -> None:
    tau = np.linspace(-5.0, 5.0, 251)
    nats = -20.0 * np.sin(np.pi * (tau - 0.3) / 1.1) ** 2
    with pytest.raises(EstimationError, match="a stride more or less"):
        _choose(tau, nats, 1.1)


def test_the_turns_of_both_feet_are_those_of_the_way(feet: Feet) -> None:
    swings: list[Swings] = [list_swings(one, detect_stances(one)) for one in feet.values()]
    at = np.linspace(10.0, 55.0, 40)
    left, right = (np.interp(at, one.t, one.heading) for one in swings)
    assert np.ptp(left) > 1.0  # the way turns
    assert np.std(left - right) < 0.15
