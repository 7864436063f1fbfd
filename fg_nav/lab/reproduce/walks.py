"""Methods on simulated walks for a paper: what is stored in the folder is used, the rest is made.

The folder is that of `fg_nav.lab.store.results`, so that results of a campaign with the same walks hold here too.
Each walk is stored as soon as it is made, so ending a run loses only what its workers were at.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from fg_nav.lab.campaign.execute import Task, make, run_task, settings_of
from fg_nav.lab.campaign.walks import LOOP
from fg_nav.lab.landmarks import error_reduction_percent
from fg_nav.lab.processes import run_tasks
from fg_nav.lab.reproduce.results import Spread, spread_of
from fg_nav.lab.simulation.fields.building import CLUTTERS, SMOOTH_KINDS
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.files import make_folder
from fg_nav.lab.store.results import USED, Key, Measurement, Result, drop_paths, read_result
from fg_nav.lab.walked import AS_STARTED, BEST_YAW
from fg_nav.magnetic import DETECTORS
from fg_nav.text import format_count

RESULTS_FOLDER = "cells"  # Of the folder of a reproduction.
FIELDS: dict[str, Any] = {"smooth": SMOOTH_KINDS, **CLUTTERS}  # Objects and floor of a level.


@dataclass(frozen=True)
class Walks:
    """Results by (scenario, field, method), each in the order of the seeds."""

    results: dict[tuple[str, str, str], list[Result]] = field(default_factory=dict)

    def of(self, scenario: str, level: str, method: str) -> list[Result]:
        """Results of one method; none if it was not asked for."""
        return self.results.get((scenario, level, method), [])

    def first(self, scenario: str, level: str, method: str) -> Result | None:
        """Result of the first walk that did not fail, which has its path."""
        return next((result for result in self.of(scenario, level, method) if not result.failed), None)


def keys_of(scenario: str, levels: Sequence[str], methods: Sequence[str], seeds: Sequence[int]) -> list[Key]:
    """Every method on every walk, with the shoe calibrated on a loop, as Ma did it."""
    return [Key(scenario, level, str(seed), LOOP, method) for level in levels for method in methods for seed in seeds]


def run_missing(
    folder: Path,
    keys: Sequence[Key],
    measurements: Sequence[Measurement],
    workers: int = 1,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Make what is not stored in the folder; the progress is the share of the tasks done.

    Raises
    ------
    OutputError
        If a folder or a file cannot be written.
    """
    results = make_folder(folder / RESULTS_FOLDER)
    parts = [partial(one.run, folder) for one in measurements if one.read(folder) is None]

    def execute(tasks: Sequence[Task]) -> Iterator[Sequence[Result]]:
        calls: list[Callable[[], Sequence[Result] | None]] = [*(partial(run_task, task) for task in tasks), *parts]
        for done, (_, made) in enumerate(run_tasks(calls, workers), start=1):
            yield made or ()
            if progress is not None:
                progress(done / len(calls))

    deque(make({key: settings_of(key) for key in keys}, results, execute), maxlen=0)


def read_walks(folder: Path, keys: Sequence[Key]) -> Walks:
    """Read results, all of which are there; only the first of a method that did not fail keeps its path."""
    found = Walks()
    for key in keys:
        result = read_result(folder / RESULTS_FOLDER, key, settings_of(key))
        assert result is not None, f"{key.file} was not made"
        before = found.results.setdefault((key.group, key.field, key.method), [])
        before.append(drop_paths(result) if any(one.estimate for one in before) else result)
    return found


def describe_other_code(walks: Walks) -> tuple[str, ...]:
    """Return one sentence if other code than this (`fg_nav.lab.store.code`) made some of the results."""
    codes = [one.code for results in walks.results.values() for one in results]
    others = Counter(code for code in codes if code != code_sum())
    if not others:
        return ()
    sums = ", ".join(f"{number} with sum {code}" for code, number in others.most_common())
    return (
        f"{others.total()} of {format_count(len(codes), 'result')} on walks were made by another state of the code, "
        f"or of its libraries, than this one ({sums}), with the same parameters: "
        f"without the folder '{RESULTS_FOLDER}' all are made again.",
    )


