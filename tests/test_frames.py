"""Attitude, heading and their signs: East-North-Up, headings clockwise from north."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.frames import (
    GRAVITY_M_S2,
    compute_heading,
    level_attitude,
    quaternion_xyzw,
    turn_heading,
    wrap_angle,
    yaw_rotation,
)

angles = st.floats(-50.0, 50.0)
rotvecs = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)
EAST, NORTH, UP = np.eye(3)


@given(rotvec=rotvecs)
@settings(deadline=None)
def test_a_small_turn_about_body_axes_turns_the_heading_as_told(rotvec):
    nav_R_body = Rotation.from_rotvec(rotvec).as_matrix()
    if np.hypot(nav_R_body[0, 0], nav_R_body[1, 0]) < 0.1:
        return  # x is nearly vertical
    small = 1e-6 * np.eye(3)
    turned = nav_R_body @ Rotation.from_rotvec(small).as_matrix()
    clockwise = wrap_angle(compute_heading(turned) - compute_heading(nav_R_body))
    np.testing.assert_allclose(turn_heading(nav_R_body), -clockwise / 1e-6, atol=1e-3)


@given(rotvec=rotvecs, heading=st.floats(-3.1, 3.1))
@settings(deadline=None)
def test_levelling_recovers_an_attitude_from_its_up_and_its_heading(rotvec, heading):
    tilt = Rotation.from_rotvec(rotvec).as_matrix()
    if np.hypot(tilt[0, 0], tilt[1, 0]) < 1e-3:
        return  # x is vertical and has no heading
    nav_R_body = yaw_rotation(compute_heading(tilt) - heading) @ tilt
    body_up = GRAVITY_M_S2 * nav_R_body[2]  # specific force at rest
    np.testing.assert_allclose(level_attitude(body_up, heading), nav_R_body, atol=1e-9)
    np.testing.assert_allclose(nav_R_body @ nav_R_body.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_levelling_with_x_vertical_is_still_a_rotation(sign):
    for hair in (0.0, 1e-9, -1e-9):
        body_up = np.array([sign, hair, 0.0])
        nav_R_body = level_attitude(body_up, 0.3)
        np.testing.assert_allclose(nav_R_body @ nav_R_body.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(nav_R_body) == pytest.approx(1.0)
        np.testing.assert_allclose(nav_R_body @ body_up / np.linalg.norm(body_up), UP, atol=1e-8)


@pytest.mark.parametrize(
    ("heading_deg", "forward"), [(0, NORTH), (90, EAST), (180, -NORTH), (-90, -EAST)], ids=["N", "E", "S", "W"]
)
def test_headings_are_clockwise_from_north(heading_deg, forward):
    level = level_attitude(UP, np.radians(heading_deg))
    np.testing.assert_allclose(level @ [1.0, 0.0, 0.0], forward, atol=1e-12)
    np.testing.assert_allclose(level @ [0.0, 0.0, 1.0], UP, atol=1e-12)
    assert wrap_angle(compute_heading(level) - np.radians(heading_deg)) == pytest.approx(0.0, abs=1e-12)


@given(rotvec=rotvecs, turn=st.floats(-3.0, 3.0))
@settings(deadline=None)
def test_turning_left_lowers_the_heading(rotvec, turn):
    nav_R_body = Rotation.from_rotvec(rotvec).as_matrix()
    if np.hypot(nav_R_body[0, 0], nav_R_body[1, 0]) < 1e-3:
        return
    turned = compute_heading(yaw_rotation(turn) @ nav_R_body)
    assert wrap_angle(turned - compute_heading(nav_R_body) + turn) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(yaw_rotation(turn), Rotation.from_euler("z", turn).as_matrix(), atol=1e-15)


@given(angle=angles)
def test_wrapping_keeps_the_direction(angle):
    wrapped = wrap_angle(np.array([angle]))[0]
    assert -np.pi <= wrapped <= np.pi
    assert np.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(wrap_angle(np.array([np.pi, -np.pi, 3 * np.pi, 0.0])), [-np.pi, -np.pi, -np.pi, 0.0])


def test_quaternions_are_scalar_last_and_turn_the_same():
    turn = Rotation.from_euler("z", 90, degrees=True)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(np.abs(quaternion_xyzw(turn.as_matrix()[None])), [[0, 0, half, half]], atol=1e-12)
    attitudes = Rotation.random(20, rng=np.random.default_rng(1)).as_matrix()
    np.testing.assert_allclose(Rotation.from_quat(quaternion_xyzw(attitudes)).as_matrix(), attitudes, atol=1e-12)
