"""Where filters without a magnetometer end on the simulated `office`, beside Ma et al. 2018, Figure 10a.

    python scripts/simulated_drift.py [--seeds N] [--jobs N] [--json FILE]

Three loops, 1018 m, in the shoe's heel if nothing else is said; the sensor is

============ ===================================================================================================
calibrated   `mpu-9250x8`: eight units averaged, each calibrated without a turntable
raw          eight units as they come out of the bag
perfect      no errors at all: what the foot alone does to an estimator
============ ===================================================================================================

Final heading error is that of the heading's change from first to last sample; the end error is the distance from the
true end, the start laid on the start (closure, since the walk ends where it began). Medians over the seeds, and the
5th and 95th percentile. The seeds begin at 101: those below were looked at while the simulator was made.

"Of the same order" is taken as within a factor of three of the paper's 14 degrees and 2 metres.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import figures as fig
import numpy as np
from figures import Figure

from fg_nav.arrays import Floats
from fg_nav.frames import heading_of, wrap, yaw_rotation
from fg_nav.lab.simulation import SCENARIOS, Scenario, simulate
from fg_nav.lab.simulation.sensors import SensorPrior, preset
from fg_nav.recording import TrajectoryTruth
from fg_nav.report.terminal import progress
from fg_nav.session import Outcome, prepare, solve

FIRST_SEED, SEEDS = 101, 20
METHODS = ("iez", "smoother")
PAPER_DEG, PAPER_M, SAME_ORDER = 14.0, 2.0, 3.0


@dataclass(frozen=True)
class End:
    """Where a method ended: error of heading (deg), over the ground and in height (m)."""

    heading_deg: float
    over_ground_m: float
    height_m: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, solve, print."""
    chosen = _parse(arguments)
    seeds = range(FIRST_SEED, FIRST_SEED + chosen.seeds)
    found = {name: ends(one, seeds, chosen.jobs) for name, one in cases().items()}
    print_ends(found)
    figures = judged(found["calibrated"]["iez"])
    fig.print_verdict(figures)
    if chosen.json:
        fig.write_json(chosen.json, {"figures": [f.as_dict() for f in figures]})


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Drift of filters without a magnetometer on the simulated office.")
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=f"how many walks ({SEEDS})")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (2)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to this file")
    return parser.parse_args(arguments)


def cases() -> dict[str, Scenario]:
    """The walks that are compared, by the words of the table."""
    calibrated, raw = preset("mpu-9250x8"), replace(preset("mpu-9250-raw"), units=8)
    return {
        "calibrated": office(calibrated),
        "calibrated, on the instep": replace(office(calibrated), worn="instep"),
        "raw": office(raw),
        "perfect": office(preset("ideal").at_rate(raw.rate_hz)),
    }


def office(prior: SensorPrior) -> Scenario:
    """Return the scenario with this sensor, without its magnetometer: no method here uses one."""
    return replace(SCENARIOS["office"], sensor=replace(prior, mag=None), field="homogeneous")


def ends(scenario: Scenario, seeds: Sequence[int], jobs: int) -> dict[str, list[End]]:
    """Ends of every method, one a seed."""
    found: list[dict[str, End]] = []
    with progress(scenario.prior.name) as report, ProcessPoolExecutor(jobs) as pool:
        for end in pool.map(partial(ends_of, scenario), seeds):
            found.append(end)
            report(len(found) / len(seeds))
    return {method: [end[method] for end in found] for method in METHODS}


def ends_of(scenario: Scenario, seed: int) -> dict[str, End]:
    """Ends of all methods on one walk and the same stances."""
    session = prepare(simulate(scenario, seed).recording)
    return {method: end_of(solve(session, method), session.recording.truth) for method in METHODS}


def end_of(outcome: Outcome, truth: object) -> End:
    """Errors at the last sample, the first laid on the truth."""
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    solution = outcome.solution
    turned = heading_change(solution.nav_R_body) - heading_change(truth.nav_R_body)
    first = float(heading_of(truth.nav_R_body[0]) - heading_of(solution.nav_R_body[0]))
    moved = yaw_rotation(-first) @ (solution.position[-1] - solution.position[0])
    error = moved - (truth.position[-1] - truth.position[0])
    return End(float(np.rad2deg(wrap(np.array(turned)))), float(np.hypot(error[0], error[1])), float(error[2]))


def heading_change(nav_R_body: Floats) -> float:
    """From the first to the last attitude of (N, 3, 3), rad clockwise."""
    first, last = heading_of(nav_R_body[[0, -1]])
    return float(last - first)


def print_ends(found: Mapping[str, Mapping[str, Sequence[End]]]) -> None:
    """One row a sensor and method."""
    count = len(found["calibrated"]["iez"])
    fig.print_heading(f"office, {count} seeds: median of the size (5 % to 95 %)")
    rows = [("Ma 2018, Figure 10a", "pure ZUPT", f"{PAPER_DEG:g}", f"{PAPER_M:g}", "-")]
    for sensor, methods in found.items():
        rows += [(sensor, method, *_spread(some)) for method, some in methods.items()]
    fig.print_table(("sensor", "method", "final heading (deg)", "end (m)", "height (m)"), rows)


def _spread(some: Sequence[End]) -> tuple[str, str, str]:
    columns = np.array([(end.heading_deg, end.over_ground_m, end.height_m) for end in some]).T
    low, middle, high = np.percentile(np.abs(columns), [5, 50, 95], axis=1)
    words = [f"{m:.2g} ({a:.2g} to {b:.2g})" for a, m, b in zip(low, middle, high, strict=True)]
    return words[0], words[1], words[2]


def judged(some: Sequence[End]) -> list[Figure]:
    """The filter on the calibrated module against the paper."""
    heading = float(np.median(np.abs([end.heading_deg for end in some])))
    end = float(np.median([end.over_ground_m for end in some]))
    return [
        Figure(
            "office", "final heading, deg", "iez", heading, PAPER_DEG / SAME_ORDER, PAPER_DEG * SAME_ORDER, "{:.1f}"
        ),
        Figure("office", "end, m", "iez", end, PAPER_M / SAME_ORDER, PAPER_M * SAME_ORDER, "{:.1f}"),
    ]


if __name__ == "__main__":
    fig.leave_with(main)
