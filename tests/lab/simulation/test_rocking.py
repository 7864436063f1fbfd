"""A loaded foot rocks on its sole: no rest is found where it does, and all that is true stays true."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.detection.rest import find_rests
from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import SCENARIOS, Choices, Scenario, simulate
from fg_nav.lab.simulation.foot import FootMotion, build_foot_motion
from fg_nav.lab.simulation.mount import HEEL, INSTEP, Mount
from fg_nav.lab.simulation.path import Pose, straight
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Section, Stand, Walk, plan
from fg_nav.lab.simulation.scenario_file import parse_scenario
from fg_nav.lab.verbs.simulate import describe_truth
from fg_nav.truth import TrajectoryTruth

AGAIN = straight(20.0).place(Pose(np.array([0.0, 20.0, 0.0]), 0.0))
COURSE: list[Section] = [Stand(4.0), Walk(straight(20.0)), Stand(6.0), Walk(AGAIN), Stand(4.0)]
"""Standing before, between and after two walks to the north."""


def make_foot(mount: Mount, restless: bool = False, person: Person = Person(), seed: int = 1) -> FootMotion:
    rng = np.random.default_rng(seed)
    return build_foot_motion(plan(COURSE, person, rng), person, mount, rng, restless)


def list_instants(foot: FootMotion, standing: bool) -> np.ndarray:
    """Middle thirds of the stances, or of the standing."""
    begin, end = foot.flat.T
    some = (end - begin > 1.0) == standing
    return np.concatenate([np.arange(b + (e - b) / 3, e - (e - b) / 3, 5e-3) for b, e in foot.flat[some]])


def measure_rate(foot: FootMotion, standing: bool = False) -> np.ndarray:
    """Rms rate (3,) deg/s in the foot's axes."""
    rate = foot.at(list_instants(foot, standing)).rate @ foot.foot_R_body.T
    return np.asarray(np.rad2deg(np.sqrt(np.mean(rate**2, axis=0))))


def test_a_heel_rocks_at_4_to_9_deg_s_about_all_axes():
    persons = [Person().draw(np.random.default_rng(seed)) for seed in range(12)]
    axes = np.array([measure_rate(make_foot(HEEL, person=one, seed=k)) for k, one in enumerate(persons)])
    total = np.linalg.norm(axes, axis=1)
    assert 4.5 < np.median(total) < 7.5
    assert total.min() > 3.0
    assert total.max() < 10.0
    roll, pitch, yaw = np.median(axes, axis=0)
    assert min(roll, pitch) > yaw > 1.0


@pytest.mark.parametrize("mount", [HEEL, INSTEP], ids=["heel", "instep"])
def test_in_standing_it_rocks_only_if_it_is_restless(mount: Mount):
    still, restless = (np.linalg.norm(measure_rate(make_foot(mount, one), standing=True)) for one in (False, True))
    assert still < 0.5
    assert 4.0 < restless < 8.0


def test_it_rocks_about_the_floor_beneath_the_sensor():
    """What rocking adds to the velocity is what it adds to the rate, times the height above the floor."""
    feet = [make_foot(mount, restless=mount.rocking > 0) for mount in (HEEL, replace(HEEL, rocking=0.0))]
    t = list_instants(feet[0], standing=True)
    rocks, still = (foot.at(t) for foot in feet)
    nav_rate = np.einsum("nij,nj->ni", rocks.nav_R_body, rocks.rate - still.rate)
    height = np.array([0.0, 0.0, feet[0].lever_m[2]])
    expected, added = np.cross(nav_rate, height), rocks.velocity - still.velocity
    assert np.sqrt(np.mean((added - expected) ** 2)) < 0.1 * np.sqrt(np.mean(added**2))


def test_rate_and_force_are_the_derivatives_of_the_pose():
    foot, step = make_foot(HEEL, restless=True), 1e-5
    t = np.arange(0.5, foot.flat[-1, 1] - 0.5, 0.0173)
    before, now, after = (foot.at(t + by) for by in (-step, 0.0, step))
    slope = (after.position - before.position) / (2 * step)
    np.testing.assert_allclose(now.velocity, slope, atol=1e-5)
    nav_force = (after.velocity - before.velocity) / (2 * step) + [0.0, 0.0, GRAVITY_M_S2]
    np.testing.assert_allclose(np.einsum("nij,nj->ni", now.nav_R_body, now.force), nav_force, atol=2e-3)
    turned = np.einsum("nji,njk->nik", now.nav_R_body, (after.nav_R_body - before.nav_R_body) / (2 * step))
    np.testing.assert_allclose(turned[:, [2, 0, 1], [1, 2, 0]], now.rate, atol=1e-5)


def test_rocking_carries_the_foot_nowhere():
    """Nor up: what a stance turns is taken back in the swing, up to 0.13 m times half the square of an angle."""
    feet = [make_foot(replace(HEEL, rocking=rocking)) for rocking in (0.0, 1.0)]
    swinging = feet[0].flat.mean(axis=1)[1:-1] + 0.6  # after the way back, before the next landing
    moved = np.diff([foot.at(swinging).position for foot in feet], axis=0)[0]
    assert np.abs(moved).max() < 5e-3
    assert np.abs(moved.mean(axis=0)).max() < 5e-4


@pytest.mark.parametrize("worn", ["heel", "instep"])
@pytest.mark.parametrize("rests", ["rocking", "none"])
def test_no_rest_is_found_where_a_foot_rocks(worn: str, rests: str):
    teaching = SCENARIOS["teaching-building"]
    short: Scenario = replace(teaching, name="short", route=lambda rng: COURSE)
    for seed in (1, 2, 3):
        still, restless = (simulate(short, seed, Choices(worn=worn, rests=one)) for one in (None, rests))
        assert len(find_rests(still.recording)) == 3
        assert not find_rests(restless.recording)
        assert len(still.strides) - len(restless.strides) <= 1


def test_without_rests_the_walk_begins_and_ends_in_a_stance():
    walk = simulate("demo", 1, Choices(rests="none"))
    assert walk.strides.start[0] == pytest.approx(0.35, abs=1e-3)
    assert np.diff(walk.strides.start).max() < 2.0
    assert abs(len(detect_stances(walk.recording)) - len(walk.strides) - 1) <= 1
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    np.testing.assert_array_equal(truth.position[0], 0.0)
    again = simulate("demo", 1, Choices(rests="none"))
    np.testing.assert_array_equal(walk.recording.gyr, again.recording.gyr)


def test_a_scenario_of_a_file_may_have_no_rests():
    scenario = parse_scenario("mine.toml", 'rests = "none"\n[course]\npoints_m = [[0, 0], [0, 20]]\nrest_s = 9.0\n')
    walk = simulate(scenario, 1)
    assert walk.recording.duration_s < 20.0
    assert describe_truth(walk)["rests"] == "none"
    with pytest.raises(SimulationError, match="rests cannot be 'some'"):
        parse_scenario("mine.toml", 'rests = "some"\n[course]\npoints_m = [[0, 0], [0, 20]]\n')


def test_who_only_stands_has_no_walk_without_rests():
    with pytest.raises(SimulationError, match="without its rests"):
        simulate("at-rest", 1, Choices(rests="none"))
    with pytest.raises(SimulationError, match="rests cannot be 'some': choose one of still, rocking, none"):
        simulate("demo", 1, Choices(rests="some"))
