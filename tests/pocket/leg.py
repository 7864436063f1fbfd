"""A thigh that swings about a hip at rest, by hand: attitudes, and what a sensor on it reads."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording

BIAS = np.radians([-0.1, 0.1, -0.1])
MUNICH = np.array([0.0, 21.04, -43.14])


@dataclass(frozen=True)
class Leg:
    """Attitudes (N + 1, 3, 3) at the stamps and after the last, and the period s."""

    attitude: np.ndarray
    h: float

    def turned(self, angle):
        """The same walk about up by an angle in rad."""
        return replace(self, attitude=Rotation.from_rotvec([0, 0, angle]).as_matrix() @ self.attitude)

    def recording(self, bias=BIAS, field=MUNICH, nav_rate=(0, 0, 0), sigma=(0.0, 0.0, 0.0), seed=0):
        """Rates with a bias and a turn of nav, gravity alone, and a field; white errors of rate, force and field."""
        rng = np.random.default_rng(seed)
        R = self.attitude
        n = len(R) - 1
        turned = Rotation.from_matrix(R[:-1]).inv() * Rotation.from_matrix(R[1:])
        middle = (Rotation.from_matrix(R[:-1]) * Rotation.from_rotvec(turned.as_rotvec() / 2)).as_matrix()
        gyr = turned.as_rotvec() / self.h + bias + np.einsum("nji,j->ni", middle, np.asarray(nav_rate, dtype=float))
        up = GRAVITY_M_S2 * R[:, 2]
        mag = None if field is None else np.einsum("nji,j->ni", R[:-1], field)
        noise = [s * rng.standard_normal((n, 3)) for s in sigma]
        return Recording(
            t=np.arange(n) * self.h,
            acc=(up[:-1] + up[1:]) / 2 + noise[1],
            gyr=gyr + noise[0],
            mag=None if mag is None else mag + noise[2],
        )


def walking(seconds, rate_hz=100.0, swing_deg=30.0, still_s=1.5, curves=True):
    """z along the thigh: a second and a half at rest, then a swing at 1 Hz, some roll, and curves in yaw."""
    t = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    on = np.clip(t - still_s, 0.0, 1.0)
    s = 2 * np.pi * (t - still_s)
    pitch = on * np.radians(swing_deg) * np.sin(s)
    roll = on * np.radians(5.0) * np.sin(s + 0.8)
    yaw = on * np.radians(6.0) * np.sin(s + 2.0) + (0.7 * np.sin(t / 9.0) if curves else 0.0)
    angles = np.stack([yaw, pitch, roll], axis=1)
    return Leg(Rotation.from_euler("ZYX", angles).as_matrix(), 1.0 / rate_hz)


def resting(seconds, rate_hz=50.0, angles=(0.3, 0.1, -0.2)):
    """A sensor that lies still with this yaw, pitch and roll, rad."""
    R = Rotation.from_euler("ZYX", angles).as_matrix()
    return Leg(np.tile(R, (round(seconds * rate_hz) + 1, 1, 1)), 1.0 / rate_hz)
