"""The magnetic field: its state at a footfall, the heading against it, and its line integral between footfalls.

State (`FieldPrior`, `FieldTransition`)
---------------------------------------

    m = (phi, delta, r_east, r_north, E_east, E_north, h_x, h_y, h_z)

========= ===== =====================================================================================================
phi       uT m  potential of all that is magnetized about, without which the field would be E everywhere
delta     uT    deviation of the field at the footfall across that of its region, to its right
r         uT    deviation of the region: what a corridor or a wing of the building does for tens of metres
E         uT    horizontal field of the building; G = E + r is that of the region
h         uT    hard iron left in the stance's axes, carried along
========= ===== =====================================================================================================

Deviations and potential are stationary Gauss-Markov processes along the path; field and iron are random walks:

    m_{k+1} = keep m_k + innovation,     innovation ~ N(0, sigma^2),     both componentwise.

The prior on E is one on its direction and one on its strength, in place of those on E_east and E_north: a field that is
not where it was expected would otherwise shrink instead of turning. With c the unit vector across E, to its right,

    e_turn = |E_0| atan2(c_0 . E, E_0 . E / |E_0|),     e_strength = |E| - |E_0|.

Heading (`MagneticHeading`): the pose of a footfall against the building's field and the deviation there
--------------------------------------------------------------------------------------------------------

y is the field in the body frame, uT, h the hard iron left in the stance's axes, L = level_R_body these axes from the
body's. In the navigation frame (East-North-Up) the field is n = R (y - L^T h). Its part across the horizontal field G
of the region, to the right of it, is the deviation of the place:

    e = (n_E G_N - n_N G_E) / |G| - delta.

A field indoors must not tilt the attitude, so it is levelled by an attitude nav_R_level that is held, that of the
solution before, and only the turn psi about up from there to R counts (`rotation.turn_from`), Rz(psi) the rotation by
it. With c the unit vector across G,

    n = Rz(psi) nav_R_level (y - L^T h),
    de/dpose = [-(n . G) / |G| dpsi/dpose, 0],   de/dE = de/dr = -(n . G) / |G|^2 c,   de/dh = -L nav_R_level^T Rz^T c.

With the tilt of nav_R_level dpsi/dpose is e_z^T R: no pose is tilted. The noise is robust: with x = e / sigma the loss
is Cauchy's, c = `TAIL_SIGMAS`, in two rows (`residual.hold_cauchy`).

Line integral (`FieldPotential`): without currents the field has no curl, so over a walk only the two ends count
----------------------------------------------------------------------------------------------------------------

B is the field in the navigation frame, uT: that of the region, G, and that of the steel in it, which has a potential
phi (uT m) that stays within bounds. With no current through the air

    B = G - grad phi,     integral of B . dp from a to b = G . (p_b - p_a) - (phi_b - phi_a),

p the sensor's position, m. The sensor measures y = R^T B + h in its body frame, R = nav_R_body, h its hard iron. Summed
over the displacements of the body frame, R^T dp, which an inertial trajectory knows without any heading,

    u = integral of y . (R^T dp) - E_U dz,     s = integral of R^T dp (m),
    u = G . (p_b - p_a)_h + h . s - (phi_b - phi_a).

A turn of the whole trajectory about up changes neither u nor s. A tilt by theta over a stride, R -> Exp(theta) R, adds

    integral of (theta x B) . dp = theta . J,     J = integral of B x dp     (uT m, by rad).

It stays for many strides, so it is no noise, and the pose of the footfall before has it. With nav_R_level the attitude
of u at footfall k, the body's up b = R_k^T e_z shows by which theta R_k differs, nav_R_level b = (-theta_N, theta_E, 1)
to first order, and with R_k the integral is u_k + w_k . b_k, w across up:

    w_k = nav_R_level^T (e_z x J),     w_k . b_k = theta . J,     zero at nav_R_level.

So the residual of the stride from footfall k to k + 1,

    e = G . n_h + h . s_k + phi_k - phi_k+1 - u_k - w_k . b_k     (uT m),     n = Rz(psi_k) nav_R_level d_k,

shows heading and tilt of R_k: psi_k is its turn about up from nav_R_level, as above. d_k = nav_R_level^T (p_k+1 - p_k),
s_k, u_k and w_k are all from one trajectory, and held while the attitude moves:

    de/dpose_k = [(n_E G_N - n_N G_E) dpsi/dpose - (w_k x b_k)^T, 0],
    de/dE = de/dr = n_h,     de/dh = s_k,     de/dphi_k = 1,     de/dphi_k+1 = -1.

What the path is false by enters with the deviation grad phi only, not with E. Over a leg of length L across the field a
constant error of heading is seen with sqrt(2) sigma_phi / (|E_h| L), and along the field not to first order.

Source: Ampere's law. That u wants no heading, and its use for one, is this project's; `docs/field.md` names what is
near to it, and where it fails.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .residual import Array, hold_cauchy
from .rotation import turn_from

SIZE = 9  # Numbers of a state.
PHI, DELTA, EAST, NORTH = 0, 1, 4, 5
REGION, E_H, IRON = slice(2, 4), slice(4, 6), slice(6, 9)  # Where its parts stand.
TAIL_SIGMAS = 3.0  # c: a footfall beside a magnet keeps half its weight at this many sigmas, a tenth at nine.
_BLOCK_ROWS = 1 << 16  # That are integrated at once.


@dataclass(frozen=True)
class FieldTransition:
    """Change of the state from footfall to footfall; variables m before and after. It is linear.

    `keep` (..., 9) is the share of each number that is left, `sigma` (..., 9) that of what is new.
    """

    name: ClassVar[str] = "field transition"
    dims: ClassVar[tuple[int, ...]] = (SIZE, SIZE)
    rows: ClassVar[int] = SIZE

    keep: Array
    sigma: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 9) and its Jacobians by the states before and after."""
        before, after = variables
        e = (after - self.keep * before) / self.sigma
        if not with_jacobians:
            return e, []
        weight = 1.0 / self.sigma
        return e, [(-self.keep * weight)[..., None] * np.eye(SIZE), weight[..., None] * np.eye(SIZE)]


