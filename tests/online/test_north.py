"""What a walk knows of north by its field: nothing, little, and more the farther it goes."""

import numpy as np
import pytest

from fg_nav.frames import UNKNOWN_RAD
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.estimates import StanceEstimate
from fg_nav.online.field import FLOOR_UT, ROOM_SHARE, average_along, extend_with_north, find_north_sigma
from tests.online.walks import NORTH, push, short_walk

STRENGTH_UT = 20.0


def test_the_mean_of_a_correlated_deviation_varies_as_it_is_told():
    """The mean over 20 m of an exponentially correlated process, drawn: its variance is v."""
    rng, step, length, n = np.random.default_rng(1), 0.1, 1.5, 200
    keep = np.exp(-step / length)
    x = rng.standard_normal(20000)
    total = np.zeros(20000)
    for _ in range(n):
        total += x
        x = keep * x + np.sqrt(1.0 - keep**2) * rng.standard_normal(20000)
    assert (total / n).var() == pytest.approx(average_along(n * step / length), rel=0.03)
    assert average_along(0.0) == 1.0
    assert average_along(0.9999e-4) == pytest.approx(average_along(1.0001e-4), abs=1e-8)


def test_north_is_known_better_the_farther_the_walk_and_the_steadier_its_field():
    rough = 7.0 * np.random.default_rng(2).standard_normal(400)
    by_path = [find_north_sigma(rough[:n], 1.3 * n, STRENGTH_UT) for n in (4, 40, 400)]
    assert by_path[0] > 2.0 * by_path[1] > 4.0 * by_path[2]
    smooth = find_north_sigma(0.05 * rough[:40], 52.0, STRENGTH_UT)
    assert smooth < 0.5 * by_path[1]
    assert find_north_sigma(np.zeros(4), 4.0, STRENGTH_UT) > np.radians(8.0)  # that agree, and may all be off


def test_of_one_place_north_is_as_little_known_as_floors_and_rooms_deviate():
    """Both deviations across the walk's field are independent, and a room's is a share of the floor's."""
    expected = FLOOR_UT * np.hypot(1.0, ROOM_SHARE) / STRENGTH_UT
    assert find_north_sigma(np.zeros(1), 0.0, STRENGTH_UT) == pytest.approx(min(expected, UNKNOWN_RAD))


def test_a_field_without_a_horizontal_part_shows_nothing():
    assert find_north_sigma(np.full(4, 5.0), 4.0, 0.1) == UNKNOWN_RAD
    with np.errstate(all="raise"):
        assert find_north_sigma(np.full(4, 5.0), 4.0, 0.0) == UNKNOWN_RAD


@pytest.mark.parametrize("sigma", [0.02, 0.5, UNKNOWN_RAD])
def test_a_pose_moves_as_a_turn_about_the_origin_moves_it(sigma):
    rng, position = np.random.default_rng(3), np.array([3.0, -4.0, 1.0])
    theta = sigma * rng.standard_normal(400_000)
    at = (position[0] + 1j * position[1]) * (np.exp(1j * theta) - 1.0)
    drawn = np.stack([at.real, at.imag, np.zeros(len(theta)), theta])
    told = extend_with_north(np.zeros((4, 4)), position, sigma)
    np.testing.assert_allclose(told, drawn @ drawn.T / len(theta), atol=0.02 * told.max())
    assert np.linalg.eigvalsh(told).min() > -1e-9


def test_what_the_heading_knows_of_it_is_not_counted_twice():
    known = np.diag([0.1, 0.1, 0.1, 0.2]) ** 2
    np.testing.assert_allclose(extend_with_north(known, np.ones(3), 0.1), known)
    assert extend_with_north(known, np.zeros(3), 0.5)[3, 3] == pytest.approx(0.25)


def tell(options: OnlineOptions, magnetometer: bool = True) -> list[StanceEstimate]:
    """Lines of the short walk northward, in a field that points north."""
    rows = rows_of(short_walk())
    rows[:, 7:10] = rows[:, 7:10] if magnetometer else np.nan
    return [line for line in push(OnlineNavigator(options), rows) if isinstance(line, StanceEstimate)]


def test_an_unknown_north_is_in_the_lines_until_the_field_shows_it():
    lines = tell(OnlineOptions(heading_rad=None))
    heading = np.array([np.sqrt(line.pose_cov[3, 3]) for line in lines])
    assert heading[:3].min() >= UNKNOWN_RAD
    assert heading[-1] < np.radians(15.0)
    across = np.array([np.sqrt(line.pose_cov[0, 0]) for line in lines])
    walked = np.array([np.hypot(*line.position[:2]) for line in lines])
    assert across[2] > 0.5 * walked[2]
    assert across[-1] < 0.25 * walked[-1]


@pytest.mark.parametrize(
    ("options", "magnetometer"),
    [(NORTH, True), (OnlineOptions(heading_rad=None), False), (OnlineOptions(heading_rad=None, use_field=False), True)],
    ids=["given", "no magnetometer", "field not used"],
)
def test_north_is_what_the_start_says_where_no_field_is_to_show_it(options, magnetometer):
    first = tell(options, magnetometer)[0]
    assert np.sqrt(first.pose_cov[3, 3]) < np.radians(1.0)
