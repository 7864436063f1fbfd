"""Stray direct currents: closed circuits of straight conductors.

A straight piece from a to b that carries I (A) adds, at a point seen from its ends at r_a and r_b (m),

    B = mu_0 I / (4 pi)  (1/|r_a| + 1/|r_b|) (r_a x r_b) / (|r_a| |r_b| + r_a . r_b)        (Biot and Savart).

A single piece has a curl everywhere, for its current ends in nothing; around a *closed* circuit the curls cancel.
A supply cable holds both its conductors and is hardly felt: a pair 1 cm apart at 10 A makes 0.1 uT half a metre away.
What is felt is the current that returns another way, through the steel of the building, some amperes round a loop
as high as a storey. The mains' 50 Hz is not modelled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.fields.dipole import SCALE_UT


@dataclass(frozen=True)
class Circuit:
    """A closed polygon of conductors.

    Attributes
    ----------
    corners : (K, 3) m in nav; the last is joined to the first.
    current_A : positive from corner to corner in their order.
    """

    corners: Floats
    current_A: float

    def __post_init__(self) -> None:
        corners = np.ascontiguousarray(self.corners, dtype=np.float64)
        if corners.ndim != 2 or corners.shape[1:] != (3,) or len(corners) < 3 or not np.isfinite(corners).all():
            raise SimulationError(f"corners of shape {corners.shape} close no circuit: give three or more finite ones.")
        object.__setattr__(self, "corners", corners)

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m.

        Raises
        ------
        SimulationError
            On the conductor.
        """
        field = self.current_A * _per_ampere(np.ascontiguousarray(position, dtype=np.float64), self.corners)
        if not np.isfinite(field).all():
            raise SimulationError("the sensor lies on a conductor: move the circuit or the path.")
        return field

    def pieces(self, length_m: float) -> Floats:
        """Points (N, 3) m on the conductor, `length_m` apart or less."""
        ends = np.roll(self.corners, -1, axis=0)
        count = 1 + int(np.linalg.norm(ends - self.corners, axis=1).max() / length_m)
        share = np.arange(count)[:, None, None] / count
        points: Floats = (self.corners + share * (ends - self.corners)).reshape(-1, 3)
        return points


def upright_loop(start: Floats, end: Floats, height_m: float, current_A: float) -> Circuit:
    """Circuit that runs from `start` (3,) m to `end` (3,) m and comes back `height_m` above."""
    up = np.array([0.0, 0.0, height_m])
    return Circuit(np.stack([start, end, end + up, start + up]), current_A)


@njit(cache=True, error_model="numpy")
def _per_ampere(position: Floats, corners: Floats) -> Floats:
    total = np.zeros((len(position), 3))
    count = len(corners)
    for i in range(len(position)):
        ax, ay, az = position[i] - corners[count - 1]
        a = np.sqrt(ax * ax + ay * ay + az * az)
        for k in range(count):
            bx, by, bz = position[i, 0] - corners[k, 0], position[i, 1] - corners[k, 1], position[i, 2] - corners[k, 2]
            b = np.sqrt(bx * bx + by * by + bz * bz)
            shape = SCALE_UT * (a + b) / (a * b * (a * b + ax * bx + ay * by + az * bz))
            total[i, 0] += shape * (ay * bz - az * by)
            total[i, 1] += shape * (az * bx - ax * bz)
            total[i, 2] += shape * (ax * by - ay * bx)
            ax, ay, az, a = bx, by, bz, b
    return total
