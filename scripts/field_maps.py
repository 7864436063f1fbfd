"""The simulated magnetic fields: are they fields at all, and what do they look like.

    python scripts/field_maps.py [--seed N] [--figure FILE]

For each map, at points on a patch at foot height (0.10 m) and at pocket height (0.75 m) that are half a metre or more
from its sources: the largest divergence and curl by central differences over their own scale, the largest gradient
there (all in uT/m), and the rms per axis of what the map adds to the Earth's field. A magnetic field has neither
divergence nor curl; the cylinder with the exponent printed in the paper has both.

The picture shows each map from above at both heights: colour is the strength of the whole field (white: that of the
Earth alone), arrows its horizontal part; the way of the walk is dashed.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import harness
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from fg_nav.arrays import Floats
from fg_nav.errors import OutputError, SimulationError
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
from fg_nav.report.plots import style

HEIGHTS_M = {"foot": 0.10, "pocket": 0.75}
FAR_M = 0.5
"""Nearer to a source than this no point is judged."""

BESIDE_M = 0.75
"""Where there is a way, points are judged as near to it as a foot or a pocket comes."""

SHOWN_PERCENT = 96.0
"""Colours reach as far as the field differs from the Earth's on this much of the patch at foot height."""

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

    def grid(self, height_m: float, shape: tuple[int, int]) -> Floats:
        """Points (rows, columns, 3) m, `height_m` over the floor."""
        rows, columns = shape
        x, y = np.meshgrid(np.linspace(self.west, self.east, columns), np.linspace(self.south, self.north, rows))
        return np.stack([x, y, height_m + self.climbs * x], axis=-1)

    def random(self, height_m: float, count: int, rng: np.random.Generator) -> Floats:
        """Points (N, 3) m far from all sources and near to the way if there is one, `height_m` over the floor."""
        x, y = rng.uniform(self.west, self.east, count), rng.uniform(self.south, self.north, count)
        position = np.stack([x, y, height_m + self.climbs * x], axis=1)
        judged = _distance(self.field, position) > FAR_M
        if self.way is not None:
            judged &= _nearest(position[:, :2], resample_path(self.way).points[:, :2]) < BESIDE_M
        return position[judged]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, draw the picture."""
    parser = argparse.ArgumentParser(description="Divergence, curl and pictures of the simulated fields.")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="draw the maps into a PNG")
    chosen = parser.parse_args(arguments)
    patches = all_patches(chosen.seed)
    rows = [
        [patch.name, place, *(f"{value:.2g}" for value in judged(patch, height, chosen.seed))]
        for patch in patches
        for place, height in HEIGHTS_M.items()
    ]
    harness.print_heading("The maps: largest |div|, |curl| and gradient (uT/m), and rms per axis of what is added (uT)")
    harness.print_table(("map", "height", "|div|", "|curl|", "gradient", "div/grad", "curl/grad", "added"), rows)
    if chosen.figure:
        _save(drawn(patches), chosen.figure)


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


def judged(patch: Patch, height_m: float, seed: int, count: int = 2000) -> tuple[float, ...]:
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


def drawn(patches: Sequence[Patch]) -> Figure:
    """Draw every map at both heights, two maps in a row."""
    with style.styled():
        figure = style.new_figure(3.0 * -(-len(patches) // 2), width_in=14.0)
        cells = figure.subfigures(-(-len(patches) // 2), 2, wspace=0.03, hspace=0.03).ravel()
        for patch, cell in zip(patches, cells, strict=False):
            _draw(cell, patch)
    return figure


def _draw(cell: SubFigure, patch: Patch) -> None:
    pair = cell.subplots(1, 2, sharey=True)
    strengths = [_strengths(patch, height) for height in HEIGHTS_M.values()]
    undisturbed = float(np.linalg.norm(patch.earth.vector))
    reach = float(np.nanpercentile(np.abs(strengths[0] - undisturbed), SHOWN_PERCENT))
    for axes, strength, (place, height) in zip(pair, strengths, HEIGHTS_M.items(), strict=True):
        image = axes.imshow(
            strength,
            origin="lower",
            extent=(patch.west, patch.east, patch.south, patch.north),
            cmap="RdBu_r",
            vmin=undisturbed - reach,
            vmax=undisturbed + reach,
            interpolation="bilinear",
        )
        _draw_arrows(axes, patch, height)
        _draw_way(axes, patch)
        axes.set(xlim=(patch.west, patch.east), ylim=(patch.south, patch.north), xlabel="east (m)", facecolor=style.INK)
        axes.grid(visible=False)
        axes.set_title(f"{place}, {height:.2f} m", color=style.SOFT_INK, fontsize=9.0)
    pair[0].set_ylabel("north (m)")
    cell.suptitle(patch.name, x=0.01, ha="left", fontsize=11.0, color=style.INK)
    cell.colorbar(image, ax=list(pair), label="|B| (uT)", pad=0.015, extend="both", aspect=16)


def _draw_way(axes: Axes, patch: Patch) -> None:
    if patch.way is not None:
        axes.plot(*patch.way[:, :2].T, color=style.GREEN, linewidth=1.8, linestyle=(0, (4, 2)))


def _strengths(patch: Patch, height_m: float, shape: tuple[int, int] = (120, 160)) -> Floats:
    """Strength (rows, columns) uT; NaN inside of iron."""
    return np.asarray(np.linalg.norm(_anywhere(patch.field, patch.grid(height_m, shape)), axis=-1))


def _draw_arrows(axes: Axes, patch: Patch, height_m: float) -> None:
    """Horizontal field; beside iron, where it is more than twice the Earth's, the arrows grow no longer."""
    place = patch.grid(height_m, (14, 18))[1:-1, 1:-1]
    east, north = np.moveaxis(_anywhere(patch.field, place)[..., :2], -1, 0)
    usual = float(np.linalg.norm(patch.earth.vector[:2]))
    shown = np.minimum(1.0, 2 * usual / np.hypot(east, north))
    size = {"scale": 22 * usual, "scale_units": "width", "width": 0.0045, "headwidth": 3.6}
    axes.quiver(place[..., 0], place[..., 1], shown * east, shown * north, color=style.INK, pivot="mid", **size)


def _anywhere(field: Field, grid: Floats) -> Floats:
    """Field (rows, columns, 3) uT; NaN where it cannot be asked for."""
    try:
        return field.at(grid.reshape(-1, 3)).reshape(grid.shape)
    except SimulationError:
        points = [_or_nothing(field, point) for point in grid.reshape(-1, 3)]
        return np.array(points).reshape(grid.shape)


def _or_nothing(field: Field, point: Floats) -> Floats:
    try:
        return field.at(point[None])[0]
    except SimulationError:
        return np.full(3, np.nan)


def _save(figure: Figure, path: Path) -> None:
    try:
        style.save(figure, path)
    except OSError as error:
        raise OutputError(f"{path} could not be written ({error.strerror}): name another file.") from error


if __name__ == "__main__":
    harness.run(main)
