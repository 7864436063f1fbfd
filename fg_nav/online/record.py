"""The record of a stream, from which a walk that was killed goes on: its samples as they came, and the lines it gave.

FILE has the samples, FILE.lines the lines (docs/online.md), among them `walk` (version and options; at the start and at
each resume, with the number of samples before) and `header` (columns of the source). Samples are written before the
lines that they complete, and these before anybody is given them, in one write for each block of samples. What was cut
off at the end of a file is cut away. Replayed, the samples bring everything that judges them to where it was; the lines
say which footfalls were given, where and in which map.
"""

from __future__ import annotations

import json
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.mapping import CANONICAL
from fg_nav.errors import EstimationError, FormatError, OutputError, describe_reason
from fg_nav.io.content import read_content
from fg_nav.io.formats import FORMATS
from fg_nav.io.writing import format_rows
from fg_nav.online.buffer import rows_of
from fg_nav.online.estimates import Revision, StanceEstimate, parse_estimate
from fg_nav.samples.delivery import Overlap
from fg_nav.samples.readings import COLUMNS
from fg_nav.system.processes import lock
from fg_nav.text import format_count, to_json

RETRY_S = 1.0  # Between two attempts to write on a disk without room.
SYNC_S = 5.0  # Between two times that a file is brought to the disk, for a power cut.
HEADER = ",".join(CANONICAL) + "\n"
LINES = ".lines"  # Behind the name of the record.
WORDS = {  # For what must be the same where a walk is resumed.
    "version": "another version of fg-nav",
    "options": "other options",
    "calibration": "another calibration",
    "columns": "other --columns",
    "mag_axes": "other --mag-axes",
}
WALK, COLUMN_NAMES = "walk", "header"  # Kinds of entries that are no lines of the walk.


@dataclass(frozen=True)
class GivenLines:
    """The lines that a walk gave before it was interrupted, as estimates and revisions in their order."""

    lines: list[StanceEstimate | Revision] = field(default_factory=list)
    estimates: list[StanceEstimate] = field(default_factory=list)  # Those of footfalls, by number; of each
    continues: list[bool] = field(default_factory=list)  # whether it is a further piece of a standing,
    turns: list[float] = field(default_factory=list)  # and by how much the map turned since, rad clockwise.
    retracted: set[int] = field(default_factory=set)  # Numbers of the lines that were taken back.

    @classmethod
    def parse(cls, entries: Sequence[Mapping[str, Any]]) -> GivenLines:
        """Return those of the entries of a file of lines; raises `ValueError`, `KeyError`, `TypeError` for others."""
        given, turned, gone = cls(), 0.0, list[tuple[int, float]]()
        for entry in entries:
            match entry["kind"]:
                case "now":
                    if entry["stance"] != len(given.estimates):
                        raise ValueError("the lines are not in order")
                    given.estimates.append(parse_estimate(entry))
                    given.lines.append(given.estimates[-1])
                    given.continues.append(bool(entry["continues"]))
                    given.turns.append(0.0)
                case "turned":
                    turned = float(np.radians(entry["angle_deg"]))
                    given.turns[:] = [one + turned for one in given.turns]
                case "retracted":
                    gone.append((int(entry["stance"]), float(entry["stance_t"])))
                    given.retracted.add(gone[-1][0])
                case "revised":
                    path = np.array(entry["path"], dtype=np.float64).reshape(-1, 4)
                    given.lines.append(Revision(float(entry["t"]), turned, tuple(gone), path))
                    turned, gone = 0.0, []
        return given


