"""A reproduction as a file, `results.json`: nothing of time or machine in it, so the same walks give the same bytes.

JSON has no infinity: what never came or failed is the text "inf" there, and what is not known is null.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce.results import Reproduction, Row, Spread
from fg_nav.lab.store.entries import encode_number
from fg_nav.text import to_json

FORM = 2
"""Of the file."""


def write_reproduction(found: Reproduction) -> str:
    """Return the text of the file, with each row's verdict for readers without this library."""
    content = {"form": FORM, **to_json(found)}
    for experiment, written in zip(found.experiments, content["experiments"], strict=True):
        written["rows"] = [_row(row) for row in experiment.rows]
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _row(row: Row) -> dict[str, Any]:
    return {**to_json(row), "ours": {name: _spread(one) for name, one in row.ours.items()}, "verdict": row.verdict}


def _spread(one: Spread) -> dict[str, Any]:
    numbers = {name: encode_number(getattr(one, name)) for name in ("median", "low", "high")}
    return {**numbers, "n": one.n}


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
        words = "is no result of `fg-nav reproduce`, or one of another version: make it again."
        raise OutputError(f"{path} {words}") from None
