"""Figures of merit as tables, printed output, and progress on a terminal only.

In a pipe all is plain text, lines unbroken.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from fg_nav.report import REPORT
from fg_nav.text import format_count, format_digits

format_sigma = partial(format_digits, digits=2)

FIGURES: tuple[tuple[str, str, Callable[[Any], str]], ...] = (
    ("distance_m", "distance (m)", format_digits),
    ("distance_sigma_m", "its sigma (m)", format_sigma),
    ("strides", "strides", str),
    ("strides_true", "strides in truth", str),
    ("closure_m", "start to end (m)", format_digits),
    ("closure_percent", "start to end (%)", format_digits),
    ("rmse_2d_m", "rmse 2-D (m)", format_digits),
    ("rmse_3d_m", "rmse 3-D (m)", format_digits),
    ("end_error_m", "end error (m)", format_digits),
    ("max_error_m", "max error (m)", format_digits),
    ("moment_rmse_2d_m", "rmse 2-D at the moment (m)", format_digits),
    ("moment_end_error_m", "end error at the moment (m)", format_digits),
    ("polished_rmse_2d_m", "rmse 2-D in batch (m)", format_digits),
    ("polished_closure_m", "start to end in batch (m)", format_digits),
    ("polish_gap_rms_m", "apart from batch, rms (m)", format_digits),
    ("polish_gap_max_m", "apart from batch, most (m)", format_digits),
    ("polish_gap_heading_deg", "apart from batch (deg)", format_digits),
    ("heading_rmse_deg", "heading rmse (deg)", format_digits),
    ("scale", "best-fit scale", "{:.4f}".format),
    ("alignment", "alignment", str),
    ("magnetometer", "magnetometer", str),
    ("runtime_s", "runtime (s)", format_digits),
    ("realtime_factor", "times real time", "{:.0f}".format),
)
"""Key of the summary, words, and format of every row of a result table."""

LOOP_PERCENT = 5.0  # Recorded: 117 of 155 walks end as near, loops that drifted within 8, other walks from 16 % on.
KNOW = "What you should know"
SOLVING = re.compile(
    "gyro bias|sensor (at|taken)|swing noise|solved in|[0-9]+ level floor|field over ground|it deviates|hard iron left"
    "|line integral|gyroscope's scale|barometer in|[0-9]+ % of .* directions|estimates of|magnetometer corrected"
    "|corrected by|its lines are|preset|clipped peaks|step constant|[0-9]+ steps of both legs|[0-9]+ returns? to where"
)
"""Openings of the notes that say how a walk was solved; all others are what its user should know."""


@dataclass(frozen=True)
class Cell:
    """A figure of merit as text, with its key and its value in the summary."""

    key: str
    text: str
    value: object


def tabulate_figures(summaries: Sequence[Mapping[str, object]]) -> list[tuple[str, list[Cell]]]:
    """Rows of the figures that at least one of the columns has; from start to end of a loop only."""
    rows = []
    for key, words, write in FIGURES:
        values = [summary.get(key) for summary in summaries]
        if any(value is not None for value in values) and ("closure" not in key or is_loop(summaries)):
            rows.append((words, [Cell(key, "-" if value is None else write(value), value) for value in values]))
    return rows


def is_loop(summaries: Sequence[Mapping[str, object]]) -> bool:
    """Whether a walk ends where it began, by one method at least: only there is that distance an error."""
    known = [cast("float | None", summary.get("closure_percent")) for summary in summaries]
    return any(percent is not None and percent <= LOOP_PERCENT for percent in known)


def collect_notes(summaries: Sequence[Mapping[str, object]]) -> list[tuple[str, str]]:
    """Return the notes of several methods, each with its method, or with "" where all of them have it."""
    by_method = {str(summary["method"]): cast("list[str]", summary["notes"]) for summary in summaries}
    shared = [note for note in next(iter(by_method.values())) if all(note in notes for notes in by_method.values())]
    own = [(name, note) for name, notes in by_method.items() for note in notes if note not in shared]
    return [("", note) for note in shared] + own


def group_notes(notes: Sequence[tuple[str, str]]) -> dict[str, list[tuple[str, str]]]:
    """Group notes, each with its method, by title, without empty groups."""
    how = [one for one in notes if SOLVING.match(one[1])]
    groups = {KNOW: [one for one in notes if one not in how], "How it was solved": how}
    return {title: found for title, found in groups.items() if found}


_hushed = False  # Whether only errors are printed (`hush`); of the process, as its threads print too.


@contextmanager
def hush(quiet: bool) -> Iterator[None]:
    """While the block runs, print no remarks and no progress, if `quiet`."""
    global _hushed
    _hushed, before = quiet, _hushed
    try:
        yield
    finally:
        _hushed = before


def remark(words: str) -> None:
    """Print a sentence for people on standard error; a closed one is ignored."""
    if not _hushed:
        with suppress(OSError):
            print(words, file=sys.stderr, flush=True)  # noqa: T201


def console() -> Console:
    """Return a console on standard output, as wide as the terminal; wide enough for any line in a pipe."""
    return Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 1000)


def print_results(summaries: Sequence[Mapping[str, object]], place: Path) -> None:
    """Print the result of one method in five lines, or the table and the verdicts of several."""
    out = console()
    several = len(summaries) > 1
    if several:
        # a column a method, a row a figure that at least one of them has
        table = ruled_table("", *(str(summary["method"]) for summary in summaries))
        for words, cells in tabulate_figures(summaries):
            table.add_row(words, *(cell.text for cell in cells))
        out.print(table)
    for summary in summaries:
        reasons = "; ".join(cast("list[str]", summary["reasons"]))
        who = f" ({summary['method']})" if several else ""
        out.print(f"verdict{who}: {summary['verdict']}" + (f": {reasons}" if reasons else ""), soft_wrap=True)
    if not several:
        for line in _describe_result(summaries[0]):
            out.print(line, soft_wrap=True)
    remarks = group_notes(collect_notes(summaries)).get(KNOW, [])
    out.print(describe_place(place, len(remarks)), soft_wrap=True)


def _describe_result(summary: Mapping[str, object]) -> list[str]:
    """Distance, end and, where known, error of one method, and the coupling of the feet, a line each."""
    known = {key: write(summary[key]) for key, _, write in FIGURES if summary.get(key) is not None}
    sigma = f", sigma {known['distance_sigma_m']} m" if "distance_sigma_m" in known else ""
    strides = format_count(cast("int", summary["strides"]), "stride")
    closure = f"{known.get('closure_m')} m from the start ({known.get('closure_percent')} % of the distance), at "
    end = f"end: {closure if is_loop([summary]) else ''}{_format_place(summary['end_m'], 3)}"
    lines = [
        f"distance: {known['distance_m']} m{sigma}, in {strides}",
        f"{end}, sigma {_format_place(summary['end_sigma_m'], 2)}",
    ]
    if "rmse_2d_m" in known:
        error = f"error: {known['rmse_2d_m']} m rms horizontally, {known['end_error_m']} m at the end"
        lines.append(f"{error}, {known['max_error_m']} m at most; alignment {known['alignment']}")
    if summary.get("mount") != "feet":
        return lines
    # the coupling of the feet
    sides = " and ".join(cast("list[str]", summary["sides"]))
    how = {"named": "as named", "shown": "as the steps show", "assumed": "assumed"}[str(summary["sides_known"])]
    coupled = "one is missing" if None in (summary["left"], summary["right"]) else "two walks"
    if summary["width_m"] is not None:
        coupled = (
            f"{summary['width_m']:.2f} m apart, sigma {summary['width_sigma_m']:.2f} m, by {summary['cells']} "
            f"cells of steps; clock {summary['clock_offset_s']:+.3f} s"
        )
    return [*lines, f"feet: {sides}, {how}; {coupled}"]


def _format_place(values: object, digits: int) -> str:
    """Format x, y, z (m) with so many significant digits, to the centimetre; a dash for an unknown sigma."""
    named = zip("xyz", cast("list[float | None]", values), strict=True)
    words = (f"{axis} {'-' if value is None else format_digits(value, digits, decimals=2)}" for axis, value in named)
    return f"{', '.join(words)} m"


def describe_place(place: Path, remarks: int = 0) -> str:
    """Return the place of the page of a result, or of its files where there is no page."""
    more = f" ({format_count(remarks, 'remark')} in it)" if remarks else ""
    return f"report: {place / REPORT}{more}" if (place / REPORT).exists() else f"files: {place}"


def listing(rows: Sequence[tuple[str, str]]) -> Table | Text:
    """Names and values; in a pipe each line ends with its value, not with blanks up to the longest."""
    if not sys.stdout.isatty():
        width = max((len(name) for name, _ in rows), default=0)
        lines = (f"{name:<{width}}  {value}".rstrip() for name, value in rows)
        return Text("\n".join(lines), overflow="fold")
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column()
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(Text(name, style="dim"), Text(value))
    return table


def ruled_table(*headers: str) -> Table:
    """Return an empty table; all columns but the first are numbers."""
    table = Table(box=box.SIMPLE_HEAD if sys.stdout.isatty() else None, pad_edge=False)
    for i, header in enumerate(headers):
        table.add_column(Text(header), justify="right" if i else "left")
    return table


@contextmanager
def progress(words: str) -> Iterator[Callable[[float], None]]:
    """Show a bar on standard error while the block runs; yields a function of the fraction done."""
    errors = Console(stderr=True)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    shown = can_show_progress(errors)
    with Progress(*columns, console=errors, transient=True, disable=not shown) as bars:
        task = bars.add_task(words, total=None)
        yield lambda fraction: bars.update(task, total=1.0, completed=fraction)


def can_show_progress(errors: Console) -> bool:
    """Whether a bar can be drawn there, and is wanted."""
    return sys.stderr.isatty() and not errors.is_dumb_terminal and not _hushed
