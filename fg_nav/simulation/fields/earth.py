"""The Earth's field: homogeneous over the reach of a walk.

With strength F, dip I (positive where the field points into the ground) and declination D (positive where a compass
points east of north), in East-North-Up

    B = F (cos I sin D, cos I cos D, -sin I).

The three sites are those of Munoz Diaz et al. (2017), Table 1, rounded as there and without declination. Any place
and date is known from the World Magnetic Model (US and UK defence agencies; one edition every five years), worked out
by `pygeomag`, an extra of this project: it is asked for only when a place is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from importlib import import_module
from types import MappingProxyType
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError

EXTRA = "wmm"
"""The extra of this project that brings the World Magnetic Model."""

MODEL_HEIGHT_M = (-1000.0, 850_000.0)
"""The World Magnetic Model holds between these heights above the ellipsoid (its own report)."""


@dataclass(frozen=True)
class Homogeneous:
    """The same field everywhere.

    Attributes
    ----------
    nav_field_uT : flux density in East-North-Up.
    """

    nav_field_uT: tuple[float, float, float]

    def __post_init__(self) -> None:
        if len(self.nav_field_uT) != 3 or not np.isfinite(self.nav_field_uT).all():
            raise SimulationError(f"the field {self.nav_field_uT} is no vector: give three finite numbers in uT.")

    @property
    def vector(self) -> Floats:
        """Flux density (3,) uT in nav."""
        return np.array(self.nav_field_uT, dtype=np.float64)

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m."""
        return np.tile(self.vector, (len(position), 1))


def earth_field(strength_uT: float, dip_deg: float, declination_deg: float = 0.0) -> Homogeneous:
    """Field of a given strength and direction.

    Parameters
    ----------
    strength_uT : not negative.
    dip_deg : below the horizon, -90 to 90; positive on the northern hemisphere.
    declination_deg : clockwise from north.

    Raises
    ------
    SimulationError
        Where there is no such field.
    """
    if not 0.0 <= strength_uT < np.inf:
        raise SimulationError(f"a field of {strength_uT} uT cannot be: give a strength of 0 or more.")
    if not (-90.0 <= dip_deg <= 90.0 and np.isfinite(declination_deg)):
        raise SimulationError(
            f"dip {dip_deg} and declination {declination_deg} degrees name no direction: give a dip within -90 to 90."
        )
    dip, declination = np.deg2rad([dip_deg, declination_deg])
    direction = (np.cos(dip) * np.sin(declination), np.cos(dip) * np.cos(declination), -np.sin(dip))
    east, north, up = (strength_uT * float(part) for part in direction)
    return Homogeneous((east, north, up))


SITES: Mapping[str, Homogeneous] = MappingProxyType(
    {
        "north-pole": earth_field(65.0, 90.0),
        "equator": earth_field(25.0, 0.0),
        "munich": earth_field(48.0, 64.0),
    }
)
"""Munoz Diaz et al. (2017), Table 1."""


def site(name: str) -> Homogeneous:
    """Field of a site by name: `north-pole`, `equator` or `munich`.

    Raises
    ------
    SimulationError
        For any other name.
    """
    if name not in SITES:
        raise SimulationError(f"there is no site {name!r}: choose one of {', '.join(SITES)}, or name a place and date.")
    return SITES[name]


def world_magnetic_model(latitude_deg: float, longitude_deg: float, height_m: float, when: date) -> Homogeneous:
    """Field of the World Magnetic Model at a place and date; nav's north is the geographic one.

    Parameters
    ----------
    latitude_deg, longitude_deg : geodetic, north and east positive; -90 to 90 and -180 to 180.
    height_m : above the WGS 84 ellipsoid.
    when : from 2010 to the end of the newest edition that `pygeomag` knows (2029 for WMM2025).

    Raises
    ------
    SimulationError
        Without the extra `wmm`, off the Earth, or at a date of no edition.
    """
    _check_place(latitude_deg, longitude_deg, height_m)
    try:
        model = _library().GeoMag(base_year=when.year)
        found = model.calculate(glat=latitude_deg, glon=longitude_deg, alt=height_m / 1000, time=_decimal_year(when))
    except ValueError as error:
        raise SimulationError(
            f"the World Magnetic Model knows no field of {when} ({error}): name a date from 2010 to 2029."
        ) from None
    return Homogeneous((found.y / 1000, found.x / 1000, -found.z / 1000))


def _check_place(latitude_deg: float, longitude_deg: float, height_m: float) -> None:
    if not (-90.0 <= latitude_deg <= 90.0 and -180.0 <= longitude_deg <= 180.0):
        raise SimulationError(
            f"latitude {latitude_deg}, longitude {longitude_deg} is not on the Earth: "
            f"give degrees within -90 to 90 and -180 to 180."
        )
    low, high = MODEL_HEIGHT_M
    if not low <= height_m <= high:
        raise SimulationError(
            f"at {height_m} m there is no World Magnetic Model: give metres above sea within {low:.0f} to {high:.0f}."
        )


def _decimal_year(when: date) -> float:
    first, next_first = date(when.year, 1, 1), date(when.year + 1, 1, 1)
    return when.year + (when - first).days / (next_first - first).days


def _library() -> Any:
    try:
        return import_module("pygeomag")
    except ModuleNotFoundError:
        raise SimulationError(
            f"the World Magnetic Model needs a library that is not installed: "
            f"pip install 'fg-nav[{EXTRA}]', or name a site ({', '.join(SITES)})."
        ) from None
