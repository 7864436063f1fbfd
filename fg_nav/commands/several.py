"""Several recordings in one call: one after the other, one table at the end; a bad one does not stop the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from fg_nav.commands import Answer, name_walk
from fg_nav.errors import FgNavError, RecordingError
from fg_nav.report.terminal import console, ruled_table
from fg_nav.text import to_json

Columns: TypeAlias = Mapping[str, Callable[[Mapping[str, Any]], str]]
"""Heads of a table, and what stands below each by the content of an answer."""

FAILED = "failed"

MAX_SENTENCES = 5  # That are said at the end; each recording has its own in the JSON.


def answer_each(recordings: Sequence[Path], verb: Callable[[Path], Answer], columns: Columns) -> Answer:
    """Return the answers of a verb to several recordings as one; its failure names those that failed."""
    contents, sentences = [], []
    for recording in recordings:
        content, failure = _try(verb, recording)
        if failure is not None:
            content["error"] = " ".join(str(failure).split())
            named = recording.name in content["error"]
            sentences.append(content["error"] if named else f"{recording}: {content['error']}")
        contents.append(content)
    return Answer(contents, partial(print_table, contents, columns), _sum_up(sentences, len(recordings)))


def _try(verb: Callable[[Path], Answer], recording: Path) -> tuple[dict[str, Any], Exception | None]:
    try:
        answer = verb(recording)
    except (FgNavError, OSError) as error:
        return {"recording": str(recording)}, error
    return to_json(answer.content), answer.failure


def _sum_up(sentences: Sequence[str], number: int) -> FgNavError | None:
    if not sentences:
        return None
    more = len(sentences) - MAX_SENTENCES
    said = " ".join([*sentences[:MAX_SENTENCES], *([f"And {more} more."] if more > 0 else [])])
    return RecordingError(f"{len(sentences)} of {number} recordings failed. {said}")


def print_table(contents: Sequence[Mapping[str, Any]], columns: Columns) -> None:
    """Print one row a recording; where there is nothing to say of it, that it failed."""
    table = ruled_table("recording", *columns)
    for content in contents:
        known = len(content.keys() - {"recording", "error"}) > 0
        cells = [cell(content) for cell in columns.values()] if known else [FAILED, *([""] * (len(columns) - 1))]
        table.add_row(content["recording"], *cells)
    console().print(table)


def show_number(key: str, pattern: str) -> Callable[[Mapping[str, Any]], str]:
    """Return what writes a number of a content; a dash where it is not known."""

    def show(content: Mapping[str, Any]) -> str:
        value = content.get(key)
        return "-" if value is None else pattern.format(value)

    return show


def name_walks(recordings: Sequence[Path]) -> dict[Path, str]:
    """Return names for results of several recordings in one folder: a number behind those that are the same."""
    names: dict[Path, str] = {}
    seen: Counter[str] = Counter()
    for recording in recordings:
        name = name_walk(recording)
        seen[name] += 1
        names[recording] = name if seen[name] == 1 else f"{name}-{seen[name]}"
    return names
