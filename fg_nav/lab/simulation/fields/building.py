"""Steel about a path (pillars, lockers, door frames, beams, boxes), stray currents, and named environments.

An object is a long body of steel of a volume V and a length, standing or lying. It is magnetized twice,

    m = m_induced(B_earth) + q m_induced(|B_earth| u),

both times as a soft-iron spheroid of that volume and length would be (`sources`): by the field of today, and by what
remains from the mill and the building site, u a direction of its own and q Koenigsberger's ratio (fitted, not
measured). It is spread over its length as a row of dipoles. Objects stand about the path by a Poisson process, so many
a meter of it; one that would come nearer than `room_m` to where a sensor may be gets another place.

============= =====================================================================================================
homogeneous   the Earth's field alone
smooth        large iron some meters off: the field changes by 1 to 2 uT from one footfall to the next, and a stretch
              of several strides is nearly homogeneous. Kinder than any building: flatters all methods that wait for a
              quiet field
indoor        a reinforced floor, with pillars, lockers, door frames, steel in the floor, stray currents and a few
              large objects: rough at the foot, milder at the pocket; and a regional field, alike for tens of meters.
              How strong all of it is differs from building to building. Fitted to walks of gdin, openshoe, mtig710
              and mems_foot together (docs/simulation.md)
indoor-old    the same objects and floor as they were fitted to the ten gdin walks alone: no regional field, all
              buildings alike. For results that were measured on it
============= =====================================================================================================

The disturbance of a building is B_b = f (B_floor + B_objects + B_currents + B_region), ln f ~ N(0, s^2). Currents and
magnetization scale alike, so it stays free of divergence and curl.

Where the path climbs, pieces of steel under the treads replace the floor's potential; the regional field stays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.fields.field import Field, Homogeneous, Sum
from fg_nav.lab.simulation.fields.floor import (
    SPACING_M,
    SPOTS_M,
    Floor,
    FloorParameters,
    FloorPath,
    draw_floor,
    draw_treads,
    resample_path,
)
from fg_nav.lab.simulation.fields.sources import UP, Circuit, Dipoles, compute_spheroid_moment, make_upright_loop, rod

TRIES = 30  # So often another place is tried; a path that leaves no room has fewer objects.

PIECE_M = 0.4
"""Length of steel for which one dipole stands; half a meter from its end such a row is a rod to a few per cent."""

Range = tuple[float, float]
"""Least and most, evenly filled."""


@dataclass(frozen=True)
class Kind:
    """Objects of a kind.

    Attributes
    ----------
    per_100_m : how many along 100 m of path, in the mean.
    aside_m : horizontal distance from some point of the path.
    bottom_m : height of its lower end over the floor there.
    length_m : of the object.
    steel_litre : volume of its steel (7.9 kg a litre), evenly filled in the logarithm.
    memory : q.
    lies : in any horizontal direction; else it stands.
    room_m : to where a sensor may be, at least.
    """

    name: str
    per_100_m: float
    aside_m: Range
    bottom_m: Range
    length_m: Range
    steel_litre: Range
    memory: float
    lies: bool = False
    room_m: float = 0.5


@dataclass(frozen=True)
class Cables:
    """Circuits of stray current.

    Attributes
    ----------
    per_100_m : how many along 100 m of path, in the mean.
    length_m : of the stretch.
    aside_m : distance from some point of the path.
    storey_m : the current comes back this much higher.
    current_A : standard deviation of a normal distribution.
    room_m : to where a sensor may be, at least.
    """

    per_100_m: float = 3.0
    length_m: Range = (4.0, 15.0)
    aside_m: Range = (0.5, 2.0)
    storey_m: float = 2.8
    current_A: float = 3.0
    room_m: float = 0.5


def place_objects(kinds: Sequence[Kind], path: FloorPath, nav_field: Floats, rng: np.random.Generator) -> Dipoles:
    """Furnish the path with objects that the Earth's field (3,) uT magnetizes."""
    meters = SPOTS_M * len(path.spots)
    wanted = [kind for kind in kinds for _ in range(rng.poisson(kind.per_100_m * meters / 100))]
    tried = [_place_one(kind, path, nav_field, rng) for kind in wanted]
    placed = [dipoles for dipoles in tried if dipoles is not None]
    position = np.vstack([np.zeros((0, 3)), *(dipoles.position for dipoles in placed)])
    return Dipoles(position, np.vstack([np.zeros((0, 3)), *(dipoles.moment for dipoles in placed)]))


