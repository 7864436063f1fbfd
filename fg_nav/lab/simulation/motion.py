"""The motion of a sensor, exact at any instant: strides, poses, and the smooth pieces in closed form they are made of.

`Strides` is what a plan of a walk comes down to, and all that foot and thigh share. A `Motion` is known in closed form,
so rate and specific force are exact derivatives of the pose. A sensor records the *mean* over its sample period
[t, t + period] (an integrating sensor, or one behind an anti-alias filter): steps of constant rate and force then
reproduce the pose to second order in the period.

A *ramp* takes a coordinate from 0 to its rise within [start, start + width],

    S(u) = 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7,    u = (t - start) / width in [0, 1],

and leaves it there. The first three derivatives of S vanish at both ends, so a sum of ramps has a continuous
third derivative: rate and specific force are smooth. Its velocity is a bell; bells side by side make any curve. A
rise that is taken back at once is a shock, which leaves neither velocity nor position behind.

At rising instants a pointer moves along with t; each value depends on its t alone, however the instants are cut
into blocks.

Foot and thigh are rigid bodies (frame b: x forward, y left, z up) that turn about a point p0; the sensor sits at a
lever r from it:

    p = p0 + nav_R_b r,    nav_R_b = Rz(yaw) Ry(pitch) Rx(roll),    nav_R_body = nav_R_b b_R_body.

With w the rate of b in its own frame the derivatives by time are exact:

    v = p0' + nav_R_b (w x r),    f = nav_R_b^T (p0'' + g up) + w' x r + w x (w x r).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Protocol

import numpy as np

from fg_nav.arrays import Brief, Floats, Ints
from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.system.compiled import njit


class Style(IntEnum):
    """The manner of a stride; the gait of a person has parameters for each."""

    WALK = 0
    RUN = 1
    STAIRS_UP = 2
    STAIRS_DOWN = 3
    TURN = 4  # on the spot


@dataclass(frozen=True)
class Strides(Brief):
    """K strides of one foot; in pauses between them it stands."""

    start: Floats  # (K,) s, heel-off; start[k] + duration[k] <= start[k + 1], the rest is standing.
    duration: Floats  # (K,) s to the end of the stance after the swing.
    footprint: Floats  # (K + 1, 3) m, before stride 0 and after each; z is the height of the floor.
    heading: Floats  # (K + 1,) rad clockwise from north, of the foot at each footprint; unwrapped.
    style: Ints  # (K,) of `Style`.
    end_s: float  # When the recording ends; the foot stands from the last stride's end to then.

    def __len__(self) -> int:
        return len(self.start)


@dataclass(frozen=True)
class Kinematics:
    """State of the sensor at N instants."""

    position: Floats  # (N, 3) m in nav.
    velocity: Floats  # (N, 3) m/s in nav.
    nav_R_body: Floats  # (N, 3, 3).
    rate: Floats  # (N, 3) rad/s in the body frame.
    force: Floats  # (N, 3) m/s^2, specific, in the body frame.


def compute_kinematics(moved: Floats, lever_m: Floats, b_R_body: Floats) -> Kinematics:
    """State of a sensor on a rigid body whose point and roll, pitch, yaw (3, N, 6) come with two derivatives."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(moved[0, :, 3:]).T, np.cos(moved[0, :, 3:]).T
    (r, p, y), (rr, pp, yy) = moved[1, :, 3:].T, moved[2, :, 3:].T
    nav_R_b = np.empty((moved.shape[1], 3, 3))
    nav_R_b[:, 0] = np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], axis=1)
    nav_R_b[:, 1] = np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], axis=1)
    nav_R_b[:, 2] = np.stack([-sp, cp * sr, cp * cr], axis=1)
    # rate in b and its derivative
    w = np.stack([r - y * sp, p * cr + y * cp * sr, -p * sr + y * cp * cr], axis=1)
    p_change = pp * cr - p * r * sr + yy * cp * sr - y * p * sp * sr + y * r * cp * cr
    y_change = -pp * sr - p * r * cr + yy * cp * cr - y * p * sp * cr - y * r * cp * sr
    dw = np.stack([rr - yy * sp - y * p * cp, p_change, y_change], axis=1)
    arm_velocity = _cross(w, lever_m)
    lift = moved[2, :, :3] + [0.0, 0.0, GRAVITY_M_S2]
    force = np.einsum("nji,nj->ni", nav_R_b, lift) + _cross(dw, lever_m) + _cross(w, arm_velocity)
    return Kinematics(
        position=moved[0, :, :3] + nav_R_b @ lever_m,
        velocity=moved[1, :, :3] + np.einsum("nij,nj->ni", nav_R_b, arm_velocity),
        nav_R_body=nav_R_b @ b_R_body,
        rate=w @ b_R_body,
        force=force @ b_R_body,
    )


