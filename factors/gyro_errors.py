"""Scale, misalignment and g-sensitivity of a gyroscope, as one variable of a walk.

The gyroscope shows, in the body frame and in rad/s,

    w = (I + S) w_true + G f + b,

S (3, 3) scale and misalignment, G (3, 3) rad/s per m/s^2 what specific force f does to it, b the bias. The variable s
holds any of the 18 numbers (S row by row, then G row by row), with a tight prior at zero; `GYRO_SCALE` and so on
choose them. Over a swing the errors add up to an error of the increment that was preintegrated from the samples. To
the first order in s, the end state of the increment from the corrected rates w - b - S (w - b) - G f is that from
the measured ones moved, in the tangent space of gtsam.NavState (rotation, position, velocity, in the body frame at the
end), by D s,

    D = (theta, rho, nu),   theta = sum_t R_t c_t,   nu = sum_t (R_t c_t) x (v_end - v_t),
    rho = sum_t (R_t c_t) x (p_end - p_t - v_t (t_end - t)),    c_t = -(S (w_t - b) + G f_t) h_t  per unit of s,

R_t the attitude in the middle of sample t, v and p the integrals of the specific force, all brought to the body frame
at the end. The sums are over outer products of nine rows of motion with six of measurement, so one matrix product
a swing does.

An inertial factor compares the increment with the step between two states. To move the increment by D s is to move the
end state by -D s, so its residual becomes, with the derivatives that the factor already has,

    e(x, s) = e(x, 0) + J s,    J = -(de/dpose_end, de/dv_end nav_R_end) (D's rows in that order).

How J itself changes with x is left out: it would enter as the product of s and the residual. What is of second order
in s is about (2 |s|)^2 / 2 rad for a swing of 2 rad, 2e-4 rad for 1 %. Where that is not small beside the noise, take
the errors that were found off the samples (`corrected_rate`), and go on from there (`taken_off`).

A foot that stands adds the constant G f to b, and no swing tells them apart. With `rest_force`, the mean specific force
of the standing foot, G acts on f - rest_force, and b is the bias of a foot that stands as it is used to.

Model: IEEE Std 528; D is this project's derivation, and is tested against preintegration of corrected samples.
"""

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from .guarded import Array, guarded_factor
from .rotation import rotation_exp

Ints = NDArray[np.intp]

GYRO_SCALE = [0, 4, 8]
"""Columns of the scale factors of the three axes."""
GYRO_MATRIX = list(range(9))
"""Columns of scale and misalignment, row by row."""
G_SENSITIVITY = list(range(9, 18))
"""Columns of the g-sensitivity, row by row."""
G_SENSITIVITY_DIAGONAL = [9, 13, 17]
"""Columns of the g-sensitivity of each axis to the force along it."""

IMU_FACTOR_DIMS = [6, 3, 6, 3, 6]
"""Pose, velocity, pose, velocity, bias: the keys of an inertial factor."""


def gyro_error_sensitivity(
    rate: Array, force: Array, period: Array, start: Ints, stop: Ints, rest_force: Array | None = None
) -> Array:
    """Derivative (K, 9, 18) of the increments of K intervals by the errors of the gyroscope.

    Parameters
    ----------
    rate, force : (N, 3)
        Angular rate, bias taken off, rad/s, and specific force, m/s^2, in the body frame, held over their periods.
    period : (N,) s
        Of each sample.
    start, stop : (K,)
        Samples `start <= i < stop` of each interval, as preintegrated between its two nodes.
    rest_force : (3,) m/s^2
        Specific force at which the g-sensitivity is part of the bias; zero if not given.

    Returns
    -------
    (K, 9, 18)
        Rows: rotation (rad), position (m), velocity (m/s), in the body frame at the end of the interval. Columns: S
        and G, row by row; take those that are variables, for example `[..., GYRO_SCALE]`. Good to a part in n^2 for n
        samples: the turns act in the middle of their samples.
    """
    attitude = _attitudes(rate, period)
    middle = attitude[:-1] @ rotation_exp(0.5 * rate * period[:, None])
    effect = _effects(middle, force, period, start, stop)
    sensed = np.hstack([rate, force if rest_force is None else force - rest_force]) * -period[:, None]
    sums = np.array([effect[i:j].reshape(-1, 27).T @ sensed[i:j] for i, j in zip(start, stop, strict=True)])
    at_end = np.swapaxes(attitude[stop], -1, -2)[:, None] @ sums.reshape(-1, 3, 3, 18)
    by_rate, by_force = np.split(at_end.reshape(-1, 9, 3, 6), 2, axis=3)
    return np.concatenate([by_rate.reshape(-1, 9, 9), by_force.reshape(-1, 9, 9)], axis=2)


