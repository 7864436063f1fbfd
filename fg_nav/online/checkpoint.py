"""Save a walk in progress and resume it, to the same answer.

A checkpoint is a file that grows (`packing`) with each save:

    samples since the last save, and the state of their filter                 each time
    state of the walk, what changed of it (`saved_state`)                      after it was solved again
    lines before which solutions took effect since that state                  each time

To resume, the walk goes on from the last state with the samples behind it, some tens of footfalls, to the same answer
to the last bit. The file is written again, without what is superseded and samples that no state needs any more, once
it is more than twice as large as it must be.

`collect` refers to what does not change any more and copies some seconds of samples, in milliseconds; `write` may run
in another thread.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.causal import CausalParameters
from fg_nav.errors import EstimationError, FormatError, OutputError, describe_reason
from fg_nav.online.buffer import TAKEN, OnlineOptions
from fg_nav.online.navigator import NavigatorState, OnlineNavigator
from fg_nav.online.packing import append_record, pack, read_records, unpack, write_records
from fg_nav.online.pocket import Navigator, PocketOptions, begin_walk
from fg_nav.online.record_check import is_in_order, refuse_damaged, report_damaged
from fg_nav.online.sample_filter import SampleFilter
from fg_nav.online.saved_state import StateChanges, StateReader, find_changes
from fg_nav.system.processes import PathLock
from fg_nav.text import format_count, to_json

VERSION = 13  # of the records in a checkpoint
BLOCK = 1 << 14  # rows that are replayed at once; the answer does not depend on it
MIN_BYTES = 1 << 20  # a smaller file is not written again
ROW_BYTES = 8 * TAKEN


@dataclass(frozen=True)
class Frame:
    """Options of the walk, which stay as they are from save to save."""

    options: OnlineOptions | PocketOptions
    detection: CausalParameters


@dataclass(frozen=True)
class Record:
    """What the file holds of one save."""

    frame: Frame | None  # In the first record of a file; None in others.
    first: int  # Number of the first of the rows in the walk.
    rows: Floats  # (n, 12) samples since the last save.
    kept_from: int  # First sample that is still needed.
    changes: StateChanges | None  # Of the state of the walk; None where that of the record before is valid.
    judge: dict[str, Any]  # This and the rest are of the navigator, behind these samples.
    source: dict[str, Any]
    has_ended: bool
    n_reported: int
    takeovers: tuple[int, ...]


@dataclass(frozen=True)
class Snapshot:
    """A record without its changes, and the state that they lead to; None without."""

    record: Record
    state: NavigatorState | None


class Checkpoint:
    """A file in which a walk is saved as it goes on, by `collect` and `write` in turn."""

    def __init__(self, path: Path | str) -> None:
        self._path = Path(path)
        self._lock: PathLock | None = None
        self._size = self._stop = 0
        self._state: NavigatorState | None = None
        self._begun_at = -1
        self._state_bytes = 0

    @contextmanager
    def hold(self) -> Iterator[None]:
        """Keep other streams out of the file while the block runs; raises `OutputError` if one saves in it."""
        self._lock = PathLock(self._path)
        try:
            self._renew_lock()
            yield
        finally:
            self._lock.release()
            self._lock = None

    def _renew_lock(self) -> None:
        try:
            if self._lock is not None:
                self._lock.renew()
        except BlockingIOError:
            raise OutputError(f"another stream saves its walk in {self._path}: name another checkpoint.") from None

    def collect(self, navigator: Navigator) -> Snapshot:
        """Return a snapshot of what is new since the last save, for `write` while the walk goes on."""
        size = 0
        with suppress(OSError):
            size = self._path.stat().st_size
        if not 0 < self._size == size:  # the file is not as the last save left it
            self._size, self._stop, self._state, self._begun_at = 0, 0, None, -1
        buffer, is_new = navigator.buffer, self._size == 0
        # A state is needed if the walk was solved again, or if samples were discarded before they were saved.
        first, state = max(self._stop, buffer.first), None
        if isinstance(navigator, OnlineNavigator) and navigator.smoother.anchors:
            newest = navigator.smoother.anchors[-1].stance.sample
            state = navigator.state() if newest != self._begun_at or first > self._stop else None
        record = Record(
            frame=Frame(navigator.options, navigator.detection) if is_new else None,
            first=first,
            rows=buffer.between(first, buffer.stop),
            kept_from=buffer.first,
            changes=None,
            judge=navigator.judge.state(),
            source=dict(navigator.source),
            has_ended=navigator.has_ended,
            n_reported=len(navigator.reported_continues),
            takeovers=navigator.takeovers,
        )
        return Snapshot(record, state)

    def write(self, snapshot: Snapshot) -> None:
        """Write what was collected; raises `OutputError` if that cannot be, and then the file stays as it was."""
        record, state = snapshot.record, snapshot.state
        if state is not None:
            record = replace(record, changes=find_changes(state, self._state))
        packed = pack(record)
        try:
            if record.frame is not None:
                if self._lock is not None and self._lock.file is None:
                    self._renew_lock()
                self._size = write_records(self._path, VERSION, [packed])
                self._renew_lock()
            else:
                self._size = append_record(self._path, self._size, packed)
            # all of it is on the disk: the next save begins behind it
            self._stop = record.first + len(record.rows)
            if state is not None:
                self._state, self._begun_at = state, state.smoother.starts[-1].stance.sample
                self._state_bytes = len(packed)
            # what is superseded is left out once it is more than half: beside the newest state and the samples needed
            needed = (self._stop - record.kept_from) * ROW_BYTES + self._state_bytes
            if self._state is not None:
                smoother = self._state.smoother
                rows = (*smoother.told, *smoother.past.rows)
                needed += len(rows) * rows[0].numbers.nbytes + sum(part.nbytes for part in smoother.past.nodes)
            if self._size > max(2 * needed, MIN_BYTES):
                self._size = _write_again(self._path)
                self._renew_lock()
        except OSError as error:
            reason = describe_reason(error)
            raise OutputError(
                f"{self._path} cannot be written ({reason}): name another checkpoint, or make room."
            ) from None

    def resume(
        self,
        options: OnlineOptions | PocketOptions | None = None,
        remark: Callable[[str], None] = lambda words: None,
        progress: Callable[[float], None] | None = None,
        detection: CausalParameters = CausalParameters(),
        background: bool = False,
    ) -> Navigator:
        """Resume the walk that the file holds, see `load`; what is saved from then on goes into the same file."""
        name = self._path.name
        with report_damaged(self._path):
            content = _Content(self._path)
            self._state = content.state
        frame = content.frame
        calibration, known = (getattr(one, "calibration", None) for one in (options, frame.options))
        compared = (
            (calibration, known, "another calibration"),
            (options, frame.options, "other options"),
            (detection, frame.detection, "another detection"),
        )
        for given, known, other in compared:
            if given is not None and to_json(given) != to_json(known):
                raise EstimationError(f"{name} was made with {other}: give the same, or name another checkpoint.")
        with report_damaged(self._path):
            navigator = _resume(content, remark, progress, background)
        if len(navigator.reported_continues) != content.newest.n_reported:
            raise EstimationError(f"{name} is of a version that found other footfalls: begin the walk again.")
        self._size, self._stop = content.size, content.stop
        self._begun_at = -1 if self._state is None else self._state.smoother.starts[-1].stance.sample
        behind = self._path.stat().st_size - content.size
        if behind:
            remark(f"the last {format_count(behind, 'byte')} of {name} are not whole, and left out.")
            with suppress(OSError):
                os.truncate(self._path, content.size)
        return navigator


def save(navigator: Navigator, path: Path | str) -> None:
    """Write a checkpoint in place of an older one; raises `OutputError` if that cannot be."""
    checkpoint = Checkpoint(path)
    checkpoint.write(checkpoint.collect(navigator))


def load(
    path: Path | str,
    options: OnlineOptions | PocketOptions | None = None,
    remark: Callable[[str], None] = lambda words: None,
    progress: Callable[[float], None] | None = None,
    detection: CausalParameters = CausalParameters(),
    background: bool = False,
) -> Navigator:
    """Resume a walk where a checkpoint left it.

    Push what the source sends then, from its beginning or from a later moment on (`overlap`, `judge`). A walk that had
    ended when it was saved has ended now too: it accepts no more samples, and returns all else.

    Raises `FormatError` if the file is no checkpoint, or one of another version, and `EstimationError` if it was made
    with other options or another detection, or finds other footfalls now.

    Parameters
    ----------
    options : of the walk, for comparison; None for those of the checkpoint.
    remark, detection, background : as for `OnlineNavigator`.
    progress : called from time to time with the fraction that is done.
    """
    return Checkpoint(path).resume(options, remark, progress, detection, background)


class _Content:
    """Content of the records of a file; raises `FormatError` if it is no checkpoint.

    The samples `first <= i < stop` are in `blocks`, unless they are not read; `size` is that of the file as far as it
    is whole, `frame` from its first record, `newest` its last record, and `state` the last state, None without.
    """

    def __init__(self, path: Path, with_samples: bool = True) -> None:
        self.blocks: list[Floats] = []
        self.first = self.stop = self.size = 0
        reader, frame, records = StateReader(), None, list[Record]()
        newest: Record | None = None
        for record, size in _read(path):
            records += [record] * with_samples
            self.size, frame, newest = size, frame or record.frame, record
            if record.first > self.stop:
                self.blocks, self.first = [], record.first
            self.stop = record.first + len(record.rows)
            if with_samples:
                self.blocks.append(record.rows)
            if record.changes is not None:
                reader.add(record.changes)
        if frame is None or newest is None:
            raise FormatError(f"{path.name} is no checkpoint of a walk: name another file, or remove it.")
        self.frame, self.newest = frame, newest
        if with_samples:  # to be resumed; else the program itself wrote them
            refuse_damaged(path, records, self.stop)
            # samples that are not needed any more
            before = newest.kept_from
            while self.blocks and self.first + len(self.blocks[0]) <= before:
                self.first += len(self.blocks.pop(0))
            if self.blocks and self.first < before:
                self.blocks[0], self.first = self.blocks[0][before - self.first :], before
        self.state = reader.state()


def _resume(
    content: _Content,
    remark: Callable[[str], None],
    progress: Callable[[float], None] | None,
    background: bool,
) -> Navigator:
    """Return a navigator that goes on from the last state with the samples behind it."""
    newest, frame, state = content.newest, content.frame, content.state
    judge = SampleFilter.resume(newest.judge, content.blocks, remark, content.first)
    navigator = begin_walk(frame.options, remark, frame.detection, judge, background)
    navigator.source.update(newest.source)
    if "units" in newest.source:
        navigator.units.resume(newest.source["units"])
    # the samples that the state includes, and the state
    known = 0 if state is None else state.stop - content.first
    navigator.buffer.skip_to(content.first)
    behind = [np.empty((0, TAKEN))]
    for block in content.blocks:
        navigator.buffer.append(block[: max(known, 0)])
        behind.append(block[max(known, 0) :])
        known -= len(block)
    if state is not None:
        assert isinstance(navigator, OnlineNavigator)
        navigator.resume(state, newest.takeovers, newest.n_reported)
    # those behind it, as they came
    later = np.concatenate(behind)
    for start in range(0, len(later), BLOCK):
        navigator.add_rows(later[start : start + BLOCK])
        if progress is not None:
            progress(min(start + BLOCK, len(later)) / len(later))
    if newest.has_ended:
        navigator.close()
    return navigator


def _read(path: Path) -> Iterator[tuple[Record, int]]:
    """Yield the records of a file, each with the size of the file up to its end."""
    for content, size in read_records(path, VERSION):
        try:
            record = unpack(content)
        except FormatError:
            record = None
        if not (isinstance(record, Record) and is_in_order(record.rows, TAKEN)):
            raise FormatError(f"{path.name} is no checkpoint of a walk: name another file, or remove it.")
        yield record, size


def _write_again(path: Path) -> int:
    """Rewrite a file without superseded records, samples one record at a time; return its size (bytes)."""
    content = _Content(path, with_samples=False)
    newest, state = replace(content.newest, frame=None, changes=None), content.state
    changes = None if state is None else find_changes(state, None)

    def list_records() -> Iterator[bytes]:
        # all but the samples first, then these, in records that add nothing else
        kept_from = newest.kept_from
        yield pack(replace(newest, frame=content.frame, first=kept_from, rows=newest.rows[:0], changes=changes))
        for record, _ in _read(path):
            stop = record.first + len(record.rows)
            if stop > kept_from:
                first = max(record.first, kept_from)
                yield pack(replace(newest, first=first, rows=record.rows[first - record.first :]))

    return write_records(path, VERSION, list_records())
