"""Changes of a true field over a window: fields whose changes are known, and what a compass would show."""

import numpy as np
import pytest

from fg_nav.errors import EvaluationError
from fg_nav.frames import yaw_rotation
from fg_nav.lab.reproduce.roc import measure_compass_deviation, measure_course_change, measure_field_change
from fg_nav.lab.simulation import simulate
from fg_nav.magnetic.footfall_field import compute_field_heading, rotate_to_level

NORTH = np.array([0.0, 21.0, -43.0])


def turned(bearing_deg, field=NORTH):
    """The field turned clockwise by each of these angles."""
    return np.array([yaw_rotation(-angle) @ field for angle in np.deg2rad(bearing_deg)])


def test_a_field_that_creeps_changes_by_its_whole_way():
    field = NORTH + np.arange(10.0)[:, None] * [0.3, 0.0, 0.0]
    np.testing.assert_allclose(measure_field_change(field, 1)[1:], 0.3)
    change = measure_field_change(field, 3)
    np.testing.assert_allclose(change[3:], 0.9)
    assert np.isnan(change[:3]).all()


def test_a_field_that_comes_back_has_changed_all_the_same():
    field = NORTH + np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0])[:, None] * [0.0, 0.0, 1.0]
    np.testing.assert_allclose(measure_field_change(field, 3), [np.nan, np.nan, np.nan, 2.0, 2.0, 0.0])


def test_turning_the_map_changes_nothing():
    field = NORTH + np.random.default_rng(2).normal(scale=3.0, size=(50, 3))
    there, turned_map = measure_field_change(field, 2), measure_field_change(field @ yaw_rotation(1.0).T, 2)
    np.testing.assert_allclose(there, turned_map, atol=1e-12)


def test_deviation_is_the_error_of_a_perfect_compass():
    """A level sensor at any heading, in a field turned off the Earth's, read as every compass of the library is."""
    earth = turned([4.0])[0]
    field = turned([4.0, 14.0, -20.0, 179.0])
    nav_R_body = yaw_rotation(0.8)
    shown = [compute_field_heading(rotate_to_level(nav_R_body.T @ b, nav_R_body[2])) for b in (earth, *field)]
    error = np.array(shown[1:]) - shown[0]
    np.testing.assert_allclose(np.sin(measure_compass_deviation(field, earth)), np.sin(error), atol=1e-12)
    np.testing.assert_allclose(np.cos(measure_compass_deviation(field, earth)), np.cos(error), atol=1e-12)
    assert np.rad2deg(measure_compass_deviation(field, earth)[1]) == pytest.approx(-10.0)


def test_course_of_a_straight_way_and_of_a_circle():
    straight = np.arange(8.0)[:, None] * [0.5, 1.0, 0.0]
    np.testing.assert_allclose(measure_course_change(straight, 3)[3:], 0.0, atol=1e-12)
    angle = np.deg2rad(25.0) * np.arange(8)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    change = np.rad2deg(measure_course_change(circle, 3))
    np.testing.assert_allclose(change[3:], 50.0)
    assert np.isnan(change[:3]).all()
    assert len(change) == 8


def test_the_simulator_tells_the_field_where_the_sensor_is():
    """It is what the magnetometer shows once its iron is taken off and the true attitude turns it."""
    walk = simulate("demo", 5)
    sample = np.arange(0, len(walk.recording.t), 997)
    truth = walk.recording.truth
    iron, soft = (np.array(walk.drawn["sensor"][key]) for key in ("hard_iron_uT", "soft_iron"))
    corrected = np.linalg.solve(soft, (walk.recording.mag[sample] - iron).T).T
    shown = np.einsum("nij,nj->ni", truth.nav_R_body[sample], corrected)
    error = np.linalg.norm(shown - walk.nav_field(sample), axis=1)
    assert np.nanmedian(error) < 1.5
    assert np.nanmedian(np.linalg.norm(walk.nav_field(sample) - walk.earth.vector, axis=1)) > 3.0


def test_what_cannot_be_is_said():
    with pytest.raises(EvaluationError, match="window of 3 steps cannot be laid over 3 stances"):
        measure_field_change(np.tile(NORTH, (3, 1)), 3)
    with pytest.raises(EvaluationError, match="window of 0 steps"):
        measure_field_change(np.tile(NORTH, (3, 1)), 0)
    with pytest.raises(EvaluationError, match="window of 3 steps cannot be laid over 2 stances"):
        measure_course_change(np.zeros((2, 3)), 3)
