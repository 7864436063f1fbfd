"""Sensors moved by hand: a thigh that swings about a hip at rest, and a hand; attitudes, and what is read there."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2, yaw_rotation
from fg_nav.pocket import PocketStart
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import Recording

BIAS = np.radians([-0.1, 0.1, -0.1])
MUNICH = np.array([0.0, 21.04, -43.14])
NOISE = (np.radians(0.1), 0.05, 0.5)  # Of rate, force and field, as of a MEMS sensor.


@dataclass(frozen=True)
class Leg:
    """Attitudes (N + 1, 3, 3) at the stamps and after the last, the period s, and accelerations (N, 3) in nav."""

    attitude: np.ndarray
    h: float
    acceleration: np.ndarray | float = 0.0

    def recording(self, bias=BIAS, field=MUNICH, nav_rate=(0, 0, 0), sigma=(0.0, 0.0, 0.0), seed=0, scale=0.0, iron=0):
        """What is read with a bias, a turn of nav, a scale error (3, 3) and hard iron; white errors of all three."""
        rng = np.random.default_rng(seed)
        R, n = self.attitude, len(self.attitude) - 1
        turned = Rotation.from_matrix(np.swapaxes(R[:-1], 1, 2) @ R[1:]).as_rotvec()
        middle = R[:-1] @ Rotation.from_rotvec(turned / 2).as_matrix()
        rate = turned / self.h + np.einsum("nji,j->ni", middle, np.asarray(nav_rate, dtype=float))
        up = GRAVITY_M_S2 * R[:, 2]
        push = np.einsum("nji,nj->ni", middle, np.broadcast_to(self.acceleration, (n, 3)))
        noise = [s * rng.standard_normal((n, 3)) for s in sigma]
        return Recording(
            t=np.arange(n) * self.h,
            acc=(up[:-1] + up[1:]) / 2 + push + noise[1],
            gyr=rate + rate @ np.broadcast_to(scale, (3, 3)).T + bias + noise[0],
            mag=None if field is None else np.einsum("nji,j->ni", R[:-1], field) + iron + noise[2],
        )


def walking(seconds, rate_hz=100.0, still_s=1.5, curves=True):
    """z along the thigh: a second and a half at rest, then a swing at 1 Hz, some roll, and curves in yaw."""
    t = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    on = np.clip(t - still_s, 0.0, 1.0)
    s = 2 * np.pi * (t - still_s)
    pitch = on * np.radians(30.0) * np.sin(s)
    roll = on * np.radians(5.0) * np.sin(s + 0.8)
    yaw = on * np.radians(6.0) * np.sin(s + 2.0) + (0.7 * np.sin(t / 9.0) if curves else 0.0)
    angles = np.stack([yaw, pitch, roll], axis=1)
    return Leg(Rotation.from_euler("ZYX", angles).as_matrix(), 1.0 / rate_hz)


def resting(seconds, angles=(0.3, 0.1, -0.2)):
    """A sensor that lies still with this yaw, pitch and roll, rad."""
    R = Rotation.from_euler("ZYX", angles).as_matrix()
    return Leg(np.tile(R, (round(seconds * 50.0) + 1, 1, 1)), 1.0 / 50.0)


def waved(rng, seconds):
    """A hand at rest for 3 s, then turned by some hundred deg/s about all axes, and moved about 15 cm an axis."""
    h = 0.01
    t = np.arange(round(seconds / h) + 1) * h
    since = np.clip((t - 3.0) / 2.0, 0, 1)
    on = since**2 * (3 - 2 * since)

    def wave(size, low_hz, high_hz):
        frequency, phase = rng.uniform(low_hz, high_hz, (4, 3)), rng.uniform(0, 2 * np.pi, (4, 3))
        return size / np.sqrt(2) * np.sin(2 * np.pi * t[:, None, None] * frequency + phase).sum(axis=1)

    turned = Rotation.from_rotvec(on[:, None] * wave(0.8, 0.1, 0.6))
    place = on[:, None] * wave(0.15, 0.3, 1.0)
    acceleration = np.gradient(np.gradient(place, h, axis=0), h, axis=0)
    return Leg(turned.as_matrix(), h, (acceleration[:-1] + acceleration[1:]) / 2)


def start_of(leg, offset=0.0, tilt_sigma=0.01):
    """The true attitude at the first sample, turned clockwise by an offset, rad."""
    return PocketStart(yaw_rotation(offset) @ leg.attitude[0], tilt_sigma)


def error_deg_s(track, bias=BIAS):
    return np.degrees(track.gyro_bias[-1] - bias)


def turn_deg(track, leg):
    """Rotation (N, 3) from the truth to the estimate, in nav, deg."""
    return np.degrees(Rotation.from_matrix(track.nav_R_body @ leg.attitude[:-1].transpose(0, 2, 1)).as_rotvec())


def track_of(t, nav_R_body, heading_sigma=0.0):
    """A track with these attitudes (N, 3, 3) and sigmas of the heading, rad, and nothing else."""
    sigma = np.zeros((len(t), 6))
    sigma[:, 2] = heading_sigma
    nothing, none = np.full(len(t), np.nan), np.zeros(1, int)
    return PocketTrack(t, nav_R_body, np.zeros((len(t), 3)), sigma, none, np.zeros((1, 6, 6)), nothing, nothing)


def moved_field(recording, leg, change):
    """The recording in a field that changes by these (N, 3) in nav, uT."""
    return replace(recording, mag=recording.mag + np.einsum("nji,nj->ni", leg.attitude[:-1], change))
