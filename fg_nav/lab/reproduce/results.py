"""What an experiment of a paper came to: rows of figures with a verdict, their text, reasons, pictures, and the file.

A row has the paper's figure p, as printed and as a number where it is one, and what each of our columns (methods)
made of it over the seeds. The verdict (`MEANINGS`) is of one column, the paper's own method, by its median m:
reproduced where |m - p| <= tolerance |p|, or where the paper has a bound ("at most 0.5 m"), m holds it. A verdict is
computed; only the reason is written by hand (`fg_nav.lab.reproduce.table`).

The file `results.json` has nothing of time or machine, so the same walks give the same bytes. JSON has no infinity:
what never came or failed is the text "inf", and what is not known is null.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import TypeAdapter, ValidationError

from fg_nav.errors import OutputError
from fg_nav.lab.store.results import Number, encode_number
from fg_nav.text import to_json

REPRODUCED, BETTER, MISSED_EXPLAINED, MISSED = "reproduced", "better", "missed (explained)", "missed"
PUT_IN, AS_ASKED, SHORT = "put in", "as asked", "short"

TOLERANCE = 0.4
"""Share of the printed figure: one walk of theirs beside a median of ours, with another sensor and building."""

LOW_PERCENT, HIGH_PERCENT = 5.0, 95.0


@dataclass(frozen=True)
class Spread:
    """Median over `n` walks, and their 5 and 95 %; infinite where the method failed or the moment never came."""

    median: Number
    low: Number
    high: Number
    n: int


def spread_of(values: Sequence[float]) -> Spread:
    """Median and spread of one figure over the walks; NaN of none. Infinite ones count, as the largest."""
    x = np.asarray(values, dtype=np.float64)
    if not len(x):
        return Spread(math.nan, math.nan, math.nan, 0)
    if np.isfinite(x).all():
        low, median, high = np.percentile(x, [LOW_PERCENT, 50.0, HIGH_PERCENT]).tolist()
    else:  # infinite values cannot be interpolated: the next one, away from the middle
        low = float(np.percentile(x, LOW_PERCENT, method="lower"))
        median, high = np.percentile(x, [50.0, HIGH_PERCENT], method="higher").tolist()
    return Spread(median, low, high, len(x))


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes
    ----------
    quantity, unit : what it is; "" for a pure number.
    printed : as it stands in the paper; "" where it does not.
    ours : by column.
    paper : the printed figure as a number, None where there is none to compare with.
    judged : the column that is the paper's own method.
    bound : the paper gives a bound and not a value: +1 for "at most", -1 for "at least", 0 for a value.
    good : -1 where less is better, +1 where more is, 0 where neither: a rate to be met, or a filter that the paper
        argues against.
    tolerance : share of `paper` that still is the same.
    why : reason of a difference; shown only where there is one.
    pattern : of the numbers.
    whose : "paper"; "input" where a setting of ours was chosen by it; "asked" where it was asked of ours.
    """

    quantity: str
    unit: str = ""
    printed: str = ""
    ours: Mapping[str, Spread] = field(default_factory=dict)
    paper: float | None = None
    judged: str = ""
    bound: int = 0
    good: int = 0
    tolerance: float = TOLERANCE
    why: str = ""
    pattern: str = "{:.2f}"
    whose: Literal["paper", "input", "asked"] = "paper"

    @property
    def verdict(self) -> str:
        """As in the table above."""
        if self.paper is None or self.judged not in self.ours or math.isnan(self.ours[self.judged].median):
            return ""
        if self.whose == "asked":
            return AS_ASKED if self._holds else SHORT
        if self._holds:
            return PUT_IN if self.whose == "input" else REPRODUCED
        median = self.ours[self.judged].median
        if math.isfinite(median) and (median - self.paper) * self.good > 0:
            return BETTER
        return MISSED_EXPLAINED if self.why else MISSED

    @property
    def _holds(self) -> bool:
        """Whether the judged median is the paper's figure or within its bound; an infinite one failed."""
        assert self.paper is not None
        off = self.ours[self.judged].median - self.paper
        if not math.isfinite(off):
            return False
        return off * self.bound <= 0 if self.bound else abs(off) <= self.tolerance * abs(self.paper)


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
    """All experiments of a paper.

    Attributes
    ----------
    paper : its short name, as on the command line.
    citation : authors, year, title, journal.
    seeds : of the simulated walks.
    experiments : in the order of the paper.
    differs : paragraphs: what differs from the paper, and why.
    parameters : effective ones, by method.
    command : what made this; "" where no command did.
    versions : of what it was made with.
    """

    paper: str
    citation: str
    seeds: Sequence[int]
    experiments: Sequence[Experiment]
    differs: Sequence[str] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    command: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)


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

_TIMES = ("s", "min", "h")


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
    """Median (5 to 95 %) of a column, with the number of values where it is not that of the walks."""
    one = row.ours.get(column)
    if one is None or one.n == 0:
        return "-"
    middle = _value(row, one.median)
    if one.n == 1 or one.low == one.high:
        return middle if one.n in (1, walks) else f"{middle} (n {one.n})"
    count = "" if one.n == walks else f", n {one.n}"
    return f"{middle} ({_value(row, one.low)} to {_value(row, one.high)}{count})"


def _value(row: Row, value: float) -> str:
    """A number by the row's pattern; infinite is a moment that never came, a ratio to one, or a method that failed."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "infinite" if not row.unit else "never" if row.unit in _TIMES else "failed"
    return row.pattern.format(value)


def count_verdicts(found: Reproduction) -> dict[str, int]:
    """How many printed figures have each verdict, in the order of `VERDICTS`."""
    return {verdict: _verdicts(found).count(verdict) for verdict in VERDICTS}


def _verdicts(found: Reproduction) -> list[str]:
    return [row.verdict for experiment in found.experiments for row in experiment.rows]


def describe_counts(found: Reproduction) -> str:
    """The counts as a sentence."""
    number = count_verdicts(found)
    parts = [f"{count} {verdict}" for verdict, count in number.items() if count]
    aside = [f"{count} {verdict}" for verdict in ASIDE if (count := _verdicts(found).count(verdict))]
    beside = f" Beside these, {', '.join(aside)}." if aside else ""
    return f"{sum(number.values())} figures compared: {', '.join(parts) or 'none compared'}.{beside}"


def format_seeds(found: Reproduction) -> str:
    """The seeds, as a range where they are one."""
    seeds = list(found.seeds)
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(str(seed) for seed in seeds)


FORM = 2  # Of the file.


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
    """Read a file.

    Raises
    ------
    OutputError
        If it is none.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content.pop("form") != FORM:
            raise ValueError("another form")
        return TypeAdapter(Reproduction).validate_python(content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ValidationError):
        words = "is no result of `fg-nav lab reproduce`, or one of another version: make it again."
        raise OutputError(f"{path} {words}") from None
