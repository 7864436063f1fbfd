"""Zero rate of a foot that stands still for a while: its mean rate is the gyroscope's bias.

Over a rest of duration T the body turns by no more than a small angle, a rms about each axis, and the gyroscope has
white noise of density N. With a scale and misalignment S and a g-sensitivity G beside the bias b, the mean rate is

    w = (I + S) w_true + G f + b,    w_true within a / T,    so    w = b + G f + noise,

    sigma^2 = N^2 / T + (a / T)^2.

S does nothing to a sensor that does not turn, to the first order. With G known or left out, the residual b - w is
linear in the bias alone, and gtsam's own prior on it does: `zero_rate_factor`. With G a variable,

    e = b + G f - w,    de/db = I,    de/dG = I (x) f^T,

which, for steady f, sees only the sum of b and G f. All in the body frame, rad/s and m/s^2; G row by row.

The second term of sigma rules: a foot that leans by half a degree in half a second shows its bias to 1 deg/s. A rest
that is part of a stance is no rest (Skog et al. 2010, on zero angular rate): sway over a rest is white in the angle,
and a, for a standing person, some hundredths of a degree.
"""

from collections.abc import Sequence

import gtsam
import numpy as np

from .guarded import Array, guarded_factor


def zero_rate_sigma(duration: Array | float, rate_density: float, turned: float) -> Array:
    """Sigma (...) rad/s, per axis, of the mean rate of rests as an estimate of the bias.

    Parameters
    ----------
    duration : (...) s
        Of the rests.
    rate_density : rad/s/sqrt(Hz)
        Of the gyroscope's white noise.
    turned : rad
        By which the body may have turned from the begin of the rest to its end, rms per axis.
    """
    T = np.asarray(duration, dtype=np.float64)
    return np.asarray(np.hypot(rate_density / np.sqrt(T), turned / T))


def zero_rate_factor(bias_key: int, rate: Array, sigma: float) -> gtsam.PriorFactorConstantBias:
    """Prior on the gyroscope's half of a bias (imuBias.ConstantBias); that of the accelerometer stays free.

    Parameters
    ----------
    rate : (3,) rad/s
        Mean over the rest.
    sigma : rad/s
        Of each axis, from `zero_rate_sigma`.
    """
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), np.asarray(rate, dtype=np.float64))
    precisions = np.repeat([0.0, sigma**-2], 3)
    return gtsam.PriorFactorConstantBias(bias_key, bias, gtsam.noiseModel.Diagonal.Precisions(precisions))


def zero_rate_residual(gyro_bias: Array, g_sensitivity: Array, rate: Array, force: Array) -> Array:
    """Residual (..., 3) rad/s of rests: biases (..., 3), G (..., 3, 3), mean rates and forces (..., 3)."""
    return np.asarray(gyro_bias + np.einsum("...ab,...b->...a", g_sensitivity, force) - rate)


def zero_rate_jacobian(force: Array) -> Array:
    """Derivative (..., 3, 9) of the residual by G, row by row; that by the bias is the identity."""
    by_g = np.zeros((*np.shape(force)[:-1], 3, 3, 3))
    for axis in range(3):
        by_g[..., axis, axis, :] = force
    return by_g.reshape(*np.shape(force)[:-1], 3, 9)


def zero_rate_with_g_factor(
    bias_key: int, g_key: int, rate: Array, force: Array, noise: gtsam.noiseModel.Base
) -> gtsam.CustomFactor:
    """Tie bias and g-sensitivity to what a rest shows.

    Parameters
    ----------
    bias_key, g_key
        Keys of the bias (imuBias.ConstantBias) and of G (9-vector, row by row).
    rate, force : (3,)
        Means over the rest, rad/s and m/s^2.
    noise
        Of dimension 3, rad/s.
    """
    rate, force = np.array(rate, dtype=np.float64), np.array(force, dtype=np.float64)
    by_bias = np.hstack([np.zeros((3, 3)), np.eye(3)])
    by_g = zero_rate_jacobian(force)

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Array, Sequence[Array]]:
        G = values.atVector(g_key).reshape(3, 3)
        return zero_rate_residual(values.atConstantBias(bias_key).gyroscope(), G, rate, force), [by_bias, by_g]

    return guarded_factor("zero rate", [bias_key, g_key], [6, 9], noise, residual)
