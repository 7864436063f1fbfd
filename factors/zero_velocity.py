"""Zero velocity of a standing foot, for a sensor that stands above the point about which the foot rolls.

A shoe on the ground is not at rest. It rolls slowly from heel to toe, and its sole gives way. A sensor at `l` from
the point about which the foot rolls (body frame, from that point to the sensor) moves with

    nav_v = nav_R_body (w x l) + nav_settling,

w the angular rate, bias taken off. The residual is the difference of the two sides, in the navigation frame:

    e = nav_v - nav_R_body u - nav_settling,     u = w x l.

With pose perturbations (rotation, translation) in the body frame,

    de/dpose = [nav_R_body [u]x, 0],     de/dv = I.

All soles of a walk are the same: where they give way by more than was thought, they do so in every stance. With a
variable S, m, for that excess, and a sole that sinks by `sinks_per_m` (1/s, one over the time in which it settles)
faster for each metre of it, the residual has sinks_per_m S more upward, and de/dS = (0, 0, sinks_per_m).

With l = 0 and no settling this is the plain zero-velocity update, for which gtsam's own `PriorFactorVector` does.
"""

import gtsam
import numpy as np

from .guarded import Array, guarded_factor


def rolling_stance_residual(nav_R_body: Array, nav_v: Array, body_velocity: Array, nav_settling: Array) -> Array:
    """Residual (..., 3) of one or many stances: attitudes (..., 3, 3), velocities (..., 3) m/s."""
    return np.asarray(nav_v - np.einsum("...ab,...b->...a", nav_R_body, body_velocity) - nav_settling)


def rolling_stance_jacobian(nav_R_body: Array, body_velocity: Array) -> Array:
    """Derivative (..., 3, 3) of the residual by the rotation of the pose: nav_R_body [u]x."""
    columns = [np.cross(body_velocity, axis) for axis in np.eye(3)]
    return nav_R_body @ np.stack(columns, axis=-1)


def rolling_stance_factor(
    pose_key: int,
    velocity_key: int,
    body_velocity: Array,
    nav_settling: Array,
    noise: gtsam.noiseModel.Base,
    sole_key: int | None = None,
    sinks_per_m: float = 0.0,
) -> gtsam.CustomFactor:
    """Tie the velocity of a sensor on a rolling, settling foot to its attitude.

    Parameters
    ----------
    pose_key, velocity_key
        Keys of nav_T_body (Pose3) and nav_v (3-vector).
    body_velocity : (3,) m/s
        w x l in the body frame.
    nav_settling : (3,) m/s
        Velocity of the sole as it gives way, in the navigation frame.
    noise
        Of dimension 3, m/s, on the axes of the navigation frame.
    sole_key
        Key of the excess S (1-vector, m) by which the sole settles; None where that is known.
    sinks_per_m : 1/s
        By how much faster it sinks for each metre of it.
    """
    u = np.array(body_velocity, dtype=np.float64)
    settling = np.array(nav_settling, dtype=np.float64)
    by_velocity, by_sole = np.eye(3), np.array([[0.0], [0.0], [sinks_per_m]])
    of_sole = [] if sole_key is None else [sole_key]

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Array, list[Array]]:
        nav_R_body = values.atPose3(pose_key).rotation().matrix()
        e = rolling_stance_residual(nav_R_body, values.atVector(velocity_key), u, settling)
        for key in of_sole:
            e = e + by_sole @ values.atVector(key)
        if not with_jacobians:
            return e, []
        by_pose = np.zeros((3, 6))
        by_pose[:, :3] = rolling_stance_jacobian(nav_R_body, u)
        return e, [by_pose, by_velocity, *(by_sole for _ in of_sole)]

    keys = [pose_key, velocity_key, *of_sole]
    return guarded_factor("rolling stance", keys, [6, 3, 1][: len(keys)], noise, residual)
