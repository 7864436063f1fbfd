"""What is known of sensor, mounting and walk before the graph is built."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration import RollingLever, estimate_lever
from fg_nav.detection import Rest
from fg_nav.recording import Recording
from fg_nav.smoother.noise_level import SwingNoise, swing_noise
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.stances import Stances
from fg_nav.wording import counted


@dataclass(frozen=True)
class Known:
    """Gyro bias (3,) rad/s to start from and the sigma of its prior about zero, rests, lever, noise of a swing."""

    gyro_bias: Floats
    gyro_bias_sigma: float
    rests: tuple[Rest, ...]
    lever: RollingLever
    swing: SwingNoise

    @property
    def notes(self) -> tuple[str, ...]:
        """The same in words."""
        return (_bias_note(self), _lever_note(self.lever), self.swing.note)


def known_before(recording: Recording, stances: Stances, rests: tuple[Rest, ...], p: SmootherParameters) -> Known:
    """Gather it from rests and stances."""
    bias, sigma = _bias_from_rests(rests, np.radians(p.gyro_bias_sigma_deg_s))
    if p.known_lever is not None:
        lever = RollingLever(np.array(p.known_lever), np.zeros((3, 3)), 0)
    else:
        lever = estimate_lever(recording, stances)
    swing = SwingNoise(p.gyr_relative_density, "swing noise as told")
    if p.choose_swing_noise:
        swing = swing_noise(recording, stances, bias, sigma, lever.lever, p)
    return Known(bias, sigma, rests, lever, swing)


def _bias_from_rests(rests: tuple[Rest, ...], prior_sigma: float) -> tuple[Floats, float]:
    """Bias (3,) to start from and the sigma of its prior about zero, rad/s.

    Rests that show a bias far outside the prior show a sensor that was not calibrated: the prior widens to it.
    """
    if not rests:
        return np.zeros(3), prior_sigma
    weight = np.array([rest.sigma**-2 for rest in rests])
    mean = weight @ np.array([rest.rate for rest in rests]) / weight.sum()
    sigma = float(np.hypot(prior_sigma, np.linalg.norm(mean)))
    return mean * sigma**2 / (sigma**2 + 1 / weight.sum()), sigma


def _bias_note(known: Known) -> str:
    if not known.rests:
        return "gyro bias from the walk alone, there is no rest in it"
    bias = np.round(np.degrees(known.gyro_bias), 3).tolist()
    return f"gyro bias {bias} deg/s from {counted(len(known.rests), 'rest')}"


def _lever_note(lever: RollingLever) -> str:
    if not lever.lever.any():
        return "sensor taken to stand where the foot rolls: plain zero velocity"
    x, y, z = lever.lever * 1000
    return f"sensor at ({x:.0f}, {y:.0f}, {z:.0f}) mm from the point about which the foot rolls, body axes"
