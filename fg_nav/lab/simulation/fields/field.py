"""Magnetic fields as functions of place: the Earth's, dipoles, circuits of direct current, and iron cylinders.

Away from its sources a static field has neither divergence nor curl (Maxwell). Fields of separate sources add (`Sum`).

The Earth's field is homogeneous over the reach of a walk. With strength F, dip I (positive where the field points into
the ground) and declination D (positive where a compass points east of north), in East-North-Up

    B = F (cos I sin D, cos I cos D, -sin I).

The three sites are those of MD Table 1, rounded as there and without declination. Any place and date is known from the
World Magnetic Model (`fg_nav.earth`).

A dipole of moment m (A m^2), seen from it at r (m), is

    B = mu_0 / (4 pi) (3 (m . u) u - m) / |r|^3,    u = r / |r|,    mu_0 / (4 pi) = 0.1 uT m / A.

Soft iron in a homogeneous field B_0 takes on the moment of its shape. A spheroid of volume V with demagnetizing
factor N_i along axis i and susceptibility chi = mu_r - 1 has

    m_i = V / mu_0  chi / (1 + N_i chi)  B_0i,

where the N_i add up to 1: a third each for a sphere, and less along what is long (Osborn 1945). A long object is a
row of such dipoles, as a thin magnetized rod is: what is felt near its ends are its poles.

A straight conductor from a to b with a current I (A) adds, at a point seen from its ends at r_a and r_b (m),

    B = mu_0 I / (4 pi)  (1/|r_a| + 1/|r_b|) (r_a x r_b) / (|r_a| |r_b| + r_a . r_b)        (Biot and Savart).

A single piece has a curl everywhere, for its current ends in nothing; around a *closed* circuit the curls cancel.
A supply cable holds both its conductors and is hardly felt: a pair 1 cm apart at 10 A makes 0.1 uT half a meter from
it. What is felt is the current that returns by another path, through the steel of the building, some amperes round a
loop as high as a storey. The mains' 50 Hz is not modelled.

Outside an upright iron cylinder without end, of radius r_c and permeability mu_r (Munoz Diaz et al. 2017), at
r from its axis with u = r / |r| (horizontal), a far field of horizontal part H is, its upward part as without iron,

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
from typing import Protocol

import numpy as np

from fg_nav.arrays import Brief, Floats, Ints
from fg_nav.earth import PLACE_FORM, Place, compute_field
from fg_nav.errors import EarthError, SimulationError
from fg_nav.system.compiled import njit

SCALE_UT = 0.1  # mu_0 / (4 pi) in uT m / A.
CLOSEST_M = 0.01  # Nearer to a point dipole than this nothing can be.
IRON_MU_R = 200.0  # Relative permeability of structural steel in weak fields; that of Munoz Diaz et al. (2017).

UP: Floats = np.array([0.0, 0.0, 1.0])


class Field(Protocol):
    """A static magnetic field."""

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT in nav (East-North-Up) at `position` (N, 3) m in nav."""
        ...


@dataclass(frozen=True)
class Sum(Brief):
    """The field of several sources."""

    parts: Sequence[Field]

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m."""
        total: Floats = np.sum([part.at(position) for part in self.parts], axis=0)
        return total


@dataclass(frozen=True)
class Homogeneous:
    """The same field everywhere.

    Attributes
    ----------
    nav_field_uT : flux density in East-North-Up.
    """

    nav_field_uT: tuple[float, float, float]

    @property
    def vector(self) -> Floats:
        """Flux density (3,) uT in nav."""
        return np.array(self.nav_field_uT, dtype=np.float64)

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m."""
        return np.tile(self.vector, (len(position), 1))


def make_earth_field(strength_uT: float, dip_deg: float, declination_deg: float = 0.0) -> Homogeneous:
    """Field of a strength (uT), a dip below the horizon and a declination clockwise from north."""
    dip, declination = np.deg2rad([dip_deg, declination_deg])
    direction = (np.cos(dip) * np.sin(declination), np.cos(dip) * np.cos(declination), -np.sin(dip))
    east, north, up = (strength_uT * float(part) for part in direction)
    return Homogeneous((east, north, up))


SITES: Mapping[str, Homogeneous] = {
    "north-pole": make_earth_field(65.0, 90.0),
    "equator": make_earth_field(25.0, 0.0),
    "munich": make_earth_field(48.0, 64.0),
}
"""Munoz Diaz et al. (2017), Table 1."""


