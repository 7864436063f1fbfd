"""How the sensors of two feet are turned to each other."""

import numpy as np
import pytest

from fg_nav.both_feet import _find_footfalls
from fg_nav.errors import EstimationError
from fg_nav.feet.steps import Footfalls, measure_relative_heading
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab.simulation import simulate_feet
from fg_nav.walk import Walk, find_stances


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_the_steps_show_how_the_right_sensor_is_turned_from_the_left_one(seed: int) -> None:
    feet = simulate_feet("demo", seed)
    walks = {side: find_stances(Walk.of(one.recording)) for side, one in feet.sides.items()}
    starts = {}
    for side, walk in walks.items():
        truth = feet.sides[side].recording.truth
        starts[side] = compute_heading(truth.nav_R_body[walk.stances.start[0]])
    found = measure_relative_heading(*(_find_footfalls(walks[side]) for side in ("right", "left")))
    assert np.degrees(abs(wrap_angle(found - (starts["right"] - starts["left"])))) < 2.0


def walk_line(heading: float, drift: float = 0.0, side: float = 0.0) -> Footfalls:
    """A foot's path on a straight way that its sensor has begun with zero: turned by its heading, and drifting."""
    t = 1.1 * np.arange(200) + (0.55 if side else 0.0)
    angle = heading + drift * t  # counter-clockwise
    step = 1.4 * np.stack([np.cos(angle), np.sin(angle), np.zeros(len(t))], axis=1)
    return Footfalls(t, np.cumsum(step, axis=0) + np.array([0.0, side, 0.0]))


@pytest.mark.parametrize("turned", [0.0, 0.4, -2.0, 3.1])
def test_it_is_clockwise_and_that_of_the_first_minute(turned: float) -> None:
    """A right path that lies counter-clockwise of the left one is that of a sensor turned clockwise by as much.

    Both paths begin with the same heading of their sensors, so that of the right sensor is more.
    """
    found = measure_relative_heading(walk_line(turned, drift=0.002, side=-0.15), walk_line(0.0))
    assert abs(wrap_angle(found - turned - 0.002 * 30.0)) < 0.03


@pytest.mark.parametrize("foot", [0, 1])
def test_behind_a_hole_a_path_is_turned_by_anything(foot: int) -> None:
    feet = [walk_line(0.3, side=-0.15), walk_line(0.0)]
    t, place = feet[foot].t, feet[foot].position
    hole, behind = 20.2, feet[foot].t > 20.2
    turned = np.where(behind[:, None], place[:, [1, 0, 2]] * [-1.0, 1.0, 1.0] + [50.0, 0.0, 0.0], place)
    kept = (t < hole) | (t > hole + 8.0)
    feet[foot] = Footfalls(t[kept], turned[kept], np.array([hole]))
    assert abs(wrap_angle(measure_relative_heading(*feet) - 0.3)) < 0.03


def test_feet_that_take_no_step_in_turn_are_refused() -> None:
    left = walk_line(0.0)
    with pytest.raises(EstimationError, match=r"no step in turn.*--clock-offset"):
        measure_relative_heading(Footfalls(left.t + 1000.0, left.position), left)
