"""A paper as a table (`table.toml` in its folder), and what its rows came to: verdicts, their text, and the file.

A row has the paper's figure p, as printed and as a number where it is one, and what each of our columns (methods)
made of it over the seeds. The verdict (`MEANINGS`) is of one column, the paper's own method, by its median m:
reproduced where |m - p| <= tolerance |p|, or where the paper has a bound ("at most 0.5 m"), m holds it.

A verdict is computed; only the reason is written by hand, and shown only for the field and the side that it was checked
on: a reason for a filter worse than printed does not explain one that is better, nor one floor another, and none
explains a filter that failed. What each key of a table means stands beside the fields of `Line`, `Planned` and `Table`.

The file `results.json` has nothing of time or machine, so the same walks give the same bytes. JSON has no infinity:
what never came or failed is the text "inf", and what is not known is null.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import BeforeValidator, ConfigDict, TypeAdapter, ValidationError

from fg_nav.errors import OutputError
from fg_nav.lab.store.results import Number, encode_number
from fg_nav.text import to_json

PAPERS = ("ma2018", "aiez2017", "munoz-diaz2017")

REPRODUCED, BETTER, MISSED_EXPLAINED, MISSED = "reproduced", "better", "missed (explained)", "missed"
PUT_IN, AS_ASKED, SHORT = "put in", "as asked", "short"
VERDICTS = (REPRODUCED, BETTER, MISSED_EXPLAINED, MISSED)  # Of a printed figure, from good to bad.
ASIDE = (PUT_IN, AS_ASKED, SHORT)  # What is no comparison with the paper.
MEANINGS = {
    REPRODUCED: "as printed within the row's tolerance, or within the printed bound",
    BETTER: "off the printed figure on the good side",
    MISSED_EXPLAINED: "off it on the bad side, and a reason is given",
    MISSED: "off it on the bad side, and there is none",
    PUT_IN: "a setting of ours was chosen by the printed figure, so it is no result",
    AS_ASKED: "within what was asked of ours",
    SHORT: "not within it",
}

TOLERANCE = 0.4  # Share of the printed figure: one walk of theirs, a median of ours, another sensor and building.
LOW_PERCENT, HIGH_PERCENT = 5.0, 95.0  # Of the walks, about the median.
FORM = 2  # Of the file.
PICTURES = "pictures"  # Folder of the pictures of a reproduction.

_TIMES = ("s", "min", "h")


@dataclass(frozen=True)
class Spread:
    """Median over `n` walks, and their 5 and 95 %; infinite where the method failed or the moment never came."""

    median: Number
    low: Number
    high: Number
    n: int


NOTHING = Spread(math.nan, math.nan, math.nan, 0)  # Of no walk.


def spread_of(values: Sequence[float]) -> Spread:
    """Median and spread of one figure over the walks. Infinite ones count, as the largest."""
    x = np.asarray(values, dtype=np.float64)
    if not len(x):
        return NOTHING
    if np.isfinite(x).all():
        low, median, high = np.percentile(x, [LOW_PERCENT, 50.0, HIGH_PERCENT]).tolist()
    else:  # infinite values cannot be interpolated: the next one, away from the middle
        low = float(np.percentile(x, LOW_PERCENT, method="lower"))
        median, high = np.percentile(x, [50.0, HIGH_PERCENT], method="higher").tolist()
    return Spread(median, low, high, len(x))


@dataclass(frozen=True)
class Row:
    """One figure of a paper beside ours."""

    quantity: str
    unit: str = ""  # "" for a pure number
    printed: str = ""  # as it stands in the paper; "" where it does not
    ours: Mapping[str, Spread] = field(default_factory=dict)  # by column
    paper: float | None = None  # the printed figure as a number, None where there is none to compare with
    judged: str = ""  # the column that is the paper's own method
    bound: int = 0  # +1 for "at most", -1 for "at least", 0 for a value
    good: int = (
        0  # -1 less is better, +1 more is, 0 neither: a rate to be met, or a filter that the paper argues against
    )
    tolerance: float = TOLERANCE  # share of `paper` that still is the same
    why: str = ""  # reason of a difference; shown only where there is one
    pattern: str = "{:.2f}"  # of the numbers
    whose: Literal["paper", "input", "asked"] = "paper"  # input: it chose a setting of ours; asked: of ours

    @property
    def verdict(self) -> str:
        """One of `MEANINGS`; "" where there is nothing to compare."""
        if self.paper is None or self.judged not in self.ours or math.isnan(self.ours[self.judged].median):
            return ""
        median = self.ours[self.judged].median
        off = median - self.paper
        near = off * self.bound <= 0 if self.bound else abs(off) <= self.tolerance * abs(self.paper)
        holds = math.isfinite(off) and near
        if self.whose == "asked":
            return AS_ASKED if holds else SHORT
        if holds:
            return PUT_IN if self.whose == "input" else REPRODUCED
        if math.isfinite(median) and off * self.good > 0:
            return BETTER
        return MISSED_EXPLAINED if self.why else MISSED


@dataclass(frozen=True)
class Picture:
    """A file in the folder of the report, named relatively, and what it shows."""

    file: str
    caption: str


@dataclass(frozen=True)
class Experiment:
    """One experiment: its name in the list of the papers' experiments (M-E3), setting, table and pictures."""

    name: str
    title: str
    setting: str
    columns: Sequence[str]
    rows: Sequence[Row]
    pictures: Sequence[Picture] = ()


