"""Iron that is carried along: how shoe, battery and board bend the field before any chip measures it.

    B' = S B + h

B (uT) is the field in the body frame without the iron, h (uT) the field of what is magnetised for good (hard
iron), S (3, 3) the bending by what B itself magnetises (soft iron). All chips of a module sit in the same B': it
does not average away. S is drawn as identity plus a symmetric matrix whose spread is the same in all directions:
standard deviation s on its diagonal and s/sqrt(2) off it.

Ma et al. 2018, Table 1, calibrate in the levelled plane of a standing foot: offsets (137.95, 75.26) mG, and an
ellipse whose long axis lies at eta = 0.973 rad from x and whose axes have the ratio tau = 0.896. Their correction
shrinks the long axis by tau (Eq. 9-12), so what they correct is S = I + (1/tau - 1) u u^T, u = (cos eta, sin eta,
0), h = offsets (`ma_table_1`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.sensors import checks
from fg_nav.lab.simulation.sensors.checks import IDENTITY, ZERO, Matrix, Triple

MA_OFFSET_UT = (13.795, 7.526)
"""Hard iron of Ma's Table 1, 2-D method, along the levelled x and y axes, uT."""

MA_ETA_RAD = 0.973
"""Direction of the ellipse's long axis of Ma's Table 1, from x towards y."""

MA_TAU = 0.896
"""Ratio of the ellipse's short axis to its long one of Ma's Table 1."""


MOST_UT = 1e4
"""More than a magnet against the case; no chip of these reads that far."""

MOST_SOFT, MOST_SOFT_SD = 10.0, 0.5


@dataclass(frozen=True)
class IronPrior:
    """What iron sensors of one kind carry; none by default, and exactly `hard_uT` and `soft` without spreads.

    Attributes
    ----------
    hard_uT, hard_sd_uT : h, expected (3,) and standard deviation about it per axis, uT.
    soft, soft_sd : S, expected (3, 3) and spread s about it.

    Raises
    ------
    SimulationError
        If a spread is negative or anything is not a number or more than can be, naming the field.
    """

    hard_uT: Triple = ZERO
    hard_sd_uT: float = 0.0
    soft: Matrix = IDENTITY
    soft_sd: float = 0.0

    def __post_init__(self) -> None:
        checks.up_to(MOST_UT, self, "hard_sd_uT")
        checks.up_to(MOST_SOFT_SD, self, "soft_sd")
        checks.vector(self, "hard_uT", most=MOST_UT)
        checks.vector(self, "soft", (3, 3), most=MOST_SOFT)

    def draw(self, rng: np.random.Generator) -> Iron:
        """Draw the iron of one sensor."""
        hard = self.hard_uT + self.hard_sd_uT * rng.standard_normal(3)
        any_matrix = rng.standard_normal((3, 3))
        return Iron(hard, self.soft + self.soft_sd * (any_matrix + any_matrix.T) / 2)


@dataclass(frozen=True)
class Iron:
    """Iron of one particular sensor: `hard_uT` h (3,) and `soft` S (3, 3)."""

    hard_uT: Floats
    soft: Floats

    def bent(self, body_field: Floats) -> Floats:
        """Field (N, 3) uT where the chips sit, from the field `body_field` (N, 3) uT without the iron."""
        return np.asarray(body_field @ self.soft.T + self.hard_uT)


def ma_table_1(level_R_body: Floats | None = None) -> IronPrior:
    """Make exactly the iron of Ma's Table 1.

    Parameters
    ----------
    level_R_body : (3, 3)
        From the body to the levelled axes of the standing foot (x forward, y as the body's seen from above, z up),
        in which the table holds; the body stands level if left out. There is no iron along the vertical.
    """
    body_R_level = np.eye(3) if level_R_body is None else level_R_body.T
    long_axis = body_R_level @ np.array([np.cos(MA_ETA_RAD), np.sin(MA_ETA_RAD), 0.0])
    soft = np.eye(3) + (1 / MA_TAU - 1) * np.outer(long_axis, long_axis)
    return fixed_iron(body_R_level @ np.array([*MA_OFFSET_UT, 0.0]), soft)


def fixed_iron(hard_uT: Floats, soft: Floats | None = None) -> IronPrior:
    """Make exactly this iron: `hard_uT` (3,) and `soft` (3, 3), the latter none if left out."""
    x, y, z = (float(value) for value in hard_uT)
    rows = np.eye(3) if soft is None else soft
    a, b, c = ((float(row[0]), float(row[1]), float(row[2])) for row in rows)
    return IronPrior(hard_uT=(x, y, z), soft=(a, b, c))
