"""Local field: one field vector, unknown but constant, seen by all footfalls of a quasi-static stretch.

m is the field in the navigation frame, h the hard iron in the body frame, y the field measured in the body frame, all
uT. The residual is in the body frame, where the sensor's noise is:

    e = nav_R_body^T m + h - y,
    de/dpose = [[nav_R_body^T m]x, 0],     de/dm = nav_R_body^T,     de/dh = I.

Along a path the local fields deviate from the Earth's field E. Between two of them, a distance d apart,

    m_k - E = a (m_k-1 - E) + w,     a = exp(-d / length),     sigma_w = sigma sqrt(1 - a^2)

(stationary Gauss-Markov: each deviation has sigma, neighbours resemble each other for a length). E is given, or a
variable. The tie takes the place of the prior from the second field on; both would count it twice. What differs from
one footfall to the next (a reinforced floor) is noise of `local_field_factor`.

Deviations have heavy tails: most are small, and some are a steel cabinet. A Student t of `dof` degrees of freedom on
the vector is exactly gtsam's Cauchy kernel, which weighs the norm of the whitened vector:

    p(r) ~ (1 + r^2 / (dof s^2))^(-(dof + 3) / 2):     k = sqrt(dof + 3),     sigma = s sqrt(dof / (dof + 3)).

It never silences a field altogether, as Tukey's or a truncated kernel would from a bad first guess.

With the prior tight these are factors of a known field, and carry heading; with it loose, two poses and the field
eliminated, they are the differential field. Hard iron that drifts: a `gtsam.BetweenFactorVector` between successive h.
"""

import gtsam
import numpy as np

from .guarded import Array, guarded_factor
from .rotation import skew

SHORTEST_M = 0.01
"""Fields less far apart than this are taken to be so: a foot does not come down on the same spot to a centimetre."""


def local_field_residual(nav_R_body: Array, nav_field: Array, hard_iron: Array, body_field: Array) -> Array:
    """Residual (..., 3) uT of attitudes (..., 3, 3), local fields, hard irons and measured fields, each (..., 3) uT."""
    return np.asarray(np.einsum("...ba,...b->...a", nav_R_body, nav_field) + hard_iron - body_field)


def local_field_jacobians(nav_R_body: Array, nav_field: Array) -> tuple[Array, Array]:
    """Derivatives (..., 3, 3) by the rotation of the pose and by the local field; that by the hard iron is I."""
    by_field = np.swapaxes(nav_R_body, -1, -2)
    return skew(np.einsum("...ab,...b->...a", by_field, nav_field)), by_field


def local_field_factor(
    pose_key: int,
    field_key: int,
    body_field: Array,
    noise: gtsam.noiseModel.Base,
    hard_iron_key: int | None = None,
    hard_iron: Array | None = None,
) -> gtsam.CustomFactor:
    """Tie a pose to the local field that its sensor measures.

    Parameters
    ----------
    pose_key, field_key
        Keys of nav_T_body (Pose3) and of the local field (3-vector, uT).
    body_field : (3,) uT
        Measured.
    noise
        Of dimension 3, uT, on the axes of the body.
    hard_iron_key
        Of the hard iron (3-vector, uT), if it is a variable.
    hard_iron : (3,) uT
        If it is known and not a variable; zero by default.
    """
    y = np.array(body_field, dtype=np.float64)
    known = np.zeros(3) if hard_iron is None else np.array(hard_iron, dtype=np.float64)
    keys = [pose_key, field_key] if hard_iron_key is None else [pose_key, field_key, hard_iron_key]

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Array, list[Array]]:
        nav_R_body, m = values.atPose3(pose_key).rotation().matrix(), values.atVector(field_key)
        h = known if hard_iron_key is None else values.atVector(hard_iron_key)
        e = local_field_residual(nav_R_body, m, h, y)
        if not with_jacobians:
            return e, []
        by_rotation, by_field = local_field_jacobians(nav_R_body, m)
        return e, [np.hstack([by_rotation, np.zeros((3, 3))]), by_field, np.eye(3)][: len(keys)]

    return guarded_factor("local field", keys, [6, 3, 3][: len(keys)], noise, residual)


def student_t_noise(scale_uT: float, dof: float) -> gtsam.noiseModel.Robust:
    """Noise of a 3-vector with a Student t of this scale per axis (its sigma is scale sqrt(dof / (dof - 2)))."""
    gaussian = gtsam.noiseModel.Isotropic.Sigma(3, scale_uT * np.sqrt(dof / (dof + 3.0)))
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(np.sqrt(dof + 3.0)), gaussian)


def student_t_information(deviation: Array, scale_uT: Array | float, dof: float) -> Array:
    """Information (...,) 1/uT^2 per axis with which `student_t_noise` weighs deviations (..., 3) uT."""
    squared = (np.asarray(deviation) ** 2).sum(axis=-1)
    return np.asarray((dof + 3.0) / (dof * np.square(scale_uT) + squared))


def earth_field_prior(field_key: int, nav_earth_field: Array, scale_uT: float, dof: float) -> gtsam.PriorFactorVector:
    """Expect a local field around the Earth's (3,) uT, with the Student t of `student_t_noise`."""
    return gtsam.PriorFactorVector(field_key, np.array(nav_earth_field), student_t_noise(scale_uT, dof))


def field_tie_coefficients(
    distance_m: Array | float, length_m: Array | float, sigma_uT: Array | float
) -> tuple[Array, Array]:
    """How much of a deviation is left after a distance, a (...,), and sigma_w (...,) uT of what is new."""
    path = np.maximum(distance_m, SHORTEST_M) / np.asarray(length_m, dtype=np.float64)
    return np.asarray(np.exp(-path)), np.asarray(sigma_uT * np.sqrt(-np.expm1(-2.0 * path)))


def field_tie_residual(nav_field: Array, before: Array, earth_field: Array, left: Array | float) -> Array:
    """Residual (..., 3) uT: m - a m_before - (1 - a) E; its derivatives by the three are I, -a I and -(1 - a) I."""
    a = np.asarray(left)[..., None]
    return np.asarray(nav_field - a * before - (1.0 - a) * earth_field)


def field_tie_factor(
    before_key: int,
    field_key: int,
    left: float,
    sigma_w_uT: float,
    earth_field: Array | None = None,
    earth_key: int | None = None,
) -> gtsam.LinearContainerFactor:
    """Tie two successive local fields (3-vectors, uT), with `field_tie_coefficients`; in C++.

    Give the Earth's field as `earth_field` (3,) uT, or its variable as `earth_key`.

    Raises
    ------
    ValueError
        If neither or both are given.
    """
    if (earth_field is None) == (earth_key is None):
        raise ValueError("field tie: give either the Earth's field or the key of its variable.")
    one, at = np.eye(3), gtsam.Values()
    noise = gtsam.noiseModel.Isotropic.Sigma(3, sigma_w_uT)
    for key in (before_key, field_key) if earth_key is None else (before_key, field_key, earth_key):
        at.insert(key, np.zeros(3))
    if earth_key is None:
        b = (1.0 - left) * np.array(earth_field, dtype=np.float64)
        linear = gtsam.JacobianFactor(before_key, -left * one, field_key, one, b, noise)
    else:
        by_earth = (left - 1.0) * one
        linear = gtsam.JacobianFactor(before_key, -left * one, field_key, one, earth_key, by_earth, np.zeros(3), noise)
    return gtsam.LinearContainerFactor(linear, at)
