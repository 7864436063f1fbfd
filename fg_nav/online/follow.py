"""Follow a source to its end: rows in, estimates out, checkpoints on the way.

    StreamOptions  how a source is followed: options of the navigator, calibration, checkpoint
    follow_source  rows -> navigator -> one line an estimate, until the source ends or an event is set
    StreamedWalk   the closed navigator, to be solved as a whole

Nothing that happens to the stream ends the walk but its end: bad rows are left out, and a stalled source is waited for,
with a remark on each. Checkpoints come every `checkpoint_s`, are written in a thread of their own, and less often once
that takes long: at most one part in twenty of the time goes into it.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.of_recording import Calibration
from fg_nav.errors import EstimationError, FgNavError
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.checkpoint import Checkpoint, Snapshot
from fg_nav.online.estimates import Revision, StanceEstimate, format_estimate, format_revision, thin_rows
from fg_nav.online.line_verdict import Judged, LineVerdict
from fg_nav.online.outlets import Say, StatusReporter, describe_walk
from fg_nav.online.pocket import Navigator, PocketOptions, begin_walk
from fg_nav.online.record_check import report_damaged
from fg_nav.online.rows import Columns
from fg_nav.online.source_check import LossCounter, Silence, SourceCheck, describe_losses
from fg_nav.online.sources import SampleSource
from fg_nav.text import to_json
from fg_nav.view.process import ListenerProcess

WAIT_S = 0.2  # for bytes, before the stop signal is checked
SAVING_SHARE = 0.05  # of the time at most

# Ctrl-C, a service that is stopped, a terminal or connection that is gone: they end the walk.
ENDING = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))


@dataclass(frozen=True)
class StreamedWalk:
    """A walk that has ended: its navigator, the name of its source, and the calibration and axes that were applied.

    `polish` requests its batch solution as well; `rate_sigma` as of `StreamOptions`.
    """

    navigator: Navigator
    name: str
    calibration: Calibration | None
    mag_axes: MagAxes | None = None
    polish: bool = False
    rate_sigma: float = 0.0


@dataclass(frozen=True)
class StreamOptions:
    """How a source is followed."""

    online: OnlineOptions | PocketOptions = field(default_factory=OnlineOptions)
    checkpoint: Path | None = None  # File to save the walk in, and to resume it from if it is there.
    checkpoint_s: float = 10.0  # Between two saves.
    stalled_s: float = 5.0  # Silence after which it is remarked that the source stalls.
    until_silent_s: float | None = None  # Silence after which the walk ends; None to wait for ever.
    calibration: Calibration | None = None  # To apply.
    mag_axes: MagAxes | None = None  # Of the magnetometer in those of the gyroscope; None for the same.
    columns: Columns | None = None  # Of rows without a header, which a checkpoint must share.
    background: bool = False  # Whether the walk is solved again in another process.

    @property
    def rate_sigma(self) -> float:
        """Sigma of the rate by which stamps are counted, a share of it; 0 where rows have stamps."""
        return 0.0 if self.columns is None else self.columns.rate_sigma


def follow_source(
    source: SampleSource,
    options: StreamOptions,
    emit: Say,
    remark: Say,
    stop: threading.Event | None = None,
    watcher: ListenerProcess | None = None,
) -> Navigator:
    """Follow a source to its end; return the navigator, closed, with the whole walk.

    Raises `FormatError`, `RecordingError`, `EstimationError` if the rows are of another format or unit, or a checkpoint
    cannot be resumed.

    Parameters
    ----------
    emit : called with one line of JSON (`fg_nav.online.estimates`) for each estimate.
    remark : called with a sentence for people about what is odd.
    stop : ends the walk when it is set.
    watcher : sent the status between footfalls; None without.
    """
    checkpoint = None if options.checkpoint is None else Checkpoint(options.checkpoint)
    with nullcontext() if checkpoint is None else checkpoint.hold():
        # the walk, new or resumed
        navigator = _open_navigator(options, checkpoint, remark)
        status = None if watcher is None else StatusReporter(watcher)
        walk = FollowedWalk(navigator, options, checkpoint, emit, remark, status)
        if navigator.footfalls:  # its path, for clients that have not seen it
            table = navigator.smoothed()
            path = np.column_stack([table.t, table.position])[thin_rows(len(table))]
            walk.emit_lines([(Revision(float(table.t[-1]), 0.0, (), path), None)])
        if navigator.source.get("header") and options.checkpoint is not None:
            with report_damaged(options.checkpoint):
                source.resume(navigator.source["header"])
        # the source, to its end
        silence = Silence(source.name, options.stalled_s, options.until_silent_s, remark)
        while not (stop is not None and stop.is_set()):
            rows = source.read(WAIT_S)
            if rows is None or silence.is_over(len(rows)):
                break
            walk.add(rows, source.header)
            walk.show_status(source.lost)
        walk.add(source.finish(), source.header)
        walk.end(source.lost)
    return navigator


def _open_navigator(options: StreamOptions, checkpoint: Checkpoint | None, remark: Say) -> Navigator:
    path, axes = options.checkpoint, options.mag_axes
    given = {"calibration": to_json(options.calibration), "columns": to_json(options.columns)}
    given["mag_axes"] = None if axes is None else str(axes)
    if path is None or checkpoint is None or not path.exists():
        navigator = begin_walk(options.online, remark, background=options.background)
        navigator.source |= given
        return navigator
    navigator = checkpoint.resume(options.online, remark, background=options.background)
    changed = {"calibration": "another calibration", "columns": "other --columns", "mag_axes": "other --mag-axes"}
    for key, words in changed.items():
        if navigator.source.get(key) != given[key]:
            raise EstimationError(f"{path.name} was made with {words}: give the same, or name another.")
    rows = "strides" if isinstance(options.online, PocketOptions) else "stances"
    remark(f"resumed from {path.name}: {len(navigator.footfalls)} {rows}, {navigator.buffer.stop} samples.")
    return navigator


class FollowedWalk:
    """Gives samples to the navigator, emits the lines of its estimates, and saves the walk in its checkpoint.

    Arguments are as of `follow_source`; the checkpoint is held, the status reported if somebody may watch.
    """

    def __init__(
        self,
        navigator: Navigator,
        options: StreamOptions,
        checkpoint: Checkpoint | None,
        emit: Say,
        remark: Say,
        status: StatusReporter | None = None,
    ) -> None:
        self._checkpoint, self._navigator, self._options = checkpoint, navigator, options
        self._emit, self._remark, self._status, self._unsaved = emit, remark, status, False
        self._races, self._due = navigator.races, time.monotonic() + options.checkpoint_s
        self._check = SourceCheck("pocket" if isinstance(options.online, PocketOptions) else "foot", remark)
        in_pocket = isinstance(options.online, PocketOptions)
        self._verdict = LineVerdict(in_pocket, remark, not navigator.footfalls, options.rate_sigma)
        self.losses = LossCounter(remark)
        # what a checkpoint keeps beside the navigator
        self._parts: dict[str, SourceCheck | LineVerdict | LossCounter] = {
            "check": self._check,
            "verdict": self._verdict,
            "losses": self.losses,
        }
        with nullcontext() if options.checkpoint is None else report_damaged(options.checkpoint):
            for name, part in self._parts.items():
                if name in navigator.source:
                    part.resume(navigator.source[name])
        self._saving: threading.Thread | None = None

    def add(self, rows: Floats, header: list[str] | None) -> None:
        """Calibrate and push rows (n, 11), emit the lines that they complete, save if due; `header` names columns."""
        if self._status is not None:
            self._status.count_samples(len(rows))
        if not len(rows):
            return
        self._check.add(rows)
        self._navigator.source["header"] = header
        overlap = self._navigator.judge.overlap
        # Axes and calibration are applied as to a recording (`fg_nav.walk`).
        acc, mag, found = rows[:, 1:4], rows[:, 7:10], self._options.calibration
        if self._options.mag_axes is not None:
            mag = mag @ self._options.mag_axes.P.T
        if found is not None and found.magnetometer is not None:
            mag = np.asarray(found.magnetometer.correct(mag))
        if found is not None and found.accelerometer is not None:
            acc = found.accelerometer.correct(acc)
        field = mag if self._options.online.use_field else None
        made = self._navigator.push(rows[:, 0], acc, rows[:, 4:7], field, rows[:, 10])
        self.losses.add(rows[:, 0], overlap)
        self._verdict.axes.look_at(self._navigator.buffer)
        judged = self._judge(made)
        # What depends on the machine's speed is saved before it is sent, once the last save is done.
        raced = self._navigator.races != self._races and self._due < np.inf
        if self._checkpoint is not None and (raced or time.monotonic() >= self._due):
            self._save(self._checkpoint)
        self.emit_lines(judged)

    def end(self, lost_datagrams: int) -> None:
        """Save and end the walk, and emit its last lines; `lost_datagrams` as the source counted them."""
        self.count_losses(lost_datagrams)
        if self._checkpoint is not None:
            self._save(self._checkpoint)
            if self._saving is not None:
                self._saving.join()
        self.report(self._navigator.close())
        self.show_status(lost_datagrams, ended=True)

    def count_losses(self, lost_datagrams: int) -> None:
        """Count what was lost in all, and remark it."""
        self.losses.finish()
        self._navigator.source["lost"] = lost = self.losses.report(lost_datagrams)
        for words in describe_losses(lost):
            self._remark(f"{words}.")

    def report(self, made: Sequence[StanceEstimate | Revision]) -> None:
        """Judge what the navigator made, and emit its lines."""
        self.emit_lines(self._judge(made))

    def _judge(self, made: Sequence[StanceEstimate | Revision]) -> list[Judged]:
        if self._options.rate_sigma > 0.0:
            made = [one if isinstance(one, Revision) else one.widen(self._options.rate_sigma) for one in made]
        return self._verdict.judge(made, self._navigator.reported_continues)

    def show_status(self, lost_datagrams: int, ended: bool = False) -> None:
        """Send the status between footfalls."""
        if self._status is not None:
            self._status.report(lambda: describe_walk(self._navigator), self.losses.report(lost_datagrams), ended)

    def emit_lines(self, found: Sequence[Judged]) -> None:
        """Emit the JSON lines of estimates, each with its verdict, and of revisions."""
        for one, verdict in found:
            if isinstance(one, Revision):
                for line in format_revision(one):
                    self._emit(line)
            else:
                continues = self._navigator.reported_continues[one.number]
                self._emit(format_estimate(one, continues, self._navigator.judge.sensor_time, verdict))
                if self._status is not None:
                    self._status.note_line()

    def _save(self, checkpoint: Checkpoint) -> None:
        """Save in a thread: only what is collected holds the walk up."""
        if self._saving is not None:
            self._saving.join()
        self._navigator.source |= {name: part.state() for name, part in self._parts.items()}
        snapshot, self._races = checkpoint.collect(self._navigator), self._navigator.races
        self._saving = threading.Thread(target=self._write, args=(snapshot, checkpoint))
        self._due = np.inf
        self._saving.start()

    def _write(self, snapshot: Snapshot, checkpoint: Checkpoint) -> None:
        began = time.monotonic()
        try:
            checkpoint.write(snapshot)
            self._unsaved = False
        except FgNavError as error:  # the walk goes on, disk full or not
            if not self._unsaved:
                self._remark(str(error))
            self._unsaved = True
        finally:
            took = time.monotonic() - began
            self._due = time.monotonic() + max(self._options.checkpoint_s, took / SAVING_SHARE)
