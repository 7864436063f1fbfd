"""Straight simulated walks of any gait, with the truth a detector is judged by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.recording import Recording
from fg_nav.simulation.gait import FootMotion
from fg_nav.simulation.strides import Gait, Strides, foot_motion

WALKING = Gait()
RUNNING = Gait(
    stride_m=2.4,
    stride_s=0.72,
    swing_share=0.80,  # 0.14 s on the ground
    toe_down_rad=np.radians(75.0),
    toe_up_rad=np.radians(15.0),
    stance_pitch_rad=np.radians(8.0),
    clearance_m=0.3,
)
ACC_NOISE_M_S2, GYR_NOISE_RAD_S = 0.03, np.radians(0.1)


@dataclass(frozen=True)
class SimulatedWalk:
    """A recording, how the foot moved, and between which times it swung: `swing` (K, 2) s."""

    recording: Recording
    motion: FootMotion
    swing: Floats

    @property
    def speed(self) -> Floats:
        """True speed (N,) m/s of the sensor at each sample."""
        return np.linalg.norm(self.motion.at(self.recording.t).velocity, axis=1)

    def part(self, start: int, stop: int) -> SimulatedWalk:
        """The samples `start <= i < stop`, and the swings that lie in them as a whole."""
        recording = self.recording.slice(start, stop)
        whole = (self.swing[:, 0] >= recording.t[0]) & (self.swing[:, 1] <= recording.t[-1])
        return SimulatedWalk(recording, self.motion, self.swing[whole])


def simulate(
    gait: Gait = WALKING,
    strides: int = 12,
    standing_s: float = 2.0,
    rate_hz: float = 200.0,
    noise: float = 1.0,
    seed: int = 0,
) -> SimulatedWalk:
    """Straight ahead, `standing_s` before and after; `noise` scales that of the sensor."""
    rng = np.random.default_rng(seed)
    duration = gait.stride_s * (1 + gait.variation * rng.standard_normal(strides))
    start = standing_s + np.concatenate([[0.0], np.cumsum(duration[:-1])])
    footprint = np.zeros((strides + 1, 2))
    footprint[1:, 1] = np.cumsum(gait.stride_m * (1 + gait.variation * rng.standard_normal(strides)))
    motion = foot_motion(Strides(start, duration, footprint, np.zeros(strides + 1)), gait, rng)
    t = np.arange(round((start[-1] + duration[-1] + standing_s) * rate_hz)) / rate_hz
    gyr, acc = motion.sampled(t, 1 / rate_hz)
    acc += noise * ACC_NOISE_M_S2 * rng.standard_normal(acc.shape)
    gyr += noise * GYR_NOISE_RAD_S * rng.standard_normal(gyr.shape)
    swing = np.stack([start, start + gait.swing_share * duration], axis=1)
    return SimulatedWalk(Recording(t=t, acc=acc, gyr=gyr), motion, swing)


def mounted(recording: Recording, body_R_sensor: Rotation) -> Recording:
    """What the same sensor reads when it is mounted turned."""
    acc, gyr = (body_R_sensor.inv().apply(samples) for samples in (recording.acc, recording.gyr))
    return Recording(t=recording.t, acc=acc, gyr=gyr)
