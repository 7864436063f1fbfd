"""Iron from an ordinary walk: against made-up walks whose iron, building and drift are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.calibration import (
    WalkCalibrationParameters,
    calibrate_on_walk,
    circular_sd_deg,
    correct_field,
    walk_model,
)
from fg_nav.calibration import walk as walk_calibration
from fg_nav.errors import CalibrationError
from fg_nav.frames import yaw_rotation
from fg_nav.magnetic import FootfallField

EARTH = np.array([0.0, 21.0, -43.0])
HARD = np.array([9.0, -6.0, 4.0])
ANYWAY = WalkCalibrationParameters(must_gain=False, largest_sigma_uT=np.inf)


@pytest.fixture
def hard_alone(monkeypatch):
    """What is asked of a walk where soft iron is next to none."""
    monkeypatch.setattr(walk_model, "SOFT_IRON_SIGMA", 1e-4)
    monkeypatch.setattr(walk_calibration, "BLOCKS", 2)
    return ANYWAY


"""Soft iron known to be none."""


def round_walk(strides=120, rounds=3):
    """Headings (F,) rad of right-angled rounds, a straight of which is several strides long."""
    return np.pi / 2 * np.floor(np.arange(strides) / strides * rounds * 4)


def walked(heading, rng, building_uT=8.0, hard=HARD, soft=None, drift_deg=0.0, again=0):
    """Field at footfalls with these headings; the building's is alike (0.25) at neighbours and heavy-tailed.

    The inertial heading drifts evenly by `drift_deg` in all; with `again` the building repeats after so many footfalls.
    """
    n = len(heading)
    tilt = Rotation.from_rotvec(np.radians(1.5) * rng.standard_normal((n, 3)) * [1, 1, 0]).as_matrix()
    truth = np.array([yaw_rotation(np.pi / 2 - angle) for angle in heading]) @ tilt
    draw = rng.standard_t(6, (n + 1, 3)) / np.sqrt(1.5)
    building = building_uT * (draw[1:] + 0.27 * draw[:-1]) / np.hypot(1, 0.27)
    if again:
        building = building[np.arange(n) % again]
    free = np.einsum("nji,nj->ni", truth, EARTH + building)
    reading = free @ (np.eye(3) if soft is None else soft) + hard
    drift = np.radians(np.linspace(0.0, drift_deg, n))
    attitude = np.array([yaw_rotation(-angle) for angle in drift]) @ truth
    none = np.zeros(n)
    t = 1.1 * np.arange(n)
    return FootfallField(np.arange(n), t, reading, 9.8 * truth[:, 2], attitude, np.full(n, 20), none, none, none)


def test_without_a_building_the_level_iron_is_found_to_a_hair():
    found = calibrate_on_walk(walked(round_walk(), np.random.default_rng(1), building_uT=0.02))
    np.testing.assert_allclose(found.hard_iron_uT[:2], HARD[:2], atol=0.1)
    field = walked(round_walk(), np.random.default_rng(1), building_uT=0.02)
    after = correct_field(field, found)
    assert circular_sd_deg(field.heading_difference) > 15
    assert circular_sd_deg(after.heading_difference) < 1


def test_soft_iron_shows_where_there_is_no_building():
    soft = np.array([[1.05, 0.03, 0.0], [0.03, 0.96, 0.0], [0.0, 0.0, 1.0]])
    heading = np.linspace(0, 6 * np.pi, 120)
    field = walked(heading, np.random.default_rng(2), building_uT=0.02, soft=soft)
    found = calibrate_on_walk(field)
    bent = np.linalg.inv(found.correction)
    assert bent[0, 1] == pytest.approx(0.03, abs=0.003)
    assert bent[0, 0] / bent[1, 1] == pytest.approx(1.05 / 0.96, abs=0.005)


@pytest.mark.parametrize("again", [0, 60], ids=["new places", "the same places four times"])
def test_errors_over_the_ground_are_as_large_as_they_are_said_to_be(again, hard_alone):
    """Over many walks the error by its own sigma is one."""
    heading = round_walk(240, 8)
    errors = []
    for seed in range(60):
        found = calibrate_on_walk(walked(heading, np.random.default_rng(seed), again=again), hard_alone)
        errors.append((found.hard_iron_uT - HARD)[:2] / found.sigma[:2])
    assert 0.75 < np.sqrt(np.mean(np.square(errors))) < 1.25


def test_a_walk_over_the_same_places_again_says_little_more(hard_alone):
    """Twice round shows as much as once of the building, and about as much of the iron."""
    heading = round_walk(240, 8)
    new, same = (
        calibrate_on_walk(walked(heading, np.random.default_rng(3), again=again), hard_alone) for again in (0, 60)
    )
    assert same.sigma[:2].mean() > 1.3 * new.sigma[:2].mean()


def test_what_a_level_floor_cannot_show_keeps_its_prior():
    found = calibrate_on_walk(walked(round_walk(), np.random.default_rng(4)))
    assert found.sigma[2] > 15
    assert found.sigma[0] < 4


def test_a_drifting_heading_is_not_taken_for_iron():
    steady, drifting = (
        calibrate_on_walk(walked(round_walk(), np.random.default_rng(5), drift_deg=drift)) for drift in (0.0, 25.0)
    )
    np.testing.assert_allclose(drifting.hard_iron_uT[:2], steady.hard_iron_uT[:2], atol=0.7)


def test_a_frame_turned_about_up_changes_nothing():
    field = walked(round_walk(), np.random.default_rng(6))
    turned = replace(field, nav_R_body=yaw_rotation(1.1) @ field.nav_R_body)
    one, other = calibrate_on_walk(field), calibrate_on_walk(turned)
    np.testing.assert_allclose(other.hard_iron_uT, one.hard_iron_uT, atol=0.02)
    np.testing.assert_allclose(other.sigma, one.sigma, rtol=0.01)


def test_a_single_magnet_does_not_move_it():
    field = walked(round_walk(), np.random.default_rng(7))
    body_field = field.body_field.copy()
    body_field[40] += [150.0, -80.0, 60.0]
    before, after = calibrate_on_walk(field), calibrate_on_walk(replace(field, body_field=body_field))
    np.testing.assert_allclose(after.hard_iron_uT[:2], before.hard_iron_uT[:2], atol=0.5)


def test_footfalls_without_a_field_are_left_out():
    field = walked(round_walk(), np.random.default_rng(8))
    body_field = field.body_field.copy()
    body_field[10:20] = np.nan
    assert calibrate_on_walk(replace(field, body_field=body_field)).samples == 110


def test_a_straight_walk_is_refused_for_its_headings():
    heading = np.radians(3) * np.random.default_rng(9).standard_normal(120)
    with pytest.raises(CalibrationError, match="100 % of them head within 45 deg of one direction"):
        calibrate_on_walk(walked(heading, np.random.default_rng(9)))


@pytest.mark.parametrize("strides", [0, 1, 19])
def test_a_short_walk_is_refused(strides):
    field = walked(round_walk(30), np.random.default_rng(10))
    body_field = field.body_field.copy()
    body_field[strides:] = np.nan
    with pytest.raises(CalibrationError, match=f"^{strides} footfalls? with a field cannot tell"):
        calibrate_on_walk(replace(field, body_field=body_field))


def refusal(field):
    """In words; nothing if it is calibrated."""
    try:
        calibrate_on_walk(field)
    except CalibrationError as error:
        return str(error)
    return ""


def test_most_walks_without_iron_are_refused():
    fields = [walked(round_walk(), np.random.default_rng(seed), hard=np.zeros(3)) for seed in range(30)]
    assert sum("no iron shows against the building" in refusal(field) for field in fields) >= 26


def test_iron_that_helps_in_one_part_only_is_refused():
    """What stood beside the way in the middle of the walk, at one heading, is not on the shoe."""
    reasons = []
    for seed in range(10):
        field = walked(round_walk(), np.random.default_rng(seed), hard=np.zeros(3))
        there = (np.arange(120) >= 50) & (np.arange(120) < 65)
        beside = np.einsum("nji,j->ni", field.nav_R_body, [35.0, 0.0, 0.0]) * there[:, None]
        reasons.append(refusal(replace(field, body_field=field.body_field + beside)))
    assert all(reasons)
    assert any("does not help in the others" in reason for reason in reasons)


def test_iron_that_bends_the_field_as_no_shoe_does_is_refused():
    bent = np.diag([2.5, 1.0, 1.0])
    field = walked(round_walk(), np.random.default_rng(2), building_uT=0.02, soft=bent)
    with pytest.raises(CalibrationError, match="as no shoe does"):
        calibrate_on_walk(field)


@pytest.mark.parametrize("reading", [[20.0, 3.0, -40.0], [0.0, 0.0, 0.0]])
@pytest.mark.parametrize("noise_uT", [0.0, 0.3])
def test_a_magnetometer_that_does_not_feel_the_field_is_refused(reading, noise_uT):
    """All of a dead sensor's reading is hard iron, and known to a hair."""
    rng = np.random.default_rng(14)
    field = walked(round_walk(), rng)
    dead = np.array(reading) + noise_uT * rng.standard_normal(field.body_field.shape)
    assert "does the magnetometer work" in refusal(replace(field, body_field=dead))


