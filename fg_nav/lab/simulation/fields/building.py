"""Buildings about the path of a walk: floors, stairs, steel objects and stray currents; and named environments.

All is drawn about the path (`FloorPath`). The sensor may be anywhere over that path from the foot to the
pocket, so the room to leave is the distance from that upright strip.

Level floor. With z the height over a sheet of steel, horizontal wave vectors k, amplitudes b (uT at the sheet) and
phases c,

    phi = sgn(z) sum (b / |k|) cos(k . x + c) exp(-|k z|),    B = -grad phi:

    B_horizontal = sgn(z) sum b (k / |k|) sin(k . x + c) exp(-|k z|),    B_up = sum b cos(k . x + c) exp(-|k z|).

Each term solves Laplace's equation on either side, so the map has neither divergence nor curl; B_up goes through the
sheet without a step and the step of B_horizontal is the magnetized steel in it. Short waves die out first: the map is
rough at the foot and mild at the pocket. The sheet lies `SHEET_M` under the floor, where no sensor is.

What makes a reinforced floor so rough is not its mesh of 15 cm, whose field is gone at 10 cm, but that each bar has
its own magnetization; wavelengths and strength are those of real walks (`scripts/realism.py`, docs/simulation.md).

Stairs. The floor climbs with the walker, so the same steel is cut into pieces: dipoles of equal size in random
directions, spread in a strip about and below the path, so that each tread has its own steel under it.
Outside of the pieces the field has neither divergence nor curl. A layer at a distance H varies over about H, as waves
of 2 pi H / 1.5 do. The moments are scaled so that the rms along the path is exactly `TREADS_UT`; a piece then has 5
to 10 A m^2, some meters of reinforcing bar.

Objects. An object is a long body of steel of a volume V and a length, standing or lying. It is magnetized twice,

    m = m_induced(B_earth) + q m_induced(|B_earth| u),

both times as a soft-iron spheroid of that volume and length would be (`field`): by the field of today, and by what
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
between       `BETWEEN` of the disturbance of an indoor building and the rest of that of a smooth one: the papers'
              detectors see both kinds of footfalls on it
============= =====================================================================================================

The disturbance of a building is B_b = f (B_floor + B_objects + B_currents + B_region), ln f ~ N(0, s^2). Currents and
magnetization scale alike, so it stays free of divergence and curl.

Where the path climbs, pieces of steel under the treads replace the floor's potential; the regional field stays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.spatial import KDTree

from fg_nav.arrays import Brief, Floats, Ints, interpolate_columns
from fg_nav.lab.simulation.checks import Checked, NotNegative, Positive
from fg_nav.lab.simulation.fields.field import (
    UP,
    Circuit,
    Dipoles,
    Homogeneous,
    Sum,
    compute_spheroid_moment,
    rod,
)
from fg_nav.lab.simulation.fields.field import Field as Environment
from fg_nav.system.compiled import njit

SPACING_M = 0.2  # Points of a path lie no further apart than this.
SPOTS_M = 1.0  # Things are counted by the meter of path.
SENSOR_HEIGHTS_M = (0.1, 0.4, 0.7, 1.0)  # From a foot's sensor to above a pocket's.
REFERENCE_M, SHEET_M = 0.1, 0.05  # A sensor on a standing foot over the floor; steel under it: 2 to 5 cm of concrete.
LEVEL_M = 0.1  # A path that rises less than this in all lies on one floor.


@dataclass(frozen=True)
class FloorPath:
    """Points on the floor along which a person walks.

    Attributes
    ----------
    points : (M, 3) m in nav, closely spaced.
    """

    points: Floats

    @property
    def is_level(self) -> bool:
        """Whether all of it lies on one floor."""
        return bool(np.ptp(self.points[:, 2]) < LEVEL_M)

    @property
    def floor_m(self) -> float:
        """Height of the floor in nav where the path is level."""
        return float(np.median(self.points[:, 2]))

    @property
    def spots(self) -> Floats:
        """Points (K, 3) m of the path, about `SPOTS_M` apart: what is walked again counts once."""
        spots: Floats = self.points[self._spot]
        return spots

    @property
    def spot_directions(self) -> Floats:
        """Direction (K, 3) of the path at its spots, with its slope; zero where it has none."""
        last = len(self.points) - 1
        chord = self.points[np.minimum(self._spot + 1, last)] - self.points[np.maximum(self._spot - 1, 0)]
        length = np.linalg.norm(chord, axis=1, keepdims=True)
        direction: Floats = np.divide(chord, length, out=np.zeros_like(chord), where=length > 0)
        return direction

    def room(self, position: Floats) -> Floats:
        """Distance (K,) m of `position` (K, 3) m from where the sensor may be."""
        distance, _ = self._tree.query(position)
        return np.asarray(distance, dtype=np.float64)

    @cached_property
    def _spot(self) -> Ints:
        tree = KDTree(self.points)
        free = np.ones(len(self.points), dtype=np.bool_)
        kept = []
        for i, point in enumerate(self.points):
            if free[i]:
                kept.append(i)
                free[tree.query_ball_point(point, SPOTS_M - SPACING_M / 2)] = False
        return np.array(kept)

    @cached_property
    def _tree(self) -> KDTree:
        lifts = np.array([[0.0, 0.0, height] for height in SENSOR_HEIGHTS_M])
        return KDTree((self.points[:, None] + lifts).reshape(-1, 3))


def resample_path(points: Floats) -> FloorPath:
    """The path through corners `points` (M, 3) m, on the floor, joined by straight lines."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    asked = np.linspace(0.0, along[-1], int(along[-1] / SPACING_M) + 2)
    return FloorPath(interpolate_columns(asked, along, points))