@dataclass(frozen=True)
class Reproduction:
    """All experiments of a paper, in its order."""

    paper: str  # short name, as on the command line
    citation: str
    seeds: Sequence[int]
    experiments: Sequence[Experiment]
    differs: Sequence[str] = ()  # paragraphs: what differs from the paper, and why
    parameters: Mapping[str, Any] = field(default_factory=dict)  # effective ones, by method
    command: str = ""  # what made this
    versions: Mapping[str, str] = field(default_factory=dict)  # of what it was made with


# --- the table of a paper --------------------------------------------------------------------------------------------

Words: TypeAlias = Annotated[str, BeforeValidator(lambda text: " ".join(text.split()))]  # Written over several lines.


@dataclass(frozen=True)
class Reason:
    """Why a figure differs, by its name in the table; off to this side of the printed one, in this field, or in any."""

    because: str
    off: Literal["above", "below", ""] = ""
    field: str = ""


@dataclass(frozen=True)
class Line(Row):
    """A row as the table has it, without our figures; one with "{field}" in it is one for each field of a run."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    measure: tuple[str | float, ...] = ()  # name of the figure that is measured, and its arguments
    of: str = ""  # filter or case whose it is
    over: str = ""  # the figure is taken over the same one of this case
    without: tuple[str, ...] = ()  # columns that it says nothing of
    reasons: tuple[Reason, ...] = ()  # of a difference, the first that explains it
    level: str = ""  # of the field


@dataclass(frozen=True)
class Planned:
    """An experiment: its rows, the column that is judged, and the scenario that its methods walk, if they do.

    Its figure in the paper, what that shows, and what is drawn of ours, "{}" for by whom.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    name: str
    title: str
    source: str  # where the paper has it
    setting: Words
    columns: tuple[str, ...]
    judged: str
    rows: tuple[Line, ...]
    figure: int = 0
    shows: str = ""
    drawn: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)  # of the figure, by what is in it
    scenario: str = ""

    def lines(self, levels: Sequence[str]) -> list[Line]:
        """Rows of a run in these fields; what is of no field stands in the first, and only there a row is judged.

        A figure is reproduced only on the field on which the paper's others are.
        """
        lines = []
        for line in self.rows:
            for level in levels if "{field}" in line.quantity else levels[:1]:
                quantity, paper = line.quantity.replace("{field}", level), line.paper if level == levels[0] else None
                judged = line.judged or self.judged
                lines.append(replace(line, quantity=quantity, level=level, judged=judged, paper=paper))
        return lines


