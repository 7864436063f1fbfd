"""What all scripts share: arguments, seeds, workers, spread, tables, figures beside what was asked of them.

A figure is `ok` where it lies within its bounds (bounds included), `missed` where it does not, and has no mark where it
has no bounds. A figure that could not be measured is infinite, and is missed.

Tables are drawn on a terminal and plain text in a pipe.
"""

from __future__ import annotations

import argparse
import gc
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any, NoReturn, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from rich import box
from rich.table import Table
from rich.text import Text

from fg_nav.errors import FgNavError
from fg_nav.lab.processes import run_tasks
from fg_nav.report.terminal import console, progress

FIRST_SEED = 101  # Of walks that are reported: estimators were tuned on seeds below 100.

S = TypeVar("S")
T = TypeVar("T")

# --- arguments -------------------------------------------------------------------------------------------------------

Option: TypeAlias = dict[str, Any]
"""What `argparse` needs of an option."""


def option(default: Any, help: str, **more: Any) -> Option:
    """Describe an option; a number's type is that of its default, and a default of False makes it a switch."""
    if default is False:
        more["action"] = "store_true"
    elif isinstance(default, int | float | str) and "type" not in more:
        more["type"] = type(default)
    shown = "" if default in (None, False) or more.get("nargs") else f" ({default})"
    return {"default": default, "help": f"{help}{shown}".replace("%", "%%"), **more}


COMMON: Mapping[str, Callable[[Any], Option]] = {
    "seeds": partial(option, help="how many walks", metavar="N"),
    "first": partial(option, help="the first seed", metavar="SEED"),
    "seed": partial(option, help="draws the walk", metavar="N"),
    "jobs": partial(option, help="processes", metavar="N"),
    "data": partial(option, help="folder of the real recordings ($FG_NAV_DATA)", type=Path, metavar="DIR"),
    "methods": partial(option, help="methods", nargs="+", metavar="NAME"),
    "scenarios": partial(option, help="simulated walks", nargs="*", metavar="NAME"),
}
"""Options that several scripts have, by their defaults."""


def parse_arguments(
    doc: str | None, arguments: Sequence[str] | None, what: Iterable[str] = (), **options: Any
) -> argparse.Namespace:
    """Parse the command line of a script.

    Parameters
    ----------
    doc : docstring of the script, shown by `--help`.
    arguments : words of the command line; those of the process if None.
    what : words of which the first argument is one, where there are some.
    options : name -> default of one of `COMMON`, or -> an `Option`.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if what:
        parser.add_argument("what", choices=list(what))
    for name, given in options.items():
        one = given if isinstance(given, dict) else COMMON[name](given)
        parser.add_argument(f"--{name.replace('_', '-')}", **one)
    return parser.parse_args(arguments)


def seeds_of(chosen: argparse.Namespace) -> range:
    """Return the seeds asked for: `--seeds` of them from `--first` on."""
    return range(chosen.first, chosen.first + chosen.seeds)


# --- work ------------------------------------------------------------------------------------------------------------


def map_walks(function: Callable[[S], T], walks: Iterable[S], jobs: int = 1, title: str = "walks") -> list[T]:
    """Apply a function to each walk, on that many processes, in the order of the walks."""
    tasks, found = [partial(function, walk) for walk in walks], dict[int, T]()
    with progress(f"{title}: {len(tasks)}") as report:
        for number, result in run_tasks(tasks, jobs):
            found[number] = result
            report(len(found) / len(tasks))
    return [found[number] for number in range(len(tasks))]


def measure_cpu(call: Callable[[], object]) -> float:
    """Return the processor time of a call, s."""
    gc.collect()
    began = process_time()
    call()
    return process_time() - began


# --- words -----------------------------------------------------------------------------------------------------------


def spread(values: ArrayLike, pattern: str = "", ends: tuple[float, float] = (5.0, 95.0)) -> str:
    """Median and two percentiles, `median (5 % to 95 %)`, in this pattern or three digits.

    An infinite value is a failure; percentiles are then not interpolated. `ends` of (0, 100): the least and the most.
    """
    some = np.asarray(values, dtype=np.float64)
    if not len(some):
        return "-"
    how = "linear" if np.isfinite(some).all() else "higher"
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


def report_figures(figures: Sequence[Figure]) -> None:
    """Print a row each figure, and how many are as asked; nothing where there is none."""
    if not figures:
        return
    rows = [(f.section, f.name, f.method, f.asked or "-", f.pattern.format(f.measured), f.mark) for f in figures]
    print_table(("", "figure", "method", "asked", "measured", ""), rows)
    marks = [figure.mark for figure in figures if figure.mark]
    console().print(f"\n{marks.count('ok')} of {len(marks)} figures are as asked.")


def run(script: Callable[[], None]) -> NoReturn:
    """Run a script and exit: 0 when done, 1 with one sentence where its input is to blame."""
    try:
        script()
    except (FgNavError, OSError) as error:
        print(error, file=sys.stderr)
        sys.exit(1)
    sys.exit(0)