def place_cables(cables: Cables, path: FloorPath, rng: np.random.Generator) -> list[Circuit]:
    """Lay circuits along the path."""
    count = rng.poisson(cables.per_100_m * SPOTS_M * len(path.spots) / 100)
    tried = (_lay_one(cables, path, rng) for _ in range(count))
    return [circuit for circuit in tried if circuit is not None]


def _place_one(kind: Kind, path: FloorPath, nav_field: Floats, rng: np.random.Generator) -> Dipoles | None:
    length = rng.uniform(*kind.length_m)
    axis = _horizontal(rng) if kind.lies else UP
    moment = _moment(kind, length, axis, nav_field, rng)
    for _ in range(TRIES):
        end = _place_aside(path.spots, kind.aside_m, rng) + rng.uniform(*kind.bottom_m) * UP
        start = end - length / 2 * axis if kind.lies else end
        dipoles = rod(start, start + length * axis, moment, count=max(1, round(length / PIECE_M)))
        if path.room(dipoles.position).min() >= kind.room_m:
            return dipoles
    return None


def _moment(kind: Kind, length_m: float, axis: Floats, nav_field: Floats, rng: np.random.Generator) -> Floats:
    volume_m3 = 1e-3 * np.exp(rng.uniform(*np.log(kind.steel_litre)))
    radius_m = float(np.sqrt(1.5 * volume_m3 / (np.pi * length_m)))
    remembered = rng.standard_normal(3)
    remembered *= kind.memory * np.linalg.norm(nav_field) / np.linalg.norm(remembered)
    return compute_spheroid_moment(nav_field + remembered, axis, length_m / 2, radius_m)


def _lay_one(cables: Cables, path: FloorPath, rng: np.random.Generator) -> Circuit | None:
    length = rng.uniform(*cables.length_m)
    current = cables.current_A * rng.standard_normal()
    for _ in range(TRIES):
        k = int(rng.integers(len(path.spots)))
        start = _place_aside(path.spots[[k]], cables.aside_m, rng)
        end = start + length * path.spot_directions[k] * [1.0, 1.0, 0.0]
        circuit = make_upright_loop(start, end, cables.storey_m, current)
        if path.room(circuit.pieces(SPACING_M)).min() >= cables.room_m:
            return circuit
    return None


def _place_aside(spots: Floats, aside_m: Range, rng: np.random.Generator) -> Floats:
    """Return a place (3,) m at some distance and in some direction from some spot."""
    spot: Floats = spots[rng.integers(len(spots))]
    return spot + rng.uniform(*aside_m) * _horizontal(rng)


def _horizontal(rng: np.random.Generator) -> Floats:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.sin(angle), np.cos(angle), 0.0])


SMOOTH_KINDS = (Kind("large iron", 80.0, (2.0, 4.0), (-1.0, 1.0), (1.0, 2.0), (60.0, 150.0), memory=12.0, room_m=2.0),)

INDOOR_KINDS = (
    Kind("pillar", 8.0, (0.6, 2.0), (-0.2, 0.0), (2.7, 2.9), (6.0, 40.0), memory=3.0),
    Kind("locker or radiator", 12.0, (0.6, 1.5), (0.0, 0.3), (0.6, 2.0), (3.0, 15.0), memory=5.0),
    Kind("door post", 12.0, (0.5, 1.0), (0.0, 0.0), (2.0, 2.1), (0.5, 2.0), memory=5.0),
    Kind("beam under the floor", 20.0, (0.0, 1.5), (-0.9, -0.35), (0.8, 4.0), (5.0, 40.0), memory=10.0, lies=True),
    Kind("large object", 4.0, (1.5, 4.0), (0.0, 0.5), (1.0, 2.5), (30.0, 150.0), memory=3.0, room_m=1.2),
)


