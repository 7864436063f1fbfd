"""A walk in closed form, and what a perfect sensor on the foot reads.

The pivot moves in the swings and stands in the stances; the sensor is `height` above it and tilts about it:

    position = pivot + R (0, 0, height),   R = Rz(yaw) Ry(pitch),
    body rate = (-sin(pitch) yaw', pitch', cos(pitch) yaw')

A sample is the mean of rate and specific force over its period (Gauss-Legendre of four points).
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from fg_nav.arrays import Floats
from fg_nav.detection.stance import Stances
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording

RISE = Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
BUMP = Polynomial([0, 1]) ** 4 * Polynomial([1, -1]) ** 4 * 256
GAUSS, WEIGHT = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class Walk:
    """`strides` of `stride_m`, after `rest_s` at rest; each swing turns the foot by `turn` rad."""

    strides: int = 10
    stride_m: float = 1.3
    rest_s: float = 2.0
    stance_s: float = 0.4
    swing_s: float = 0.6
    turn: float = 0.2
    pitch: float = 0.7
    roll: float = 0.0  # pitch at heel strike, taken back during the stance, rad
    height: float = 0.0

    @property
    def duration_s(self) -> float:
        return self.rest_s + self.strides * (self.stance_s + self.swing_s)

    def phase(self, t: Floats) -> tuple[Floats, Floats, Floats]:
        """Swings done, phase of the swing and of the stance that follows it, each held at 0 or 1 outside."""
        cycle = self.stance_s + self.swing_s
        done = np.clip(np.floor((t - self.rest_s) / cycle), 0, self.strides - 1)
        since = t - self.rest_s - done * cycle
        return (
            done,
            np.clip(since / self.swing_s, 0, 1),
            np.clip((since - self.swing_s) / self.stance_s, 0, 1),
        )

    def stands(self, t: Floats) -> np.ndarray:
        _, swing, _ = self.phase(t)
        return (swing == 0) | (swing == 1)

    def _angle(self, t: Floats, order: int) -> tuple[Floats, Floats]:
        """Yaw and pitch, or their derivatives by time."""
        done, swing, stance = self.phase(t)
        in_swing, in_stance = RISE.deriv(order)(swing), RISE.deriv(order)(stance)
        if order:
            in_swing = in_swing / self.swing_s**order
            in_stance = in_stance / self.stance_s**order
        yaw = self.turn * (in_swing + (done if order == 0 else 0))
        bump = BUMP.deriv(order)(swing) / self.swing_s**order if order else BUMP(swing)
        return yaw, self.pitch * bump + self.roll * (in_swing - in_stance)

    def attitude(self, t: Floats) -> Floats:
        yaw, pitch = self._angle(t, 0)
        c, s, cp, sp, o = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch), np.zeros_like(yaw)
        return np.stack(
            [
                np.stack([c * cp, -s, c * sp], -1),
                np.stack([s * cp, c, s * sp], -1),
                np.stack([-sp, o, cp], -1),
            ],
            -2,
        )

    def rate(self, t: Floats) -> Floats:
        yaw_rate, pitch_rate = self._angle(t, 1)
        _, pitch = self._angle(t, 0)
        return np.stack([-np.sin(pitch) * yaw_rate, pitch_rate, np.cos(pitch) * yaw_rate], -1)

    def pivot(self, t: Floats, order: int = 0) -> Floats:
        done, swing, _ = self.phase(t)
        course = self.turn * (done + 0.5)  # of the stride under way
        shape, lift = RISE.deriv(order)(swing), BUMP.deriv(order)(swing)
        if order:
            shape, lift = shape / self.swing_s**order, lift / self.swing_s**order
        path = np.stack(
            [self.stride_m * shape * np.cos(course), self.stride_m * shape * np.sin(course), 0.1 * lift], -1
        )
        if order == 0:
            steps = self.stride_m * np.exp(1j * self.turn * (np.arange(self.strides) + 0.5))
            start = np.concatenate([[0], np.cumsum(steps)])[done.astype(int)]
            path[..., 0] += start.real
            path[..., 1] += start.imag
        return path

    def position(self, t: Floats) -> Floats:
        return self.pivot(t) + self.height * self.attitude(t)[..., 2]

    def velocity(self, t: Floats) -> Floats:
        arm = self.height * np.array([0.0, 0.0, 1.0])
        swing = np.cross(self.rate(t), arm)
        return self.pivot(t, 1) + np.einsum("...ij,...j", self.attitude(t), swing)

    def force(self, t: Floats) -> Floats:
        up = np.array([0.0, 0.0, GRAVITY_M_S2])
        pulled = np.einsum("...ji,...j", self.attitude(t), self.pivot(t, 2) + up)
        if self.height == 0.0:
            return pulled
        step = 1e-4  # the acceleration of the arm by a central difference of its exact velocity
        arm = (self.velocity(t + step) - self.pivot(t + step, 1)) - (self.velocity(t - step) - self.pivot(t - step, 1))
        return pulled + np.einsum("...ji,...j", self.attitude(t), arm / (2 * step))

    def samples(self, t: Floats, h: float) -> tuple[Floats, Floats]:
        """Means of specific force and rate (N, 3) over the periods from each stamp on."""
        at = t[:, None] + h * (GAUSS + 1) / 2
        return (self.force(at) * WEIGHT[:, None]).sum(1) / 2, (self.rate(at) * WEIGHT[:, None]).sum(1) / 2

    def recording(self, rate_hz: float = 200.0) -> tuple[Recording, Stances]:
        t = np.arange(round(self.duration_s * rate_hz)) / rate_hz
        acc, gyr = self.samples(t, 1 / rate_hz)
        return Recording(t=t, acc=acc, gyr=gyr), Stances.from_mask(self.stands(t) & self.stands(t + 1 / rate_hz))
