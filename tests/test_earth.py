"""The Earth's field of a place and date."""

import sys
from datetime import date

import numpy as np
import pytest

from fg_nav.earth import EarthField, Place, compute_field
from fg_nav.errors import EarthError
from fg_nav.lab.simulation.fields import make_earth_field

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