class Record:
    """The files of a record, open and locked.

    The walk of an older record goes on (`resumes`), or it is replaced with the first sample (`force`). Raises
    `OutputError` without either, or if a file cannot be opened, `FormatError` if a record is none of ours.
    """

    def __init__(self, path: Path, resumes: bool, force: bool, remark: Callable[[str], None]) -> None:
        self.path, self._remark = path, remark
        files = [path.with_name(path.name + end) for end in ("", LINES)]
        old = [file for file in files if file.is_file() and file.stat().st_size > 0]
        if old and not (resumes or force):
            raise OutputError(
                f"{old[0]} is there already: go on with it by --resume, replace it by --force, or name another file."
            )
        self.given: GivenLines | None = None  # None of a new walk.
        self.header: list[str] | None = None  # Names of the columns of the source; None before they are known.
        # Whether an unknown time lies before the samples that `add` returned last: where the walk is resumed and its
        # source did not begin again.
        self.is_interrupted = False
        rows = np.empty((0, COLUMNS))
        self._walks: list[dict[str, Any]] = []
        with ExitStack() as opened:
            self._samples, self._lines = (
                opened.enter_context(closing(_AppendedFile(file, begin, remark)))
                for file, begin in zip(files, (HEADER, ""), strict=True)
            )
            if old and resumes:
                rows = self._read()
            opened.pop_all()
        self._recorded: Floats | None = rows  # Until they are replayed.
        self._overlap: Overlap | None = Overlap(rows) if len(rows) else None  # Until nothing comes again.
        self._n, self._about, self._is_begun, self._comes_again = len(rows), dict[str, Any](), False, False

    def begin(self, about: Mapping[str, Any]) -> None:
        """Begin or go on with a walk about which is known what `WORDS` name; written with the first new sample.

        Raises `EstimationError` if the record is of another.
        """
        self._about = json.loads(json.dumps(to_json(about)))
        for key, value in self._about.items():
            if self._walks and self._walks[0].get(key) != value:
                raise EstimationError(
                    f"{self.path.name} was recorded with {WORDS[key]}: resume it with the same, or name another file."
                )

    def replay(self) -> Iterator[Floats]:
        """Yield the recorded samples (n, 11) once, those between two interruptions together, and forget them."""
        rows, self._recorded = self._recorded, None
        assert rows is not None
        yield from np.split(rows, [walk["samples"] for walk in self._walks if walk["is_interrupted"]])

    def add(self, rows: Floats, header: list[str] | None, at_end: bool = False) -> Floats:
        """Record samples (n, 11) of a source; return those that were not recorded before, `at_end` held ones too."""
        self.is_interrupted, overlap = False, self._overlap
        if overlap is not None:
            rows, self._comes_again = overlap.select_new(rows, at_end), overlap.skips
            if overlap.is_over:
                self._overlap = None
                if overlap.left_out:
                    words = format_count(overlap.left_out, "sample")
                    self._remark(f"{words} up to the last one in {self.path.name} came again, and are left out.")
        if not len(rows):
            return rows
        # What is recorded from here on, and its columns.
        entries = list[dict[str, Any]]()
        if not self._is_begun:
            self._is_begun, self.is_interrupted = True, self._n > 0 and not self._comes_again
            begin = {"kind": WALK, "samples": self._n, "is_interrupted": self.is_interrupted}
            entries.append({**begin, **self._about})
        if header != self.header:
            entries.append({"kind": COLUMN_NAMES, "columns": header})
            self.header = header
        if entries:
            self._samples.drop_older()  # before its lines
            self.add_lines([json.dumps(one) for one in entries])
        self._samples.append("".join(format_rows(rows, "%r", ",")).replace("nan", ""), len(rows))
        return rows

    def add_lines(self, lines: Sequence[str]) -> None:
        """Record lines before they are given."""
        if lines:
            self._lines.append(f"[{', '.join(lines)}]\n", len(lines))

    def close(self) -> None:
        """Write what waits, and close the files."""
        for file, what in ((self._samples, "sample"), (self._lines, "line")):
            missing = file.close()
            if missing:
                self._remark(f"{file.path} lacks {format_count(missing, what)} that could not be written.")

    def _read(self) -> Floats:
        """Return the recorded samples (n, 11), without what was cut off at their end; read their lines."""
        name, elsewhere = self.path.name, "name another file to record into"
        with self.path.open("rb") as file:
            if not HEADER.encode().startswith(file.read(len(HEADER))):  # or with a part of it, and has no more
                raise FormatError(f"{name} was not recorded by this command: {elsewhere}.")
        # The lines, and the samples up to the last whole one.
        is_begun, rows = self._samples.cut_last_line(), np.empty((0, COLUMNS))
        try:
            text = self._lines.path.read_text(encoding="ascii").rpartition("\n")[0]
            entries = [entry for line in text.splitlines() for entry in json.loads(line)]
            walks, headers = ([one for one in entries if one["kind"] == kind] for kind in (WALK, COLUMN_NAMES))
            for walk in walks:
                if not walk["samples"] >= 0 or walk["is_interrupted"] not in (True, False):
                    raise ValueError("this is no beginning of a walk")
            header = [str(one) for one in headers[-1]["columns"]] if headers else None
            with np.errstate(over="raise"):  # numbers that no walk has
                given = GivenLines.parse(entries)
            if is_begun:
                rows = rows_of(FORMATS["canonical"].read(read_content(self.path)))
        except (FormatError, ValueError, KeyError, TypeError, FloatingPointError):
            walks, header, given = [], None, None
        # A walk that was killed before there were any samples begins anew.
        if not is_begun and (given is None or given.lines):
            raise FormatError(f"{self._lines.path} is there, and the samples of its walk are not: {elsewhere}.")
        if is_begun and (given is None or not walks):
            raise FormatError(f"{name} or {self._lines.path} is damaged or not there: {elsewhere}.")
        if is_begun:
            self._walks, self.header, self.given = walks, header, given
            self._lines.cut_last_line()
        return rows


