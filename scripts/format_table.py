"""What becomes of files that sensors and phones really write: format by format, read or refused, and what is said.

    python scripts/format_table.py [--data DIR] [FILE ...]

Without names these are all files and folders below `formats` in the folder of the real recordings. A folder that is a
recording by itself is one row, else there is one for each of its files. Where a refusal names an option to add
(`--rate 100`, `--sensor 'Left Foot'`), the file is read once more with it, and the row says so.

=========== ===========================================================================================
read        a recording that can be navigated with: rate, and median strength of the field in uT
unusable    read, but not to be navigated with: why
refused     not read: why, and what to do
=========== ===========================================================================================
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import harness
import numpy as np
import walks

from fg_nav.errors import FormatError, RecordingError
from fg_nav.io import FORMATS, read_raw
from fg_nav.io.content import read_content
from fg_nav.recording import RawRecording, Recording

_COMMAND = re.compile(r"--(?:rate|sensor|columns) .+")
_OPTIONS: Mapping[str, tuple[str, Callable[[str], Any]]] = {
    "--rate": ("rate_hz", float),
    "--sensor": ("sensor", str),
    "--columns": ("columns", str),
}


class Row(NamedTuple):
    """What became of a file."""

    name: str
    format: str
    outcome: str
    samples: str = ""
    rate_hz: str = ""
    field_uT: str = ""
    words: str = ""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run from the command line."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        data=None,
        files=harness.option([], "these only", type=Path, nargs="*", metavar="FILE", positional=True),
    )
    folder = walks.data_folder(chosen.data) / "formats"
    places = chosen.files or sorted(part for part in folder.iterdir() if part.is_dir())
    print("\n".join(format_rows([row for place in places for row in judge(place, folder)])))


def judge(place: Path, base: Path) -> Iterator[Row]:
    """Rows of a file, or of a folder and what is in it; names are from the folder `base` on."""
    name = place.relative_to(base).as_posix() if place.is_relative_to(base) else place.name
    try:
        if place.is_dir() and not _is_recording(place):
            for part in sorted(place.iterdir()):
                yield from judge(part, base)
            return
        yield _judge_one(place, name, {}, "")
    except FormatError as error:
        yield _ask_again(place, name, str(error))


def _is_recording(folder: Path) -> bool:
    content = read_content(folder)
    return any(content.kind in known.kinds and known.recognizes(content) for known in FORMATS.values())


def _ask_again(place: Path, name: str, refusal: str) -> Row:
    """Row of a file that was refused; if the refusal says what to add, of the file with that."""
    command = _COMMAND.search(refusal)
    words = shlex.split(command[0].rstrip("`.")) if command else []
    asked = [(flag, value) for flag, value in pairwise(words) if flag in _OPTIONS]
    if not asked:
        return Row(name, "", "refused", words=refusal)
    told = {_OPTIONS[flag][0]: _OPTIONS[flag][1](value) for flag, value in asked}
    try:
        return _judge_one(place, name, told, f" with {shlex.join(word for pair in asked for word in pair)}")
    except FormatError as error:
        return Row(name, "", "refused", words=f"{refusal} Then: {error}")


def _judge_one(place: Path, name: str, told: Mapping[str, Any], words: str) -> Row:
    raw = read_raw(place, **told)
    try:
        recording = Recording.from_raw(raw)
    except RecordingError as error:
        return _row(raw, name, "unusable" + words, str(error).removeprefix(f"{place.name}: "))
    rate = f"{1.0 / recording.period_s:.1f}"
    return _row(raw, name, "read" + words, "; ".join(recording.provenance.notes))._replace(rate_hz=rate)


def _row(raw: RawRecording, name: str, outcome: str, words: str) -> Row:
    field = np.empty(0) if raw.mag is None else np.linalg.norm(raw.mag[np.isfinite(raw.mag).all(axis=1)], axis=1)
    strength = f"{np.median(field):.1f}" if field.size else "-"
    return Row(name, raw.provenance.format, outcome, str(len(raw.t)), "", strength, words)


def format_rows(rows: Sequence[Row]) -> list[str]:
    """Lines of a table in Markdown, and how many rows there are of each outcome."""
    lines = ["| file | format | outcome | samples | Hz | field uT | in words |", "|---|---|---|---:|---:|---:|---|"]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    kinds = [row.outcome.split()[0] for row in rows]
    return [*lines, "", ", ".join(f"{kinds.count(kind)} {kind}" for kind in ("read", "unusable", "refused"))]


if __name__ == "__main__":
    harness.run(main)
