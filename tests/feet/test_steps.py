"""Steps of a person who walks on a known curve, the person between the feet, and clocks that were set apart."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from fg_nav.both_feet import _find_footfalls
from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError
from fg_nav.feet import SIDES, Side
from fg_nav.feet.clocks import Swings, list_swings, match_swings
from fg_nav.feet.person import trace_person
from fg_nav.feet.steps import (
    CELL_M,
    Footfalls,
    average_cells,
    find_steps,
    measure_relative_heading,
    measure_turns,
)
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab.simulation import simulate_feet
from fg_nav.recording import Recording
from fg_nav.solution import Solution, StanceTable
from fg_nav.walk import Walk, find_stances
from tests.feet.walks import demo_feet, truth_of, without_field

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


# --- the person between two feet, whose paths are given


SPEED = 1.3
HOLE = (20.0, 35.0)


def true_foot(side: Side, kept: tuple[tuple[float, float], ...]) -> Solution:
    """A foot that was recorded during some spans, and is where it is; a footfall each second."""
    truth = truth_of(side)
    rows = np.flatnonzero(np.any([(truth.t >= begin) & (truth.t <= end) for begin, end in kept], axis=0))
    t, position = truth.t[rows], truth.position[rows]
    velocity = np.gradient(truth.position, truth.t, axis=0)[rows]
    sample = np.arange(0, len(t), 200)
    count = len(sample)
    table = StanceTable(
        sample, t[sample], position[sample], np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)),
        np.tile(np.eye(3), (count, 1, 1)), np.ones(count), np.zeros((count, 3)), ("none",) * count, ("",) * count,
    )  # fmt: skip
    return Solution("smoother", t, position, velocity, np.tile(np.eye(3), (len(t), 1, 1)), table, 0.0)


Spans = tuple[tuple[float, float], ...]
WHOLE: Spans = ((0.0, 60.0),)
BROKEN: Spans = ((0.0, HOLE[0]), (HOLE[1], 60.0))


def trace(left: Spans, right: Spans) -> Solution:
    feet = true_foot("right", right), true_foot("left", left)
    return trace_person(*feet, np.zeros(1), 4.0 * np.eye(4)[None])


@pytest.mark.parametrize(("left", "right"), [(WHOLE, BROKEN), (BROKEN, WHOLE)])
def test_in_a_hole_of_one_foot_the_person_goes_on_as_the_other_one(left: Spans, right: Spans) -> None:
    whole, person = trace(WHOLE, WHOLE), trace(left, right)
    assert np.diff(person.t).max() < 0.02
    outside = (person.t < HOLE[0]) | (person.t > HOLE[1])
    same = np.stack([np.interp(person.t, whole.t, column) for column in whole.position.T], axis=1)
    apart = np.linalg.norm(person.position - same, axis=1)
    assert apart[outside].max() < 1e-6
    assert 0.05 < apart[~outside].max() < 0.6  # a foot is ahead of the person, or behind, by half a step
    assert apart[~outside].mean() < 0.3
    # and moves as the foot that was recorded
    moved = np.linalg.norm(np.diff(person.position[~outside][:, :2], axis=0), axis=1).sum()
    assert moved == pytest.approx(SPEED * (HOLE[1] - HOLE[0]), rel=0.25)
    # with the footfalls of that one, as uncertain as it and half of what both differ by
    assert np.diff(person.stances.t).max() < 1.5
    np.testing.assert_allclose(person.stances.pose_cov, np.tile(2.0 * np.eye(4), (len(person.stances), 1, 1)))


def test_what_the_feet_differ_by_is_known_between_the_times_it_is_given_for_in_any_order() -> None:
    feet = true_foot("right", WHOLE), true_foot("left", WHOLE)
    t, size = np.array([10.0, 50.0, 30.0]), np.array([1.0, 1.0, 5.0])
    person = trace_person(*feet, t, size[:, None, None] * np.eye(4))
    expected = 1.0 + 0.25 * np.interp(person.stances.t, [10.0, 30.0, 50.0], [1.0, 5.0, 1.0])
    np.testing.assert_allclose(person.stances.position_cov[:, 2, 2], expected)


def test_where_neither_was_recorded_nothing_is_made_up() -> None:
    person = trace(BROKEN, BROKEN)
    assert np.diff(person.t).max() == pytest.approx(HOLE[1] - HOLE[0], abs=0.02)


# --- clocks that were set apart


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
    cycle: float = 1.1, count: int = 60, limp: float = 0.0, bends: tuple[int, ...] = ()
) -> tuple[Swings, Swings]:
    """Swings of two feet in turn, `limp` of a cycle late on the second one; half turns on the spot at some strides."""
    rng = np.random.default_rng(1)
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
