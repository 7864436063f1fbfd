"""How figures, verdicts and counts are told, the same on a terminal, in a page and in a document."""

from __future__ import annotations

import math
from collections import Counter

from fg_nav.reproduce.results import BETTER, EXPLAINED, NOT_REPRODUCED, REPRODUCED, Reproduction, Row

VERDICTS = (REPRODUCED, BETTER, EXPLAINED, NOT_REPRODUCED)
"""From good to bad."""

MEANINGS = {
    REPRODUCED: "as printed within the row's tolerance, or within the printed bound",
    BETTER: "off the printed figure on the good side",
    EXPLAINED: "off it, and why is told",
    NOT_REPRODUCED: "off it, and nobody knows why",
}

_TIMES = ("s", "min", "h")


def named(row: Row) -> str:
    """What a row is of, with its unit."""
    return f"{row.quantity} ({row.unit})" if row.unit else row.quantity


def told(row: Row, column: str, walks: int) -> str:
    """Median (5 to 95 %) of a column, with the number of values where it is not that of the walks."""
    one = row.ours.get(column)
    if one is None or one.n == 0:
        return "-"
    middle = _value(row, one.median)
    if one.n == 1 or one.low == one.high:
        return middle
    count = "" if one.n == walks else f", n {one.n}"
    return f"{middle} ({_value(row, one.low)} to {_value(row, one.high)}{count})"


def _value(row: Row, value: float) -> str:
    """A number by the row's pattern; infinite is a moment that never came, a ratio to one, or a method that failed."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "infinite" if not row.unit else "never" if row.unit in _TIMES else "failed"
    return row.pattern.format(value)


def counts(found: Reproduction) -> dict[str, int]:
    """How many rows have each verdict, in the order of `VERDICTS`."""
    number = Counter(row.verdict for experiment in found.experiments for row in experiment.rows)
    return {verdict: number[verdict] for verdict in VERDICTS}


def counted(found: Reproduction) -> str:
    """The counts as a sentence."""
    number = counts(found)
    parts = [f"{count} {verdict}" for verdict, count in number.items() if count]
    return f"{sum(number.values())} figures compared: {', '.join(parts) or 'none compared'}."


def seeds_told(found: Reproduction) -> str:
    """The seeds, as a range where they are one."""
    seeds = list(found.seeds)
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(str(seed) for seed in seeds)
