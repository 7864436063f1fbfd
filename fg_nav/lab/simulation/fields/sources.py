"""Sources in closed form: point dipoles (magnets, steel from afar) and circuits of direct current.

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
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.system.compiled import njit

SCALE_UT = 0.1  # mu_0 / (4 pi) in uT m / A.
CLOSEST_M = 0.01  # Nearer to a point dipole than this nothing can be.
IRON_MU_R = 200.0  # Relative permeability of structural steel in weak fields; that of Munoz Diaz et al. (2017).


UP: Floats = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Dipoles:
    """K dipoles.

    Attributes
    ----------
    position : (K, 3) m in nav.
    moment : (K, 3) A m^2 in nav.
    """

    position: Floats
    moment: Floats

    def __post_init__(self) -> None:
        for name in ("position", "moment"):
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if value.ndim != 2 or value.shape[1] != 3 or not np.isfinite(value).all():
                raise SimulationError(f"{name} of shape {value.shape} is not finite rows of three: give one a dipole.")
            object.__setattr__(self, name, value)
        if len(self.position) != len(self.moment):
            raise SimulationError(
                f"{len(self.position)} positions but {len(self.moment)} moments: give each dipole one of both."
            )

    def __len__(self) -> int:
        return len(self.position)

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m.

        Raises `SimulationError` within a centimeter of a dipole.
        """
        sensed = np.ascontiguousarray(position, dtype=np.float64)
        total, hit = _dipoles_at(sensed, _by_axis(self.position), _by_axis(self.moment))
        if hit >= 0:
            raise SimulationError(
                f"the sensor comes within {100 * CLOSEST_M:.0f} cm of a dipole at {_place(sensed[hit])}: "
                f"move the dipole or the path."
            )
        return total


def magnet(position: Floats, moment: Floats) -> Dipoles:
    """One permanent magnet: `position` (3,) m, `moment` (3,) A m^2.

    A neodymium block holds about 1 A m^2 per cubic centimetre; a loudspeaker in a floor box 1 to 5 A m^2.
    """
    return Dipoles(np.asarray(position, dtype=np.float64)[None], np.asarray(moment, dtype=np.float64)[None])


def compute_sphere_moment(nav_field: Floats, radius_m: float, mu_r: float = IRON_MU_R) -> Floats:
    """Moment (3,) A m^2 that a soft-iron sphere takes on in a homogeneous field (3,) uT."""
    return compute_spheroid_moment(nav_field, UP, radius_m, radius_m, mu_r)


def compute_spheroid_moment(
    nav_field: Floats, axis: Floats, half_length_m: float, radius_m: float, mu_r: float = IRON_MU_R
) -> Floats:
    """Moment (3,) A m^2 of a soft-iron spheroid in a homogeneous field.

    Parameters
    ----------
    nav_field : (3,) uT in nav.
    axis : (3,) direction of its axis of revolution, of length 1.
    half_length_m : semi-axis along `axis`; larger than the radius for a pillar, smaller for a plate.
    radius_m : the two others.
    mu_r : relative permeability.

    Raises `SimulationError` where there is no such body.
    """
    if not (radius_m > 0 and half_length_m > 0 and mu_r >= 1):
        raise SimulationError(
            f"a spheroid of {half_length_m} m by {radius_m} m and permeability {mu_r} cannot be: "
            f"give lengths above 0 and a permeability of 1 or more."
        )
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


def _by_axis(rows: Floats) -> Floats:
    return np.ascontiguousarray(rows.T)


def _place(position: Floats) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in position) + ") m"


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
    """A closed polygon of conductors.

    Attributes
    ----------
    corners : (K, 3) m in nav; the last is joined to the first.
    current_A : positive from corner to corner in their order.
    """

    corners: Floats
    current_A: float

    def __post_init__(self) -> None:
        corners = np.ascontiguousarray(self.corners, dtype=np.float64)
        if corners.ndim != 2 or corners.shape[1:] != (3,) or len(corners) < 3 or not np.isfinite(corners).all():
            raise SimulationError(f"corners of shape {corners.shape} close no circuit: give three or more finite ones.")
        object.__setattr__(self, "corners", corners)

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m.

        Raises `SimulationError` on the conductor.
        """
        field = self.current_A * _per_ampere(np.ascontiguousarray(position, dtype=np.float64), self.corners)
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


def make_upright_loop(start: Floats, end: Floats, height_m: float, current_A: float) -> Circuit:
    """Circuit that runs from `start` (3,) m to `end` (3,) m and comes back `height_m` above."""
    up = np.array([0.0, 0.0, height_m])
    return Circuit(np.stack([start, end, end + up, start + up]), current_A)


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
