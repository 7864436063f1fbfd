"""Courses of the papers' experiments: their lengths, strides and durations, and what they look like."""

import inspect

import numpy as np
import pytest

from fg_nav.lab.simulation import routes
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Stairs, Stand, Walk, plan, plan_walk

PRINTED = {
    "office": (1018.0, 786, None),
    "office_open": (1018.0, 786, None),
    "mall": (2480.0, 1920, None),
    "mall_open": (2480.0, 1920, None),
    "teaching_building": (515.5, None, 7 * 60),
    "pocket_street": (3000.0, None, 39 * 60),
    "pocket_long": (4320.0, None, 44 * 60),
    "demo": (77.0, None, 66),
}
"""Length (m), strides and duration (s) of each."""

ALL = (*PRINTED, "magnet_corridor", "calibration_loop", "stairs", "mixed_gait")
OPEN = ("office_open", "mall_open")


def drawn(name, seed=0):
    course = getattr(routes, name)
    return course(np.random.default_rng(seed)) if inspect.signature(course).parameters else course()


def walked(name, seed=0):
    return plan(drawn(name, seed), Person(), np.random.default_rng(seed))


def whole_length(sections):
    return sum(section.path.length_m for section in sections if isinstance(section, Walk))


def path_of(name, seed=0):
    (walk,) = (section for section in drawn(name, seed) if isinstance(section, Walk))
    return walk.path


def turned_in_three_strides(path):
    """Degrees by which a path turns in 3.9 m, from everywhere on it."""
    s = np.arange(0.0, path.length_m - 3.9, 0.5)
    return np.degrees(np.abs(path.at(s + 3.9)[1] - path.at(s)[1]))


@pytest.mark.parametrize("name", ALL)
def test_lengths_strides_and_durations_are_the_printed_ones_between_rests_at_the_origin(name):
    length_m, count, seconds = PRINTED.get(name, (None, None, None))
    for seed in range(3):
        sections, strides = drawn(name, seed), walked(name, seed)
        if length_m:
            assert whole_length(sections) == pytest.approx(length_m, rel=2e-3 if name == "demo" else 1e-9)
        assert count is None or len(strides) == count
        assert seconds is None or strides.end_s == pytest.approx(seconds, rel=0.03)
        assert isinstance(sections[0], Stand)
        assert isinstance(sections[-1], Stand)
        assert strides.start[0] >= 5.0
        assert strides.end_s - (strides.start + strides.duration)[-1] >= 5.0 - 1e-9
        assert np.linalg.norm(strides.footprint[0]) == pytest.approx(0.09)
        if name in OPEN:
            assert np.linalg.norm(strides.footprint[-1] - strides.footprint[0]) > 350.0
        else:
            np.testing.assert_array_equal(strides.footprint[-1], strides.footprint[0])
            rounds = (strides.heading[-1] - strides.heading[0]) / (2 * np.pi)
            assert rounds == pytest.approx(round(rounds), abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_office_is_three_equal_loops_to_the_right_mostly_straight(seed):
    path = path_of("office", seed)
    third, s = path.length_m / 3, np.linspace(0, path.length_m / 3, 500)
    np.testing.assert_allclose(path.at(s + third)[0], path.at(s)[0], atol=1e-6)
    assert np.degrees(path.heading[-1] - path.heading[0]) == pytest.approx(3 * 360)
    assert np.mean(np.abs(path.curvature(np.arange(0, path.length_m, 0.1))) < 1e-9) > 0.85
    assert np.mean(turned_in_three_strides(path) > 4.0) < 0.30


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["mall", "mall_open"])
def test_the_mall_winds_most_of_the_time(name, seed):
    path = path_of(name, seed)
    bend = np.abs(path.curvature(path.arc))
    assert np.mean(turned_in_three_strides(path) > 4.0) > 0.7
    assert np.mean(bend > 1 / 50) > 0.7
    assert 1.2 < 1 / bend.max() < 5.0