@pytest.mark.parametrize("unit", [1e-6, 0.01, 1000.0], ids=["tesla", "gauss", "nanotesla"])
def test_readings_in_another_unit_are_refused(unit):
    field = walked(round_walk(), np.random.default_rng(15))
    assert refusal(replace(field, body_field=unit * field.body_field))


def test_the_jacobian_is_that_of_the_residual():
    walk = walk_model.Walk.of(walked(round_walk(), np.random.default_rng(11), drift_deg=20.0))
    rng = np.random.default_rng(12)
    at = np.concatenate([HARD, np.eye(3)[np.triu_indices(3)], EARTH, 0.3 * rng.standard_normal(walk.knots.shape[1])])
    at[3:9] += 0.1 * rng.standard_normal(6)
    step = 1e-5
    ahead, behind = (
        np.stack([walk_model.compute_residual(walk, at + sign * step * one) for one in np.eye(len(at))], axis=2)
        for sign in (1, -1)
    )
    np.testing.assert_allclose(walk_model.compute_jacobian(walk, at), -(ahead - behind) / (2 * step), atol=1e-5)


def test_circular_spread_knows_no_edge():
    angle = np.radians(10) * np.random.default_rng(13).standard_normal(20_000)
    assert circular_sd_deg(angle + np.pi) == pytest.approx(10, rel=0.02)
    assert circular_sd_deg(np.append(angle, np.nan)) == pytest.approx(10, rel=0.02)
