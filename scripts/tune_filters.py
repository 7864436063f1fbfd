"""Tune the filters on simulated walks: the preset `tuned` of `fg_nav.ekf.presets`.

    python scripts/tune_filters.py --cache DIR [--seeds N] [--methods NAME ...] [--jobs N]
    python scripts/tune_filters.py --cache DIR --held-out      `tuned` and `physical` on seeds not tuned on

One preset a method for all scenarios and fields, for a user does not know the field. Calibrated magnetometer, true
heading at the start, position and heading of the start laid on the truth. On every walk

    e = rmse over the ground at the footfalls + error over the ground at the last, m
    loss of a walk = ln(e / e of the IEZ in its physical preset on that walk)
    loss = mean over scenarios and fields of the mean over the seeds

so exp(loss) is a geometric mean of ratios: all scenarios and fields weigh alike, an estimate without the field has 1.

The search varies one parameter after the other over a fixed grid, from each of two starts, until a round changes
nothing. Then every value of every parameter is tried beside the best: the table shows how flat it is, and whether the
best lies at an edge. The largest sigma of the compass all but turns it off, so no method can be tuned to be worse than
the IEZ. Tuned at 100 Hz, samples averaged; held-out walks keep their rate.

Walks (seeds 1 to 12) and results are kept in the cache: empty it after a change of a filter. Seeds 31 to 36 are held
out of the tuning; those from 101 on are left to the reports.
"""

from __future__ import annotations

import json
import os
import pickle
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeAlias

import harness
import numpy as np
from harness import option

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.ekf import IezParameters, run_iez
from fg_nav.ekf.compass import run_with_compass
from fg_nav.ekf.presets import PHYSICAL, TUNED, Parameters, find_parameters
from fg_nav.errors import OutputError
from fg_nav.frames import compute_heading
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.detectors import scale_detector
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth

SCENARIOS, FIELDS = ("teaching-building", "office", "mall"), ("smooth", "indoor")
FIRST_SEED, MAX_SEEDS = 1, 12
HELD_OUT = 31
RATE_HZ = 100.0
BASELINE = "iez"

Point: TypeAlias = Mapping[str, float]
"""Parameter -> value; what is not named is as in the physical preset."""
Grid: TypeAlias = Mapping[str, tuple[float, ...]]

SIGMAS_DEG = (5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 45.0, 90.0)
ALLOWANCES = (0.7, 1.0, 1.4, 2.0, 4.0, 8.0, 16.0, 32.0)

COMPASS_GRID: Grid = {"compass_sigma_deg": SIGMAS_DEG, "allowance": ALLOWANCES, "window": (1, 2, 3, 5)}
GRIDS: Mapping[str, Grid] = {
    "qsf": COMPASS_GRID,
    "iqsf": COMPASS_GRID,
    "ma2018": COMPASS_GRID,
    "qsf-stance": COMPASS_GRID,
    "aiez": {
        "compass_sigma_deg": SIGMAS_DEG,
        "course_sigma_deg": (2.0, 4.0, 8.0, 16.0, 90.0),
        "course_limit_deg": (1.2, 2.5, 5.0),
        "allowance": (0.5, *ALLOWANCES),
    },
}
"""Beside the physical preset's values. `allowance` and `window` are those of `scale_detector`."""

STARTS: Sequence[Point] = ({}, {"allowance": 8.0, "compass_sigma_deg": 20.0})
"""Where the search begins: at the physical values, and with a gate that passes nearly all and a weaker compass."""


HELD_OUT_COLUMNS = ("method", "preset", "rmse (m)", "end (m)", "over the IEZ's", "least", "greatest")

FLAT = 0.02  # Losses that differ by less are alike: 2 % of the error.

DETECTORS_OWN = frozenset({"allowance", "window"})
INERTIAL = frozenset(field.name for field in fields(IezParameters))


@dataclass(frozen=True)
class Walked:
    """A simulated walk as a filter sees it, in each field; `truth` (F, 2) m at the footfalls, `heading` rad."""

    recording: Recording
    stances: Stances
    fields: Mapping[str, FootfallField]
    truth: Floats
    heading: float


