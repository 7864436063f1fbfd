"""What all scripts share: arguments, seeds, workers, spread, tables, figures beside what was asked of them, JSON.

A figure is `ok` where it lies within its bounds (bounds included), `missed` where it does not, and has no mark where it
has no bounds. A figure that could not be measured is infinite, and is missed.

Tables are drawn on a terminal and plain text in a pipe; the same figures go to a file as JSON.
"""

from __future__ import annotations

import argparse
import gc
import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from rich import box
from rich.table import Table
from rich.text import Text

from fg_nav.errors import FgNavError, OutputError, SimulationError
from fg_nav.lab.processes import run_tasks
from fg_nav.report.terminal import console, progress

FIRST_SEED = 101  # Of walks that are reported: estimators were tuned on seeds below 100.

S = TypeVar("S")
T = TypeVar("T")

# --- arguments -------------------------------------------------------------------------------------------------------

COMMON: Mapping[str, dict[str, Any]] = {
    "seeds": {"type": int, "metavar": "N", "help": "how many walks"},
    "first": {"type": int, "metavar": "SEED", "help": "the first seed"},
    "seed": {"type": int, "metavar": "N", "help": "draws the walk"},
    "jobs": {"type": int, "metavar": "N", "help": "processes"},
    "data": {"type": Path, "metavar": "DIR", "help": "folder of the real recordings ($FG_NAV_DATA)"},
    "json": {"type": Path, "metavar": "FILE", "help": "write the figures to this file"},
    "figure": {"type": Path, "metavar": "FILE", "help": "draw into this file"},
    "methods": {"nargs": "+", "metavar": "NAME", "help": "methods"},
    "scenarios": {"nargs": "*", "metavar": "NAME", "help": "simulated walks"},
    "fields": {"nargs": "+", "metavar": "LEVEL", "help": "levels of the magnetic field"},
}
"""Options that several scripts have."""


@dataclass(frozen=True)
class Option:
    """An option of one script: its default and what `argparse` needs besides."""

    default: Any
    help: str
    more: Mapping[str, Any]


def option(default: Any, help: str, **more: Any) -> Option:
    """Describe an option; a number's type is that of its default, and a default of False makes it a switch."""
    if default is False:
        more["action"] = "store_true"
    elif isinstance(default, int | float | str) and "type" not in more:
        more["type"] = type(default)
    return Option(default, help, more)


def parse_arguments(doc: str | None, arguments: Sequence[str] | None, **options: Any) -> argparse.Namespace:
    """Parse the command line of a script.

    Parameters
    ----------
    doc : docstring of the script, shown by `--help`.
    arguments : words of the command line; those of the process if None.
    options : name -> default of one of `COMMON`, or -> an `Option`.

    Raises `SimulationError` where fewer than no walk is asked for.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, given in options.items():
        one = given if isinstance(given, Option) else option(given, **COMMON[name])
        shown = "" if one.default in (None, False) or one.more.get("nargs") else f" ({one.default})"
        more = {key: value for key, value in one.more.items() if key != "positional"}
        flag = name if "positional" in one.more else "--" + name.replace("_", "-")
        parser.add_argument(flag, default=one.default, help=f"{one.help}{shown}".replace("%", "%%"), **more)
    chosen = parser.parse_args(arguments)
    if getattr(chosen, "seeds", 0) < 0:
        raise SimulationError("that few walks show nothing: ask for one or more.")
    return chosen


def seeds_of(chosen: argparse.Namespace) -> range:
    """Return the seeds asked for: `--seeds` of them from `--first` on."""
    first = getattr(chosen, "first", FIRST_SEED)
    return range(first, first + chosen.seeds)


# --- work ------------------------------------------------------------------------------------------------------------


def map_walks(function: Callable[[S], T], walks: Iterable[S], jobs: int = 1, title: str = "walks") -> list[T]:
    """Apply a function to each walk, on that many processes, in the order of the walks."""
    tasks, found = [partial(function, walk) for walk in walks], dict[int, T]()
    with progress(f"{title}: {len(tasks)}") as report:
        for number, result in run_tasks(tasks, jobs):
            found[number] = result
            report(len(found) / len(tasks))
    return [found[number] for number in range(len(tasks))]


def measure_cpu(call: Callable[[], T]) -> tuple[float, T]:
    """Return the processor time of a call, s, and its result."""
    gc.collect()
    began = process_time()
    result = call()
    return process_time() - began, result


# --- words -----------------------------------------------------------------------------------------------------------


def spread(values: ArrayLike, pattern: str = "", ends: tuple[float, float] = (5.0, 95.0)) -> str:
    """Median and two percentiles, `median (5 % to 95 %)`, in this pattern or three digits.

    An infinite value is a failure; percentiles are then not interpolated. `ends` of (0, 100): the least and the most.
    """
    some = np.asarray(values, dtype=np.float64)
    if not len(some):
        return "-"
    how = "linear" if np.isfinite(some).all() else "higher" if np.isposinf(some).any() else "lower"
    low, middle, high = np.percentile(some, [ends[0], 50.0, ends[1]], method=how)  # type: ignore[call-overload]
    words = [format_number(value, pattern) for value in (middle, low, high)]
    return f"{words[0]} ({words[1]} to {words[2]})" if len(some) > 1 else words[0]


def format_number(value: float, pattern: str = "") -> str:
    """Write a number in this pattern, else with three digits and no exponent; one that is infinite is a failure."""
    if not math.isfinite(value):
        return "failed"
    if pattern:
        return pattern.format(value)
    digits = 2 if abs(value) < 10 else 1 if abs(value) < 100 else 0
    return f"{value:.{digits}f}"


def print_heading(words: str) -> None:
    """Begin a section."""
    console().print(f"\n{words}", style="bold")


def print_table(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table: its first column to the left, the others to the right."""
    table = Table(box=box.SIMPLE_HEAD if sys.stdout.isatty() else None, pad_edge=False)
    for i, header in enumerate(headers):
        table.add_column(Text(header), justify="right" if i else "left")
    for row in rows:
        table.add_row(*(Text(cell, style="bold red" if cell == "missed" else "") for cell in row))
    console().print(table)


