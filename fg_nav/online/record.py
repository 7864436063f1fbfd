"""The raw samples of a stream, written as they come: canonical CSV, as `fg-nav run` reads it, exact to the last bit.

Before calibration, and before anything is left out or set on. A thread writes once a second what has come since; what
cannot be written, because the disk is full, waits and is tried again. An older file that is to be replaced stays as it
is until the first sample is there. A walk that is resumed goes on in its file, without what is in it already.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.mapping import CANONICAL
from fg_nav.errors import FgNavError, FormatError, OutputError, describe_reason
from fg_nav.io.content import read_content
from fg_nav.io.formats import FORMATS
from fg_nav.io.writing import format_rows
from fg_nav.online.buffer import COLUMNS, rows_of
from fg_nav.online.overlap import TAIL, Overlap
from fg_nav.online.rows import Columns
from fg_nav.online.sources import SampleSource, open_samples
from fg_nav.system.processes import lock

WRITE_S = 1.0  # between two writes
MAX_WAITING = 500_000  # samples that wait for a disk with room, twenty minutes at 400 Hz; the oldest are dropped first
PART = 5000  # samples that are written at once, in some hundredths of a second
HEADER = ",".join(CANONICAL) + "\n"


class Recorder:
    """Writes samples into a file.

    Raises `OutputError` if the file is there already and is not to be continued or replaced, or cannot be opened, and
    `FormatError` if it is to be continued and is none of ours.

    Parameters
    ----------
    goes_on : whether an older file is that of the same walk, and is continued.
    force : whether another older file is replaced.
    remark : called with a sentence if the file cannot be written, and when it can again.
    """

    def __init__(self, path: Path, goes_on: bool, force: bool, remark: Callable[[str], None]) -> None:
        self._path, self._remark = path, remark
        self._overlap = Overlap([], [(0, 0.0)], [], np.empty((0, COLUMNS)), np.empty((0, COLUMNS)))
        is_old = path.is_file() and path.stat().st_size > 0
        if is_old and not goes_on and not force:
            raise OutputError(f"{path} is there already: name another file to record into, or replace it by --force.")
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            lock(self._file)
            self._good = 0
            if is_old and goes_on:
                self._reopen()
        except BlockingIOError:
            raise OutputError(f"another stream records into {path}: name another file to record into.") from None
        except OSError as error:
            reason = describe_reason(error)
            raise OutputError(f"{path} cannot be written ({reason}): name another file to record into.") from None
        self._text = "" if self._good else HEADER
        self._waiting: deque[Floats] = deque()
        self._count = self._lost = 0
        self._fails = False
        self._lock, self._closed = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def add(self, rows: Floats) -> None:
        """Add samples (n, 11), to be written within a second."""
        self._put(self._overlap.select_new(rows))

    def close(self) -> None:
        """Write what waits, and close the file."""
        self._put(self._overlap.select_new(np.empty((0, COLUMNS)), at_end=True))
        self._closed.set()
        self._thread.join()
        os.close(self._file)
        if self._lost + self._count:
            self._remark(f"{self._path} lacks {self._lost + self._count} samples that could not be written.")

    def _put(self, rows: Floats) -> None:
        if not len(rows):
            return
        with self._lock:
            self._waiting.append(rows)
            self._count += len(rows)
            while self._count > MAX_WAITING:
                given_up = len(self._waiting.popleft())
                self._count, self._lost = self._count - given_up, self._lost + given_up

    def _run(self) -> None:
        is_over = False
        while not is_over:
            is_over = self._closed.wait(WRITE_S)
            self._write_waiting()

    def _write_waiting(self) -> None:
        """Write what waits, part by part; put back the part with which that fails."""
        while True:
            # the oldest samples, some `PART`
            blocks: list[Floats] = []
            with self._lock:
                taken = 0
                while self._waiting and taken < PART:
                    blocks.append(self._waiting.popleft())
                    taken += len(blocks[-1])
                self._count -= taken
            if not blocks:
                break
            text = self._text + "".join(format_rows(np.concatenate(blocks), "%r", ",")).replace("nan", "")
            try:
                self._write(text.encode("ascii"))
            except OSError as error:
                with self._lock:
                    self._waiting.extendleft(reversed(blocks))
                    self._count += taken
                if not self._fails:
                    reason = describe_reason(error)
                    self._remark(f"{self._path} cannot be written ({reason}): the walk goes on, and it is tried again.")
                self._fails = True
                return
            self._text = ""
        if self._fails:
            self._remark(f"{self._path} is written again.")
        self._fails = False

    def _write(self, data: bytes) -> None:
        """Append all of it, or nothing: what was written of it is cut off again."""
        place = self._good
        try:
            if place == 0 and self._path.is_file():
                os.truncate(self._file, 0)  # what an older file held
            while data:
                written = os.pwrite(self._file, data, place)
                place, data = place + written, data[written:]
        except OSError:
            if self._path.is_file():
                os.truncate(self._file, self._good)
            raise
        self._good = place

    def _reopen(self) -> None:
        """Go on in a file of ours behind its last line with an end, where it is cut; compare with its samples."""
        if not HEADER.encode().startswith(os.pread(self._file, len(HEADER), 0)):
            os.close(self._file)
            raise FormatError(f"{self._path.name} was not recorded by this command: name another file to record into.")
        size = os.fstat(self._file).st_size
        tail = os.pread(self._file, 1 << 16, max(size - (1 << 16), 0))
        self._good = size - len(tail) + tail.rfind(b"\n") + 1
        os.truncate(self._file, self._good)
        if not self._good:
            return
        known = np.empty((0, COLUMNS))
        with suppress(FormatError):  # it has no samples yet
            known = rows_of(FORMATS["canonical"].read(read_content(self._path)))
        self._overlap = Overlap([known], [(0, 0.0)], [], known[-TAIL:], known[:0])


class _RecordedSource(SampleSource):
    """A source whose samples are recorded as they are read."""

    def __init__(self, source: SampleSource, recorder: Recorder) -> None:
        self.name = source.name
        self._source, self._recorder = source, recorder

    @property
    def header(self) -> list[str] | None:
        return self._source.header

    @property
    def lost(self) -> int:
        return self._source.lost

    def resume(self, header: Sequence[str]) -> None:
        self._source.resume(header)

    def read(self, wait_s: float) -> Floats | None:
        rows = self._source.read(wait_s)
        if rows is not None:
            self._recorder.add(rows)
        return rows

    def finish(self) -> Floats:
        rows = self._source.finish()
        self._recorder.add(rows)
        return rows

    def close(self) -> None:
        self._source.close()
        self._recorder.close()


def open_recorded(
    path: Path,
    goes_on: bool,
    force: bool,
    word: str,
    columns: Columns | None,
    baud: int,
    speed: str | None,
    remark: Callable[[str], None],
) -> SampleSource:
    """Open a source as `open_samples` does, and before it the file that it is recorded in (`Recorder`)."""
    if path.exists() and Path(word).exists() and path.samefile(word):
        raise OutputError(f"{path} is what is streamed: name another file to record into.")
    recorder = Recorder(path, goes_on, force, remark)
    try:
        return _RecordedSource(open_samples(word, columns, baud, speed, remark), recorder)
    except FgNavError:
        recorder.close()
        raise