@dataclass(frozen=True)
class Table:
    """A paper."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    paper: str  # short name, as on the command line
    citation: Words
    differs: tuple[Words, ...]  # what differs from the paper, and why
    experiments: tuple[Planned, ...]
    reasons: Mapping[str, Words]  # by name
    quick: Words = ""  # what a quick run leaves out
    fields: tuple[str, ...] = ("",)  # levels of the field that are walked
    filters: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # methods by column, of each of its filters
    detectors: tuple[str, ...] = ()  # whose parameters are listed

    @property
    def methods(self) -> list[str]:
        """Methods of all filters, each once."""
        return list(dict.fromkeys(method for columns in self.filters.values() for method in columns.values()))

    def judge(self, line: Line, ours: Mapping[str, Spread]) -> Row:
        """Return the row with our figures, and the first reason that is of such a median in this field."""
        judged = ours.get(line.judged)
        off = math.nan if judged is None or line.paper is None else judged.median - line.paper
        side = {"above": off > 0.0, "below": off < 0.0, "": True}
        fitting = (
            one for one in line.reasons if one.field in ("", line.level) and math.isfinite(off) and side[one.off]
        )
        why = next((self.reasons[one.because] for one in fitting), "")
        return Row(**{item.name: getattr(line, item.name) for item in fields(Row)} | {"ours": ours, "why": why})


@cache
def read_table(paper: str) -> Table:
    """Read the table of one of `PAPERS`."""
    folder = resources.files("fg_nav.lab.reproduce") / paper.replace("-", "_")
    content = tomllib.loads((folder / "table.toml").read_text(encoding="utf-8"))
    return TypeAdapter(Table).validate_python(content)


# --- words -----------------------------------------------------------------------------------------------------------


def format_name(row: Row) -> str:
    """What a row is of, with its unit."""
    return f"{row.quantity} ({row.unit})" if row.unit else row.quantity


def format_printed(row: Row) -> str:
    """The paper's figure, with the row's own tolerance where it has one."""
    own = row.paper is not None and row.verdict and not row.bound and row.tolerance != TOLERANCE
    return f"{row.printed} (within {100 * row.tolerance:.0f} %)" if own else row.printed or "-"


def format_note(row: Row) -> str:
    """The reason, beside a verdict that needs one."""
    return row.why if row.verdict == MISSED_EXPLAINED else ""


def format_spread(row: Row, column: str, walks: int) -> str:
    """Median (5 to 95 %) of a column, with the number of values where it is not that of the walks.

    Infinite is a moment that never came, a ratio to one, or a method that failed.
    """
    one = row.ours.get(column)
    if one is None or one.n == 0:
        return "-"
    infinite = "infinite" if not row.unit else "never" if row.unit in _TIMES else "failed"
    middle, low, high = (
        "-" if math.isnan(value) else infinite if math.isinf(value) else row.pattern.format(value)
        for value in (one.median, one.low, one.high)
    )
    if one.n == 1 or one.low == one.high:
        return middle if one.n in (1, walks) else f"{middle} (n {one.n})"
    return f"{middle} ({low} to {high}{'' if one.n == walks else f', n {one.n}'})"


def count_verdicts(found: Reproduction, verdicts: Sequence[str] = VERDICTS) -> dict[str, int]:
    """How many figures have each of these verdicts."""
    all_of = [row.verdict for experiment in found.experiments for row in experiment.rows]
    return {verdict: all_of.count(verdict) for verdict in verdicts}


def describe_counts(found: Reproduction) -> str:
    """The counts as a sentence."""
    number = count_verdicts(found)
    parts, aside = (
        ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count)
        for counts in (number, count_verdicts(found, ASIDE))
    )
    beside = f" Beside these, {aside}." if aside else ""
    return f"{sum(number.values())} figures compared: {parts or 'none compared'}.{beside}"


def format_seeds(found: Reproduction) -> str:
    """The seeds, as a range where they are one."""
    seeds = list(found.seeds)
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(str(seed) for seed in seeds)


# --- the file --------------------------------------------------------------------------------------------------------


def write_reproduction(found: Reproduction) -> str:
    """Return the text of the file."""
    return json.dumps(describe_reproduction(found), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def describe_reproduction(found: Reproduction) -> dict[str, Any]:
    """Return the content of the file, with each row's verdict for readers without this library."""
    content = {"form": FORM, **to_json(found)}
    for experiment, written in zip(found.experiments, content["experiments"], strict=True):
        for row, of_row in zip(experiment.rows, written["rows"], strict=True):
            of_row["ours"] = {
                column: {name: encode_number(value) for name, value in asdict(one).items()}
                for column, one in row.ours.items()
            }
            of_row["verdict"] = row.verdict
    return content


def read_reproduction(path: Path) -> Reproduction:
    """Read a file; raises `OutputError` if it is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content.pop("form") != FORM:
            raise ValueError("another form")
        return TypeAdapter(Reproduction).validate_python(content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ValidationError):
        words = "is no result of `fg-nav lab reproduce`, or one of another version: make it again."
        raise OutputError(f"{path} {words}") from None
