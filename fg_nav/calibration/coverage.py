"""Which directions of the field a calibration has seen, in the axes of the sensor.

The sphere is cut into `CELLS` patches of equal size, each about a point of a Fibonacci lattice; a patch is covered if
a reading points into it. What matters more than the share is the weakest direction: the axis along which the mean
square of the unit vectors is least, 1/3 when all directions are seen alike and 0 when the readings lie in a plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats

CELLS = 100
"""Patches of 413 square degrees, about 20 degrees wide: a hand that tumbles a box leaves no finer holes."""


@dataclass(frozen=True)
class Coverage:
    """Directions that were covered.

    Attributes
    ----------
    share : of the sphere's patches that hold a reading.
    weakest : (3,) unit axis along which the readings point least.
    weakest_share : three times the mean square of their component along it: 1 for an even tumbling, 0 in a plane.
    """

    share: float
    weakest: Floats
    weakest_share: float

    @property
    def words(self) -> str:
        """The verdict in a sentence's part."""
        x, y, z = self.weakest
        return (
            f"{100 * self.share:.0f} % of all directions covered, weakest along ({x:+.2f}, {y:+.2f}, {z:+.2f}) of the "
            f"sensor's axes ({100 * self.weakest_share:.0f} % of an even tumbling)"
        )


def coverage_of(body_field: Floats) -> Coverage:
    """Coverage by readings (N, 3) less hard iron: soft iron is mild enough to be left in."""
    direction = body_field / np.linalg.norm(body_field, axis=1, keepdims=True)
    cell = np.argmax(direction @ _lattice().T, axis=1)
    size, axes = np.linalg.eigh(direction.T @ direction / len(direction))
    return Coverage(len(np.unique(cell)) / CELLS, axes[:, 0], float(3.0 * size[0]))


def _lattice() -> Floats:
    """Points (CELLS, 3) evenly over the unit sphere."""
    k = np.arange(CELLS) + 0.5
    z, angle = 1.0 - 2.0 * k / CELLS, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)
