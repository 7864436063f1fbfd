"""The Earth's field in the simulator: sites, any direction, and any place."""

import sys

import numpy as np
import pytest

from fg_nav.earth import Place, compute_field
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.fields import SITES, Homogeneous, find_earth_field, make_earth_field, site


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
        np.testing.assert_allclose(strength_dip_declination(make_earth_field(*asked)), asked, rtol=1e-9, atol=1e-9)


def test_it_is_the_same_everywhere_and_each_place_has_its_own_row():
    felt = SITES["munich"].at(np.random.default_rng(0).normal(size=(5, 3)))
    felt[0] = 0.0
    np.testing.assert_array_equal(felt[1:], np.tile(SITES["munich"].vector, (4, 1)))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: site("atlantis"), "north-pole, equator, munich"),
        (lambda: make_earth_field(-1.0, 60.0), "strength"),
        (lambda: make_earth_field(np.nan, 60.0), "strength"),
        (lambda: make_earth_field(48.0, 91.0), "dip"),
        (lambda: make_earth_field(48.0, 60.0, np.inf), "declination"),
        (lambda: Homogeneous((1.0, 2.0)), "three"),
        (lambda: Homogeneous((1.0, 2.0, np.nan)), "three"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(make, words):
    with pytest.raises(SimulationError, match=words):
        make()


def test_a_place_is_where_the_model_has_it_and_what_it_refuses_is_named_as_a_site():
    pytest.importorskip("pygeomag", reason="the extra wmm is not installed")
    written = "48.165, 11.277, 2015-04-15"
    np.testing.assert_array_equal(find_earth_field(written).vector, compute_field(Place.parse(written)).vector)
    with pytest.raises(SimulationError, match=r"not on the Earth.* or choose one of north-pole"):
        find_earth_field("91,0,2026-01-01")


def test_without_the_extra_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygeomag", None)
    with pytest.raises(SimulationError, match=r"pip install 'fg-nav\[wmm\]'.*north-pole"):
        find_earth_field("48.1,11.6,2026-11-21")