@dataclass(frozen=True)
class FieldPrior:
    """The first state; variable m. `mean` (9,) and `sigma` (9,), for E of its turn as an arc and of its strength."""

    name: ClassVar[str] = "first state of the field"
    dims: ClassVar[tuple[int, ...]] = (SIZE,)
    rows: ClassVar[int] = SIZE

    mean: Array
    sigma: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (9,) and its Jacobian by the state."""
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


@dataclass(frozen=True)
class MagneticHeading:
    """Compass at a footfall; variables nav_T_body and the state m of the field.

    `body_field` (..., 3) uT; `level_R_body`, `nav_R_level` (..., 3, 3); `sigma_uT` (...).
    """

    name: ClassVar[str] = "magnetic heading"
    dims: ClassVar[tuple[int, ...]] = (6, SIZE)
    rows: ClassVar[int] = 2

    body_field: Array
    level_R_body: Array
    nav_R_level: Array
    sigma_uT: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return both rows (..., 2) and, with the weight held, their Jacobians by pose and state."""
        nav_T_body, m = variables
        east, north = np.moveaxis(m[..., E_H] + m[..., REGION], -1, 0)
        strength = np.sqrt(east * east + north * north)
        body_field = self.body_field - (m[..., None, IRON] @ self.level_R_body)[..., 0, :]
        turn, by_turn = _level_turn(self.nav_R_level, nav_T_body)
        level = turn @ self.nav_R_level[..., :2, :]
        n = (level @ body_field[..., None])[..., 0]
        across = (n[..., 0] * north - n[..., 1] * east) / strength
        x = (across - m[..., DELTA]) / self.sigma_uT
        held, above = hold_cauchy(x**2, TAIL_SIGMAS)
        e = np.stack([held * x, above], axis=-1)
        if not with_jacobians:
            return e, []
        weight = held / self.sigma_uT
        along = (n[..., 0] * east + n[..., 1] * north) / strength * weight
        right = np.empty(n.shape)
        right[..., 0], right[..., 1] = north / strength, -east / strength
        by_pose, by_state = np.zeros((*e.shape, 6)), np.zeros((*e.shape, SIZE))
        by_pose[..., 0, :3] = -along[..., None] * by_turn
        by_state[..., 0, DELTA] = -weight
        by_state[..., 0, E_H] = by_state[..., 0, REGION] = -(along / strength)[..., None] * right
        across_body = right[..., None, :] @ level
        by_state[..., 0, IRON] = -weight[..., None] * (self.level_R_body @ np.swapaxes(across_body, -1, -2))[..., 0]
        return e, [by_pose, by_state]


def _level_turn(nav_R_level: Array, nav_T_body: Array) -> tuple[Array, Array]:
    """Rz(psi) over ground (..., 2, 2), and the derivative of psi by the pose's turn (..., 3)."""
    c, s, by_turn = turn_from(nav_R_level, nav_T_body[..., :3, :3])
    turn = np.empty((*c.shape, 2, 2))
    turn[..., 0, 0] = turn[..., 1, 1] = c
    turn[..., 0, 1], turn[..., 1, 0] = -s, s
    return turn, by_turn


