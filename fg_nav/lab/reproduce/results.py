"""What an experiment of a paper came to: the paper's figures beside ours, each with a verdict, and the pictures.

A row has the paper's figure p, as printed and as a number where it is one, and what each of our columns (methods)
made of it over the seeds. The verdict is of one column, the paper's own method, by its median m:

    reproduced     |m - p| <= tolerance |p|, or where the paper has a bound ("at most 0.5 m"): m holds it
    better         m is off p on the good side
    missed         off on the bad side; `explained` is noted where `why` gives a reason for that side
    put in         m is p because a setting of ours was chosen by p: it is no result
    as asked       p is a bound that was asked of ours, not the paper's, and m holds it
    short          it does not
    ""             the paper has no figure for it, or ours has none

So a verdict is computed, and only the reason is written by hand.

Reasons why a figure of ours is off the printed one, each for the field and the side that it was looked at on.

A reason that was found for a filter that is worse than printed does not explain one that is better, and what holds on
one floor need not on another: there it is left out, and the figure stays unexplained.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.store.entries import Number

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
    x = np.sort(np.asarray(values, dtype=np.float64))
    if not len(x):
        return Spread(math.nan, math.nan, math.nan, 0)
    low, median, high = (_percentile(x, q, up=q >= 50.0) for q in (LOW_PERCENT, 50.0, HIGH_PERCENT))
    return Spread(median, low, high, len(x))


def _percentile(x: Floats, q: float, up: bool) -> float:
    """Of sorted values; infinite ones cannot be interpolated, and then it is the next value up or down."""
    if np.isfinite(x).all():
        return float(np.percentile(x, q))
    place = q / 100.0 * (len(x) - 1)
    return float(x[math.ceil(place) if up else math.floor(place)])


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
    side : where the reason holds: +1 where ours is above the printed figure, -1 below, 0 on either side.
    note : what is to be known in any case.
    """

    quantity: str
    unit: str
    printed: str
    ours: Mapping[str, Spread]
    paper: float | None = None
    judged: str = ""
    bound: int = 0
    good: int = -1
    tolerance: float = TOLERANCE
    why: str = ""
    pattern: str = "{:.2f}"
    whose: Literal["paper", "input", "asked"] = "paper"
    side: int = 0
    note: str = ""

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
        holds = not self.side or (median - self.paper) * self.side > 0
        return MISSED_EXPLAINED if self.why and holds else MISSED

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


def one_line(text: str) -> str:
    """Return a text that was written over several lines as one."""
    return " ".join(text.split())


ABOVE, BELOW = 1, -1
"""Where ours lies of the printed figure."""


@dataclass(frozen=True)
class Reason:
    """A text, the side on which it was checked, and in which field; "" for each or for none."""

    text: str
    side: int
    field: str = ""


def reason_for(reasons: Sequence[Reason], field: str, off: float) -> str:
    """Text of the first reason for this field and a median so far above the printed figure; "" where there is none.

    A filter that failed is infinitely far off, and none of the reasons is of that.
    """
    held = (one.text for one in reasons if one.field in ("", field) and 0.0 < off * one.side < math.inf)
    return one_line(next(held, ""))
