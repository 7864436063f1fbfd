"""A paper as a table: what it prints, row by row, with the words beside ours (`table.toml` in the folder of the paper).

A row names what is measured, of which method or case, and the figure as printed. Where ours differs, a reason is shown
only for the field and the side that it was checked on: a reason for a filter worse than printed does not explain one
that is better, nor one floor another, and none explains a filter that failed.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from importlib import resources
from typing import Annotated, Literal, TypeAlias

from pydantic import BeforeValidator, ConfigDict, TypeAdapter

from fg_nav.lab.reproduce.results import Row, Spread

PAPERS = ("ma2018", "aiez2017", "munoz-diaz2017")

Words: TypeAlias = Annotated[str, BeforeValidator(lambda text: " ".join(text.split()))]  # Written over several lines.


@dataclass(frozen=True)
class Reason:
    """Why a figure differs, by its name in the table; off to this side of the printed one, in this field, or in any."""

    because: str
    off: Literal["above", "below", ""] = ""
    field: str = ""

    def explains(self, off: float, level: str) -> bool:
        """Whether it is of a median so far above the printed figure, in this field."""
        side = {"above": off > 0.0, "below": off < 0.0, "": True}
        return self.field in ("", level) and math.isfinite(off) and side[self.off]


@dataclass(frozen=True)
class Line(Row):
    """A row as the table has it, without our figures.

    Attributes
    ----------
    measure : name of the figure that is measured, and its arguments.
    of : filter or case whose it is.
    over : the figure is taken over the same one of this case.
    without : columns that it says nothing of.
    reasons : of a difference, the first that explains it.
    level : of the field, which stands for "{field}" in the quantity; a row with it is one for each field of a run.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    measure: tuple[str | float, ...] = ()
    of: str = ""
    over: str = ""
    without: tuple[str, ...] = ()
    reasons: tuple[Reason, ...] = ()
    level: str = ""


@dataclass(frozen=True)
class Planned:
    """An experiment: its rows, the column that is judged, and the scenario that its methods walk, if they do."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    name: str
    title: str
    source: str  #: where the paper has it
    setting: Words
    columns: tuple[str, ...]
    judged: str
    rows: tuple[Line, ...]
    scenario: str = ""

    def lines(self, levels: Sequence[str]) -> list[Line]:
        """Rows of a run in these fields; what is of no field stands in the first."""
        lines = []
        for line in self.rows:
            for level in levels if "{field}" in line.quantity else levels[:1]:
                quantity = line.quantity.replace("{field}", level)
                lines.append(replace(line, quantity=quantity, level=level, judged=line.judged or self.judged))
        return lines


@dataclass(frozen=True)
class Table:
    """A paper.

    Attributes
    ----------
    paper, citation : short name, as on the command line, and the whole.
    differs, quick : what differs from the paper, and in a quick run besides.
    fields, quick_fields : levels of the field that are walked.
    filters : methods by column, of each filter of the paper.
    detectors : whose parameters are listed.
    reasons : by name.
    experiments : in the order of the paper.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    paper: str
    citation: Words
    differs: tuple[Words, ...]
    experiments: tuple[Planned, ...]
    reasons: Mapping[str, Words]
    quick: Words = ""
    fields: tuple[str, ...] = ("",)
    quick_fields: tuple[str, ...] = ()
    filters: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    detectors: tuple[str, ...] = ()

    @property
    def methods(self) -> list[str]:
        """Methods of all filters, each once."""
        return list(dict.fromkeys(method for columns in self.filters.values() for method in columns.values()))

    def judge(self, line: Line, ours: Mapping[str, Spread]) -> Row:
        """Return the row with our figures, and the reason if there is one."""
        judged = ours.get(line.judged)
        off = math.nan if judged is None or line.paper is None else judged.median - line.paper
        why = next((self.reasons[one.because] for one in line.reasons if one.explains(off, line.level)), "")
        return Row(**{item.name: getattr(line, item.name) for item in fields(Row)} | {"ours": ours, "why": why})


@cache
def read_table(paper: str) -> Table:
    """Read the table of one of `PAPERS`."""
    folder = resources.files("fg_nav.lab.reproduce") / paper.replace("-", "_")
    content = tomllib.loads((folder / "table.toml").read_text(encoding="utf-8"))
    return TypeAdapter(Table).validate_python(content)
