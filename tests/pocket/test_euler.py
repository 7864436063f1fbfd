"""Euler angles and their errors against scipy and finite differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.lab.reproduce.munoz_diaz2017.as_printed import (
    angles_of_rotation,
    angles_of_up,
    error_axes,
    inverse_error_axes,
    is_degenerate,
    roll_as_printed,
    rotation_of_angles,
)

ANGLES = [(0.1, -0.4, 2.5), (-2.9, 1.2, -0.7), (1.4, 0.0, 0.0)]


@pytest.mark.parametrize("angles", ANGLES)
def test_angles_are_those_of_rotations_about_z_then_y_then_x(angles):
    R = Rotation.from_euler("ZYX", angles[::-1]).as_matrix()
    assert np.allclose(rotation_of_angles(np.array(angles)), R, atol=1e-14)
    assert np.allclose(angles_of_rotation(R), angles, atol=1e-14)


@pytest.mark.parametrize("angles", ANGLES)
def test_errors_of_angles_turn_about_their_axes(angles):
    R, step = rotation_of_angles(np.array(angles)), 1e-6
    for i, column in enumerate(error_axes(R).T):
        moved = [rotation_of_angles(np.array(angles) + sign * step * np.eye(3)[i]) for sign in (1, -1)]
        turned = Rotation.from_matrix(moved[0] @ moved[1].T).as_rotvec() / (2 * step)
        assert np.allclose(column, turned, atol=1e-8)
    assert np.allclose(inverse_error_axes(R) @ error_axes(R), np.eye(3), atol=1e-12)


@pytest.mark.parametrize("angles", ANGLES)
def test_gravity_gives_roll_and_pitch(angles):
    force = 9.8 * rotation_of_angles(np.array(angles))[2]
    assert np.allclose(angles_of_up(force), angles[:2], atol=1e-12)


def test_the_printed_roll_knows_no_sensor_upside_down():
    upright, upside_down = (9.8 * rotation_of_angles(np.array([roll, 0.1, 0.0]))[2] for roll in (0.3, 0.3 - np.pi))
    assert roll_as_printed(upright) == pytest.approx(0.3)
    assert roll_as_printed(upside_down) == pytest.approx(0.3)  # half a turn off
    assert angles_of_up(upside_down)[0] == pytest.approx(0.3 - np.pi)


def test_a_vertical_x_axis_is_where_angles_end():
    assert is_degenerate(rotation_of_angles(np.array([0.2, np.radians(89.5), 1.0])))
    assert not is_degenerate(rotation_of_angles(np.array([0.2, np.radians(88.5), 1.0])))
