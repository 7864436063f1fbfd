"""Experiments: what is measured on which walks, how it is summed up, and what is asked of it.

A task is one walk of a section, simulated or read where it is measured; it returns the figures of each variant (a
method, a preset, a smoother without one of its parts) on that walk. A variant that fails is infinitely bad there.
Columns sum a figure up over the walks of a section, `over` another variant walk by walk. What is asked is a bound of
such a sum. `scripts/measure.py` runs, prints and stores them.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import harness
import numpy as np
from harness import Figure

from fg_nav.arrays import Floats
from fg_nav.errors import FgNavError
from fg_nav.frames import compute_heading
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options

Value: TypeAlias = float | int | str | None
Figures: TypeAlias = Mapping[str, Value]
Found: TypeAlias = Mapping[str, Figures | Callable[[], Figures]]
"""Figures by variant, of one walk, or what measures them."""

FAILURE = "failure"  # In place of figures: why there are none.
ALL = "all"  # In place of a walk, where a row has sums over them.

SUMMARIES: Mapping[str, Callable[[Floats], float]] = {
    "mean": lambda x: float(np.mean(x)),
    "median": lambda x: float(np.median(x)),
    "worst": lambda x: float(np.max(x)),
    "p95": lambda x: float(np.percentile(x, 95, method="linear" if np.isfinite(x).all() else "higher")),
    "rms": lambda x: float(np.sqrt(np.mean(np.square(x)))),
    "sum": lambda x: float(np.sum(x)),
}
SPREAD = "spread"  # Median and 5 to 95 %, in words.


@dataclass(frozen=True)
class Task:
    """One walk of a section; `measure` returns the figures of each variant, and can be sent to another process."""

    section: str
    walk: str
    measure: Callable[[], Found]


def measure_variants(measure: Callable[[], Found]) -> dict[str, Figures]:
    """Measure all variants on a walk; of one that fails, or of a walk that cannot be read, the reason."""
    found: dict[str, Figures] = {}
    try:
        variants = measure()
    except FgNavError as error:
        return {"all": {FAILURE: str(error)}}
    for name, one in variants.items():
        try:
            found[name] = one() if callable(one) else one
        except FgNavError as error:
            found[name] = {FAILURE: str(error)}
    return found


def list_seeds(chosen: Namespace, measures: Mapping[str, Callable[[int], Found]]) -> list[Task]:
    """All seeds of each section."""
    seeds = harness.seeds_of(chosen)
    return [Task(name, f"{seed}", partial(measure, seed)) for name, measure in measures.items() for seed in seeds]


def find_truth(recording: Recording) -> tuple[TrajectoryTruth, Floats]:
    """Where a simulated sensor was, and its attitudes (N, 3, 3)."""
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    return truth, truth.nav_R_body


def give_heading(recording: Recording) -> Options:
    """Give the true heading at the start of a simulated walk."""
    return Options(heading_deg=float(np.degrees(compute_heading(find_truth(recording)[1][0]))))


@dataclass(frozen=True)
class Table:
    """Rows: `section`, `walk`, `variant`, and figures by name."""

    rows: Sequence[Mapping[str, Any]]

    @property
    def cases(self) -> list[tuple[str, str]]:
        """Sections and variants, in the order in which they were measured."""
        return list(dict.fromkeys((row["section"], row["variant"]) for row in self.rows))

    @property
    def sections(self) -> list[str]:
        """In the order in which they were measured."""
        return list(dict.fromkeys(section for section, _ in self.cases))

    def select(self, section: str) -> Table:
        """The rows of one section."""
        return Table([row for row in self.rows if row["section"] == section])

    def of(self, section: str, variant: str) -> dict[str, Mapping[str, Any]]:
        """Rows by walk."""
        return {row["walk"]: row for row in self.rows if (row["section"], row["variant"]) == (section, variant)}

    def values(self, section: str, variant: str, figure: str, over: str = "") -> Floats:
        """Sizes (W,) of a figure on the walks that have it; infinite where the variant failed and others have it.

        With `over`, the ratio to that variant's on the same walk.
        """
        rows, theirs = self.of(section, variant), self.of(section, over)
        if not any(isinstance(row.get(figure), int | float) for row in self.rows if row["section"] == section):
            return np.zeros(0)
        found = []
        for walk, row in rows.items():
            value = np.inf if row.get(FAILURE) else row.get(figure)
            other = theirs.get(walk, {}).get(figure) if over else 1.0
            if value is not None and other:
                found.append(abs(float(value)) / abs(float(other)))
        return np.array(found, dtype=np.float64)


@dataclass(frozen=True)
class Column:
    """A figure over the walks of a section; `summary` has one or more names of `SUMMARIES`, or is `spread`."""

    figure: str
    head: str
    summary: str = SPREAD
    pattern: str = "{:.3f}"
    over: str = ""

    def write(self, table: Table, section: str, variant: str) -> str:
        """Write it, `mean / median`; nothing where no walk has it."""
        values = table.values(section, variant, self.figure, self.over)
        if not len(values):
            return ""
        if self.summary == SPREAD:
            return harness.spread(values, self.pattern)
        some = (SUMMARIES[name](values) for name in self.summary.split(" / "))
        return " / ".join(harness.format_number(value, self.pattern) for value in some)


@dataclass(frozen=True)
class Asked:
    """Bounds of a figure over the walks of a section; of every section and variant that has it, if none is named."""

    figure: str
    summary: str
    low: float = -np.inf
    high: float = np.inf
    section: str = ""
    variant: str = ""
    over: str = ""
    pattern: str = "{:.3f}"

    def judge(self, table: Table) -> Iterable[Figure]:
        """Yield the figure of each section and variant."""
        for section, variant in table.cases:
            values = table.values(section, variant, self.figure, self.over)
            if len(values) and self.section in ("", section) and self.variant in ("", variant):
                name = f"{self.figure}, {self.summary}" + (f", over {self.over}" if self.over else "")
                measured = SUMMARIES[self.summary](values)
                yield Figure(section, name, variant, measured, self.low, self.high, self.pattern)


Block: TypeAlias = Callable[[Table], list[str]]
"""Lines of a table in Markdown."""


@dataclass(frozen=True)
class Experiment:
    """Something to be measured.

    Attributes
    ----------
    about : what is measured on what, and what the columns are.
    list_tasks : the walks, by the arguments.
    columns, asked : what is shown and what is asked.
    seeds, first : how many simulated walks, from which on; none of an experiment on recordings alone.
    options : of the command line, besides those of all, as `harness.parse_arguments` takes them.
    blocks : tables of pages, by the names of their marks.
    """

    about: str
    list_tasks: Callable[[Namespace], Sequence[Task]]
    columns: Sequence[Column]
    asked: Sequence[Asked] = ()
    seeds: int = 0
    first: int = harness.FIRST_SEED
    options: Mapping[str, Any] = field(default_factory=dict)
    blocks: Mapping[str, Block] = field(default_factory=dict)

    @property
    def question(self) -> str:
        """What is measured on what, in one sentence."""
        return " ".join(self.about.split("\n\n")[0].split()).rstrip(".")


# --- tables of pages -------------------------------------------------------------------------------------------------


def sum_up(table: Table, columns: Sequence[Column]) -> dict[tuple[str, ...], list[list[str]]]:
    """Rows of each section and variant by their heads; columns that are empty throughout a section are left out."""
    heads, groups = ["section", "variant", "walks", *(column.head for column in columns)], dict[tuple[str, ...], Any]()
    for section in table.sections:
        rows = []
        for _, variant in table.select(section).cases:
            walks = len(table.of(section, variant))
            rows.append([section, variant, f"{walks}", *(c.write(table, section, variant) for c in columns)])
        kept = [k for k in range(len(heads)) if k < 3 or any(row[k] for row in rows)]
        group = groups.setdefault(tuple(heads[k] for k in kept), [])
        group += [[row[k] or "-" for k in kept] for row in rows]
    return groups


def write_table(heads: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1, last: int = 0) -> list[str]:
    """Write a table in Markdown, whose first and last columns are words and the others figures.

    What would end a cell, or be taken for a tag, is escaped.
    """
    lines = [
        " | ".join(cell.replace("|", "\\|").replace("\n", " ").replace("<i", "&lt;i") for cell in row)
        for row in (heads, *rows)
    ]
    marks = "|---" * words + "|---:" * (len(heads) - words - last) + "|---" * last + "|"
    return [f"| {lines[0]} |", marks, *(f"| {line} |" for line in lines[1:])]
