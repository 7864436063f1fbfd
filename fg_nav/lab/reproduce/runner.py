"""One runner for all papers: make what is missing of a table's walks and measurements, and read its rows off them.

The module of a paper has a `PAPER`: which measurements its table needs besides methods on walks, and how they are read.
The folder is that of `fg_nav.lab.store.results`, so that results of a campaign with the same walks hold here too. Each
walk is stored as soon as it is made, so ending a run loses only what its workers were at.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from fg_nav.lab.campaign.execute import Task, make, run_task, settings_of, simulated_keys
from fg_nav.lab.campaign.walks import LOOP
from fg_nav.lab.processes import run_tasks
from fg_nav.lab.reproduce.drawing import draw_paths
from fg_nav.lab.reproduce.results import (
    PICTURES,
    Experiment,
    Line,
    Picture,
    Planned,
    Reproduction,
    Spread,
    Table,
    read_table,
    spread_of,
)
from fg_nav.lab.simulation.fields.building import FLOOR, INDOOR, INDOOR_KINDS, REGION, SMOOTH_KINDS, STRENGTH_SPREAD
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.files import make_folder
from fg_nav.lab.store.results import USED, Arrays, Key, Measurement, Result, read_result
from fg_nav.lab.walked import AS_STARTED, BEST_YAW
from fg_nav.magnetic import DETECTORS
from fg_nav.report.plots import style
from fg_nav.text import format_count

RESULTS_FOLDER = "cells"  # Of the folder of a reproduction.
FIELDS: Mapping[str, Any] = {
    "smooth": SMOOTH_KINDS,
    "between": {"share of indoor, the rest is smooth": INDOOR["between"]},
    "indoor": {"floor": FLOOR, "kinds": INDOOR_KINDS, "region": REGION, "strength_spread": STRENGTH_SPREAD},
}
"""Objects and floor of a level."""

Parts = Mapping[str, Sequence[Measurement]]  # By kind.
Measures = Mapping[str, Callable[[Line], Mapping[str, Spread]]]  # By the first word of `Line.measure`: by column.
WalkFigure = Callable[[Result], float | None]  # None where the walk has none.


@dataclass(frozen=True)
class Made:
    """All that a run has made in its folder: methods on walks, in some levels of the field, and measurements."""

    table: Table
    folder: Path
    levels: Sequence[str]
    results: Mapping[tuple[str, str, str], Sequence[Result]]  # By scenario, field, method; in the order of the seeds.
    parts: Parts

    def load(self, kind: str) -> list[Arrays]:
        """Return the arrays of each measurement of a kind."""
        return [part.load(self.folder) for part in self.parts[kind]]

    def of(self, scenario: str, level: str, method: str) -> Sequence[Result]:
        """Results of one method; none if it was not asked for."""
        return self.results.get((scenario, level, method), ())


@dataclass(frozen=True)
class Found:
    """How rows are read off what was made, figures by experiment and drawn by whom, and parameters beside methods'."""

    measures: Measures
    figures: Mapping[str, Mapping[str, Figure]]
    parameters: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Paper:
    """What differs from paper to paper: measurements for seeds, quick or not, and what is read of a run."""

    parts: Callable[[Sequence[int], bool], Parts]
    read: Callable[[Made], Found]


def run_paper(
    name: str, folder: Path, seeds: Sequence[int], workers: int, progress: Callable[[float], None], quick: bool
) -> Reproduction:
    """Make all experiments of a paper; what is stored in the folder is used.

    `progress` is called with the fraction done. Raises `OutputError` where a folder or a file cannot be written.
    """
    table = read_table(name)
    paper: Paper = import_module(f"fg_nav.lab.reproduce.{name.replace('-', '_')}").PAPER
    # make what is missing, the shoe calibrated on a loop, as Ma did
    scenarios = [planned.scenario for planned in table.experiments if planned.scenario]
    keys = simulated_keys(
        scenarios, table.fields, [LOOP], table.methods, seeds
    )  # the shoe calibrated on a loop, as Ma did
    parts = paper.parts(seeds, quick)
    run_missing(folder, keys, [part for some in parts.values() for part in some], workers, progress)
    # read the rows off it
    made = Made(table, folder, table.fields, read_walks(folder, keys), parts)
    with style.styled():
        found = paper.read(made)
        figures = {
            **found.figures,
            **{one.name: {"": draw_paths(made, one)} for one in table.experiments if one.scenario},
        }
        pictures = {
            one.name: [_save(folder, one, by, figure) for by, figure in figures.get(one.name, {}).items()]
            for one in table.experiments
        }
    experiments = []
    for planned in table.experiments:
        rows = []
        for line in planned.lines(table.fields):
            what = str(line.measure[0])
            if what in WALK_FIGURES:  # of each method of a filter, over the walks through a scenario
                methods, figure = table.filters[line.of].items(), WALK_FIGURES[what]
                ours = {one: spread_over(made.of(planned.scenario, line.level, by), figure) for one, by in methods}
            else:
                ours = dict(found.measures[what](line))
            ours = {column: one for column, one in ours.items() if one.n and column not in line.without}
            rows += [table.judge(line, ours)] if ours else []
        title, drawn = f"{planned.title} ({planned.source})", pictures[planned.name]
        experiments.append(Experiment(planned.name, title, planned.setting, planned.columns, rows, drawn))
    # effective parameters of each method, of its first walk in the first scenario and field
    parameters: dict[str, Any] = {}
    for (_, _, method), some in made.results.items():
        parameters.setdefault(method, next((one.parameters for one in some if not one.failed), {}))
    return Reproduction(
        table.paper,
        table.citation,
        tuple(seeds),
        experiments,
        (*table.differs, *([table.quick] if quick and table.quick else []), *describe_other_code(made.results)),
        {
            **parameters,
            **describe_walks(keys, table.detectors),
            **found.parameters,
        },
    )


