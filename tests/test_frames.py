"""Attitude, heading and their signs, headings clockwise from north; and the Earth's field of a place and date."""

import sys
from datetime import date

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.earth import EarthField, Place, compute_field
from fg_nav.errors import EarthError
from fg_nav.frames import (
    GRAVITY_M_S2,
    compute_heading,
    level_attitude,
    quaternion_xyzw,
    turn_heading,
    wrap_angle,
    yaw_rotation,
)
from fg_nav.lab.simulation.fields import make_earth_field

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


TODAY = date(2026, 11, 21)


def needs_wmm():
    return pytest.importorskip("pygeomag", reason="the extra wmm is not installed")


def test_strength_inclination_and_declination_are_those_that_a_field_was_made_of():
    rng = np.random.default_rng(0)
    for _ in range(50):
        strength, dip, declination = rng.uniform([1, -89, -179], [70, 89, 179])
        field = EarthField(make_earth_field(strength, dip, declination).nav_field_uT)
        found = field.strength_uT, np.degrees(field.inclination), np.degrees(field.declination)
        np.testing.assert_allclose(found, (strength, dip, declination), rtol=1e-9, atol=1e-9)


def test_munich_in_april_2015_was_as_the_observatory_reported():
    """Strength, dip and declination as told by Munoz Diaz et al. (2017); crust and rounding make the rest.

    Natick, 1000 m, 4 July 2028, is as MathWorks' `wrldmagm` gives it (documentation of the Aerospace Toolbox).
    """
    needs_wmm()
    natick = compute_field(Place(42.283, -71.35, date(2028, 7, 4), height_m=1000.0))
    np.testing.assert_allclose(natick.vector, [-4.905, 20.139, -46.532], atol=0.001)
    field = compute_field(Place(48.165, 11.277, date(2015, 4, 15), height_m=572.0))
    assert field.strength_uT == pytest.approx(48.0, abs=0.4)
    assert np.degrees(field.inclination) == pytest.approx(64.23, abs=0.3)
    assert np.degrees(field.declination) == pytest.approx(2.57, abs=0.3)


def test_the_model_covers_today_and_the_poles():
    needs_wmm()
    for latitude in (-90.0, 0.0, 90.0):
        assert 22 < compute_field(Place(latitude, 11.6, TODAY)).strength_uT < 68
    ground, above = (compute_field(Place(48.0, 11.6, TODAY, height_m)).strength_uT for height_m in (0.0, 400_000.0))
    assert above < 0.9 * ground
    for year in (2009, 2030):
        with pytest.raises(EarthError, match="2010 to 2029"):
            compute_field(Place(48.0, 11.6, date(year, 6, 1)))


def test_what_is_no_place_is_refused():
    assert Place.parse(" -33.9, 18.4 ,2026-11-21") == Place(-33.9, 18.4, TODAY)
    for where, name in ((91.0, 0.0), "latitude"), ((np.nan, 0.0), "latitude"), ((0.0, 200.0), "longitude"):
        with pytest.raises(EarthError, match=name):
            Place(*where, TODAY)
    for words in ("munich", "48,11", "48,11,20240501", "48,11,2024-02-30", "48,11,2024-05-01,noon"):
        with pytest.raises(EarthError, match="latitude,longitude,YYYY-MM-DD"):
            Place.parse(words)


def test_without_the_extra_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygeomag", None)
    with pytest.raises(EarthError, match=r"pip install 'pygeomag>=[\d.]+'\.$"):
        compute_field(Place(48.1, 11.6, TODAY))
