"""Differential field: within a quasi-static stretch two poses see the same field, whatever it is.

y_i, y_j are the fields measured in the body frame, uT, hard iron taken off. The residual is in the navigation frame:

    e = nav_R_i y_i - nav_R_j y_j,
    de/dpose_i = [-nav_R_i [y_i]x, 0],     de/dpose_j = [nav_R_j [y_j]x, 0].

In this frame each pose has its own half of the residual, and neither Jacobian depends on the other pose; and what
concerns heading, the horizontal rows, stands apart from the upward row, in which there is tilt only. A turn of both
poses about up turns e with them: nothing is said about absolute heading. The noise is that of both measurements,

    C = nav_R_i C_i nav_R_i^T + nav_R_j C_j nav_R_j^T,

and if both are isotropic sigma = sqrt(sigma_i^2 + sigma_j^2) on each axis. A turn between the poses about the field
itself is not seen.

A warning about chains. Neighbouring differences share a measurement: their errors are correlated by -1/2 (a moving
average of order one). A chain of N differences taken as white uses in effect only the first and the last measurement
for a slow error such as a gyro bias, about N / 6 times less information than the same measurements hold. Use this
factor for two poses; for more, give them one variable of `local_field`, which is the same without the loss.
"""

import gtsam
import numpy as np

from .guarded import Array, guarded_factor
from .rotation import skew


def differential_field_residual(nav_R_i: Array, nav_R_j: Array, field_i: Array, field_j: Array) -> Array:
    """Residual (..., 3) uT of attitudes (..., 3, 3) and fields (..., 3) uT in the body frame."""
    i, j = (np.einsum("...ab,...b->...a", R, y) for R, y in ((nav_R_i, field_i), (nav_R_j, field_j)))
    return np.asarray(i - j)


def differential_field_jacobians(nav_R_i: Array, nav_R_j: Array, field_i: Array, field_j: Array) -> tuple[Array, Array]:
    """Derivatives (..., 3, 3) of the residual by the rotations of the two poses."""
    return np.asarray(-nav_R_i @ skew(field_i)), np.asarray(nav_R_j @ skew(field_j))


def differential_field_covariance(nav_R_i: Array, nav_R_j: Array, covariance_i: Array, covariance_j: Array) -> Array:
    """Covariance (..., 3, 3) uT^2 of the residual, from those of the two measurements on the axes of the body."""
    i, j = (R @ C @ np.swapaxes(R, -1, -2) for R, C in ((nav_R_i, covariance_i), (nav_R_j, covariance_j)))
    return np.asarray(i + j)


def differential_field_factor(
    key_i: int, key_j: int, field_i: Array, field_j: Array, noise: gtsam.noiseModel.Base
) -> gtsam.CustomFactor:
    """Tie the attitudes of two poses that see the same field.

    Parameters
    ----------
    key_i, key_j
        Keys of nav_T_body (Pose3).
    field_i, field_j : (3,) uT
        Measured in the body frame at each.
    noise
        Of dimension 3, uT, on the axes of the navigation frame; of both measurements together.
    """
    y_i, y_j = np.array(field_i, dtype=np.float64), np.array(field_j, dtype=np.float64)
    no_position = np.zeros((3, 3))

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Array, list[Array]]:
        R_i, R_j = (values.atPose3(key).rotation().matrix() for key in (key_i, key_j))
        e = differential_field_residual(R_i, R_j, y_i, y_j)
        if not with_jacobians:
            return e, []
        return e, [np.hstack([J, no_position]) for J in differential_field_jacobians(R_i, R_j, y_i, y_j)]

    return guarded_factor("differential field", [key_i, key_j], [6, 6], noise, residual)
