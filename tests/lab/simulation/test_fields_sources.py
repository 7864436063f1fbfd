"""Cylinders, dipoles and circuits against the laws of magnetostatics, and the Earth's field."""

import sys

import numpy as np
import pytest

from fg_nav.earth import Place, compute_field
from fg_nav.errors import SimulationError
from fg_nav.frames import yaw_rotation
from fg_nav.lab.simulation.fields import (
    AS_PRINTED,
    PHYSICAL,
    SITES,
    Circuit,
    Cylinders,
    Dipoles,
    Sum,
    find_earth_field,
    magnet,
    make_earth_field,
    street,
)
from fg_nav.lab.simulation.fields.field import (
    CAR_M,
    IRON_MU_R,
    STREETLIGHT_M,
    TEMPLATE_LENGTH_M,
    UP,
    compute_demagnetizing_factor,
    compute_spheroid_moment,
    rod,
)
from tests.lab.simulation.magnetostatics import is_magnetic, measure_sources

MU_0 = 4 * np.pi * 0.1  # In uT m / A.

K = (IRON_MU_R - 1) / (IRON_MU_R + 1)
SKEW = make_earth_field(50.0, 60.0, 30.0)


def one_cylinder(far=SITES["equator"], radius=0.3, **options):
    return Cylinders(np.zeros((1, 2)), np.array([radius]), far, **options)


def around(count=200, least=0.5, most=3.0, seed=0):
    """Points between two spheres about the origin."""
    direction = np.random.default_rng(seed).standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * np.random.default_rng(seed + 1).uniform(least, most, (count, 1))


def beside(count=200, least=0.4, most=3.0, seed=0):
    """Points between two upright cylinders about the origin."""
    rng = np.random.default_rng(seed)
    angle, distance = rng.uniform(0, 2 * np.pi, count), rng.uniform(least, most, count)
    return np.stack([distance * np.sin(angle), distance * np.cos(angle), rng.uniform(0, 2, count)], axis=1)


LOOP = Circuit(np.array([[-2.0, -4.0, 0.0], [3.0, -4.0, 0.0], [3.0, -4.0, 2.8], [-2.0, -4.0, 2.8]]), 7.0)


@pytest.mark.parametrize(
    ("field", "position"),
    [
        (one_cylinder(), beside()),
        (one_cylinder(SKEW, radius=0.35), beside()),
        (one_cylinder(SITES["north-pole"]), beside()),
        (magnet(np.zeros(3), np.array([1.0, -2.0, 3.0])), around()),
        (rod(np.array([0, 0, -0.2]), np.array([0.1, 0, 0.2]), np.array([1.0, 2.0, -30.0])), around()),
        (LOOP, around()),
        (Sum((SKEW, LOOP, magnet(np.zeros(3), np.ones(3)))), around()),
    ],
    ids=["cylinder", "skew cylinder", "pole", "magnet", "rod", "circuit", "sum"],
)
def test_a_magnetic_field_has_neither_divergence_nor_curl(field, position):
    assert is_magnetic(field, position)


def test_the_printed_exponent_makes_no_magnetic_field():
    divergence, curl, size = measure_sources(one_cylinder(exponent=AS_PRINTED), beside())
    assert np.median(divergence / size) > 0.1
    assert np.median(curl / size) > 0.1


@pytest.mark.parametrize("exponent", [PHYSICAL, AS_PRINTED])
def test_it_is_equation_21_for_a_field_along_north(exponent):
    position = beside()
    x, y, _ = position.T
    r, rho = np.hypot(x, y), np.arctan2(x, y)
    east = 25 * K * (0.3 / r) ** exponent * np.sin(2 * rho)
    north = 25 * (1 + K * (0.3 / r) ** exponent * np.cos(2 * rho))
    expected = np.stack([east, north, np.zeros_like(x)], axis=1)
    np.testing.assert_allclose(one_cylinder(exponent=exponent).at(position), expected, atol=1e-12)
    elsewhere = Cylinders(np.array([[3.0, -1.0]]), np.array([0.3]), SITES["equator"], exponent=exponent)
    np.testing.assert_allclose(elsewhere.at(position + np.array([3.0, -1.0, 0.0])), expected, atol=1e-12)


def test_the_field_turns_with_the_field_that_makes_it():
    turn = yaw_rotation(0.7)
    position = beside()
    turned = one_cylinder(make_earth_field(50.0, 60.0, -np.degrees(0.7))).at(position @ turn.T)
    np.testing.assert_allclose(turned, one_cylinder(make_earth_field(50.0, 60.0)).at(position) @ turn.T, atol=1e-12)


