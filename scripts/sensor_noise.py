"""What an Allan deviation finds of the simulated sensors.

    python scripts/sensor_noise.py [--seeds N] [--minutes M]

Each preset lies on a table for an hour (`at-rest`), seeds 101 on. Found over true, median of axes and seeds with the
least and the most: N, K where the preset has a walk and the hour shows it, and the lowest point of the curve, over the
one that noise and drift have by their formulas (`fg_nav.lab.simulation.sensors.drift`).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import figures as fig
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.allan import NoiseFit
from fg_nav.calibration.at_rest import SensorNoise, recording_noise
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.lab.simulation.sensors import preset
from fg_nav.lab.simulation.sensors.triad import TriadPrior

SENSORS = ("xsens-mtw", "lord-gx5", "mpu-9250", "kvh-1750")
FIRST_SEED = 101


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, measure, print."""
    parser = argparse.ArgumentParser(description="What an Allan deviation finds of the simulated sensors.")
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="recordings of a sensor, from seed 101 on")
    parser.add_argument("--minutes", type=float, default=60.0, metavar="M", help="length of a recording")
    chosen = parser.parse_args(arguments)
    rows = []
    for sensor in SENSORS:
        found: dict[str, list[NoiseFit]] = {"gyr": [], "acc": []}
        for seed in range(FIRST_SEED, FIRST_SEED + chosen.seeds):
            for one in at_rest(sensor, seed, chosen.minutes):
                found.get(one.sensor, []).extend(one.fits)
        for name, fits in found.items():
            rows.append((f"{sensor} {name}", f"{len(fits)}", *row(fits, getattr(preset(sensor), name))))
    fig.print_heading(f"Found over true, median [least, most], {chosen.minutes:g} minutes at rest")
    fig.print_table(("sensor", "axes", "N", "K", "K seen", "lowest"), rows)


def at_rest(sensor: str, seed: int, minutes: float) -> tuple[SensorNoise, ...]:
    """Noise of the sensors of a preset that lies still for so long."""
    scenario = replace(SCENARIOS["at-rest"], course=lambda rng: [Stand(60.0 * minutes)])
    return recording_noise(simulate(scenario, seed, Choices(sensor=sensor)).recording).sensors


def row(fits: Sequence[NoiseFit], prior: TriadPrior) -> tuple[str, str, str, str]:
    """Ratios of what was found to what is true."""
    white = np.array([fit.white.value for fit in fits]) / prior.noise_density
    walks = [fit.walk.value for fit in fits if fit.walk.seen]
    lowest = np.array([fit.lowest for fit in fits]) / true_deviation(np.geomspace(0.1, 900.0, 200), prior).min()
    walk = spread(np.array(walks) / prior.drift.walk) if prior.drift.walk else "-"
    return spread(white), walk, f"{len(walks)} of {len(fits)}", spread(lowest)


def true_deviation(tau_s: Floats, prior: TriadPrior) -> Floats:
    """Allan deviation of white noise, a Gauss-Markov process and a walk."""
    d, x = prior.drift, tau_s / prior.drift.time_s
    markov = d.sd**2 / x**2 * (2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x))
    return np.asarray(np.sqrt(prior.noise_density**2 / tau_s + markov + d.walk**2 * tau_s / 3))


def spread(ratios: Floats) -> str:
    """Median [least, most]."""
    if not len(ratios):
        return "-"
    return f"{np.median(ratios):.2f} [{ratios.min():.2f}, {ratios.max():.2f}]"


if __name__ == "__main__":
    fig.leave_with(main)