# --- figures ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Figure:
    """`measured` against `low <= measured <= high`; `pattern` formats all three."""

    section: str
    name: str
    method: str
    measured: float
    low: float = -math.inf
    high: float = math.inf
    pattern: str = "{:.3f}"

    @property
    def asked(self) -> str:
        """Its bounds in words."""
        low, high = self.pattern.format(self.low), self.pattern.format(self.high)
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"{low} to {high}"
        if math.isfinite(self.high):
            return f"<= {high}"
        return f">= {low}" if math.isfinite(self.low) else ""

    @property
    def mark(self) -> str:
        """`ok`, `missed`, or nothing where it has no bounds."""
        if not self.asked:
            return ""
        return "ok" if math.isfinite(self.measured) and self.low <= self.measured <= self.high else "missed"

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON; an infinite number is null there."""
        found = {name: finite(value) for name, value in asdict(self).items() if name != "pattern"}
        return {**found, "mark": self.mark}


def finite(value: object) -> object:
    """Return the value, or None for a number that JSON does not know."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def report_figures(figures: Sequence[Figure], path: Path | None = None, **more: object) -> None:
    """Print a row each figure and which are missed; write them, and more, to a file if there is one."""
    rows = [(f.name, f.method, f.asked or "-", f.pattern.format(f.measured), f.mark) for f in figures]
    print_table(("figure", "method", "asked", "measured", ""), rows)
    asked = [figure for figure in figures if figure.mark]
    missed = [figure for figure in asked if figure.mark == "missed"]
    console().print(f"\n{len(asked) - len(missed)} of {len(asked)} figures are as asked.")
    for f in missed:
        measured = f.pattern.format(f.measured)
        console().print(f"missed: {f.section}, {f.name}, {f.method}: {measured}, asked {f.asked}")
    if path is not None:
        write_json(path, {"figures": [figure.as_dict() for figure in figures], **more})


def write_json(path: Path, content: Mapping[str, object]) -> None:
    """Write a file of JSON."""
    write_file(path, lambda file: file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8"))


def write_file(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file; raises `OutputError` where the system refuses."""
    try:
        write(path)
    except OSError as error:
        raise OutputError(f"{path} could not be written ({error.strerror}): name another file.") from error


def run(script: Callable[[], None]) -> NoReturn:
    """Run a script and exit: 0 when done, 1 with one sentence where its input is to blame."""
    try:
        script()
    except FgNavError as error:
        print(error, file=sys.stderr)
        sys.exit(1)
    sys.exit(0)
