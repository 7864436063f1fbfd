"""Paths against plane geometry: tangents, lengths, laps, and what cannot be a path."""

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.path import Pose, arc, closed_curve, open_curve, polyline, straight

CORNERS = [(0.0, 0.0), (0.0, 11.0), (9.0, 11.0), (9.0, 4.0), (20.0, -3.0)]
ROUND = 5.0 * np.stack([np.sin(np.arange(12) * np.pi / 6), np.cos(np.arange(12) * np.pi / 6)], axis=1)
PATHS = {
    "polyline": polyline(CORNERS, 1.2),
    "arc": arc(2.0, -4.0),
    "closed": closed_curve([(0, 0), (0, 20), (15, 25), (30, 5), (12, -6)]),
    "open": open_curve([(0, 0), (5, 20), (25, 25), (30, 50)]),
}


@pytest.fixture(params=PATHS, scope="module")
def path(request):
    return PATHS[request.param]


def inside(path, count=500, seed=0):
    return np.sort(np.random.default_rng(seed).uniform(0.01, path.length_m - 0.01, count))


def test_heading_is_the_tangent_and_arc_is_length(path):
    s, half = inside(path), 1e-4
    moved = (path.at(s + half)[0] - path.at(s - half)[0]) / (2 * half)
    heading = path.at(s)[1]
    np.testing.assert_allclose(moved[:, 0], np.sin(heading), atol=2e-4)
    np.testing.assert_allclose(moved[:, 1], np.cos(heading), atol=2e-4)
    s = np.linspace(0, path.length_m, 20_001)
    assert np.linalg.norm(np.diff(path.at(s)[0], axis=0), axis=1).sum() == pytest.approx(path.length_m, rel=1e-6)
    turned = np.sum(path.curvature((s[1:] + s[:-1]) / 2) * np.diff(s))
    assert turned == pytest.approx(path.heading[-1] - path.heading[0], abs=1e-2)
    np.testing.assert_allclose(path.at([-1.0, path.length_m + 1])[0], path.position[[0, -1]], atol=1e-9)


def test_a_corner_takes_its_tangents_and_gives_its_arc():
    corner = polyline([(0, 0), (0, 10), (10, 10)], 1.5)
    assert corner.length_m == pytest.approx(20 - 2 * 1.5 + 1.5 * np.pi / 2, rel=1e-12)
    middle, heading = corner.at([corner.length_m / 2])
    centre = np.array([1.5, 8.5, 0.0])
    np.testing.assert_allclose(np.linalg.norm(middle - centre, axis=1), 1.5, atol=1e-7)
    np.testing.assert_allclose(heading, np.pi / 4)
    np.testing.assert_allclose(corner.end.position, [10, 10, 0], atol=1e-12)


def test_turns_to_the_right_are_positive():
    right = arc(3.0, np.pi / 2)
    np.testing.assert_allclose(right.end.position, [3, 3, 0], atol=1e-12)
    assert right.end.heading == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(right.curvature([1.0]), 1 / 3)


def test_height_is_linear_along_the_legs():
    ramp = polyline([(0, 0, 0), (0, 10, 1), (10, 10, 1), (10, 20, 3)], 1.0)
    position, _ = ramp.at([0.0, ramp.length_m / 2, ramp.length_m])
    np.testing.assert_allclose(position[:, 2], [0, 1, 3], atol=1e-12)
    assert (np.diff(ramp.at(np.linspace(0, ramp.length_m, 99))[0][:, 2]) >= 0).all()


def test_a_curve_through_points_of_a_circle_is_the_circle():
    ring = closed_curve(ROUND)
    assert ring.length_m == pytest.approx(10 * np.pi, rel=1e-3)
    assert ring.heading[-1] - ring.heading[0] == pytest.approx(2 * np.pi)
    np.testing.assert_array_equal(ring.position[0], ring.position[-1])


def test_a_curve_passes_through_its_points():
    points = np.array([(0, 0), (5, 20), (25, 25), (30, 50)])
    position, _ = PATHS["open"].at(np.linspace(0, PATHS["open"].length_m, 4001))
    away = np.linalg.norm(position[None, :, :2] - points[:, None], axis=2).min(axis=1)
    assert away.max() < 0.02


