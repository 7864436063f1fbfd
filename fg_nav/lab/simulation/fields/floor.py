"""The clutter of a reinforced floor: a random harmonic potential above a sheet of steel.

With z the height over the sheet, horizontal wave vectors k, amplitudes b (uT at the sheet) and phases c,

    phi = sgn(z) sum (b / |k|) cos(k . x + c) exp(-|k z|),    B = -grad phi:

    B_horizontal = sgn(z) sum b (k / |k|) sin(k . x + c) exp(-|k z|),    B_up = sum b cos(k . x + c) exp(-|k z|).

Each term solves Laplace's equation on either side, so the map has neither divergence nor curl; B_up goes through the
sheet without a step and the step of B_horizontal is the magnetised steel in it. Short waves die out first: the map is
rough at the foot and mild at the pocket. The sheet lies `depth_m` under the floor, where nobody walks, and nothing
grows beyond it.

What makes a reinforced floor so rough is not its mesh of 15 cm, whose field is gone at 10 cm, but that its bars are
magnetised each in its own way; wavelengths and strength are those of the real walks (`scripts/realism_field.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError


@dataclass(frozen=True)
class FloorParameters:
    """How rough a floor is.

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
