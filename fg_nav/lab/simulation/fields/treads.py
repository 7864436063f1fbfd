"""The clutter of stairs: small magnets in random directions, buried under the way wherever it leads.

Over one floor the clutter is a potential (`floor`), but on stairs the floor climbs with the walker. Here the same
steel is cut into pieces: dipoles of equal size in random directions, spread in a strip about the way and `depth_m`
below it, so that each tread has its own steel under it. Outside of the pieces the field has neither divergence nor
curl. A layer at a distance H varies over about H, as waves of 2 pi H / 1.5 do.

The moments are scaled so that the rms along the way is exactly what is asked; a piece then has 5 to 10 A m^2,
some metres of reinforcing bar.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.fields.dipole import UP, Dipoles
from fg_nav.lab.simulation.fields.ways import SPOTS_M, Ways


@dataclass(frozen=True)
class TreadParameters:
    """How rough stairs are.

    Attributes
    ----------
    strength_uT : rms per axis at `reference_m` above the way; that of a floor.
    reference_m : height of a sensor on a standing foot.
    depth_m : of the pieces under the way.
    half_width_m : of the strip.
    per_m : pieces a metre of way; so many that several act at once.
    room_m : to where a sensor may be, at least (winding stairs hang over the way below).
    """

    strength_uT: float = 5.5
    reference_m: float = 0.1
    depth_m: tuple[float, float] = (0.35, 0.9)
    half_width_m: float = 1.6
    per_m: float = 12.0
    room_m: float = 0.35


def draw_treads(ways: Ways, rng: np.random.Generator, parameters: TreadParameters = TreadParameters()) -> Dipoles:
    """Bury the pieces under the ways."""
    p = parameters
    count = max(1, round(p.per_m * SPOTS_M))
    position = _under(np.repeat(ways.spots, count, axis=0), np.repeat(ways.spot_directions, count, axis=0), p, rng)
    position = position[ways.room(position) >= p.room_m]
    moment = rng.standard_normal(position.shape)
    unit = Dipoles(position, moment / np.linalg.norm(moment, axis=1, keepdims=True))
    felt = unit.at(ways.points + np.array([0.0, 0.0, p.reference_m]))
    size = p.strength_uT / np.sqrt(np.mean(felt**2))
    return Dipoles(unit.position, size * unit.moment)


def _under(spot: Floats, direction: Floats, p: TreadParameters, rng: np.random.Generator) -> Floats:
    """Places (K, 3) m under the way: along it as it climbs, and level to its sides."""
    along = SPOTS_M * rng.uniform(-0.5, 0.5, (len(spot), 1))
    aside = p.half_width_m * rng.uniform(-1, 1, (len(spot), 1))
    depth = rng.uniform(*p.depth_m, (len(spot), 1))
    return spot + along * direction + aside * np.cross(direction, UP) - depth * UP
