"""A magnetic field as a function of place, its derivatives, and the Earth's.

Fields of separate sources add (`Sum`). Away from its sources a static field has neither divergence nor curl (Maxwell),
so its gradient is symmetric and has no trace. With D(h) the central difference over +-h,

    dB_i / dx_j = (4 D(h/2) - D(h)) / 3 + O(h^4)        (Richardson).

The Earth's field is homogeneous over the reach of a walk. With strength F, dip I (positive where the field points into
the ground) and declination D (positive where a compass points east of north), in East-North-Up

    B = F (cos I sin D, cos I cos D, -sin I).

The three sites are those of MD Table 1, rounded as there and without declination. Any place and date is known from the
World Magnetic Model (`fg_nav.earth`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.earth import PLACE_FORM, Place, compute_field
from fg_nav.errors import EarthError, SimulationError


class Field(Protocol):
    """A static magnetic field."""

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT in nav (East-North-Up) at `position` (N, 3) m in nav."""
        ...


@dataclass(frozen=True)
class Sum:
    """The field of several sources."""

    parts: Sequence[Field]

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m."""
        total: Floats = np.sum([part.at(position) for part in self.parts], axis=0)
        return total


STEP_M = 0.02
"""Short against what bends a field half a meter from steel, and far above rounding."""


def gradient(field: Field, position: Floats, step_m: float = STEP_M) -> Floats:
    """Gradient (N, 3, 3) uT/m at `position` (N, 3) m: row is the component of the field, column the direction."""
    coarse, fine = _central(field, position, step_m), _central(field, position, step_m / 2)
    return (4 * fine - coarse) / 3


def divergence(gradient: Floats) -> Floats:
    """Divergence (N,) uT/m of gradients (N, 3, 3)."""
    trace: Floats = np.trace(gradient, axis1=1, axis2=2)
    return trace


def curl(gradient: Floats) -> Floats:
    """Curl (N, 3) uT/m of gradients (N, 3, 3)."""
    turned = np.swapaxes(gradient, 1, 2) - gradient
    return np.stack([turned[:, 1, 2], turned[:, 2, 0], turned[:, 0, 1]], axis=1)


def _central(field: Field, position: Floats, step_m: float) -> Floats:
    shifts = step_m * np.eye(3)
    columns = [(field.at(position + shift) - field.at(position - shift)) / (2 * step_m) for shift in shifts]
    return np.stack(columns, axis=2)


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


def make_earth_field(strength_uT: float, dip_deg: float, declination_deg: float = 0.0) -> Homogeneous:
    """Field of a given strength and direction.

    Parameters
    ----------
    strength_uT : not negative.
    dip_deg : below the horizon, -90 to 90; positive on the northern hemisphere.
    declination_deg : clockwise from north.

    Raises `SimulationError` where there is no such field.
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
        "north-pole": make_earth_field(65.0, 90.0),
        "equator": make_earth_field(25.0, 0.0),
        "munich": make_earth_field(48.0, 64.0),
    }
)
"""Munoz Diaz et al. (2017), Table 1."""


def site(name: str) -> Homogeneous:
    """Field of a site by name: `north-pole`, `equator` or `munich`.

    Raises `SimulationError` for any other name.
    """
    if name not in SITES:
        raise SimulationError(f"there is no site {name!r}: choose one of {', '.join(SITES)}, or give {PLACE_FORM}.")
    return SITES[name]


def find_earth_field(where: str) -> Homogeneous:
    """Field of a site by its name, or of `latitude,longitude,YYYY-MM-DD` by the World Magnetic Model.

    Raises `SimulationError` for what is neither, a place or date without a field, or without the extra `wmm`.
    """
    if "," not in where:
        return site(where)
    try:
        return Homogeneous(compute_field(Place.parse(where)).nav_field_uT)
    except EarthError as error:
        raise SimulationError(f"{str(error).removesuffix('.')}, or choose one of {', '.join(SITES)}.") from None