@dataclass(frozen=True)
class Trial:
    """A method with some of its parameters otherwise; all are given the heading at the start."""

    method: str
    point: tuple[tuple[str, float], ...] = ()
    preset: str = PHYSICAL

    @classmethod
    def at(cls, method: str, point: Point) -> Trial:
        """Of the physical preset."""
        return cls(method, tuple(sorted(point.items())))

    @property
    def key(self) -> str:
        """Under which its result is kept."""
        return json.dumps([self.method, self.preset, self.point])


@dataclass(frozen=True)
class Case:
    """A walk in a field."""

    scenario: str
    seed: int
    field: str


Errors: TypeAlias = Mapping[Case, tuple[float, float]]
"""Case -> rmse at the footfalls and error at the last, m."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Tune, print, and keep what was computed."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        cache=option(None, "folder of walks and results", type=Path, required=True, metavar="DIR"),
        seeds=option(3, "walks of a scenario", choices=range(1, MAX_SEEDS + 1)),
        scenarios=SCENARIOS,
        methods=tuple(GRIDS),
        rounds=option(4, "at most so many rounds of the search", metavar="N"),
        jobs=2,
        held_out=option(False, "measure `tuned` on seeds 31 to 36 instead"),
    )
    first = HELD_OUT if chosen.held_out else FIRST_SEED
    with ProcessPoolExecutor(chosen.jobs) as pool:
        rate = np.inf if chosen.held_out else RATE_HZ
        bench = Bench(chosen.cache, pool, tuple(chosen.scenarios), range(first, first + chosen.seeds), rate)
        if chosen.held_out:
            print_held_out(bench, chosen.methods)
            return
        for method in chosen.methods:
            grid = with_physical(method, GRIDS[method])
            print_star(bench, method, search_starts(bench, method, grid, chosen.rounds), grid)


# --- the walks -------------------------------------------------------------------------------------------------------


def find_walk(folder: Path, scenario: str, seed: int, rate_hz: float = RATE_HZ) -> Walked:
    """Return a walk out of the folder, or simulate it and put it there."""
    path = folder / f"{scenario}-{seed}.pickle"
    if not path.exists():
        walk, unfinished = simulate_walk(scenario, seed, rate_hz), path.with_suffix(f".{os.getpid()}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            unfinished.write_bytes(pickle.dumps(walk))
            unfinished.replace(path)
        except OSError as error:
            raise OutputError(f"{path} could not be written ({error.strerror}): name another --cache.") from error
    walk = pickle.loads(path.read_bytes())
    assert isinstance(walk, Walked)
    return walk


def simulate_walk(scenario: str, seed: int, rate_hz: float) -> Walked:
    """Simulate a walk in each field."""
    walks = {name: simulate(scenario, seed, Choices(calibrated=True, field=name)).recording for name in FIELDS}
    walks = {name: average_samples(recording, rate_hz) for name, recording in walks.items()}
    first = walks[FIELDS[0]]
    truth = first.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    stances = detect_stances(first)
    heading = float(compute_heading(truth.nav_R_body[0]))
    compare_at_footfalls = {}
    for name, recording in walks.items():
        assert np.array_equal(recording.gyr, first.gyr)  # a seed has the same steps and noise in every field
        compare_at_footfalls[name] = average_footfall_field(recording, stances, heading)
    there = truth.position[stances.stillest(first.gyr), :2]
    return Walked(replace(first, mag=None, truth=None), stances, compare_at_footfalls, there, heading)


def average_samples(recording: Recording, rate_hz: float) -> Recording:
    """Return the recording with neighbouring samples averaged, down to about this rate; none for an infinite one."""
    size = max(1, round(1.0 / (rate_hz * recording.period_s)))
    truth, blocks = recording.truth, len(recording) // size
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    assert recording.mag is not None
    first = slice(0, blocks * size, size)
    acc, gyr, mag = (
        values[: blocks * size].reshape(blocks, size, 3) for values in (recording.acc, recording.gyr, recording.mag)
    )
    count = np.isfinite(mag).sum(axis=1)
    mean = np.nansum(mag, axis=1) / np.where(count == 0, np.nan, count)
    there = TrajectoryTruth(recording.t[first], truth.position[first], truth.nav_R_body[first])
    return Recording(recording.t[first], acc.mean(axis=1), gyr.mean(axis=1), mean, there)


# --- one run ---------------------------------------------------------------------------------------------------------


def errors_m(trial: Trial, walk: Walked, field: str) -> tuple[float, float]:
    """Rmse over the footfalls and error at the last; over the ground, the first footfall laid on the truth."""
    apart = run_trial(trial, walk, field).stances.position[:, :2] - walk.truth
    error = np.linalg.norm(apart - apart[0], axis=1)
    return float(np.sqrt(np.mean(error**2))), float(error[-1])


def run_trial(trial: Trial, walk: Walked, field: str) -> Solution:
    """Run the filter."""
    parameters = set_point(find_parameters(trial.method, trial.preset), dict(trial.point))
    seen, compass = (walk.recording, walk.stances), walk.fields[field]
    if isinstance(parameters, IezParameters):
        return run_iez(*seen, parameters, walk.heading)
    return run_with_compass(*seen, compass, parameters, walk.heading)


def set_point(parameters: Parameters, point: Point) -> Parameters:
    """Return the parameters with those of the point in their place."""
    inertial: dict[str, Any] = {name: value for name, value in point.items() if name in INERTIAL}
    if isinstance(parameters, IezParameters):
        return replace(parameters, **inertial)
    window = point.get("window")
    detector = scale_detector(parameters.detector, point.get("allowance", 1.0), None if window is None else int(window))
    own: dict[str, Any] = {name: value for name, value in point.items() if name not in INERTIAL | DETECTORS_OWN}
    core = replace(parameters.inertial, **inertial)
    return replace(parameters, detector=detector, inertial=core, **own)


# --- many runs -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bench:
    """Runs trials on all its walks, in processes, and keeps the results in a folder."""

    folder: Path
    pool: ProcessPoolExecutor
    scenarios: Sequence[str]
    seeds: range
    rate_hz: float = RATE_HZ

    @property
    def cases(self) -> list[Case]:
        """All walks in all fields."""
        return [Case(name, seed, field) for name in self.scenarios for seed in self.seeds for field in FIELDS]

    def losses(self, trials: Sequence[Trial]) -> list[float]:
        """Loss of each trial."""
        iez, *found = self.errors([Trial(BASELINE), *trials])
        return [float(np.mean([log_ratio(errors[case], iez[case]) for case in self.cases])) for errors in found]

    def errors(self, trials: Sequence[Trial]) -> Sequence[Errors]:
        """Errors of each trial on all cases."""
        walks = [(name, seed) for name in self.scenarios for seed in self.seeds]
        found: list[dict[Case, tuple[float, float]]] = [{} for _ in trials]
        todo = [self.pool.submit(on_walk, self.folder, *walk, self.rate_hz, list(trials)) for walk in walks]
        for done in todo:
            for errors, of_trial in zip(found, done.result(), strict=True):
                errors.update(of_trial)
        return found


def log_ratio(errors: tuple[float, float], iez: tuple[float, float]) -> float:
    """Loss of a walk."""
    return float(np.log(sum(errors) / sum(iez)))


def on_walk(
    folder: Path, scenario: str, seed: int, rate_hz: float, trials: Sequence[Trial]
) -> list[dict[Case, tuple[float, float]]]:
    """Errors of each trial on one walk in all fields: those kept in the folder, and the others computed and kept."""
    path, kept = folder / f"{scenario}-{seed}.jsonl", dict[str, list[list[float]]]()
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        kept |= json.loads(line)
    todo = [trial for trial in dict.fromkeys(trials) if trial.key not in kept]
    if todo:
        walk = find_walk(folder, scenario, seed, rate_hz)
        with path.open("a", encoding="utf-8") as file:
            for trial in todo:
                kept[trial.key] = [list(errors_m(trial, walk, field)) for field in FIELDS]
                file.write(json.dumps({trial.key: kept[trial.key]}) + "\n")
    cases = [Case(scenario, seed, field) for field in FIELDS]
    return [{case: (rmse, end) for case, (rmse, end) in zip(cases, kept[trial.key], strict=True)} for trial in trials]


# --- the search ------------------------------------------------------------------------------------------------------


def search_starts(bench: Bench, method: str, grid: Grid, rounds: int) -> Point:
    """Search from each start, and return the better end."""
    begin = physical(method, grid)
    ends = [descend(bench, method, grid, {**begin, **start}, rounds) for start in STARTS]
    losses = bench.losses([Trial.at(method, end) for end in ends])
    return ends[int(np.argmin(losses))]


def descend(bench: Bench, method: str, grid: Grid, point: Point, rounds: int) -> Point:
    """Search along one parameter after the other until a round changes nothing."""
    for _ in range(rounds):
        before = point
        for name in grid:
            loss = try_values(bench, method, point, name, grid[name])
            point = {**point, name: min(loss, key=lambda value: loss[value])}
        if point == before:
            break
    return point


def with_physical(method: str, grid: Grid) -> Grid:
    """Return the grid with the physical preset's values in it."""
    return {name: tuple(sorted({*grid[name], value})) for name, value in physical(method, grid).items()}