FLOOR = FloorParameters(strength_uT=5.8, shortest_m=0.7, longest_m=20.0)
"""Together with the objects 8 uT per axis over ground, 10 upwards."""

REGION = FloorParameters(strength_uT=2.0, shortest_m=30.0, longest_m=90.0, modes=24)
"""Of girders, decks and whole wings: legs of 50 to 85 m differ in their mean by 4 to 5 uT where the footfalls have 12
(mems_foot). Waves of 60 to 150 m explain that as well, but their potential is twice that of the walks."""


@dataclass(frozen=True)
class Clutter:
    """What stands and lies in a building; the defaults are the level `indoor`.

    Attributes
    ----------
    floor : roughness of level floors.
    kinds : objects.
    cables : stray currents, or None.
    region : field that is alike for tens of meters, or None.
    strength_spread : s, of the logarithm of a building's strength.
    """

    floor: FloorParameters = FLOOR
    kinds: tuple[Kind, ...] = INDOOR_KINDS
    cables: Cables | None = field(default_factory=Cables)
    region: FloorParameters | None = REGION
    strength_spread: float = 0.25


Part: TypeAlias = Floor | Dipoles | Circuit
"""Of what a building adds."""

CLUTTERS: Mapping[str, Clutter] = {
    "indoor": Clutter(),
    "indoor-old": Clutter(floor=FloorParameters(), region=None, strength_spread=0.0),
}
"""Of the levels that are buildings."""

LEVELS = ("homogeneous", "smooth", *CLUTTERS)


def draw_environment(
    level: str, earth: Homogeneous, points: Floats, rng: np.random.Generator, clutter: Clutter | None = None
) -> Field:
    """Draw an environment about the path of a walk.

    Parameters
    ----------
    level : one of `LEVELS`.
    earth : field without the building.
    points : (M, 3) m in nav, points on the floor along which the feet go, joined by straight lines. Objects stand
        next to it, half a meter or more from wherever the sensor may be.
    rng : source of all that is random.
    clutter : of a building; None for that of its level.

    Raises `SimulationError` for any other level, or points that are no path.
    """
    if level not in LEVELS:
        raise SimulationError(f"there is no field level {level!r}: choose one of {', '.join(LEVELS)}.")
    if level == "homogeneous":
        return earth
    path = resample_path(points)
    if level == "smooth":
        return Sum((earth, place_objects(SMOOTH_KINDS, path, earth.vector, rng)))
    return Sum((earth, *_draw_building(clutter or CLUTTERS[level], path, earth.vector, rng)))


def _draw_building(clutter: Clutter, path: FloorPath, nav_field: Floats, rng: np.random.Generator) -> list[Part]:
    """Draw what a building adds to the Earth's field."""
    ground: Part = draw_floor(rng, clutter.floor, path.floor_m) if path.is_level else draw_treads(path, rng)
    objects = place_objects(clutter.kinds, path, nav_field, rng)
    circuits = place_cables(clutter.cables, path, rng) if clutter.cables else []
    parts: list[Part] = [ground, objects, *circuits]
    # last, so that a seed has the same objects in every building
    if clutter.region is not None:
        parts.append(draw_floor(rng, clutter.region, float(path.points[:, 2].min())))
    if not clutter.strength_spread:
        return parts
    factor = float(np.exp(clutter.strength_spread * rng.standard_normal()))
    return [_scale(part, factor) for part in parts]


def _scale(part: Part, factor: float) -> Part:
    if isinstance(part, Floor):
        return replace(part, amplitude=factor * part.amplitude)
    if isinstance(part, Dipoles):
        return replace(part, moment=factor * part.moment)
    return replace(part, current_A=factor * part.current_A)
