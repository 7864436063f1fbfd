"""A minute of walking with a magnetometer that is late, early or turned."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

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