def parameters_of(walks: Walks) -> dict[str, Any]:
    """Return the effective parameters of each method, of its first walk."""
    found: dict[str, Any] = {}
    for (_, _, method), results in walks.results.items():
        found.setdefault(method, next((result.parameters for result in results if not result.failed), {}))
    return found


def describe_walks(keys: Iterable[Key], detectors: Iterable[str]) -> dict[str, Any]:
    """Return by name the site, sensor and place of each scenario, the objects of each field, and these detectors."""
    keys = list(keys)
    of_scenario = {key.group: key for key in reversed(keys)}
    levels = sorted({key.field for key in keys} & set(FIELDS))
    return {
        **{
            f"scenario {name}": {what: one for what, one in settings_of(key)["walk"].items() if what != "field"}
            for name, key in sorted(of_scenario.items())
        },
        **{f"field {level}": FIELDS[level] for level in levels},
        **{f"detector {name}": DETECTORS[name] for name in detectors},
    }


Figure = Callable[[Result], float | None]
"""A figure of a walk; None where it has none."""


def walk_error(result: Result, name: str, mode: str = AS_STARTED) -> float | None:
    """Size of an error of `WalkErrors`, in this alignment; None where there is none."""
    errors = result.errors.get(mode)
    value = None if errors is None else getattr(errors, name)
    return None if value is None else float(abs(value))


def at_landmarks(result: Result, of: Callable[[Sequence[float]], float], mode: str = AS_STARTED) -> float | None:
    """Mean or largest error over the crossings of landmarks; None where there is none."""
    errors = result.landmark_m.get(mode)
    return None if not errors else float(of(errors))


def mean(values: Sequence[float]) -> float:
    """Arithmetic mean, the same in whatever order the sum is made."""
    return math.fsum(values) / len(values)


def used_percent(result: Result) -> float | None:
    """Share of the footfalls at which the method used the field."""
    return 100.0 * result.used.count(USED) / len(result.used) if result.used else None


def max_percent(result: Result) -> float | None:
    """Largest error in percent of the path length."""
    errors = result.errors.get(AS_STARTED)
    return None if errors is None or errors.max_m is None else 100.0 * errors.max_m / errors.distance_m


FIGURES: dict[str, Figure] = {
    **{name: partial(walk_error, name=name) for name in ("end_m", "end_percent", "heading_deg", "mean_m", "max_m")},
    "landmark_mean_m": partial(at_landmarks, of=mean),
    "landmark_max_m": partial(at_landmarks, of=max),
    "laid_max_m": partial(walk_error, name="max_m", mode=BEST_YAW),
    "laid_landmark_mean_m": partial(at_landmarks, of=mean, mode=BEST_YAW),
    "used_percent": used_percent,
    "max_percent": max_percent,
}
"""By the names that tables have for them; what those of errors mean: `fg_nav.lab.walked`."""


def spread_over(results: Sequence[Result], figure: Figure) -> Spread:
    """Median and spread over walks; a failed walk is infinitely wrong."""
    values = [math.inf if result.failed else figure(result) for result in results]
    return spread_of([value for value in values if value is not None])


def reduction_over(results: Sequence[Result], reference: Sequence[Result], figure: Figure) -> Spread:
    """Median and spread, over walks, of the reduction of a figure against that of another method on the same walk."""
    theirs: Mapping[str, Result] = {result.key.walk: result for result in reference}
    found = []
    for result in results:
        other = theirs.get(result.key.walk)
        pair = (figure(result), None if other is None else figure(other))
        if pair[0] is not None and pair[1]:
            found.append(error_reduction_percent(pair[0], pair[1]))
        elif result.failed:
            found.append(-math.inf)
    return spread_of(found)
