"""The number of the floor: by the heights of footfalls, through stairs, slopes, kerbs and drift."""

from functools import reduce

import numpy as np
import pytest

from fg_nav.online.strides import FloorTrack, number_floors, track_floors

FLIGHT = [0.34] * 5
CORRIDOR = [0.0] * 12


def numbers_of(climbs: list[float]) -> list[int | None]:
    """Number at each footfall of a walk that climbs by so much a stride."""
    track, found = FloorTrack(), []
    for height in np.cumsum(climbs).tolist():
        track = track.add(height)
        found.append(track.number)
    return found


def test_stairs_lead_from_floor_to_floor_and_back() -> None:
    down = [-x for x in FLIGHT]
    numbers = numbers_of(
        [*CORRIDOR, *FLIGHT, 0.0, *FLIGHT, *CORRIDOR, *down, 0.0, *down, *CORRIDOR, *down, *down, *CORRIDOR]
    )
    assert numbers[:12] == [0] * 12
    assert numbers[12:25] == [None] * 11 + [None] * 2
    assert numbers[26:35] == [1] * 9
    assert set(numbers[35:46]) == {None}
    assert numbers[49:58] == [0] * 9
    assert numbers[-8:] == [-1] * 8


@pytest.mark.parametrize(("a_stride", "number"), [(0.01, 0), (-0.01, 0), (0.07, None)])
def test_a_gentle_slope_or_a_drift_is_the_same_floor_and_a_ramp_is_none(a_stride: float, number: int | None) -> None:
    assert numbers_of([*CORRIDOR, *[a_stride] * 300])[-1] == number


def test_a_kerb_and_a_floor_that_is_met_again_elsewhere_begin_no_number() -> None:
    assert number_floors([0.0, 0.15, 3.2, 3.5, 6.4, -3.1, -1.6, 1.7]) == [0, 0, 1, 1, 2, -1, None, None]
    assert set(numbers_of([*CORRIDOR, 0.15, *CORRIDOR][-4:])) == {0}


def test_a_solution_of_the_walk_says_on_which_floor_it_is() -> None:
    heights = np.concatenate([np.zeros(6), [0.5, 1.0, 1.5, 2.0, 2.5], np.full(4, 3.0), [3.0]])
    floor = np.array([0] * 6 + [-1] * 5 + [1] * 4 + [-1])
    pieces = np.zeros(len(heights), dtype=bool)
    assert track_floors(heights, floor, pieces).number == 1
    assert track_floors(heights[:9], floor[:9], pieces[:9]).number is None
    assert track_floors(heights[:4], None, pieces[:4]).number == 0
    # A standing on a stair, in pieces, is no floor.
    standing = np.concatenate([np.zeros(4), np.full(6, 2.5)])
    assert track_floors(standing, None, np.arange(10) > 4).number is None
    assert reduce(FloorTrack.add, [3.0] * 4, track_floors(heights[:9], floor[:9], pieces[:9])).number == 1
