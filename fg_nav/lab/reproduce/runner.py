"""One runner for all papers: make what is missing of a table's walks and measurements, and read its rows off them.

The module of a paper has a `PAPER`: which measurements its table needs besides methods on walks, and how they are read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from fg_nav.lab.reproduce.results import Experiment, Picture, Reproduction, Row, Spread
from fg_nav.lab.reproduce.table import Line, Planned, Table, read_table
from fg_nav.lab.reproduce.walks import (
    FIGURES,
    Walks,
    describe_other_code,
    describe_walks,
    keys_of,
    parameters_of,
    read_walks,
    run_missing,
    spread_over,
)
from fg_nav.lab.store.results import Measurement

Parts = Mapping[str, Sequence[Measurement]]  # By kind.
Measures = Mapping[str, Callable[[Line], Mapping[str, Spread]]]  # By the first word of `Line.measure`: by column.


@dataclass(frozen=True)
class Made:
    """All that a run has made in its folder: methods on walks, in some levels of the field, and measurements."""

    table: Table
    folder: Path
    seeds: Sequence[int]
    levels: Sequence[str]
    walks: Walks
    parts: Parts

    def load(self, kind: str) -> list[dict[str, NDArray[Any]]]:
        """Return the arrays of each measurement of a kind."""
        return [part.load(self.folder) for part in self.parts[kind]]


@dataclass(frozen=True)
class Found:
    """How rows are read off what was made, the pictures of each experiment, and parameters besides the methods'."""

    measures: Measures
    pictures: Mapping[str, Sequence[Picture]]
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
    # make what is missing
    levels = table.quick_fields if quick and table.quick_fields else table.fields
    scenarios = [planned.scenario for planned in table.experiments if planned.scenario]
    keys = [key for scenario in scenarios for key in keys_of(scenario, levels, table.methods, seeds)]
    parts = paper.parts(seeds, quick)
    run_missing(folder, keys, [part for some in parts.values() for part in some], workers, progress)
    # read the rows off it
    made = Made(table, folder, seeds, levels, read_walks(folder, keys), parts)
    found = paper.read(made)
    experiments = []
    for planned in table.experiments:
        rows = [row for line in planned.lines(levels) if (row := _fill_row(made, found, planned, line))]
        title, pictures = f"{planned.title} ({planned.source})", found.pictures.get(planned.name, ())
        experiments.append(Experiment(planned.name, title, planned.setting, planned.columns, rows, pictures))
    return Reproduction(
        table.paper,
        table.citation,
        tuple(seeds),
        experiments,
        (*table.differs, *([table.quick] if quick and table.quick else []), *describe_other_code(made.walks)),
        parameters_of(made.walks) | describe_walks(keys, table.detectors) | dict(found.parameters),
    )


def _fill_row(made: Made, found: Found, planned: Planned, line: Line) -> Row | None:
    """Return a row with our figures; None where no walk has one."""
    name = str(line.measure[0])
    measure = partial(_measure_methods, made, planned.scenario) if name in FIGURES else found.measures[name]
    ours = {column: one for column, one in measure(line).items() if one.n and column not in line.without}
    return made.table.judge(line, ours) if ours else None


def _measure_methods(made: Made, scenario: str, line: Line) -> dict[str, Spread]:
    """A figure of each method of a filter, over the walks through a scenario."""
    return {
        column: spread_over(made.walks.of(scenario, line.level, method), FIGURES[str(line.measure[0])])
        for column, method in made.table.filters[line.of].items()
    }
