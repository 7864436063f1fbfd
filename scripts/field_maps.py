"""The simulated magnetic fields: are they fields at all.

    python scripts/field_maps.py [--seed N]

For each map, at points on a patch at foot height (0.10 m) and at pocket height (0.75 m) that are half a metre or more
from its sources: the largest divergence and curl by central differences over their own scale, the largest gradient
there (all in uT/m), and the rms per axis of what the map adds to the Earth's field. A magnetic field has neither
divergence nor curl; the cylinder with the exponent printed in the paper has both.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import harness
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.fields import (
    AS_PRINTED,
    SITES,
    Circuit,
    Cylinders,
    Dipoles,
    Field,
    FloorParameters,
    Homogeneous,
    Sum,
    compute_sphere_moment,
    curl,
    divergence,
    draw_environment,
    draw_floor,
    draw_treads,
    gradient,
    magnet,
    make_upright_loop,
    resample_path,
    rod,
    street,
)

HEIGHTS_M = {"foot": 0.10, "pocket": 0.75}
FAR_M = 0.5  # Nearer to a source than this no point is judged.
BESIDE_M = 0.75  # Where there is a way, points are judged as near to it as a foot or a pocket comes.

MUNICH, EQUATOR = SITES["munich"], SITES["equator"]


@dataclass(frozen=True)
class Patch:
    """A map, the Earth's field in it, and the patch that is shown: west, east, south, north in m.

    `way` (M, 3) m is drawn where there is one; `climbs` is the slope of the floor towards the east.
    """

    name: str
    field: Field
    earth: Homogeneous
    west: float
    east: float
    south: float
    north: float
    way: Floats | None = None
    climbs: float = 0.0

    def random(self, height_m: float, count: int, rng: np.random.Generator) -> Floats:
        """Points (N, 3) m far from all sources and near to the way if there is one, `height_m` over the floor."""
        x, y = rng.uniform(self.west, self.east, count), rng.uniform(self.south, self.north, count)
        position = np.stack([x, y, height_m + self.climbs * x], axis=1)
        judged = _distance(self.field, position) > FAR_M
        if self.way is not None:
            judged &= _nearest(position[:, :2], resample_path(self.way).points[:, :2]) < BESIDE_M
        return position[judged]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    chosen = harness.parse_arguments(__doc__, arguments, seed=1)
    patches = all_patches(chosen.seed)
    rows = [
        [patch.name, place, *(f"{value:.2g}" for value in measure_patch(patch, height, chosen.seed))]
        for patch in patches
        for place, height in HEIGHTS_M.items()
    ]
    harness.print_heading("The maps: largest |div|, |curl| and gradient (uT/m), and rms per axis of what is added (uT)")
    harness.print_table(("map", "height", "|div|", "|curl|", "gradient", "div/grad", "curl/grad", "added"), rows)


def all_patches(seed: int) -> list[Patch]:
    """Every map of the package, on the patch that shows it best."""
    rng = np.random.default_rng(seed)
    light = {"axis": np.zeros((1, 2)), "radius": np.array([0.3])}
    loop = make_upright_loop(np.array([-1.0, 2.5, 0.0]), np.array([5.0, 2.5, 0.0]), 2.8, 5.0)
    iron = rod(np.array([1.0, 1.2, 0.0]), np.array([1.0, 1.2, 2.8]), np.array([0.0, 0.0, -60.0]))
    ball = magnet(np.array([3.0, 3.0, 0.3]), compute_sphere_moment(MUNICH.vector, 0.25))
    stick = magnet(np.array([4.5, 1.0, 0.0]), np.array([3.0, 0.0, 0.0]))
    way = np.array([[-12.0, 2.0, 0.0], [4.0, 2.0, 0.0], [4.0, 12.0, 0.0]])
    stairs = np.array([[-12.0, 2.0, -12.0], [12.0, 2.0, 12.0]]) * [1.0, 1.0, 0.5]
    room = (-1.0, 7.0, -1.0, 5.0)
    return [
        Patch("cylinder", Cylinders(**light, far=EQUATOR), EQUATOR, -2.0, 2.0, -1.5, 1.5),
        Patch(
            "cylinder, as printed", Cylinders(**light, far=EQUATOR, exponent=AS_PRINTED), EQUATOR, -2.0, 2.0, -1.5, 1.5
        ),
        Patch("street", street(EQUATOR, 120.0), EQUATOR, 40.0, 80.0, -11.0, 19.0),
        Patch("magnet, iron ball, pillar", Sum((MUNICH, stick, ball, iron)), MUNICH, *room),
        Patch("stray current", Sum((MUNICH, loop)), MUNICH, *room),
        Patch("reinforced floor", Sum((MUNICH, draw_floor(rng))), MUNICH, *room),
        Patch(
            "reinforced floor, bars at 30 degrees",
            Sum((MUNICH, draw_floor(rng, FloorParameters(mesh_heading_deg=30.0)))),
            MUNICH,
            *room,
        ),
        Patch(
            "stairs that climb to the east",
            Sum((MUNICH, draw_treads(resample_path(stairs), rng))),
            MUNICH,
            *room,
            stairs,
            climbs=0.5,
        ),
        Patch("level smooth", draw_environment("smooth", MUNICH, way, rng), MUNICH, *room, way),
        Patch("level indoor", draw_environment("indoor", MUNICH, way, rng), MUNICH, *room, way),
    ]


def measure_patch(patch: Patch, height_m: float, seed: int, count: int = 2000) -> tuple[float, ...]:
    """Largest |div|, |curl| and gradient, both over the largest gradient, and the rms of what is added."""
    position = patch.random(height_m, count, np.random.default_rng(seed))
    changes = gradient(patch.field, position)
    div, rot = np.abs(divergence(changes)).max(), np.linalg.norm(curl(changes), axis=1).max()
    size = np.linalg.norm(changes, axis=(1, 2)).max()
    added = patch.field.at(position) - patch.earth.vector
    return float(div), float(rot), float(size), float(div / size), float(rot / size), float(np.sqrt(np.mean(added**2)))


def _distance(field: Field, position: Floats) -> Floats:
    """Distance (N,) m from the nearest source, or from the border of a cell."""
    if isinstance(field, Sum):
        return np.min([_distance(part, position) for part in field.parts], axis=0)
    if isinstance(field, Dipoles):
        return _nearest(position, field.position)
    if isinstance(field, Circuit):
        return _nearest(position, field.pieces(0.1))
    if isinstance(field, Cylinders):
        return _cylinder_distance(field, position)
    return np.full(len(position), np.inf)


def _nearest(position: Floats, sources: Floats) -> Floats:
    return np.asarray(np.min([np.linalg.norm(position - source, axis=1) for source in sources], axis=0))


def _cylinder_distance(field: Cylinders, position: Floats, reach_m: float = 0.1) -> Floats:
    """Distance (N,) m, near enough where the surface is `reach_m` off; nothing near the border of two cells."""
    gap = np.min(
        [np.linalg.norm(position[:, :2] - axis, axis=1) for axis in field.axis] - field.radius[:, None], axis=0
    )
    shifts = reach_m * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    same = np.all([field.cell(position + shift) == field.cell(position) for shift in shifts], axis=0)
    return np.where(same, gap + FAR_M - reach_m, 0.0)


if __name__ == "__main__":
    harness.run(main)
