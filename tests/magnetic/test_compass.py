"""Levelling and heading: ours, the papers' in their own axes, and what their misprints do.

Truth is an attitude and a field: nothing here is computed by the functions under test.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2, compute_heading, level_attitude, wrap_angle
from fg_nav.lab.simulation.fields import make_earth_field
from fg_nav.magnetic import footfall_field
from tests.magnetic import printed

G = np.array([0.0, 0.0, GRAVITY_M_S2])
INCLINATION, DECLINATION = np.radians([64.23, 2.57])
NORTH = make_earth_field(48.0, np.degrees(INCLINATION)).vector
EAST_OF_NORTH = make_earth_field(48.0, np.degrees(INCLINATION), np.degrees(DECLINATION)).vector
HEADINGS = np.radians(np.arange(-175.0, 180.0, 10.0))


def tilted(roll_deg=17.0, pitch_deg=14.0, headings=HEADINGS):
    """Attitudes (N, 3, 3) with these headings: turned, then pitched, then rolled."""
    tilt = Rotation.from_euler("YX", [pitch_deg, roll_deg], degrees=True).as_matrix()
    attitudes = np.array([level_attitude(np.array([0.0, 0.0, 1.0]), heading) @ tilt for heading in headings])
    np.testing.assert_allclose(wrap_angle(compute_heading(attitudes) - headings), 0.0, atol=1e-12)
    return attitudes


def sensed(nav_R_body, nav_field=NORTH):
    """Field and specific force (N, 3) that a sensor at rest in these attitudes reads."""
    return np.einsum("nji,j->ni", nav_R_body, nav_field), np.einsum("nji,j->ni", nav_R_body, G)


def off_deg(heading, truth=HEADINGS):
    return np.degrees(np.abs(wrap_angle(heading - truth)))


def test_ours_gives_heading_and_inclination_in_any_attitude():
    attitudes = Rotation.random(300, random_state=0).as_matrix()
    field, acc = sensed(attitudes)
    level = footfall_field.rotate_to_level(field, acc)
    np.testing.assert_allclose(
        wrap_angle(footfall_field.compute_field_heading(level) - compute_heading(attitudes)), 0.0, atol=1e-9
    )
    np.testing.assert_allclose(footfall_field.compute_inclination(level), INCLINATION, atol=1e-12)


def test_levelling_lays_the_sensor_flat_without_turning_it():
    attitudes = Rotation.random(300, random_state=1).as_matrix()
    level_R_body = footfall_field.compute_level_R_body(attitudes[:, 2])
    np.testing.assert_allclose(np.linalg.det(level_R_body), 1.0)
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", level_R_body, attitudes[:, 2]), np.tile([0, 0, 1], (300, 1)), atol=1e-12
    )
    forward = level_R_body[:, :, 0]
    assert forward[:, 0].min() > 0
    np.testing.assert_allclose(forward[:, 1], 0.0, atol=1e-12)


def test_declination_leads_from_the_compass_to_true_north():
    field, acc = sensed(tilted(), EAST_OF_NORTH)
    magnetic = footfall_field.compute_field_heading(footfall_field.rotate_to_level(field, acc))
    np.testing.assert_allclose(off_deg(magnetic), np.degrees(DECLINATION))
    assert off_deg(footfall_field.compute_true_heading(magnetic, DECLINATION)).max() < 1e-9
    np.testing.assert_allclose(
        off_deg(footfall_field.compute_true_heading(magnetic, -DECLINATION)), 2 * np.degrees(DECLINATION)
    )


@pytest.mark.parametrize("theirs", [printed.ma_heading, printed.aiez_heading])
def test_both_papers_agree_with_ours_once_their_signs_are_right(theirs):
    attitudes = Rotation.random(300, random_state=2).as_matrix()
    field, acc = sensed(attitudes, EAST_OF_NORTH)
    np.testing.assert_allclose(wrap_angle(theirs(field, acc, DECLINATION) - compute_heading(attitudes)), 0.0, atol=1e-9)


def test_both_papers_level_as_we_do():
    field, acc = sensed(Rotation.random(100, random_state=3).as_matrix())
    ours, frd = footfall_field.rotate_to_level(field, acc), printed.FRD_FROM_FLU
    np.testing.assert_allclose(printed.aiez_levelled(field, printed.aiez_tilt(acc)), ours, atol=1e-9)
    down = printed.ma_levelled(field * frd, printed.ma_tilt(acc * frd))
    np.testing.assert_allclose(down * frd, ours, atol=1e-9)
    np.testing.assert_allclose(printed.ma_inclination(down), INCLINATION)


def test_ma_5_is_two_rows_of_ma_3():
    """Ma (5) written out as it is printed."""
    rng = np.random.default_rng(0)
    (x, y, z), r, p = rng.normal(size=3), 0.3, -0.2
    two = [x * np.cos(p) + y * np.sin(p) * np.sin(r) - z * np.sin(p) * np.cos(r), y * np.cos(r) + z * np.sin(r)]
    np.testing.assert_allclose(printed.ma_levelled(np.array([x, y, z]), (r, p))[:2], two)


def test_aiez_19_is_the_force_that_aiez_20_and_21_read():
    roll, pitch = np.random.default_rng(0).uniform([[-np.pi], [-1.5]], [[np.pi], [1.5]], (2, 100))
    np.testing.assert_allclose(printed.aiez_tilt(printed.aiez_force((roll, pitch))), (roll, pitch), atol=1e-9)


def test_a_compass_with_the_printed_sign_counts_the_heading_twice():
    """Ma (1) and AIEZ (25): true minus printed heading is 2 psi where it must be 0 (both in their own axes)."""
    ahead = HEADINGS[np.abs(HEADINGS) < np.pi / 2]
    field, acc = sensed(tilted(headings=ahead))
    frd = printed.FRD_FROM_FLU
    down = printed.ma_levelled(field * frd, printed.ma_tilt(acc * frd))
    np.testing.assert_allclose(wrap_angle(ahead - printed.ma_compass(down)), 0.0, atol=1e-9)
    np.testing.assert_allclose(wrap_angle(ahead - printed.ma_compass_as_printed(down) - 2 * ahead), 0.0, atol=1e-9)
    up, yaw = printed.aiez_levelled(field, printed.aiez_tilt(acc)), -ahead
    np.testing.assert_allclose(wrap_angle(yaw - printed.aiez_compass(up)), 0.0, atol=1e-9)
    np.testing.assert_allclose(wrap_angle(yaw - printed.aiez_compass_as_printed(up) - 2 * yaw), 0.0, atol=1e-9)


def test_an_arctangent_of_a_quotient_takes_south_for_north():
    """Ma (1) and AIEZ (25): even with its sign right, the quotient forgets which way round the sensor is."""
    field, acc = sensed(tilted())
    level = footfall_field.rotate_to_level(field, acc)
    quotient = off_deg(np.arctan(level[:, 1] / level[:, 0]))
    behind = np.abs(HEADINGS) > np.pi / 2
    np.testing.assert_allclose(quotient[behind], 180.0)
    np.testing.assert_allclose(quotient[~behind], 0.0, atol=1e-9)


def test_the_field_in_navigation_axes_holds_no_heading():
    """Ma (1) asks for the components in north, east and down: there the field is the same however the foot turns."""
    attitudes = tilted()
    field, acc = sensed(attitudes)
    north, east, _ = np.moveaxis(np.einsum("nij,nj->ni", attitudes, field)[:, [1, 0, 2]], -1, 0)
    printed_heading = np.arctan2(east, north)
    np.testing.assert_allclose(printed_heading, 0.0, atol=1e-12)
    assert off_deg(printed_heading).max() > 170.0
    assert off_deg(printed.ma_heading(field, acc)).max() < 1e-9


def test_levelling_one_papers_way_with_the_others_accelerometer_is_off_by_far():
    """Ma (3), (4) and AIEZ (19)-(24) are each right, with an accelerometer that reads -g and +g down its third axis.

    Ma's matrix with the angles that AIEZ's accelerometer gives tilts the field twice as far instead of back.
    """
    field, acc = sensed(tilted())
    frd = printed.FRD_FROM_FLU
    right = printed.ma_compass(printed.ma_levelled(field * frd, printed.ma_tilt(acc * frd)))
    mixed = printed.ma_compass(printed.ma_levelled(field * frd, printed.aiez_tilt(-acc * frd)))
    assert off_deg(right).max() < 1e-9
    assert off_deg(mixed).max() > 60.0
    assert np.median(off_deg(mixed)) > 20.0
    unturned = printed.aiez_compass(printed.aiez_levelled(field, printed.ma_tilt(-acc)))
    assert off_deg(-unturned).max() > 60.0


def test_the_product_of_ma_4_is_no_roll():
    """asin(a_y g cos p) has no unit that an arcsine takes: any tilt of more than half a degree is a right angle."""
    field, acc = sensed(tilted(roll_deg=17.0, pitch_deg=0.0))
    roll, pitch = printed.ma_tilt_as_printed(acc * printed.FRD_FROM_FLU)
    np.testing.assert_allclose(np.degrees(np.abs(roll)), 90.0)
    right, _ = printed.ma_tilt(acc * printed.FRD_FROM_FLU)
    np.testing.assert_allclose(np.degrees(np.abs(right)), 17.0)
    level = printed.ma_levelled(field * printed.FRD_FROM_FLU, (roll, pitch))
    assert off_deg(printed.ma_compass(level)).max() > 60.0


def test_upside_down_is_not_upright():
    """AIEZ (20) as a quotient, and an arcsine as in Ma (4), end at a right angle of roll."""
    field, acc = sensed(tilted(roll_deg=160.0))
    assert off_deg(printed.aiez_heading(field, acc)).max() < 1e-9
    flat = printed.aiez_levelled(field, printed.aiez_tilt_as_printed(acc))
    assert off_deg(-printed.aiez_compass(flat)).max() > 90.0
    assert off_deg(printed.ma_heading(field, acc)).max() < 1e-9
    assert off_deg(_by_arcsine(field, acc)).max() > 90.0


def test_an_arcsine_wants_the_accelerometers_own_g():
    """Ma (4) with an MPU-9250's 3 % of scale: a degree of heading, and none by arctangents."""
    field, acc = sensed(tilted())
    assert off_deg(_by_arcsine(field, acc)).max() < 1e-6
    assert off_deg(_by_arcsine(field, 1.03 * acc)).max() > 1.0
    assert off_deg(printed.ma_heading(field, 1.03 * acc)).max() < 1e-9


