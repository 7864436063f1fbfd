"""The clutter of buildings: floors, stairs, objects, and the three levels."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from fg_nav.lab.simulation.fields import LEVELS, SITES, Dipoles, Sum, draw_environment, draw_floor
from fg_nav.lab.simulation.fields.building import (
    BETWEEN,
    CABLE_ROOM_M,
    INDOOR,
    REFERENCE_M,
    REGION,
    SENSOR_HEIGHTS_M,
    SHEET_M,
    TREADS_ROOM_M,
    TREADS_UT,
    FloorParameters,
    Kind,
    draw_treads,
    place_cables,
    place_objects,
    resample_path,
)
from tests.lab.simulation.magnetostatics import is_magnetic

EARTH = SITES["munich"]
CORRIDOR = np.array([[0.0, 0, 0], [40, 0, 0], [40, 25, 0], [0, 25, 0], [0, 0, 0]])
WINDING = np.array(
    [[0, 0, 0], [3, 0, 1.7], [4, 0, 1.7], [4, 1.2, 1.7], [3, 1.2, 1.7], [0, 1.2, 3.4], [0, 0, 3.4], [3, 0, 5.1]]
)
LOCKER = Kind("locker", 50.0, (0.0, 2.0), (0.0, 0.5), (0.5, 2.0), (2.0, 20.0), memory=3.0)


def rng(seed=0):
    return np.random.default_rng(seed)


def up(height):
    return np.array([0.0, 0.0, height])


def over(height, count=4000, size=100.0, seed=1):
    xy = rng(seed).uniform(0, size, (count, 2))
    return np.column_stack([xy, np.full(count, height)])


EAST = np.array([1.0, 0.0, 0.0])


def rms(field):
    return np.sqrt(np.mean(field**2))


def swept(way):
    """Points over a way at which a sensor may be."""
    points = resample_path(way).points
    return np.concatenate([points + up(height) for height in SENSOR_HEIGHTS_M])


@pytest.mark.parametrize("height", [0.05, 0.1, 0.75, -0.1])
def test_over_and_under_a_floor_there_is_a_magnetic_field(height):
    assert is_magnetic(draw_floor(rng()), over(height, 300))


def test_a_floor_is_as_rough_as_asked_at_the_foot_and_fades_towards_the_pocket_short_waves_first():
    for seed in range(3):
        felt = draw_floor(rng(seed), FloorParameters(strength_uT=7.0)).at(over(REFERENCE_M))
        assert rms(felt) == pytest.approx(7.0, rel=0.05)
        assert np.all(np.abs(felt.mean(axis=0)) < 0.7)
    floor = draw_floor(rng())
    strength = [rms(floor.at(over(height))) for height in (0.05, 0.1, 0.3, 0.75, 1.5)]
    assert np.all(np.diff(strength) < 0)
    assert strength[3] < 0.5 * strength[1]
    short = draw_floor(rng(), FloorParameters(shortest_m=1.0, longest_m=1.0))
    assert rms(short.at(over(0.6))) / rms(short.at(over(0.1))) == pytest.approx(np.exp(-2 * np.pi * 0.5), rel=1e-6)
    low, high = draw_floor(rng(5)), draw_floor(rng(5), height_m=7.0)
    np.testing.assert_allclose(low.at(over(0.1)), high.at(over(7.1)), atol=1e-9)


def test_flux_passes_the_sheet_and_under_it_nothing_blows_up():
    floor = draw_floor(rng())
    above, below = floor.at(over(-SHEET_M + 1e-9)), floor.at(over(-SHEET_M - 1e-9))
    np.testing.assert_allclose(above[:, 2], below[:, 2], atol=1e-5)
    at_sheet = np.abs(floor.at(over(-SHEET_M))).max()
    assert all(np.abs(floor.at(over(-depth))).max() <= at_sheet for depth in (0.06, 0.5, 5.0))


def test_a_floor_does_not_repeat_within_a_building():
    floor = draw_floor(rng())
    here = over(0.1, 2000, size=20.0)
    felt = floor.at(here)
    for seed in range(20):
        angle = rng(seed).uniform(0, 2 * np.pi)
        away = rng(seed + 100).uniform(8, 100) * np.array([np.sin(angle), np.cos(angle), 0])
        assert abs(np.mean(felt * floor.at(here + away)) / np.mean(felt**2)) < 0.35


def test_stairs_are_as_rough_as_asked_all_the_way_up():
    way = resample_path(WINDING)
    treads = draw_treads(way, rng())
    felt = treads.at(way.points + up(0.1))
    assert rms(felt) == pytest.approx(TREADS_UT, rel=1e-6)
    halves = np.array_split(felt, 2)
    assert all(0.6 < rms(half) / TREADS_UT < 1.4 for half in halves)
    assert rms(treads.at(way.points + up(0.75))) < 0.7 * rms(felt)
    assert is_magnetic(treads, swept(WINDING)[::5])


def test_no_steel_of_the_stairs_is_in_the_way():
    distance, _ = KDTree(swept(WINDING)).query(draw_treads(resample_path(WINDING), rng()).position)
    assert distance.min() >= TREADS_ROOM_M


def test_what_is_walked_again_counts_once():
    once, thrice = resample_path(CORRIDOR), resample_path(np.vstack([CORRIDOR] * 3))
    assert len(once.spots) == pytest.approx(130, abs=8)
    np.testing.assert_allclose(len(thrice.spots), len(once.spots), atol=3)
    apart = np.linalg.norm(once.spots[:, None] - once.spots, axis=2) + 9 * np.eye(len(once.spots))
    assert apart.min() > 0.89


def test_a_way_is_followed_closely_and_as_it_climbs():
    way = resample_path(WINDING)
    assert np.linalg.norm(np.diff(way.points, axis=0), axis=1).max() <= 0.2 + 1e-9
    assert not way.is_level
    assert resample_path(CORRIDOR + up(3.0)).floor_m == pytest.approx(3.0)
    slope = way.spot_directions[0]
    np.testing.assert_allclose(slope, WINDING[1] / np.linalg.norm(WINDING[1]), atol=1e-9)


def test_objects_keep_out_of_the_way_and_are_as_many_as_asked():
    way = resample_path(CORRIDOR)
    placed = place_objects((LOCKER,), way, EARTH.vector, rng())
    assert len(placed) > 50
    distance = np.linalg.norm(swept(CORRIDOR)[:, None] - placed.position, axis=2)
    assert distance.min() >= LOCKER.room_m
    assert distance.min(axis=0).max() < 4.0
    point = Kind("point", 50.0, (0.6, 2.0), (0.0, 0.5), (0.1, 0.2), (1.0, 2.0), memory=1.0)
    counts = [len(place_objects((point,), way, EARTH.vector, rng(seed))) for seed in range(40)]
    expected = 0.5 * len(way.spots)
    assert np.mean(counts) == pytest.approx(expected, abs=4 * np.sqrt(expected / 40))


def test_soft_iron_follows_the_field_and_memory_does_not():
    way = resample_path(CORRIDOR)
    soft = Kind("soft", 30.0, (0.6, 2.0), (0.0, 0.5), (0.5, 2.0), (2.0, 20.0), memory=0.0)
    plain = place_objects((soft,), way, EARTH.vector, rng(3))
    turned = place_objects((soft,), way, -EARTH.vector, rng(3))
    np.testing.assert_allclose(turned.moment, -plain.moment)
    hard = (
        place_objects((LOCKER,), way, -EARTH.vector, rng(3)).moment
        + place_objects((LOCKER,), way, EARTH.vector, rng(3)).moment
    )
    assert rms(hard) > 0.5 * rms(plain.moment)


@pytest.mark.parametrize("way", [CORRIDOR, WINDING], ids=["corridor", "stairs"])
def test_cables_keep_out_of_the_way_and_are_felt_a_little(way):
    circuits = place_cables(resample_path(way), rng(), per_100_m=60.0)
    assert len(circuits) > 2
    for circuit in circuits:
        distance, _ = KDTree(swept(way)).query(circuit.pieces(0.05))
        assert distance.min() > CABLE_ROOM_M - 0.02  # corners between the pieces that were looked at
    felt = Sum(circuits).at(resample_path(way).points + up(0.1))
    assert 0.05 < rms(felt) < 10.0
    assert is_magnetic(Sum(circuits), swept(way)[::20])


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("way", [CORRIDOR, WINDING], ids=["corridor", "stairs"])
def test_every_level_is_a_magnetic_field_wherever_the_sensor_may_be(level, way):
    assert is_magnetic(draw_environment(level, EARTH, way, rng()), swept(way)[::7], least=1.0)


@pytest.mark.parametrize("level", LEVELS)
def test_a_seed_makes_one_building_and_another_another(level):
    position = swept(CORRIDOR)
    first, again, other = (draw_environment(level, EARTH, CORRIDOR, rng(seed)).at(position) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert (rms(first - other) > 1.0) == (level != "homogeneous")


def footfalls(way, height=0.1):
    points = resample_path(way).points
    return points[:: round(1.29 / 0.2)] + up(height)


def steps(level, seed, height=0.1):
    felt = draw_environment(level, EARTH, CORRIDOR, rng(seed)).at(footfalls(CORRIDOR, height))
    return np.median(np.linalg.norm(np.diff(felt, axis=0), axis=1))


def test_smooth_changes_by_one_to_two_microtesla_a_step_and_indoor_by_eight_to_nineteen():
    assert 1.0 < np.median([steps("smooth", seed) for seed in range(8)]) < 2.0
    assert 8.0 < np.median([steps("indoor", seed) for seed in range(8)]) < 19.0


def test_indoors_the_pocket_feels_less_than_the_foot():
    foot, pocket = (np.median([steps("indoor", seed, height) for seed in range(5)]) for height in (0.1, 0.75))
    assert pocket < 0.5 * foot
    assert pocket > 1.0


def test_stairs_have_treads_and_a_way_of_one_point_is_enough():
    assert isinstance(draw_environment("indoor", EARTH, WINDING, rng()).parts[1], Dipoles)
    here = np.array([[1.0, 2.0, 0.0]])
    for level in LEVELS:
        assert np.isfinite(draw_environment(level, EARTH, here, rng()).at(here + up(0.1))).all()
    assert draw_environment("homogeneous", EARTH, CORRIDOR, rng()) is EARTH


def building(level, seed, way=CORRIDOR):
    return draw_environment(level, EARTH, way, rng(seed)).at(footfalls(way)) - EARTH.vector


def test_buildings_differ_in_strength_and_one_between_is_less_rough():
    spread = [np.log(rms(building("indoor", seed)[:, :2])) for seed in range(40)]
    assert np.exp(np.median(spread)) == pytest.approx(8.0, rel=0.15)  # sets: 7 to 12
    assert 0.2 < np.std(spread) < 0.45
    smooth, between, indoor = (
        np.median([rms(np.diff(building(level, seed), axis=0)) for seed in range(10)]) for level in INDOOR
    )
    assert smooth < between
    assert between == pytest.approx(np.hypot((1 - BETWEEN) * smooth, BETWEEN * indoor), rel=0.2)


def test_the_regional_field_is_alike_for_tens_of_metres_and_its_potential_bounded():
    field = draw_floor(rng(3), REGION)
    here = over(0.1, 3000, size=300.0)
    near, far = (np.mean(field.at(here) * field.at(here + away * EAST)) for away in (5.0, 40.0))
    strength = rms(field.at(here)) ** 2
    assert near > 0.75 * strength
    assert far < 0.5 * strength
    assert rms(field.at(over(8.0, 3000, size=300.0))) > 0.3 * rms(field.at(here))  # a storey up
    assert is_magnetic(field, over(0.1, 300))