@dataclass(frozen=True)
class FloorParameters(Checked):
    """How rough a floor is; the defaults are those of `indoor`.

    Attributes
    ----------
    strength_uT : rms per axis at `REFERENCE_M` above the floor. With what lies in and stands on it, the walks of
        level `indoor` feel about 8 (real ones 6 to 13).
    shortest_m, longest_m : range of the wavelengths, evenly filled in their logarithm, each with the same power at
        the reference height. The real walks ask for short ones (the field changes within a swing) and for long ones
        (neighbouring footfalls have a fifth to a quarter of their deviation in common).
    modes : number of waves; no two have a length in common, so no building is large enough for them to repeat.
    """

    strength_uT: NotNegative = 5.8
    shortest_m: Positive = 0.7
    longest_m: Positive = 20.0
    modes: Annotated[int, Field(ge=1)] = 240


@dataclass(frozen=True)
class Floor(Brief):
    """One draw of a floor's clutter; the Earth's field is not in it."""

    wave: Floats  # (M, 2) rad/m, horizontal wave vectors.
    amplitude: Floats  # (M,) uT at the sheet.
    phase: Floats  # (M,) rad.
    sheet_m: float  # Height of the sheet in nav.

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m."""
        above = np.array(position, dtype=np.float64, order="C")
        above[:, 2] -= self.sheet_m
        return _waves_at(above, self.wave, self.amplitude, self.phase)


def draw_floor(
    rng: np.random.Generator, parameters: FloorParameters = FloorParameters(), height_m: float = 0.0
) -> Floor:
    """Draw the clutter of a floor whose surface is at `height_m` in nav."""
    p = parameters
    even = (rng.permutation(p.modes) + rng.uniform(size=p.modes)) / p.modes
    number = 2 * np.pi / (p.shortest_m * (p.longest_m / p.shortest_m) ** even)
    heading = rng.uniform(0, 2 * np.pi, p.modes)
    return Floor(
        wave=number[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1),
        amplitude=p.strength_uT * np.sqrt(3 / p.modes) * np.exp(number * (REFERENCE_M + SHEET_M)),
        phase=rng.uniform(0, 2 * np.pi, p.modes),
        sheet_m=height_m - SHEET_M,
    )


@njit(cache=True)
def _waves_at(above: Floats, wave: Floats, amplitude: Floats, phase: Floats) -> Floats:
    """Field (N, 3) uT at points (N, 3) m whose third coordinate counts from the sheet."""
    number = np.sqrt(wave[:, 0] ** 2 + wave[:, 1] ** 2)
    east, north = wave[:, 0] / number, wave[:, 1] / number
    field = np.empty((len(above), 3))
    for i in range(len(above)):
        x, y, z = above[i]
        side, far = (1.0, z) if z > 0 else (-1.0, -z)
        e = n = u = 0.0
        for m in range(len(number)):
            angle = wave[m, 0] * x + wave[m, 1] * y + phase[m]
            size = amplitude[m] * np.exp(-number[m] * far)
            across = size * np.sin(angle)
            e += east[m] * across
            n += north[m] * across
            u += size * np.cos(angle)
        field[i, 0], field[i, 1], field[i, 2] = side * e, side * n, u
    return field


TREADS_UT, TREADS_HEIGHT_M = 5.5, 0.1
"""Stairs: rms per axis, that of a floor, at the height over the path of a sensor on a standing foot."""

TREADS_DEPTH_M, TREADS_HALF_WIDTH_M = (0.35, 0.9), 1.6  # Of the pieces under the path, and of their strip.
TREADS_PER_M = 12.0  # Pieces a meter of path: so many that several act at once.
TREADS_ROOM_M = 0.35  # From a piece to where a sensor may be, at least (winding stairs hang over the path below).


def draw_treads(path: FloorPath, rng: np.random.Generator) -> Dipoles:
    """Bury the pieces under the path: along it as it climbs, and level to its sides."""
    count = max(1, round(TREADS_PER_M * SPOTS_M))
    spot, direction = (np.repeat(of, count, axis=0) for of in (path.spots, path.spot_directions))
    along = SPOTS_M * rng.uniform(-0.5, 0.5, (len(spot), 1))
    aside = TREADS_HALF_WIDTH_M * rng.uniform(-1, 1, (len(spot), 1))
    depth = rng.uniform(*TREADS_DEPTH_M, (len(spot), 1))
    position = spot + along * direction + aside * np.cross(direction, UP) - depth * UP
    position = position[path.room(position) >= TREADS_ROOM_M]
    moment = rng.standard_normal(position.shape)
    unit = Dipoles(position, moment / np.linalg.norm(moment, axis=1, keepdims=True))
    felt = unit.at(path.points + np.array([0.0, 0.0, TREADS_HEIGHT_M]))
    size = TREADS_UT / np.sqrt(np.mean(felt**2))
    return Dipoles(unit.position, size * unit.moment)


TRIES = 30  # So often another place is tried; a path that leaves no room has fewer objects.

PIECE_M = 0.4
"""Length of steel for which one dipole stands; half a meter from its end such a row is a rod to a few per cent."""

Range = tuple[float, float]
"""Least and most, evenly filled."""


@dataclass(frozen=True)
class Kind:
    """Objects of a kind."""

    name: str
    per_100_m: float  # How many along 100 m of path, in the mean.
    aside_m: Range  # Horizontal distance from some point of the path.
    bottom_m: Range  # Height of its lower end over the floor there.
    length_m: Range  # Of the object.
    steel_litre: Range  # Volume of its steel (7.9 kg a litre), evenly filled in the logarithm.
    memory: float  # q.
    lies: bool = False  # In any horizontal direction; else it stands.
    room_m: float = 0.5  # To where a sensor may be, at least.


CABLES_PER_100_M = 3.0  # Circuits of stray current, in the mean.
CABLE_LENGTH_M, CABLE_ASIDE_M = (4.0, 15.0), (0.5, 2.0)  # Of the stretch, and its distance from some point of the path.
STOREY_M, CURRENT_A = 2.8, 3.0  # The current comes back this much higher; its standard deviation.
CABLE_ROOM_M = 0.5  # To where a sensor may be, at least.


def place_objects(kinds: Sequence[Kind], path: FloorPath, nav_field: Floats, rng: np.random.Generator) -> Dipoles:
    """Furnish the path with objects that the Earth's field (3,) uT magnetizes."""
    meters = SPOTS_M * len(path.spots)
    wanted = [kind for kind in kinds for _ in range(rng.poisson(kind.per_100_m * meters / 100))]
    tried = [_place_one(kind, path, nav_field, rng) for kind in wanted]
    placed = [dipoles for dipoles in tried if dipoles is not None]
    position = np.vstack([np.zeros((0, 3)), *(dipoles.position for dipoles in placed)])
    return Dipoles(position, np.vstack([np.zeros((0, 3)), *(dipoles.moment for dipoles in placed)]))


