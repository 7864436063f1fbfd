"""Three named environments, from kind to honest; every magnetic result is given for each.

============= =====================================================================================================
homogeneous   the Earth's field alone
smooth        large iron some metres away: the field changes by 1 to 2 uT from one footfall to the next, and a
              stretch of several strides is nearly homogeneous. Kinder than any building: flatters all methods that
              wait for a quiet field
indoor        a reinforced floor, with pillars, lockers, door frames, steel in the floor, stray currents and a few
              large objects: rough at the foot, milder at the pocket. Fitted to the statistics of ten real indoor
              walks (`scripts/realism_field.py`)
============= =====================================================================================================

Where the way climbs, the floor's potential gives way to pieces of steel under the treads.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.fields.earth import Homogeneous
from fg_nav.lab.simulation.fields.field import Field, Sum
from fg_nav.lab.simulation.fields.floor import FloorParameters, draw_floor
from fg_nav.lab.simulation.fields.objects import Cables, Kind, place_cables, place_objects
from fg_nav.lab.simulation.fields.treads import TreadParameters, draw_treads
from fg_nav.lab.simulation.fields.ways import closely_spaced

LEVELS = ("homogeneous", "smooth", "indoor")

SMOOTH_KINDS = (Kind("large iron", 80.0, (2.0, 4.0), (-1.0, 1.0), (1.0, 2.0), (60.0, 150.0), memory=12.0, room_m=2.0),)

INDOOR_KINDS = (
    Kind("pillar", 8.0, (0.6, 2.0), (-0.2, 0.0), (2.7, 2.9), (6.0, 40.0), memory=3.0),
    Kind("locker or radiator", 12.0, (0.6, 1.5), (0.0, 0.3), (0.6, 2.0), (3.0, 15.0), memory=5.0),
    Kind("door post", 12.0, (0.5, 1.0), (0.0, 0.0), (2.0, 2.1), (0.5, 2.0), memory=5.0),
    Kind("beam under the floor", 20.0, (0.0, 1.5), (-0.9, -0.35), (0.8, 4.0), (5.0, 40.0), memory=10.0, lies=True),
    Kind("large object", 4.0, (1.5, 4.0), (0.0, 0.5), (1.0, 2.5), (30.0, 150.0), memory=3.0, room_m=1.2),
)


@dataclass(frozen=True)
class Clutter:
    """What stands and lies in a building; the defaults are the level `indoor`.

    Attributes
    ----------
    floor : roughness of level floors.
    treads : roughness where the way climbs.
    kinds : objects.
    cables : stray currents, or None.
    """

    floor: FloorParameters = field(default_factory=FloorParameters)
    treads: TreadParameters = field(default_factory=TreadParameters)
    kinds: tuple[Kind, ...] = INDOOR_KINDS
    cables: Cables | None = field(default_factory=Cables)


def environment(
    level: str, earth: Homogeneous, ways: Floats, rng: np.random.Generator, clutter: Clutter = Clutter()
) -> Field:
    """Draw an environment about the ways of a walk.

    Parameters
    ----------
    level : one of `LEVELS`.
    earth : field without the building.
    ways : (M, 3) m in nav, points on the floor along which the feet go, joined by straight lines. Objects stand
        beside them, half a metre or more from wherever the sensor may be.
    rng : source of all that is random.
    clutter : of the level `indoor`.

    Raises
    ------
    SimulationError
        For any other level, or ways that are no path.
    """
    if level not in LEVELS:
        raise SimulationError(f"there is no field level {level!r}: choose one of {', '.join(LEVELS)}.")
    if level == "homogeneous":
        return earth
    path = closely_spaced(ways)
    if level == "smooth":
        return Sum((earth, place_objects(SMOOTH_KINDS, path, earth.vector, rng)))
    ground: Field = (
        draw_floor(rng, clutter.floor, path.floor_m) if path.is_level else draw_treads(path, rng, clutter.treads)
    )
    objects = place_objects(clutter.kinds, path, earth.vector, rng)
    circuits = place_cables(clutter.cables, path, rng) if clutter.cables else []
    return Sum((earth, ground, objects, *circuits))
