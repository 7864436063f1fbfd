"""A magnetic field as a function of place, its derivatives, and the Earth's.

Fields of separate sources add (`Sum`). Away from its sources a static field has neither divergence nor curl (Maxwell),
so its gradient is symmetric and has no trace. With D(h) the central difference over +-h,

    dB_i / dx_j = (4 D(h/2) - D(h)) / 3 + O(h^4)        (Richardson).

The Earth's field is homogeneous over the reach of a walk. With strength F, dip I (positive where the field points into
the ground) and declination D (positive where a compass points east of north), in East-North-Up

    B = F (cos I sin D, cos I cos D, -sin I).

The three sites are those of MD Table 1, rounded as there and without declination. Any place and date is known from the
World Magnetic Model (`fg_nav.earth`).

An upright iron cylinder without end in a homogeneous field, and a street of them (Munoz Diaz et al. 2017).

Outside a cylinder of radius r_c and permeability mu_r, at r from its axis with u = r / |r| (horizontal), a far field
of horizontal part H is, and its upward part is as without iron,

    B = H + k (r_c / |r|)^n (2 (H . u) u - H),    k = (mu_r - 1) / (mu_r + 1).

It solves MD (19), (20). For H along north and rho = atan2(east, north) it is MD (21)-(23), whose factor prints n = 1.
Only n = 2, the field of a line of dipoles, is free of divergence and curl, and only so does the field cross the iron as
it must; n = 1 is kept to repeat what was printed.

The paper never lets two cylinders act at once. A street is cut into *cells*: the field at a place is that of the
cylinder whose surface is nearest. Across the border of two cells the field jumps, so an emulation must not difference
measurements across it; `cell` says where one is.

The template of Figure 4 is four streetlights (0.30 m) and a parked car (2 m). The text gives no positions; here a
pedestrian walks along the middle of a pavement 2 m wide, the lights stand at the kerb 30 m apart, their axes 1 m to
the left, and the car is parked half-way along the block, its axis 4 m to the left (2 m of air between). The template
repeats every 120 m. `PAST_CARS` is the same template for one who keeps 4 m farther away but where the paper's
pedestrian came close; its phase puts a car or a light at each of those places
(`fg_nav.lab.simulation.routes.past_cars`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.earth import PLACE_FORM, Place, compute_field
from fg_nav.errors import EarthError, SimulationError
from fg_nav.lab.simulation.fields.sources import IRON_MU_R


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


STEP_M = 0.02  # Short against what bends a field half a meter from steel, and far above rounding.


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


PHYSICAL, AS_PRINTED = 2.0, 1.0  # Exponents n: that of the physics, and that of MD (21) as printed.
STREETLIGHT_M, CAR_M = 0.30, 2.0  # Radii of the template's cylinders (paper, Section 2.2).
TEMPLATE_LENGTH_M = 120.0  # After this the template repeats; our choice, a block of houses.

TEMPLATE: tuple[tuple[float, float, float], ...] = (
    (15.0, 1.0, STREETLIGHT_M),
    (45.0, 1.0, STREETLIGHT_M),
    (60.0, 4.0, CAR_M),
    (75.0, 1.0, STREETLIGHT_M),
    (105.0, 1.0, STREETLIGHT_M),
)
"""Along the street (m), to the left of it (m), radius (m); our choice, see above."""

PAST_CARS: tuple[tuple[float, float, float], ...] = (
    (27.0, 5.0, STREETLIGHT_M),
    (57.0, 5.0, STREETLIGHT_M),
    (87.0, 5.0, STREETLIGHT_M),
    (110.0, 8.0, CAR_M),
    (117.0, 5.0, STREETLIGHT_M),
)
"""The same for one who walks on the far side; our choice, see above."""


@dataclass(frozen=True)
class Cylinders:
    """K upright cylinders, each alone in its cell.

    Attributes
    ----------
    axis : (K, 2) m, east and north of each axis.
    radius : (K,) m.
    far : the field far from iron.
    mu_r : relative permeability.
    exponent : n; `PHYSICAL` or `AS_PRINTED`.
    """

    axis: Floats
    radius: Floats
    far: Homogeneous
    mu_r: float = IRON_MU_R
    exponent: float = PHYSICAL

    def __post_init__(self) -> None:
        axis, radius = np.asarray(self.axis, dtype=np.float64), np.asarray(self.radius, dtype=np.float64)
        if axis.ndim != 2 or axis.shape[1] != 2 or radius.shape != (len(axis),) or not len(axis):
            raise SimulationError(f"axes {axis.shape} and radii {radius.shape} do not match: give (K, 2) and (K,).")
        if not (np.isfinite(axis).all() and (radius > 0).all() and self.mu_r >= 1 and self.exponent > 0):
            raise SimulationError(
                "a cylinder needs a finite axis, a radius above 0, a permeability of 1 or more "
                "and an exponent above 0: check the four."
            )
        object.__setattr__(self, "axis", axis)
        object.__setattr__(self, "radius", radius)

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m.

        Raises `SimulationError` inside a cylinder.
        """
        nearest, gap = self._nearest(position)
        self._check_outside(position, nearest, gap)
        arm = position[:, :2] - self.axis[nearest]
        square = np.sum(arm**2, axis=1, keepdims=True)
        far = self.far.vector[:2]
        k = (self.mu_r - 1) / (self.mu_r + 1)
        share = k * (self.radius[nearest, None] ** 2 / square) ** (self.exponent / 2)
        field = self.far.at(position)
        field[:, :2] += share * (2 * (arm @ far)[:, None] * arm / square - far)
        return field

    def cell(self, position: Floats) -> Ints:
        """Number (N,) of the cylinder that rules at `position` (N, 3) m: the one whose surface is nearest."""
        return self._nearest(position)[0]

    def _nearest(self, position: Floats) -> tuple[Ints, Floats]:
        """The ruling cylinder (N,) and the distance (N,) m from its surface."""
        nearest = np.zeros(len(position), dtype=np.int64)
        gap = np.full(len(position), np.inf)
        for k, (axis, radius) in enumerate(zip(self.axis, self.radius, strict=True)):
            own = np.hypot(position[:, 0] - axis[0], position[:, 1] - axis[1]) - radius
            nearer = own < gap
            nearest[nearer], gap[nearer] = k, own[nearer]
        return nearest, gap

    def _check_outside(self, position: Floats, nearest: Ints, gap: Floats) -> None:
        if len(gap) and gap.min() < 0:
            i = int(np.argmin(gap))
            east, north = self.axis[nearest[i]]
            raise SimulationError(
                f"({position[i, 0]:.2f}, {position[i, 1]:.2f}) m lies inside the cylinder of radius "
                f"{self.radius[nearest[i]]} m at ({east:.2f}, {north:.2f}) m: lead the path around it."
            )