def find_earth_field(where: str) -> Homogeneous:
    """Field of a site by its name, or of `latitude,longitude,YYYY-MM-DD` by the World Magnetic Model.

    Raises `SimulationError` for what is neither, a place or date without a field, or without the extra `wmm`.
    """
    if where in SITES:
        return SITES[where]
    if "," not in where:
        raise SimulationError(f"there is no site {where!r}: choose one of {', '.join(SITES)}, or give {PLACE_FORM}.")
    try:
        return Homogeneous(compute_field(Place.parse(where)).nav_field_uT)
    except EarthError as error:
        raise SimulationError(f"{str(error).removesuffix('.')}, or choose one of {', '.join(SITES)}.") from None


@dataclass(frozen=True)
class Dipoles(Brief):
    """K dipoles."""

    position: Floats  # (K, 3) m in nav.
    moment: Floats  # (K, 3) A m^2 in nav.

    def __len__(self) -> int:
        return len(self.position)

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m.

        Raises `SimulationError` within a centimeter of a dipole.
        """
        sensed = np.ascontiguousarray(position, dtype=np.float64)
        total, hit = _dipoles_at(sensed, np.ascontiguousarray(self.position.T), np.ascontiguousarray(self.moment.T))
        if hit >= 0:
            raise SimulationError(
                f"the sensor comes within {100 * CLOSEST_M:.0f} cm of a dipole at {np.round(sensed[hit], 2)} m: "
                "move the dipole or the path."
            )
        return total


def magnet(position: Floats, moment: Floats) -> Dipoles:
    """One permanent magnet: `position` (3,) m, `moment` (3,) A m^2.

    A neodymium block holds about 1 A m^2 per cubic centimetre; a loudspeaker in a floor box 1 to 5 A m^2.
    """
    return Dipoles(np.asarray(position, dtype=np.float64)[None], np.asarray(moment, dtype=np.float64)[None])


def compute_spheroid_moment(
    nav_field: Floats, axis: Floats, half_length_m: float, radius_m: float, mu_r: float = IRON_MU_R
) -> Floats:
    """Moment (3,) A m^2 of a soft-iron spheroid in a homogeneous field (3,) uT, its `axis` (3,) of length 1.

    `half_length_m` is the semi-axis along `axis`, larger than the radius for a pillar, smaller for a plate.
    """
    along = compute_demagnetizing_factor(half_length_m / radius_m)
    volume = 4 / 3 * np.pi * radius_m**2 * half_length_m
    lengthwise = float(nav_field @ axis) * axis
    across = nav_field - lengthwise
    chi = mu_r - 1
    magnetized = chi / (1 + along * chi) * lengthwise + chi / (1 + (1 - along) / 2 * chi) * across
    return np.asarray(volume / (4 * np.pi * SCALE_UT) * magnetized, dtype=np.float64)


def compute_demagnetizing_factor(aspect: float) -> float:
    """Factor N along the axis of revolution of a spheroid, `aspect` = that semi-axis over the others (Osborn 1945)."""
    if abs(aspect - 1) < 1e-4:
        return 1 / 3 - 4 / 15 * (aspect - 1)
    if aspect > 1:
        e = np.sqrt(1 - aspect**-2)
        return float((np.arctanh(e) / e - 1) * (1 - e**2) / e**2)
    e = np.sqrt(1 - aspect**2)
    return float((1 - np.sqrt(1 - e**2) * np.arcsin(e) / e) / e**2)


def rod(start: Floats, end: Floats, moment: Floats, count: int = 8) -> Dipoles:
    """Return a long body from `start` (3,) m to `end` (3,) m as a row of dipoles; `moment` (3,) A m^2 in all."""
    share = (np.arange(count) + 0.5) / count
    position = start + share[:, None] * (np.asarray(end) - start)
    return Dipoles(position, np.tile(np.asarray(moment, dtype=np.float64) / count, (count, 1)))


@njit(cache=True, error_model="numpy")
def _dipoles_at(position: Floats, source: Floats, moment: Floats) -> tuple[Floats, int]:
    """Field (N, 3) uT of sources (3, K), and the last position that lies on one of them (-1 if none does)."""
    source_x, source_y, source_z = source
    moment_x, moment_y, moment_z = moment
    total = np.empty((len(position), 3))
    hit = -1
    for i in range(len(position)):
        px, py, pz = position[i]
        bx = by = bz = 0.0
        nearest = np.inf
        for k in range(len(source_x)):
            x, y, z = px - source_x[k], py - source_y[k], pz - source_z[k]
            square = x * x + y * y + z * z
            nearest = min(nearest, square)
            inverse = 1.0 / square
            cube = SCALE_UT * inverse * np.sqrt(inverse)
            along = 3.0 * inverse * (moment_x[k] * x + moment_y[k] * y + moment_z[k] * z)
            bx += cube * (along * x - moment_x[k])
            by += cube * (along * y - moment_y[k])
            bz += cube * (along * z - moment_z[k])
        total[i, 0], total[i, 1], total[i, 2] = bx, by, bz
        if nearest < CLOSEST_M * CLOSEST_M:
            hit = i
    return total, hit


@dataclass(frozen=True)
class Circuit:
    """A closed polygon of conductors."""

    corners: Floats  # (K, 3) m in nav; the last is joined to the first.
    current_A: float  # Positive from corner to corner in their order.

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m.

        Raises `SimulationError` on the conductor.
        """
        field = self.current_A * _per_ampere(
            np.ascontiguousarray(position, dtype=np.float64), np.ascontiguousarray(self.corners)
        )
        if not np.isfinite(field).all():
            raise SimulationError("the sensor lies on a conductor: move the circuit or the path.")
        return field

    def pieces(self, length_m: float) -> Floats:
        """Points (N, 3) m on the conductor, `length_m` apart or less."""
        ends = np.roll(self.corners, -1, axis=0)
        count = 1 + int(np.linalg.norm(ends - self.corners, axis=1).max() / length_m)
        share = np.arange(count)[:, None, None] / count
        points: Floats = (self.corners + share * (ends - self.corners)).reshape(-1, 3)
        return points


