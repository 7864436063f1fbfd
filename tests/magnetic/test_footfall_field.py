"""The field at each footfall, of a foot that turns between stances in a field that is known; levelling and heading.

Truth is an attitude and a field: nothing of it is computed by the functions under test. The papers have axes of their
own:

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

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection.stance import Stances
from fg_nav.errors import EstimationError, MagneticError
from fg_nav.frames import GRAVITY_M_S2, compute_heading, level_attitude, wrap_angle
from fg_nav.lab.simulation.fields import make_earth_field
from fg_nav.magnetic import average_footfall_field
from fg_nav.magnetic.footfall_field import (
    HALF_WINDOW_S,
    compute_field_heading,
    compute_inclination,
    compute_level_R_body,
    compute_true_heading,
    integrate_attitude,
    rotate_to_level,
)
from fg_nav.recording import Recording
from tests.magnetic.fields import DIP, EARTH

RATE_HZ, STRIDE, STAND = 100.0, 100, 40
STRIDES = 12
UP = np.array([0.0, 0.0, 1.0])
TILT = Rotation.from_euler("xyz", [8.0, -12.0, 0.0], degrees=True).as_matrix()


def walk(mount=np.eye(3), rolling=0.0, first_heading=0.4, nav_field=EARTH, turning=0.5, tipping=0.0):
    """Recording, true attitudes and stances of a foot that stands 0.4 s and turns 0.6 s in every second.

    It turns by `turning` rad a stride, tilts forward and back as it does, and in stance rolls by `rolling` rad/s about
    the vertical and by `tipping` rad/s about the way ahead. `nav_field` is uT, (3,) or one a sample.
    """
    n = STRIDES * STRIDE
    stands = (np.arange(n) % STRIDE) < STAND
    swing = np.where(stands, 0.0, 2 * np.pi * ((np.arange(n) % STRIDE) - STAND) / (STRIDE - STAND))
    pitch = np.where(stands, 0.0, 0.6 * (1 - np.cos(swing)))
    yaw = np.cumsum(np.where(stands, rolling / RATE_HZ, -turning / (STRIDE - STAND)))
    roll = tipping / RATE_HZ * np.interp(np.arange(n) % STRIDE, [0, STAND, STRIDE], [0, STAND, 0])
    level = level_attitude(UP, first_heading)
    true = (
        Rotation.from_rotvec(yaw[:, None] * UP)
        * Rotation.from_matrix(level)
        * Rotation.from_rotvec(pitch[:, None] * [0.0, 1.0, 0.0])
        * Rotation.from_rotvec(roll[:, None] * [1.0, 0.0, 0.0])
    )
    true = true * Rotation.from_matrix(TILT @ mount)
    nav_R_body = true.as_matrix()
    gyr = (true[:-1].inv() * true[1:]).as_rotvec() * RATE_HZ
    acc = np.einsum("nji,j->ni", nav_R_body, GRAVITY_M_S2 * UP)
    mag = np.einsum("nji,nj->ni", nav_R_body, np.broadcast_to(nav_field, (n, 3)))
    t = np.arange(n) / RATE_HZ
    return Recording(t, acc, np.vstack([gyr, gyr[-1:]]), mag), nav_R_body, Stances.from_mask(stands)


def at_start(nav_R_body):
    return float(compute_heading(nav_R_body[0]))


def test_field_and_headings_are_the_true_ones():
    recording, nav_R_body, stances = walk()
    field = average_footfall_field(recording, stances, at_start(nav_R_body))
    true = nav_R_body[field.sample]
    assert len(field) == STRIDES
    np.testing.assert_array_equal(field.t, recording.t[field.sample])
    np.testing.assert_allclose(field.body_field, np.einsum("nji,j->ni", true, EARTH), atol=1e-6)
    np.testing.assert_allclose(field.body_force, np.einsum("nji,j->ni", true, GRAVITY_M_S2 * UP), atol=1e-6)
    np.testing.assert_allclose(field.nav_field, np.tile(EARTH, (STRIDES, 1)), atol=1e-3)
    np.testing.assert_allclose(wrap_angle(field.magnetic_heading - compute_heading(true)), 0.0, atol=1e-4)
    np.testing.assert_allclose(wrap_angle(field.gyro_heading - compute_heading(true)), 0.0, atol=1e-4)
    np.testing.assert_allclose(field.heading_difference, 0.0, atol=1e-4)
    np.testing.assert_allclose(field.inclination, DIP, atol=1e-4)
    np.testing.assert_allclose(field.strength, 48.0, atol=1e-6)
    assert np.ptp(field.magnetic_heading) > 1.0  # it did turn


def test_a_wrong_heading_to_begin_with_stays_in_the_difference_and_nowhere_else():
    recording, nav_R_body, stances = walk()
    right = average_footfall_field(recording, stances, at_start(nav_R_body))
    wrong = average_footfall_field(recording, stances, at_start(nav_R_body) + 0.3)
    np.testing.assert_allclose(wrong.heading_difference, -0.3, atol=1e-4)
    np.testing.assert_allclose(wrong.magnetic_heading, right.magnetic_heading, atol=1e-9)
    np.testing.assert_allclose(wrong.level_field, right.level_field, atol=1e-9)


def test_how_the_sensor_sits_changes_neither_difference_nor_inclination_nor_strength():
    plain = average_footfall_field(*walk()[::2])
    for angles in ((0, 0, 130), (20, 0, 0), (-10, 25, 70)):
        mount = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        turned = average_footfall_field(*walk(mount)[::2])
        np.testing.assert_allclose(turned.inclination, plain.inclination, atol=1e-4)
        np.testing.assert_allclose(turned.strength, plain.strength, atol=1e-6)
        np.testing.assert_allclose(np.diff(np.unwrap(turned.heading_difference)), 0.0, atol=1e-4)
        np.testing.assert_allclose(turned.body_field, plain.body_field @ mount, atol=1e-6)


def test_a_foot_that_rolls_in_stance_loses_nothing_by_the_mean():
    """AIEZ (9) prints |dB/dt|: a foot that rolls at 0.2 rad/s in a still field has eight of its sigmas, 0.5 uT/s."""
    for rolling, every in ((0.2, 1), (0.8, 1), (0.5, 2), (0.5, 5)):  # and of a slower magnetometer what it measured
        recording, nav_R_body, stances = walk(rolling=rolling)
        printed_rate = np.linalg.norm(np.diff(recording.mag[:STAND], axis=0), axis=1) * RATE_HZ
        assert printed_rate.min() / 0.5 > 8.0
        mag = np.where((np.arange(len(recording)) % every == 0)[:, None], recording.mag, np.nan)
        field = average_footfall_field(replace(recording, mag=mag), stances, at_start(nav_R_body))
        true = np.einsum("nji,j->ni", nav_R_body[field.sample], EARTH)
        np.testing.assert_array_equal(field.count, STAND // every)
        np.testing.assert_allclose(field.body_field, true, atol=1e-5)
        assert np.nanmax(field.scatter_uT) < 1e-4
        assert np.abs(field.strength_rate).max() < 1e-6


@pytest.mark.parametrize("every", [1, 5])
def test_the_strength_rate_is_the_slope_and_its_sigma_and_scatter_are_honest(every):
    """Of eight samples a stance too: their squares are right in the mean, not a seventh too small."""
    rng = np.random.default_rng(5)
    t = np.arange(STRIDES * STRIDE) / RATE_HZ
    recording, _, stances = walk(nav_field=EARTH * (1.0 + 0.05 * (t % 1.0))[:, None])  # 2.4 uT/s within each second
    exact = average_footfall_field(recording, stances)
    np.testing.assert_allclose(exact.strength_rate, 2.4, atol=1e-6)
    mag = np.where((np.arange(len(t)) % every == 0)[:, None], recording.mag, np.nan)
    count, at = STAND // every, t[:STAND:every]
    noisy = [replace(recording, mag=mag + 0.3 * rng.standard_normal(mag.shape)) for _ in range(60)]
    found = [average_footfall_field(one, stances) for one in noisy]
    errors = [(one.strength_rate - 2.4) / one.strength_rate_sigma for one in found]
    if every == 1:
        assert np.std(errors) == pytest.approx(1.0, abs=0.1)
        assert np.mean(errors) == pytest.approx(0.0, abs=0.15)
    square = 0.3**2 / ((at - at.mean()) ** 2).sum()
    assert np.mean([one.strength_rate_sigma**2 for one in found]) == pytest.approx(square, rel=0.08)
    slope = 2.4**2 * at.var() * count / (count - 1) / 3.0  # scatters too, on one axis of three
    assert np.mean([one.scatter_uT**2 for one in found]) == pytest.approx(0.3**2 + slope, rel=0.04)


def test_a_footfall_without_a_field_is_none_and_the_others_stay():
    recording, _, stances = walk()
    mag = recording.mag.copy()
    mag[2 * STRIDE : 3 * STRIDE] = np.nan
    mag[5 * STRIDE + 1 : 6 * STRIDE] = np.nan  # leaves a single sample
    holed, whole = (average_footfall_field(replace(recording, mag=one), stances) for one in (mag, recording.mag))
    there = np.isfinite(holed.strength)
    np.testing.assert_array_equal(np.flatnonzero(~there), [2, 5])
    np.testing.assert_array_equal(holed.body_field[there], whole.body_field[there])
    np.testing.assert_array_equal(holed.count[[2, 5]], [0, 1])
    np.testing.assert_allclose(holed.body_force, whole.body_force)


def test_of_a_long_standing_only_the_second_about_its_stillest_instant_is_averaged():
    recording, _, _ = walk(turning=0.0)
    unrest = np.ones(len(recording))
    unrest[600] = 0.0
    far = np.abs(recording.t - recording.t[600]) > HALF_WINDOW_S + 1e-9
    gyr, acc = np.zeros_like(recording.gyr), np.tile(recording.acc[0], (len(recording), 1))
    mag = np.where(far[:, None], 1000.0, recording.mag[0])
    stands = replace(Stances.from_mask(np.ones(len(recording), dtype=bool)), statistic=unrest)
    field = average_footfall_field(Recording(recording.t, acc, gyr, mag), stands)
    assert field.sample.tolist() == [600]
    assert field.count[0] == 101
    np.testing.assert_allclose(field.body_field[0], recording.mag[0], atol=1e-9)
    unrest[:] = 1.0
    unrest[[10, 15]] = 0.0  # of two stances that touch: the second is the first sample of its stance
    ends = np.array([0, 15, STAND])
    field = average_footfall_field(recording, Stances(ends[:-1], ends[1:], np.arange(2), len(unrest), statistic=unrest))
    assert field.sample.tolist() == [10, 15]
    assert field.count.tolist() == [15, STAND - 15]


def test_what_comes_before_the_first_stance_is_reached_by_stepping_back():
    whole, nav_R_body, _ = walk()
    cut = STAND + 15  # in the midst of a swing, the foot turning fastest
    recording, true = whole.slice(cut, len(whole)), nav_R_body[cut:]
    row = STRIDE - cut
    stances = Stances.from_mask((np.arange(len(recording)) + cut) % STRIDE < STAND)
    found = integrate_attitude(recording, stances, float(compute_heading(true[row])))
    np.testing.assert_allclose(found[: row + 1], true[: row + 1], atol=1e-6)


def test_the_stances_hold_the_attitude_upright():
    """1 deg/s about a level axis would tip it by 12 deg; each stance takes off more than half of what is there."""
    recording, nav_R_body, stances = walk(turning=0.0)
    ahead = nav_R_body[0].T @ level_attitude(UP, 0.4)[:, 0]
    tipping = replace(recording, gyr=recording.gyr + np.deg2rad(1.0) * ahead)
    found = integrate_attitude(tipping, stances, at_start(nav_R_body))
    tilt = np.degrees(np.arccos(np.clip((found[:, 2] * nav_R_body[:, 2]).sum(axis=1), -1.0, 1.0)))
    assert 0.5 < tilt[stances.stop - 1].max() < 1.5


def test_an_attitude_that_is_given_is_used_and_can_be_put_in_later():
    """What a smoother does that has the field judged again: on stances in which the foot is still, nothing is lost."""
    recording, nav_R_body, stances = walk()
    drifting = average_footfall_field(recording, stances, at_start(nav_R_body) + 0.3)
    assert np.abs(drifting.heading_difference).min() > 0.29  # looked at, and so kept, before it is replaced
    better = replace(drifting, nav_R_body=nav_R_body[drifting.sample])
    given = average_footfall_field(recording, stances, nav_R_body=nav_R_body)
    np.testing.assert_array_equal(given.nav_R_body, nav_R_body[given.sample])
    np.testing.assert_allclose(given.nav_field, np.tile(EARTH, (STRIDES, 1)), atol=1e-9)
    for name in ("heading_difference", "inclination", "nav_field"):
        np.testing.assert_allclose(getattr(better, name), getattr(given, name), atol=1e-6)


def test_a_constant_bias_that_a_rest_has_told_does_not_turn_the_inertial_heading():
    """Ten seconds at rest first: 1 deg/s of bias would be 22 deg at the end."""
    recording, nav_R_body, stances = walk()
    rest = 1000
    first = [np.tile(a[0], (rest, 1)) for a in (recording.acc, np.zeros_like(recording.gyr), recording.mag)]
    t = np.arange(rest + len(recording)) / RATE_HZ
    acc, gyr, mag = (
        np.vstack([f, a]) for f, a in zip(first, (recording.acc, recording.gyr, recording.mag), strict=True)
    )
    bias, noise = np.deg2rad([0.5, -1.0, 1.0]), 1e-4 * np.random.default_rng(1).standard_normal(gyr.shape)
    standing = Stances.from_mask(np.concatenate([np.ones(rest, dtype=bool), stances.mask]))
    field = average_footfall_field(
        Recording(t, acc + 10 * noise, gyr + bias + noise, mag), standing, at_start(nav_R_body)
    )
    assert np.degrees(np.abs(field.heading_difference)).max() < 0.5


def test_without_a_magnetometer_or_a_sample_of_it_it_says_so():
    recording, _, stances = walk()
    with pytest.raises(MagneticError, match="no magnetometer"):
        average_footfall_field(replace(recording, mag=None), stances)
    with pytest.raises(MagneticError, match=f"none of the {STRIDES} footfalls"):
        average_footfall_field(replace(recording, mag=np.full_like(recording.mag, np.nan)), stances)
    with pytest.raises(EstimationError):
        average_footfall_field(recording, Stances.from_mask(np.zeros(len(recording), dtype=bool)))


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
    ours = compute_true_heading(compute_field_heading(rotate_to_level(*sensed(ANY))), DECLINATION)
    for heading in (ours, ma_heading(*sensed(ANY)), aiez_heading(*sensed(ANY))):
        assert off_deg(heading, compute_heading(ANY)).max() < 1e-6
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
