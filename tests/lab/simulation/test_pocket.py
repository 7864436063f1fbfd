"""The pocket scenarios of Munoz Diaz et al. (2017) against the figures of their Tables 1 to 3 and of Figure 10."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.frames import yaw_rotation
from fg_nav.lab.reproduce.munoz_diaz2017.walks import BORDER_S, mark_borders, replace_field
from fg_nav.lab.simulation import SCENARIOS, Choices, Person, routes, simulate
from fg_nav.lab.simulation.fields import PAST_CARS, SITES, Cylinders, Homogeneous, Sum, street
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.plan import Stand, Walk, plan
from fg_nav.lab.simulation.sensors import preset

TABLE_1 = {"north-pole": [0, 0, -65.0], "equator": [0, 25.0, 0], "munich": [0, 21.0418, -43.1421]}

SHORT = replace(
    SCENARIOS["pocket-past-cars"], route=lambda rng: [Stand(3.0), Walk(straight(40.0).rotate(np.pi / 2)), Stand(3.0)]
)
IDEAL = replace(SHORT, sensor="ideal")


@pytest.fixture(scope="module")
def ideal():
    return simulate(IDEAL, 3)


@pytest.mark.parametrize("site", TABLE_1)
def test_in_nav_the_field_of_a_pocket_is_that_of_table_1(site):
    walk = simulate(IDEAL, 5, Choices(site=site, field="homogeneous"))
    nav_field = np.einsum("nij,nj->ni", walk.recording.truth.nav_R_body, walk.recording.mag)
    np.testing.assert_allclose(nav_field, np.tile(TABLE_1[site], (len(nav_field), 1)), atol=1e-3)


def test_the_biases_of_table_3_are_met_at_both_ends():
    prior = preset("munoz-diaz-table-3")
    ends = []
    for seed in range(40):
        run = prior.draw(np.random.default_rng(seed)).switch_on(np.random.default_rng([seed, 1]))
        ends.append(np.degrees(run.biases_at(np.array([0.0, 44 * 60.0])).gyr))
    np.testing.assert_allclose(np.mean(ends, axis=0), [[-0.12, 0.06, -0.12], [-0.13, 0.05, -0.22]], atol=0.003)
    assert np.std(ends, axis=0).min() > 0.002  # 20 deg/h over the root of two, of the AR(1)


def test_aligned_the_sensor_stands_upright_and_looks_ahead():
    for seed in (1, 2):
        R = simulate(IDEAL, seed).recording.truth.nav_R_body[:400]  # standing, 200 Hz
        assert np.degrees(np.arccos(R[:, 2, 2])).max() < 0.6
        np.testing.assert_allclose(R[:, :2, 0], [[1.0, 0.0]] * len(R), atol=0.02)  # to the east


def test_aligned_or_not_it_is_the_same_walk():
    one, other = simulate(IDEAL, 1), simulate(replace(IDEAL, aligned=False), 1)
    np.testing.assert_array_equal(one.recording.truth.position, other.recording.truth.position)
    turn = one.recording.truth.nav_R_body[0].T @ other.recording.truth.nav_R_body[0]
    assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) > 5.0
    np.testing.assert_allclose(other.recording.gyr, one.recording.gyr @ turn, atol=1e-12)
    chosen = simulate(replace(IDEAL, aligned=False), 1, Choices(aligned=True))
    np.testing.assert_array_equal(chosen.recording.gyr, one.recording.gyr)


def strength_by_minute(seed):
    """Strength of the street's field over a walk by a person of the usual pace, at the places of the feet, and when."""
    course = routes.past_cars(np.random.default_rng(seed))
    strides = plan(course, Person(), np.random.default_rng([seed, 1]))
    t = np.arange(0.0, strides.end_s, 0.2)
    place = np.stack([np.interp(t, strides.start + strides.duration, axis[1:]) for axis in strides.footprint.T], axis=1)
    field = street(SITES["equator"], 500.0, start=tuple(strides.footprint[0, :2]), template=PAST_CARS)
    return t / 60.0, np.linalg.norm(field.at(place), axis=1), field, place


@pytest.mark.parametrize("seed", range(2))
def test_cars_are_passed_at_16_and_32_minutes_and_lamps_at_24_and_35(seed):
    minute, strength, field, place = strength_by_minute(seed)
    near = np.zeros(len(minute), dtype=bool)
    for printed, radius, least in ((16, 2.0, 8.0), (24, 0.3, 2.0), (32, 2.0, 8.0), (35, 0.3, 2.0)):
        about = np.abs(minute - printed) < 0.7
        peak = np.flatnonzero(about & (field.radius[field.cell(place)] == radius))
        peak = peak[np.argmax(np.abs(strength[peak] - 25.0))]
        assert abs(strength[peak] - 25.0) > least
        assert abs(minute[peak] - printed) < 0.5
        near |= np.abs(minute - minute[peak]) < 0.4
    assert np.abs(strength - 25.0)[~near].max() < 2.0


def test_in_its_own_field_a_walk_keeps_its_magnetometer(ideal):
    again = replace_field(ideal, ideal.field, 0.0, np.random.default_rng(0), border_s=0.0)
    np.testing.assert_allclose(again.mag, ideal.recording.mag, atol=1e-9)
    np.testing.assert_array_equal(again.gyr, ideal.recording.gyr)
    assert replace_field(ideal, None, 0.0, np.random.default_rng(0)).mag is None


def test_in_another_field_it_is_the_walk_simulated_there(ideal):
    elsewhere = simulate(IDEAL, 3, Choices(site="munich", field="homogeneous"))
    emulated = replace_field(ideal, Homogeneous(tuple(TABLE_1["munich"])), 0.0, np.random.default_rng(0))
    np.testing.assert_allclose(emulated.mag, elsewhere.recording.mag, atol=1e-3)
    noisy = replace_field(ideal, SITES["munich"], 0.5, np.random.default_rng(0))
    np.testing.assert_allclose((noisy.mag - elsewhere.recording.mag).std(axis=0), 0.5, rtol=0.05)


def test_turning_the_walk_is_turning_the_field_the_other_way(ideal):
    turned = simulate(IDEAL, 3, Choices(site="munich", field="homogeneous", turned_deg=-90.0))
    other = Homogeneous(tuple(yaw_rotation(-np.pi / 2) @ TABLE_1["munich"]))
    emulated = replace_field(ideal, other, 0.0, np.random.default_rng(0))
    np.testing.assert_allclose(emulated.mag, turned.recording.mag, atol=1e-3)


def test_across_a_border_of_two_cylinders_there_is_no_field(ideal):
    recording = replace_field(ideal, ideal.field, 0.0, np.random.default_rng(0))
    lost = np.isnan(recording.mag[:, 0])
    cylinders = next(part for part in ideal.field.parts if isinstance(part, Cylinders))
    place = recording.truth.position + ideal.origin
    crossed = np.flatnonzero(np.diff(cylinders.cell(place))) + 1
    assert len(crossed) >= 1
    assert lost[crossed].all()
    since = recording.t[lost] - recording.t[crossed[np.searchsorted(crossed, np.flatnonzero(lost), side="right") - 1]]
    assert since.min() >= 0.0
    assert BORDER_S - 0.01 < since.max() < BORDER_S
    assert not mark_borders(recording.t, place, SITES["munich"]).any()
    np.testing.assert_array_equal(mark_borders(recording.t, place, Sum([SITES["munich"], cylinders])), lost)
