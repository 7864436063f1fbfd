"""What is printed: tables, and progress on a terminal only. In a pipe all is plain text, lines unbroken."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import cast

from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

_PIPE_WIDTH = 1000

FIGURES = (
    ("distance_m", "distance (m)", "{:.2f}"),
    ("distance_sigma_m", "its sigma (m)", "{:.2f}"),
    ("strides", "strides", "{:d}"),
    ("strides_true", "strides in truth", "{:d}"),
    ("closure_m", "start to end (m)", "{:.3f}"),
    ("closure_percent", "start to end (%)", "{:.2f}"),
    ("rmse_2d_m", "rmse 2-D (m)", "{:.3f}"),
    ("rmse_3d_m", "rmse 3-D (m)", "{:.3f}"),
    ("end_error_m", "end error (m)", "{:.3f}"),
    ("max_error_m", "max error (m)", "{:.3f}"),
    ("moment_rmse_2d_m", "rmse 2-D at the moment (m)", "{:.3f}"),
    ("moment_end_error_m", "end error at the moment (m)", "{:.3f}"),
    ("polished_rmse_2d_m", "rmse 2-D in batch (m)", "{:.3f}"),
    ("polished_closure_m", "start to end in batch (m)", "{:.3f}"),
    ("polish_gap_rms_m", "apart from batch, rms (m)", "{:.3f}"),
    ("polish_gap_max_m", "apart from batch, most (m)", "{:.3f}"),
    ("polish_gap_heading_deg", "apart from batch (deg)", "{:.2f}"),
    ("heading_rmse_deg", "heading rmse (deg)", "{:.2f}"),
    ("scale", "best-fit scale", "{:.4f}"),
    ("alignment", "alignment", "{}"),
    ("magnetometer", "magnetometer", "{}"),
    ("runtime_s", "runtime (s)", "{:.2f}"),
    ("realtime_factor", "times real time", "{:.0f}"),
)
"""Key of the summary, words, and format of every row of a result table."""


def console() -> Console:
    """Return a console on standard output: as wide as the terminal, or as wide as needed in a pipe."""
    return Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else _PIPE_WIDTH)


def print_results(summaries: Sequence[Mapping[str, object]], place: Path) -> None:
    """Print the table of figures, the notes that go with it, and where the files are."""
    out = console()
    out.print(result_table(summaries))
    for words in notes_of(summaries):
        out.print(words)
    print_place([], place)
    for summary in summaries:
        out.print(_describe_verdict(summary, len(summaries) > 1), soft_wrap=True)


def _describe_verdict(summary: Mapping[str, object], named: bool) -> str:
    """The verdict on a path in one line, with its reasons."""
    reasons = "; ".join(cast("list[str]", summary["reasons"]))
    who = f" ({summary['method']})" if named else ""
    return f"verdict{who}: {summary['verdict']}" + (f": {reasons}" if reasons else "")


def print_place(notes: Sequence[str], place: Path) -> None:
    """Print the notes, and where files and pictures are."""
    out = console()
    for note in notes:
        out.print(f"note: {note}", soft_wrap=True)
    out.print(f"files: {place}", soft_wrap=True)
    pictures = sorted(path.name for path in place.glob("*.png"))
    if pictures:
        out.print(f"pictures: {', '.join(pictures)}", soft_wrap=True)


def notes_of(summaries: Sequence[Mapping[str, object]]) -> list[str]:
    """Lines of notes; of several methods each note says whose it is, unless it is everybody's."""
    said = {str(summary["method"]): cast("list[str]", summary["notes"]) for summary in summaries}
    shared = [note for note in next(iter(said.values())) if all(note in notes for notes in said.values())]
    own = [(name, note) for name, notes in said.items() for note in notes if note not in shared]
    own += [(str(one["method"]), _describe_graph(one["graph"])) for one in summaries if one.get("graph")]
    return [f"note: {note}" for note in shared] + [f"note ({name}): {note}" for name, note in own]


def _describe_graph(counts: object) -> str:
    words = ", ".join(f"{count} {kind.replace('_', ' ')}" for kind, count in cast("dict[str, int]", counts).items())
    return f"graph: {words}"


def result_table(summaries: Sequence[Mapping[str, object]]) -> Table:
    """One column a method, one row a figure that at least one of them has."""
    table = ruled_table("", *(str(summary["method"]) for summary in summaries))
    for key, words, pattern in FIGURES:
        values = [summary.get(key) for summary in summaries]
        if any(value is not None for value in values):
            table.add_row(words, *("-" if value is None else pattern.format(value) for value in values))
    return table


def listing(rows: Sequence[tuple[str, str]]) -> Table:
    """Names and values."""
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
    """Show a bar on standard error while the block runs; yields what takes the fraction done."""
    errors = Console(stderr=True)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    shown = sys.stderr.isatty() and not errors.is_dumb_terminal
    with Progress(*columns, console=errors, transient=True, disable=not shown) as bars:
        task = bars.add_task(words, total=None)
        yield lambda fraction: bars.update(task, total=1.0, completed=fraction)
