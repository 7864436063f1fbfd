"""The Earth's field: sites, any direction, and the World Magnetic Model."""

import sys
from datetime import date

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from fg_nav.simulation.fields import SITES, Homogeneous, earth_field, site, world_magnetic_model


def needs_wmm():
    return pytest.importorskip("pygeomag", reason="the extra wmm is not installed")


def strength_dip_declination(field):
    east, north, up = field.vector
    horizontal = np.hypot(east, north)
    return np.hypot(horizontal, up), np.degrees(np.arctan2(-up, horizontal)), np.degrees(np.arctan2(east, north))


@pytest.mark.parametrize(
    ("name", "printed"), [("north-pole", (0, 0, -65)), ("equator", (0, 25, 0)), ("munich", (0, 21.04, -43.14))]
)
def test_the_sites_are_those_of_the_table(name, printed):
    np.testing.assert_allclose(site(name).vector, printed, atol=0.006)
    assert site(name) is SITES[name]


def test_a_field_has_the_strength_and_direction_asked_for():
    rng = np.random.default_rng(0)
    for _ in range(50):
        asked = rng.uniform([1, -89, -179], [70, 89, 179])
        np.testing.assert_allclose(strength_dip_declination(earth_field(*asked)), asked, rtol=1e-9, atol=1e-9)


def test_it_is_the_same_everywhere_and_each_place_has_its_own_row():
    felt = SITES["munich"].at(np.random.default_rng(0).normal(size=(5, 3)))
    felt[0] = 0.0
    np.testing.assert_array_equal(felt[1:], np.tile(SITES["munich"].vector, (4, 1)))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: site("atlantis"), "north-pole, equator, munich"),
        (lambda: earth_field(-1.0, 60.0), "strength"),
        (lambda: earth_field(np.nan, 60.0), "strength"),
        (lambda: earth_field(48.0, 91.0), "dip"),
        (lambda: earth_field(48.0, 60.0, np.inf), "declination"),
        (lambda: Homogeneous((1.0, 2.0)), "three"),
        (lambda: Homogeneous((1.0, 2.0, np.nan)), "three"),
        (lambda: world_magnetic_model(91.0, 0.0, 0.0, date(2026, 1, 1)), "latitude"),
        (lambda: world_magnetic_model(0.0, 200.0, 0.0, date(2026, 1, 1)), "longitude"),
        (lambda: world_magnetic_model(0.0, 0.0, 1e7, date(2026, 1, 1)), "metres above sea"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(make, words):
    with pytest.raises(SimulationError, match=words):
        make()


def test_without_the_extra_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygeomag", None)
    with pytest.raises(SimulationError, match=r"pip install 'fg-nav\[wmm\]'"):
        world_magnetic_model(48.1, 11.6, 500.0, date(2026, 11, 21))


def test_the_model_of_2025_agrees_with_another_implementation():
    """Natick, 1000 m, 4 July 2028, as MathWorks' `wrldmagm` gives it (documentation of the Aerospace Toolbox)."""
    needs_wmm()
    field = world_magnetic_model(42.283, -71.35, 1000.0, date(2028, 7, 4))
    np.testing.assert_allclose(field.vector, [-4.905, 20.139, -46.532], atol=0.001)


def test_munich_in_april_2015_was_as_the_observatory_reported():
    """Strength, dip and declination as told by Munoz Diaz et al. (2017); crust and rounding make the rest."""
    needs_wmm()
    found = strength_dip_declination(world_magnetic_model(48.165, 11.277, 572.0, date(2015, 4, 15)))
    assert np.all(np.abs(np.subtract(found, (48.0, 64.23, 2.57))) < (0.4, 0.3, 0.3))


def test_the_model_covers_today_and_the_poles():
    needs_wmm()
    for latitude in (-90.0, 0.0, 90.0):
        strength, _, _ = strength_dip_declination(world_magnetic_model(latitude, 11.6, 0.0, date(2026, 11, 21)))
        assert 22 < strength < 68
    weaker = world_magnetic_model(48.0, 11.6, 400_000.0, date(2026, 11, 21)).vector
    assert np.linalg.norm(weaker) < 0.9 * np.linalg.norm(SITES["munich"].vector)


@pytest.mark.parametrize("year", [2009, 2030, 2035])
def test_a_date_of_no_edition_is_refused(year):
    needs_wmm()
    with pytest.raises(SimulationError, match="2010 to 2029"):
        world_magnetic_model(48.0, 11.6, 0.0, date(year, 6, 1))
