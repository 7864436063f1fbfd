"""Steel in the floor: a random harmonic potential above a level one, buried dipoles along stairs.

Both are drawn about the path of a walk (`FloorPath`). The sensor may be anywhere over that path from the foot to the
pocket, so the room to leave is the distance from that upright strip.

Level floor. With z the height over a sheet of steel, horizontal wave vectors k, amplitudes b (uT at the sheet) and
phases c,

    phi = sgn(z) sum (b / |k|) cos(k . x + c) exp(-|k z|),    B = -grad phi:

    B_horizontal = sgn(z) sum b (k / |k|) sin(k . x + c) exp(-|k z|),    B_up = sum b cos(k . x + c) exp(-|k z|).

Each term solves Laplace's equation on either side, so the map has neither divergence nor curl; B_up goes through the
sheet without a step and the step of B_horizontal is the magnetized steel in it. Short waves die out first: the map is
rough at the foot and mild at the pocket. The sheet lies `depth_m` under the floor, where no sensor is.

What makes a reinforced floor so rough is not its mesh of 15 cm, whose field is gone at 10 cm, but that each bar has
its own magnetization; wavelengths and strength are those of real walks (`scripts/realism.py`, docs/simulation.md).

Stairs. The floor climbs with the walker, so the same steel is cut into pieces: dipoles of equal size in random
directions, spread in a strip about and below the path, so that each tread has its own steel under it.
Outside of the pieces the field has neither divergence nor curl. A layer at a distance H varies over about H, as waves
of 2 pi H / 1.5 do. The moments are scaled so that the rms along the path is exactly `TREADS_UT`; a piece then has 5
to 10 A m^2, some meters of reinforcing bar.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.fields.sources import UP, Dipoles
from fg_nav.system.compiled import njit

SPACING_M = 0.2  # Points of a path lie no further apart than this.
SPOTS_M = 1.0  # Things are counted by the meter of path.
SENSOR_HEIGHTS_M = (0.1, 0.4, 0.7, 1.0)  # From a foot's sensor to above a pocket's.
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
    """The path through corners `points` (M, 3) m, on the floor, joined by straight lines.

    Raises `SimulationError` without a point, or with one that is not finite.
    """
    corners = np.asarray(points, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 3 or not len(corners) or not np.isfinite(corners).all():
        raise SimulationError(f"points of shape {corners.shape} are no path: give finite points (M, 3) in meters.")
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    asked = np.linspace(0.0, along[-1], int(along[-1] / SPACING_M) + 2)
    return FloorPath(np.stack([np.interp(asked, along, corners[:, i]) for i in range(3)], axis=1))


@dataclass(frozen=True)
class FloorParameters:
    """How rough a floor is; the defaults are those of `indoor-old`.

    Attributes
    ----------
    strength_uT : rms per axis at `reference_m` above the floor. With what lies in and stands on it, the walks of
        level `indoor` feel about 8 (real ones 6 to 13).
    reference_m : height of a sensor on a standing foot.
    shortest_m, longest_m : range of the wavelengths, evenly filled in their logarithm, each with the same power at
        the reference height. The real walks ask for short ones (the field changes within a swing) and for long ones
        (neighbouring footfalls have a fifth to a quarter of their deviation in common).
    modes : number of waves; no two have a length in common, so no building is large enough for them to repeat.
    depth_m : of the sheet under the floor: concrete covers the upper bars by 2 to 5 cm.
    mesh_heading_deg : direction of one set of bars; None for waves in all directions.
    mesh_spread_deg : sd of the waves' directions about those across the two sets of bars.
    """

    strength_uT: float = 5.5
    reference_m: float = 0.1
    shortest_m: float = 0.6
    longest_m: float = 12.0
    modes: int = 240
    depth_m: float = 0.05
    mesh_heading_deg: float | None = None
    mesh_spread_deg: float = 15.0

    def __post_init__(self) -> None:
        if not (0 <= self.strength_uT < np.inf and 0 < self.shortest_m <= self.longest_m < np.inf):
            raise SimulationError(
                f"a floor of {self.strength_uT} uT and wavelengths {self.shortest_m} to {self.longest_m} m cannot be: "
                f"give a strength of 0 or more and wavelengths above 0 in rising order."
            )
        if self.modes < 1 or not (self.depth_m >= 0 and self.reference_m + self.depth_m > 0):
            raise SimulationError("a floor needs a mode or more and a sheet under the sensor: check modes and depth.")


@dataclass(frozen=True)
class Floor:
    """One draw of a floor's clutter; the Earth's field is not in it.

    Attributes
    ----------
    wave : (M, 2) rad/m, horizontal wave vectors.
    amplitude : (M,) uT at the sheet.
    phase : (M,) rad.
    sheet_m : height of the sheet in nav.
    """

    wave: Floats
    amplitude: Floats
    phase: Floats
    sheet_m: float

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
    heading = _wave_headings(rng, p)
    return Floor(
        wave=number[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1),
        amplitude=p.strength_uT * np.sqrt(3 / p.modes) * np.exp(number * (p.reference_m + p.depth_m)),
        phase=rng.uniform(0, 2 * np.pi, p.modes),
        sheet_m=height_m - p.depth_m,
    )


def _wave_headings(rng: np.random.Generator, p: FloorParameters) -> Floats:
    if p.mesh_heading_deg is None:
        return rng.uniform(0, 2 * np.pi, p.modes)
    across = p.mesh_heading_deg + 90.0 * rng.integers(4, size=p.modes)
    return np.deg2rad(across + p.mesh_spread_deg * rng.standard_normal(p.modes))


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
    """Bury the pieces under the path."""
    count = max(1, round(TREADS_PER_M * SPOTS_M))
    position = _bury_under(np.repeat(path.spots, count, axis=0), np.repeat(path.spot_directions, count, axis=0), rng)
    position = position[path.room(position) >= TREADS_ROOM_M]
    moment = rng.standard_normal(position.shape)
    unit = Dipoles(position, moment / np.linalg.norm(moment, axis=1, keepdims=True))
    felt = unit.at(path.points + np.array([0.0, 0.0, TREADS_HEIGHT_M]))
    size = TREADS_UT / np.sqrt(np.mean(felt**2))
    return Dipoles(unit.position, size * unit.moment)


def _bury_under(spot: Floats, direction: Floats, rng: np.random.Generator) -> Floats:
    """Places (K, 3) m under the path: along it as it climbs, and level to its sides."""
    along = SPOTS_M * rng.uniform(-0.5, 0.5, (len(spot), 1))
    aside = TREADS_HALF_WIDTH_M * rng.uniform(-1, 1, (len(spot), 1))
    depth = rng.uniform(*TREADS_DEPTH_M, (len(spot), 1))
    return spot + along * direction + aside * np.cross(direction, UP) - depth * UP
