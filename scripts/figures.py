"""Figures that were asked for beside figures that were measured.

A figure is `ok` where it lies within what was asked (bounds included), `short` where it does not, and bears no mark
where nothing was asked of it. What could not be measured is infinite, and so is short.

Tables are drawn on a terminal and plain text in a pipe; the same figures go to a file as JSON.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from rich import box
from rich.table import Table
from rich.text import Text

from fg_nav.errors import FgNavError, OutputError
from fg_nav.report.terminal import console


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
        """What was asked, in words."""
        low, high = self.pattern.format(self.low), self.pattern.format(self.high)
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"{low} to {high}"
        if math.isfinite(self.high):
            return f"<= {high}"
        return f">= {low}" if math.isfinite(self.low) else ""

    @property
    def mark(self) -> str:
        """`ok`, `short`, or nothing where nothing was asked."""
        if not self.asked:
            return ""
        return "ok" if math.isfinite(self.measured) and self.low <= self.measured <= self.high else "short"

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON; an infinite number is null there."""
        return {
            "section": self.section,
            "name": self.name,
            "method": self.method,
            "measured": finite(self.measured),
            "low": finite(self.low),
            "high": finite(self.high),
            "mark": self.mark,
        }


def finite(value: object) -> object:
    """Return the value, or None for a number that JSON does not know."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_heading(words: str) -> None:
    """Begin a section."""
    console().print(f"\n{words}", style="bold")


def print_figures(figures: Sequence[Figure]) -> None:
    """One row a figure: asked, measured, mark."""
    rows = [(f.name, f.method, f.asked or "-", f.pattern.format(f.measured), f.mark) for f in figures]
    print_table(("figure", "method", "asked", "measured", ""), rows)


def print_table(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """First column to the left, the others to the right."""
    table = Table(box=box.SIMPLE_HEAD if sys.stdout.isatty() else None, pad_edge=False)
    for i, header in enumerate(headers):
        table.add_column(Text(header), justify="right" if i else "left")
    for row in rows:
        table.add_row(*(Text(cell, style="bold red" if cell == "short" else "") for cell in row))
    console().print(table)


def print_verdict(figures: Sequence[Figure]) -> None:
    """How many figures are as asked, and which are not."""
    asked = [figure for figure in figures if figure.mark]
    short = [figure for figure in asked if figure.mark == "short"]
    console().print(f"\n{len(asked) - len(short)} of {len(asked)} figures are as asked.")
    for f in short:
        measured = f.pattern.format(f.measured)
        console().print(f"short: {f.section}, {f.name}, {f.method}: {measured}, asked {f.asked}")


def write_json(path: Path, content: Mapping[str, object]) -> None:
    """Write the figures; raises `OutputError` where the system refuses."""
    try:
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path} could not be written ({error.strerror}): name another file.") from error


def leave_with(script: Callable[[], None]) -> NoReturn:
    """Run a script and exit: 0 when done, 1 with one sentence where its input is to blame."""
    try:
        script()
    except FgNavError as error:
        print(error, file=sys.stderr)
        sys.exit(1)
    sys.exit(0)
