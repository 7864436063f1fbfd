"""Steel about a way: pillars, lockers, door frames, beams and boxes in the floor, and circuits of stray current.

An object is a long body of steel of a volume V and a length, standing or lying. It is magnetised twice,

    m = m_induced(B_earth) + q m_induced(|B_earth| u),

both times as a soft-iron spheroid of that volume and length would be (`dipole`): by the field of today, and by
what it remembers of the mill and the building site, u a direction of its own and q the strength of memory
(Koenigsberger's ratio; fitted, not measured). It is spread over its length as a row of dipoles.

Objects stand about the way in Poisson's manner, so many a metre of it; one that would come nearer than `room_m` to
where a sensor may be is put elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.fields.circuit import Circuit, upright_loop
from fg_nav.lab.simulation.fields.dipole import UP, Dipoles, rod, spheroid_moment
from fg_nav.lab.simulation.fields.ways import SPACING_M, SPOTS_M, Ways

TRIES = 30
"""So often another place is looked for; a way that leaves no room has fewer objects."""

PIECE_M = 0.4
"""Length of steel for which one dipole stands; half a metre from its end such a row is a rod to a few per cent."""

Range = tuple[float, float]
"""Least and most, evenly filled."""


@dataclass(frozen=True)
class Kind:
    """Objects of a kind.

    Attributes
    ----------
    per_100_m : how many along 100 m of way, in the mean.
    aside_m : horizontal distance from some point of the way.
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
    per_100_m : how many along 100 m of way, in the mean.
    length_m : of the stretch.
    aside_m : distance from some point of the way.
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


def place_objects(kinds: Sequence[Kind], ways: Ways, nav_field: Floats, rng: np.random.Generator) -> Dipoles:
    """Furnish the ways with objects that the Earth's field (3,) uT magnetises."""
    metres = SPOTS_M * len(ways.spots)
    wanted = [kind for kind in kinds for _ in range(rng.poisson(kind.per_100_m * metres / 100))]
    tried = [_place_one(kind, ways, nav_field, rng) for kind in wanted]
    placed = [dipoles for dipoles in tried if dipoles is not None]
    position = np.vstack([np.zeros((0, 3)), *(dipoles.position for dipoles in placed)])
    return Dipoles(position, np.vstack([np.zeros((0, 3)), *(dipoles.moment for dipoles in placed)]))


def place_cables(cables: Cables, ways: Ways, rng: np.random.Generator) -> list[Circuit]:
    """Lay circuits along the ways."""
    count = rng.poisson(cables.per_100_m * SPOTS_M * len(ways.spots) / 100)
    tried = (_lay_one(cables, ways, rng) for _ in range(count))
    return [circuit for circuit in tried if circuit is not None]


def _place_one(kind: Kind, ways: Ways, nav_field: Floats, rng: np.random.Generator) -> Dipoles | None:
    length = rng.uniform(*kind.length_m)
    axis = _horizontal(rng) if kind.lies else UP
    moment = _moment(kind, length, axis, nav_field, rng)
    for _ in range(TRIES):
        end = _beside(ways.spots, kind.aside_m, rng) + rng.uniform(*kind.bottom_m) * UP
        start = end - length / 2 * axis if kind.lies else end
        dipoles = rod(start, start + length * axis, moment, count=max(1, round(length / PIECE_M)))
        if ways.room(dipoles.position).min() >= kind.room_m:
            return dipoles
    return None


def _moment(kind: Kind, length_m: float, axis: Floats, nav_field: Floats, rng: np.random.Generator) -> Floats:
    volume_m3 = 1e-3 * np.exp(rng.uniform(*np.log(kind.steel_litre)))
    radius_m = float(np.sqrt(1.5 * volume_m3 / (np.pi * length_m)))
    remembered = rng.standard_normal(3)
    remembered *= kind.memory * np.linalg.norm(nav_field) / np.linalg.norm(remembered)
    return spheroid_moment(nav_field + remembered, axis, length_m / 2, radius_m)


def _lay_one(cables: Cables, ways: Ways, rng: np.random.Generator) -> Circuit | None:
    length = rng.uniform(*cables.length_m)
    current = cables.current_A * rng.standard_normal()
    for _ in range(TRIES):
        k = int(rng.integers(len(ways.spots)))
        start = _beside(ways.spots[[k]], cables.aside_m, rng)
        end = start + length * ways.spot_directions[k] * [1.0, 1.0, 0.0]
        circuit = upright_loop(start, end, cables.storey_m, current)
        if ways.room(circuit.pieces(SPACING_M)).min() >= cables.room_m:
            return circuit
    return None


def _beside(spots: Floats, aside_m: Range, rng: np.random.Generator) -> Floats:
    """Return a place (3,) m at some distance and in some direction from some spot."""
    spot: Floats = spots[rng.integers(len(spots))]
    return spot + rng.uniform(*aside_m) * _horizontal(rng)


def _horizontal(rng: np.random.Generator) -> Floats:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.sin(angle), np.cos(angle), 0.0])