def test_fourteen_landmarks_are_crossed_in_each_of_three_laps():
    walk = plan_walk(drawn("mall"), Person(), np.random.default_rng(0))
    strides, crossings = walk.strides, walk.crossings
    assert [crossing.landmark for crossing in crossings] == [str(i + 1) for i in range(14)] * 3
    feet = strides.footprint[[crossing.stride + 1 for crossing in crossings]].reshape(3, 14, 3)
    assert np.linalg.norm(feet[1:] - feet[0], axis=2).max() < 1.6
    nearest = np.linalg.norm(feet[0][:, None] - feet[0][None], axis=2) + 1e9 * np.eye(14)
    assert nearest.min() > 10.0
    assert len(plan_walk(drawn("mall_open"), Person(), np.random.default_rng(0)).crossings) == 42


@pytest.mark.parametrize("seed", range(4))
def test_some_feet_come_down_near_the_magnet_and_none_on_it(seed):
    strides = walked("magnet_corridor", seed)
    away = np.linalg.norm(strides.footprint - np.array(routes.MAGNET_POSITION), axis=1)
    assert np.sum((away > 0.3) & (away < 0.5)) >= 2
    assert away.min() > 0.2
    assert np.median(away) > 5.0


def test_the_calibration_loop_covers_all_headings_in_steps_of_15_to_35_degrees():
    strides = walked("calibration_loop")
    step = np.degrees(np.diff(strides.heading))
    assert np.mean((np.abs(step) > 15) & (np.abs(step) < 35)) > 0.9
    assert np.abs(step).sum() > 2 * 360
    seen = np.histogram(np.degrees(strides.heading) % 360, bins=12, range=(0, 360))[0]
    assert seen.min() >= 4
    assert 60 < strides.end_s < 120


def test_the_street_runs_east_and_can_be_turned_north():
    strides = walked("pocket_street")
    reach = np.ptp(strides.footprint, axis=0)
    np.testing.assert_allclose(reach[0], 500.0, atol=0.2)
    assert reach[1] < 1.0
    north = plan(routes.rotate(drawn("pocket_street"), -np.pi / 2), Person(), np.random.default_rng(0))
    np.testing.assert_allclose(north.footprint[:, 1], strides.footprint[:, 0], atol=0.2)
    assert np.sum(strides.style == Style.TURN) == 6 * 3


def test_twelve_round_trips():
    east = walked("pocket_long").footprint[:, 0]
    assert np.sum((east[1:] > 90) & (east[:-1] <= 90)) == 12
    assert np.sum((east[1:] <= 90) & (east[:-1] > 90)) == 12


def test_stairs_lead_two_flights_up_and_down_again():
    strides = walked("stairs")
    treads = sum(section.treads for section in drawn("stairs") if isinstance(section, Stairs))
    assert np.ptp(strides.footprint[:, 2]) == pytest.approx(treads / 2 * 0.17)
    climbing = np.isin(strides.style, (Style.STAIRS_UP, Style.STAIRS_DOWN))
    np.testing.assert_allclose(np.diff(strides.footprint[:, 2])[~climbing], 0.0, atol=1e-9)
    assert set(strides.style) == {Style.WALK, Style.STAIRS_UP, Style.STAIRS_DOWN, Style.TURN}


def test_mixed_gait_has_all_of_it():
    strides = walked("mixed_gait")
    speed = np.linalg.norm(np.diff(strides.footprint, axis=0), axis=1) / strides.duration
    assert set(strides.style) == {Style.WALK, Style.RUN, Style.TURN}
    assert np.median(speed[strides.style == Style.RUN]) > 2.5
    assert speed[strides.style == Style.WALK].max() / np.median(speed[strides.style == Style.WALK]) > 1.15
    gap = strides.start[1:] - (strides.start + strides.duration)[:-1]
    assert np.sum(gap > 2.0) >= 3


def test_a_seed_draws_the_building():
    one, again, other = (path_of("mall", seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.position, again.position)
    assert np.linalg.norm(one.at([400.0])[0] - other.at([400.0])[0]) > 0.3
