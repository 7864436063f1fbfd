"""Zero velocity of a standing foot, for a sensor that stands above the point about which the foot rolls.

A shoe on the ground is not at rest. It rolls slowly from heel to toe, and its sole gives way. A sensor at `l` from
the point about which the foot rolls (body frame, from that point to the sensor) moves with

    nav_v = R u + settling - s S up,     u = w x l,     R = nav_R_body,

w the angular rate, bias taken off. What a sole is compressed beyond the expected settling is common to all stances of a
walk, so it is one slowly varying variable S (m); the sensor sinks at s S (m/s), s = `sinks_per_m` = 1 / settling time.
With D = diag(1/sigma) on nav's axes the residual is, in the body's axes,

    e = R^T D (nav_v - R u - settling + s S up),
    de/dpose = [R^T D R [u]x + [e]x, 0],     de/dv = R^T D,     de/dS = s R^T D up,

the columns of the pose being rotation, then translation, both in the body frame. Rotating the residual leaves its norm
unchanged. In navigation axes it would rotate with the heading; Gauss-Newton drops the second derivative that cancels
this, and gains spurious information on the heading, 1 rad^-2 per stance.

With l = 0 and no settling this is the plain zero-velocity update (ZUPT).

Zero rate (ZARU). Over a rest, which a still part of a stance is not (Skog et al. 2010), the mean rate of the gyroscope
is its bias. Whether a foot rests in its slow sway cannot be seen, so the noise is robust: rows of W (b - rate), W the
inverse root of the covariance, with Cauchy's loss of their norm.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import gtsam
import numpy as np

from .residual import BIAS, Array, factor_of, hold_cauchy
from .rotation import skew

REST_TAIL_SIGMAS = 4.0  # c of a rest: of feet whose sway shows 0.05 deg/s one in twenty is 0.5 off.


@dataclass(frozen=True)
class StanceVelocity:
    """Velocity of a sensor on a rolling, settling foot; variables nav_T_body, nav_v (m/s) and the excess S (m).

    `body_velocity` (..., 3) u, m/s; `settling` (..., 3) of the sole in nav, m/s; `sigma` (..., 3) on nav's axes, m/s;
    `sinks_per_m` (...) 1/s.
    """

    name: ClassVar[str] = "stance velocity"
    dims: ClassVar[tuple[int, ...]] = (6, 3, 1)
    rows: ClassVar[int] = 3

    body_velocity: Array
    settling: Array
    sigma: Array
    sinks_per_m: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 3) and its Jacobians by pose, velocity and excess."""
        nav_T_body, nav_v, excess = variables
        nav_R_body = nav_T_body[..., :3, :3]
        off = nav_v - (nav_R_body @ self.body_velocity[..., None])[..., 0] - self.settling
        off[..., 2] += self.sinks_per_m * excess[..., 0]
        weight = np.swapaxes(nav_R_body, -1, -2) / self.sigma[..., None, :]
        e = (weight @ off[..., None])[..., 0]
        if not with_jacobians:
            return e, []
        by_pose = np.zeros((*e.shape, 6))
        by_pose[..., :3] = weight @ nav_R_body @ skew(self.body_velocity) + skew(e)
        return e, [by_pose, weight, self.sinks_per_m[..., None, None] * weight[..., 2:]]


@dataclass(frozen=True)
class ZeroRate:
    """Bias of the gyroscope at a rest; variable the bias. `rate` (..., 3) rad/s, `weight` (..., 3, 3) W, s/rad."""

    name: ClassVar[str] = "zero rate"
    dims: ClassVar[tuple[int, ...]] = (BIAS,)
    rows: ClassVar[int] = 4

    rate: Array
    weight: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the rows (..., 4) and, with the weight held, their Jacobian by the bias."""
        x = (self.weight @ (variables[0][..., 3:] - self.rate)[..., None])[..., 0]
        held, above = hold_cauchy((x**2).sum(axis=-1), REST_TAIL_SIGMAS)
        e = np.concatenate([held[..., None] * x, above[..., None]], axis=-1)
        if not with_jacobians:
            return e, []
        by_bias = np.zeros((*e.shape, 6))
        by_bias[..., :3, 3:] = held[..., None, None] * self.weight
        return e, [by_bias]


def zero_rate_factor(bias_key: int, rate: Array, covariance: Array) -> gtsam.CustomFactor:
    """Robust prior on the gyroscope's half of a bias: mean `rate` (3,) rad/s of a rest, covariance (3, 3) rad^2/s^2."""
    weight = np.linalg.cholesky(np.linalg.inv(covariance)).T
    return factor_of(ZeroRate(np.asarray(rate, dtype=np.float64), weight), [bias_key])
