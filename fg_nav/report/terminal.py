"""Figures of merit as tables, printed output, remarks and log records, and progress on a terminal only.

In a pipe all is plain text, lines unbroken.
"""

from __future__ import annotations

import logging
import re
import shlex
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

from fg_nav.errors import FgNavError, OutputError, describe_reason
from fg_nav.report import REPORT
from fg_nav.text import CUT, format_count, format_digits

FIRST = (CUT, "step constant ", "on the places of ", "nothing of the saved places ")  # Notes that are printed.

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


# --- remarks: the loggers `fg_nav.*` ----------------------------------------------------------------------------------

REMARKS = logging.getLogger("fg_nav.remarks")  # What a command says as it goes on, also without -v.
LEVELS = (logging.WARNING, logging.INFO, logging.DEBUG)  # Of all other loggers on the terminal: plain, -v, -vv.
LINE = "%(asctime)s %(levelname)s %(name)s: %(message)s"  # Of a log file.

_hushed = False  # Whether only errors are printed; of the process, as its threads print too.


class TerminalHandler(logging.Handler):
    """Prints remarks, and of other loggers what is at `least` of this level, on standard error; not errors."""

    def __init__(self, least: int) -> None:
        super().__init__()
        self._least = least

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record; a closed output is ignored."""
        least = min(self._least, logging.INFO) if record.name == REMARKS.name else self._least
        if not _hushed and least <= record.levelno < logging.ERROR:
            with suppress(OSError):
                print(self.format(record), file=sys.stderr, flush=True)  # noqa: T201


@contextmanager
def log_records(quiet: bool, verbose: int = 0, file: Path | None = None) -> Iterator[None]:
    """While the block runs, log to the terminal unless `quiet`, and to a file all levels and why it failed.

    Raises `OutputError` if the file cannot be opened.
    """
    global _hushed
    least = LEVELS[min(verbose, len(LEVELS) - 1)]
    handlers: list[logging.Handler] = [TerminalHandler(least)]
    if file is not None:
        try:
            handlers.append(logging.FileHandler(file, encoding="utf-8", errors="backslashreplace"))
        except OSError as error:
            raise OutputError(f"{file} cannot be written ({describe_reason(error)}): name another --log.") from None
        handlers[1].setFormatter(logging.Formatter(LINE))
    top, (_hushed, before) = logging.getLogger("fg_nav"), (quiet, _hushed)
    top.setLevel(min(least, logging.INFO) if file is None else logging.DEBUG)
    for handler in handlers:
        top.addHandler(handler)
    top.debug("fg-nav %s", shlex.join(sys.argv[1:]))
    try:
        yield
    except Exception as error:
        top.error(" ".join(str(error).split()), exc_info=not isinstance(error, FgNavError | OSError))
        raise
    finally:
        _hushed = before
        top.setLevel(logging.NOTSET)
        for handler in handlers:
            top.removeHandler(handler)
            handler.close()


def remark(words: str, level: int = logging.INFO) -> None:
    """Say a sentence to people on standard error, and in a log file."""
    REMARKS.log(level, words)


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
        for line in describe_result(summaries[0]):
            out.print(line, soft_wrap=True)
    remarks = group_notes(collect_notes(summaries)).get(KNOW, [])
    out.print(describe_place(place, len(remarks)), soft_wrap=True)


def describe_result(summary: Mapping[str, object]) -> list[str]:
    """Distance, end and, where known, error of one method, and the coupling of the feet, a line each."""
    known = {key: write(summary[key]) for key, _, write in FIGURES if summary.get(key) is not None}
    sigma = f", sigma {known['distance_sigma_m']} m" if "distance_sigma_m" in known else ""
    strides = format_count(cast("int", summary["strides"]), "stride")
    closure = f"{known.get('closure_m')} m from the start ({known.get('closure_percent')} % of the distance), at "
    end = f"end: {closure if is_loop([summary]) else ''}{_format_place(summary['end_m'], 3)}"
    parts: list[Any] = [part for part in (summary, summary.get("left"), summary.get("right")) if part]
    lines = [
        *(f"note: {note}" for part in parts for note in part["notes"] if note.startswith(FIRST)),
        f"distance: {known['distance_m']} m{sigma}, in {strides}",
        f"{end}, sigma {_format_place(summary['end_sigma_m'], 2)}",
    ]
    if "rmse_2d_m" in known:
        error = f"error: {known['rmse_2d_m']} m rms horizontally, {known['end_error_m']} m at the end"
        lines.append(f"{error}, {known['max_error_m']} m at most; alignment {known['alignment']}")
    if isinstance(fixes := summary.get("fixes"), dict):
        how = f"{fixes['rms_m']:.2f} m rms off over ground, {fixes['beyond_3_sigma']} beyond 3 sigma"
        lines.append(f"fixes: {fixes['count']}, {how}")
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