def street(
    far: Homogeneous,
    length_m: float,
    *,
    start: tuple[float, float] = (0.0, 0.0),
    heading_deg: float = 90.0,
    exponent: float = PHYSICAL,
    template: Sequence[tuple[float, float, float]] = TEMPLATE,
) -> Cylinders:
    """Street with the template of Figure 4, repeated along it.

    Parameters
    ----------
    far : the field far from iron; the paper's is that of the equator.
    length_m : of the street; one more block is put before it and behind it.
    start : east and north of its beginning, m.
    heading_deg : direction of the street; 90 is east, as in the paper.
    exponent : `PHYSICAL` or `AS_PRINTED`.
    template : of a block: along the street, to the left of it and radius of each cylinder, m.

    Raises `SimulationError` for a length that is not above 0.
    """
    if not 0 < length_m < np.inf:
        raise SimulationError(f"a street of {length_m} m cannot be: give a length above 0.")
    heading = np.deg2rad(heading_deg)
    forward = np.array([np.sin(heading), np.cos(heading)])
    left = np.array([-forward[1], forward[0]])
    blocks = TEMPLATE_LENGTH_M * np.arange(-1, np.ceil(length_m / TEMPLATE_LENGTH_M) + 1)
    along, aside, radius = np.array(template).T
    along = np.add.outer(blocks, along).ravel()
    axis = start + along[:, None] * forward + np.tile(aside, len(blocks))[:, None] * left
    return Cylinders(axis, np.tile(radius, len(blocks)), far, exponent=exponent)