def test_flux_and_tangential_field_pass_the_surface_of_the_iron():
    """Inside, B = 2 mu_r / (mu_r + 1) B_far (Jackson, Section 5.12, in two dimensions)."""
    angle = np.linspace(0, 2 * np.pi, 50)
    outward = np.stack([np.sin(angle), np.cos(angle), np.zeros(50)], axis=1)
    along = np.stack([np.cos(angle), -np.sin(angle), np.zeros(50)], axis=1)
    outside = one_cylinder(SKEW).at(0.3 * (1 + 1e-12) * outward)
    inside = 2 * IRON_MU_R / (IRON_MU_R + 1) * SKEW.vector * [1, 1, 0]
    np.testing.assert_allclose(np.sum(outside * outward, axis=1), outward @ inside, atol=1e-6)
    np.testing.assert_allclose(np.sum(outside * along, axis=1), along @ inside / IRON_MU_R, atol=1e-6)


def test_the_upward_part_and_what_is_far_are_untouched():
    assert np.all(one_cylinder(SKEW).at(beside())[:, 2] == SKEW.vector[2])
    np.testing.assert_allclose(one_cylinder(SKEW).at(beside(least=300, most=400)), SKEW.at(beside()), atol=1e-4)
    np.testing.assert_allclose(one_cylinder(SKEW, mu_r=1.0).at(beside()), SKEW.at(beside()), atol=1e-12)


def test_in_its_cell_a_cylinder_is_alone():
    axis, radius = np.array([[0.0, 0.0], [10.0, 2.0]]), np.array([0.3, 2.0])
    both = Cylinders(axis, radius, SKEW)
    position = np.random.default_rng(0).uniform([-5, -5, 0], [15, 6, 2], (500, 3))
    gap = np.linalg.norm(position[:, None, :2] - axis, axis=2) - radius
    position, gap = position[gap.min(axis=1) > 0], gap[gap.min(axis=1) > 0]
    cell = both.cell(position)
    np.testing.assert_array_equal(cell, gap.argmin(axis=1))
    assert set(cell) == {0, 1}
    for k in (0, 1):
        alone = Cylinders(axis[[k]], radius[[k]], SKEW).at(position[cell == k])
        np.testing.assert_array_equal(both.at(position)[cell == k], alone)


def test_the_field_jumps_only_where_the_cell_changes():
    way = np.stack([np.arange(0, 120, 0.01), np.zeros(12000), np.ones(12000)], axis=1)
    avenue = street(SITES["equator"], 120.0)
    jump = np.linalg.norm(np.diff(avenue.at(way), axis=0), axis=1)
    border = np.diff(avenue.cell(way)) != 0
    assert 5 <= border.sum() <= 6
    assert jump[~border].max() < 0.25
    assert jump[border].max() > 0.5


def test_a_street_has_four_lights_and_a_car_to_a_block():
    blocks = street(SITES["equator"], 600.0)
    on_street = (blocks.axis[:, 0] >= 0) & (blocks.axis[:, 0] < 600)
    assert np.sum(blocks.radius[on_street] == STREETLIGHT_M) == 4 * 5
    assert np.sum(blocks.radius[on_street] == CAR_M) == 5


def test_a_street_repeats_and_turns():
    position = np.random.default_rng(0).uniform([0, -0.5, 0], [300, 0.5, 1], (300, 3))
    east = street(SITES["equator"], 600.0)
    np.testing.assert_allclose(east.at(position), east.at(position + np.array([TEMPLATE_LENGTH_M, 0, 0])), atol=1e-9)
    north = street(make_earth_field(25.0, 0.0, -90.0), 600.0, start=(5.0, 7.0), heading_deg=0.0)
    turn = yaw_rotation(np.pi / 2)
    np.testing.assert_allclose(north.at(position @ turn.T + [5, 7, 0]), east.at(position) @ turn.T, atol=1e-9)


def test_a_magnet_has_the_field_of_a_small_current_loop():
    """Area times current is the moment: Biot-Savart against the dipole."""
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    radius, current = 0.01, 4.0e4
    corners = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    moment = np.array([0, 0, np.pi * radius**2 * current])
    position = around(least=0.8)
    expected = magnet(np.zeros(3), moment).at(position)
    np.testing.assert_allclose(Circuit(corners, current).at(position), expected, atol=2e-3 * np.abs(expected).max())


def test_magnets_add():
    a, b = np.random.default_rng(0).normal(size=(2, 4, 3))
    position = around(least=6, most=9)
    singly = [magnet(place, moment).at(position) for place, moment in zip(a, b, strict=True)]
    np.testing.assert_allclose(Dipoles(a, b).at(position), np.sum(singly, axis=0), atol=1e-12)
    np.testing.assert_array_equal(Dipoles(np.zeros((0, 3)), np.zeros((0, 3))).at(position), 0 * position)