def test_turning_is_clockwise_about_the_origin(path):
    turned = path.translate((3.0, -4.0)).rotate(np.pi / 2)
    before, heading = path.translate((3.0, -4.0)).at(inside(path))
    after, turned_heading = turned.at(inside(path))
    np.testing.assert_allclose(after[:, 0], before[:, 1], atol=1e-9)
    np.testing.assert_allclose(after[:, 1], -before[:, 0], atol=1e-9)
    np.testing.assert_allclose(turned_heading - heading, np.pi / 2)


def test_placed_begins_at_the_pose_and_keeps_its_shape(path):
    pose = Pose(np.array([1.0, 2.0, 3.0]), 5.0)
    placed = path.place(pose)
    np.testing.assert_allclose(placed.start.position, pose.position, atol=1e-12)
    assert placed.start.heading == pytest.approx(5.0)
    reach = np.linalg.norm(path.end.position - path.start.position)
    assert np.linalg.norm(placed.end.position - placed.start.position) == pytest.approx(reach)


def test_reversed_goes_the_same_way_back(path):
    marked = path.with_landmarks([1.0, 3.0])
    back = marked.reverse()
    s = inside(path)
    np.testing.assert_allclose(back.at(path.length_m - s)[0], path.at(s)[0], atol=1e-9)
    np.testing.assert_allclose(back.at(path.length_m - s)[1], path.at(s)[1] + np.pi)
    assert [mark.name for mark in back.landmarks] == ["2", "1"]
    np.testing.assert_allclose(back.at([back.landmarks[1].arc])[0], path.at([1.0])[0], atol=1e-9)


def test_laps_repeat_places_and_add_rounds():
    lap = PATHS["closed"].with_landmarks([5.0, 40.0], ["door", "stairs"])
    laps = lap.repeat(3)
    assert laps.length_m == pytest.approx(3 * lap.length_m)
    position, heading = laps.at(np.array([7.0, 7.0 + lap.length_m, 7.0 + 2 * lap.length_m]))
    np.testing.assert_allclose(position, np.tile(position[0], (3, 1)), atol=1e-9)
    np.testing.assert_allclose(np.diff(heading), 2 * np.pi)
    assert [mark.name for mark in laps.landmarks] == ["door", "stairs"] * 3
    places = laps.at(np.array([mark.arc for mark in laps.landmarks]))[0]
    np.testing.assert_allclose(places[2:4], places[:2], atol=1e-9)


def test_parts_join_to_the_whole(path):
    cut = 0.37 * path.length_m
    joined = path.part(0, cut).then(path.part(cut, path.length_m))
    assert joined.length_m == pytest.approx(path.length_m)
    np.testing.assert_allclose(joined.at(inside(path))[0], path.at(inside(path))[0], atol=1e-5)


def test_headings_stay_unwrapped_where_paths_join():
    twice = arc(2.0, 3.0).then(arc(2.0, 3.0).place(Pose(arc(2.0, 3.0).end.position, 3.0 - 2 * np.pi)))
    assert np.abs(np.diff(twice.heading)).max() < 0.1
    assert twice.end.heading == pytest.approx(6.0)


def test_scaled_to_a_length_exactly(path):
    scaled = path.with_landmarks([path.length_m]).scale_to(1018 / 3)
    assert scaled.length_m == 1018 / 3
    assert scaled.landmarks[0].arc == 1018 / 3
    np.testing.assert_allclose(scaled.start.position, path.start.position)
    np.testing.assert_array_equal(scaled.heading, path.heading)


IMPOSSIBLE = {
    "Points 1 and 2 of the path are the same": lambda: polyline([(0, 0), (0, 5), (0, 5)], 1.0),
    "do not fit on the leg of 3 m from point 1 to point 2": lambda: polyline([(0, 0), (0, 9), (3, 9), (3, 0)], 2.0),
    "goes straight back at point 1": lambda: polyline([(0, 0), (0, 9), (0, 2)], 1.0),
    "a gap of 1 m": lambda: straight(3.0).then(straight(3.0).translate((0.0, 4.0))),
    "at an angle of 90 deg": lambda: straight(3.0).then(straight(3.0).rotate(np.pi / 2).translate((0.0, 3.0))),
}


def test_what_cannot_be_walked_is_refused_in_one_sentence():
    for words, make in IMPOSSIBLE.items():
        with pytest.raises(SimulationError, match=words) as refusal:
            make()
        assert str(refusal.value).count(". ") == 0, words
