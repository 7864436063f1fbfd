"""Magnetic heading: the pose of a footfall against the building's field and the deviation there.

y is the field in the body frame, uT, h the hard iron left in the stance's axes, L = level_R_body these axes from the
body's. In the navigation frame (East-North-Up) the field is n = R (y - L^T h). Its part across the building's
horizontal field E, to the right of it, is the deviation of the place and of its region (`field_state`):

    e = (n_E E_N - n_N E_E) / |E| - delta - rho.

A pose that is turned too far counter-clockwise sees the field turned to the left of E by as much. About up,

    de/dpose = [-(n . E) / |E| e_z^T R, 0],     de/dE = -(n . E) / |E|^2 c,     de/dh = -L R_h^T c,

c the unit vector across E and R_h the two horizontal rows of R.

Tilt. The field is levelled by `nav_R_level`, and only a turn about up from there counts: a field indoors is no plumb
line and must not tilt the attitude. Here nav_R_level is the attitude at hand, whose tilt the derivative leaves out:
about the horizontal axes e would change by the vertical field, more than twice the horizontal one in Europe. The error
of the tilt belongs in the noise.

With an innovation of none, delta is one unknown for a whole stretch (field differences); with a spread of none, the
field is known everywhere (absolute heading). A magnet moves delta where it lies, and not the heading.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .field_state import DELTA, E_H, EAST, IRON, NORTH, RHO, SIZE
from .guarded import Array


@dataclass(frozen=True)
class MagneticHeading:
    """Compass at a footfall; variables nav_T_body and the state m of the field.

    `body_field` (..., 3) uT; `level_R_body` (..., 3, 3); `sigma_uT` (...).
    """

    name: ClassVar[str] = "magnetic heading"
    dims: ClassVar[tuple[int, ...]] = (6, SIZE)
    rows: ClassVar[int] = 1

    body_field: Array
    level_R_body: Array
    sigma_uT: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 1) and its Jacobians by pose and state."""
        nav_T_body, m = variables
        nav_R_level = nav_T_body[..., :3, :3]
        east, north = m[..., EAST], m[..., NORTH]
        strength = np.sqrt(east * east + north * north)
        body_field = self.body_field - (m[..., None, IRON] @ self.level_R_body)[..., 0, :]
        n = (nav_R_level[..., :2, :] @ body_field[..., None])[..., 0]
        across = (n[..., 0] * north - n[..., 1] * east) / strength
        e = ((across - m[..., DELTA] - m[..., RHO]) / self.sigma_uT)[..., None]
        if not with_jacobians:
            return e, []
        weight = 1.0 / self.sigma_uT
        along = (n[..., 0] * east + n[..., 1] * north) / strength * weight
        right = np.empty(n.shape)
        right[..., 0], right[..., 1] = north / strength, -east / strength
        by_pose, by_state = np.zeros((*e.shape, 6)), np.zeros((*e.shape, SIZE))
        by_pose[..., 0, :3] = -along[..., None] * nav_R_level[..., 2, :]
        by_state[..., 0, DELTA] = by_state[..., 0, RHO] = -weight
        by_state[..., 0, E_H] = -(along / strength)[..., None] * right
        across_body = right[..., None, :] @ nav_R_level[..., :2, :]
        by_state[..., 0, IRON] = -weight[..., None] * (self.level_R_body @ np.swapaxes(across_body, -1, -2))[..., 0]
        return e, [by_pose, by_state]
