"""A minute of walking with a magnetometer that is late, early or turned; and a sensor that a hand turns over."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.lab.simulation.scenarios import scenario
from fg_nav.lab.simulation.sensors import IronPrior, preset
from fg_nav.recording import Recording

IRON = IronPrior(hard_uT=(20.0, -15.0, 10.0), soft_sd=0.04)


@cache
def minute(
    seed: int,
    lag_s: float = 0.0,
    field: str = "indoor",
    rate_hz: float = 200.0,
    chip_hz: float = np.inf,
    held: bool = False,
    iron: IronPrior = IRON,
) -> Recording:
    """Round the corridor of the demonstration, with the noise of an industrial sensor and the iron of a shoe."""
    prior = preset("lord-gx5-900").with_iron(iron)
    assert prior.mag is not None
    prior = replace(prior, mag=replace(prior.mag, lag_s=lag_s, rate_hz=chip_hz, held=held))
    course = replace(scenario("demo"), sensor=prior, field=field)
    return simulate(course, seed, Choices(rate_hz=rate_hz)).recording


def make_early(recording: Recording, rows: int) -> Recording:
    """Let the magnetometer be earlier by so many rows."""
    assert recording.mag is not None
    t, acc, gyr = recording.t[:-rows], recording.acc[:-rows], recording.gyr[:-rows]
    return Recording(t, acc, gyr, recording.mag[rows:])


EARTH = np.array([0.0, 21.0, -43.0])  # uT, in nav.
HARD_IRON = np.array([14.0, -8.0, 5.0])
SOFT_IRON = np.array([[1.08, 0.03, 0.0], [0.03, 0.95, -0.02], [0.0, -0.02, 1.01]])


def tumble(rate_hz: float = 100.0) -> Recording:
    """A sensor turned over in all directions for a minute, with iron about it; it never walks."""
    rng = np.random.default_rng(1)
    t = np.arange(int(60.0 * rate_hz)) / rate_hz
    rate = np.stack([np.sin(0.31 * t), np.cos(0.23 * t), 0.7 * np.sin(0.17 * t + 1.0)], axis=1)
    attitude = [np.eye(3)]
    for turn in Rotation.from_rotvec(rate[:-1] / rate_hz).as_matrix():
        attitude.append(attitude[-1] @ turn)
    acc, field = (np.swapaxes(attitude, 1, 2) @ one for one in (np.array([0.0, 0.0, GRAVITY_M_S2]), EARTH))
    acc = acc + 0.02 * rng.normal(size=(len(t), 3))
    return Recording(t, acc, rate, field @ SOFT_IRON.T + HARD_IRON + 0.3 * rng.normal(size=(len(t), 3)))