def corrected_rate(rate: Array, force: Array, errors: Array, rest_force: Array | None = None) -> Array:
    """Angular rate (N, 3) rad/s without errors (18,) that are known, from rate and force as above."""
    S, G = errors[:9].reshape(3, 3), errors[9:].reshape(3, 3)
    sensed = rate - (force if rest_force is None else force - rest_force) @ G.T
    return np.asarray(np.linalg.solve(np.eye(3) + S, sensed.T).T)


def _effects(middle: Array, force: Array, period: Array, start: Ints, stop: Ints) -> Array:
    """What a small turn about each body axis at each sample does to the end of its interval (N, 9, 3)."""
    end = np.zeros(len(force), dtype=np.intp)
    for i, j in zip(start, stop, strict=True):
        end[i:j] = j
    way, velocity = _still_to_come(np.einsum("nab,nb->na", middle, force), period[:, None], end)
    return np.concatenate([middle, _crossed(middle, way), _crossed(middle, velocity)], axis=1)


def _still_to_come(acceleration: Array, h: Array, end: Ints) -> tuple[Array, Array]:
    """From the middle of each sample to its end: way (N, 3) beyond that of the velocity there, and velocity (N, 3)."""
    velocity = _running_sum(acceleration * h)
    position = _running_sum((velocity[:-1] + 0.5 * acceleration * h) * h)
    time = _running_sum(h)
    middle_velocity = velocity[:-1] + 0.5 * acceleration * h
    middle_position = position[:-1] + (0.5 * velocity[:-1] + 0.125 * acceleration * h) * h
    left = time[end] - time[:-1] - 0.5 * h
    return position[end] - middle_position - middle_velocity * left, velocity[end] - middle_velocity


def _running_sum(steps: Array) -> Array:
    return np.vstack([np.zeros(steps.shape[1]), np.cumsum(steps, axis=0)])


def _crossed(columns: Array, vector: Array) -> Array:
    """Cross product of each column (N, 3, 3) with the vector (N, 3)."""
    x, y, z = columns[:, 0], columns[:, 1], columns[:, 2]
    u, v, w = vector[:, 0, None], vector[:, 1, None], vector[:, 2, None]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)


