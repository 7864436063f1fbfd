"""Levelling and heading: ours, the papers' in their own axes, and what their misprints do.

Truth is an attitude and a field: nothing here is computed by the functions under test.

======================== ============================ ======================================
in its own axes          Ma (1)-(5)                   AIEZ (19)-(25)
======================== ============================ ======================================
body axes                forward, right, down         forward, left, up
accelerometer at rest    (0, 0, -g)                   (0, 0, +g)
heading turns about      down: clockwise              up: counter-clockwise
======================== ============================ ======================================

What is printed wrong, and what must stand there (Ma's angles are minus the usual roll and pitch, and Ma (3) has the
usual matrix with the signs of both turned: together they are right):

========== ======================================= =====================================================
Ma (1)     atan(B_y / B_x) +- D                    -atan2(B_y, B_x) + D: else the heading counts twice
Ma (4)     asin(a_y (g cos p))                     asin(a_y / (g cos p)), better atan2(a_y, -a_z)
AIEZ (20)  atan(a_y / a_z)                         atan2: else upside down is upright
AIEZ (25)  atan(B_E / B_N) + D                     -atan2(B_E, B_N) - D: its heading turns the other way
========== ======================================= =====================================================
"""

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2, compute_heading, level_attitude, wrap_angle
from fg_nav.lab.simulation.fields import make_earth_field
from fg_nav.magnetic.footfall_field import (
    compute_field_heading,
    compute_inclination,
    compute_level_R_body,
    compute_true_heading,
    rotate_to_level,
)

G = np.array([0.0, 0.0, GRAVITY_M_S2])
INCLINATION, DECLINATION = np.radians([64.23, 2.57])
FIELD = make_earth_field(48.0, np.degrees(INCLINATION), np.degrees(DECLINATION)).vector
ANY = Rotation.random(300, random_state=0).as_matrix()
HEADINGS = np.radians(np.arange(-175.0, 180.0, 10.0))
AHEAD = np.abs(HEADINGS) < np.pi / 2


def tilted(roll_deg=17.0, pitch_deg=14.0):
    """Attitudes (N, 3, 3) with `HEADINGS`: turned, then pitched, then rolled."""
    tilt = Rotation.from_euler("YX", [pitch_deg, roll_deg], degrees=True).as_matrix()
    return np.array([level_attitude(np.array([0.0, 0.0, 1.0]), heading) @ tilt for heading in HEADINGS])


def sensed(nav_R_body):
    """Field and specific force (N, 3) that a sensor at rest in these attitudes reads."""
    return np.einsum("nji,j->ni", nav_R_body, FIELD), np.einsum("nji,j->ni", nav_R_body, G)


def off_deg(heading, truth):
    return np.degrees(np.abs(wrap_angle(heading - truth)))


def ma_heading(field, acc, sign=-1.0, arctangent=np.arctan2, divided=True, down=-1.0):
    """Ma (1), (4), (5) from our body frame; as printed with `sign` 1, a quotient's arctangent and a product."""
    x, y, z = np.moveaxis(acc * [1.0, -1.0, -1.0], -1, 0)
    r, p = np.arctan2(y, down * z), -np.arctan2(x, np.hypot(y, z))
    if not divided:
        r = np.arcsin(np.clip(y * GRAVITY_M_S2 * np.cos(p), -1.0, 1.0))
    x, y, z = np.moveaxis(field * [1.0, -1.0, -1.0], -1, 0)
    across = np.sin(r) * y - np.cos(r) * z
    north, east = np.cos(p) * x + np.sin(p) * across, np.cos(r) * y + np.sin(r) * z
    return sign * arctangent(east, north) + DECLINATION


def aiez_heading(field, acc, sign=-1.0, arctangent=np.arctan2):
    """AIEZ (20)-(25) from our body frame to our heading; as printed with `sign` 1 and quotients' arctangents."""
    x, y, z = np.moveaxis(acc, -1, 0)
    roll, pitch = arctangent(y, z), -np.arctan2(x, np.hypot(y, z))
    x, y, z = np.moveaxis(field, -1, 0)
    across = np.sin(roll) * y + np.cos(roll) * z
    north, west = np.cos(pitch) * x + np.sin(pitch) * across, np.cos(roll) * y - np.sin(roll) * z
    return -(sign * arctangent(west, north) + sign * DECLINATION)


def quotient(y, x):
    return np.arctan(y / x)


def test_heading_and_inclination_are_the_true_ones_in_any_attitude():
    level = rotate_to_level(*sensed(ANY))
    magnetic = compute_field_heading(level)
    np.testing.assert_allclose(off_deg(magnetic, compute_heading(ANY)), np.degrees(DECLINATION))
    assert off_deg(compute_true_heading(magnetic, DECLINATION), compute_heading(ANY)).max() < 1e-9
    np.testing.assert_allclose(compute_inclination(level), INCLINATION, atol=1e-12)


def test_levelling_lays_the_sensor_flat_without_turning_it():
    level_R_body = compute_level_R_body(ANY[:, 2])
    np.testing.assert_allclose(np.linalg.det(level_R_body), 1.0)
    up = np.einsum("nij,nj->ni", level_R_body, ANY[:, 2])
    np.testing.assert_allclose(up, np.tile([0, 0, 1], (300, 1)), atol=1e-12)
    assert level_R_body[:, 0, 0].min() > 0
    np.testing.assert_allclose(level_R_body[:, 1, 0], 0.0, atol=1e-12)


def test_both_papers_agree_with_ours_once_their_signs_are_right_and_not_as_printed():
    for paper in (ma_heading, aiez_heading):
        assert off_deg(paper(*sensed(ANY)), compute_heading(ANY)).max() < 1e-6
    field, acc = sensed(tilted())
    twice, turned = ma_heading(field, acc, sign=1.0), aiez_heading(field, acc, sign=1.0)
    np.testing.assert_allclose(wrap_angle(twice - DECLINATION), wrap_angle(DECLINATION - HEADINGS), atol=1e-9)
    np.testing.assert_allclose(wrap_angle(turned + DECLINATION), wrap_angle(DECLINATION - HEADINGS), atol=1e-9)
    south = off_deg(ma_heading(field, acc, arctangent=quotient), HEADINGS) > 177.0  # taken for north
    np.testing.assert_array_equal(south, ~AHEAD)
    assert np.median(off_deg(ma_heading(field, acc, divided=False), HEADINGS)) > 15.0  # the product of Ma (4)
    assert off_deg(ma_heading(field, acc, down=1.0), HEADINGS).max() > 60.0  # with the other's accelerometer
    upside_down = sensed(tilted(roll_deg=160.0))
    assert off_deg(aiez_heading(*upside_down), HEADINGS).max() < 1e-6
    assert off_deg(aiez_heading(*upside_down, arctangent=quotient), HEADINGS).max() > 90.0
