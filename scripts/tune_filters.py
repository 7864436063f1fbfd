"""Tune the filters on simulated walks: the preset `tuned` of `fg_nav.ekf.presets`.

    python scripts/tune_filters.py --cache DIR [--seeds N] [--methods NAME ...] [--jobs N]
    python scripts/tune_filters.py --cache DIR --held-out      `tuned` and `physical` on seeds not tuned on

One preset a method for all scenarios and fields, for a user does not know the field. Calibrated magnetometer, true
heading at the start, position and heading of the start laid on the truth. On every walk

    e = rmse over the ground at the footfalls + error over the ground at the last, m
    loss of a walk = ln(e / e of the IEZ in its physical preset on that walk)

and the loss is the mean over all walks, so that its exponential is a geometric mean of ratios: an estimate without the
field has 1. The search varies one parameter after the other over a fixed grid, from each of two starts, until a round
changes nothing; then every value of every parameter is tried beside the best, which shows how flat it is. The largest
sigma of the compass all but turns it off, so no method can be tuned to be worse than the IEZ.

Walks are kept in the cache. Seeds 1 to 12 are for tuning, 31 to 36 held out; those from 101 on are left to the reports.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import harness
import numpy as np
from harness import option

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.ekf import IezParameters, run_iez
from fg_nav.ekf.compass import run_with_compass
from fg_nav.ekf.presets import PHYSICAL, TUNED, Parameters, find_parameters
from fg_nav.frames import compute_heading
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.lab.store.files import atomic_write, make_folder
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.detectors import scale_detector
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth

SCENARIOS, FIELDS = ("teaching-building", "office", "mall"), ("smooth", "indoor")
BASELINE = "iez"

Point = Mapping[str, float]
"""Parameter -> value; what is not named is as in the preset. `allowance` and `window` are of `scale_detector`."""
Trial = tuple[str, str, Point]
"""Method, preset, and what is other than in it."""
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
INERTIAL = frozenset(one.name for one in fields(IezParameters))


@dataclass(frozen=True)
class Walked:
    """A simulated walk in one field as a filter sees it; `truth` (F, 2) m at the footfalls, `heading` rad."""

    recording: Recording
    stances: Stances
    field: FootfallField
    truth: Floats
    heading: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Tune and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        cache=option(None, "folder of walks", type=Path, required=True, metavar="DIR"),
        seeds=option(3, "walks of a scenario", choices=range(1, 13)),
        scenarios=SCENARIOS,
        methods=tuple(GRIDS),
        rounds=option(4, "at most so many rounds of the search", metavar="N"),
        jobs=2,
        held_out=option(False, "measure `tuned` on seeds 31 to 36 instead"),
    )
    first = 31 if chosen.held_out else 1
    seeds = range(first, first + chosen.seeds)
    cases = [(scenario, seed, level) for scenario in chosen.scenarios for seed in seeds for level in FIELDS]
    bench = Bench(make_folder(chosen.cache), cases, chosen.jobs)
    if chosen.held_out:
        trials: list[Trial] = [(m, preset, {}) for m in (BASELINE, *chosen.methods) for preset in (PHYSICAL, TUNED)]
        rows = [(m, p, f"{np.exp(loss):.3f}") for (m, p, _), loss in zip(trials, bench.losses(trials), strict=True)]
        harness.print_table(("method", "preset", f"error over the IEZ's, {len(cases)} walks"), rows)
        return
    for method in chosen.methods:
        # the physical values belong to the grid
        physical = find_parameters(method, PHYSICAL)
        begin = {"allowance": 1.0, "window": 1.0 if isinstance(physical, IezParameters) else physical.detector.window}
        begin = {name: float(begin[name] if name in begin else getattr(physical, name)) for name in GRIDS[method]}
        grid = {name: tuple(sorted({*values, begin[name]})) for name, values in GRIDS[method].items()}
        ends = [bench.descend(method, grid, {**begin, **start}, chosen.rounds) for start in STARTS]
        best = ends[int(np.argmin(bench.losses([(method, PHYSICAL, end) for end in ends])))]
        # every value of every parameter beside the best; the best is marked
        harness.print_heading(f"{method}: error over the IEZ's (geometric mean of {len(cases)} walks)")
        lines = []
        for name, values in grid.items():
            loss = bench.vary(method, best, name, values)
            marks = {min(loss, key=lambda value: loss[value]): "*"}
            shown = [f"{value:g}: {np.exp(one):.3f}{marks.get(value, '')}" for value, one in loss.items()]
            lines.append((name, "  ".join(shown)))
        harness.print_table(("parameter", "value: ratio"), lines)


@dataclass(frozen=True)
class Bench:
    """Runs trials on all its cases (scenario, seed, field), and remembers their losses."""

    folder: Path
    cases: Sequence[tuple[str, int, str]]
    jobs: int
    known: dict[str, list[float]] = field(default_factory=dict)

    def losses(self, trials: Sequence[Trial]) -> list[float]:
        """Loss of each trial."""
        every: list[Trial] = [(BASELINE, PHYSICAL, {}), *trials]
        new = {f"{one}": one for one in every if f"{one}" not in self.known}
        if new:
            measure = partial(measure_case, self.folder, list(new.values()))
            found = harness.map_walks(measure, self.cases, self.jobs, "trials")
            self.known.update({key: [one[k] for one in found] for k, key in enumerate(new)})
        baseline = np.log(self.known[f"{every[0]}"])
        return [float(np.mean(np.log(self.known[f"{one}"]) - baseline)) for one in trials]

    def vary(self, method: str, point: Point, name: str, values: Sequence[float]) -> dict[float, float]:
        """Loss at each value of one parameter, the others as in the point."""
        losses = self.losses([(method, PHYSICAL, {**point, name: value}) for value in values])
        return dict(zip(values, losses, strict=True))

    def descend(self, method: str, grid: Grid, point: Point, rounds: int) -> Point:
        """Search along one parameter after the other until a round changes nothing."""
        for _ in range(rounds):
            before = point
            for name, values in grid.items():
                loss = self.vary(method, point, name, values)
                point = {**point, name: min(loss, key=lambda value: loss[value])}
            if point == before:
                break
        return point


def measure_case(folder: Path, trials: Sequence[Trial], case: tuple[str, int, str]) -> list[float]:
    """Return rmse at the footfalls and error at the last together, m, of each trial on a walk."""
    walk, found = find_walk(folder, *case), []
    for method, preset, point in trials:
        parameters = set_point(find_parameters(method, preset), point)
        if isinstance(parameters, IezParameters):
            solution = run_iez(walk.recording, walk.stances, parameters, walk.heading)
        else:
            solution = run_with_compass(walk.recording, walk.stances, walk.field, parameters, walk.heading)
        apart = solution.stances.position[:, :2] - walk.truth
        error = np.linalg.norm(apart - apart[0], axis=1)
        found.append(float(np.sqrt(np.mean(error**2)) + error[-1]))
    return found


def find_walk(folder: Path, scenario: str, seed: int, level: str) -> Walked:
    """Return a walk out of the folder, or simulate it and put it there."""
    path = folder / f"{scenario}-{seed}-{level}.pickle"
    if not path.exists():
        recording = simulate(scenario, seed, Choices(calibrated=True, field=level, rate_hz=100.0)).recording
        truth, stances = recording.truth, detect_stances(recording)
        assert isinstance(truth, TrajectoryTruth)
        assert truth.nav_R_body is not None
        heading = float(compute_heading(truth.nav_R_body[0]))
        there = truth.position[stances.stillest(recording.gyr), :2]
        footfalls = average_footfall_field(recording, stances, heading)
        with atomic_write(path) as unfinished:
            plain = replace(recording, mag=None, truth=None)
            unfinished.write_bytes(pickle.dumps(Walked(plain, stances, footfalls, there, heading)))
    walk = pickle.loads(path.read_bytes())
    assert isinstance(walk, Walked)
    return walk


def set_point(parameters: Parameters, point: Point) -> Parameters:
    """Return the parameters with those of the point in their place."""
    inertial: dict[str, Any] = {name: value for name, value in point.items() if name in INERTIAL}
    if isinstance(parameters, IezParameters):
        return replace(parameters, **inertial)
    window = point.get("window")
    detector = scale_detector(parameters.detector, point.get("allowance", 1.0), None if window is None else int(window))
    known = INERTIAL | {"allowance", "window"}
    own: dict[str, Any] = {name: value for name, value in point.items() if name not in known}
    return replace(parameters, detector=detector, inertial=replace(parameters.inertial, **inertial), **own)


if __name__ == "__main__":
    harness.run(main)
