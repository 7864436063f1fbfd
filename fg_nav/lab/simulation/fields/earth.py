"""The Earth's field: homogeneous over the reach of a walk.

With strength F, dip I (positive where the field points into the ground) and declination D (positive where a compass
points east of north), in East-North-Up

    B = F (cos I sin D, cos I cos D, -sin I).

The three sites are those of Munoz Diaz et al. (2017), Table 1, rounded as there and without declination. Any place
and date is known from the World Magnetic Model (`fg_nav.earth`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.earth import PLACE_FORM, Place, compute_field
from fg_nav.errors import EarthError, SimulationError


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
        raise SimulationError(f"there is no site {name!r}: choose one of {', '.join(SITES)}, or give {PLACE_FORM}.")
    return SITES[name]


def earth_at(where: str) -> Homogeneous:
    """Field of a site by its name, or of `latitude,longitude,YYYY-MM-DD` by the World Magnetic Model.

    Raises
    ------
    SimulationError
        For what is neither, a place or date without a field, or without the extra `wmm`.
    """
    if "," not in where:
        return site(where)
    try:
        return Homogeneous(compute_field(Place.parse(where)).nav_field_uT)
    except EarthError as error:
        raise SimulationError(f"{str(error).removesuffix('.')}, or choose one of {', '.join(SITES)}.") from None