def _attitudes(rate: Array, period: Array) -> Array:
    """Attitude (N + 1, 3, 3) at each sample's begin and at the end, relative to the first.

    The samples are cut into about sqrt(N) blocks that are advanced together.
    """
    n = len(rate)
    length = max(1, int(np.ceil(np.sqrt(n))))
    blocks = -(-n // length)
    steps = np.tile(np.eye(3), (blocks * length, 1, 1))
    steps[:n] = rotation_exp(rate * period[:, None])
    within = steps.reshape(blocks, length, 3, 3)
    for i in range(1, length):
        within[:, i] = within[:, i - 1] @ within[:, i]
    for j in range(1, blocks):
        within[j, -1] = within[j - 1, -1] @ within[j, -1]
    within[1:, :-1] = within[:-1, -1:] @ within[1:, :-1]
    return np.concatenate([np.eye(3)[None], within.reshape(-1, 3, 3)[:n]])


def with_gyro_errors(
    linear: gtsam.GaussianFactor, nav_R_body: Array, key: int, sensitivity: Array, value: Array
) -> gtsam.GaussianFactor:
    """Let the errors of the gyroscope into a linearised inertial factor.

    Parameters
    ----------
    linear
        A `GalileanImuFactor` linearised: keys pose, velocity, pose, velocity, bias; whitened.
    nav_R_body : (3, 3)
        Attitude at the end of the interval, where it was linearised.
    key
        Of the variable s, an n-vector.
    sensitivity : (9, n)
        The chosen columns of `gyro_error_sensitivity`.
    value : (n,)
        Of s, where it is linearised, less what was taken off the samples before.

    Returns
    -------
    gtsam.GaussianFactor
        The same with one more block; half the square of its right-hand side is its error.
    """
    blocks, b = _with_errors(linear, nav_R_body, sensitivity, value)
    unit = gtsam.noiseModel.Unit.Create(len(b))
    dims = [*IMU_FACTOR_DIMS, sensitivity.shape[1]]
    as_given = guarded_factor("gyro errors", [*linear.keys(), key], dims, unit, lambda values, wanted: (-b, blocks))
    return as_given.linearize(gtsam.Values())


def gyro_error_factor(
    imu_factor: gtsam.GalileanImuFactor, key: int, sensitivity: Array, taken_off: Array | None = None
) -> gtsam.CustomFactor:
    """Inertial factor that has the errors of the gyroscope as one more variable.

    Parameters
    ----------
    imu_factor
        Keys pose, velocity, pose, velocity, bias. It goes into the new factor, and not into the graph beside it.
    key
        Of the variable s, an n-vector.
    sensitivity : (9, n)
        The chosen columns of `gyro_error_sensitivity`.
    taken_off : (n,)
        Part of s by which the samples were corrected before they were preintegrated; none if not given.
    """
    known = np.zeros(sensitivity.shape[1]) if taken_off is None else np.array(taken_off, dtype=np.float64)
    keys = imu_factor.keys()
    columns = np.array(sensitivity, dtype=np.float64)

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Array, Sequence[Array]]:
        nav_R_body = values.atPose3(keys[2]).rotation().matrix()
        blocks, b = _with_errors(imu_factor.linearize(values), nav_R_body, columns, values.atVector(key) - known)
        return -b, blocks

    unit = gtsam.noiseModel.Unit.Create(9)
    return guarded_factor("gyro errors", [*keys, key], [*IMU_FACTOR_DIMS, columns.shape[1]], unit, residual)


def gyro_error_prior(key: int, sigma: Array) -> gtsam.PriorFactorVector:
    """Prior at zero on s, with one sigma (n,) for each of its numbers.

    Scale and misalignment: 0.03 and 0.02 by the data sheet of an MPU-9250, 0.003 after a factory calibration.
    g-sensitivity: 2e-4 rad/s per m/s^2 is the 0.1 deg/s/g that is usual.
    """
    return gtsam.PriorFactorVector(key, np.zeros(len(sigma)), gtsam.noiseModel.Diagonal.Sigmas(np.asarray(sigma)))


def _with_errors(
    linear: gtsam.GaussianFactor, nav_R_body: Array, sensitivity: Array, value: Array
) -> tuple[list[Array], Array]:
    """Blocks of all keys, that of s the last, and right-hand side."""
    A, b = linear.jacobian()
    by_pose, by_velocity = A[:, 9:15], A[:, 15:18]
    by_errors = -(by_pose @ sensitivity[:6] + by_velocity @ (nav_R_body @ sensitivity[6:]))
    blocks = [np.ascontiguousarray(A_) for A_ in np.split(A, np.cumsum(IMU_FACTOR_DIMS)[:-1], axis=1)]
    return [*blocks, by_errors], b - by_errors @ value