def place_cables(path: FloorPath, rng: np.random.Generator, per_100_m: float = CABLES_PER_100_M) -> list[Circuit]:
    """Lay circuits of stray current along the path."""
    count = rng.poisson(per_100_m * SPOTS_M * len(path.spots) / 100)
    tried = (_lay_one(path, rng) for _ in range(count))
    return [circuit for circuit in tried if circuit is not None]


def _place_one(kind: Kind, path: FloorPath, nav_field: Floats, rng: np.random.Generator) -> Dipoles | None:
    length = rng.uniform(*kind.length_m)
    axis = _horizontal(rng) if kind.lies else UP
    # magnetized by the field, and by what it remembers
    volume_m3 = 1e-3 * np.exp(rng.uniform(*np.log(kind.steel_litre)))
    radius_m = float(np.sqrt(1.5 * volume_m3 / (np.pi * length)))
    remembered = rng.standard_normal(3)
    remembered *= kind.memory * np.linalg.norm(nav_field) / np.linalg.norm(remembered)
    moment = compute_spheroid_moment(nav_field + remembered, axis, length / 2, radius_m)
    for _ in range(TRIES):
        end = _place_aside(path.spots, kind.aside_m, rng) + rng.uniform(*kind.bottom_m) * UP
        start = end - length / 2 * axis if kind.lies else end
        dipoles = rod(start, start + length * axis, moment, count=max(1, round(length / PIECE_M)))
        if path.room(dipoles.position).min() >= kind.room_m:
            return dipoles
    return None


