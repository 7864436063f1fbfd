"""The motion of a sensor as the truth of a simulation: its pose and what an ideal sensor would feel, at any instant.

A `Motion` is known in closed form, so rate and specific force are exact derivatives of the pose. What a sensor
records is the *mean* over its sample period [t, t + period] (an integrating sensor, or one behind an anti-alias
filter): steps of constant rate and force then reproduce the pose to second order in the period.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fg_nav.arrays import Floats


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


def mean_over_period(motion: Motion, t: Floats, period_s: float, nodes: int) -> tuple[Floats, Floats]:
    """Rate (N, 3) rad/s and specific force (N, 3) m/s^2, each the mean over [t, t + period].

    By Gauss-Legendre quadrature, whose error is of order 2 `nodes` in the period.
    """
    node, weight = np.polynomial.legendre.leggauss(nodes)
    rate, force = np.zeros((2, len(t), 3))
    for x, w in zip(node, weight / 2, strict=True):
        state = motion.at(t + period_s * (1 + x) / 2)
        rate += w * state.rate
        force += w * state.force
    return rate, force


class Motion(Protocol):
    """What moves a sensor."""

    def at(self, t: Floats) -> Kinematics:
        """Exact state at rising instants `t` (N,) s."""
        ...

    def sampled(self, t: Floats, period_s: float) -> tuple[Floats, Floats]:
        """Rate (N, 3) rad/s and specific force (N, 3) m/s^2, each the mean over [t, t + period]."""
        ...
