"""How a foot moves in a walk, in closed form: the truth of a simulated recording.

Model
-----
The foot turns about a *pivot* near the floor; the sensor sits at `lever` from it (body frame, m), so

    position = pivot + nav_R_body lever,    nav_R_body = Rz(yaw) Ry(pitch) Rx(roll),

with x forward, y left, z up; positive pitch points the toe down. In stance the pivot stays where it is but for
the sole, which gives way under the load, and the sensor moves because the foot rolls:
velocity = nav_R_body (rate x lever) + settling.

Pivot and angles are sums of *ramps*, each rising from 0 to its full rise within one phase of a stride as

    S(u) = 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7,    0 <= u <= 1,

whose first three derivatives vanish at both ends: rate and specific force are smooth, and exact at any
instant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.polynomial import Polynomial
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.frames import GRAVITY_M_S2

_STEP = Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
_STEP_DERIVATIVES = (_STEP, _STEP.deriv(1), _STEP.deriv(2))


@dataclass(frozen=True)
class Ramps:
    """Ramps of one phase, one a stride, in order and without overlap.

    `start` (K,) s, `width` (K,) s, `rise` (K, 3) in the unit of what is moved.
    """

    start: Floats
    width: Floats
    rise: Floats

    def at(self, t: Floats, derivative: int = 0) -> Floats:
        """Value (N, 3), or its first or second derivative by time, at `t` (N,) s."""
        k = np.searchsorted(self.start, t, side="right") - 1
        u = np.where(k < 0, 0.0, np.clip((t - self.start[k]) / self.width[k], 0.0, 1.0))
        shape = _STEP_DERIVATIVES[derivative](u) / self.width[k] ** derivative
        value: Floats = shape[:, None] * self.rise[k]
        if derivative == 0:
            value += np.vstack([np.zeros(3), np.cumsum(self.rise, axis=0)])[np.maximum(k, 0)]
        return value


Coordinates: TypeAlias = Sequence[Ramps]
"""Three coordinates that move together: the sum of their ramps."""


def _sum_at(ramps: Coordinates, t: Floats, derivative: int) -> Floats:
    total: Floats = np.sum([r.at(t, derivative) for r in ramps], axis=0)
    return total


@dataclass(frozen=True)
class Kinematics:
    """State of the sensor at N instants.

    `position` (N, 3) m and `velocity` (N, 3) m/s in nav, `nav_R_body` (N, 3, 3), `rate` (N, 3) rad/s and
    specific `force` (N, 3) m/s^2 in the body frame.
    """

    position: Floats
    velocity: Floats
    nav_R_body: Floats
    rate: Floats
    force: Floats


@dataclass(frozen=True)
class FootMotion:
    """A walk of one foot: ramps of the pivot (x, y, z in m) and of the angles (roll, pitch, yaw in rad).

    `lever` (3,) m points from the pivot to the sensor in the body frame.
    """

    pivot: Coordinates
    angles: Coordinates
    lever: Floats

    def at(self, t: Floats) -> Kinematics:
        """Exact state at the instants `t` (N,) s."""
        pivot, pivot_velocity, pivot_acceleration = (_sum_at(self.pivot, t, d) for d in range(3))
        angle, angle_rate, angle_acceleration = (_sum_at(self.angles, t, d) for d in range(3))
        rate, rate_change = _body_rate(angle, angle_rate, angle_acceleration)
        nav_R_body: Floats = Rotation.from_euler("ZYX", angle[:, ::-1]).as_matrix()
        arm_velocity = np.cross(rate, self.lever)
        arm_acceleration = np.cross(rate_change, self.lever) + np.cross(rate, arm_velocity)
        lift = pivot_acceleration + np.array([0.0, 0.0, GRAVITY_M_S2])
        return Kinematics(
            position=pivot + nav_R_body @ self.lever,
            velocity=pivot_velocity + np.einsum("nij,nj->ni", nav_R_body, arm_velocity),
            nav_R_body=nav_R_body,
            rate=rate,
            force=np.einsum("nji,nj->ni", nav_R_body, lift) + arm_acceleration,
        )

    def sampled(self, t: Floats, period_s: float) -> tuple[Floats, Floats]:
        """Rate (N, 3) rad/s and specific force (N, 3) m/s^2 as a sensor has them: means over [t, t + period].

        Two-point Gauss-Legendre quadrature: its error is of fourth order in the period.
        """
        offset = period_s * (0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0))
        early, late = (self.at(t + o) for o in offset)
        return (early.rate + late.rate) / 2, (early.force + late.force) / 2


def _body_rate(angle: Floats, d_angle: Floats, dd_angle: Floats) -> tuple[Floats, Floats]:
    """Body rate (N, 3) and its derivative from roll, pitch, yaw (N, 3) and their derivatives (ZYX order)."""
    (sr, sp, _), (cr, cp, _) = np.sin(angle).T, np.cos(angle).T
    r, p, y = d_angle.T
    rr, pp, yy = dd_angle.T
    rate = np.stack([r - y * sp, p * cr + y * cp * sr, -p * sr + y * cp * cr], axis=1)
    change = np.stack(
        [
            rr - yy * sp - y * p * cp,
            pp * cr - p * r * sr + yy * cp * sr - y * p * sp * sr + y * r * cp * cr,
            -pp * sr - p * r * cr + yy * cp * cr - y * p * sp * cr - y * r * cp * sr,
        ],
        axis=1,
    )
    return rate, change
