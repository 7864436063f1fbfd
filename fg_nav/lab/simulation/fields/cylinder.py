"""An upright iron cylinder without end in a homogeneous field, and a street of them (Munoz Diaz et al. 2017).

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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.fields.field import Homogeneous
from fg_nav.lab.simulation.fields.sources import IRON_MU_R

PHYSICAL, AS_PRINTED = 2.0, 1.0
"""Exponents n: that of the physics, and that of MD (21) as printed."""

STREETLIGHT_M, CAR_M = 0.30, 2.0
"""Radii of the template's cylinders (paper, Section 2.2)."""

TEMPLATE_LENGTH_M = 120.0
"""After this the template repeats; our choice, a block of houses."""

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
