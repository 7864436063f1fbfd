"""The field along the way: without currents it has no curl, so its integral over a walk tells only of the two ends.

B is the field in the navigation frame (East-North-Up), uT: the Earth's E, the same everywhere, and that of the
building's steel, which has a potential phi (uT m) that stays within bounds. With no current through the air

    B = E - grad phi,     integral of B . dp from a to b = E . (p_b - p_a) - (phi_b - phi_a),

p the sensor's position, m. The sensor measures y = R^T B + h in its body frame, R = nav_R_body, h its hard iron. Summed
over the displacements of the body frame, R^T dp, which an inertial trajectory knows without any heading,

    u = integral of y . (R^T dp) - E_U dz,     s = integral of R^T dp (m),
    u = E_h . (p_b - p_a)_h + h . s - (phi_b - phi_a),     E_h = (E_E, E_N).

A turn of the whole trajectory about up changes neither u nor s. So the residual of the stride from footfall k to k + 1,

    e = E_h . (R_k d_k)_h + h . s_k + phi_k - phi_k+1 - u_k     (uT m),     d_k = R_k^T (p_k+1 - p_k),

tells of the heading of R_k. d_k, s_k and u_k are all from one trajectory, and held while the attitude moves:

    de/dpose_k = [(n_E E_N - n_N E_E) e_z^T R_k, 0],     n = R_k d_k,
    de/dE_h = n_h,     de/dh = s_k,     de/dphi_k = 1,     de/dphi_k+1 = -1.

Only turns about up count, as in `magnetic_heading`: the field is no plumb line. `nav_R_level`, the attitude at the last
linearisation, keeps tilt out of the residual too: n = (turn about up from nav_R_level to R_k) nav_R_level d_k.

What d_k is wrong by, u_k is wrong by as well. Where the way is false by a course of f(t), from f_k to f_k+1,

    error of e = integral of (E - B) . df = integral of grad phi . df:

not E but the deviation counts. A stride 1 % too long is 0.01 (phi_k+1 - phi_k) wrong, some 0.05 uT m; joined to a
length from elsewhere it would be 0.01 E L = 0.3. Hence no length of a stride enters as a variable.

The errors of successive strides telescope: over a walk only the first and the last phi are left, where a compass at
each footfall is off by the slope of phi. E . p / |E_h| is a coordinate along magnetic north, good to sigma_phi / |E_h|
wherever one stands. Over a leg of length L across the field, a constant error of heading is seen with

    sigma = sqrt(2) sigma_phi / (|E_h| L)

by its ends, and by N + 1 footfalls of independent phi with sqrt(12 / N) in place of sqrt(2) (a straight line). Along
the field it is not seen to first order: there n_E E_N = n_N E_E.

Where it fails: a way that passes through a circuit of current I picks up mu_0 I = 1.257 uT m for each ampere, at each
passage, and keeps it. (A way through steel would meet the currents bound in it, but steel is not walked through.) An E
that differs from one part of a building to the next is a phi without bounds: let E_h wander. Soft iron makes another
E_h of the Earth's field, and what adds along the way like h; of the building's field it makes what does not telescope.
A delay of the magnetometer turns y in the swing: take it off first. Tilt that is wrong by a (rad) over a stride adds
E_U a L, 0.1 uT m for 0.1 deg. What is the same in all strides looks like iron along the way, so that h belongs to the
trajectory that it was found with; only the rest adds up.

The integral (`way_integral`) is a trapezoid between every two measurements. What that leaves of a stride over a rough
floor (9 cm above it, 1.4 m long, simulated gait; phi changes by 4.6 uT m from one to the next), rms:

    25 Hz 0.04 uT m,     50 Hz 0.01,     100 Hz 0.0025,     200 Hz 0.0006     (of second order; mean below a tenth).

Source: Ampere's law. That u wants no heading, and its use for one, is this project's; `docs/magnetic.md` names what is
near to it.
"""

