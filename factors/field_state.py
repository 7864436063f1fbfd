"""The state of the magnetic field at a footfall: its prior, and how it changes on the path to the next.

    m = (phi, delta, rho, E_east, E_north, h_x, h_y, h_z)

========= ===== =====================================================================================================
phi       uT m  potential of all that is magnetized about, without which the field would be E everywhere
delta     uT    deviation of the field at the footfall across E, to its right
rho       uT    the same of the region: what a room or a wing of the building does to the compass for tens of metres
E         uT    horizontal field of the building
h         uT    hard iron left in the stance's axes, carried along
========= ===== =====================================================================================================

Deviations and potential are stationary Gauss-Markov processes along the path; field and iron are random walks:

    m_{k+1} = keep m_k + innovation,     innovation ~ N(0, sigma^2),     both componentwise.

The prior on E is one on its direction and one on its strength, in place of those on E_east and E_north: a field that is
not where it was expected would otherwise shrink instead of turning. With c the unit vector across E, to its right,

    e_turn = |E_0| atan2(c_0 . E, E_0 . E / |E_0|),     e_strength = |E| - |E_0|.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .guarded import Array

SIZE = 8
"""Numbers of a state."""

PHI, DELTA, RHO, EAST, NORTH = range(5)
E_H = slice(3, 5)
IRON = slice(5, 8)
"""Where its parts stand."""


@dataclass(frozen=True)
class FieldTransition:
    """Change of the state from footfall to footfall; variables m before and after. It is linear.

    `keep` (..., 8) is the share of each number that is left, `sigma` (..., 8) that of what is new.
    """

    name: ClassVar[str] = "field transition"
    dims: ClassVar[tuple[int, ...]] = (SIZE, SIZE)
    rows: ClassVar[int] = SIZE

    keep: Array
    sigma: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 8) and its Jacobians by the states before and after."""
        before, after = variables
        e = (after - self.keep * before) / self.sigma
        if not with_jacobians:
            return e, []
        weight = 1.0 / self.sigma
        return e, [(-self.keep * weight)[..., None] * np.eye(SIZE), weight[..., None] * np.eye(SIZE)]


@dataclass(frozen=True)
class FieldPrior:
    """The first state; variable m. `mean` (8,) and `sigma` (8,), for E of its turn as an arc and of its strength."""

    name: ClassVar[str] = "first state of the field"
    dims: ClassVar[tuple[int, ...]] = (SIZE,)
    rows: ClassVar[int] = SIZE

    mean: Array
    sigma: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (8,) and its Jacobian by the state."""
        (m,) = variables
        e, mean = m - self.mean, self.mean[E_H]
        length, strength = np.linalg.norm(mean), np.linalg.norm(m[E_H])
        turn = np.arctan2(across_direction(mean) @ m[E_H], mean @ m[E_H] / length)
        e[E_H] = turn * length, strength - length
        by_state = np.eye(SIZE)
        by_state[E_H, E_H] = across_direction(m[E_H]) * length / strength, m[E_H] / strength
        return e / self.sigma, [by_state / self.sigma[:, None]] if with_jacobians else []


def across_direction(horizontal: Array) -> Array:
    """Unit vectors (..., 2) over ground at right angles to horizontal fields (..., 2), to their right."""
    right = np.stack([horizontal[..., 1], -horizontal[..., 0]], axis=-1)
    return np.asarray(right / np.linalg.norm(horizontal, axis=-1)[..., None])


def across_field(nav_field: Array, horizontal: Array) -> Array:
    """Part (...) uT of fields (..., 3) across horizontal ones (..., 2), to their right."""
    return np.asarray((nav_field[..., :2] * across_direction(horizontal)).sum(axis=-1))