@dataclass(frozen=True)
class LineIntegral:
    """Integrals over the path from its first sample to K instants; differences of rows are those of strides.

    ========= ====== ===============================================================================================
    u         (K,)   uT m, of the measured field, less that of the Earth's vertical part
    s         (K, 3) m, of the path itself in the body frame: what one uT of hard iron adds to u
    moment    (K, 3) uT m, of the field's vector product with the path, in nav: what one rad of false tilt adds to u
    ========= ====== ===============================================================================================
    """

    u: Array
    s: Array
    moment: Array


def integrate_field(
    t: Array,
    nav_R_body: Array,
    position: Array,
    body_field: Array,
    at: Array,
    vertical_uT: float = 0.0,
) -> LineIntegral:
    """Integrate the field along the path by the trapezoidal rule, up to each instant of `at`.

    Parameters
    ----------
    t : (N,) s
        Ascending.
    nav_R_body, position : (N, 3, 3) and (N, 3) m
        The trajectory at these instants; its heading is of no consequence.
    body_field : (N, 3) uT
        NaN where there is no new field: a value that is only held would be taken for that of another place.
        Before the first and after the last one it is taken to stay as it is in the navigation frame, in one piece.
    at : (K,) s
        Instants of the K integrals; linear between two measurements.
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
    total, out = np.zeros(7), np.zeros((len(at), 7))
    for start in range(0, len(ends) - 1, _BLOCK_ROWS):
        part = slice(start, start + _BLOCK_ROWS + 1)
        step = np.diff(position[ends[part]], axis=0)
        # Shares of u, s and the moment in the steps.
        R = nav_R_body[nearest[part]]
        field = np.einsum("nab,nb->na", R, body_field[nearest[part]])
        of_moment = 0.5 * np.cross(field[1:] + field[:-1], step)
        field[:, 2] -= vertical_uT
        of_u = 0.5 * np.einsum("na,na->n", field[1:] + field[:-1], step)
        of_s = 0.5 * (np.einsum("nba,nb->na", R[1:], step) + np.einsum("nba,nb->na", R[:-1], step))
        running = np.cumsum(np.vstack([total, np.column_stack([of_u, of_s, of_moment])]), axis=0)
        behind, total = at >= t[ends[start]], running[-1]
        for column, of_column in zip(out.T, running.T, strict=True):
            column[behind] = np.interp(at[behind], t[ends[part]], of_column)
    return LineIntegral(u=out[:, 0], s=out[:, 1:4], moment=out[:, 4:])


@dataclass(frozen=True)
class FieldPotential:
    """Line integral of the field over a stride; variables nav_T_body at the footfall before it, and m before and after.

    `u` (...) uT m and `level_path` (..., 3) m of the stride, the latter in the axes of the iron; `by_up` (..., 3) uT m,
    w, and `body_move` (..., 3) m, d, in the body frame of the footfall before; `nav_R_level` (..., 3, 3);
    `sigma_uT_m` (...).
    """

    name: ClassVar[str] = "field potential"
    dims: ClassVar[tuple[int, ...]] = (6, SIZE, SIZE)
    rows: ClassVar[int] = 1

    u: Array
    level_path: Array
    by_up: Array
    body_move: Array
    nav_R_level: Array
    sigma_uT_m: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 1) and its Jacobians by pose and both states."""
        nav_T_body, before, after = variables
        turn, by_turn = _level_turn(self.nav_R_level, nav_T_body)
        n = (turn @ self.nav_R_level[..., :2, :] @ self.body_move[..., None])[..., 0]
        east, north = np.moveaxis(before[..., E_H] + before[..., REGION], -1, 0)
        of_iron = (before[..., None, IRON] @ self.level_path[..., None])[..., 0, 0]
        body_up = nav_T_body[..., 2, :3]
        of_tilt = (self.by_up * body_up).sum(axis=-1)
        expected = east * n[..., 0] + north * n[..., 1] + of_iron - of_tilt + before[..., PHI] - after[..., PHI]
        e = ((expected - self.u) / self.sigma_uT_m)[..., None]
        if not with_jacobians:
            return e, []
        weight = 1.0 / self.sigma_uT_m
        by_pose, by_before, by_after = (np.zeros((*e.shape, d)) for d in self.dims)
        about_up = (n[..., 0] * north - n[..., 1] * east) * weight
        by_pose[..., 0, :3] = about_up[..., None] * by_turn - np.cross(self.by_up, body_up) * weight[..., None]
        by_before[..., 0, PHI] = weight
        by_before[..., 0, E_H] = by_before[..., 0, REGION] = n * weight[..., None]
        by_before[..., 0, IRON] = self.level_path * weight[..., None]
        by_after[..., 0, PHI] = -weight
        return e, [by_pose, by_before, by_after]
