"""The mean specific force of a stance points up.

A sensor whose velocity is the same at both ends of a time T shows gravity's reaction, on average over T:

    mean(nav_R_body f) = (v_end - v_begin) / T + (0, 0, g).

Over a stance nav_R_body hardly changes, so the direction of the body's mean force is that of nav's z axis. The
residual is gtsam's own `AttitudeFactorPose3`: the part of the one direction across the other, on two axes, and for
small angles the tilt in rad. Turning the pose about nav's z axis changes nothing: yaw gets no information. Upside down
the residual is zero as well: start the right way up.

What is left of the velocities (s_v rms on each axis, at each end), the white noise N of the force, and what is known
of the accelerometer's bias only to within s_b make the tilt uncertain by

    sigma^2 = (2 s_v^2 / T^2 + N^2 / T + s_b^2) / g^2.

The first term is most of it: 1 cm/s at the ends of a stance of 0.3 s is 0.3 deg. s_b is the same in all stances of a
walk; only where the bias is no variable does it belong in here, and then the error does not average out.

Inertial factors that span the stance have this information already, with the velocities as variables: use this factor
in graphs of attitudes only, or where the stance has no inertial factors within.
"""

import gtsam
import numpy as np

from .guarded import Array

STANDARD_GRAVITY = 9.80665
"""m/s^2"""


def gravity_sigma(
    duration: Array | float,
    velocity_sigma: float,
    force_density: float,
    bias_sigma: float = 0.0,
    gravity: float = STANDARD_GRAVITY,
) -> Array:
    """Sigma (...) rad of the tilt that stances show.

    Parameters
    ----------
    duration : (...) s
        Of the stances.
    velocity_sigma : m/s
        Of the sensor at either end, per axis.
    force_density : m/s^2/sqrt(Hz)
        White noise of the accelerometer.
    bias_sigma : m/s^2
        Of its bias, per axis, if that is no variable.
    gravity : m/s^2
    """
    T = np.asarray(duration, dtype=np.float64)
    force_variance = 2.0 * (velocity_sigma / T) ** 2 + force_density**2 / T + bias_sigma**2
    return np.asarray(np.sqrt(force_variance) / gravity)


def gravity_factor(pose_key: int, body_force: Array, sigma: float) -> gtsam.AttitudeFactorPose3:
    """Level a pose by the mean specific force of its stance.

    Parameters
    ----------
    pose_key
        Key of nav_T_body (Pose3), z of nav up.
    body_force : (3,)
        Mean specific force, m/s^2, bias taken off; only its direction counts.
    sigma : rad
        Of the tilt about each of two axes, from `gravity_sigma`.

    Raises
    ------
    ValueError
        If there is no force, which has no direction.
    """
    force = np.asarray(body_force, dtype=np.float64)
    if not np.linalg.norm(force) > 0.0:
        raise ValueError("gravity: the mean specific force is zero or not a number, and has no direction.")
    nav_up = gtsam.Unit3(np.array([0.0, 0.0, 1.0]))
    noise = gtsam.noiseModel.Isotropic.Sigma(2, float(sigma))
    return gtsam.AttitudeFactorPose3(pose_key, nav_up, noise, gtsam.Unit3(force))
