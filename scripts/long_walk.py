"""A simulated walk of any length: the built-in demonstration walked again and again, each round drawn anew.

Every round begins and ends with the foot flat, at rest, on the same spot and pointing north, so one joins the other
without a jump of position, attitude, rate or specific force. Gait, footprints and noise differ from round to round;
the biases are those of one sensor. It stands still for six seconds a minute: easy to solve, and that is no matter
here, for what it measures is time.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.recording import Provenance, Recording, TrajectoryTruth
from fg_nav.simulation.demo import DemoSensor, demo_motion


def long_walk(minutes: float, rng: np.random.Generator, rate_hz: float = 200.0) -> Recording:
    """Walk round the corridor for this long; the truth is the true path.

    Parameters
    ----------
    minutes : duration; the last round is cut off where the time is over, be it in a swing.
    rng : source of gait, biases and noise.
    rate_hz : sample rate.
    """
    needed, sensor = round(60 * minutes * rate_hz), DemoSensor()
    rate, force, position = (part[:needed] for part in _rounds(needed, rng, rate_hz))
    return Recording(
        t=np.arange(needed) / rate_hz,
        acc=_measured(force, sensor.acc_bias_m_s2, sensor.acc_noise_m_s2, rng),
        gyr=_measured(rate, sensor.gyr_bias_rad_s, sensor.gyr_noise_rad_s, rng),
        truth=TrajectoryTruth(t=np.arange(needed) / rate_hz, position=position),
        provenance=Provenance(format="demo", notes=("simulated",)),
    )


def _rounds(needed: int, rng: np.random.Generator, rate_hz: float) -> list[Floats]:
    """At least `needed` samples of rate, specific force and position, (N, 3) each."""
    rounds: list[tuple[Floats, Floats, Floats]] = []
    while sum(len(position) for *_, position in rounds) < needed:
        motion, duration_s = demo_motion(rng)
        t = np.arange(int(duration_s * rate_hz) + 1) / rate_hz
        rate, force = motion.sampled(t, 1 / rate_hz)
        position = motion.at(t).position
        rounds.append((rate, force, position - position[0]))
    return [np.concatenate(parts) for parts in zip(*rounds, strict=True)]


def _measured(true: Floats, bias_sd: float, noise_sd: float, rng: np.random.Generator) -> Floats:
    return true + bias_sd * rng.standard_normal(3) + noise_sd * rng.standard_normal(true.shape)