from dataclasses import dataclass

import gtsam
import numpy as np

from .guarded import Array, guarded_factor
from .rotation import turn_about_up

FIELD_STATE = 7
"""Numbers of a field state: phi (uT m), across (uT, of another factor), E_E, E_N, h_x, h_y, h_z (uT)."""

PHI, EARTH, IRON = 0, slice(2, 4), slice(4, 7)
"""Where in a field state its parts stand."""


@dataclass(frozen=True)
class WayIntegral:
    """Integrals over the way from its first sample to K instants; differences of rows are those of strides.

    ========= ====== ===============================================================================================
    u         (K,)   uT m, of the measured field, less that of the Earth's vertical part
    s         (K, 3) m, of the way itself in the body frame: what one uT of hard iron adds to u
    square_m2 (K,)   m^2, sum of the squares of the pieces between measurements: times the variance of white noise,
                     that of u. A piece as long as a step, where no field was measured, stands out in it
    ========= ====== ===============================================================================================
    """

    u: Array
    s: Array
    square_m2: Array


def way_integral(
    t: Array, nav_R_body: Array, position: Array, body_field: Array, at: Array, vertical_uT: float = 0.0
) -> WayIntegral:
    """Sum the field over the way, by trapezoids.

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
        raise ValueError("way integral: there is no field in any row.")
    first, last = [0] if used[0] > 0 else [], [len(t) - 1] if used[-1] < len(t) - 1 else []
    ends = np.concatenate((first, used, last)).astype(np.intp)
    nearest = np.clip(ends, used[0], used[-1])  # of the rows with a field
    R, step = nav_R_body[nearest], np.diff(position[ends], axis=0)
    field = np.einsum("nab,nb->na", R, body_field[nearest])
    field[:, 2] -= vertical_uT
    of_u = 0.5 * np.einsum("na,na->n", field[1:] + field[:-1], step)
    of_s = 0.5 * (np.einsum("nba,nb->na", R[1:], step) + np.einsum("nba,nb->na", R[:-1], step))
    rows = np.column_stack([of_u, of_s, np.einsum("na,na->n", step, step)])
    running = np.vstack([np.zeros(5), np.cumsum(rows, axis=0)])
    out = np.column_stack([np.interp(at, t[ends], column) for column in running.T])
    return WayIntegral(u=out[:, 0], s=out[:, 1:4], square_m2=out[:, 4])


def field_potential_sigma(
    square_m2: Array | float,
    noise_uT: Array | float,
    course_sigma_m: Array | float = 0.0,
    deviation_uT: Array | float = 0.0,
    integration_uT_m: Array | float = 0.0,
) -> Array:
    """Sigma (...,) uT m of the residual of a stride.

    Parameters
    ----------
    square_m2
        Its difference of `WayIntegral.square_m2`.
    noise_uT
        White, on each axis of a measurement.
    course_sigma_m, deviation_uT
        How far the trajectory's course within a stride is off, and the field that it is off in: the
        deviation from the Earth's, per axis.
    integration_uT_m
        What the trapezoids leave; the model above tells how much.
    """
    white = np.square(noise_uT) * square_m2
    return np.asarray(
        np.sqrt(white + np.square(np.multiply(course_sigma_m, deviation_uT)) + np.square(integration_uT_m))
    )


def field_potential_residual(
    nav_R_body: Array,
    displacement: Array,
    earth: Array,
    iron: Array,
    potentials: Array,
    u: Array,
    s: Array,
    nav_R_level: Array | None = None,
) -> Array:
    """Residual (...,) uT m of strides.

    Parameters
    ----------
    nav_R_body : (..., 3, 3)
        At the footfall before.
    displacement : (..., 3) m
        d, of the stride in the body frame of that footfall.
    earth : (..., 2) uT
        East and north.
    iron : (..., 3) uT
    potentials : (..., 2) uT m
        phi before and after.
    u, s : (...,) uT m and (..., 3) m
        Of the stride: differences of those of `WayIntegral`.
    nav_R_level : (..., 3, 3), optional
        Attitude whose tilt counts; by default that of nav_R_body.
    """
    n = _over_ground(nav_R_body, displacement, nav_R_level)
    said = (earth * n).sum(axis=-1) + (iron * s).sum(axis=-1) + potentials[..., 0] - potentials[..., 1]
    return np.asarray(said - u)


def field_potential_jacobians(
    nav_R_body: Array, displacement: Array, earth: Array, nav_R_level: Array | None = None
) -> tuple[Array, Array]:
    """Derivatives (..., 3) by the rotation of the pose, for turns about up, and (..., 2) by the Earth's field.

    That by the iron is s, and those by the potentials are 1 and -1.
    """
    n = _over_ground(nav_R_body, displacement, nav_R_level)
    about_up = n[..., 0] * earth[..., 1] - n[..., 1] * earth[..., 0]
    return np.asarray(about_up[..., None] * nav_R_body[..., 2, :]), n


def field_potential_factor(
    pose_key: int,
    before_key: int,
    after_key: int,
    displacement: Array,
    u: float,
    s: Array,
    noise: gtsam.noiseModel.Base,
    nav_R_level: Array | None = None,
) -> gtsam.CustomFactor:
    """Tie the heading of a pose to the field along the stride that begins there.

    Parameters
    ----------
    pose_key
        Key of nav_T_body (Pose3) at the footfall before the stride.
    before_key, after_key
        Keys of the field states (7-vectors, `FIELD_STATE`) at the footfalls before and after. The Earth's field and the
        iron are those before.
    displacement, u, s
        As in `field_potential_residual`.
    noise
        Of dimension 1, uT m (`field_potential_sigma`).
    nav_R_level : (3, 3), optional
        Attitude whose tilt counts; by default that of the pose as it is.
    """
    d, way, measured = (np.array(x, dtype=np.float64) for x in (displacement, s, u))
    level = None if nav_R_level is None else np.array(nav_R_level, dtype=np.float64)

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Array, list[Array]]:
        R = values.atPose3(pose_key).rotation().matrix()
        before, after = values.atVector(before_key), values.atVector(after_key)
        potentials = np.array([before[PHI], after[PHI]])
        e = field_potential_residual(R, d, before[EARTH], before[IRON], potentials, measured, way, level)
        if not with_jacobians:
            return np.atleast_1d(e), []
        return np.atleast_1d(e), _rows(R, d, before[EARTH], way, level)

    return guarded_factor(
        "field potential", [pose_key, before_key, after_key], [6, FIELD_STATE, FIELD_STATE], noise, residual
    )


def _rows(R: Array, displacement: Array, earth: Array, s: Array, level: Array | None) -> list[Array]:
    """Jacobians by the pose (1, 6) and by the two field states (1, 7)."""
    by_pose, by_before, by_after = np.zeros((1, 6)), np.zeros((1, FIELD_STATE)), np.zeros((1, FIELD_STATE))
    by_pose[0, :3], by_before[0, EARTH] = field_potential_jacobians(R, displacement, earth, level)
    by_before[0, PHI], by_before[0, IRON], by_after[0, PHI] = 1.0, s, -1.0
    return [by_pose, by_before, by_after]


def _over_ground(nav_R_body: Array, displacement: Array, nav_R_level: Array | None) -> Array:
    """Displacement (..., 2) m, east and north."""
    level = nav_R_body if nav_R_level is None else nav_R_level
    n = np.einsum("...ab,...b->...a", level, displacement)[..., :2]
    if nav_R_level is None:
        return np.asarray(n)
    angle = turn_about_up(nav_R_body @ np.swapaxes(nav_R_level, -1, -2))
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * n[..., 0] - s * n[..., 1], s * n[..., 0] + c * n[..., 1]], axis=-1)
