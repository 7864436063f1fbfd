"""A sensor moved by a hand, by sums of sines: attitudes, and what its sensors read."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from tests.pocket.leg import MUNICH


@dataclass(frozen=True)
class Hand:
    """Attitudes (N + 1, 3, 3) at the stamps and after the last, accelerations (N, 3) in nav, and the period s."""

    attitude: np.ndarray
    acceleration: np.ndarray
    h: float

    def recording(self, rng, bias, scale, hard_iron=np.zeros(3), sigma=(np.radians(0.1), 0.03, 0.5)):
        """What is read with a bias (3,), a scale and misalignment (3, 3) and hard iron (3,); white errors."""
        R, n = self.attitude, len(self.acceleration)
        step = Rotation.from_matrix(np.swapaxes(R[:-1], 1, 2) @ R[1:])
        rate = step.as_rotvec() / self.h
        middle = R[:-1] @ Rotation.from_rotvec(step.as_rotvec() / 2).as_matrix()
        force = np.einsum("nji,nj->ni", middle, self.acceleration + np.array([0, 0, GRAVITY_M_S2]))
        noise = [s * rng.standard_normal((n, 3)) for s in sigma]
        return Recording(
            t=np.arange(n) * self.h,
            acc=force + noise[1],
            gyr=rate + rate @ scale.T + bias + noise[0],
            mag=np.einsum("nji,j->ni", R[:-1], MUNICH) + hard_iron + noise[2],
        )


def moved(rng, seconds, rest_s=3.0, rate_hz=100.0, swing_m=0.15):
    """At rest at first, then turned by some hundred deg/s about all axes, and moved about `swing_m` an axis."""
    h = 1.0 / rate_hz
    t = np.arange(round(seconds * rate_hz) + 1) * h
    since = np.maximum(t - rest_s, 0.0)
    on = np.clip(since / 2.0, 0, 1) ** 2 * (3 - 2 * np.clip(since / 2.0, 0, 1))

    def wave(size, low_hz, high_hz):
        frequency, phase = rng.uniform(low_hz, high_hz, (4, 3)), rng.uniform(0, 2 * np.pi, (4, 3))
        return size / np.sqrt(2) * np.sin(2 * np.pi * t[:, None, None] * frequency + phase).sum(axis=1)

    turned = Rotation.from_rotvec(on[:, None] * wave(0.8, 0.1, 0.6))
    place = on[:, None] * wave(swing_m, 0.3, 1.0)
    acceleration = np.gradient(np.gradient(place, h, axis=0), h, axis=0)
    return Hand(turned.as_matrix(), (acceleration[:-1] + acceleration[1:]) / 2, h)