def test_flux_passes_the_pole_of_an_iron_sphere():
    """Inside, B = 3 mu_r / (mu_r + 2) B_far; outside, B_far and a dipole."""
    radius, far = 0.4, SITES["munich"].vector
    pole = radius * far / np.linalg.norm(far)
    outside = far + magnet(np.zeros(3), compute_spheroid_moment(far, UP, radius, radius)).at(pole[None])[0]
    np.testing.assert_allclose(outside, 3 * IRON_MU_R / (IRON_MU_R + 2) * far, rtol=1e-9)


def test_demagnetising_factors_are_those_of_osborn_and_fall_without_a_step():
    tabled = {1.0: 1 / 3, 2.0: 0.1736, 10.0: 0.0203, 0.5: 0.5272, 0.1: 0.8608}
    assert {a: compute_demagnetizing_factor(a) for a in tabled} == pytest.approx(tabled, abs=6e-5)
    factor = np.array([compute_demagnetizing_factor(a) for a in np.geomspace(1e-3, 1e3, 4001)])
    assert np.all(np.diff(factor) < 0)
    assert np.diff(factor).min() > -2e-3


def test_a_rod_is_two_poles():
    moment, half = 40.0, 1.4
    position = around(least=2.0, most=4.0)
    poles = sum(
        sign * 0.1 * moment / (2 * half) * (position - pole) / np.linalg.norm(position - pole, axis=1)[:, None] ** 3
        for sign, pole in ((1, [0, 0, half]), (-1, [0, 0, -half]))
    )
    felt = rod(np.array([0, 0, -half]), np.array([0, 0, half]), np.array([0, 0, moment]), count=28).at(position)
    np.testing.assert_allclose(felt, poles, atol=0.01 * np.abs(poles).max())


def test_around_a_wire_the_field_adds_up_to_the_current():
    angle = np.linspace(0, 2 * np.pi, 721)
    ring = np.array([0.0, -4.0, 0.0]) + 0.6 * np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    middle = (ring[1:] + ring[:-1]) / 2
    total = np.sum(LOOP.at(middle) * np.diff(ring, axis=0))
    assert total == pytest.approx(MU_0 * LOOP.current_A, rel=1e-4)
    elsewhere = np.sum(LOOP.at(middle + np.array([0, 2.0, 0])) * np.diff(ring, axis=0))
    assert elsewhere == pytest.approx(0.0, abs=1e-4)


IMPOSSIBLE = {
    "within 1 cm of a dipole": lambda: magnet(np.zeros(3), np.ones(3)).at(np.array([[0.001, 0, 0]])),
    "conductor": lambda: LOOP.at(LOOP.corners[:1]),
    r"inside the cylinder of radius 0.3 m at \[0. 0.\] m": lambda: one_cylinder().at(np.array([[0.1, 0.2, 0]])),
    "north-pole, equator, munich": lambda: find_earth_field("atlantis"),
}


def test_what_cannot_be_is_refused_in_a_sentence():
    for words, make in IMPOSSIBLE.items():
        with pytest.raises(SimulationError, match=words):
            make()


# ---- the Earth's


@pytest.mark.parametrize(
    ("name", "printed"), [("north-pole", (0, 0, -65)), ("equator", (0, 25, 0)), ("munich", (0, 21.04, -43.14))]
)
def test_the_sites_are_those_of_the_table_and_each_place_has_its_own_row(name, printed):
    assert find_earth_field(name) is SITES[name]
    felt = SITES[name].at(np.random.default_rng(0).normal(size=(5, 3)))
    np.testing.assert_allclose(felt, [printed] * 5, atol=0.006)
    felt[0] = 0.0
    np.testing.assert_array_equal(felt[1:], np.tile(SITES[name].vector, (4, 1)))


def test_a_field_has_the_strength_and_direction_asked_for():
    rng = np.random.default_rng(0)
    for _ in range(50):
        asked = rng.uniform([1, -89, -179], [70, 89, 179])
        east, north, up = make_earth_field(*asked).vector
        horizontal = np.hypot(east, north)
        got = np.hypot(horizontal, up), np.degrees(np.arctan2(-up, horizontal)), np.degrees(np.arctan2(east, north))
        np.testing.assert_allclose(got, asked, rtol=1e-9, atol=1e-9)


def test_a_place_is_where_the_model_has_it_and_what_it_refuses_is_named_as_a_site(monkeypatch):
    pytest.importorskip("pygeomag", reason="the extra wmm is not installed")
    written = "48.165, 11.277, 2015-04-15"
    np.testing.assert_array_equal(find_earth_field(written).vector, compute_field(Place.parse(written)).vector)
    with pytest.raises(SimulationError, match=r"not on the Earth.* or choose one of north-pole"):
        find_earth_field("91,0,2026-01-01")
    monkeypatch.setitem(sys.modules, "pygeomag", None)
    with pytest.raises(SimulationError, match=r"pip install 'pygeomag>=.*north-pole"):
        find_earth_field("48.1,11.6,2026-11-21")