def _save(folder: Path, planned: Planned, by: str, figure: Figure) -> Picture:
    """Write the figure of an experiment, drawn by an estimator or, with no name, of all."""
    file = f"{PICTURES}/figure-{planned.figure:02d}{f'-{by}' if by else ''}.png"
    style.save(figure, folder / file)
    return Picture(file, f"Fig. {planned.figure} of the paper: {planned.shows}; ours: {planned.drawn.format(by)}")


def run_missing(
    folder: Path,
    keys: Sequence[Key],
    measurements: Sequence[Measurement],
    workers: int = 1,
    progress: Callable[[float], None] = lambda _: None,
) -> None:
    """Make what is not stored in the folder; the progress is the share of the tasks done.

    Raises `OutputError` if a folder or a file cannot be written.
    """
    results = make_folder(folder / RESULTS_FOLDER)
    parts = [partial(one.run, folder) for one in measurements if one.read(folder) is None]

    def execute(tasks: Sequence[Task]) -> Iterator[Sequence[Result]]:
        calls: list[Callable[[], Sequence[Result] | None]] = [*(partial(run_task, task) for task in tasks), *parts]
        for done, (_, made) in enumerate(run_tasks(calls, workers), start=1):
            yield made or ()
            progress(done / len(calls))

    deque(make({key: settings_of(key) for key in keys}, results, execute), maxlen=0)


def read_walks(folder: Path, keys: Sequence[Key]) -> dict[tuple[str, str, str], list[Result]]:
    """Read results, all of which are there; only the first of a method that did not fail keeps its path."""
    found: dict[tuple[str, str, str], list[Result]] = {}
    for key in keys:
        result = read_result(folder / RESULTS_FOLDER, key, settings_of(key))
        assert result is not None, f"{key.file} was not made"
        before = found.setdefault((key.group, key.field, key.method), [])
        if any(one.estimate for one in before):  # paths are most of a result's memory
            result = replace(result, estimate={}, truth=(), whitened={})
        before.append(result)
    return found


# --- what it was made with -------------------------------------------------------------------------------------------


def describe_other_code(results: Mapping[tuple[str, str, str], Sequence[Result]]) -> tuple[str, ...]:
    """Return one sentence if other code than this (`fg_nav.lab.store.code`) made some of the results."""
    codes = [one.code for some in results.values() for one in some]
    others = Counter(code for code in codes if code != code_sum())
    if not others:
        return ()
    sums = ", ".join(f"{number} with sum {code}" for code, number in others.most_common())
    return (
        f"{others.total()} of {format_count(len(codes), 'result')} on walks were made by another state of the code, "
        f"or of its libraries, than this one ({sums}), with the same parameters: "
        f"without the folder '{RESULTS_FOLDER}' all are made again.",
    )


def describe_walks(keys: Iterable[Key], detectors: Iterable[str]) -> dict[str, Any]:
    """Return by name the site, sensor and place of each scenario, the objects of each field, and these detectors."""
    keys = list(keys)
    of_scenario = {key.group: settings_of(key)["walk"] for key in reversed(keys)}
    levels = sorted({key.field for key in keys} & set(FIELDS))
    return {
        **{
            f"scenario {name}": {what: one for what, one in walk.items() if what != "field"}
            for name, walk in sorted(of_scenario.items())
        },
        **{f"field {level}": FIELDS[level] for level in levels},
        **{f"detector {name}": DETECTORS[name] for name in detectors},
    }


# --- figures of walks ------------------------------------------------------------------------------------------------


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


WALK_FIGURES: dict[str, WalkFigure] = {
    **{name: partial(walk_error, name=name) for name in ("end_m", "end_percent", "heading_deg", "mean_m", "max_m")},
    "landmark_mean_m": partial(at_landmarks, of=mean),
    "landmark_max_m": partial(at_landmarks, of=max),
    "laid_max_m": partial(walk_error, name="max_m", mode=BEST_YAW),
    "laid_landmark_mean_m": partial(at_landmarks, of=mean, mode=BEST_YAW),
    "used_percent": used_percent,
    "max_percent": max_percent,
}  # By the names that tables have for them; what those of errors mean: `fg_nav.lab.walked`.


def spread_over(results: Sequence[Result], figure: WalkFigure) -> Spread:
    """Median and spread over walks; a failed walk is infinitely wrong."""
    values = [math.inf if result.failed else figure(result) for result in results]
    return spread_of([value for value in values if value is not None])


def reduction_over(results: Sequence[Result], reference: Sequence[Result], figure: WalkFigure) -> Spread:
    """Median and spread, over walks, of the reduction of a figure against that of another method on the same walk."""
    theirs = {result.key.walk: figure(result) for result in reference}
    found = []
    for result in results:
        one, other = figure(result), theirs.get(result.key.walk)
        if one is not None and other:
            found.append(100.0 * (1.0 - one / other))
        elif result.failed:
            found.append(-math.inf)
    return spread_of(found)
