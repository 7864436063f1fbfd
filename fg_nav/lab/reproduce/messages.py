"""Text of figures, verdicts and counts, the same on a terminal, in a page and in a document."""

from __future__ import annotations

import math
from collections import Counter

from fg_nav.lab.reproduce.results import (
    AS_ASKED,
    BETTER,
    MISSED,
    MISSED_EXPLAINED,
    PUT_IN,
    REPRODUCED,
    SHORT,
    TOLERANCE,
    Reproduction,
    Row,
)

VERDICTS = (REPRODUCED, BETTER, MISSED_EXPLAINED, MISSED)
"""Of a printed figure, from good to bad."""

ASIDE = (PUT_IN, AS_ASKED, SHORT)
"""What is no comparison with the paper."""

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
    """What is said beside the verdict."""
    return " ".join(text for text in (row.why if row.verdict == MISSED_EXPLAINED else "", row.note) if text)


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
    number = _number(found)
    return {verdict: number[verdict] for verdict in VERDICTS}


def _number(found: Reproduction) -> Counter[str]:
    return Counter(row.verdict for experiment in found.experiments for row in experiment.rows)


def describe_counts(found: Reproduction) -> str:
    """The counts as a sentence."""
    number = count_verdicts(found)
    parts = [f"{count} {verdict}" for verdict, count in number.items() if count]
    aside = [f"{_number(found)[verdict]} {verdict}" for verdict in ASIDE if _number(found)[verdict]]
    beside = f" Beside these, {', '.join(aside)}." if aside else ""
    return f"{sum(number.values())} figures compared: {', '.join(parts) or 'none compared'}.{beside}"


def format_seeds(found: Reproduction) -> str:
    """The seeds, as a range where they are one."""
    seeds = list(found.seeds)
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(str(seed) for seed in seeds)
