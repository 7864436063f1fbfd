"""Both feet of a person: they alternate on one floor in one field, and the right one is that of a walk of one foot."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import SCENARIOS, Choices, Person, SimulatedFeet, simulate, simulate_feet
from fg_nav.lab.simulation.feet import draw_step_width, plan_left_foot
from fg_nav.lab.simulation.foot import build_foot_motion
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import polyline, straight
from fg_nav.lab.simulation.person import INSTEP, Scatter
from fg_nav.lab.simulation.plan import Stairs, Stand, TurnOnSpot, Walk, plan_walk

IDEAL = Choices(sensor="ideal")
CORRIDOR = polyline([(0, 0), (0, 12), (9, 12)], 1.2)
SHORT = replace(SCENARIOS["demo"], name="short", route=lambda rng: [Stand(3.0), Walk(CORRIDOR), Stand(3.0)])
LONG = replace(
    SCENARIOS["demo"], name="long", route=lambda rng: [Stand(3.0), Walk(straight(200.0)), Stand(3.0)],
    field="homogeneous",
)  # fmt: skip
STEADY = Scatter(footprint_m=0.0, heading_rad=0.0, wander_m=0.0, pace=0.0)
LEG_REACH_M = 1.0
BALL_M, HEEL_M, LIFTED_M = 0.10, 0.12, 0.01
"""Ends of the sole before and behind the pivot, and how high the lower one is of a foot in the air."""


@pytest.fixture(scope="module")
def ideal() -> SimulatedFeet:
    return simulate_feet(SHORT, 3, IDEAL)


@pytest.fixture(scope="module")
def along() -> SimulatedFeet:
    """Straight ahead for 200 m."""
    return simulate_feet(LONG, 5, replace(IDEAL, rate_hz=50.0))


def walking(feet: SimulatedFeet, step_s: float = 0.005):
    """Instants at which both feet have made their first stride and neither its last."""
    both = feet.left.strides, feet.right.strides
    return np.arange(max(s.start[2] for s in both), min(s.start[-2] for s in both), step_s)


def grounded(feet: SimulatedFeet, t):
    """Whether each foot (2, N) touches the floor."""
    touching = []
    for motion, walk in zip(feet.motions, (feet.left, feet.right), strict=True):
        height = motion.up.at(t)[0] - walk.strides.footprint[0, 2]
        pitch = motion.pitch.at(t)[0]
        touching.append(np.minimum(height - BALL_M * np.sin(pitch), height + HEEL_M * np.sin(pitch)) < LIFTED_M)
    return np.array(touching)


def sideways(feet: SimulatedFeet):
    """Distances (S,) m sideways of successive footprints, on a straight path."""
    prints = [(start, walk.strides.footprint[k + 1]) for walk in (feet.left, feet.right)
              for k, start in enumerate(walk.strides.start)]  # fmt: skip
    places = np.array([place for _, place in sorted(prints, key=lambda one: one[0])])
    heading = feet.right.strides.heading.mean()
    aside = places @ [np.cos(heading), -np.sin(heading), 0.0]
    return np.abs(np.diff(aside[:-2]))  # but for the closing steps


def test_the_right_foot_is_that_of_a_walk_of_one_foot():
    one, feet = simulate(SHORT, 4), simulate_feet(SHORT, 4)
    for column in ("t", "acc", "gyr", "mag"):
        np.testing.assert_array_equal(getattr(feet.right.recording, column), getattr(one.recording, column))
    np.testing.assert_array_equal(feet.right.recording.truth.position, one.recording.truth.position)
    np.testing.assert_array_equal(feet.right.strides.footprint, one.strides.footprint)
    assert feet.right.drawn == one.drawn
    assert feet.right.person == one.person


def test_a_person_in_the_mirror_is_another_and_twice_the_same():
    person = Person().draw(np.random.default_rng(1)).with_moving_feet(np.random.default_rng(2))
    assert person.mirror() != person == person.mirror().mirror()
    strides = plan_walk([Stand(1.0), Walk(straight(9.0)), Stand(1.0)], person, np.random.default_rng(0)).strides
    feet = [build_foot_motion(strides, one, INSTEP, np.random.default_rng(3)) for one in (person, person.mirror())]
    t = strides.start[2] + np.arange(0.0, 1.0, 0.01)
    (right, left), (flex, same) = ([foot.roll.at(t)[0] for foot in feet], [foot.pitch.at(t)[0] for foot in feet])
    assert np.corrcoef(right, left)[0, 1] < -0.8  # but for rocking and the shock
    assert np.corrcoef(flex, same)[0, 1] > 0.99


def test_both_feet_sample_the_field_of_one_building(ideal):
    assert ideal.left.field is ideal.right.field
    for walk in ideal.sides.values():
        truth = walk.recording.truth
        nav_field = np.einsum("nij,nj->ni", truth.nav_R_body, walk.recording.mag)
        np.testing.assert_allclose(nav_field, ideal.right.field.at(truth.position + ideal.right.origin), atol=1e-9)
    np.testing.assert_array_equal(ideal.left.origin, ideal.right.origin)


def test_stances_alternate(along):
    """Each is over before the same foot's next one, and the other's lies between."""
    flat = [(begin, side) for side, walk in along.sides.items() for begin, _ in walk.flat[1:-1]]
    sides = [side for _, side in sorted(flat)]
    assert all(here != there for here, there in pairwise(sides))
    left, right = (walk.flat[1:-1] for walk in (along.left, along.right))
    apart = (left[:, None, 0] >= right[None, :, 1]) | (left[:, None, 1] <= right[None, :, 0])
    assert apart.all()


def test_one_foot_is_always_on_the_floor_and_both_are_for_a_tenth_to_a_fifth_of_the_cycle_each_time(along):
    touching = grounded(along, walking(along))
    assert touching.any(axis=0).all()
    assert 0.10 < touching.all(axis=0).mean() / 2 < 0.20  # twice a cycle


def test_feet_are_a_step_width_apart_that_varies_by_two_to_four_centimeters(along):
    width = sideways(along)
    assert width.mean() == pytest.approx(along.step_width_m, abs=0.005)
    assert 0.018 < width.std() < 0.04
    drawn = [draw_step_width(np.random.default_rng(seed)) for seed in range(200)]
    np.testing.assert_allclose([min(drawn), np.mean(drawn), max(drawn)], [0.10, 0.15, 0.20], atol=0.01)


def test_left_strides_vary_as_right_ones():
    walk = plan_walk([Walk(straight(6000.0))], Person(), np.random.default_rng(1), STEADY)
    left = plan_left_foot(walk, Person(), 0.15, np.random.default_rng(2), STEADY)
    assert len(left) == len(walk.strides) - 1
    for one, other in (
        (left.duration, walk.strides.duration),
        (np.diff(left.footprint[:, 1])[1:-1], np.diff(walk.strides.footprint[:, 1])[1:-1]),
    ):
        assert one.mean() == pytest.approx(other.mean(), rel=0.005)
        assert one.std() == pytest.approx(other.std(), rel=0.06)


def test_each_foot_passes_on_its_own_side(along):
    place, yaw = along.locate_feet(walking(along))
    heading = np.pi / 2 - yaw.mean(axis=0)
    right = np.stack([np.cos(heading), -np.sin(heading)], axis=1)
    assert np.einsum("ni,ni->n", (place[1] - place[0])[:, :2], right).min() > 0.02


@pytest.mark.parametrize("name", ["demo", "stairs", "magnet-corridor"])
def test_feet_stay_within_the_reach_of_the_legs_and_go_equally_far(name):
    feet = simulate_feet(name, 3, Choices(rate_hz=41.0, field="homogeneous"))
    place, _ = feet.locate_feet(np.arange(0.0, feet.right.strides.end_s, 0.01))
    apart = np.linalg.norm(place[1] - place[0], axis=1)
    assert apart.max() < LEG_REACH_M
    assert apart.min() > 0.04
    walked = [np.linalg.norm(np.diff(w.strides.footprint, axis=0), axis=1).sum() for w in feet.sides.values()]
    turned = sum(style == Style.TURN for style in feet.right.strides.style)
    assert abs(walked[1] - walked[0]) < 0.65 + 0.005 * walked[0] + 0.2 * turned


def test_standing_feet_are_beside_each_other_and_the_person_between_them(ideal):
    for t in (1.0, ideal.right.strides.end_s - 0.5):
        place, yaw = ideal.locate_feet(np.array([t]))
        heading = np.pi / 2 - yaw.mean()
        apart = (place[1] - place[0])[0]
        np.testing.assert_allclose(apart @ [np.sin(heading), np.cos(heading), 0.0], 0.0, atol=0.02)
        np.testing.assert_allclose(np.linalg.norm(apart), ideal.step_width_m, atol=0.02)
        person = ideal.person_at(np.array([t]))
        np.testing.assert_allclose(person.position[0], place.mean(axis=0)[0])
    assert len(ideal.person.t) == len(ideal.right.recording.truth.t)
    np.testing.assert_allclose(ideal.person.nav_R_body[:, 2, 2], 1.0)


def test_truths_are_in_one_frame_and_at_the_feet(ideal):
    """Sensors sit within the length of a shoe of the pivots."""
    for place, walk in zip(ideal.locate_feet(ideal.right.recording.truth.t)[0], ideal.sides.values(), strict=True):
        apart = np.linalg.norm(walk.recording.truth.position - place, axis=1)
        assert apart.max() < 0.2
    np.testing.assert_array_equal(ideal.right.recording.truth.position[0], 0.0)


def test_each_foot_has_a_sensor_and_a_mount_of_its_own_on_one_clock():
    feet = simulate_feet(replace(SHORT, field="homogeneous"), 3, Choices(rate_hz=100.0))
    left, right = (walk.drawn for walk in feet.sides.values())
    for name in ("gyr_matrix", "acc_matrix", "hard_iron_uT", "soft_iron"):
        assert not np.allclose(left["sensor"][name], right["sensor"][name], rtol=1e-6, atol=0.0)
    assert left["switched_on"] != right["switched_on"]
    assert left["sensor"]["clock_scale_error"] == right["sensor"]["clock_scale_error"]
    assert np.abs(feet.left.recording.truth.nav_R_body[0] - feet.right.recording.truth.nav_R_body[0]).max() > 0.02
    standing = [walk.recording.acc[walk.recording.t < 2.0].mean(axis=0) for walk in feet.sides.values()]
    np.testing.assert_allclose(np.linalg.norm(standing, axis=1), GRAVITY_M_S2, atol=0.1)


def test_on_stairs_the_feet_take_turns_with_the_treads():
    for treads, first in ((10, 1), (9, 0)):
        walk = plan_walk([Walk(straight(6.5)), Stairs(treads), Stand(5.0)], Person(), np.random.default_rng(0), STEADY)
        left = plan_left_foot(walk, Person(), 0.15, np.random.default_rng(0), STEADY)
        height = np.round(np.unique(left.footprint[:, 2] / 0.17), 9)
        trodden = [0.0, *np.arange(first or 2, treads, 2), treads]
        np.testing.assert_allclose(height, trodden)
        np.testing.assert_allclose(left.footprint[-1, 1:], walk.strides.footprint[-1, 1:], atol=1e-9)


@pytest.mark.parametrize("pause", [0.2, 0.9, 1.5, 5.0])
def test_a_turn_is_opened_and_closed_by_the_left_foot(pause):
    """Whatever stands between two turns, strides do not overlap, and both feet end beside each other."""
    course = [Stand(pause), TurnOnSpot(np.pi), Stand(pause), TurnOnSpot(-np.pi / 2), Stand(pause)]
    walk = plan_walk(course, Person(), np.random.default_rng(0), STEADY)
    left = plan_left_foot(walk, Person(), 0.15, np.random.default_rng(0), STEADY)
    assert (left.start[1:] >= (left.start + left.duration)[:-1] - 1e-9).all()
    assert left.start[0] >= 0.0
    assert (left.start + left.duration)[-1] <= left.end_s + 1e-9
    assert left.duration.min() > 0.45
    assert left.heading[-1] == pytest.approx(walk.strides.heading[-1])
    assert np.abs(np.diff(left.heading)).max() < 1.6


def test_a_sensor_that_is_on_no_foot_has_none_opposite():
    for name, worn in (("demo", "pocket"), ("at-rest", "table")):
        with pytest.raises(SimulationError, match=f"'{worn}' has none opposite"):
            simulate_feet(name, 1, Choices(worn=worn, rate_hz=41.0))
