"""The line integral of the field: without currents it has no curl, so over a walk only the two ends count.

B is the field in the navigation frame (East-North-Up), uT: the Earth's E, the same everywhere, and that of the
building's steel, which has a potential phi (uT m) that stays within bounds. With no current through the air

    B = E - grad phi,     integral of B . dp from a to b = E . (p_b - p_a) - (phi_b - phi_a),

p the sensor's position, m. The sensor measures y = R^T B + h in its body frame, R = nav_R_body, h its hard iron. Summed
over the displacements of the body frame, R^T dp, which an inertial trajectory knows without any heading,

    u = integral of y . (R^T dp) - E_U dz,     s = integral of R^T dp (m),
    u = E_h . (p_b - p_a)_h + h . s - (phi_b - phi_a),     E_h = (E_E, E_N).

A turn of the whole trajectory about up changes neither u nor s. So the residual of the stride from footfall k to k + 1,

    e = E_h . (R_k d_k)_h + h . s_k + phi_k - phi_k+1 - u_k     (uT m),     d_k = R_k^T (p_k+1 - p_k),

shows the heading of R_k. d_k, s_k and u_k are all from one trajectory, and held while the attitude moves:

    de/dpose_k = [(n_E E_N - n_N E_E) e_z^T R_k, 0],     n = R_k d_k,
    de/dE_h = n_h,     de/dh = s_k,     de/dphi_k = 1,     de/dphi_k+1 = -1.

Only turns about up count, with the tilt of `nav_R_level` as in `magnetic_heading`: the field is no plumb line.

What d_k is wrong by, u_k is wrong by as well. Where the path is false by a course of f(t), from f_k to f_k+1,

    error of e = integral of (E - B) . df = integral of grad phi . df:

not E but the deviation counts. A stride 1 % too long is 0.01 (phi_k+1 - phi_k) wrong, some 0.05 uT m; joined to a
length from elsewhere it would be 0.01 E L = 0.3. Hence no length of a stride enters as a variable.

The errors of successive strides telescope: over a walk only the first and the last phi are left, where a compass at
each footfall is off by the slope of phi. E . p / |E_h| is a coordinate along magnetic north, good to sigma_phi / |E_h|
wherever one stands. Over a leg of length L across the field, a constant error of heading is seen with

    sigma = sqrt(2) sigma_phi / (|E_h| L)

by its ends, and by N + 1 footfalls of independent phi with sqrt(12 / N) in place of sqrt(2) (a straight line). Along
the field it is not seen to first order: there n_E E_N = n_N E_E.

Where it fails: a path that passes through a circuit of current I picks up mu_0 I = 1.257 uT m for each ampere, at each
passage, and keeps it. (A path through steel would meet the currents bound in it, but steel is not walked through.) An E
that differs from one part of a building to the next is a phi without bounds: let E_h wander. Soft iron makes another
E_h of the Earth's field, and what adds along the path like h; of the building's field it makes what does not telescope.
A delay of the magnetometer turns y in the swing: take it off first. Tilt that is wrong by a (rad) over a stride adds
E_U a L, 0.1 uT m for 0.1 deg. What is the same in all strides looks like iron along the path, so that h belongs to the
trajectory that it was found with; only the rest adds up.

The integral (`integrate_field`) is a trapezoid between every two measurements. What that leaves of a stride over a
rough floor (9 cm above it, 1.4 m long, simulated gait; phi changes by 4.6 uT m from one to the next), rms:

    25 Hz 0.04 uT m,     50 Hz 0.01,     100 Hz 0.0025,     200 Hz 0.0006     (of second order; mean below a tenth).

Source: Ampere's law. That u wants no heading, and its use for one, is this project's; `docs/magnetic.md` names what is
near to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .field_state import E_H, EAST, IRON, NORTH, PHI, SIZE
from .guarded import Array


@dataclass(frozen=True)
class LineIntegral:
    """Integrals over the path from its first sample to K instants; differences of rows are those of strides.

    ========= ====== ===============================================================================================
    u         (K,)   uT m, of the measured field, less that of the Earth's vertical part
    s         (K, 3) m, of the path itself in the body frame: what one uT of hard iron adds to u
    ========= ====== ===============================================================================================
    """

    u: Array
    s: Array


def integrate_field(
    t: Array, nav_R_body: Array, position: Array, body_field: Array, at: Array, vertical_uT: float = 0.0
) -> LineIntegral:
    """Sum the field over the path, by trapezoids.

    Parameters
    ----------
    t : (N,) s
        Rising.
    nav_R_body, position : (N, 3, 3) and (N, 3) m
        The trajectory at these instants; its heading is of no consequence.
    body_field : (N, 3) uT
        NaN where there is no new field: a value that is only held would be taken for that of another place.
        Before the first and after the last one it is taken to stay as it is in the navigation frame, in one piece.
    at : (K,) s
        Where the integrals are asked for; between two measurements they grow evenly.
    vertical_uT : float
        E_U, whose share E_U dz is taken off: a foot goes down as far as up, but for stairs.

    Raises
    ------
    ValueError
        If there is no field at all.
    """
    used = np.flatnonzero(np.isfinite(body_field).all(axis=1))
    if len(used) == 0:
        raise ValueError("line integral: there is no field in any row.")
    first, last = [0] if used[0] > 0 else [], [len(t) - 1] if used[-1] < len(t) - 1 else []
    ends = np.concatenate((first, used, last)).astype(np.intp)
    nearest = np.clip(ends, used[0], used[-1])  # of the rows with a field
    R, step = nav_R_body[nearest], np.diff(position[ends], axis=0)
    field = np.einsum("nab,nb->na", R, body_field[nearest])
    field[:, 2] -= vertical_uT
    of_u = 0.5 * np.einsum("na,na->n", field[1:] + field[:-1], step)
    of_s = 0.5 * (np.einsum("nba,nb->na", R[1:], step) + np.einsum("nba,nb->na", R[:-1], step))
    running = np.vstack([np.zeros(4), np.cumsum(np.column_stack([of_u, of_s]), axis=0)])
    out = np.column_stack([np.interp(at, t[ends], column) for column in running.T])
    return LineIntegral(u=out[:, 0], s=out[:, 1:])


@dataclass(frozen=True)
class FieldPotential:
    """Line integral of the field over a stride; variables nav_T_body at the footfall before it, and m before and after.

    `u` (...) uT m and `level_path` (..., 3) m of the stride, the latter in the axes of the iron; `body_move` (..., 3)
    m, d in the body frame of the footfall before; `sigma_uT_m` (...).
    """

    name: ClassVar[str] = "field potential"
    dims: ClassVar[tuple[int, ...]] = (6, SIZE, SIZE)
    rows: ClassVar[int] = 1

    u: Array
    level_path: Array
    body_move: Array
    sigma_uT_m: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 1) and its Jacobians by pose and both states."""
        nav_T_body, before, after = variables
        nav_R_level = nav_T_body[..., :3, :3]
        n = (nav_R_level[..., :2, :] @ self.body_move[..., None])[..., 0]
        east, north = before[..., EAST], before[..., NORTH]
        of_iron = (before[..., None, IRON] @ self.level_path[..., None])[..., 0, 0]
        expected = east * n[..., 0] + north * n[..., 1] + of_iron + before[..., PHI] - after[..., PHI]
        e = ((expected - self.u) / self.sigma_uT_m)[..., None]
        if not with_jacobians:
            return e, []
        weight = 1.0 / self.sigma_uT_m
        by_pose, by_before, by_after = (np.zeros((*e.shape, d)) for d in self.dims)
        about_up = (n[..., 0] * north - n[..., 1] * east) * weight
        by_pose[..., 0, :3] = about_up[..., None] * nav_R_level[..., 2, :]
        by_before[..., 0, PHI] = weight
        by_before[..., 0, E_H] = n * weight[..., None]
        by_before[..., 0, IRON] = self.level_path * weight[..., None]
        by_after[..., 0, PHI] = -weight
        return e, [by_pose, by_before, by_after]
