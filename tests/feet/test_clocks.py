"""Clocks of two feet that were set apart."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError
from fg_nav.feet import SIDES, Side
from fg_nav.feet.clocks import Swings, list_swings, match_swings
from fg_nav.lab.simulation import simulate_feet
from fg_nav.recording import Recording
from tests.feet.walks import without_field


def swings_of(recording: Recording) -> Swings:
    return list_swings(recording, detect_stances(recording))


def align(feet: dict[Side, Recording], offset: float) -> float:
    left, right = (swings_of(feet[side]) for side in SIDES)
    return match_swings(left, set_clock(right, offset)).offset_s


@pytest.mark.parametrize("offset", [0.0, 0.3, -0.3, 1.2, 1000.0])
def test_an_offset_is_found_and_not_one_of_a_stride_more(offset: float) -> None:
    assert align(without_field(), offset) == pytest.approx(-offset, abs=0.05 * (offset != 0.0))


@pytest.mark.parametrize(("side", "offset"), [("left", 0.0), ("right", 0.3), ("left", -5.0)])
def test_an_interrupted_recording_is_aligned_by_what_both_recorded(side: Side, offset: float) -> None:
    whole = without_field()[side]
    kept = (whole.t < 20.0) | (whole.t > 35.0)
    cut = Recording(whole.t[kept], whole.acc[kept], whole.gyr[kept])
    assert align({**without_field(), side: cut}, offset) == pytest.approx(-offset, abs=0.05)


def test_feet_of_two_walks_are_refused_in_a_sentence() -> None:
    other = simulate_feet("stairs", 8).right.recording
    with pytest.raises(EstimationError, match=r"feet of one walk.*--clock-offset"):
        match_swings(swings_of(without_field()["left"]), swings_of(other))


def walk_feet(
    cycle: float = 1.1, count: int = 60, limp: float = 0.0, bends: tuple[int, ...] = (), seed: int = 1
) -> tuple[Swings, Swings]:
    """Swings of two feet in turn, `limp` of a cycle late on the second one; half turns on the spot at some strides."""
    rng = np.random.default_rng(seed)
    middle = 5.0 + cycle * np.arange(count) + 0.03 * cycle * rng.standard_normal(count)
    swings = []
    for k, late in enumerate((0.0, 0.5 + limp)):
        own = middle + late * cycle + 0.02 * cycle * rng.standard_normal(count)
        turn = 0.05 * rng.standard_normal(count)
        for bend in bends:
            # The one foot turns at once, the other one in two swings.
            turn[bend : bend + 2 - k] += np.pi / (2 - k)
        heading = np.concatenate([[0.0], np.cumsum(turn)])
        swing = 0.2 * cycle
        stands = np.concatenate([[own[0] - 3.0], np.stack([own - swing, own + swing], axis=1).ravel(), [own[-1] + 3.0]])
        holes = np.array([[-np.inf, stands[0]], [stands[-1], np.inf]])
        swings.append(Swings(own, stands, np.repeat(heading, 2), holes))
    return swings[0], swings[1]


def set_clock(swings: Swings, offset: float, rate: float = 1.0) -> Swings:
    """The same by a clock of another rate, that is ahead by an offset at zero."""
    return Swings(
        *(rate * one + offset for one in (swings.middle, swings.t)), swings.heading, rate * swings.holes + offset
    )


@pytest.mark.parametrize("cycle", [0.7, 1.1, 3.5])
@pytest.mark.parametrize("limp", [0.0, 0.12, -0.12])
def test_one_clock_is_left_as_it_is_at_any_speed_with_limping_and_turns_on_the_spot(cycle: float, limp: float) -> None:
    for bends, count in product([(), (3,), (3, 20, 40)], (8, 60)):
        found = match_swings(*walk_feet(cycle, count, limp, tuple(one for one in bends if one < count)))
        assert (found.offset_s, found.drift, found.note) == (0.0, 0.0, "")


@pytest.mark.parametrize("cycle", [0.8, 1.1, 2.6])
@pytest.mark.parametrize("offset", [1.4, -6.0, 900.0])
def test_two_clocks_are_aligned_by_the_turns_on_the_spot(cycle: float, offset: float) -> None:
    a, b = walk_feet(cycle, count=80, bends=(7, 16, 29, 37, 51, 62, 70))
    found = match_swings(a, set_clock(b, offset))
    assert found.offset_s == pytest.approx(-offset, abs=0.05 * cycle)
    assert found.drift == 0.0


def test_clocks_are_aligned_though_a_gyroscope_drifts_and_its_foot_is_turned_by_hand() -> None:
    """What turns one foot alone is its bias, which is a median: four turns of 6 rad are none of it."""
    a, b = walk_feet(count=80, bends=(7, 16, 29, 37, 51, 62, 70))
    stride = np.arange(len(b.heading)) // 2
    by_hand = sum(6.0 * (stride > at) for at in (3, 27, 51, 75))
    found = match_swings(a, set_clock(replace(b, heading=b.heading + 0.25 * stride + by_hand), 1.4))
    assert found.offset_s == pytest.approx(-1.4, abs=0.05)


@pytest.mark.parametrize("rate", [0.988, 1.01])
def test_a_clock_that_runs_fast_is_found_with_its_rate(rate: float) -> None:
    a, b = walk_feet(count=120, bends=(9, 26, 45, 61, 80, 99))
    found = match_swings(a, set_clock(b, 0.4, rate))
    assert 1.0 + found.drift == pytest.approx(1.0 / rate, abs=0.0008)
    np.testing.assert_allclose(found.shift(rate * b.middle + 0.4), b.middle, atol=0.08)
    assert "one of the clocks runs fast" in found.note


def test_an_even_straight_walk_does_not_show_which_stride_it_is() -> None:
    a, b = walk_feet(count=200)
    with pytest.raises(EstimationError, match="a stride more or less"):
        match_swings(a, set_clock(b, 3.85))