def _by_arcsine(field, acc):
    """Ma's heading with the division that Ma (4) must mean, and its arcsines and g as printed."""
    x, y, _ = np.moveaxis(acc * printed.FRD_FROM_FLU, -1, 0)
    p = -np.arcsin(x / GRAVITY_M_S2)
    tilt = np.arcsin(np.clip(y / (GRAVITY_M_S2 * np.cos(p)), -1.0, 1.0)), p
    return printed.ma_compass(printed.ma_levelled(field * printed.FRD_FROM_FLU, tilt))


def test_declination_changes_its_sign_with_the_axes():
    """Ma's heading turns clockwise as declination does, AIEZ's the other way round; both print a plus."""
    field, acc = sensed(tilted(), EAST_OF_NORTH)
    frd = printed.FRD_FROM_FLU
    down = printed.ma_levelled(field * frd, printed.ma_tilt(acc * frd))
    up = printed.aiez_levelled(field, printed.aiez_tilt(acc))
    assert off_deg(printed.ma_compass(down, DECLINATION)).max() < 1e-9
    assert off_deg(-printed.aiez_compass(up, DECLINATION)).max() < 1e-9
    for wrong in (printed.ma_compass(down, -DECLINATION), -printed.aiez_compass(up, -DECLINATION)):
        np.testing.assert_allclose(off_deg(wrong), 2 * np.degrees(DECLINATION))


@pytest.mark.parametrize("theirs", [printed.ma_heading, printed.aiez_heading])
def test_as_printed_is_wrong_on_a_foot(theirs):
    """The whole chain as printed, at a foot's tilt: no use on any heading but by chance."""
    field, acc = sensed(tilted())
    assert np.median(off_deg(theirs(field, acc, as_printed=True))) > 45.0