def physical(method: str, grid: Grid) -> Point:
    """Where the grid's parameters are in the physical preset."""
    parameters = find_parameters(method, PHYSICAL)
    return {name: value_of(parameters, name) for name in grid}


def value_of(parameters: Parameters, name: str) -> float:
    """One of a grid's parameters."""
    if isinstance(parameters, IezParameters):
        return float(getattr(parameters, name))
    if name == "window":
        return parameters.detector.window
    return 1.0 if name == "allowance" else float(getattr(parameters, name))


def try_values(bench: Bench, method: str, point: Point, name: str, values: Sequence[float]) -> dict[float, float]:
    """Loss at each value of one parameter, the others as in the point."""
    return dict(zip(values, bench.losses([Trial.at(method, {**point, name: value}) for value in values]), strict=True))


# --- tables ----------------------------------------------------------------------------------------------------------


def print_star(bench: Bench, method: str, point: Point, grid: Grid) -> None:
    """Print the ratio to the IEZ's error at each value of each parameter; the best is marked, and where it lies."""
    harness.print_heading(f"{method}: error over the IEZ's (geometric mean of {len(bench.cases)} walks)")
    rows = []
    for name, values in grid.items():
        loss = try_values(bench, method, point, name, values)
        at = min(loss, key=lambda value: loss[value])
        shown = [f"{value:g}: {np.exp(loss[value]):.3f}{'*' if value == at else ''}" for value in values]
        rows.append([name, name_shape(list(loss.values())), "  ".join(shown)])
    harness.print_table(("parameter", "best", "value: ratio"), rows)