def _cross(a: Floats, b: Floats) -> Floats:
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def average_over_period(motion: Motion, t: Floats, period_s: float, nodes: int) -> tuple[Floats, Floats]:
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


@dataclass(frozen=True)
class Ramps:
    """One coordinate that M ramps move: `start`, `width` (M,) s, in order of `start`; `rise` (M,) in its unit.

    They may overlap. `begun_at` is the value before the first.
    """

    start: Floats
    width: Floats
    rise: Floats
    begun_at: float = 0.0

    @classmethod
    def of(cls, start: Floats, width: Floats, rise: Floats, begun_at: float = 0.0) -> Ramps:
        """Ramps in any order; those that rise by nothing are left out."""
        kept = np.flatnonzero(rise)
        order = kept[np.argsort(start[kept], kind="stable")]
        return cls(start[order], width[order], rise[order], begun_at)

    def at(self, t: Floats) -> Floats:
        """Value, first and second derivative by time (3, N) at rising `t` (N,) s."""
        if len(t) > 1 and not (t[1:] >= t[:-1]).all():
            late = int(np.argmin(t[1:] >= t[:-1])) + 1
            raise SimulationError(f"instant {late} ({t[late]:.3f} s) is before the one ahead of it: sort the instants.")
        return np.asarray(_ramps_at(t, self.start, self.width, self.rise, self._done, self._over))

    @cached_property
    def _done(self) -> Floats:
        """Value (M + 1,) when the first 0, 1, ... M are over."""
        return self.begun_at + np.concatenate([[0.0], np.cumsum(self.rise)])

    @cached_property
    def _over(self) -> Floats:
        """When each and all before it are over (M,): they differ in width, so later ones may end first."""
        return np.maximum.accumulate(self.start + self.width)


@njit(cache=True)
def _ramps_at(t: Floats, start: Floats, width: Floats, rise: Floats, done: Floats, over: Floats) -> Floats:
    out = np.zeros((3, len(t)))
    first = stop = np.searchsorted(over, t[0], side="right") if len(t) else 0
    for n in range(len(t)):
        # move the window of ramps that are begun and not over on to this instant
        while first < len(over) and over[first] <= t[n]:
            first += 1
        stop = max(stop, first)
        while stop < len(start) and start[stop] < t[n]:
            stop += 1
        value, slope, bend = done[first], 0.0, 0.0
        for k in range(first, stop):
            u = (t[n] - start[k]) / width[k]
            if u >= 1.0:
                value += rise[k]
                continue
            v = 1.0 - u
            uv = u * v
            value += rise[k] * u * u * u * u * (35.0 - u * (84.0 - u * (70.0 - 20.0 * u)))
            slope += rise[k] / width[k] * 140.0 * uv * uv * uv
            bend += rise[k] / (width[k] * width[k]) * 420.0 * uv * uv * (v - u)
        out[0, n], out[1, n], out[2, n] = value, slope, bend
    return out
