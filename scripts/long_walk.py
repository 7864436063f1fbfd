"""A simulated walk of any length: rounds of the demonstration's corridor, a rest after each.

Foot, sensor and way are those of the demonstration, with the magnetometer where a field is named. It stands still for
ten seconds a minute: easy to solve, and that is no matter here, for what it measures is time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.lab.simulation import SCENARIOS, Choices, courses, simulate
from fg_nav.lab.simulation.plan import Section, Stand
from fg_nav.recording import Recording, TrajectoryTruth

PAUSE_S = 10.0
SHORTEST_ROUND_S = 55.0
"""A round of 61 strides takes some 57 s, and there is a pause after it."""


def long_walk(minutes: float, seed: int, rate_hz: float = 200.0, field: str | None = None) -> Recording:
    """Walk round the corridor for this long; the truth is the true path.

    Parameters
    ----------
    minutes : duration; the last round is cut off where the time is over, be it in a swing.
    seed : draws gait, biases and noise.
    rate_hz : sample rate.
    field : level of the field, for one with a magnetometer.
    """
    rounds = int(np.ceil(60 * minutes / SHORTEST_ROUND_S))
    demo = SCENARIOS["demo"]
    scenario = replace(
        demo,
        name=f"{rounds} rounds",
        course=lambda _: _course(rounds),
        sensor=demo.sensor if field else replace(demo.prior, mag=None),
        field=field or "homogeneous",
    )
    whole = simulate(scenario, seed, Choices(rate_hz=rate_hz)).recording
    truth, stop = whole.truth, round(60 * minutes * rate_hz)
    assert isinstance(truth, TrajectoryTruth)
    return replace(whole.slice(0, stop), truth=TrajectoryTruth(truth.t[:stop], truth.position[:stop]))


def _course(rounds: int) -> list[Section]:
    rest, around, _ = courses.demo()
    return [rest, *[around, Stand(PAUSE_S)] * rounds]
