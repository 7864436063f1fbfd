"""A reproduction as a file, `results.json`: nothing of time or machine in it, so the same walks give the same bytes.

JSON knows no infinity: what never came or failed is the text "inf" there, and what is not known is null.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from fg_nav.errors import OutputError
from fg_nav.lab.campaign.whole import whole
from fg_nav.lab.reproduce.results import Experiment, Picture, Reproduction, Row, Spread
from fg_nav.plain import plain

FORM = 2
"""Of the file."""


def written(found: Reproduction) -> str:
    """Return the text of the file. Each row's verdict is told too, for those who read it without this library."""
    content = {"form": FORM, **plain(found)}
    for experiment, beside in zip(found.experiments, content["experiments"], strict=True):
        beside["rows"] = [_row(row) for row in experiment.rows]
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _row(row: Row) -> dict[str, Any]:
    ours = {name: {**plain(one), **{part: in_json(getattr(one, part)) for part in _PARTS}} for name, one in _cells(row)}
    return {**plain(row), "ours": ours, "verdict": row.verdict}


_PARTS = ("median", "low", "high")


def _cells(row: Row) -> list[tuple[str, Spread]]:
    return list(row.ours.items())


def in_json(value: float) -> float | str | None:
    """Return a number as it stands in a file."""
    if math.isnan(value):
        return None
    return value if math.isfinite(value) else str(value)


def from_json(told: float | str | None) -> float:
    """Return a number as it was."""
    return math.nan if told is None else float(told)


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
        return _reproduction(content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        words = "is no result of `fg-nav reproduce`, or one of another version: make it anew."
        raise OutputError(f"{path} {words}") from None


def _reproduction(content: dict[str, Any]) -> Reproduction:
    for name in ("seeds", "differs"):
        content[name] = tuple(content[name])
    content["experiments"] = tuple(_experiment(one) for one in content["experiments"])
    return Reproduction(**content)


def _experiment(content: dict[str, Any]) -> Experiment:
    rows = tuple(_row_of(row) for row in content.pop("rows"))
    pictures = tuple(Picture(**picture) for picture in content.pop("pictures"))
    return Experiment(**{**content, "columns": tuple(content["columns"])}, rows=rows, pictures=pictures)


def _row_of(content: dict[str, Any]) -> Row:
    del content["verdict"]
    return Row(**{**content, "ours": {name: _spread(one) for name, one in content["ours"].items()}})


def _spread(content: dict[str, Any]) -> Spread:
    median, low, high = (from_json(content[part]) for part in _PARTS)
    return Spread(median, low, high, int(content["n"]))


def write_whole(path: Path, text: str) -> None:
    """Write a text that appears whole or not at all; raises `OutputError` where the system refuses."""
    with whole(path) as beside:
        beside.write_text(text, encoding="utf-8")