def name_shape(losses: Sequence[float]) -> str:
    """Whether the least of the losses along a grid lies on a plateau (a neighbour within 2 %), or at an edge."""
    best = int(np.argmin(losses))
    near = [losses[k] - losses[best] < FLAT for k in (best - 1, best + 1) if 0 <= k < len(losses)]
    shape = "plateau" if all(near) else "slope" if any(near) else "peak"
    return f"{shape}, at the edge" if best in (0, len(losses) - 1) else shape


def print_held_out(bench: Bench, methods: Sequence[str]) -> None:
    """Print `physical` and `tuned` on walks that were not tuned on."""
    trials = [Trial(method, preset=preset) for method in (BASELINE, *methods) for preset in (PHYSICAL, TUNED)]
    errors = dict(zip(trials, bench.errors(trials), strict=True))
    iez = errors[Trial(BASELINE)]
    for scenario in bench.scenarios:
        for field in FIELDS:
            cases = [case for case in bench.cases if (case.scenario, case.field) == (scenario, field)]
            harness.print_heading(f"{scenario}, {field}: medians over seeds {bench.seeds[0]} to {bench.seeds[-1]}")
            harness.print_table(HELD_OUT_COLUMNS, [_row(trial, errors[trial], iez, cases) for trial in trials])
    harness.print_heading("all")
    harness.print_table(HELD_OUT_COLUMNS, [_row(trial, errors[trial], iez, bench.cases) for trial in trials])


def _row(trial: Trial, errors: Errors, iez: Errors, cases: Sequence[Case]) -> list[str]:
    rmse, end = np.median([errors[case] for case in cases], axis=0)
    ratio = np.exp([log_ratio(errors[case], iez[case]) for case in cases])
    middle = float(np.exp(np.mean(np.log(ratio))))
    ratios = (f"{value:.3f}" for value in (middle, ratio.min(), ratio.max()))
    return [trial.method, trial.preset, f"{rmse:.2f}", f"{end:.2f}", *ratios]


if __name__ == "__main__":
    harness.run(main)