@njit(cache=True, error_model="numpy")
def _per_ampere(position: Floats, corners: Floats) -> Floats:
    total = np.zeros((len(position), 3))
    count = len(corners)
    for i in range(len(position)):
        ax, ay, az = position[i] - corners[count - 1]
        a = np.sqrt(ax * ax + ay * ay + az * az)
        for k in range(count):
            bx, by, bz = position[i, 0] - corners[k, 0], position[i, 1] - corners[k, 1], position[i, 2] - corners[k, 2]
            b = np.sqrt(bx * bx + by * by + bz * bz)
            shape = SCALE_UT * (a + b) / (a * b * (a * b + ax * bx + ay * by + az * bz))
            total[i, 0] += shape * (ay * bz - az * by)
            total[i, 1] += shape * (az * bx - ax * bz)
            total[i, 2] += shape * (ax * by - ay * bx)
            ax, ay, az, a = bx, by, bz, b
    return total


PHYSICAL, AS_PRINTED = 2.0, 1.0  # Exponents n: that of the physics, and that of MD (21) as printed.
STREETLIGHT_M, CAR_M = 0.30, 2.0  # Radii of the template's cylinders (paper, Section 2.2).
TEMPLATE_LENGTH_M = 120.0  # After this the template repeats; our choice, a block of houses.

TEMPLATE = (*((along, 1.0, STREETLIGHT_M) for along in (15.0, 45.0, 75.0, 105.0)), (60.0, 4.0, CAR_M))
"""Along the street (m), to the left of it (m), radius (m); our choice, see above."""

PAST_CARS = (*((along, 5.0, STREETLIGHT_M) for along in (27.0, 57.0, 87.0, 117.0)), (110.0, 8.0, CAR_M))
"""The same for one who walks on the far side; our choice, see above."""


@dataclass(frozen=True)
class Cylinders:
    """K upright cylinders, each alone in its cell."""

    axis: Floats  # (K, 2) m, east and north of each axis.
    radius: Floats  # (K,) m.
    far: Homogeneous  # The field far from iron.
    mu_r: float = IRON_MU_R  # Relative permeability.
    exponent: float = PHYSICAL  # n; `PHYSICAL` or `AS_PRINTED`.

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m.

        Raises `SimulationError` inside a cylinder.
        """
        nearest, gap = self._nearest(position)
        if len(gap) and gap.min() < 0:
            i = int(np.argmin(gap))
            raise SimulationError(
                f"{np.round(position[i, :2], 2)} m lies inside the cylinder of radius {self.radius[nearest[i]]} m at "
                f"{np.round(self.axis[nearest[i]], 2)} m: lead the path around it."
            )
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


def street(
    far: Homogeneous,
    length_m: float,
    *,
    start: tuple[float, float] = (0.0, 0.0),
    heading_deg: float = 90.0,
    exponent: float = PHYSICAL,
    template: Sequence[tuple[float, float, float]] = TEMPLATE,
) -> Cylinders:
    """Street with a template (along, to the left, radius; m) of cylinders, repeated along it.

    It begins at `start` (east and north, m) and goes in a direction of which 90 degrees is east, as in the paper; one
    more block is put before it and behind it.
    """
    heading = np.deg2rad(heading_deg)
    forward = np.array([np.sin(heading), np.cos(heading)])
    left = np.array([-forward[1], forward[0]])
    blocks = TEMPLATE_LENGTH_M * np.arange(-1, np.ceil(length_m / TEMPLATE_LENGTH_M) + 1)
    along, aside, radius = np.array(template).T
    along = np.add.outer(blocks, along).ravel()
    axis = start + along[:, None] * forward + np.tile(aside, len(blocks))[:, None] * left
    return Cylinders(axis, np.tile(radius, len(blocks)), far, exponent=exponent)