def _lay_one(path: FloorPath, rng: np.random.Generator) -> Circuit | None:
    length, current = rng.uniform(*CABLE_LENGTH_M), CURRENT_A * rng.standard_normal()
    for _ in range(TRIES):
        k = int(rng.integers(len(path.spots)))
        start = _place_aside(path.spots[[k]], CABLE_ASIDE_M, rng)
        end = start + length * path.spot_directions[k] * [1.0, 1.0, 0.0]
        circuit = Circuit(np.stack([start, end, end + STOREY_M * UP, start + STOREY_M * UP]), current)
        if path.room(circuit.pieces(SPACING_M)).min() >= CABLE_ROOM_M:
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


FLOOR = FloorParameters()
"""Together with the objects 8 uT per axis over ground, 10 upwards."""

REGION = FloorParameters(strength_uT=2.0, shortest_m=30.0, longest_m=90.0, modes=24)
"""Of girders, decks and whole wings: legs of 50 to 85 m differ in their mean by 4 to 5 uT where the footfalls have 12
(mems_foot). Waves of 60 to 150 m explain that as well, but their potential is twice that of the walks."""

STRENGTH_SPREAD = 0.25  # s, of the logarithm of a building's strength.
BETWEEN = 0.4  # Of 0.28, 0.34 and 0.4 it gives most of Ma's figures together (`scripts/plans/ma_floor.toml`).

INDOOR: Mapping[str, float] = {"smooth": 0.0, "between": BETWEEN, "indoor": 1.0}
"""Share of the disturbance of a reinforced building in each level; the rest is that of large iron far off."""

LEVELS = ("homogeneous", *INDOOR)


def draw_environment(level: str, earth: Homogeneous, points: Floats, rng: np.random.Generator) -> Environment:
    """Draw an environment, one of `LEVELS`, about the path of a walk.

    The path goes by straight lines through `points` (M, 3) m on the floor. Objects stand next to it, half a meter or
    more from wherever the sensor may be.
    """
    if level == "homogeneous":
        return earth
    path, share, parts = resample_path(points), INDOOR[level], list[Floor | Dipoles | Circuit]()
    # large iron some meters off
    if share < 1.0:
        parts.append(_scale(place_objects(SMOOTH_KINDS, path, earth.vector, rng), 1.0 - share))
    # floor, objects and currents; the region last, so that a seed has the same objects in every building
    if share > 0.0:
        ground = draw_floor(rng, FLOOR, path.floor_m) if path.is_level else draw_treads(path, rng)
        rough = [ground, place_objects(INDOOR_KINDS, path, earth.vector, rng), *place_cables(path, rng)]
        rough.append(draw_floor(rng, REGION, float(path.points[:, 2].min())))
        strength = share * float(np.exp(STRENGTH_SPREAD * rng.standard_normal()))
        parts += [_scale(part, strength) for part in rough]
    return Sum((earth, *parts))


def _scale(part: Floor | Dipoles | Circuit, factor: float) -> Floor | Dipoles | Circuit:
    if isinstance(part, Floor):
        return replace(part, amplitude=factor * part.amplitude)
    if isinstance(part, Dipoles):
        return replace(part, moment=factor * part.moment)
    return replace(part, current_A=factor * part.current_A)