class _AppendedFile:
    """A text file that is appended to, open and locked; what it held stays until then, and is replaced if not read."""

    def __init__(self, path: Path, header: str, remark: Callable[[str], None]) -> None:
        self.path, self._header, self._remark = path, header, remark
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            lock(self._file)
            os.truncate(self._file, os.fstat(self._file).st_size)  # no device can be cut
        except BlockingIOError:
            raise OutputError(f"another stream records into {path}: name another file to record into.") from None
        except OSError as error:
            reason = describe_reason(error)
            raise OutputError(f"{path} cannot be written ({reason}): name another file to record into.") from None
        self._good = 0  # Bytes that are whole.
        self._waiting = deque[tuple[str, int]]()  # Whole lines, and how many samples or lines of a walk they hold.
        self._retry_at: float | None = None  # While it cannot be written.
        self._synced_at = 0.0  # When it was last on the disk.

    def drop_older(self) -> None:
        """Drop what an older file held, if that was not read."""
        if self._good == 0:
            os.truncate(self._file, 0)

    def cut_last_line(self) -> bool:
        """Go on behind the last line that has an end; return whether more than the header is before that."""
        self._good = self.path.read_bytes().rfind(b"\n") + 1
        os.truncate(self._file, self._good)
        return self._good > len(self._header)

    def append(self, text: str, count: int) -> None:
        """Append whole lines with `count` samples or lines of a walk, or have them wait while the disk is full."""
        self._waiting.append((text, count))
        if self._retry_at is None or time.monotonic() >= self._retry_at:
            self._write_waiting()

    def close(self) -> int:
        """Write what waits, close it, and return how many samples or lines of a walk it lacks."""
        self._write_waiting()
        os.close(self._file)
        return sum(count for _, count in self._waiting)

    def _write_waiting(self) -> None:
        try:
            while self._waiting:
                self._write(self._waiting[0][0].encode("ascii"))
                self._waiting.popleft()
        except OSError as error:
            if self._retry_at is None:
                reason = describe_reason(error)
                self._remark(f"{self.path} cannot be written ({reason}): the walk goes on, and it is tried again.")
            self._retry_at = time.monotonic() + RETRY_S
            return
        if self._retry_at is not None:
            self._remark(f"{self.path} is written again.")
            self._retry_at = None

    def _write(self, data: bytes) -> None:
        """Append all of it, or nothing: what was written of it is cut off again."""
        place = self._good
        data = data if place else self._header.encode("ascii") + data
        try:
            self.drop_older()
            while data:
                written = os.pwrite(self._file, data, place)
                place, data = place + written, data[written:]
            if time.monotonic() > self._synced_at + SYNC_S:
                os.fsync(self._file)
                self._synced_at = time.monotonic()
        except OSError:
            os.truncate(self._file, self._good)
            raise
        self._good = place
