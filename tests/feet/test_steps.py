"""Steps of a person who walks on a known curve, and how they show the sensors turned to each other."""

import numpy as np
import pytest

from fg_nav.both_feet import _find_footfalls
from fg_nav.errors import EstimationError
from fg_nav.feet.steps import (
    CELL_M,
    Footfalls,
    average_cells,
    find_steps,
    measure_relative_heading,
    measure_turns,
)
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.walk import Walk, find_stances
from tests.feet.walks import demo_feet

WIDTH, STEP = 0.16, 0.7


def walk_curve(radius: float, steps: int = 60) -> tuple[Footfalls, Footfalls]:
    """Right and left footfalls, in turn, at both sides of a circle; of a straight line where the radius is infinite."""
    k = np.arange(steps)
    arc, side = STEP * k, np.where(k % 2 == 0, -0.5, 0.5) * WIDTH  # left of the way
    if np.isinf(radius):
        place = np.stack([arc, side, np.zeros(steps)], axis=1)
    else:
        angle = arc / radius
        place = np.stack([(radius - side) * np.sin(angle), radius - (radius - side) * np.cos(angle), 0.0 * k], axis=1)
    t = 0.55 * k
    return Footfalls(t[::2], place[::2]), Footfalls(t[1::2], place[1::2])


def test_each_footfall_in_a_row_is_a_step_between_two_of_the_other() -> None:
    right, left = walk_curve(np.inf)
    steps = find_steps(right, left)
    assert steps.at.tolist() == list(range(1, 30))
    np.testing.assert_array_equal(steps.before, steps.at - 1)
    np.testing.assert_allclose(steps.left_normal, np.tile([0.0, 1.0], (29, 1)), atol=1e-12)


@pytest.mark.parametrize("radius", [np.inf, 8.0, 3.0, -3.0])
def test_the_means_of_a_cell_are_the_width_apart_however_the_way_bends(radius: float) -> None:
    cells = average_cells(*walk_curve(radius))
    assert len(cells) > 3
    assert cells.steps.sum() == pytest.approx(58.0, abs=4.0)  # each step counts once
    beside = cells.left[:, :2] - WIDTH * cells.left_normal
    apart = np.linalg.norm(cells.right[:, :2] - beside, axis=1)
    # The middle of a chord alone is off by this much.
    bend = (2.0 * STEP) ** 2 / (8.0 * abs(radius))
    assert apart.max() < 0.01 + 0.35 * bend


def test_a_short_walk_has_small_cells_of_larger_sigma() -> None:
    cells, long = (average_cells(*walk_curve(np.inf, count)) for count in (10, 90))
    assert len(cells) >= 2
    assert cells.grown < 0.5
    assert long.grown == 1.0
    assert cells.steps.max() < long.steps.max()
    np.testing.assert_allclose(cells.left[:, 1] - cells.right[:, 1], WIDTH, atol=1e-9)


def test_a_halt_a_shuffle_and_a_hop_are_no_steps() -> None:
    right, left = walk_curve(np.inf, 20)
    shuffled = Footfalls(right.t, right.position * [0.2, 1.0, 1.0])
    halting = Footfalls(right.t * 4.0, right.position)
    hopping = Footfalls(np.sort(np.append(right.t, right.t + 0.1)), np.repeat(right.position, 2, axis=0))
    assert find_steps(left, shuffled).weight.max() < 0.2
    assert len(find_steps(hopping, left).at) == 0
    # Who is slow all along walks, whatever the time of a stride; a halt in between is none.
    steps = find_steps(Footfalls(left.t * 4.0, left.position), halting)
    assert steps.weight.min() > 0.9
    halt = np.where(np.arange(len(right)) > 4, 10.0, 0.0), np.where(np.arange(len(left)) > 4, 10.0, 0.0)
    steps = find_steps(Footfalls(left.t + halt[1], left.position), Footfalls(right.t + halt[0], right.position))
    assert steps.weight.min() > 0.9
    assert len(steps.at) == 8  # of nine


@pytest.mark.parametrize("turn", [0.0, 0.3, -2.0])
def test_the_turn_of_one_path_against_the_other_is_found(turn: float) -> None:
    right, left = walk_curve(6.0)
    c, s = np.cos(turn), np.sin(turn)
    turned = Footfalls(right.t, right.position @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    found = measure_turns(turned, left)[1]
    np.testing.assert_allclose(np.angle(found * np.exp(-1j * turn)), 0.0, atol=0.03)


def test_a_long_walk_has_fewer_cells_and_these_are_not_far_apart() -> None:
    cells = average_cells(*walk_curve(np.inf, 8000))  # 5.6 km
    apart = np.diff(cells.right[:, 0])
    assert 100 < len(cells) < 400
    assert apart.max() < 30.0 + 2.0 * CELL_M


@pytest.mark.parametrize("foot", [0, 1])
def test_no_step_no_cell_and_no_turn_crosses_a_hole(foot: int) -> None:
    """Behind it a path may lie anywhere: moved by ten meters, it moves the cells behind by as much, and no other."""
    feet = list(walk_curve(np.inf))
    hole = float(feet[0].t[len(feet[0]) // 2]) + 0.1
    moved = feet.copy()
    behind = feet[foot].t > hole
    position = feet[foot].position + [0.0, 0.0, 10.0] * behind[:, None]
    moved[foot] = Footfalls(feet[foot].t, position, np.array([hole]))
    before = average_cells(*moved)
    apart = before.right[:, 2] - before.left[:, 2]
    assert set(np.round(np.abs(apart), 9)) == {0.0, 10.0}
    np.testing.assert_array_equal(np.abs(apart) > 5.0, before.t > hole)
    aside = feet[foot].position + [0.0, 40.0, 0.0] * behind[:, None]
    feet[foot] = Footfalls(feet[foot].t, aside, np.array([hole]))
    np.testing.assert_allclose(np.angle(measure_turns(*feet)[1]), 0.0, atol=1e-9)


# --- of sensors that are turned --------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [5, 12])
def test_the_steps_show_how_the_right_sensor_is_turned_from_the_left_one(seed: int) -> None:
    sides = demo_feet(seed).sides
    right, left = walks = [find_stances(Walk.of(sides[side].recording)) for side in ("right", "left")]
    starts = [compute_heading(one.recording.truth.nav_R_body[one.stances.start[0]]) for one in (right, left)]
    found = measure_relative_heading(*map(_find_footfalls, walks))
    assert np.degrees(abs(wrap_angle(found - (starts[0] - starts[1])))) < 2.0


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
