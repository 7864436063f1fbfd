"""Tune the filters on simulated walks: the preset `tuned` of `fg_nav.ekf.presets`.

    python scripts/tune_filters.py [--seeds N] [--methods NAME ...] [--jobs N]

One preset a method for all scenarios and fields, for a user does not know the field. Calibrated magnetometer, true
heading at the start, position and heading of the start laid on the truth. On every walk

    e = rmse over the ground at the footfalls + error over the ground at the last, m
    loss of a walk = ln(e / e of the IEZ in its physical preset on that walk)

and the loss is the mean over all walks, so that its exponential is a geometric mean of ratios: an estimate without the
field has 1. The search varies one parameter after the other over a fixed grid, from each of two starts, until a round
changes nothing; then every value of every parameter is tried beside the best, which shows how flat it is. The largest
sigma of the compass all but turns it off, so no method can be tuned to be worse than the IEZ.

Seeds 1 to 12 are for tuning, 31 to 36 held out (`compare_ekf.py --first 31 --seeds 6`, presets side by side); those
from 101 on are left to the reports.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, cast

import harness
import numpy as np
from experiments import find_truth, give_heading
from harness import option

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.ekf import run_iez
from fg_nav.ekf.compass import GatedCompassParameters, run_with_compass
from fg_nav.ekf.presets import PHYSICAL, find_parameters
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.magnetic import average_footfall_field
from fg_nav.magnetic.detectors import scale_detector
from fg_nav.solution import Solution
from fg_nav.walk import Walk

SCENARIOS, FIELDS = ("teaching-building", "office", "mall"), ("smooth", "indoor")

Point = Mapping[str, float]
"""Parameter -> value; what is not named is as in the preset `physical`. `allowance` and `window`: `scale_detector`."""
Grid = Mapping[str, tuple[float, ...]]

SIGMAS_DEG = (5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 45.0, 90.0)
ALLOWANCES = (0.5, 0.7, 1.0, 1.4, 2.0, 4.0, 8.0, 16.0, 32.0)
COMPASS_GRID: Grid = {"compass_sigma_deg": SIGMAS_DEG, "allowance": ALLOWANCES, "window": (1, 2, 3, 5)}
COURSE = {"course_sigma_deg": (2.0, 4.0, 8.0, 16.0, 90.0), "course_limit_deg": (1.2, 2.5, 5.0)}
GRIDS: Mapping[str, Grid] = {
    **dict.fromkeys(("qsf", "iqsf", "ma2018", "qsf-stance"), COMPASS_GRID),
    "aiez": {"compass_sigma_deg": SIGMAS_DEG, **COURSE, "allowance": ALLOWANCES},
}
STARTS: Sequence[Point] = ({}, {"allowance": 8.0, "compass_sigma_deg": 20.0})
"""The physical values, and a gate that passes nearly all with a weaker compass."""
ROUNDS = 4  # of the search, at most


def main(arguments: Sequence[str] | None = None) -> None:
    """Search, and print every value beside the best one."""
    seeds = option(3, "walks of a scenario", type=int, choices=range(1, 13), metavar="N")
    chosen = harness.parse_arguments(__doc__, arguments, seeds=seeds, scenarios=SCENARIOS, methods=tuple(GRIDS), jobs=2)
    cases = [
        (name, seed, level) for name in chosen.scenarios for seed in range(1, chosen.seeds + 1) for level in FIELDS
    ]
    walks = harness.map_walks(simulate_case, cases, chosen.jobs)
    for method in chosen.methods:
        # the physical values belong to the grid
        physical = cast("GatedCompassParameters", find_parameters(method, PHYSICAL))
        own = {"allowance": 1.0, "window": physical.detector.window}
        begin = {name: float(own[name] if name in own else getattr(physical, name)) for name in GRIDS[method]}
        grid = {name: tuple(sorted({*values, begin[name]})) for name, values in GRIDS[method].items()}
        bench = Bench(method, walks, chosen.jobs)
        ends = [bench.descend(grid, {**begin, **start}) for start in STARTS]
        best = ends[int(np.argmin(bench.measure(ends)))]
        # every value of every parameter beside the best; the best is marked
        harness.print_heading(f"{method}: error over the IEZ's (geometric mean of {len(cases)} walks)")
        lines = []
        for name, values in grid.items():
            losses = bench.measure([{**best, name: value} for value in values])
            marks = ["*" if loss == min(losses) else "" for loss in losses]
            shown = [
                f"{value:g}: {np.exp(loss):.3f}{mark}" for value, loss, mark in zip(values, losses, marks, strict=True)
            ]
            lines.append((name, "  ".join(shown)))
        harness.print_table(("parameter", "value: ratio"), lines)


@dataclass(frozen=True)
class Walked:
    """A simulated walk as a filter sees it; `truth` (F, 2) m at the footfalls, and the error of the IEZ, m."""

    walk: Walk
    truth: Floats
    iez_m: float


@dataclass(frozen=True)
class Bench:
    """Runs a method on all walks, and remembers its losses by their points."""

    method: str
    walks: Sequence[Walked]
    jobs: int
    known: dict[str, float] = field(default_factory=dict)

    def measure(self, points: Sequence[Point]) -> list[float]:
        """Loss at each point."""
        new = {f"{point}": point for point in points if f"{point}" not in self.known}
        if new:
            measure = partial(measure_losses, self.method, list(new.values()))
            losses = np.mean(harness.map_walks(measure, self.walks, self.jobs, "trials"), axis=0)
            self.known.update(zip(new, losses.tolist(), strict=True))
        return [self.known[f"{point}"] for point in points]

    def descend(self, grid: Grid, point: Point) -> Point:
        """Search along one parameter after the other until a round changes nothing."""
        for _ in range(ROUNDS):
            before = point
            for name, values in grid.items():
                losses = self.measure([{**point, name: value} for value in values])
                point = {**point, name: values[int(np.argmin(losses))]}
            if point == before:
                break
        return point


def simulate_case(case: tuple[str, int, str]) -> Walked:
    """Simulate the walk of a scenario, seed and field."""
    scenario, seed, level = case
    recording = simulate(scenario, seed, Choices(calibrated=True, field=level, rate_hz=100.0)).recording
    stances, options = detect_stances(recording), give_heading(recording)
    there = find_truth(recording)[0].position[stances.stillest(recording.gyr), :2]
    plain, heading = replace(recording, mag=None, truth=None), options.heading_rad or 0.0
    footfalls = average_footfall_field(recording, stances, heading)
    iez = run_iez(plain, stances, heading=heading)
    return Walked(Walk(plain, stances, options=options, field=footfalls), there, measure_error(iez, there))


def measure_error(solution: Solution, truth: Floats) -> float:
    """Rmse at the footfalls and error at the last together, m."""
    apart = solution.stances.position[:, :2] - truth
    error = np.linalg.norm(apart - apart[0], axis=1)
    return float(np.sqrt(np.mean(error**2)) + error[-1])


def measure_losses(method: str, points: Sequence[Point], walked: Walked) -> list[float]:
    """Loss at each point on a walk."""
    physical = cast("GatedCompassParameters", find_parameters(method, PHYSICAL))
    walk, losses = walked.walk, list[float]()
    for point in points:
        own: dict[str, Any] = dict(point)
        window = int(own.pop("window", physical.detector.window))
        detector = scale_detector(physical.detector, own.pop("allowance"), window)
        parameters = replace(physical, detector=detector, **own)
        solution = run_with_compass(walk.recording, walk.stances, walk.field, parameters, walk.options.heading_rad)
        losses.append(float(np.log(measure_error(solution, walked.truth) / walked.iez_m)))
    return losses


if __name__ == "__main__":
    harness.run(main)
